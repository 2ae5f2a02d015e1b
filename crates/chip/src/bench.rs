//! Chip and motor together: what a test of the firmware works with.

use std::cell::Ref;
use std::path::Path;

use motorbench_board::pins::{ENCODER_A, ENCODER_B};
use motorbench_core::HARDWARE;

use super::core::{Chip, Crash, ResetCause};
use super::encoder::EncoderFault;
use super::program::{Program, ProgramError};
use super::recorder::{Recording, Row};
use super::rig::Rig;
use super::sensors::SensorFault;
use super::serial::Serial;
use super::surroundings::Surroundings;
use host_sim::plant::Plant;

/// How closely a write of the EEPROM is watched for; one takes 54,400 cycles.
const EEPROM_POLL_CYCLES: u64 = 100;

/// The firmware on its chip, with a motor.
///
/// ```no_run
/// use motorbench_chip::{Bench, Rig, firmware_elf};
/// use host_sim::plant::{DcMotor, Plant};
///
/// let mut bench = Bench::new(firmware_elf()?, Rig::default(), DcMotor::default())?;
/// bench.serial().write_line("speed 100");
/// bench.run_s(0.5)?;
/// println!("{:.1} rad/s, the firmware says {:?}", bench.now().speed_rad_per_s, bench.serial().read_line());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Bench<P: Plant> {
    chip: Chip<Surroundings<P>>,
    program: Program,
}

impl<P: Plant> Bench<P> {
    /// Switches on the firmware from an ELF file, with the motor as `plant` has it.
    ///
    /// # Errors
    /// If the file is no program for the chip.
    pub fn new(elf: impl AsRef<Path>, rig: Rig, plant: P) -> Result<Self, ProgramError> {
        let program = Program::load(elf)?;
        Ok(Self { chip: Chip::new(&program, Surroundings::new(rig, plant)), program })
    }

    /// The program, with its symbols.
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// The chip.
    pub fn chip(&self) -> &Chip<Surroundings<P>> {
        &self.chip
    }

    /// The chip, for its memories, its resets and measuring.
    pub fn chip_mut(&mut self) -> &mut Chip<Surroundings<P>> {
        &mut self.chip
    }

