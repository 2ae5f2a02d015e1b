//! The Arduino Uno, as far as the control core and its simulations must know it. Clock, PWM, converter and timer are
//! one constant; the pins are in a table.
//!
//! A port to another board is a package of the same name with these items.
//!
//! ```
//! use motorbench_board::HARDWARE;
//!
//! assert_eq!(HARDWARE.pwm_steps, 800);
//! assert_eq!(HARDWARE.converter.step_v(), 5.0 / 1024.0);
//! ```
#![no_std]

pub mod pins;

/// What a board is, in numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hardware {
    /// Clock of the processor; edges are timed in its cycles.
    pub clock_hz: u32,
    /// PWM frequency of the bridge.
    pub pwm_hz: u32,
    /// Steps of one PWM period: the resolution of the duty.
    pub pwm_steps: u16,
    /// Step of the PWM period at which the current is sampled: at the end of the off phase.
    pub current_sampling_step: u16,
    /// Cycles of the clock in a count of the coarse timer that stamps edges and ticks, as a power of two.
    pub coarse_timer_shift: u8,
    /// Serial speed.
    pub baud: u32,
    /// The analogue-to-digital converter.
    pub converter: Converter,
}

/// An analogue-to-digital converter that takes several channels in turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Converter {
    /// Full scale, in volts: its reference.
    pub full_scale_v: f32,
    /// Steps of the full scale.
    pub steps: u16,
    /// PWM periods from one conversion to the next.
    pub periods_per_conversion: u8,
    /// Conversions of the current in a row, before one of another channel.
    pub block: u8,
}

impl Converter {
    /// A step, in volts.
    pub const fn step_v(&self) -> f32 {
        self.full_scale_v / self.steps as f32
    }
}

const CLOCK_HZ: u32 = 16_000_000;
const PWM_HZ: u32 = 20_000;

/// The Uno: an ATmega328P at 16 MHz.
pub const HARDWARE: Hardware = Hardware {
    clock_hz: CLOCK_HZ,
    pwm_hz: PWM_HZ,
    // Timer1 counts 0..=799.
    pwm_steps: (CLOCK_HZ / PWM_HZ) as u16,
    current_sampling_step: 772,
    // Timer0 counts every 64 cycles.
    coarse_timer_shift: 6,
    // 16 MHz divides into it exactly, and the Uno's USB bridge carries it.
    baud: 500_000,
    // AVcc; ten bits.
    converter: Converter { full_scale_v: 5.0, steps: 1024, periods_per_conversion: 2, block: 4 },
};
