//! Files of instruments, robots, Office programs and MATLAB, made here byte by byte.

use super::*;
use hdf5_pure::{AttrValue, FileBuilder};
use serde_json::json;
use std::io::{Cursor, Write as _};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

fn columns(columns: &[&str]) -> Vec<Mapping> {
    columns.iter().map(|column| column.parse().unwrap()).collect()
}

pub fn read_as(format: Format, bytes: &[u8], names: &[&str]) -> Result<Recording, String> {
    read("in", bytes, format, &columns(names), Dialect::default())
        .map(|converted| converted.recording)
        .map_err(|error| error.to_string())
}

fn values(recording: &Recording, channel: Channel) -> &[f64] {
    recording.get(channel).unwrap_or_else(|| panic!("no {}: {:?}", channel.column(), recording.ignored))
}

/// A workbook with one sheet of these rows; its numbers are numbers, its words are in the cells.
fn workbook(rows: &[&[&str]]) -> Vec<u8> {
    let mut sheet = String::new();
    for (row, cells) in rows.iter().enumerate() {
        let cell = |(column, text): (usize, &&str)| {
            let place = format!("{}{}", char::from(b'A' + column as u8), row + 1);
            match text.parse::<f64>() {
                Ok(_) => format!("<c r=\"{place}\"><v>{text}</v></c>"),
                Err(_) => format!("<c r=\"{place}\" t=\"inlineStr\"><is><t>{text}</t></is></c>"),
            }
        };
        let cells: String = cells.iter().enumerate().map(cell).collect();
        sheet += &format!("<row r=\"{}\">{cells}</row>", row + 1);
    }
    book_of(&sheet)
}

/// A workbook with one sheet of these elements `row`.
pub fn book_of(rows: &str) -> Vec<u8> {
    book_with(rows, &[])
}

