//! Every command as a person and as a program meet it: its help, its output on a terminal and in a pipe, its JSON, its exit
//! codes. The list of commands is the program's own: one that is not in the table below fails.
#[cfg(feature = "chip")]
use crate::motor::PIVT6_TOML;
use motorbench_data::rig::NominalMotor;
use motorbench_data::telemetry;
use motorbench_model::motor::MotorParameters;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcsetwinsize};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Command, Stdio};
use tempfile::TempDir;

const COLUMNS: usize = 80;
/// Commands that print a line of JSON for each of theirs, while they run.
const IN_LINES: [&str; 2] = ["connect", "virtual"];
/// Begins every escape sequence; what a terminal shows in colour is ESC [ ... m.
const ESCAPE: char = '\u{1b}';

/// A command and what is tried with it.
struct Row {
    command: &'static str,
    /// Arguments of runs that succeed.
    good: &'static [&'static [&'static str]],
    /// What makes it print JSON, where it has a result; runs of `good` that print none are none of this.
    json: &'static [&'static str],
    /// Arguments of runs that fail, the exit code, and what the message must say.
    bad: &'static [(&'static [&'static str], i32, &'static str)],
    /// Its output is for programs: as wide as it likes.
    for_programs: bool,
}

const fn row(command: &'static str) -> Row {
    Row { command, good: &[], json: &[], bad: &[], for_programs: false }
}

