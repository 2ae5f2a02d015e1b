//! The chip: processor, memories and peripherals.

use std::cell::{Ref, RefMut};
use std::fmt;

use motorbench_core::HARDWARE;

use super::board::Board;
use super::ffi::{Core, Progress};
use super::meter::Meter;
use super::program::Program;
use super::registers::*;
use super::serial::Serial;
use super::world::{Outputs, World};

/// What unused SRAM is filled with for measuring the depth of the stack.
const PAINT: u8 = 0xC5;

/// What reset the chip; MCUSR shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetCause {
    /// Supply switched on: the SRAM holds noise, the other flags of MCUSR are cleared.
    PowerOn,
    /// Reset button or the host opening the port.
    External,
    /// The supply dipped below the brown-out level.
    BrownOut,
    /// The watchdog ran out; it goes on running with its shortest period.
    Watchdog,
}

impl ResetCause {
    /// Its flag in MCUSR (section 11.9.1).
    pub const fn flag(self) -> u8 {
        match self {
            Self::PowerOn => 1,
            Self::External => 2,
            Self::BrownOut => 4,
            Self::Watchdog => 8,
        }
    }
}

/// Why a chip cannot go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Crash {
    /// The processor met something that is no instruction.
    InvalidOpcode {
        /// When.
        cycle: u64,
        /// Byte address in the flash.
        address: u32,
        /// What stands there.
        opcode: u16,
    },
    /// The processor sleeps with interrupts disabled, and no watchdog runs that could reset it.
    AsleepForEver {
        /// Since when.
        cycle: u64,
    },
}

impl fmt::Display for Crash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::InvalidOpcode { cycle, address, opcode } => {
                write!(f, "invalid instruction {opcode:#06x} at {address:#06x} in cycle {cycle}")
            }
            Self::AsleepForEver { cycle } => write!(f, "asleep with interrupts disabled since cycle {cycle}"),
        }
    }
}

impl std::error::Error for Crash {}

/// A simulated ATmega328P at 16 MHz with its surroundings.
pub struct Chip<W: World> {
    pub(super) core: Core<Board<W>>,
}

impl<W: World> Chip<W> {
    /// A chip that has just been switched on, its EEPROM as the program file has it and otherwise erased.
    pub fn new(program: &Program, world: W) -> Self {
        let mut core = Core::new(Board::new(world));
        program.flash.iter().for_each(|(address, code)| core.load(*address, code));
        for (address, data) in &program.eeprom {
            core.device_mut().eeprom.image[*address..*address + data.len()].copy_from_slice(data);
        }
        let mut chip = Self { core };
        chip.reset(ResetCause::PowerOn);
        chip
    }

    /// Resets the chip. Its EEPROM stays, its SRAM stays unless the supply was off.
    pub fn reset(&mut self, cause: ResetCause) {
        let cpu = self.core.cpu();
        let earlier = if cause == ResetCause::PowerOn { 0 } else { cpu.read(MCUSR) };
        cpu.write(MCUSR, earlier | cause.flag());
        if cause == ResetCause::PowerOn {
            // Any pattern without regularity will do; it only has to differ from zeroes.
            let mut noise = 0x2545_F491_u32;
            for address in SRAM_START..=SRAM_END {
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                cpu.write(address, (noise >> 24) as u8);
            }
        }
        let mut board = self.core.device_mut();
        board.crash = None;
        if cause == ResetCause::PowerOn {
            board.eeprom.power_cut();
        }
        drop(board);
        self.core.reset();
    }

    /// Cycles since power-on; resets do not restart it.
    pub fn cycle(&self) -> u64 {
        self.core.cpu().now()
    }

    /// Seconds since power-on.
    pub fn time_s(&self) -> f64 {
        self.cycle() as f64 / f64::from(HARDWARE.clock_hz)
    }

    /// Runs until `cycle` has been reached; the instruction then running is completed.
    ///
    /// # Errors
    /// If the program runs into an invalid instruction or goes to sleep for ever.
    pub fn run_until(&mut self, cycle: u64) -> Result<(), Crash> {
        let progress = self.core.run_until(cycle);
        self.check(progress)
    }

    /// Runs for `duration_s` seconds.
    ///
    /// # Errors
    /// As [`Chip::run_until`].
    pub fn run_s(&mut self, duration_s: f64) -> Result<(), Crash> {
        self.run_until(self.cycle() + (duration_s * f64::from(HARDWARE.clock_hz)).round() as u64)
    }

    /// Executes one instruction, or sleeps until the next event.
    ///
    /// # Errors
    /// As [`Chip::run_until`].
    pub fn step(&mut self) -> Result<(), Crash> {
        let progress = self.core.step();
        self.check(progress)
    }

    /// Single-steps until `condition` holds, at most `limit_cycles`. Returns whether it holds.
    ///
    /// # Errors
    /// As [`Chip::run_until`].
    pub fn step_until(&mut self, limit_cycles: u64, mut condition: impl FnMut(&Self) -> bool) -> Result<bool, Crash> {
        let end = self.cycle() + limit_cycles;
        while !condition(self) {
            if self.cycle() >= end {
                return Ok(false);
            }
            self.step()?;
        }
        Ok(true)
    }

