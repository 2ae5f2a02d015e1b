//! What the tests of the chip share.
#![allow(dead_code)]

use std::path::{Path, PathBuf};

use motorbench_board::pins::EMERGENCY_STOP;
use motorbench_chip::{Chip, Outputs, Program, World, assemble};

/// Assembles a program of `chip-programs`.
pub fn elf(name: &str) -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("chip-programs").join(name).with_extension("S");
    assemble(source).unwrap_or_else(|error| panic!("{error}"))
}

/// A chip with this program and a probe around it.
pub fn chip(name: &str) -> Chip<Probe> {
    let program = Program::load(elf(name)).unwrap_or_else(|error| panic!("{error}"));
    Chip::new(&program, Probe::default())
}

/// Notes what the chip's outputs do, and gives its inputs what the test wants.
pub struct Probe {
    pub changes: Vec<(u64, Outputs)>,
    pub port_d: u8,
    pub analog_v: [f64; 8],
}

impl Default for Probe {
    fn default() -> Self {
        Self { changes: Vec::new(), port_d: EMERGENCY_STOP.mask(), analog_v: [0.0; 8] }
    }
}

impl World for Probe {
    fn outputs_changed(&mut self, cycle: u64, outputs: &Outputs) {
        self.changes.push((cycle, *outputs));
    }
    fn wake(&mut self, _: u64) {}
    fn next_wake(&self) -> Option<u64> {
        None
    }
    fn port_d_inputs(&self) -> u8 {
        self.port_d
    }
    fn analog_in_v(&mut self, _: u64, channel: u8) -> f64 {
        self.analog_v[usize::from(channel)]
    }
}

const LENGTH: u16 = 0x100;
const ENTRIES: u16 = 0x104;
const COUNTS: u16 = 0x300;
const RESULT: u16 = 0x320;
const RECEIVED: u16 = 0x340;

/// The chip with the program `agent`, which does to its registers what the test says.
pub struct Agent {
    pub chip: Chip<Probe>,
}

impl Agent {
    pub fn new() -> Self {
        let mut agent = Self { chip: chip("agent") };
        agent.run(2000);
        agent
    }

    pub fn run(&mut self, cycles: u64) {
        self.chip.run_until(self.chip.cycle() + cycles).unwrap();
    }

    /// Has the program write `value` to each address, one right after the other.
    pub fn write(&mut self, list: &[(u16, u8)]) {
        execute(&mut self.chip, list);
    }

    /// Has the program read a register.
    pub fn read(&mut self, address: u16) -> u8 {
        execute(&mut self.chip, &[(address | 0x8000, 0)]);
        self.chip.read(ENTRIES + 2)
    }

    /// Has the program start to write a byte into the EEPROM.
    pub fn program(&mut self, address: u8, value: u8) {
        execute(&mut self.chip, &[(0x4000 | u16::from(address), value)]);
    }

    /// How often an interrupt was served.
    pub fn count(&self, vector: u8) -> u8 {
        self.chip.read(COUNTS + u16::from(vector))
    }

    /// Last result of the converter.
    pub fn result(&self) -> u16 {
        self.chip.read_u16(RESULT)
    }

    /// The first `N` bytes received.
    pub fn received<const N: usize>(&self) -> [u8; N] {
        self.chip.read_bytes(RECEIVED)
    }

    /// What the outputs did since the last call.
    pub fn changes(&mut self) -> Vec<(u64, Outputs)> {
        std::mem::take(&mut self.chip.world_mut().changes)
    }

    /// Sets the levels of D2, D3 and D4.
    pub fn set_port_d(&mut self, levels: u8) {
        self.chip.world_mut().port_d = levels;
        self.chip.world_changed();
    }
}

/// Has the program `agent` of a chip execute a list.
pub fn execute<W: World>(chip: &mut Chip<W>, list: &[(u16, u8)]) {
    for (place, (address, value)) in (ENTRIES..).step_by(3).zip(list) {
        let [low, high] = address.to_le_bytes();
        [low, high, *value].into_iter().zip(place..).for_each(|(byte, at)| chip.write(at, byte));
    }
    chip.write(LENGTH, list.len() as u8);
    let done = chip.step_until(100_000, |chip| chip.read(LENGTH) == 0).unwrap();
    assert!(done, "the agent does not answer");
}
