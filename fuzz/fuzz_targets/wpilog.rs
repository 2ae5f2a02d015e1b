//! Random bytes for the reader of this format.
#![no_main]

use libfuzzer_sys::fuzz_target;
use motorbench_data::convert::Format;
use motorbench_fuzz::read_in_every_way;

fuzz_target!(|bytes: &[u8]| read_in_every_way(bytes, Format::Wpilog));
