//! Random text for the mapping of columns.
#![no_main]

use libfuzzer_sys::fuzz_target;
use motorbench_data::mapping::Mapping;

fuzz_target!(|text: &str| {
    let _ = text.parse::<Mapping>();
});
