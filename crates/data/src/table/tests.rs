//! Kinds of files that people have. Each has its right values.

use crate::mapping::Mapping;
use crate::recording::{Channel, Recording};
use proptest::prelude::*;
use std::fmt::Write as _;

fn read(text: &str, columns: &[&str]) -> Result<Recording, String> {
    let columns: Vec<Mapping> = columns.iter().map(|column| column.parse().unwrap()).collect();
    Recording::parse("test.txt", text.as_bytes(), &columns).map_err(|error| error.to_string())
}

/// Milliseconds, PWM, rpm and mA of a motor that starts and turns back, as a sketch prints them.
fn lines(count: usize, line: impl Fn(i32, i32, f64, i32) -> String) -> String {
    (0..count as i32)
        .map(|row| line(412 + 10 * row, sense(row) * 120, f64::from(sense(row)) * 486.5, sense(row) * 93) + "\n")
        .collect()
}

fn sense(row: i32) -> i32 {
    if row < 5 {
        0
    } else if row % 40 < 20 {
        1
    } else {
        -1
    }
}

/// Names of the sketch's columns as channels.
const SKETCH: [&str; 4] = ["millis=t_s*0.001", "pwm=duty/255", "rpm=rpm", "mA=i_A*0.001"];

/// The recording of [`lines`], whatever the file looked like.
fn assert_is_it(found: &Recording, count: usize, what: &str) {
    assert_eq!(found.len(), count, "{what}: {:?}", found.notes);
    let column = |channel: Channel| found.get(channel).unwrap_or_else(|| panic!("{what} has no {}", channel.column()));
    let time_s = column(Channel::Time);
    for row in 1..count {
        assert!((time_s[row] - time_s[row - 1] - 0.01).abs() < 1e-6, "{what}, row {row}: {}", time_s[row]);
        let sense = f64::from(sense(row as i32));
        assert!((column(Channel::Duty)[row] - sense * 120.0 / 255.0).abs() < 1e-9, "{what}, row {row}");
        assert!((column(Channel::Rpm)[row] - sense * 486.5).abs() < 1e-9, "{what}, row {row}");
        assert!((column(Channel::Current)[row] - sense * 0.093).abs() < 1e-9, "{what}, row {row}");
    }
}

#[test]
fn a_serial_line_as_text() {
    let plain = |ms: i32, pwm: i32, rpm: f64, ma: i32| format!("{ms},{pwm},{rpm},{ma}");
    let table = "millis,pwm,rpm,mA\n".to_owned() + &lines(400, plain);
    let stamped = |text: &str, stamp: &dyn Fn(usize) -> String| {
        text.lines().enumerate().map(|(index, line)| format!("{}{line}\n", stamp(index))).collect::<String>()
    };
    let clock = |index: usize| format!("14:59:{:02}.{:03}", 50 + index / 1000, index % 1000);
    for (what, text) in [
        ("plain", table.clone()),
        ("a greeting before the header", format!("Motor test v1.2\nReady\n{table}")),
        ("the time stamps of the Arduino IDE", stamped(&format!("Ready\n{table}"), &|index| clock(index) + " -> ")),
        ("time stamps in brackets", stamped(&table, &|index| format!("[{}] ", clock(index)))),
        (
            "noise of a starting board",
            format!("\u{fffd}\u{fffd}7,-33,412.\nets Jul 29 2019 12:21:46\nrst:0x1\n{table}"),
        ),
        ("aligned blanks", table.replace(',', "    ").replace("\n", "\n   ")),
        ("tabs", table.replace(',', "\t")),
        ("bars", table.replace(',', " | ")),
        ("a separator at the end of each line", table.replace('\n', ",\n")),
        ("carriage returns", table.replace('\n', "\r\n")),
        ("the header again and again", table.replace("1412,", "millis,pwm,rpm,mA\n1412,")),
        ("comments", table.replace("1412,", "# fault cleared\n1412,")),
        ("a numpy header", table.replacen("millis", "# millis", 1).replace(',', " ")),
    ] {
        assert_is_it(&read(&text, &SKETCH).unwrap_or_else(|why| panic!("{what}: {why}")), 400, what);
    }
    // Without a header, by numbers.
    let by_number = ["1=t_s*0.001", "2=duty/255", "3=rpm", "4=i_A*0.001"];
    assert_is_it(&read(&lines(400, plain), &by_number).unwrap(), 400, "no header");
    let why = read(&lines(400, plain), &[]).unwrap_err();
    assert!(why.contains("line 1 is numbers: there is no header line") && why.contains("--column 1=t_s/1000"), "{why}");
}

