//! The EEPROM (section 8.4), which replaces simavr's.
//!
//! simavr writes in no time, shows EEPE low at once and raises EE_READY once, 3.4 ms later. On the chip EEPE stays up
//! for 3.4 ms (1.8 ms if only erasing or only writing). EE_READY asks as long as EEPE is down. EEMPE opens the way for
//! four cycles. A read halts the processor for four cycles and a write for two.
//!
//! A cell reads 0xFF from the start of an erase until its write is complete. That is what a power cut leaves behind.

use super::ffi::Cpu;
use super::registers::*;
use motorbench_core::HARDWARE;

const EERIE: u8 = 1 << 3;
const EEMPE: u8 = 1 << 2;
const EEPE: u8 = 1 << 1;
const EERE: u8 = 1;
const MODE_SHIFT: u8 = 4;
const UNLOCKED_CYCLES: u64 = 4;
/// Erase and write in one operation (table 8-1).
const ATOMIC_CYCLES: u64 = HARDWARE.clock_hz as u64 * 34 / 10_000;
/// Erase only, or write only.
const SINGLE_CYCLES: u64 = HARDWARE.clock_hz as u64 * 18 / 10_000;

/// The memory and its programming logic.
pub(super) struct Eeprom {
    pub image: Vec<u8>,
    /// The cell being programmed and what it will hold.
    busy: Option<(usize, u8)>,
    unlocked_at: Option<u64>,
    pub started: u64,
    pub completed: u64,
}

impl Eeprom {
    pub fn new() -> Self {
        Self { image: vec![0xFF; EEPROM_BYTES], busy: None, unlocked_at: None, started: 0, completed: 0 }
    }

    /// The supply fails: what is being programmed stays as it is.
    pub fn power_cut(&mut self) {
        self.busy = None;
    }

    /// A reset does not stop a write in progress (section 8.4.2). Returns when the remainder will be done at the latest.
    pub fn reset(&mut self, cpu: &Cpu) -> Option<u64> {
        self.unlocked_at = None;
        self.publish(cpu, 0);
        self.busy.map(|_| cpu.now() + ATOMIC_CYCLES)
    }

    /// Puts the control register together and requests EE_READY.
    fn publish(&self, cpu: &Cpu, written: u8) {
        let unlocked = self.unlocked_at.is_some_and(|at| cpu.now() - at <= UNLOCKED_CYCLES);
        let flag = |set: bool, mask: u8| if set { mask } else { 0 };
        let control =
            (written & (0b11 << MODE_SHIFT | EERIE)) | flag(unlocked, EEMPE) | flag(self.busy.is_some(), EEPE);
        cpu.write(EECR, control);
        match (control & EERIE != 0 && self.busy.is_none(), cpu.requested(vector::EE_READY)) {
            (true, false) => cpu.raise(vector::EE_READY),
            (false, true) => cpu.clear(vector::EE_READY),
            _ => {}
        }
    }

    /// A handler returned: EE_READY asks again as long as nothing is being written.
    pub fn handler_returned(&self, cpu: &Cpu) {
        self.publish(cpu, cpu.read(EECR));
    }

    pub fn control_read(&self, cpu: &Cpu) -> u8 {
        self.publish(cpu, cpu.read(EECR));
        cpu.read(EECR)
    }

    /// The program wrote EECR. Returns when the write that this started will be complete.
    pub fn control_written(&mut self, cpu: &Cpu, value: u8) -> Option<u64> {
        let unlocked = self.unlocked_at.is_some_and(|at| cpu.now() - at <= UNLOCKED_CYCLES);
        let address = usize::from(u16::from_le_bytes([cpu.read(EEARL), cpu.read(EEARH)])) % EEPROM_BYTES;
        let mut done = None;
        if value & EEPE != 0 && unlocked && self.busy.is_none() {
            let mode = (value >> MODE_SHIFT) & 0b11;
            done = Some(cpu.now() + if mode == 0 { ATOMIC_CYCLES } else { SINGLE_CYCLES });
            self.program(address, cpu.read(EEDR), mode);
            self.unlocked_at = None;
            cpu.stall(2);
        } else if value & EEMPE != 0 {
            self.unlocked_at = Some(cpu.now());
        }
        if value & EERE != 0 && self.busy.is_none() {
            cpu.write(EEDR, self.image[address]);
            cpu.stall(4);
        }
        self.publish(cpu, value);
        done
    }

    /// Begins to erase and write (mode 0), to erase (1) or to write (2, which can only clear bits).
    fn program(&mut self, address: usize, data: u8, mode: u8) {
        let old = self.image[address];
        let (during, after) = match mode {
            0 => (0xFF, data),
            1 => (0xFF, 0xFF),
            _ => (old, old & data),
        };
        self.image[address] = during;
        self.busy = Some((address, after));
        self.started += 1;
    }

    /// The write in progress is complete.
    pub fn done(&mut self, cpu: &Cpu) {
        if let Some((address, value)) = self.busy.take() {
            self.image[address] = value;
            self.completed += 1;
            self.publish(cpu, cpu.read(EECR));
        }
    }
}
