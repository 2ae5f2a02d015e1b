//! Random bytes behind the mark of HDF5 for the reader of MATLAB 7.3; other bytes are those of the target `mat`.
#![no_main]

use libfuzzer_sys::fuzz_target;
use motorbench_data::convert::Format;
use motorbench_fuzz::read_in_every_way;

const MARK: &[u8] = b"\x89HDF\r\n\x1a\n";

fuzz_target!(|bytes: &[u8]| {
    if bytes.starts_with(MARK) {
        read_in_every_way(bytes, Format::Mat);
    }
});