#[test]
fn names_and_values_in_each_line() {
    for (what, text) in [
        ("plotter", lines(200, |ms, pwm, rpm, ma| format!("millis:{ms}\tpwm:{pwm}\trpm:{rpm}\tmA:{ma}"))),
        ("commas", lines(200, |ms, pwm, rpm, ma| format!("millis:{ms},pwm:{pwm},rpm:{rpm},mA:{ma}"))),
        ("words", lines(200, |ms, pwm, rpm, ma| format!("millis: {ms} ms, pwm: {pwm}, rpm: {rpm} rpm, mA: {ma} mA"))),
        ("equals", lines(200, |ms, pwm, rpm, ma| format!("millis={ms} pwm={pwm} rpm={rpm} mA={ma}"))),
        ("a line for each", lines(200, |ms, pwm, rpm, ma| format!(">millis:{ms}\n>pwm:{pwm}\n>rpm:{rpm}\n>mA:{ma}"))),
    ] {
        assert_is_it(&read(&text, &SKETCH).unwrap_or_else(|why| panic!("{what}: {why}")), 200, what);
    }
    // A unit in the line counts like one in a header.
    let said = lines(200, |ms, pwm, rpm, ma| format!("t = {ms} ms | pwm = {pwm} | speed = {rpm} rpm | I = {ma}mA"));
    assert_is_it(&read(&said, &["pwm=duty/255", "speed=rpm", "I=i_A"]).unwrap(), 200, "units");
    let another = said.replacen("= -93mA", "= -0.093 A", 1);
    let found = read(&another, &["pwm=duty/255", "speed=rpm", "I=i_A"]).unwrap();
    assert!(
        found.len() == 199 && found.notes.iter().any(|note| note.contains("the unit of I is \"A\"")),
        "{:?}",
        found.notes
    );
    let teleplot = lines(200, |ms, pwm, rpm, ma| format!(">pwm:{ms}:{pwm}\n>rpm:{ms}:{rpm}\u{a7}rpm|g\n>mA:{ms}:{ma}"));
    assert_is_it(&read(&teleplot, &SKETCH[1..]).unwrap(), 200, "teleplot");
    // The stream of this project's firmware has no times: its rate gives them.
    let mut own = String::new();
    for row in 0..200 {
        let _ = write!(own, "reference:6,position:{},speed:34.2,current:0.16,duty:-50\r\n", 0.684 * f64::from(row));
    }
    let found = read(&own, &["row=t_s*0.02"]).unwrap();
    assert_eq!((found.get(Channel::Duty).unwrap()[9], found.get(Channel::Speed).unwrap()[9]), (-0.5, 34.2));
    assert!((found.time_s().unwrap()[199] - 3.98).abs() < 1e-9 && found.ignored == ["reference"]);
    let advice = read(&own, &["reference=ref_rad_per_s"]).unwrap().advice_on_time().unwrap();
    assert!(advice.ends_with("--column row=t_s*0.02 takes them as 0.02 s apart"), "{advice}");
}