/// Commands that need no board.
const TABLE: &[Row] = &[
    Row {
        good: &[&["--seed", "7"]],
        json: &["--json"],
        bad: &[
            (&["--seed", "7", "--csv", "/nonexistent/run.csv"], 3, "/nonexistent/run.csv"),
            (&["--csv", "a.csv", "--report", "a.rig.toml"], 1, "two outputs have the name a.rig.toml"),
            (&["--csv", "-"], 1, "give it a name"),
        ],
        ..row("demo")
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
            (&["junk.csv", "a.mat"], 1, "this is no text; a CSV table is expected, and --from says another format"),
            (&["run.csv", "a.csv", "--rename", "omega_rad_per_s=u_V"], 1, "two columns would be called u_V"),
            (&["run.csv", "a.csv", "--map", "u_V=u_V*nan"], 2, "a number other than 0"),
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
            (&["none.csv"], 1, "none.csv: there is no such file; beside it are bad.csv, "),
            (&["run.csv", "--rig", "junk.csv"], 1, "junk.csv: this is no text; a rig file (TOML) is expected"),
            (&[".", "--rig", "rig.toml"], 1, "this is a folder; a recording (CSV) is expected"),
            (
                &["."],
                1,
                "this is a folder; a recording (CSV) is expected, and diagnose takes all in a folder with --batch",
            ),
            (&["run.csv", "--rig", "."], 1, "this is a folder; a rig file (TOML) is expected"),
            (&["run.csv", "--rig", "run.csv"], 1, "run.csv: this is CSV; a rig file (TOML) is expected"),
            (&["rig.toml"], 1, "rig.toml: this is TOML; a recording (CSV) is expected"),
            (&["names.csv"], 1, "no known column among time, volts;"),
            (&["slow.csv"], 1, "`motorbench convert slow.csv NEW.csv --map t_s=t_s*0.001`"),
            (&["time.csv"], 1, "time.csv: no column t_s"),
            (&["glitch.csv"], 1, "glitch.csv, line 3: column omega_rad_per_s: 1e300 is no measurement"),
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
        ..row("diagnose")
    },
    Row {
        good: &[&["run.csv", "--rig", "rig.toml"]],
        json: &["--json", "-"],
        bad: &[
            (&["none.csv"], 1, "none.csv"),
            (&["bad.csv"], 1, "bad.csv"),
            (&["run.csv", "--rig", "rig.toml", "--model", "/nonexistent/m.toml"], 3, "/nonexistent/m.toml"),
            (&["run.csv", "--rig", "rig.toml", "--json", "run.csv"], 1, "run.csv is an input and would be overwritten"),
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
            (&["run.csv"], 1, "run.csv: this is CSV; a scenario or its model (TOML) is expected"),
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
            (&["junk.csv", "--rig", "stand.toml"], 1, "this is no text"),
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
                &["table.csv", "--rig", "stand.toml", "--json", "table.csv"],
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
                &["loop.csv", "--scenario", "loop.toml", "--json", "loop.toml"],
                1,
                "loop.toml is an input and would be overwritten",
            ),
        ],
        ..row("validate")
    },
    // Ends by itself; everything else about it is in tests/virtual_board.rs.
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
const WITH_A_BOARD: &[Row] = &[
    Row {
        good: &[&["version", "status", "show speed_kp"]],
        json: &["--json"],
        bad: &[
            (&["nonsense"], 1, "unknown command, see help"),
            (&["stream text 10"], 1, "stream is not possible in connect"),
        ],
        // The board's own lines are as long as they are.
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

/// What the table's runs read.
fn files() -> TempDir {
    let folder = TempDir::new().unwrap();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    // Causes, some of them with long names.
    let effects = "[effects.coulomb_friction]\ntorque_Nm = 0.01\n[effects.voltage_drop]\ndrop_V = 1.6\n\
        [effects.stribeck_friction]\nexcess_torque_Nm = 0.006\nstribeck_speed_rad_per_s = 8\n";
    let play = |name: &str, mode: &str, sequence: &str| {
        let scenario =
            format!("duration_s = 6.0\nmode = \"{mode}\"\n{PIVT6_TOML}{effects}[noise]\ncurrent_A = 0.01\n{sequence}");
        put(&format!("{name}.toml"), &scenario);
        let scenario = motorbench_files::scenario(&folder.path().join(format!("{name}.toml")), None).unwrap();
        put(&format!("{name}.csv"), &scenario.run().unwrap().recording.to_csv());
        let nominal = NominalMotor::from(MotorParameters::PIVT6);
        put("rig.toml", &toml::to_string(&telemetry::rig(&scenario.settings, nominal)).unwrap());
    };
    play(
        "run",
        "open",
        "[[reference]]\ntime_s = 0.1\nkind = \"sequence\"\nsequence = \"prbs\"\namplitude = 8\nperiod_ms = 60\ncount = 90\n",
    );
    let steps = [60, 20, -50, 40, -20, 70, 10];
    let steps = steps
        .iter()
        .enumerate()
        .map(|(index, to)| format!("[[reference]]\ntime_s = {}\nvalue = {to}\n", 0.1 + 0.8 * index as f64));
    play("loop", "speed", &steps.collect::<String>());
    put(
        "scenario.toml",
        &format!("duration_s = 0.5\nmode = \"speed\"\n{PIVT6_TOML}[[reference]]\ntime_s = 0.1\nvalue = 40\n"),
    );
    // With numbers as long as they come.
    put("position.toml", include_str!("../../../../scenarios/position_lqr.toml"));
    put("model.toml", PIVT6_TOML);
    put("other.toml", &format!("{PIVT6_TOML}[effects.coulomb_friction]\ntorque_Nm = 0.01\n"));
    put("stand.toml", PIVT6_TOML);
    let table = |loads_nm: &[f64]| {
        let mut table = String::from("u_V,load_Nm,i_A,omega_rad_per_s\n");
        for u in [10.0, 15.0, 20.0, 25.0, 30.0] {
            for (load, scatter) in
                loads_nm.iter().flat_map(|load| [1.0, -1.0, 0.5, -0.5].map(|scatter| (load, scatter)))
            {
                let omega = (u - 2.0 - 5.84 * (0.015 + load) / 0.072) / (0.072 + 5.84 * 5e-6 / 0.072);
                let current = (0.015 + load + 5e-6 * omega) / 0.072 + 0.003 * scatter;
                table += &format!("{u},{load},{current},{}\n", omega - 0.4 * scatter);
            }
        }
        table
    };
    put("table.csv", &table(&[0.0]));
    put("loaded.csv", &table(&[0.0, 0.02, 0.05]));
    put("positions.csv", "resistance_ohm\n5.8\n5.9\n6.1\n");
    put("found.json", "{\"parameters\": {\"resistance_ohm\": {\"value\": 5.8, \"ci95\": [5.7, 5.9]}}}");
    put("gains.txt", "# from a design\nset speed_kp 0.05 speed_ki 1\n");
    put("bad.txt", "# the second is too much\nset speed_kp 0.05\nset speed_kp 99999\n");
    let rows = |from: usize| (from..from + 100).map(|row| format!("{row},{},1\n", row % 7)).collect::<String>();
    put("slow.csv", &format!("t_s,u_V,omega_rad_per_s\n{}", rows(0)));
    put("time.csv", &format!("time,u_V,omega_rad_per_s\n{}", rows(0)));
    put("glitch.csv", &format!("t_s,u_V,omega_rad_per_s\n0,1,1\n1,1,1e300\n{}", rows(2)));
    put("bad.csv", "t_s,omega_rad_per_s\n0,1\nzero,2\n");
    put("bad.toml", "[motor\n");
    put("bare.toml", "[encoder]\ncounts_per_rev = 2000\n");
    put("names.csv", "time,volts\n0,1\n");
    put("typo.toml", "[moter]\nresistance_ohm = 5\n");
    put("empty.csv", "");
    std::fs::write(folder.path().join("junk.csv"), b"\x93NUMPY\x01\0").unwrap();
    folder
}

fn motorbench(arguments: &[&str], folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_motorbench"));
    command.args(arguments).current_dir(folder).stdin(Stdio::null());
    command
}

/// What a run left: exit code, standard output, standard error.
struct Done {
    code: Option<i32>,
    out: String,
    err: String,
}

fn piped(arguments: &[&str], folder: &Path) -> Done {
    let output = motorbench(arguments, folder).output().unwrap();
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).expect("UTF-8"));
    Done { code: output.status.code(), out, err }
}

