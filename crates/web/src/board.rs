//! A board on a serial line: its settings, its telemetry, its recordings. The page moves the bytes.

use crate::{Message, json, said};
use motorbench_core::HARDWARE;
use motorbench_core::console::explanation;
use motorbench_core::message::{Mode, Sample, State, Trip};
use motorbench_core::protocol::{Frame, StreamDecoder};
use motorbench_core::settings::{Param, Settings, Text, find, help, text};
use motorbench_core::units::{AMPERE, VOLT};
use motorbench_data::coverage::{Coverage, Covered};
use motorbench_data::names::{setting_name, trip_cause, trip_limit, trip_words};
use motorbench_data::rig::{NominalMotor, Rig};
use motorbench_data::telemetry::{self, LOST_AFTER_MS, reference_bit, speed_bit_rad_per_s};
use serde::Serialize;
use std::f64::consts::TAU;
use wasm_bindgen::prelude::*;

/// Numbers of a sample for the page.
const COLUMNS: usize = 10;

/// A setting.
#[derive(Serialize)]
struct Setting {
    name: String,
    unit: String,
    help: &'static str,
    min: f32,
    max: f32,
    default: f32,
}

/// All settings, in the board's order.
#[wasm_bindgen]
pub fn settings() -> Result<String, Message> {
    let defaults = Settings::defaults();
    let of = |param: &Param| Setting {
        name: setting_name(*param),
        unit: text(*param, Text::Unit).map(char::from).collect(),
        help: help(*param),
        min: param.range().0,
        max: param.range().1,
        default: defaults.get(*param),
    };
    json(&Param::ALL.iter().map(of).collect::<Vec<_>>())
}

/// A trip: what the board calls it, what to do, and the setting that limits it.
#[derive(Serialize)]
struct TripHelp {
    number: u8,
    words: String,
    cure: &'static str,
    setting: Option<&'static str>,
}

/// All trips, by their number.
#[wasm_bindgen]
pub fn trips() -> Result<String, Message> {
    let of = |trip: Trip| TripHelp {
        number: trip as u8,
        words: trip_words(trip),
        cure: trip_cause(trip),
        setting: trip_limit(trip),
    };
    json(&(0..).map_while(Trip::from_number).map(of).collect::<Vec<_>>())
}

/// What a command of the console does; none for another word.
#[wasm_bindgen]
#[must_use]
pub fn console_help(word: &str) -> Option<String> {
    explanation(word).map(str::to_owned)
}

/// The value of `trip_host` that a program sets before it arms, in milliseconds.
#[wasm_bindgen]
#[must_use]
pub fn lost_after_ms() -> f32 {
    LOST_AFTER_MS
}

/// The settings of a recording that shall identify the motor, as NAME VALUE pairs of one `set` line.
#[wasm_bindgen]
#[must_use]
pub fn identification_settings() -> Vec<String> {
    telemetry::IDENTIFICATION_SETTINGS
        .iter()
        .map(|(param, value)| format!("{} {value}", setting_name(*param)))
        .collect()
}

/// The board's side of the line: bytes in, samples and text out.
#[wasm_bindgen]
pub struct Receiver {
    decoder: StreamDecoder,
    is_binary: bool,
    text: Vec<u8>,
    settings: Settings,
    came: Vec<f64>,
    last: Sample,
    recorded: Option<Vec<Sample>>,
    coverage: Coverage,
}

impl Default for Receiver {
    fn default() -> Self {
        let settings = Settings::defaults();
        Self {
            decoder: StreamDecoder::default(),
            is_binary: false,
            text: Vec::new(),
            coverage: Coverage::new(&settings),
            settings,
            came: Vec::new(),
            last: Sample::default(),
            recorded: None,
        }
    }
}

#[wasm_bindgen]
impl Receiver {
    /// Of a board that sends text.
    #[wasm_bindgen(constructor)]
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Whether frames come from now on, or text.
    pub fn set_binary(&mut self, is_binary: bool) {
        self.is_binary = is_binary;
        self.decoder = StreamDecoder::default();
    }