#[test]
fn logs_of_other_programs() {
    let of_clock = |ms: i32| format!("14:59:{:02}.{:03}", 50 + ms / 1000, ms % 1000);
    let day = |ms: i32| format!("2024-03-01 {}", of_clock(ms));
    for (what, text) in [
        (
            "ESP-IDF with names",
            "ets Jun  8 2016 00:22:57\n".to_owned()
                + &lines(400, |ms, pwm, rpm, ma| format!("I ({ms}) motor: pwm={pwm} rpm={rpm} mA={ma}")),
        ),
        (
            "ESP-IDF with a table",
            "I (400) motor: pwm,rpm,mA\n".to_owned()
                + &lines(400, |ms, pwm, rpm, ma| format!("I ({ms}) motor: {pwm},{rpm},{ma}")),
        ),
        (
            "date and time before a table",
            format!("{} pwm,rpm,mA\n", day(400))
                + &lines(400, |ms, pwm, rpm, ma| format!("{} {pwm},{rpm},{ma}", day(ms))),
        ),
        (
            "a log of Python",
            lines(400, |ms, pwm, rpm, ma| format!("{} INFO pwm={pwm} rpm={rpm} mA={ma}", day(ms).replace('.', ","))),
        ),
        (
            "level in brackets",
            lines(400, |ms, pwm, rpm, ma| format!("[{}] [DEBUG] pwm:{pwm}, rpm:{rpm}, mA:{ma}", of_clock(ms))),
        ),
        (
            "seconds since the start and since the line before",
            lines(400, |ms, pwm, rpm, ma| {
                format!("[{:.6} 0.010000] pwm:{pwm},rpm:{rpm},mA:{ma}", f64::from(ms) / 1000.0)
            }),
        ),
        (
            "minutes and seconds",
            "time,pwm,rpm,mA\n".to_owned()
                + &lines(400, |ms, pwm, rpm, ma| format!("00:{:02}.{:03},{pwm},{rpm},{ma}", ms / 1000, ms % 1000)),
        ),
        (
            "JSON",
            lines(400, |ms, pwm, rpm, ma| format!("{{\"ms\": {ms}, \"pwm\": {pwm}, \"rpm\": {rpm}, \"mA\": {ma}}}")),
        ),
        ("lists", "ms,pwm,rpm,mA\n".to_owned() + &lines(400, |ms, pwm, rpm, ma| format!("[{ms}, {pwm}, {rpm}, {ma}]"))),
        (
            "units in the cells",
            "ms,pwm,rpm,mA\n".to_owned() + &lines(400, |ms, pwm, rpm, ma| format!("{ms} ms,{pwm},{rpm} rpm,{ma}mA")),
        ),
        (
            "units in sentences",
            "in ms;pwm;rpm;mA in mA\n".to_owned()
                + &lines(400, |ms, pwm, rpm, ma| format!("{ms};{pwm};{};{ma}", rpm.to_string().replace('.', ","))),
        ),
        (
            "ROS",
            "%time_ns,field.pwm,field.rpm,field.mA\n".to_owned()
                + &lines(400, |ms, pwm, rpm, ma| {
                    format!("{}000000,{pwm},{rpm},{ma}", 1_709_305_190_000_i64 + i64::from(ms))
                }),
        ),
        (
            "a table of a text page",
            "| ms | pwm | rpm | mA |\n|---:|---:|---:|---:|\n".to_owned()
                + &lines(400, |ms, pwm, rpm, ma| format!("| {ms} | {pwm} | {rpm} | {ma} |")),
        ),
    ] {
        let columns = ["pwm=duty/255", "rpm=rpm", "mA=i_A*0.001"];
        assert_is_it(&read(&text, &columns).unwrap_or_else(|why| panic!("{what}: {why}")), 400, what);
    }
}

/// With a number in the name each line has a name of its own, and a table of them would be the square of the file.
#[test]
fn lines_with_a_number_in_their_name_are_no_labels() {
    for line in [|row: i32| format!("x:1, step {row}: 0.5\n"), |row: i32| format!(">step{row}:{row}:0.5\n")] {
        let labels = |count: i32| {
            let text: String = (0..count).map(line).collect();
            super::labels::read(&super::lines::of(&text).lines)
        };
        assert!(labels(900).is_some() && labels(5000).is_none());
    }
}

#[test]
fn a_timer_that_wraps_in_its_own_counts() {
    // Timer 1 of an Uno at 4 us.
    let timer = |ms: i32| ms * 250 % 65_536;
    let text =
        "TCNT1,pwm,rpm,mA\n".to_owned() + &lines(400, |ms, pwm, rpm, ma| format!("{},{pwm},{rpm},{ma}", timer(ms)));
    let found = read(&text, &["TCNT1=t_s*4e-6", "pwm=duty/255", "mA=i_A/1000"]).unwrap();
    assert_is_it(&found, 400, "a timer");
    assert!(found.notes[0].contains("counts of the file's clock"), "{:?}", found.notes);
}

