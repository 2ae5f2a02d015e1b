use super::*;
use proptest::prelude::*;

fn recording(rows: &[(f64, f64, f64)]) -> Recording {
    let mut recording = Recording::new("made.csv");
    let column = |of: &dyn Fn(&(f64, f64, f64)) -> f64| rows.iter().map(of).collect::<Vec<_>>();
    recording.set(Channel::Time, (0..rows.len()).map(|row| row as f64 * 1e-3).collect());
    recording.set(Channel::Voltage, column(&|row| row.0));
    recording.set(Channel::Speed, column(&|row| row.1));
    recording.set(Channel::Current, column(&|row| row.2));
    recording
}

fn there_and_back(recording: &Recording, format: Format, dialect: Dialect) -> Recording {
    let bytes = write(recording, format, &[], dialect).unwrap();
    read("made.csv", &bytes, format, &[], dialect).unwrap().recording
}

/// Equal up to the share `tolerance` and the absolute error `least`; missing stays missing.
fn assert_same(a: &Recording, b: &Recording, tolerance: f64, least: f64) {
    assert_eq!(a.channels().collect::<Vec<_>>(), b.channels().collect::<Vec<_>>());
    for channel in a.channels() {
        let (a, b) = (a.get(channel).unwrap(), b.get(channel).unwrap());
        assert_eq!(a.len(), b.len());
        for (a, b) in a.iter().zip(b) {
            let same = a.is_nan() && b.is_nan() || (a - b).abs() <= least + tolerance * a.abs();
            assert!(same, "{}: {a} became {b}", channel.column());
        }
    }
}

fn value() -> impl Strategy<Value = f64> {
    prop_oneof![8 => -1e6..1e6_f64, 1 => Just(f64::NAN), 1 => Just(0.0), 1 => -1e-6..1e-6_f64]
}

/// Tables in the format of spreadsheets with a decimal comma.
#[test]
fn exports_of_spreadsheets_are_read() {
    let table = "\"t_s\";\"u_V\";\r\n0;1,5;\r\n0,001;-2;\r\n";
    let utf_16 = |table: &str| [0xfeff].into_iter().chain(table.encode_utf16()).collect::<Vec<u16>>();
    let dialect = Dialect { decimal_comma: true, ..Dialect::default() };
    let files = [
        format!("\u{feff}{table}").into_bytes(),
        format!("sep=;\r\n{table}").into_bytes(),
        utf_16(table).into_iter().flat_map(u16::to_le_bytes).collect(),
        utf_16(&table.replace(';', "\t")).into_iter().flat_map(u16::to_be_bytes).collect(),
    ];
    for bytes in files {
        let converted = read("made.csv", &bytes, Format::Csv, &[], dialect).unwrap();
        assert_eq!(converted.recording.get(Channel::Voltage), Some(&[1.5, -2.0][..]));
        assert_eq!(converted.recording.time_s(), Some(&[0.0, 0.001][..]));
        assert!(converted.recording.ignored.is_empty(), "{:?}", converted.recording.ignored);
    }
    let plain = |table: &str| read("made.csv", table.as_bytes(), Format::Csv, &[], Dialect::default());
    assert_eq!(plain(table).unwrap().recording.get(Channel::Voltage), Some(&[1.5, -2.0][..]));
    // 1,5 and 0,001 can only have decimal commas.
    assert_eq!(plain(&table.replace(';', "\t")).unwrap().recording.get(Channel::Voltage), Some(&[1.5, -2.0][..]));
    let ambiguous = plain("t_s\tu_V\n0\t1,500\n1\t2,500\n");
    assert!(ambiguous.unwrap_err().to_string().contains("--decimal-comma"));
}