    fn check(&self, progress: Progress) -> Result<(), Crash> {
        match (self.core.device().crash, progress) {
            (Some(crash), _) => Err(crash),
            (None, Progress::Dead) => Err(Crash::AsleepForEver { cycle: self.cycle() }),
            (None, Progress::Running) => Ok(()),
        }
    }

    /// A byte of data memory: working registers, I/O registers or SRAM. Reading has no side effects; timer counters and
    /// SREG show what the program saw last.
    pub fn read(&self, address: u16) -> u8 {
        self.core.cpu().read(address)
    }

    /// Two bytes of data memory, little-endian.
    pub fn read_u16(&self, address: u16) -> u16 {
        u16::from_le_bytes([self.read(address), self.read(address + 1)])
    }

    /// `N` bytes of data memory.
    pub fn read_bytes<const N: usize>(&self, address: u16) -> [u8; N] {
        std::array::from_fn(|offset| self.read(address + offset as u16))
    }

    /// Writes a byte of data memory without side effects: fit for variables, not for I/O registers.
    pub fn write(&mut self, address: u16, value: u8) {
        self.core.cpu().write(address, value);
    }

    /// Byte address of the next instruction.
    pub fn program_counter(&self) -> u32 {
        self.core.cpu().program_counter()
    }

    /// The stack pointer.
    pub fn stack_pointer(&self) -> u16 {
        self.read_u16(SPL)
    }

    /// The EEPROM as it stands, 1024 bytes.
    pub fn eeprom(&self) -> Vec<u8> {
        self.core.device().eeprom.image.clone()
    }

    /// Replaces the EEPROM's content.
    ///
    /// # Panics
    /// If `image` does not have 1024 bytes.
    pub fn set_eeprom(&mut self, image: &[u8]) {
        assert_eq!(image.len(), EEPROM_BYTES, "an EEPROM image has {EEPROM_BYTES} bytes");
        self.core.device_mut().eeprom.image.copy_from_slice(image);
    }

    /// EEPROM bytes whose programming has begun and has been completed since power-on.
    pub fn eeprom_writes(&self) -> (u64, u64) {
        let board = self.core.device();
        (board.eeprom.started, board.eeprom.completed)
    }

    /// Lets the converter end no conversion any more, or go on.
    pub fn set_converter_dead(&mut self, dead: bool) {
        self.core.device_mut().adc.dead = dead;
    }

    /// Lets the transmitter of the serial line keep the byte that it has, or send again.
    pub fn set_transmitter_stuck(&mut self, stuck: bool) {
        self.core.with_device(|board, cpu| board.set_transmitter_stuck(cpu, stuck));
    }

    /// The serial line.
    pub fn serial(&mut self) -> Serial<'_, W> {
        Serial { chip: self }
    }

    /// What the chip drives its pins with.
    pub fn outputs(&self) -> Outputs {
        self.core.device().outputs
    }

    /// What is connected to it.
    pub fn world(&self) -> Ref<'_, W> {
        Ref::map(self.core.device(), |board| &board.world)
    }

    /// What is connected to it, to change; call [`Chip::world_changed`] afterwards.
    pub fn world_mut(&mut self) -> RefMut<'_, W> {
        RefMut::map(self.core.device_mut(), |board| &mut board.world)
    }

    /// Brings changes made through [`Chip::world_mut`] to the pins.
    pub fn world_changed(&mut self) {
        self.core.with_device(|board, cpu| board.attend(cpu));
    }

    /// Begins to note handlers, samples and, if given, writes to a marker register (GPIOR0, say); earlier notes are
    /// dropped. It costs little time.
    ///
    /// # Panics
    /// If `marker_register` is not an I/O register.
    pub fn measure(&mut self, marker_register: Option<u16>) {
        if let Some(address) = marker_register {
            assert!((IO_BASE..SRAM_START).contains(&address), "{address:#x} is no I/O register");
            self.core.take_over_writes(address);
        }
        self.core.device_mut().meter = Meter::started(marker_register);
    }

    /// What has been noted since [`Chip::measure`].
    pub fn meter(&self) -> Ref<'_, Meter> {
        Ref::map(self.core.device(), |board| &board.meter)
    }

    /// Fills the SRAM from `first_free` (the end of the program's variables) to the stack with a pattern for
    /// [`Chip::stack_free_bytes`].
    pub fn paint_stack(&mut self, first_free: u16) {
        let cpu = self.core.cpu();
        (first_free.max(SRAM_START)..=self.stack_pointer()).for_each(|address| cpu.write(address, PAINT));
    }

    /// Bytes between `first_free` and the deepest point that the stack has reached since [`Chip::paint_stack`].
    pub fn stack_free_bytes(&self, first_free: u16) -> u16 {
        (first_free..=SRAM_END).take_while(|&address| self.read(address) == PAINT).count() as u16
    }
}
