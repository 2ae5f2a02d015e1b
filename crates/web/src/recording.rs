//! A file: its columns, and the recording that they are.

use crate::{Message, json, said};
use host_sim::scenario::{Scenario, ScenarioError};
use motorbench_data::convert::Format;
use motorbench_data::mapping::Mapping;
use motorbench_data::preview;
use motorbench_data::recording::{Channel, Recording};
use motorbench_data::rig::Rig;
use serde::Serialize;
use std::path::Path;
use wasm_bindgen::prelude::*;

/// The bench of the tutorial, and its data sheets.
const EXAMPLE_BENCH: &str = include_str!("../../../examples/recording/bench.toml");
const EXAMPLE_RIG: &str = include_str!("../../../examples/recording/rig.toml");
/// Values of each channel that are shown.
const SHOWN: usize = 2000;

/// The file's columns, with what each likely is.
#[wasm_bindgen]
pub fn preview_file(name: &str, bytes: &[u8]) -> Result<String, Message> {
    json(&preview::preview(name, bytes, Format::of_content(Path::new(name), bytes)).map_err(said)?)
}

/// The channels that a column can be: name, and title with unit.
#[wasm_bindgen]
pub fn channels() -> Result<String, Message> {
    json(&Channel::ALL.map(|channel| (channel.column(), channel.title())))
}

/// Reads a file as the program does; `columns` are those of its option `--column`.
pub(crate) fn read(name: &str, bytes: &[u8], columns: &[String]) -> Result<Recording, Message> {
    let mappings: Vec<Mapping> = columns.iter().map(|column| column.parse()).collect::<Result<_, _>>()?;
    let recording =
        Recording::of_bytes(name, bytes, Format::of_content(Path::new(name), bytes), &mappings).map_err(said)?;
    recording.advice_on_time().map_or(Ok(recording), Err)
}

/// What a recording holds, for a person.
#[derive(Serialize)]
struct Summary<'a> {
    rows: usize,
    is_table: bool,
    channels: Vec<Shown>,
    ignored: &'a [String],
    notes: &'a [String],
    suggestion: &'a str,
}

/// A channel with some of its values.
#[derive(Serialize)]
struct Shown {
    column: &'static str,
    title: &'static str,
    values: Vec<Option<f64>>,
}

/// Reads a file and tells what it holds.
#[wasm_bindgen]
pub fn read_recording(name: &str, bytes: &[u8], columns: Vec<String>) -> Result<String, Message> {
    let recording = read(name, bytes, &columns)?;
    let step = recording.len().div_ceil(SHOWN).max(1);
    let shown = |channel: Channel| Shown {
        column: channel.column(),
        title: channel.title(),
        values: recording.get(channel).unwrap_or_default().iter().step_by(step).map(finite).collect(),
    };
    json(&Summary {
        rows: recording.len(),
        is_table: recording.time_s().is_none(),
        channels: recording.channels().map(shown).collect(),
        ignored: &recording.ignored,
        notes: &recording.notes,
        suggestion: &recording.suggestion,
    })
}

fn finite(value: &f64) -> Option<f64> {
    value.is_finite().then_some(*value)
}

/// Checks the text of a rig file; returns it as JSON.
#[wasm_bindgen]
pub fn check_rig(name: &str, text: &str) -> Result<String, Message> {
    json(&Rig::parse(name, text).map_err(said)?)
}

/// A recording for a first look: the bench of the tutorial, simulated.
#[wasm_bindgen]
pub fn example_recording() -> Result<String, Message> {
    let no_model = |_: &Path| -> Result<String, ScenarioError> { unreachable!("this scenario names no other file") };
    let scenario = Scenario::parse(Path::new("bench.toml"), EXAMPLE_BENCH, None, no_model).map_err(said)?;
    Ok(scenario.run().map_err(said)?.recording.to_csv())
}

/// What the data sheets say of its bench.
#[wasm_bindgen]
#[must_use]
pub fn example_rig() -> String {
    EXAMPLE_RIG.into()
}
