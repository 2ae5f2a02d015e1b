//! Random bytes for the reader of this format: a recording or an error, never a panic.
#![no_main]

use libfuzzer_sys::fuzz_target;
use motorbench_data::convert::{Dialect, Format, read};

fuzz_target!(|bytes: &[u8]| {
    let columns = ["1=t_s*0.001", "2=u_V"].map(|column| column.parse().expect("a valid mapping"));
    let _ = read("fuzz", bytes, Format::Sysid, &[], Dialect::default());
    let _ = read("fuzz", bytes, Format::Sysid, &columns, Dialect::default());
});