proptest! {
    #[test]
    fn every_format_gives_back_what_it_took(rows in prop::collection::vec((value(), value(), value()), 2..60)) {
        let recording = recording(&rows);
        // Every bit is kept, apart from microseconds in the times of logs.
        for format in [Format::Mat, Format::Npy, Format::Npz, Format::Csv] {
            assert_same(&recording, &there_and_back(&recording, format, Dialect::default()), 0.0, 0.0);
        }
        for format in [Format::Plotjuggler, Format::Wpilog] {
            assert_same(&recording, &there_and_back(&recording, format, Dialect::default()), 0.0, 1e-12);
        }
        let german = Dialect { delimiter: Some(b';'), decimal_comma: true };
        assert_same(&recording, &there_and_back(&recording, Format::Csv, german), 0.0, 0.0);
    }

    /// Whatever the channels and the clock are: times since 1970 in whole microseconds, counters of 32 bits.
    #[test]
    fn times_and_counts_of_any_size_come_back(
        start_us in 0..2_000_000_000_000_000_u64,
        steps_us in prop::collection::vec(500_000..5_000_000_u64, 2..60),
        counts in prop::collection::vec(any::<i32>(), 60),
        missing in 0..60_usize,
    ) {
        let mut recording = Recording::new("made.csv");
        let times = steps_us.iter().scan(start_us, |time_us, step_us| {
            *time_us += step_us;
            Some(*time_us as f64 / 1e6)
        });
        recording.set(Channel::Time, times.collect());
        let count = |row: usize| if row == missing { f64::NAN } else { f64::from(counts[row]) };
        recording.set(Channel::Counts, (0..steps_us.len()).map(count).collect());
        recording.set(Channel::Supply, vec![12.0; steps_us.len()]);
        for format in [Format::Mat, Format::Npy, Format::Npz, Format::Csv] {
            assert_same(&recording, &there_and_back(&recording, format, Dialect::default()), 0.0, 0.0);
        }
        // Logs count from their first sample, in microseconds.
        let start_s = recording.time_s().unwrap()[0];
        let mut from_0 = recording.clone();
        from_0.set(Channel::Time, recording.time_s().unwrap().iter().map(|t_s| t_s - start_s).collect());
        for format in [Format::Plotjuggler, Format::Wpilog] {
            assert_same(&from_0, &there_and_back(&recording, format, Dialect::default()), 1e-9, 1e-6);
        }
    }

    /// For any bytes, reading returns a recording or an error with a message.
    #[test]
    fn damaged_files_never_panic(
        rows in prop::collection::vec((value(), value(), value()), 2..20),
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
        kept in any::<prop::sample::Index>(),
    ) {
        for format in [Format::Mat, Format::Npy, Format::Npz, Format::Wpilog, Format::Plotjuggler, Format::Csv] {
            let mut bytes = write(&recording(&rows), format, &[], Dialect::default()).unwrap();
            for (place, value) in &damage {
                let place = place.index(bytes.len());
                bytes[place] = *value;
            }
            bytes.truncate(kept.index(bytes.len()) + 1);
            if let Err(error) = read("bad", &bytes, format, &[], Dialect::default()) {
                prop_assert!(error.to_string().starts_with("bad"), "{}", error);
            }
        }
    }
}

/// Four tests of SysId: a ramp and a step in each direction.
fn four_tests() -> Recording {
    let mut recording = Recording::new("four.csv");
    let (mut time_s, mut voltage) = (Vec::new(), Vec::new());
    for (test, course) in [|x: f64| 8.0 * x + 0.01, |x| -8.0 * x - 0.01, |_| 7.0, |_| -7.0].into_iter().enumerate() {
        time_s.extend((0..200).map(|row| f64::from(row) * 0.01 + 3.0 * test as f64));
        voltage.extend((0..200).map(|row| course(f64::from(row) / 200.0)));
    }
    recording.set(Channel::Angle, time_s.iter().map(|t_s| 5.0 * t_s).collect());
    recording.set(Channel::Speed, voltage.iter().map(|u| 10.0 * u).collect());
    recording.set(Channel::Time, time_s);
    recording.set(Channel::Voltage, voltage);
    recording
}

#[test]
fn sysid_tests_are_found_in_a_recording_and_come_back() {
    let original = four_tests();
    let back = there_and_back(&original, Format::Sysid, Dialect::default());
    for channel in [Channel::Voltage, Channel::Speed, Channel::Angle] {
        for (a, b) in original.get(channel).unwrap().iter().zip(back.get(channel).unwrap()) {
            assert!((a - b).abs() < 1e-9, "{}", channel.column());
        }
    }
    let time_s = back.time_s().unwrap();
    assert!((time_s[200] - time_s[199] - 1.0).abs() < 1e-9, "a pause between tests");
    let mut forward = original.clone();
    forward.set(Channel::Voltage, original.get(Channel::Voltage).unwrap().iter().map(|u| u.abs()).collect());
    let message = write(&forward, Format::Sysid, &[], Dialect::default()).unwrap_err().to_string();
    assert!(message.contains("\"slow-backward\": this test is a slow ramp of negative voltage"), "{message}");
}