/// A pseudo-terminal, and a thread that collects what is written there.
fn terminal() -> (File, std::thread::JoinHandle<String>) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let size = Winsize { ws_row: 24, ws_col: COLUMNS as u16, ws_xpixel: 0, ws_ypixel: 0 };
    tcsetwinsize(&master, size).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap();
    let slave = File::options().read(true).write(true).open(std::ffi::OsStr::from_bytes(name.as_bytes())).unwrap();
    let mut master = File::from(master);
    let heard = std::thread::spawn(move || {
        let mut bytes = Vec::new();
        // The error at the end says that nobody has the terminal open any more.
        let _ = master.read_to_end(&mut bytes);
        String::from_utf8(bytes).expect("UTF-8").replace("\r\n", "\n")
    });
    (slave, heard)
}

/// With the standard output and the standard error on a terminal each.
fn on_terminals(arguments: &[&str], folder: &Path, no_color: bool) -> Done {
    let ((out, out_heard), (err, err_heard)) = (terminal(), terminal());
    let mut command = motorbench(arguments, folder);
    command.env("TERM", "xterm-256color").env_remove("NO_COLOR").env_remove("CLICOLOR").stdout(out).stderr(err);
    if no_color {
        command.env("NO_COLOR", "1");
    }
    let mut running = command.spawn().unwrap();
    // The command has the terminals open as well, until it is dropped.
    drop(command);
    let code = running.wait().unwrap().code();
    Done { code, out: out_heard.join().unwrap(), err: err_heard.join().unwrap() }
}

/// The port of a run, which is longer than a person's.
fn long_port(arguments: &[&str]) -> String {
    let port = arguments.iter().position(|argument| *argument == "--port").map(|at| arguments[at + 1]);
    port.unwrap_or("/tmp/motorbench").into()
}

/// Whether a text sets colours or other looks: ESC [ digits and semicolons m.
fn is_coloured(text: &str) -> bool {
    text.split(ESCAPE).skip(1).any(|after| {
        let parameters =
            after.strip_prefix('[').map(|rest| rest.trim_start_matches(|c: char| c.is_ascii_digit() || c == ';'));
        parameters.is_some_and(|rest| rest.starts_with('m'))
    })
}

/// What was found wrong, all of it: one run of this test is as good as many.
#[derive(Default)]
struct Complaints(Vec<String>);

impl Complaints {
    fn expect(&mut self, right: bool, what: &str, wrong: &str) {
        if !right {
            self.0.push(format!("motorbench {what}: {wrong}"));
        }
    }

    /// Fits the terminal.
    fn fits(&mut self, text: &str, what: &str) {
        for line in text.lines().filter(|line| line.chars().count() > COLUMNS) {
            self.expect(false, what, &format!("wider than {COLUMNS} columns: {line}"));
        }
    }

    /// So does the message on which a command ends; a word that is wider alone, as a path may be, is not broken.
    fn message_fits(&mut self, err: &str, what: &str) {
        let message = err.rfind("motorbench: ").map_or("", |at| &err[at..]);
        self.expect(!message.is_empty(), what, "no message on a terminal");
        let lines: Vec<&str> = message.lines().filter(|line| line.trim().contains(' ')).collect();
        self.fits(&lines.join("\n"), what);
    }

    /// No escape sequences, no progress bar.
    fn plain(&mut self, text: &str, what: &str) {
        self.expect(!text.contains([ESCAPE, '\r']), what, &format!("escape sequences or a progress bar: {text:?}"));
    }

    fn ended(&mut self, done: &Done, code: i32, what: &str) {
        let Done { code: found, out, err } = done;
        let panicked = err.contains("panicked");
        self.expect(*found == Some(code) && !panicked, what, &format!("exit code {found:?}, not {code}: {out}{err}"));
    }

