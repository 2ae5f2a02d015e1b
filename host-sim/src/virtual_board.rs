//! A board without hardware: the console and the control core on a simulated motor. The same bytes go in and come out as
//! on the serial line of a real one.
//!
//! A line of bytes takes no time here. So no sample is late, and a long reply holds none up.

use crate::plant::{ModelPlant, Plant};
use crate::trial::{Surroundings, Trial};
use motorbench_core::console::{Console, Counters, Machine, ResetCause};
use motorbench_core::message::{Request, Sample};
use motorbench_core::settings::{BuildError, Settings};
use motorbench_core::storage::Eeprom;
use motorbench_model::Model;
use motorbench_model::catalogue::effect;
use std::collections::VecDeque;

/// Size of the memory of the settings, and what stands in it before the first save.
const MEMORY_BYTES: usize = 1024;
const ERASED: u8 = 0xff;
/// Longest that the zero of the current takes, in ticks.
const ZEROING_TICKS: u32 = 4000;

/// A board with a motor. See the module.
pub struct VirtualBoard {
    console: Console,
    machine: Simulated,
    /// The motor without the brake.
    model: Model,
    brake_nm: f64,
}

/// What the console talks to.
struct Simulated {
    trial: Trial<ModelPlant>,
    memory: Memory,
    sent: Vec<u8>,
    /// Samples that the console has not seen.
    samples: VecDeque<Sample>,
    /// Ticks that passed while a line was carried out.
    ahead: u32,
    reset_cause: ResetCause,
}

/// Keeps the settings while the page is open.
struct Memory([u8; MEMORY_BYTES]);

impl Eeprom for Memory {
    fn read(&mut self, address: u16) -> u8 {
        self.0[usize::from(address) % MEMORY_BYTES]
    }

    fn ready(&mut self) -> bool {
        true
    }

    fn write(&mut self, address: u16, byte: u8) {
        self.0[usize::from(address) % MEMORY_BYTES] = byte;
    }
}

impl Simulated {
    fn tick(&mut self, request: Option<Request>) {
        self.trial.tick(request);
        self.samples.push_back(*self.trial.sample());
    }

    fn tick_ahead(&mut self, request: Option<Request>) {
        self.tick(request);
        self.ahead += 1;
    }
}

impl Machine for Simulated {
    type Memory = Memory;

    fn request(&mut self, request: Request) {
        self.tick_ahead(Some(request));
    }

    fn look(&mut self, sample: &mut Sample, counters: &mut Counters) {
        self.tick_ahead(None);
        let control = self.trial.control();
        *sample = *control.sample();
        counters.illegal_transitions = control.illegal_transitions();
        counters.since_trip = control.since_trip();
        (counters.zeroing, counters.zero_ok) = control.current_zero();
        counters.reset_cause = self.reset_cause;
    }

    fn configure(&mut self, settings: &Settings) -> Result<(), BuildError> {
        self.trial.configure(settings)
    }

    fn memory(&mut self) -> &mut Memory {
        &mut self.memory
    }

    fn send(&mut self, byte: u8) {
        self.sent.push(byte);
    }

    fn host_spoke(&mut self) {
        self.trial.host_speaks();
    }

    fn listen(&mut self) {}
}

impl VirtualBoard {
    /// A board that has just got its power, with this motor.
    ///
    /// # Errors
    /// A setting the core cannot hold.
    pub fn new(model: Model) -> Result<Self, BuildError> {
        let machine = Simulated {
            trial: Trial::of_model(&model, Settings::defaults())?,
            memory: Memory([ERASED; MEMORY_BYTES]),
            sent: Vec::new(),
            samples: VecDeque::new(),
            ahead: 0,
            reset_cause: ResetCause::PowerOn,
        };
        let mut board = Self { console: Console::default(), machine, model, brake_nm: 0.0 };
        board.start()?;
        Ok(board)
    }

