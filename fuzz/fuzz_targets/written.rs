//! Random tables that are written in other formats and read again.
#![no_main]

use libfuzzer_sys::fuzz_target;
use motorbench_fuzz::write_and_read_again;

fuzz_target!(|bytes: &[u8]| write_and_read_again(bytes));