    fn none(self) {
        assert!(self.0.is_empty(), "{} complaints:\n{}", self.0.len(), self.0.join("\n"));
    }

    /// A run that shall succeed, in a pipe, on a terminal, and for a program.
    fn good(&mut self, row: &Row, arguments: &[&str], folder: &Path) {
        let what = arguments.join(" ");
        let done = piped(arguments, folder);
        self.ended(&done, 0, &what);
        self.expect(!done.out.is_empty(), &what, "it says nothing");
        for text in [&done.out, &done.err] {
            self.plain(text, &what);
            if !row.for_programs {
                self.fits(&text.replace(&long_port(arguments), "/tmp/motorbench"), &what);
            }
        }
        let what = format!("{what} (on a terminal, with NO_COLOR)");
        let shown = on_terminals(arguments, folder, true);
        self.ended(&shown, 0, &what);
        self.plain(&shown.out, &what);
        // A spinner moves the cursor; colours it has none.
        self.expect(!is_coloured(&shown.err), &what, &format!("coloured: {:?}", shown.err));
        if !row.json.is_empty() {
            self.json(&[arguments, row.json].concat(), 0, true, folder);
        }
        if row.json == ["--json"] {
            self.json(&[arguments, &["--json", "-"]].concat(), 0, true, folder);
            if !IN_LINES.contains(&row.command) {
                self.json_file(arguments, folder);
            }
        }
    }

    /// A file has JSON, and the standard output what a person reads.
    fn json_file(&mut self, arguments: &[&str], folder: &Path) {
        let arguments = [arguments, &["--json", "made.json"]].concat();
        let (what, file) = (arguments.join(" "), folder.join("made.json"));
        let done = piped(&arguments, folder);
        self.ended(&done, 0, &what);
        let made = std::fs::read(&file).ok().and_then(|text| serde_json::from_slice::<serde_json::Value>(&text).ok());
        self.expect(made.is_some(), &what, "no JSON in the file");
        self.expect(!done.out.is_empty(), &what, "it says nothing");
        let _ = std::fs::remove_file(file);
    }

    /// The standard output has JSON and nothing else.
    fn json(&mut self, arguments: &[&str], code: i32, wanted: bool, folder: &Path) {
        let what = arguments.join(" ");
        let done = piped(arguments, folder);
        self.ended(&done, code, &what);
        let values = serde_json::Deserializer::from_str(&done.out).into_iter::<serde_json::Value>();
        let right = values.collect::<Result<Vec<_>, _>>().is_ok_and(|values| !wanted || !values.is_empty());
        self.expect(right, &what, &format!("no JSON, or something beside it: {}", done.out));
        self.plain(&done.err, &what);
    }

    /// A run that shall fail.
    fn bad(&mut self, row: &Row, arguments: &[&str], code: i32, message: &str, folder: &Path) {
        let what = arguments.join(" ");
        let done = piped(arguments, folder);
        self.ended(&done, code, &what);
        self.expect(done.err.contains(message), &what, &format!("no \"{message}\" in: {}", done.err));
        self.plain(&done.err, &what);
        if code != 2 {
            self.message_fits(&on_terminals(arguments, folder, true).err, &what);
        }
        if !row.json.is_empty() && code != 2 && !arguments.contains(&"--json") {
            self.json(&[arguments, row.json].concat(), code, false, folder);
        }
    }

    /// What a row of the table says; `before`: arguments that every run of it begins with.
    fn row(&mut self, row: &Row, before: &[&str], folder: &Path) {
        for good in row.good {
            self.good(row, &[&[row.command], before, good].concat(), folder);
        }
        for (bad, code, message) in row.bad {
            self.bad(row, &[&[row.command], before, bad].concat(), *code, message, folder);
        }
    }
}

#[test]
fn the_table_has_every_command() {
    let program = motorbench_cli::commands::command();
    let commands: BTreeSet<&str> = program.get_subcommands().map(clap::Command::get_name).collect();
    let tried: BTreeSet<&str> = TABLE.iter().map(|row| row.command).collect();
    assert_eq!(tried, commands);
    for command in program.get_subcommands() {
        let has_json = command.get_arguments().any(|argument| argument.get_id() == "json");
        assert!(has_json, "{} has no --json", command.get_name());
    }
}

/// Every run that succeeds is tried with it, and every command has such a run.
#[cfg(feature = "chip")]
#[test]
fn the_table_tries_the_json_of_every_command() {
    let rows = || TABLE.iter().chain(WITH_A_BOARD);
    for row in rows().filter(|row| !row.good.is_empty()) {
        assert!(!row.json.is_empty(), "{}: its JSON is not tried", row.command);
    }
    for Row { command, .. } in TABLE {
        assert!(rows().any(|row| row.command == *command && !row.good.is_empty()), "{command} is not tried");
    }
}