#[test]
fn directions_in_words() {
    for (forwards, backwards) in [("FWD", "REV"), ("cw", "ccw"), ("forward", "backward"), ("F", "R")] {
        let word = |pwm: i32| match pwm {
            0 => "stop",
            1.. => forwards,
            _ => backwards,
        };
        let text = "millis,pwm,dir,rpm,mA\n".to_owned()
            + &lines(400, |ms, pwm, rpm, ma| format!("{ms},{},{},{rpm},{ma}", pwm.abs(), word(pwm)));
        let columns = ["millis=t_s/1000", "pwm*sign(dir)=duty/255", "mA=i_A/1000"];
        assert_is_it(&read(&text, &columns).unwrap(), 400, forwards);
    }
}

#[test]
fn broken_lines_are_left_out_and_counted() {
    let plain = |ms: i32, pwm: i32, rpm: f64, ma: i32| format!("{ms},{pwm},{rpm},{ma}");
    let table = |broken: &str| {
        let table = "millis,pwm,rpm,mA\n".to_owned() + &lines(400, plain);
        table
            .lines()
            .enumerate()
            .map(|(index, line)| if index == 300 { broken.to_owned() } else { line.to_owned() } + "\n")
            .collect::<String>()
    };
    for (broken, why) in [
        ("34,1", "2 values, but the header line has 4"),
        ("3402,12\u{fffd},0.0,1", "column pwm (duty): expected a number, found"),
        ("3402,120,4863402,120,486.5,93", "6 values, but the header line has 4"),
    ] {
        let found = read(&table(broken), &SKETCH).unwrap();
        assert_eq!(found.len(), 399);
        assert!(
            found.notes[0].starts_with(&format!("Line 301 cannot be read and is left out: {why}")),
            "{:?}",
            found.notes
        );
    }
    // A cut at the end, and `ovf` for a value that is too great.
    let cut = table("3402,120,ovf,93");
    let found = read(cut.trim_end().trim_end_matches(|sign| sign != ','), &SKETCH).unwrap();
    assert_eq!(found.len(), 400);
    assert!(found.get(Channel::Rpm).unwrap()[299].is_nan());
    // Too many of them are no noise.
    let bad = "millis,pwm,rpm,mA\n".to_owned()
        + &lines(400, |ms, pwm, rpm, ma| if ms % 500 == 12 { "x".into() } else { plain(ms, pwm, rpm, ma) });
    let why = read(&bad, &SKETCH).unwrap_err();
    assert!(why.contains("line 12: 1 values, but the header line has 4 (8 of 400 lines cannot be read"), "{why}");
    // What stands in a column that is not used does not matter.
    let words =
        "millis,pwm,rpm,mA,state\n".to_owned() + &lines(400, |ms, pwm, rpm, ma| plain(ms, pwm, rpm, ma) + ",RUN");
    assert_is_it(&read(&words, &SKETCH).unwrap(), 400, "a column of words");
}

