//! What the targets do with their bytes.

use motorbench_data::convert::{Dialect, Format, read, write};
use motorbench_data::mapping::Mapping;
use motorbench_data::preview::preview;
use motorbench_data::recording::{Channel, Recording};
use std::io::{Cursor, Write as _};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Mappings that lead to different code: none, with a time, measured series, values computed from two columns.
const MAPPINGS: [&[&str]; 4] = [
    &[],
    &["1=t_s*0.001", "2=u_V"],
    &["1=omega_rad_per_s*6.28", "2=u_V", "3=i_A/0.185-13.5"],
    &["row=t_s*0.01", "1*sign(2)=duty/255", "quadrature(1,2)=counts"],
];

/// Reads the bytes of a file in every way in which the program does: a recording or an error, never a panic.
pub fn read_in_every_way(bytes: &[u8], format: Format) {
    for names in MAPPINGS {
        let mappings: Vec<Mapping> = names.iter().map(|name| name.parse().expect("a valid mapping")).collect();
        let _ = read("fuzz", bytes, format, &mappings, Dialect::default());
    }
    let _ = preview("fuzz", bytes, format);
}

/// Writes what can be read of a table in the formats that keep every bit, and reads it again.
///
/// # Panics
/// If something is lost.
pub fn write_and_read_again(bytes: &[u8]) {
    let Ok(table) = read("fuzz", bytes, Format::Csv, &[], Dialect::default()) else { return };
    let german = Dialect { delimiter: Some(b';'), decimal_comma: true };
    let usual = Dialect::default();
    let ways = [
        (Format::Csv, usual),
        (Format::Csv, german),
        (Format::Mat, usual),
        (Format::Npy, usual),
        (Format::Npz, usual),
    ];
    for (format, dialect) in ways {
        let written = write(&table.recording, format, &[], dialect).expect("a recording can be written");
        let again = read("again", &written, format, &[], dialect).unwrap_or_else(|error| panic!("{format:?}: {error}"));
        assert_same(&table.recording, &again.recording, format);
    }
}

fn assert_same(before: &Recording, after: &Recording, format: Format) {
    let channels = |recording: &Recording| recording.channels().collect::<Vec<Channel>>();
    assert_eq!(channels(before), channels(after), "{format:?}");
    for channel in before.channels() {
        let values = |recording: &Recording| recording.get(channel).expect("it is there").to_vec();
        let (before, after) = (values(before), values(after));
        assert_eq!(before.len(), after.len(), "{format:?}: {}", channel.column());
        for (row, (a, b)) in before.iter().zip(&after).enumerate() {
            let is_same = a == b || a.is_nan() && b.is_nan();
            assert!(is_same, "{format:?}: {} of row {row} was {a:e} and is {b:e}", channel.column());
        }
    }
}

/// An archive of these parts. Random bytes have no right checksums, so a target makes the archive around them.
///
/// # Panics
/// Never: nothing here can fail.
pub fn archive(parts: &[(&str, &[u8])]) -> Vec<u8> {
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in parts {
        archive.start_file(*name, options).expect("a new part");
        archive.write_all(bytes).expect("written to memory");
    }
    archive.finish().expect("written to memory").into_inner()
}
