//! Commutation ripple: the torque constant varies over the angle of the shaft, since the brushes connect one coil after the
//! other. The same factor is in the torque and in the back-EMF. A ripple of 3 % is usual for few segments.

use super::law::mean_over_middle;
use super::{
    About, ActsOn, Balance, Channels, Coordinate, Instant, Law, Parameter, Scales, Search, Shown, Simplification,
    Strength, Unit,
};
use crate::motor::MotorParameters;

/// Most ripples a revolution that are looked for: twice an odd number of segments, or an even number of them.
const MOST_RIPPLES: u8 = 40;
/// A usual share, to start from.
const USUAL_SHARE: f64 = 0.02;

/// See the module.
pub struct CommutationRipple;

static ABOUT: About = About {
    id: "commutation_ripple",
    title: "a torque constant that varies over the angle",
    acts_on: &[ActsOn::Torque, ActsOn::Voltage],
    parameters: &[
        Parameter::signed("cosine_share", Unit::One),
        Parameter::signed("sine_share", Unit::One),
        Parameter::tried("ripples_per_rev"),
    ],
    linear_in: 2,
    law: "k (1 + cosine_share cos(n a) + sine_share sin(n a)) in torque and back-EMF, n = ripples_per_rev",
    looks_like: "The current ripples many times a revolution, in proportion to the speed; at standstill the torque for a current depends on the angle",
    confused_with: &["cogging", "tacho_ripple"],
    experiment: "Turn the motor from outside with its terminals open: the ripple is in the voltage, in proportion to the speed, where cogging shows none",
    remedy: "Average the current over whole ripples; a current limit with margin; a motor with more commutator segments",
    source: "Fitzgerald, Kingsley, Umans, Electric Machinery (2003), commutator machines: ripple of the rectified EMF",
    // The ripple has harmonics, and in a step the current is taken as it begins.
    simplification: Simplification::of_own(0.02),
    responds_linearly: true,
    shown: Shown::new(Strength::TorqueConstant, Coordinate::Angle),
    ..About::DEFAULT
};

impl Law for CommutationRipple {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn contribute(
        &self,
        values: &[f64],
        motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        let (sine, cosine) = (values[2] * at.angle_rad).sin_cos();
        let share = mean_over_middle(values[2], at.turned_rad) * (values[0] * cosine + values[1] * sine);
        let more_nm_per_a = share * motor.torque_constant_nm_per_a;
        balance.voltage_v -= more_nm_per_a * at.middle_rad_per_s;
        balance.torque_nm += more_nm_per_a * at.current_a;
    }
}

impl Search for CommutationRipple {
    fn starts(&self, _scales: &Scales) -> Vec<Vec<f64>> {
        let even = (4..=MOST_RIPPLES).step_by(2);
        even.map(|ripples| vec![USUAL_SHARE, USUAL_SHARE, f64::from(ripples)]).collect()
    }

    /// Without a measured current it can hardly be told from cogging.
    fn can_show_in(&self, channels: &Channels) -> bool {
        channels.current
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the torque gains in power the voltage pays for: energy is neither made nor lost.
    #[test]
    fn both_balances_have_the_same_power() {
        let motor = MotorParameters::PIVT6;
        let mut balance = Balance::default();
        let at = Instant {
            time_s: 0.0,
            voltage_v: 6.0,
            duty: 0.5,
            mean_duty: 0.5,
            supply_v: 12.0,
            open: false,
            current_a: 0.7,
            speed_rad_per_s: 60.0,
            middle_rad_per_s: 60.0,
            angle_rad: 0.3,
            turned_rad: 0.05,
            step_s: 1e-3,
        };
        CommutationRipple.contribute(&[0.03, -0.01, 14.0], &motor, &at, &mut [], &mut balance);
        let [mechanical_w, electrical_w] = [balance.torque_nm * at.speed_rad_per_s, -balance.voltage_v * at.current_a];
        assert!(mechanical_w.abs() > 1e-3 && (mechanical_w / electrical_w - 1.0).abs() < 1e-12);
    }
}