    /// Takes the value that the board shows of a setting. Samples are converted with it.
    pub fn set_setting(&mut self, name: &str, value: f32) -> Result<(), Message> {
        let param = find(name.as_bytes()).ok_or_else(|| {
            format!("{name}: the board has a setting that this page does not know. Flash the firmware of this page")
        })?;
        self.settings.set(param, value).map_err(|rule| format!("{name} {value}: {rule:?}"))
    }

    /// Takes bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        if !self.is_binary {
            self.text.extend_from_slice(bytes);
            return;
        }
        for byte in bytes {
            match self.decoder.push(*byte) {
                Some(Frame::Sample(sample)) => self.take(&sample),
                Some(Frame::Text(text, length)) => self.text.extend_from_slice(&text[..length]),
                None => {}
            }
        }
    }

    fn take(&mut self, sample: &Sample) {
        self.last = *sample;
        self.came.extend(self.in_si(sample));
        if let Some(recorded) = &mut self.recorded
            && sample.state.has(State::PLAYING)
        {
            recorded.push(*sample);
            self.coverage.add(std::slice::from_ref(sample));
        }
    }

    /// Time, reference, angle, speed, current, duty, voltage, supply, state, trip.
    fn in_si(&self, sample: &Sample) -> [f64; COLUMNS] {
        let get = |param| f64::from(self.settings.get(param));
        let (duty, supply_v) =
            (f64::from(sample.duty) / f64::from(HARDWARE.pwm_steps), f64::from(sample.supply) / f64::from(VOLT));
        let mode = sample.state.mode();
        [
            f64::from(sample.tick) / get(Param::TickRate),
            if mode == Mode::Off {
                f64::NAN
            } else {
                f64::from(sample.reference) * reference_bit(mode, &self.settings)
            },
            f64::from(sample.counts) * TAU / get(Param::CountsPerRev),
            f64::from(sample.speed) * speed_bit_rad_per_s(&self.settings),
            f64::from(sample.current) / f64::from(AMPERE),
            duty,
            duty * supply_v,
            supply_v,
            f64::from(sample.state.0),
            f64::from(sample.trip as u8),
        ]
    }

    /// The samples since the last call: ten numbers each. Time, reference, angle, speed, current, duty, voltage, supply in
    /// SI units, state and trip as numbers.
    pub fn samples(&mut self) -> Vec<f64> {
        std::mem::take(&mut self.came)
    }

    /// The text since the last call. Damaged characters are replaced.
    pub fn text(&mut self) -> String {
        String::from_utf8_lossy(&std::mem::take(&mut self.text)).replace('\r', "")
    }

    /// Frames that never came, and of them those that came damaged.
    #[must_use]
    pub fn losses(&self) -> Vec<u32> {
        vec![self.decoder.lost.max(self.decoder.damaged), self.decoder.damaged]
    }

    /// Keeps the samples of the next sequence.
    pub fn record(&mut self) {
        self.recorded = Some(Vec::new());
        self.coverage = Coverage::new(&self.settings);
    }

    /// Number of samples kept.
    #[must_use]
    pub fn recorded(&self) -> usize {
        self.recorded.as_ref().map_or(0, Vec::len)
    }

    /// What the recording covers so far.
    pub fn covered(&self) -> Result<String, Message> {
        #[derive(Serialize)]
        struct Told {
            #[serde(flatten)]
            covered: Covered,
            words: String,
        }
        let covered = self.coverage.covered();
        json(&Told { words: covered.to_string(), covered })
    }

    /// The recording as a CSV file.
    #[must_use]
    pub fn recording_csv(&self, name: &str) -> String {
        telemetry::recording(name, self.recorded.as_deref().unwrap_or_default(), &self.settings).to_csv()
    }

    /// Its rig file. `nominal_rig`: a rig file with nominal constants of the motor, or an empty text. `is_virtual`: the
    /// board is simulated.
    pub fn rig(&self, nominal_rig: &str, is_virtual: bool) -> Result<String, Message> {
        let nominal = match nominal_rig {
            "" => NominalMotor::default(),
            text => Rig::parse("rig file", text).map_err(said)?.motor,
        };
        let of_board: fn(&Settings, NominalMotor) -> Rig =
            if is_virtual { telemetry::rig_of_core } else { telemetry::rig };
        toml::to_string(&of_board(&self.settings, nominal)).map_err(said)
    }
}