/// The same with more parts.
pub fn book_with(rows: &str, others: &[(&str, &str)]) -> Vec<u8> {
    let main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main";
    let relations = "http://schemas.openxmlformats.org/officeDocument/2006/relationships";
    let package = "http://schemas.openxmlformats.org/package/2006";
    let files = [
        (
            "[Content_Types].xml",
            format!(
                "<Types xmlns=\"{package}/content-types\"><Default Extension=\"xml\" ContentType=\"application/xml\"/></Types>"
            ),
        ),
        (
            "_rels/.rels",
            format!(
                "<Relationships xmlns=\"{package}/relationships\"><Relationship Id=\"rId1\" Type=\"{relations}/officeDocument\" Target=\"xl/workbook.xml\"/></Relationships>"
            ),
        ),
        (
            "xl/workbook.xml",
            format!(
                "<workbook xmlns=\"{main}\" xmlns:r=\"{relations}\"><sheets><sheet name=\"Log\" sheetId=\"1\" r:id=\"rId1\"/></sheets></workbook>"
            ),
        ),
        (
            "xl/_rels/workbook.xml.rels",
            format!(
                "<Relationships xmlns=\"{package}/relationships\"><Relationship Id=\"rId1\" Type=\"{relations}/worksheet\" Target=\"worksheets/sheet1.xml\"/></Relationships>"
            ),
        ),
        ("xl/worksheets/sheet1.xml", format!("<worksheet xmlns=\"{main}\"><sheetData>{rows}</sheetData></worksheet>")),
    ];
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let others = others.iter().map(|(name, text)| (*name, (*text).to_owned()));
    for (name, text) in files.into_iter().chain(others) {
        archive.start_file(name, SimpleFileOptions::default()).unwrap();
        archive.write_all(text.as_bytes()).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

#[test]
fn a_workbook_is_read_like_a_table() {
    let book = workbook(&[
        &["Measured on Monday", "", ""],
        &["t_s", "u_V", "Speed (rpm)"],
        &["0", "1.5", "10"],
        &["0.01", "-2", "20.25"],
        &["0.02", "3", "n/a"],
    ]);
    assert_eq!(Format::of_content(Path::new("log.xlsx"), &book), Format::Spreadsheet);
    let found = read_as(Format::Spreadsheet, &book, &["Speed=rpm"]).unwrap();
    assert_eq!(values(&found, Channel::Time), [0.0, 0.01, 0.02]);
    assert_eq!(values(&found, Channel::Voltage), [1.5, -2.0, 3.0]);
    assert!(values(&found, Channel::Rpm)[..2] == [10.0, 20.25] && values(&found, Channel::Rpm)[2].is_nan());
    let why = read_as(Format::Spreadsheet, b"PK\x03\x04nothing", &[]).unwrap_err();
    assert!(why.contains("this spreadsheet cannot be read") && why.contains("save the sheet as CSV"), "{why}");
    // An archive that has a sheet, but not the list of the sheets.
    let archive = |part: &str| {
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        archive.start_file(part, SimpleFileOptions::default()).unwrap();
        archive.write_all(b"<worksheet/>").unwrap();
        archive.finish().unwrap().into_inner()
    };
    for (part, what) in [
        (
            "xl/worksheets/sheet1.xml",
            "it has no xl/workbook.xml, the list of its sheets; it has xl/worksheets/sheet1.xml",
        ),
        ("run.csv", "this archive is no spreadsheet: it has run.csv"),
    ] {
        let why = read_as(Format::Spreadsheet, &archive(part), &[]).unwrap_err();
        assert!(why.contains(what) && why.contains("soffice --headless --convert-to csv FILE"), "{why}");
    }
}

/// An element of a MATLAB file of level 5.
pub fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut bytes = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
    bytes.extend(data);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

pub fn array(class: u8, shape: [u32; 2], name: &str, content: &[u8]) -> Vec<u8> {
    let flags = element(6, &[u32::from(class).to_le_bytes(), [0; 4]].concat());
    let shape = element(5, &shape.map(u32::to_le_bytes).concat());
    element(14, &[&flags[..], &shape, &element(1, name.as_bytes()), content].concat())
}

pub fn doubles(values: &[f64]) -> Vec<u8> {
    element(9, &values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<_>>())
}

pub fn matlab(variables: &[Vec<u8>]) -> Vec<u8> {
    let mut file = format!("{:<124}", "MATLAB 5.0 MAT-file").into_bytes();
    file.extend(b"\0\x01IM");
    file.extend(variables.concat());
    file
}

/// A structure of one element.
fn structure(name: &str, fields: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let names: Vec<u8> = fields.iter().flat_map(|(name, _)| format!("{name:\0<16}").into_bytes()).collect();
    let content = [
        element(5, &16_u32.to_le_bytes()),
        element(1, &names),
        fields.iter().flat_map(|(_, field)| field.clone()).collect(),
    ];
    array(2, [1, 1], name, &content.concat())
}

#[test]
fn matrices_and_structures_of_matlab() {
    let rows = 30_u32;
    let column = |of: &dyn Fn(f64) -> f64| (0..rows).map(|row| of(f64::from(row))).collect::<Vec<f64>>();
    let (time, volts, speed) = (column(&|x| 0.01 * x), column(&|x| x - 9.0), column(&|x| 3.0 * x));
    let matrix = array(6, [rows, 3], "log", &doubles(&[time.clone(), volts.clone(), speed.clone()].concat()));
    let found = read_as(Format::Mat, &matlab(&[matrix]), &["log/1=t_s", "log/2=u_V", "3=omega_rad_per_s"]).unwrap();
    assert_eq!((values(&found, Channel::Voltage), values(&found, Channel::Speed)), (&volts[..], &speed[..]));
    // Samples along the rows.
    let across: Vec<f64> = (0..rows as usize).flat_map(|row| [time[row], volts[row], speed[row]]).collect();
    let matrix = array(6, [3, rows], "log", &doubles(&across));
    let found = read_as(Format::Mat, &matlab(&[matrix]), &["log/1=t_s", "log/2=u_V", "log/3=omega_rad_per_s"]).unwrap();
    assert_eq!(values(&found, Channel::Speed), &speed[..]);
    // The structure with time that Simulink saves.
    let vector = |values: &[f64]| array(6, [rows, 1], "", &doubles(values));
    let label = |text: &str| array(4, [1, text.len() as u32], "", &element(16, text.as_bytes()));
    let signal = |name: &str, values: &[f64]| structure("", &[("values", vector(values)), ("label", label(name))]);
    let out =
        structure("out", &[("time", vector(&time)), ("u_V", signal("u_V", &volts)), ("rest", signal("omega", &speed))]);
    let unused = array(1, [0, 0], "cells", &[]);
    let found = read_as(Format::Mat, &matlab(&[unused, out]), &["time=t_s", "omega=omega_rad_per_s"]).unwrap();
    assert_eq!((values(&found, Channel::Voltage), values(&found, Channel::Speed)), (&volts[..], &speed[..]));
}

/// Objects keep their arrays in a variable of bytes without a name.
#[test]
fn arrays_of_matlab_objects() {
    let samples: Vec<f64> = (0..40).map(f64::from).collect();
    let single: Vec<u8> = (0..40).flat_map(|value| (2.0 * value as f32).to_le_bytes()).collect();
    let cells = [
        array(6, [40, 1], "", &doubles(&samples)),
        array(6, [1, 1], "", &doubles(&[7.0])),
        array(7, [40, 1], "", &element(7, &single)),
    ];
    let inside = [vec![0, 1, b'I', b'M', 0, 0, 0, 0], array(1, [3, 1], "", &cells.concat())].concat();
    let workspace = array(9, [1, inside.len() as u32], "", &element(2, &inside));
    let names = ["row=t_s*0.0005", "object/1=u_V", "object/2=omega_rad_per_s"];
    let found = read_as(Format::Mat, &matlab(&[workspace]), &names).unwrap();
    assert_eq!((values(&found, Channel::Voltage)[39], values(&found, Channel::Speed)[39]), (39.0, 78.0));
    assert!((values(&found, Channel::Time)[39] - 0.0195).abs() < 1e-12);
    assert!(found.notes.iter().any(|note| note.contains("object/1")), "{:?}", found.notes);
}

pub fn words(values: &[u32]) -> Vec<u8> {
    values.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// The bytes that say which objects there are: one that holds two timeseries. The cells of properties are: name, samples
/// and time information of the first, its times; the same of the second, its step and number; the two objects.
fn two_timeseries() -> Vec<u8> {
    // Names by their number, from 1; the fourth and the fifth are classes.
    let names = b"Name\0Data_\0TimeInfo\0timeseries\0holder\0Time_\0Increment_\0Length\0any\0";
    let list = |properties: &[[u32; 2]]| {
        let mut found = vec![properties.len() as u32];
        found.extend(properties.iter().flat_map(|[name, cell]| [*name, 1, *cell]));
        found.resize(found.len().next_multiple_of(2), 0);
        found
    };
    let saved = [vec![0, 0], list(&[[9, 9]])].concat();
    let plain = [
        vec![0, 0],
        list(&[[1, 0], [2, 1], [3, 2]]),
        list(&[[6, 3]]),
        list(&[[1, 4], [2, 5], [3, 6]]),
        list(&[[7, 7], [8, 8]]),
    ]
    .concat();
    let classes = [0_u32; 12];
    let objects: Vec<u32> = [
        [0, 0, 0, 0, 0, 0],
        [2, 0, 0, 1, 0, 1],
        [1, 0, 0, 0, 1, 2],
        [1, 0, 0, 0, 2, 3],
        [1, 0, 0, 0, 3, 4],
        [1, 0, 0, 0, 4, 5],
    ]
    .concat();
    let mut parts = vec![40 + names.len().next_multiple_of(8)];
    for length in [classes.len(), saved.len(), objects.len(), plain.len()] {
        parts.push(parts.last().unwrap() + 4 * length);
    }
    let mut bytes = words(&[4, 9]);
    bytes.extend(words(&parts.iter().map(|part| *part as u32).collect::<Vec<_>>()));
    bytes.resize(40, 0);
    bytes.extend(names);
    bytes.resize(parts[0], 0);
    bytes.extend([words(&classes), words(&saved), words(&objects), words(&plain)].concat());
    bytes
}

/// Two timeseries in an object that holds them, as Simulink saves a Dataset. One has its times one by one, the other has
/// start, step and number.
#[test]
fn signals_of_matlab_objects_have_their_names() {
    let volts: Vec<f64> = (0..40).map(f64::from).collect();
    let speed: Vec<f64> = volts.iter().map(|value| 2.0 * value).collect();
    let times: Vec<f64> = volts.iter().map(|value| 0.5e-3 * value).collect();
    let text = |text: &str| array(4, [1, text.len() as u32], "", &element(16, text.as_bytes()));
    let column = |values: &[f64]| array(6, [values.len() as u32, 1], "", &doubles(values));
    let reference = |objects: &[u32]| {
        let numbers = [&[0xdd00_0000, 2, objects.len() as u32, 1], objects, &[1]].concat();
        array(13, [numbers.len() as u32, 1], "", &element(6, &words(&numbers)))
    };
    let bytes = two_timeseries();
    let cells = [
        array(9, [1, bytes.len() as u32], "", &element(2, &bytes)),
        array(6, [0, 0], "", &[]),
        text("input signal"),
        column(&volts),
        reference(&[3]),
        column(&times),
        text("Motor Angular Velocity"),
        column(&speed),
        reference(&[5]),
        column(&[0.5e-3]),
        column(&[40.0]),
        array(1, [2, 1], "", &[reference(&[2]), reference(&[4])].concat()),
    ];
    let inside = [vec![0, 1, b'I', b'M', 0, 0, 0, 0], array(1, [cells.len() as u32, 1], "", &cells.concat())].concat();
    let workspace = array(9, [1, inside.len() as u32], "", &element(2, &inside));
    let names = ["input signal=u_V", "Motor Angular Velocity=omega_rad_per_s"];
    let found = read_as(Format::Mat, &matlab(std::slice::from_ref(&workspace)), &names).unwrap();
    assert_eq!((values(&found, Channel::Voltage), values(&found, Channel::Speed)), (&volts[..], &speed[..]));
    assert!((values(&found, Channel::Time)[39] - 0.0195).abs() < 1e-12);
    // Beside a vector they are columns like it.
    let current = array(6, [40, 1], "current", &doubles(&volts));
    let names = [&names[..], &["current=i_A", "input signal/time=t_s"]].concat();
    let found = read_as(Format::Mat, &matlab(&[current, workspace]), &names).unwrap();
    assert_eq!((values(&found, Channel::Current), values(&found, Channel::Speed)), (&volts[..], &speed[..]));
}

#[test]
fn variables_of_matlab_7_3() {
    let mut file = FileBuilder::new();
    let samples = |of: &dyn Fn(f64) -> f64| (0..30).map(|row| of(f64::from(row))).collect::<Vec<f64>>();
    let set = |builder: &mut hdf5_pure::DatasetBuilder, values: &[f64], shape: &[u64]| {
        builder
            .with_f64_data(values)
            .with_shape(shape)
            .set_attr("MATLAB_class", AttrValue::AsciiString("double".into()));
    };
    set(file.create_dataset("t_s"), &samples(&|x| 0.01 * x), &[1, 30]);
    set(file.create_dataset("log"), &[samples(&|x| x), samples(&|x| -x)].concat(), &[2, 30]);
    let bytes = file.finish().unwrap();
    let found = read_as(Format::Mat, &bytes, &["log/1=u_V", "log/2=omega_rad_per_s"]).unwrap();
    assert_eq!((values(&found, Channel::Voltage)[29], values(&found, Channel::Speed)[29]), (29.0, -29.0));
    // The signals of a Simulink Dataset, with start, step and count of their times.
    let mut file = FileBuilder::new();
    let mut references = file.create_group("#refs#");
    for (group, name, factor) in [("a", "volts", 1.0), ("b", "speed", 3.0)] {
        let mut element = references.create_group(group);
        let letters: Vec<u16> = name.encode_utf16().collect();
        element.create_dataset("Name").with_u16_data(&letters).with_shape(&[letters.len() as u64, 1]);
        let mut inside = element.create_group("Values");
        set(inside.create_dataset("Data"), &samples(&|x| factor * x), &[1, 30]);
        set(inside.create_dataset("CompressedTime"), &[0.0, 0.0002, 30.0], &[3, 1]);
        element.add_group(inside.finish());
        references.add_group(element.finish());
    }
    file.add_group(references.finish());
    let found = read_as(Format::Mat, &file.finish().unwrap(), &["volts=u_V", "speed=omega_rad_per_s"]).unwrap();
    assert_eq!((found.len(), values(&found, Channel::Speed)[29]), (30, 87.0));
    assert!((values(&found, Channel::Time)[29] - 0.0058).abs() < 1e-12);
}

/// Simulink keeps the samples of a streamed signal in a group of the signal's number, in the type of the signal.
#[test]
fn streamed_signals_of_a_simulink_dataset() {
    let mut file = FileBuilder::new();
    let (mut references, mut streams) = (file.create_group("#refs#"), file.create_group("#sigstream#"));
    for (number, name, single) in [(0.0_f64, "speed", true), (1.0, "volts", false)] {
        let mut element = references.create_group(name);
        let letters: Vec<u16> = name.encode_utf16().collect();
        element.create_dataset("Name").with_u16_data(&letters).with_shape(&[letters.len() as u64, 1]);
        let mut inside = element.create_group("Values");
        inside.create_dataset("DataR2").with_f64_data(&[number]).with_shape(&[1, 1]);
        inside.create_dataset("CompressedTime").with_f64_data(&[0.0, 0.001, 30.0]).with_shape(&[3, 1]);
        element.add_group(inside.finish());
        references.add_group(element.finish());
        let samples: Vec<u8> = (0..30_u8)
            .flat_map(|row| match single {
                true => (3.0 * f32::from(row)).to_le_bytes().to_vec(),
                false => f64::from(row).to_le_bytes().to_vec(),
            })
            .collect();
        let mut stream = streams.create_group(&number.to_string());
        stream.create_dataset("#data#").with_u8_data(&samples).with_shape(&[samples.len() as u64]);
        streams.add_group(stream.finish());
    }
    file.add_group(references.finish());
    file.add_group(streams.finish());
    let found = read_as(Format::Mat, &file.finish().unwrap(), &["volts=u_V", "speed=omega_rad_per_s"]).unwrap();
    assert_eq!((values(&found, Channel::Speed)[29], values(&found, Channel::Voltage)[29]), (87.0, 29.0));
}

/// MATLAB 7.3 keeps objects in the same cells, each a dataset of its own.
#[test]
fn signals_of_objects_in_matlab_7_3() {
    let mut file = FileBuilder::new();
    let class = |name: &str| AttrValue::AsciiString(name.into());
    let mut cells = file.create_group("#refs#");
    let bytes = two_timeseries();
    cells.create_dataset("00").with_u8_data(&bytes).with_shape(&[1, bytes.len() as u64]);
    cells.create_dataset("01").with_u64_data(&[0, 0]).with_shape(&[2]).set_attr("MATLAB_empty", AttrValue::U8(1));
    let mut number = 2;
    let mut name = || {
        number += 1;
        format!("{:02}", number - 1)
    };
    for (signal, factor) in [("input signal", 1.0_f64), ("Motor Angular Velocity", 2.0)] {
        let letters: Vec<u16> = signal.encode_utf16().collect();
        let text = cells.create_dataset(&name());
        text.with_u16_data(&letters).with_shape(&[letters.len() as u64, 1]).set_attr("MATLAB_class", class("char"));
        let samples: Vec<f64> = (0..40).map(|row| factor * f64::from(row)).collect();
        cells.create_dataset(&name()).with_f64_data(&samples).with_shape(&[1, 40]);
        let info = if factor == 1.0 { 3 } else { 5 };
        cells.create_dataset(&name()).with_u32_data(&[0xdd00_0000, 2, 1, 1, info, 1]).with_shape(&[1, 6]);
        if factor == 1.0 {
            let times: Vec<f64> = (0..40).map(|row| 0.5e-3 * f64::from(row)).collect();
            cells.create_dataset(&name()).with_f64_data(&times).with_shape(&[1, 40]);
        } else {
            cells.create_dataset(&name()).with_f64_data(&[0.5e-3]).with_shape(&[1, 1]);
            cells.create_dataset(&name()).with_f64_data(&[40.0]).with_shape(&[1, 1]);
        }
    }
    cells.create_dataset(&name()).with_u32_data(&[0xdd00_0000, 2, 2, 1, 2, 4, 1]).with_shape(&[1, 7]);
    file.add_group(cells.finish());
    let mut subsystem = file.create_group("#subsystem#");
    let paths: Vec<String> = (0..number).map(|cell| format!("#refs#/{cell:02}")).collect();
    let paths: Vec<&str> = paths.iter().map(String::as_str).collect();
    subsystem.create_dataset("MCOS").with_path_references(&paths).with_shape(&[1, paths.len() as u64]);
    file.add_group(subsystem.finish());
    let names = ["input signal=u_V", "Motor Angular Velocity=omega_rad_per_s"];
    let found = read_as(Format::Mat, &file.finish().unwrap(), &names).unwrap();
    assert_eq!((values(&found, Channel::Voltage)[39], values(&found, Channel::Speed)[39]), (39.0, 78.0));
    assert!((values(&found, Channel::Time)[39] - 0.0195).abs() < 1e-12);
}

/// A test of SysId: time, voltage, turns, turns/s.
fn sysid_test(start_s: f64, volts: f64) -> serde_json::Value {
    (0..30).map(|row| json!([start_s + 0.01 * f64::from(row), volts, 0.1, volts / 2.0])).collect()
}

#[test]
fn tests_of_sysid_that_are_not_whole() {
    let mut file = json!({ "sysid": true, "test": "Simple", "units": "Rotations" });
    for (index, name) in ["slow-forward", "slow-backward", "fast-forward"].into_iter().enumerate() {
        file[name] = sysid_test(10.0 * index as f64, [1.0, -1.0, 5.0][index]);
    }
    file["slow-backward"][3][3] = json!("NOT");
    let text = file.to_string().replace("\"NOT\"", "NaN");
    // A test that is not there, and one that is empty, are the same.
    for text in [text.clone(), text.replacen('{', "{\"fast-backward\":[],", 1)] {
        let found = read_as(Format::Sysid, text.as_bytes(), &[]).unwrap();
        assert_eq!((found.len(), values(&found, Channel::Voltage)[89]), (90, 5.0));
        assert!(values(&found, Channel::Speed)[33].is_nan());
        assert_eq!(
            found.notes,
            ["Of the four tests fast-backward is missing or empty. With all four the constants are surer."]
        );
    }
    assert!(read_as(Format::Sysid, b"{\"sysid\":true}", &[]).unwrap_err().contains("all tests are missing or empty"));
    // A drivetrain asks which side.
    let sides: serde_json::Value =
        (0..30).map(|row| json!([0.01 * f64::from(row), 1.0, 2.0, 0.1, 0.2, 0.5, 1.5, 0.0, 0.0])).collect();
    let file = json!({ "sysid": true, "test": "Drivetrain", "slow-forward": sides }).to_string();
    let why = read_as(Format::Sysid, file.as_bytes(), &[]).unwrap_err();
    assert!(why.contains("left/u_V, right/u_V. Choose, for instance --column left/u_V=u_V --column left/theta_rad=theta_rad --column left/omega_rad_per_s=omega_rad_per_s"), "{why}");
    let right = ["right/u_V=u_V", "right/omega_rad_per_s=omega_rad_per_s", "right/theta_rad=theta_rad"];
    let found = read_as(Format::Sysid, file.as_bytes(), &right).unwrap();
    assert_eq!(values(&found, Channel::Voltage)[0], 2.0);
    assert!((values(&found, Channel::Speed)[0] - 1.5 * std::f64::consts::TAU).abs() < 1e-12);
}

/// A log with a record for each change.
pub fn log(entries: &[(&str, &str)], records: &[(u32, u64, Vec<u8>)]) -> Vec<u8> {
    let mut log = b"WPILOG\0\x01\0\0\0\0".to_vec();
    let mut record = |entry: u32, stamp_us: u64, payload: &[u8]| {
        log.push(0x7f);
        log.extend(entry.to_le_bytes());
        log.extend((payload.len() as u32).to_le_bytes());
        log.extend(stamp_us.to_le_bytes());
        log.extend(payload);
    };
    for (index, (name, kind)) in entries.iter().enumerate() {
        let mut start = [&[0][..], &(index as u32 + 1).to_le_bytes()].concat();
        for text in [*name, *kind, ""] {
            start.extend((text.len() as u32).to_le_bytes());
            start.extend(text.as_bytes());
        }
        record(0, 0, &start);
    }
    records.iter().for_each(|(entry, stamp_us, payload)| record(*entry, *stamp_us, payload));
    log
}

#[test]
fn logs_that_are_written_on_change() {
    let mut records = Vec::new();
    for step in 0..200_u32 {
        // The ramp changes at each step, the speed at every second one.
        records.push((1, u64::from(step) * 10_000, (f64::from(step) * 0.02).to_le_bytes().to_vec()));
        if step % 2 == 0 {
            records.push((2, u64::from(step) * 10_000 + 200, (step as f32).to_le_bytes().to_vec()));
            records.push((
                3,
                u64::from(step) * 10_000,
                [f64::from(step), 0.5].iter().flat_map(|x| x.to_le_bytes()).collect(),
            ));
        }
    }
    let entries = [("NT:/volts", "double"), ("NT:/omega", "float"), ("NT:/pair", "double[]"), ("NT:/mode", "string")];
    let bytes = log(&entries, &records);
    let names = ["volts=u_V", "omega=omega_rad_per_s", "pair/2=i_A"];
    let found = read_as(Format::Wpilog, &bytes, &names).unwrap();
    assert_eq!((found.len(), values(&found, Channel::Speed)[99]), (100, 198.0));
    assert!((values(&found, Channel::Voltage)[99] - 3.96).abs() < 1e-12);
    assert!(values(&found, Channel::Current).iter().all(|value| *value == 0.5));
    assert!(
        found.notes.iter().any(|note| note.starts_with("100 of 200 values of NT:/volts lie between")),
        "{:?}",
        found.notes
    );
    assert!(found.ignored.contains(&"NT:/mode".to_owned()), "{:?}", found.ignored);
    let why = read_as(Format::Wpilog, &bytes, &[]).unwrap_err();
    assert!(why.contains("Likely: --column NT:/omega=omega_rad_per_s --column NT:/volts=u_V"), "{why}");
}