    /// As after power on: the zero of the current is measured, then the board greets.
    fn start(&mut self) -> Result<(), BuildError> {
        self.console.start(&mut self.machine)?;
        self.machine.request(Request::ZeroCurrent);
        for _ in 0..ZEROING_TICKS {
            if !self.machine.trial.control().current_zero().0 {
                break;
            }
            self.machine.tick_ahead(None);
        }
        self.console.greet(&mut self.machine);
        // The start takes no time of the host's.
        self.machine.samples.clear();
        self.machine.ahead = 0;
        Ok(())
    }

    /// The reset that a real board does when its port is opened. Saved settings stay, and so do load and faults.
    ///
    /// # Errors
    /// A setting the core cannot hold.
    pub fn reset(&mut self) -> Result<(), BuildError> {
        let surroundings = self.machine.trial.surroundings;
        self.machine.trial = Trial::of_model(&self.braked(), Settings::defaults())?;
        self.machine.trial.surroundings = surroundings;
        self.machine.reset_cause = ResetCause::External;
        self.machine.samples.clear();
        self.machine.sent.clear();
        self.console = Console::default();
        self.start()
    }

    /// Takes bytes from the host.
    pub fn receive(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.console.receive(*byte, &mut self.machine);
            self.stream();
        }
    }

    /// Lets so many ticks pass, and returns the bytes for the host.
    pub fn advance(&mut self, ticks: u32) -> Vec<u8> {
        let passed = ticks.min(self.machine.ahead);
        self.machine.ahead -= passed;
        for _ in passed..ticks {
            self.machine.tick(None);
            self.stream();
        }
        std::mem::take(&mut self.machine.sent)
    }

    /// The console sees every sample, and goes on with a save.
    fn stream(&mut self) {
        while let Some(sample) = self.machine.samples.pop_front() {
            self.console.telemetry(&sample, &mut self.machine);
        }
        self.console.poll(&mut self.machine);
    }

    /// Ticks in a second.
    pub fn tick_rate_hz(&self) -> f64 {
        1.0 / self.machine.trial.period_s()
    }

    /// Load, supply and faults.
    pub fn surroundings(&mut self) -> &mut Surroundings {
        &mut self.machine.trial.surroundings
    }

    /// The motor without the brake.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Another motor at the same speed, or the same one with other constants.
    pub fn set_model(&mut self, model: Model) {
        self.model = model;
        let plant = &mut self.machine.trial.plant;
        plant.replace(crate::plant::BridgeLosses::DIODES, braked(&self.model, self.brake_nm));
    }

    /// A brake at the shaft: friction of the same torque both ways.
    pub fn brake(&mut self, torque_nm: f64) {
        self.brake_nm = torque_nm.max(0.0);
        self.set_model(self.model.clone());
    }

    /// True speed of the shaft.
    pub fn speed_rad_per_s(&self) -> f64 {
        self.machine.trial.plant.speed_rad_per_s()
    }

    fn braked(&self) -> Model {
        braked(&self.model, self.brake_nm)
    }
}

