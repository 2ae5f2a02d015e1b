//! What is connected to the chip's pins.

use motorbench_board::pins::Pin;

use super::pwm::PwmSetting;

/// The chip's outputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outputs {
    /// PORTB and its directions.
    pub port_b: u8,
    /// DDRB: ones are outputs.
    pub direction_b: u8,
    /// PORTD.
    pub port_d: u8,
    /// DDRD: ones are outputs.
    pub direction_d: u8,
    /// Level of OC1A, if that is what D9 shows.
    pub oc1a: Option<bool>,
    /// Settings of the PWM during this period.
    pub pwm: PwmSetting,
}

impl Outputs {
    /// Level that the chip gives to a pin of port B or D; `None` if the pin is an input.
    pub fn level(&self, pin: &Pin) -> Option<bool> {
        let (port, direction) = match pin.port {
            'B' => (self.port_b, self.direction_b),
            _ => (self.port_d, self.direction_d),
        };
        let own = port & pin.mask() != 0;
        let is_oc1a = (pin.port, pin.bit) == ('B', 1);
        (direction & pin.mask() != 0).then(|| self.oc1a.filter(|_| is_oc1a).unwrap_or(own))
    }

    /// Whether the pull-up of an input pin of port B or D is on.
    pub fn pull_up(&self, pin: &Pin) -> bool {
        let port = if pin.port == 'B' { self.port_b } else { self.port_d };
        self.level(pin).is_none() && port & pin.mask() != 0
    }
}

/// The circuit around the chip.
///
/// The cycles passed never decrease. After each call the chip looks at [`World::port_d_inputs`] and
/// [`World::next_wake`] again.
pub trait World {
    /// The outputs change at `cycle`.
    fn outputs_changed(&mut self, cycle: u64, outputs: &Outputs);
    /// A cycle that [`World::next_wake`] has asked for has come; the wish may have changed since.
    fn wake(&mut self, cycle: u64);
    /// When the world wants to be woken: for an edge on an input pin, or to go on with its own time.
    /// It may be woken earlier.
    fn next_wake(&self) -> Option<u64>;
    /// Levels at the pins of port D from outside; only D2, D3 and D4 are looked at.
    fn port_d_inputs(&self) -> u8;
    /// Voltage at an analogue input (0..=7) at `cycle`.
    fn analog_in_v(&mut self, cycle: u64, channel: u8) -> f64;
}

/// Nothing connected: inputs low except the emergency stop, analogue inputs at 0 V.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unconnected;

impl World for Unconnected {
    fn outputs_changed(&mut self, _: u64, _: &Outputs) {}
    fn wake(&mut self, _: u64) {}
    fn next_wake(&self) -> Option<u64> {
        None
    }
    fn port_d_inputs(&self) -> u8 {
        motorbench_board::pins::EMERGENCY_STOP.mask()
    }
    fn analog_in_v(&mut self, _: u64, _: u8) -> f64 {
        0.0
    }
}