#[test]
fn numbers_and_times_in_other_notations() {
    let moment = |ms: i32| format!("14:{:02}:{:02}.{:03}", 59 + (ms / 60_000), ms / 1000 % 60, ms % 1000);
    let columns = ["pwm=duty/255", "mA=i_A/1000"];
    for (what, text) in [
        (
            "date and clock",
            "Date,Time,pwm,rpm,mA\n".to_owned()
                + &lines(300, |ms, pwm, rpm, ma| format!("2024-03-01,{},{pwm},{rpm},{ma}", moment(ms))),
        ),
        (
            "ISO",
            "timestamp,pwm,rpm,mA\n".to_owned()
                + &lines(300, |ms, pwm, rpm, ma| format!("2024-03-01T{}Z,{pwm},{rpm},{ma}", moment(ms))),
        ),
        (
            "date and clock in one",
            "when;pwm;rpm;mA\n".to_owned()
                + &lines(300, |ms, pwm, rpm, ma| {
                    format!("01.03.2024 {};{pwm};{};{ma}", moment(ms), rpm.to_string().replace('.', ","))
                }),
        ),
        (
            "since 1970",
            "t_s,pwm,rpm,mA\n".to_owned()
                + &lines(300, |ms, pwm, rpm, ma| {
                    format!("17093051{:02}.{:03},{pwm},{rpm},{ma}", 90 + ms / 1000, ms % 1000)
                }),
        ),
        (
            "units of the header",
            "Time (ms),pwm,speed [rpm],mA\n".to_owned()
                + &lines(300, |ms, pwm, rpm, ma| format!("{ms},{pwm},{rpm},{ma}")),
        ),
        (
            "a line of units",
            "Time,pwm,speed,mA\n(ms),,(rpm),(mA)\n\n".to_owned()
                + &lines(300, |ms, pwm, rpm, ma| format!("{ms},{pwm},{rpm},{ma}")),
        ),
        (
            "thousands",
            "Time_us;pwm;rpm;mA\n".to_owned()
                + &lines(300, |ms, pwm, rpm, ma| {
                    format!("{}.{:03}.000,0;{pwm};{};{ma}", ms / 1000, ms % 1000, rpm.to_string().replace('.', ","))
                }),
        ),
    ] {
        let mut columns = columns.to_vec();
        if text.contains("speed") {
            columns.push("speed=rpm");
        }
        let what = what.to_owned();
        let found = read(&text, &columns).unwrap_or_else(|why| panic!("{what}: {why}"));
        assert_is_it(&found, 300, &what);
    }
}

#[test]
fn columns_that_need_an_expression() {
    let table = "millis,pwm,dir,rpm,rpm,adc\n".to_owned()
        + &lines(300, |ms, pwm, rpm, ma| {
            format!("{ms},{},{},300.0,{rpm},{}", pwm.abs(), i32::from(pwm > 0), f64::from(ma) / 1000.0 / 0.0264 + 512.0)
        });
    let columns = ["millis=t_s/1000", "pwm*sign(dir)=duty/255", "rpm#2=rpm", "adc=i_A*0.0264-13.5168"];
    let found = read(&table, &columns).unwrap();
    assert_is_it(&found, 300, "expressions");
    let why = read(&table, &columns[..2]).unwrap_err();
    assert!(why.contains("two columns are rpm: rpm#1, rpm#2. Choose, for instance --column rpm#2=rpm"), "{why}");
    let paths = table.replacen("millis,pwm,dir,rpm,rpm,adc", "\"a/millis\",\"m/pwm\",m/dir,m/set rpm,m/rpm,x/adc", 1);
    assert_is_it(
        &read(&paths, &["millis=t_s/1000", "pwm*sign(dir)=duty/255", "adc=i_A*0.0264-13.5168"]).unwrap(),
        300,
        "paths",
    );
}

