//! Random text for the files of motorbench's own: rig, model, scenario.
#![no_main]

use host_sim::scenario::{Scenario, ScenarioError};
use libfuzzer_sys::fuzz_target;
use motorbench_data::rig::Rig;
use motorbench_model::Model;
use std::io::{Error, ErrorKind};
use std::path::Path;

fuzz_target!(|text: &str| {
    let _ = Rig::parse("fuzz", text);
    let _ = Model::parse_with_axis(text);
    let no_other_file =
        |_: &Path| Err(ScenarioError::Read { path: "fuzz".into(), source: Error::from(ErrorKind::NotFound) });
    let _ = Scenario::parse(Path::new("fuzz"), text, None, no_other_file);
});
