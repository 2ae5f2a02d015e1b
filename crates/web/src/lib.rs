//! The libraries for a page in a browser. This crate only turns bytes and JSON into calls of them, and results into JSON:
//! no rule about motors stands here.
//!
//! A failed call throws its message. The page runs what takes time in workers.

mod board;
mod design;
mod diagnosis;
mod recording;
mod virtual_board;

use serde::Serialize;
use wasm_bindgen::prelude::*;

/// The message of a failed call.
type Message = String;

fn json(value: &impl Serialize) -> Result<String, Message> {
    serde_json::to_string(value).map_err(said)
}

fn said(error: impl std::fmt::Display) -> Message {
    error.to_string()
}

#[wasm_bindgen]
extern "C" {
    #[wasm_bindgen(js_namespace = console, js_name = error)]
    fn console_error(text: &str);
}

/// Shows where a fault of the libraries is.
#[wasm_bindgen(start)]
pub fn start() {
    std::panic::set_hook(Box::new(|panic| console_error(&panic.to_string())));
}

/// Version of the libraries: firmware and page go together within one version.
#[wasm_bindgen]
#[must_use]
pub fn version() -> String {
    env!("CARGO_PKG_VERSION").into()
}
