//! Random text for the mapping of columns, the rig file and the text of a console's stream.
#![no_main]

use libfuzzer_sys::fuzz_target;
use motorbench_data::mapping::Mapping;
use motorbench_data::rig::Rig;

fuzz_target!(|text: &str| {
    let _ = text.parse::<Mapping>();
    let _ = Rig::parse("fuzz", text);
});