fn message(bytes: &[u8], format: Format, names: &[&str]) -> String {
    let names: Vec<Mapping> = names.iter().map(|name| name.parse().unwrap()).collect();
    read("in", bytes, format, &names, Dialect::default()).unwrap_err().to_string()
}

#[test]
fn errors_say_where_and_what_to_do() {
    let csv = |text: &str, names: &[&str]| message(text.as_bytes(), Format::Csv, names);
    assert_eq!(
        csv("t_s\tu_V\n0\t1,500\n", &[]),
        "in: line 2: column u_V: expected a number, found \"1,500\"; for decimal commas add --decimal-comma"
    );
    assert!(csv("a,b\n0,1\n", &[]).contains("no known channel among a, b. Name them with --column NAME=CHANNEL"));
    assert!(
        csv("t_s,u_V\n0,1\n", &["v=omega_rad_per_s"]).contains("there is no numeric column \"v\"; there are t_s, u_V")
    );
    assert!(csv("t_s,u_V\n0,1\n0,1\n", &[]).contains("time must increase"));
    assert!(message(b"{\n \"sysid\": true,\n}", Format::Sysid, &[]).contains("line 3, column 1"));
    assert!(
        message(b"{\"sysid\":true,\"slow-forward\":[[1,2]]}", Format::Sysid, &[])
            .contains("\"slow-forward\", sample 1: expected [time, voltage, position, velocity], found [1,2]")
    );
    assert!(message(b"WPILOG\x00\x02\0\0\0\0", Format::Wpilog, &[]).contains("byte 6: version 2.0"));
    assert!(message(b"MATLAB 7.3 MAT-file", Format::Mat, &[]).contains("save it with save(..., '-v7')"));
    let mut cut = write(&four_tests(), Format::Mat, &[], Dialect::default()).unwrap();
    cut.truncate(300);
    assert!(message(&cut, Format::Mat, &[]).contains("byte 136: "));
}

#[test]
fn units_are_scaled_and_paths_are_known_by_their_last_part() {
    let text = "__time,/motor/turns_per_s,/motor/u_V\n100.0,1,2\n100.01,,3\n100.02,2,\n";
    let names = ["turns_per_s=omega_rad_per_s*6.283185307179586".parse().unwrap()];
    let read = read("jug.csv", text.as_bytes(), Format::Csv, &names, Dialect::default()).unwrap().recording;
    // The measured speed gives the times; the command holds its value.
    assert_eq!(read.time_s().unwrap(), [0.0, 0.02]);
    assert_eq!(read.get(Channel::Voltage).unwrap(), [2.0, 3.0]);
    assert!((read.get(Channel::Speed).unwrap()[1] - 2.0 * std::f64::consts::TAU).abs() < 1e-12);
}

#[test]
fn samples_without_any_value_are_not_lost() {
    let missing = f64::NAN;
    for lacking in [1, 12] {
        let values = |first: f64| -> Vec<f64> {
            let sampled = (0..20).map(|row| first + f64::from(row));
            std::iter::repeat_n(missing, lacking).chain(sampled).chain([missing]).collect()
        };
        let mut recording = Recording::new("a sensor that starts late");
        recording.set(Channel::Duty, values(0.5));
        recording.set(Channel::Speed, values(30.0));
        for dialect in [Dialect::default(), Dialect { delimiter: Some(b';'), decimal_comma: true }] {
            let back = there_and_back(&recording, Format::Csv, dialect);
            for channel in [Channel::Duty, Channel::Speed] {
                let (before, after) = (recording.get(channel).unwrap(), back.get(channel).unwrap());
                assert_eq!(before.len(), after.len(), "{lacking} rows before the first value");
                assert!(before.iter().zip(after).all(|(a, b)| a == b || a.is_nan() && b.is_nan()), "{after:?}");
            }
        }
    }
}

#[test]
fn a_rule_under_the_names_is_no_sample() {
    let read = |text: &str| read("in", text.as_bytes(), Format::Csv, &[], Dialect::default()).unwrap().recording;
    let ruled = read("u_V | omega_rad_per_s\n----|----\n1.5 | 30.0\n1.6 | 31.0\n");
    assert_eq!(ruled.get(Channel::Voltage).unwrap(), [1.5, 1.6]);
    let missing = read("u_V,omega_rad_per_s\nnan,nan\n1.5,30.0\n");
    assert!(missing.get(Channel::Voltage).unwrap()[0].is_nan(), "{missing:?}");
    assert_eq!(missing.get(Channel::Voltage).unwrap()[1], 1.5);
}
