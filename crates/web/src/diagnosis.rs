//! A diagnosis of recordings.

use crate::{Message, recording, said};
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_diagnosis::dataset::contradictions;
use motorbench_diagnosis::diagnose::Diagnosis;
use motorbench_diagnosis::steady_state::Study;
use motorbench_diagnosis::{diagnose, steady_state};
use motorbench_report::web_page::Provenance;
use motorbench_report::{diagnosis_page, diagnosis_text, steady_state as table_report};
use std::cell::RefCell;
use wasm_bindgen::prelude::*;

thread_local! {
    /// Hears what is being tried.
    static LISTENER: RefCell<Option<js_sys::Function>> = const { RefCell::new(None) };
}

fn tell(what: &str) {
    LISTENER.with_borrow(|listener| {
        if let Some(listener) = listener {
            // Who does not listen any more misses nothing else.
            let _ = listener.call1(&JsValue::NULL, &JsValue::from_str(what));
        }
    });
}

/// Recordings of one rig.
#[wasm_bindgen]
#[derive(Default)]
pub struct Recordings {
    recordings: Vec<Recording>,
    rig: Rig,
    rig_name: Option<String>,
}

#[wasm_bindgen]
impl Recordings {
    /// None yet, of a rig of which nothing is known.
    #[wasm_bindgen(constructor)]
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a file. `columns` are those of the program's option `--column`.
    pub fn add(&mut self, name: &str, bytes: &[u8], columns: Vec<String>) -> Result<(), Message> {
        self.recordings.push(recording::read(name, bytes, &columns)?);
        Ok(())
    }

    /// The rig file.
    pub fn set_rig(&mut self, name: &str, text: &str) -> Result<(), Message> {
        self.rig = Rig::parse(name, text).map_err(said)?;
        self.rig_name = Some(name.into());
        Ok(())
    }

    /// Where recordings and rig file contradict each other.
    #[must_use]
    pub fn contradictions(&self) -> Vec<String> {
        let of = |recording| contradictions(recording, &self.rig);
        self.recordings.iter().flat_map(of).map(|contradiction| contradiction.note()).collect()
    }

    /// Diagnoses them. `progress` hears what is being tried.
    pub fn diagnose(&self, progress: Option<js_sys::Function>) -> Result<Diagnosed, Message> {
        let found = match &self.recordings[..] {
            [table] if table.time_s().is_none() => {
                Found::Table(Box::new(steady_state::study(table, &self.rig, None).map_err(said)?))
            }
            recordings => {
                LISTENER.set(progress);
                let found = diagnose::diagnose(recordings, &self.rig, &tell).map_err(said);
                LISTENER.set(None);
                Found::Recording(Box::new(found?))
            }
        };
        let files = self.recordings.iter().map(|recording| recording.name.clone()).collect();
        let inputs = self.rig_name.iter().map(|name| ("Rig file", name.clone())).collect();
        Ok(Diagnosed { found, from: Provenance { files, inputs, ..Provenance::default() } })
    }
}

/// What was found.
enum Found {
    Recording(Box<Diagnosis>),
    Table(Box<Study>),
}

/// The result of a diagnosis.
#[wasm_bindgen]
pub struct Diagnosed {
    found: Found,
    from: Provenance,
}

#[wasm_bindgen]
impl Diagnosed {
    /// The same JSON as of the program's option `--json`.
    pub fn outcome(&self) -> Result<String, Message> {
        let text = match &self.found {
            Found::Recording(diagnosis) => serde_json::to_string_pretty(&diagnosis.outcome),
            Found::Table(study) => serde_json::to_string_pretty(study),
        };
        Ok(text.map_err(said)? + "\n")
    }

    /// The page of the program's option `--report`. `written` says when, for its foot.
    #[must_use]
    pub fn report(&self, written: &str) -> String {
        let from = Provenance { written: Some(written.into()), ..self.from.clone() };
        match &self.found {
            Found::Recording(diagnosis) => diagnosis_page::report(diagnosis, from),
            Found::Table(study) => table_report::html(study, from),
        }
    }

    /// What the program prints.
    #[must_use]
    pub fn text(&self) -> String {
        match &self.found {
            Found::Recording(diagnosis) => diagnosis_text::page(diagnosis),
            Found::Table(study) => table_report::page(study),
        }
    }

    /// The result in a sentence.
    #[must_use]
    pub fn verdict(&self) -> String {
        match &self.found {
            Found::Recording(diagnosis) => diagnosis_text::verdict(&diagnosis.outcome),
            Found::Table(study) => diagnosis_text::verdict(&study.outcome),
        }
    }

    /// The extended model as a file; none for a table of steady states, which shows neither inertia nor inductance.
    #[must_use]
    pub fn model(&self) -> Option<String> {
        match &self.found {
            Found::Recording(diagnosis) => Some(diagnosis.model.to_toml()),
            Found::Table(_) => None,
        }
    }
}
