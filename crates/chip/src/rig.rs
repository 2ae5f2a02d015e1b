//! How motor, sensors and chip are wired.

use motorbench_board::pins::{BRIDGE_DIRECTION, BRIDGE_ENABLE, BRIDGE_PWM};

use super::sensors::{Acs712, SupplyDivider, Tachogenerator};
use super::world::Outputs;
use host_sim::plant::Bridge;

/// Which pins lead to which inputs of the L293D.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wiring {
    /// D9 at IN1, D8 at IN2, D7 at EN: the motor is short-circuited between the PWM pulses.
    #[default]
    Braking,
    /// D9 at EN, D7 at IN1, D8 at IN2: the bridge is off between the PWM pulses.
    Coasting,
}

impl Wiring {
    /// What the bridge does with these outputs. An undriven EN is held low by its resistor, an undriven IN counts as
    /// low.
    pub fn bridge(self, outputs: &Outputs) -> Bridge {
        let high = |pin| outputs.level(pin).unwrap_or(false);
        let (enable, in1, in2) = match self {
            Self::Braking => (high(&BRIDGE_ENABLE), high(&BRIDGE_PWM), high(&BRIDGE_DIRECTION)),
            Self::Coasting => (high(&BRIDGE_PWM), high(&BRIDGE_ENABLE), high(&BRIDGE_DIRECTION)),
        };
        match (enable, in1, in2) {
            (false, _, _) => Bridge::Coast,
            (true, true, false) => Bridge::Forward,
            (true, false, true) => Bridge::Reverse,
            (true, _, _) => Bridge::Brake,
        }
    }
}

/// The circuit around the chip, apart from the motor itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rig {
    /// Wiring of the bridge.
    pub wiring: Wiring,
    /// Counts per turn of the encoder, all four edges counted; positive.
    pub counts_per_turn: f64,
    /// Turns of the encoder per turn of the motor: 1 on the motor's shaft, 1/30 behind a 1:30 gear.
    pub encoder_gear: f64,
    /// A and B exchanged: the encoder counts down when the motor turns forward.
    pub encoder_swapped: bool,
    /// Motor supply at the start, in volts.
    pub supply_v: f64,
    /// Current sensor at A0.
    pub current_sensor: Acs712,
    /// Tachogenerator at A1, on the motor's shaft.
    pub tachogenerator: Tachogenerator,
    /// Divider at A2.
    pub supply_divider: SupplyDivider,
    /// Seed of the sensors' noise: the same seed gives the same run.
    pub seed: u64,
}

impl Default for Rig {
    fn default() -> Self {
        Self {
            wiring: Wiring::Braking,
            counts_per_turn: 2000.0,
            encoder_gear: 1.0,
            encoder_swapped: false,
            supply_v: 12.0,
            current_sensor: Acs712::default(),
            tachogenerator: Tachogenerator::default(),
            supply_divider: SupplyDivider::default(),
            seed: 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_board::pins::Pin;

    fn driving(pins: &[&Pin]) -> Outputs {
        let mut outputs = Outputs { direction_b: 0xFF, direction_d: 0xFF, ..Outputs::default() };
        for pin in pins {
            *(if pin.port == 'B' { &mut outputs.port_b } else { &mut outputs.port_d }) |= pin.mask();
        }
        outputs
    }

    #[test]
    fn braking_wiring_shorts_the_motor_between_pulses() {
        let bridge = |pins: &[&Pin]| Wiring::Braking.bridge(&driving(pins));
        assert_eq!(bridge(&[&BRIDGE_PWM, &BRIDGE_DIRECTION]), Bridge::Coast);
        assert_eq!(bridge(&[&BRIDGE_ENABLE, &BRIDGE_PWM]), Bridge::Forward);
        assert_eq!(bridge(&[&BRIDGE_ENABLE]), Bridge::Brake);
        assert_eq!(bridge(&[&BRIDGE_ENABLE, &BRIDGE_DIRECTION]), Bridge::Reverse);
        assert_eq!(bridge(&[&BRIDGE_ENABLE, &BRIDGE_DIRECTION, &BRIDGE_PWM]), Bridge::Brake);
    }

    #[test]
    fn coasting_wiring_releases_the_motor_between_pulses() {
        let bridge = |pins: &[&Pin]| Wiring::Coasting.bridge(&driving(pins));
        assert_eq!(bridge(&[&BRIDGE_ENABLE]), Bridge::Coast);
        assert_eq!(bridge(&[&BRIDGE_PWM, &BRIDGE_ENABLE]), Bridge::Forward);
        assert_eq!(bridge(&[&BRIDGE_PWM, &BRIDGE_DIRECTION]), Bridge::Reverse);
    }

    #[test]
    fn undriven_pins_leave_the_bridge_off() {
        assert_eq!(
            Wiring::Braking.bridge(&Outputs { port_b: 0xFF, port_d: 0xFF, ..Outputs::default() }),
            Bridge::Coast
        );
    }
}