    /// The serial line.
    pub fn serial(&mut self) -> Serial<'_, Surroundings<P>> {
        self.chip.serial()
    }

    /// Cycles since power-on.
    pub fn cycle(&self) -> u64 {
        self.chip.cycle()
    }

    /// Runs for `duration_s` seconds.
    ///
    /// # Errors
    /// If the program crashes.
    pub fn run_s(&mut self, duration_s: f64) -> Result<(), Crash> {
        self.chip.run_s(duration_s)
    }

    /// Runs until a line has come over the serial line, at most `limit_s` seconds.
    ///
    /// # Errors
    /// If the program crashes.
    pub fn run_until_line(&mut self, limit_s: f64) -> Result<Option<String>, Crash> {
        let end = self.cycle() + (limit_s * f64::from(HARDWARE.clock_hz)) as u64;
        loop {
            let line = self.serial().read_line();
            if line.is_some() || self.cycle() >= end {
                return Ok(line);
            }
            self.chip.run_until(self.cycle() + u64::from(HARDWARE.pwm_steps))?;
        }
    }

    /// The plant. Its state is that of the last instant at which it met the chip; [`Bench::now`] is up to date.
    pub fn plant(&self) -> Ref<'_, P> {
        Ref::map(self.chip.world(), |world| &world.plant)
    }

    /// The true state now.
    pub fn now(&mut self) -> Row {
        let cycle = self.cycle();
        self.change(|_| ());
        debug_assert!(self.chip.world().row().cycle <= cycle);
        self.chip.world().row()
    }

    /// Changes the surroundings at this instant.
    fn change<R>(&mut self, change: impl FnOnce(&mut Surroundings<P>) -> R) -> R {
        let cycle = self.cycle();
        let mut world = self.chip.world_mut();
        world.advance_to(cycle);
        let result = change(&mut world);
        drop(world);
        self.chip.world_changed();
        result
    }

    /// Changes the plant itself at this instant.
    pub fn change_plant<R>(&mut self, change: impl FnOnce(&mut P) -> R) -> R {
        self.change(|world| change(&mut world.plant))
    }

    /// Sets the motor supply, in volts.
    pub fn set_supply_v(&mut self, supply_v: f64) {
        self.change(|world| world.inputs.supply_v = supply_v);
    }

    /// Sets the load torque against positive rotation, in newton metres.
    pub fn set_load_torque_nm(&mut self, load_torque_nm: f64) {
        self.change(|world| world.inputs.load_torque_nm = load_torque_nm);
    }

    /// Holds the rotor fast, or lets it go.
    pub fn block_rotor(&mut self, blocked: bool) {
        self.change(|world| world.inputs.blocked = blocked);
    }

    /// Presses or releases the emergency stop.
    pub fn press_emergency_stop(&mut self, pressed: bool) {
        self.change(|world| world.stop_pressed = pressed);
    }

    /// Lets the encoder fail, or repairs it.
    pub fn set_encoder_fault(&mut self, fault: Option<EncoderFault>) {
        let cycle = self.cycle();
        self.change(|world| {
            let angle_rad = world.plant.angle_rad();
            world.encoder.set_fault(cycle, angle_rad, fault);
        });
    }

    /// Replaces the encoder's edges by a train at a fixed rate, backwards if negative; `None` ends it.
    pub fn set_edge_train_per_s(&mut self, edges_per_s: Option<f64>) {
        let cycle = self.cycle();
        self.change(|world| world.encoder.set_train(cycle, edges_per_s));
    }

    /// A noise pulse on the lines of the encoder: both or one of them are inverted for `width_cycles`, beginning
    /// `after_cycles` from now.
    pub fn encoder_glitch(&mut self, after_cycles: u64, width_cycles: u64, a: bool, b: bool) {
        let start = self.cycle() + after_cycles;
        self.change(|world| world.encoder.disturb(start, Some(width_cycles), lines(a, b)));
    }

    /// An illegal transition: both lines of the encoder change at once, and stay inverted.
    pub fn encoder_illegal_transition(&mut self, after_cycles: u64) {
        let start = self.cycle() + after_cycles;
        self.change(|world| world.encoder.disturb(start, None, lines(true, true)));
    }

    /// Lets the current sensor fail, or repairs it.
    pub fn set_current_sensor_fault(&mut self, fault: Option<SensorFault>) {
        self.change(|world| world.current_fault = fault);
    }

    /// Lets the tachogenerator fail, or repairs it.
    pub fn set_tachogenerator_fault(&mut self, fault: Option<SensorFault>) {
        self.change(|world| world.tacho_fault = fault);
    }

    /// Lets the supply's divider fail, or repairs it.
    pub fn set_supply_divider_fault(&mut self, fault: Option<SensorFault>) {
        self.change(|world| world.supply_fault = fault);
    }

    /// The current sensor's output stays as it is now.
    pub fn freeze_current_sensor(&mut self) {
        self.change(|world| {
            let frozen_v = world.rig.current_sensor.output_v(world.plant.current_a(), 0.0);
            world.current_fault = Some(SensorFault::PinnedV(frozen_v));
        });
    }

    /// Lets the converter end no conversion any more, or go on.
    pub fn set_converter_dead(&mut self, dead: bool) {
        self.chip.set_converter_dead(dead);
    }

    /// Lets the transmitter of the serial line keep the byte that it has, or send again.
    pub fn set_transmitter_stuck(&mut self, stuck: bool) {
        self.chip.set_transmitter_stuck(stuck);
    }

    /// Records the truth every `interval_cycles` from now on: 800 for a row per PWM period, 16,000 for one per
    /// millisecond, 0 to stop. Rows are kept until [`Bench::take_recording`].
    pub fn record(&mut self, interval_cycles: u64) {
        let cycle = self.cycle();
        self.change(|world| world.recording = Recording::new(cycle, interval_cycles));
    }

    /// Takes the rows recorded so far; the recording goes on.
    pub fn take_recording(&mut self) -> Vec<Row> {
        self.change(|world| std::mem::take(&mut world.recording.rows))
    }

    /// Resets the chip while the motor goes on.
    pub fn reset(&mut self, cause: ResetCause) {
        self.chip.reset(cause);
    }

    /// Runs until the `n`-th EEPROM write from now (counted from 1) has begun or, if `completed`, ended; at most
    /// `limit_s` seconds. Returns the EEPROM as a power cut at this instant would leave it, or `None` if it did not come
    /// to this write.
    ///
    /// # Errors
    /// If the program crashes.
    pub fn run_until_eeprom_write(&mut self, n: u64, completed: bool, limit_s: f64) -> Result<Option<Vec<u8>>, Crash> {
        let writes = |bench: &Self| {
            let (begun, ended) = bench.chip.eeprom_writes();
            if completed { ended } else { begun }
        };
        let wanted = writes(self) + n;
        let end = self.cycle() + (limit_s * f64::from(HARDWARE.clock_hz)) as u64;
        while writes(self) < wanted {
            if self.cycle() >= end {
                return Ok(None);
            }
            self.chip.run_until(self.cycle() + EEPROM_POLL_CYCLES)?;
        }
        Ok(Some(self.chip.eeprom()))
    }
}

fn lines(a: bool, b: bool) -> u8 {
    (if a { ENCODER_A.mask() } else { 0 }) | (if b { ENCODER_B.mask() } else { 0 })
}
