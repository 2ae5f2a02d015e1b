//! The runs of every command.

/// A command and its runs.
pub struct Row {
    pub command: &'static str,
    /// Arguments of runs that succeed.
    pub good: &'static [&'static [&'static str]],
    /// Option for JSON, if there is a result. Runs of `good` without JSON are excluded.
    pub json: &'static [&'static str],
    /// Arguments of runs that fail, the exit code, and a part of the message.
    pub bad: &'static [(&'static [&'static str], i32, &'static str)],
    /// Its output is for programs and may be wider than a terminal.
    pub for_programs: bool,
    /// A run takes seconds: each is run once, with its JSON in a file.
    pub is_long: bool,
}

pub const fn row(command: &'static str) -> Row {
    Row { command, good: &[], json: &[], bad: &[], for_programs: false, is_long: false }
}

/// Commands that need no board.
pub const TABLE: &[Row] = &[
    Row {
        good: &[&["--seed", "12", "--csv", "team12.csv"]],
        json: &["--json"],
        bad: &[
            (&["--csv", "a.csv", "--report", "a.rig.toml"], 1, "two outputs have the name a.rig.toml"),
            (&["--csv", "-"], 1, "give it a file name"),
        ],
        is_long: true,
        ..row("demo")
    },
    Row {
        good: &[&[], &["speed_"]],
        json: &["--json"],
        bad: &[(&["counts_per_rew"], 1, "did you mean counts_per_rev?")],
        ..row("settings")
    },
    Row {
        good: &[&["--rig", "model.toml"]],
        json: &["--json"],
        bad: &[
            (&["--rig", "none.toml"], 1, "none.toml"),
            (&["--rig", "bad.toml"], 1, "bad.toml"),
            (&["--rig", "model.toml", "--bode", "model.toml"], 1, "model.toml is an input and would be overwritten"),
            (&["--rig", "model.toml", "--bode", "a.csv", "--step", "a.csv"], 1, "two outputs have the name a.csv"),
            (&["--rig", "model.toml", "--json", "--step", "-"], 1, "cannot both go to the standard output"),
        ],
        ..row("analyse")
    },
    Row {
        good: &[
            &["run.csv", "run.csv"],
            &["model.toml", "other.toml", "--voltage", "-6"],
            &["run.csv", "model.toml", "--rig", "rig.toml"],
            &["found.json", "found.json"],
        ],
        json: &["--json", "-"],
        bad: &[
            (&["none.csv", "run.csv"], 1, "none.csv"),
            (&["run.csv", "bad.csv"], 1, "bad.csv"),
            (&["run.csv", "run.xls"], 1, "expected .csv"),
            (&["run.csv", "run.csv", "--plot", "/nonexistent/a.svg"], 3, "/nonexistent/a.svg"),
            (&["run.csv"], 2, "<SECOND>"),
            (
                &["found.json", "found.json", "--json", "found.json"],
                1,
                "found.json is an input and would be overwritten",
            ),
        ],
        ..row("compare")
    },
    Row {
        good: &[&["run.csv", "run.mat"], &["run.csv", "run.npz"], &["run.csv", "jug.csv", "--to", "plotjuggler"]],
        json: &["--json"],
        bad: &[
            (&["none.csv", "run.mat"], 1, "none.csv"),
            (&["bad.csv", "run.mat"], 1, "bad.csv"),
            (&["run.csv", "/nonexistent/run.mat"], 3, "make its folder first"),
            (&["run.csv", "run.mat", "--from", "xls"], 2, "xls"),
            (&["run.csv", "./run.csv"], 1, "run.csv is an input and would be overwritten"),
            (&["junk.csv", "a.mat"], 1, "junk.csv: byte 0: no header of a NumPy array"),
            (&["run.csv", "a.csv", "--rename", "omega_rad_per_s=u_V"], 1, "two columns would be called u_V"),
            (&["run.csv", "a.csv", "--map", "u_V=u_V*nan"], 2, "and a number"),
        ],
        ..row("convert")
    },
    Row {
        good: &[
            &["--rig", "rig.toml", "--model", "model.toml", "--speed", "--bandwidth-Hz", "10"],
            &["--rig", "rig.toml", "--model", "other.toml", "--position", "--settling-s", "0.3", "--compensate"],
        ],
        json: &["--json", "-"],
        bad: &[
            (&["--rig", "none.toml", "--speed", "--bandwidth-Hz", "10"], 1, "none.toml"),
            (&["--rig", "model.toml", "--speed", "--bandwidth-Hz", "10"], 1, "encoder.counts_per_rev"),
            (&["--rig", "rig.toml", "--speed"], 2, "--bandwidth-Hz"),
            (&["--rig", "rig.toml", "--speed", "--compensate", "--coulomb-Nm", "-1"], 2, "expected 0 or more"),
            (
                &["--rig", "rig.toml", "--speed", "--bandwidth-Hz", "10", "--report", "./rig.toml"],
                1,
                "rig.toml is an input and would be overwritten",
            ),
        ],
        ..row("design")
    },
    Row {
        good: &[&["run.csv", "--rig", "rig.toml"], &["table.csv", "--rig", "stand.toml"]],
        json: &["--json", "-"],
        bad: &[
            (&["none.csv", "--rig", "rig.toml"], 1, "none.csv"),
            (&["bad.csv", "--rig", "rig.toml"], 1, "bad.csv"),
            (&["run.csv", "--rig", "bad.toml"], 1, "bad.toml"),
            (&["none.csv"], 1, "none.csv: there is no such file; its folder has bad.csv, "),
            (&["run.csv", "--rig", "junk.csv"], 1, "junk.csv: this is not text, but a rig file (TOML) is expected"),
            (&[".", "--rig", "rig.toml"], 1, "this is a folder, but a recording (CSV) is expected"),
            (
                &["."],
                1,
                "this is a folder, but a recording (CSV) is expected; `motorbench diagnose --batch` takes all in a folder",
            ),
            (&["run.csv", "--rig", "."], 1, "this is a folder, but a rig file (TOML) is expected"),
            (&["run.csv", "--rig", "run.csv"], 1, "run.csv: this is CSV, but a rig file (TOML) is expected"),
            (&["rig.toml"], 1, "rig.toml: this is TOML, but a recording (CSV) is expected"),
            (&["names.csv"], 1, "no known channel among time, volts. Likely: --column"),
            (&["slow.csv"], 1, "add --column t_s=t_s*0.001"),
            (&["time.csv"], 1, "time.csv: there is no column t_s"),
            (&["glitch.csv"], 1, "glitch.csv: rows are 1.00 s apart"),
            (&["run.csv", "--model", "run.csv"], 1, "run.csv is an input and would be overwritten"),
            (&["run.csv", "--model", "model.toml"], 1, "model.toml was not written by motorbench"),
            (
                &["run.csv", "--rig", "rig.toml", "--report", "rig.toml"],
                1,
                "rig.toml is an input and would be overwritten",
            ),
            (&["run.csv", "--json", "-", "--model", "-"], 1, "cannot both go to the standard output"),
            (&[], 2, "<RECORDINGS>"),
        ],
        is_long: true,
        ..row("diagnose")
    },
    Row {
        good: &[&["run.csv", "--rig", "rig.toml"]],
        json: &["--json", "-"],
        bad: &[
            (&["none.csv"], 1, "none.csv"),
            (&["bad.csv"], 1, "bad.csv"),
            (&["run.csv", "--rig", "rig.toml", "--model", "/nonexistent/m.toml"], 3, "/nonexistent/m.toml"),
            (&["run.csv", "--rig", "rig.toml", "--json=run.csv"], 1, "run.csv is an input and would be overwritten"),
            (&["run.csv", "--model", "model.toml"], 1, "model.toml was not written by motorbench"),
            (&[], 2, "<RECORDINGS>"),
        ],
        ..row("identify")
    },
    Row {
        good: &[&["run.csv", "--udp", "127.0.0.1:9", "--teleplot", "127.0.0.1:9", "--speed", "1000"]],
        json: &["--json"],
        bad: &[
            (&["none.csv"], 1, "none.csv"),
            (&["table.csv"], 1, "no column t_s"),
            (&["run.csv", "--speed", "0"], 2, "above 0"),
            (&["run.csv", "--udp", "nowhere"], 2, "HOST:PORT"),
        ],
        ..row("live")
    },
    Row {
        good: &[&["scenario.toml"], &["position.toml"], &["run.toml"], &["scenario.toml", "--console", "gains.txt"]],
        json: &["--json", "-"],
        bad: &[
            (&["none.toml"], 1, "none.toml"),
            (&["bad.toml"], 1, "bad.toml"),
            (&["scenario.toml", "--csv", "/nonexistent/run.csv"], 3, "/nonexistent/run.csv"),
            (&["scenario.toml", "--plot", "a.jpg"], 2, ".svg or .png"),
            (&["model.toml"], 1, "model.toml: this is no scenario: duration_s is missing"),
            (&["rig.toml"], 1, "rig.toml: this is no scenario: duration_s is missing"),
            (&["run.csv"], 1, "run.csv: this is CSV, but a scenario or its model (TOML) is expected"),
            (&["scenario.toml", "--console", "bad.txt"], 1, "bad.txt, line 3: speed_kp"),
            (&["scenario.toml", "--csv", "scenario.toml"], 1, "scenario.toml is an input and would be overwritten"),
        ],
        ..row("simulate")
    },
    Row {
        good: &[
            &["table.csv", "--rig", "stand.toml"],
            &["loaded.csv", "--rig", "stand.toml"],
            &["table.csv", "--rig", "stand.toml", "--earlier", "table.csv", "--resistance", "positions.csv"],
        ],
        json: &["--json", "-"],
        bad: &[
            (&["none.csv", "--rig", "stand.toml"], 1, "none.csv"),
            (&["junk.csv", "--rig", "stand.toml"], 1, "junk.csv: byte 0: no header of a NumPy array"),
            (&["empty.csv", "--rig", "stand.toml"], 1, "the file is empty"),
            (&["run.csv", "--rig", "stand.toml"], 1, "run.csv is a recording over time (t_s)"),
            (&["--rig", "bare.toml"], 1, "write them there from a data sheet"),
            (&["table.csv", "--rig", "bad.toml"], 1, "bad.toml"),
            (&["table.csv", "--rig", "typo.toml"], 1, "typo.toml: line 1: unknown key moter; did you mean motor?"),
            (&["--rig", "stand.toml", "--port", "/dev/none"], 3, "motorbench ports"),
            (&["--rig", "stand.toml", "--port", "/dev/none", "--save", "/nonexistent/a.csv"], 3, "/nonexistent/a.csv"),
            (&["--rig", "stand.toml", "--port", "/dev/none", "--save", "stand.json"], 2, "ends in .csv"),
            (&["--rig", "stand.toml", "--port", "/dev/none", "--json", "stand.json"], 1, "choose another name"),
            (&["table.csv"], 2, "--rig"),
            (
                &["table.csv", "--rig", "stand.toml", "--json=table.csv"],
                1,
                "table.csv is an input and would be overwritten",
            ),
        ],
        ..row("stand")
    },
    Row {
        good: &[&["loop.csv", "--scenario", "loop.toml", "--rig", "rig.toml"]],
        json: &["--json", "-"],
        bad: &[
            (&["none.csv", "--scenario", "loop.toml"], 1, "none.csv"),
            (&["loop.csv", "--scenario", "bad.toml"], 1, "bad.toml"),
            (&["loop.csv"], 1, "--scenario"),
            (
                &["loop.csv", "--scenario", "loop.toml", "--json=loop.toml"],
                1,
                "loop.toml is an input and would be overwritten",
            ),
        ],
        is_long: true,
        ..row("validate")
    },
    // Ends by itself. All other tests of it are in `virtual_board`.
    Row {
        #[cfg(feature = "chip")]
        good: &[&["--seconds", "0.2", "--link", "virtual"]],
        #[cfg(feature = "chip")]
        json: &["--json"],
        #[cfg(feature = "chip")]
        bad: &[
            (&["--rig", "none.toml"], 1, "none.toml"),
            (&["--rig", "typo.toml"], 1, "typo.toml: line 1: unknown key moter; did you mean motor?"),
            (&["--with", "nonsense"], 2, "nonsense"),
            (&["--with", "bogus 1"], 2, "expected motor NAME=VALUE, effect"),
            (&["--with", "model none.toml"], 1, "none.toml"),
            (&["--with", "quit"], 2, "that is for a board that runs"),
            (&["--link", "/nonexistent/board", "--tell", "wait 1"], 3, "no virtual board runs there"),
            (&["--with", "supply -5"], 2, "-5: expected 0 to 40.0 V"),
            (&["--with", "supply 1e9"], 2, "0 to 40.0 V"),
            (&["--with", "load 1e30"], 2, "expected -0.493 to 0.493 Nm"),
            (&["--with", "brake -1"], 2, "expected 0 to 0.493 Nm"),
            (&["--with", "turn 1e12"], 2, "0 to 36000 degrees"),
            (&["--with", "wait nan"], 2, "expected a number"),
            (&["--with", "effect cogging off"], 2, "does not have it, its effects are coulomb_friction"),
            (&["--seconds", "nan"], 2, "expected seconds"),
            (&["--seconds=-1"], 2, "expected seconds"),
            (&["--seconds", "0.2", "--link", "/nonexistent/board"], 3, "/nonexistent/board"),
        ],
        #[cfg(not(feature = "chip"))]
        bad: &[(&[], 3, "scripts/setup chip")],
        ..row("virtual")
    },
    Row { good: &[&[]], json: &["--json"], ..row("ports") },
    Row {
        bad: &[
            (&["--port", "/dev/none", "status"], 3, "motorbench ports"),
            (&["--port", "/dev/null", "status"], 3, "/dev/null is no serial port"),
            (&["--port", "run.csv", "status"], 3, "run.csv is no serial port"),
        ],
        ..row("connect")
    },
    Row {
        bad: &[
            (&["--port", "/dev/none"], 3, "motorbench ports"),
            (&["--port", "/dev/none", "--out", "/nonexistent/run.csv"], 3, "/nonexistent/run.csv"),
            (&["--port", "/dev/none", "--motor", "bad.toml"], 1, "bad.toml"),
            (&["--live", "matplotlib"], 2, "plotjuggler or teleplot"),
            (&["--port", "/dev/none", "--amplitude", "-5"], 3, "motorbench ports"),
            (&["--amplitude", "nan"], 2, "expected a number, for instance 6"),
            (&["--out", "run.json"], 2, "ends in .csv, for instance run.csv"),
            (&["--out", "run.mat"], 2, "`motorbench convert` makes other formats"),
            (&["--out", "."], 2, "ends in .csv"),
            (&["--period", "0"], 2, "1..=65535"),
            (&["--set", "speed_kp"], 2, "NAME=VALUE"),
            (&["--set", "speed_pk=1"], 2, "did you mean speed_kp"),
            (&["--set", "foo=1"], 2, "foo: no such setting; `motorbench connect show` lists them"),
            (&["--mode", "bogus"], 2, "lqr_position"),
            (&["--sequence", "nonsense"], 2, "identify"),
        ],
        ..row("record")
    },
    Row {
        bad: &[
            (&["none.txt"], 1, "none.txt"),
            (&["--port", "/dev/none", "gains.txt"], 3, "motorbench ports"),
            (&[], 2, "<FILE>"),
        ],
        ..row("send")
    },
    Row {
        bad: &[
            (&["--port", "/dev/none"], 3, "needs a terminal"),
            (&["--port", "/dev/none", "--keys", "a"], 3, "motorbench ports"),
            (&["--keys", "a x"], 2, "space tab up down left right"),
            (&["--port", "/dev/none", "--keys", "a", "--out", "s.json"], 2, "ends in .csv"),
            (&["--port", "/dev/none", "--keys", "a", "--out", "s.csv", "--json", "s.json"], 1, "choose another name"),
        ],
        ..row("tune")
    },
    Row {
        bad: &[
            (&["--port", "/dev/none"], 3, "motorbench ports"),
            (&["--port", "/dev/none", "--from", "-6", "--to", "-8", "--reference", "-60"], 3, "motorbench ports"),
            (&["--relay", "1", "--reference", "-60"], 1, "a --reference above 0"),
            (&["--hold", "0.05"], 2, "0.2 to 60 seconds"),
            (&["--hold", "-1"], 2, "0.2 to 60 seconds"),
            (&["--relay", "-1"], 2, "above 0"),
            (&["--reference", "0"], 2, "other than 0"),
            (&["--closed-loop", "nan"], 2, "above 0"),
        ],
        ..row("autotune")
    },
    Row {
        good: &[&["bash"], &["zsh"], &["fish"], &["powershell"], &["elvish"]],
        json: &["--json"],
        bad: &[(&["sh"], 2, "bash")],
        for_programs: true,
        ..row("completions")
    },
    Row {
        good: &[&[], &["record"]],
        json: &["--json"],
        bad: &[(&["nonsense"], 2, "no such command")],
        for_programs: true,
        ..row("man")
    },
];