#[test]
fn help_has_an_example_and_fits_the_terminal() {
    let folder = TempDir::new().unwrap();
    let program = motorbench_cli::commands::command();
    let mut calls = vec![vec!["--help"], vec!["-h"]];
    for row in TABLE {
        calls.extend([vec![row.command, "--help"], vec![row.command, "-h"], vec!["help", row.command]]);
    }
    let mut complaints = Complaints::default();
    for arguments in &calls {
        let what = arguments.join(" ");
        for done in [piped(arguments, folder.path()), on_terminals(arguments, folder.path(), true)] {
            complaints.ended(&done, 0, &what);
            complaints.plain(&done.out, &what);
            complaints.fits(&done.out, &what);
        }
    }
    for command in program.get_subcommands() {
        let name = command.get_name();
        let examples = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        complaints.expect(examples.contains(&format!("motorbench {name}")), name, "no example in its help");
        // Wrapped by the program they would no longer be what is typed.
        complaints.fits(&examples, name);
    }
    complaints.none();
    // It has colours, so that it means something that it leaves them.
    assert!(is_coloured(&on_terminals(&["--help"], folder.path(), false).out));
}

#[test]
fn a_wrong_command_line_is_told_apart_from_a_wrong_input() {
    let folder = TempDir::new().unwrap();
    let mut complaints = Complaints::default();
    for row in TABLE {
        complaints.bad(row, &[row.command, "--no-such-option"], 2, "--no-such-option", folder.path());
    }
    complaints.bad(&row(""), &["no-such-command"], 2, "no-such-command", folder.path());
    complaints.none();
}

#[test]
fn a_reason_that_two_laws_share_is_said_once() {
    let arguments = ["design", "--rig", "rig.toml", "--model", "model.toml", "--speed", "--bandwidth-Hz", "800"];
    let done = piped(&arguments, files().path());
    assert_eq!((done.code, done.err.matches("a tenth of the tick rate").count()), (Some(1), 1), "{}", done.err);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_said_in_one_line() {
    let (folder, mut complaints) = (files(), Complaints::default());
    for arguments in [
        &["--help"][..],
        &["man"],
        &["completions", "bash"],
        &["ports"],
        &["analyse", "--rig", "model.toml"],
        &["simulate", "scenario.toml", "--json", "-"],
        &["convert", "run.csv", "-"],
        &["diagnose", "--batch", "table.csv", "--rig", "stand.toml"],
    ] {
        let what = format!("{} > /dev/full", arguments.join(" "));
        let full = File::options().write(true).open("/dev/full").unwrap();
        let output = motorbench(arguments, folder.path()).stdout(full).output().unwrap();
        let err = String::from_utf8(output.stderr).unwrap();
        let done = Done { code: output.status.code(), out: String::new(), err };
        complaints.ended(&done, 3, &what);
        let is_one_line = done.err.lines().count() == 1 && done.err.contains("No space left on device");
        complaints.expect(is_one_line, &what, &done.err);
    }
    complaints.none();
}

/// `-` is the terminal for every file that is text, and nothing else is said there then.
#[test]
fn a_recording_goes_to_the_terminal() {
    let folder = files();
    for arguments in [&["simulate", "scenario.toml", "--csv", "-"][..], &["convert", "run.csv", "-"]] {
        let done = piped(arguments, folder.path());
        assert!(done.code == Some(0) && done.out.starts_with("t_s,"), "{arguments:?}: {}{}", done.out, done.err);
        assert!(done.out.lines().all(|line| line.contains(',')), "{arguments:?}: something else is said as well");
        assert!(!folder.path().join("-").exists(), "{arguments:?}");
    }
}

#[test]
fn output_json_and_exit_codes_are_those_of_the_page() {
    let (folder, mut complaints) = (files(), Complaints::default());
    TABLE.iter().for_each(|row| complaints.row(row, &[], folder.path()));
    complaints.none();
}

#[cfg(feature = "chip")]
#[test]
fn commands_for_boards_behave_as_the_others() {
    let board = crate::board::Board::new("terminal");
    let (folder, mut complaints) = (files(), Complaints::default());
    let port = board.port();
    let before = ["--port", port.to_str().unwrap()];
    WITH_A_BOARD.iter().for_each(|row| complaints.row(row, &before, folder.path()));
    complaints.none();
}
