//! Random bytes for the reader of this format: as an archive, and as arrays in one.
#![no_main]

use libfuzzer_sys::fuzz_target;
use motorbench_data::convert::Format;
use motorbench_fuzz::{archive, read_in_every_way};

fuzz_target!(|bytes: &[u8]| {
    if bytes.starts_with(b"PK") {
        read_in_every_way(bytes, Format::Npz);
    } else {
        read_in_every_way(&archive(&[("t_s.npy", bytes), ("log.npy", bytes)]), Format::Npz);
    }
});