#[test]
fn exports_of_oscilloscopes_and_labview() {
    let samples = |separator: &str, more: &str, first: &dyn Fn(usize) -> String| {
        let mut text = String::new();
        for row in 0..200 {
            let _ = writeln!(
                text,
                "{}{separator}{}{separator}{:.2}{more}",
                first(row),
                row % 7,
                2.5 + f64::from(row as i32 % 3)
            );
        }
        text
    };
    let seconds = |row: usize| format!("{:.4}", -0.1 + row as f64 * 1e-3);
    let files = [
        ("Rigol DS", "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-1.000000e-01,1.000000e-03\n".to_owned() + &samples(",", ",", &|row| row.to_string()), "CH1", "CH2"),
        ("Rigol MSO", "CH1V,CH2V,t0 =-1.000000e-01, tInc = 1.000000e-03,\n".to_owned() + &(0..200).map(|row| format!("{},{:.2},,\n", row % 7, 2.5 + f64::from(row % 3))).collect::<String>(), "CH1V", "CH2V"),
        ("Siglent", "Record Length,Analog:200\nSample Interval,Analog:0.001\nVertical Units,CH1:V,CH2:V\nModel Number,SDS1104X-E\nSource,CH1,CH2\nSecond,Volt,Volt\n".to_owned() + &samples(",", "", &seconds), "CH1", "CH2"),
        ("Keysight", "x-axis,1,2\nsecond,Volt,Volt\n".to_owned() + &samples(",", "", &seconds), "1", "2"),
        ("Tektronix", "Model,MSO24\nWaveform Type,ANALOG\nHorizontal Units,s\nSample Interval,1E-3\nLabels,,\n,,\nTIME,CH1,CH2\n".to_owned() + &samples(",", "", &seconds), "CH1", "CH2"),
        ("PicoScope", "Time,Channel A,Channel B\n(ms),(V),(V)\n\n".to_owned() + &samples(",", "", &|row| format!("{:.1}", -100.0 + row as f64)), "Channel A", "Channel B"),
        ("LabVIEW", "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n***End_of_Header***\t\n\t\nChannels\t2\t\nSamples\t200\t200\t\nX_Dimension\tTime\tTime\t\nDelta_X\t0.001\t0.001\t\n***End_of_Header***\t\t\t\nX_Value\tVoltage\tSensor\tComment\n".to_owned() + &samples("\t", "", &seconds), "Voltage", "Sensor"),
        ("LabVIEW without times", "LabVIEW Measurement\t\nX_Columns\tNo\n***End_of_Header***\t\n\t\nChannels\t2\t\nX0\t-0.1\t-0.1\t\nDelta_X\t0.001\t0.001\t\n***End_of_Header***\t\t\t\n\tVoltage\tSensor\tComment\n".to_owned() + &samples("\t", "", &|_| String::new()), "Voltage", "Sensor"),
    ];
    for (what, text, first, second) in files {
        let columns = [format!("{first}=u_V"), format!("{second}=i_A/0.185-13.5135")];
        let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
        let mut found = read(&text, &columns).unwrap_or_else(|why| panic!("{what}: {why}"));
        if found.time_s().is_none() && what == "Tektronix" {
            found = read(&text, &[&columns[..], &["TIME=t_s"]].concat()).unwrap();
        }
        if found.time_s().is_none() && what == "LabVIEW" {
            found = read(&text, &[&columns[..], &["X_Value=t_s"]].concat()).unwrap();
        }
        let time_s = found.time_s().unwrap_or_else(|| panic!("{what} has no time: {:?}", found.ignored));
        assert_eq!(time_s.len(), 200, "{what}: {:?}", found.notes);
        for (row, t_s) in time_s.iter().enumerate() {
            assert!((t_s + 0.1 - row as f64 * 1e-3).abs() < 1e-9, "{what}: {t_s}");
            assert_eq!(found.get(Channel::Voltage).unwrap()[row], (row % 7) as f64, "{what}");
        }
    }
    // Tektronix writes its settings beside the samples.
    let settings = [
        "Record Length,2.0e+02",
        "Sample Interval,1.0e-03",
        "Trigger Point,1.0e+02",
        "Source,CH1",
        "Vertical Units,V",
        "Horizontal Units,s",
    ];
    let beside = (0..200)
        .map(|row| format!("{},,{:.3},{}.5,\n", settings.get(row).unwrap_or(&","), -0.1 + row as f64 * 1e-3, row % 7))
        .collect::<String>();
    let found = read(&beside, &["CH1=u_V"]).unwrap();
    assert_eq!((found.len(), found.get(Channel::Voltage).unwrap()[3]), (200, 3.5));
    assert!((found.time_s().unwrap()[199] - 0.099).abs() < 1e-9);
}

#[test]
fn edges_of_a_logic_analyser_become_counts() {
    let mut text = "Time [s],Channel 0,Channel 1\n".to_owned();
    for edge in 0..200 {
        let (a, b) = [(0, 0), (1, 0), (1, 1), (0, 1)][edge % 4];
        let _ = writeln!(text, "{:.6},{a},{b}", edge as f64 * 1e-3);
    }
    let found = read(&text, &["quadrature(Channel 0,Channel 1)=counts"]).unwrap();
    assert!(found.get(Channel::Counts).unwrap().iter().enumerate().all(|(row, count)| *count == row as f64));
    assert!((found.time_s().unwrap()[199] - 0.199).abs() < 1e-9);
}