/// A motor with a brake at its shaft.
fn braked(model: &Model, brake_nm: f64) -> Model {
    let friction = effect("coulomb_friction").expect("an effect of the catalogue");
    let mut model = model.clone();
    match model.terms.iter_mut().find(|term| term.id() == friction.about().id) {
        Some(term) => term.values[0] += brake_nm,
        None if brake_nm > 0.0 => return model.with(friction, vec![brake_nm]),
        None => {}
    }
    model
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_core::message::{State, Trip};
    use motorbench_core::protocol::{Frame, StreamDecoder};
    use motorbench_model::motor::MotorParameters;

    fn board() -> VirtualBoard {
        let motor = MotorParameters { inertia_kg_m2: 2e-5, ..MotorParameters::PIVT6 };
        VirtualBoard::new(Model::linear(motor)).unwrap()
    }

    fn text(bytes: Vec<u8>) -> String {
        String::from_utf8(bytes).unwrap().replace('\r', "")
    }

    fn said(board: &mut VirtualBoard, line: &str) -> String {
        board.receive(format!("{line}\n").as_bytes());
        text(board.advance(0))
    }

    fn frames(bytes: &[u8]) -> (Vec<Sample>, StreamDecoder) {
        let mut decoder = StreamDecoder::default();
        let frames: Vec<Frame> = bytes.iter().filter_map(|byte| decoder.push(*byte)).collect();
        let samples = frames.iter().filter_map(|frame| match frame {
            Frame::Sample(sample) => Some(*sample),
            Frame::Text(..) => None,
        });
        (samples.collect(), decoder)
    }

    #[test]
    fn it_greets_answers_and_refuses_as_a_board_does() {
        let mut board = board();
        let greeting = text(board.advance(0));
        assert!(greeting.starts_with("# motorbench ") && greeting.contains("# reset: power on\n"), "{greeting}");
        assert_eq!(said(&mut board, "echo off"), "echo off\nok\n");
        assert!(said(&mut board, "show speed_kp").starts_with("# speed_kp "));
        assert!(said(&mut board, "ref 9999").starts_with("error: "));
    }

    #[test]
    fn every_sample_comes_once_and_the_motor_turns() {
        let mut board = board();
        for line in ["echo off", "stream binary", "arm", "mode open", "ref 6"] {
            board.receive(format!("{line}\n").as_bytes());
        }
        let mut bytes = board.advance(0);
        for _ in 0..50 {
            bytes.extend(board.advance(20));
        }
        let (samples, decoder) = frames(&bytes);
        assert!(
            samples.windows(2).all(|pair| pair[1].tick == pair[0].tick + 1) && samples.len() >= 990,
            "{}",
            samples.len()
        );
        assert_eq!((decoder.lost, samples.last().unwrap().trip), (0, Trip::None));
        assert!(board.speed_rad_per_s() > 50.0 && samples.last().unwrap().state.has(State::ENABLED));
    }

    /// A page that is closed says nothing more.
    #[test]
    fn a_silent_host_stops_the_motor() {
        let mut board = board();
        for line in ["echo off", "set trip_host 501", "stream binary", "arm", "mode open", "ref 6"] {
            board.receive(format!("{line}\n").as_bytes());
        }
        for _ in 0..20 {
            board.receive(b"alive\n");
            board.advance(100);
        }
        assert_eq!(board.machine.trial.sample().trip, Trip::None);
        let (samples, _) = frames(&board.advance(520));
        let tripped = samples.iter().position(|sample| sample.trip == Trip::HostLost).unwrap();
        // A tenth of a second had passed since the last word.
        assert!((390..=410).contains(&tripped), "{tripped}");
    }

    #[test]
    fn load_brake_block_and_unplugged_encoder_act() {
        let mut board = board();
        for line in ["echo off", "set trip_stall 0", "arm", "mode open", "ref 6"] {
            said(&mut board, line);
        }
        board.advance(1000);
        let free = board.speed_rad_per_s();
        board.surroundings().load_torque_nm = 0.01;
        board.advance(1000);
        let loaded = board.speed_rad_per_s();
        board.brake(0.01);
        board.advance(1000);
        let braked = board.speed_rad_per_s();
        assert!(free > loaded + 5.0 && loaded > braked + 5.0, "{free} {loaded} {braked}");
        // Only a motor that turns should give counts.
        board.surroundings().load_torque_nm = 0.0;
        board.brake(0.0);
        board.advance(1000);
        board.surroundings().encoder_unplugged = true;
        board.advance(2000);
        let trip = board.machine.trial.sample().trip;
        assert!(matches!(trip, Trip::EncoderSilent | Trip::EncoderTooFew), "{trip:?}");
    }

    #[test]
    fn what_is_saved_outlives_a_reset() {
        let mut board = board();
        for line in ["echo off", "set speed_kp 0.125", "save"] {
            assert!(said(&mut board, line).contains("ok\n"), "{line}");
        }
        board.advance(1000);
        board.reset().unwrap();
        let greeting = text(board.advance(0));
        assert!(greeting.contains("# reset: external\n"), "{greeting}");
        said(&mut board, "echo off");
        assert!(said(&mut board, "show speed_kp").starts_with("# speed_kp 0.125 "));
    }
}