/// Commands with a board.
#[cfg(feature = "chip")]
pub const WITH_A_BOARD: &[Row] = &[
    Row {
        good: &[&["version", "status", "show speed_kp"]],
        json: &["--json"],
        bad: &[
            (&["nonsense"], 1, "unknown command, see help"),
            (&["stream text 10"], 1, "stream is not possible in connect"),
        ],
        // Lines by the board may be longer.
        for_programs: true,
        ..row("connect")
    },
    Row {
        good: &[&["--sequence", "steps", "--amplitude", "5", "--period", "300", "--count", "2"]],
        json: &["--json"],
        bad: &[
            (&["--mode", "nonsense"], 2, "lqr_speed"),
            (&["--set", "speed_kp=99999"], 1, "speed_kp"),
            (&["--amplitude", "99"], 1, "expected a number in"),
        ],
        ..row("record")
    },
    Row {
        good: &[&["gains.txt", "--save"]],
        json: &["--json"],
        bad: &[(&["bad.txt"], 1, "bad.txt, line 3")],
        ..row("send")
    },
    Row {
        good: &[&["--keys", "a s right s r tab r w"]],
        json: &["--json", "-"],
        bad: &[
            (&["--keys", "s"], 1, "a arms first"),
            (&["--keys", "a r s r", "--out", "/nonexistent/t.csv"], 3, "/nonexistent/t.csv: No such file"),
            (&["--keys", "r", "--out", "/nonexistent/t.csv"], 3, "make its folder first; --out names another"),
        ],
        ..row("tune")
    },
    Row {
        good: &[&["--hold", "0.3"]],
        json: &["--json"],
        bad: &[(&["--from", "1", "--to", "8", "--hold", "0.3"], 1, "friction")],
        ..row("autotune")
    },
    Row {
        good: &[&["--rig", "stand.toml", "--voltages", "6,9,12", "--readings", "2"]],
        json: &["--json", "-"],
        bad: &[
            (&["--rig", "stand.toml", "--voltages", "99"], 1, "voltage_limit"),
            (
                &["--rig", "stand.toml", "--voltages", "-6,-9,9"],
                1,
                "--voltages: only 2 voltages or loads; give at least 3",
            ),
            (&["--rig", "stand.toml", "--load-Nm=-1"], 1, "0 or more"),
            (
                &["--rig", "stand.toml", "--voltages", "6,9,12", "--readings", "2", "--positions", "1"],
                1,
                "nobody answered, so the other positions are left out",
            ),
        ],
        ..row("stand")
    },
];