#[test]
fn curves_of_plotjuggler_are_measured_or_held() {
    let mut text = "\"__time\",\"/motor/Voltage, commanded\",\"/motor/speed[rad/s]\"\n".to_owned();
    for row in 0..200 {
        let speed = if row % 2 == 0 { format!("{}", 3 * row) } else { String::new() };
        let _ = writeln!(text, "{:.6},{},{speed}", 1_709_305_190.0 + f64::from(row) * 0.01, f64::from(row) * 0.02);
    }
    let columns = ["Voltage, commanded=u_V", "speed=omega_rad_per_s"];
    let found = read(&text, &columns).unwrap();
    assert_eq!(found.len(), 100);
    assert_eq!(found.get(Channel::Speed).unwrap()[7], 42.0);
    assert!(
        (found.get(Channel::Voltage).unwrap()[7] - 0.28).abs() < 1e-9
            && (found.time_s().unwrap()[7] - 0.14).abs() < 1e-6
    );
    assert_eq!(
        found.notes,
        [
            "100 of 200 values of /motor/Voltage, commanded lie between the samples of /motor/speed[rad/s] and are left out."
        ]
    );
}

#[test]
fn speeds_that_wrap_are_continued_before_they_are_scaled() {
    let speed = |row: i32| (45_000.0 * (f64::from(row) * 0.02).sin()).round();
    let mut text = "t_s,u_V,vel\n".to_owned();
    for row in 0..700 {
        let _ = writeln!(
            text,
            "{:.2},{},{}",
            f64::from(row) * 0.01,
            row % 9,
            (speed(row) + 32_768.0).rem_euclid(65_536.0) - 32_768.0
        );
    }
    let found = read(&text, &["vel=omega_rad_per_s*0.001"]).unwrap();
    assert!(
        found
            .get(Channel::Speed)
            .unwrap()
            .iter()
            .enumerate()
            .all(|(row, value)| (value - 1e-3 * speed(row as i32)).abs() < 1e-9)
    );
    assert_eq!(found.notes, ["omega_rad_per_s wraps at 16 bits. It is continued."]);
}

proptest! {
    /// A table loses no bit, whatever separator, notation and line ends it has.
    #[test]
    fn every_dialect_gives_the_same_numbers(
        rows in prop::collection::vec((-1e6..1e6_f64, prop_oneof![4 => -1e-3..1e-3_f64, 1 => Just(f64::NAN)]), 4..40),
        separator in prop::sample::select(vec![",", ";", "\t", "|", "   "]),
        ends in prop::sample::select(vec!["\n", "\r\n", "\r"]),
        before in prop::sample::select(vec!["", "Ready\n", "# a comment\n", "Motor test\nboard 3\n"]),
        comma in any::<bool>(),
    ) {
        let comma = comma && separator != ",";
        let text = |value: f64| match (value.is_nan(), comma) {
            (true, _) => "nan".to_owned(),
            (_, true) => value.to_string().replace('.', ","),
            _ => value.to_string(),
        };
        let mut table = before.to_owned() + &["t_s", "u_V", "rpm"].join(separator) + "\n";
        for (row, (volts, speed)) in rows.iter().enumerate() {
            table += &[text(row as f64 / 8.0), text(*volts), text(*speed)].join(separator);
            table.push('\n');
        }
        let found = Recording::parse("made", table.replace('\n', ends).as_bytes(), &[]).unwrap();
        prop_assert_eq!(found.len(), rows.len());
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        let of = |pick: fn(&(f64, f64)) -> f64| rows.iter().map(pick).collect::<Vec<_>>();
        prop_assert_eq!(bits(found.get(Channel::Voltage).unwrap()), bits(&of(|row| row.0)));
        if let Some(speed) = found.get(Channel::Rpm) {
            prop_assert_eq!(bits(speed), bits(&of(|row| row.1)));
        }
    }

    /// Any text is a table or an error, and no panic.
    #[test]
    fn any_text_is_read_or_refused(text in "[-0-9a-zA-Z,;:.\"\t >#%/\\[\\]\n\r+]{0,400}") {
        if let Err(error) = Recording::parse("any", text.as_bytes(), &[]) {
            prop_assert!(error.to_string().starts_with("any"), "{}", error);
        }
    }
}
