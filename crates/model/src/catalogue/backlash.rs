//! Backlash: a gear or a coupling has a gap between motor and load; the sensor is at the motor.

use super::{About, ActsOn, Balance, Instant, Law, Parameter, Scales, Search, Simplification, Unit};
use crate::motor::MotorParameters;
use crate::oppose_motion;
use crate::pwm_period::against;
use std::f64::consts::TAU;

/// The least gap that counts as one: a sixth of a degree.
const LEAST_GAP_RAD: f64 = 3e-3;
/// Longest part of a step: a blow lasts a millisecond, and this follows the flanks as they meet and part.
const LONGEST_PART_S: f64 = 25e-6;
/// Fewest parts of a step. Where the steps themselves are short, the caller wants a finer result.
const LEAST_PARTS: f64 = 4.0;
/// Greatest share of the inertia behind the gap.
pub(super) const MOST_SHARE: f64 = 0.95;
/// Longest step: the driving torque is constant over it.
const LONGEST_STEP_S: f64 = 0.5e-3;

/// Contacts to begin with: natural frequency in hertz and damping ratio.
const HARD: [f64; 2] = [300.0, 0.4];
const SOFT: [f64; 2] = [90.0, 0.3];
/// How long a blow and its ringing last.
const BLOW_S: f64 = 2e-3;

/// The two sides of the gap over one step of the simulation.
struct Sides {
    half_gap_rad: f64,
    motor_kg_m2: f64,
    load_kg_m2: f64,
    /// In contact: square of the natural frequency of load and motor against each other, and twice their decay rate.
    stiffness_per_s2: f64,
    damping_per_s: f64,
    twist_rad: f64,
    motor_rad_per_s: f64,
    load_rad_per_s: f64,
}

/// Free response of depth and slip in contact over a whole step: computed once for each length of a step.
#[derive(Clone, Copy)]
struct InContact {
    length_s: f64,
    depth_of: [f64; 2],
    slip_of: [f64; 2],
}

impl InContact {
    fn new(values: &[f64], length_s: f64) -> Self {
        let rate = TAU * values[2];
        let decay = values[3] * rate;
        let ringing = rate * (1.0 - values[3] * values[3]).sqrt();
        let (sine, cosine) = (ringing * length_s).sin_cos();
        let left = (-decay * length_s).exp();
        let sine = sine / ringing;
        Self {
            length_s,
            depth_of: [left * (cosine + decay * sine), left * sine],
            slip_of: [-left * rate * rate * sine, left * (cosine - decay * sine)],
        }
    }

    fn remembered(memory: &[f64]) -> Self {
        Self { length_s: memory[0], depth_of: [memory[1], memory[2]], slip_of: [memory[3], memory[4]] }
    }

    fn to_remember(self) -> [f64; 5] {
        [self.length_s, self.depth_of[0], self.depth_of[1], self.slip_of[0], self.slip_of[1]]
    }
}

impl Sides {
    fn new(values: &[f64], motor: &MotorParameters, state: &[f64], speed_rad_per_s: f64) -> Self {
        let share = values[1].clamp(1e-3, MOST_SHARE);
        let rate = TAU * values[2];
        Self {
            half_gap_rad: 0.5 * values[0],
            motor_kg_m2: (1.0 - share) * motor.inertia_kg_m2,
            load_kg_m2: share * motor.inertia_kg_m2,
            stiffness_per_s2: rate * rate,
            damping_per_s: 2.0 * values[3] * rate,
            twist_rad: state[0],
            motor_rad_per_s: speed_rad_per_s,
            load_rad_per_s: state[1],
        }
    }

    /// How far the flanks are pressed into each other, with the sign of the twist.
    fn depth_rad(&self) -> f64 {
        self.twist_rad - self.twist_rad.clamp(-self.half_gap_rad, self.half_gap_rad)
    }

    fn slip_rad_per_s(&self) -> f64 {
        self.motor_rad_per_s - self.load_rad_per_s
    }

    /// Relative acceleration by the contact. The flanks push and do not pull.
    fn parting_per_s2(&self) -> f64 {
        let depth_rad = self.depth_rad();
        let parting = self.stiffness_per_s2 * depth_rad + self.damping_per_s * self.slip_rad_per_s();
        if depth_rad * parting > 0.0 { parting } else { 0.0 }
    }

    /// Takes motor and load over a step under the other torques on the motor. Returns the mean torque on the load.
    fn take(&mut self, contact: &InContact, drive_nm: f64, terms: &Balance) -> f64 {
        let before_rad_per_s = self.load_rad_per_s;
        if !self.waits_in_the_gap(contact.length_s, drive_nm, terms) && !self.stays_as_it_is(contact, drive_nm, terms) {
            self.in_parts(contact.length_s, drive_nm, terms);
        }
        self.load_kg_m2 * (self.load_rad_per_s - before_rad_per_s) / contact.length_s
    }

    /// Takes the whole step at once, if its friction holds the motor and the load does not reach a flank; says whether it did.
    fn waits_in_the_gap(&mut self, length_s: f64, drive_nm: f64, terms: &Balance) -> bool {
        let is_held = drive_nm <= terms.dry_forward_nm.max(0.0) && drive_nm >= -terms.dry_backward_nm.max(0.0);
        let after = Self { twist_rad: self.twist_rad - self.load_rad_per_s * length_s, ..*self };
        let waits = self.motor_rad_per_s == 0.0 && is_held && self.depth_rad() == 0.0 && after.depth_rad() == 0.0;
        if waits {
            *self = after;
        }
        waits
    }

    /// Takes the whole step in closed form, if the motor turns and the flanks neither meet nor part; says whether it did.
    fn stays_as_it_is(&mut self, contact: &InContact, drive_nm: f64, terms: &Balance) -> bool {
        let speed = self.motor_rad_per_s;
        let friction_nm = if speed > 0.0 { terms.dry_forward_nm.max(0.0) } else { -terms.dry_backward_nm.max(0.0) };
        let net_nm = drive_nm - friction_nm - terms.viscous_nm_s * speed;
        let (depth_rad, slip) = (self.depth_rad(), self.slip_rad_per_s());
        let (length_s, driven_per_s2) = (contact.length_s, net_nm / self.motor_kg_m2);
        let mut after = Self { ..*self };
        if depth_rad == 0.0 {
            after.motor_rad_per_s += driven_per_s2 * length_s;
            after.twist_rad += (slip + 0.5 * driven_per_s2 * length_s) * length_s;
        } else {
            let rest_rad = driven_per_s2 / self.stiffness_per_s2;
            let from_rest = [depth_rad - rest_rad, slip];
            let of = |row: &[f64; 2]| row[0] * from_rest[0] + row[1] * from_rest[1];
            let slip_after = of(&contact.slip_of);
            after.twist_rad += rest_rad + of(&contact.depth_of) - depth_rad;
            let whole_kg_m2 = self.motor_kg_m2 + self.load_kg_m2;
            let momentum = self.motor_kg_m2 * speed + self.load_kg_m2 * self.load_rad_per_s + net_nm * length_s;
            after.load_rad_per_s = (momentum - self.motor_kg_m2 * slip_after) / whole_kg_m2;
            after.motor_rad_per_s = after.load_rad_per_s + slip_after;
        }
        let turns = speed * after.motor_rad_per_s > 0.0;
        let pressed = |sides: &Self| sides.parting_per_s2() != 0.0;
        let touching = depth_rad != 0.0;
        let same_flank = self.twist_rad * after.twist_rad > 0.0;
        let stays = turns && pressed(self) == touching && pressed(&after) == touching && same_flank;
        if stays {
            *self = after;
        }
        stays
    }

    fn in_parts(&mut self, length_s: f64, drive_nm: f64, terms: &Balance) {
        let parts = (length_s / LONGEST_PART_S).ceil().max(LEAST_PARTS);
        let part_s = length_s / parts;
        let gain = part_s / self.motor_kg_m2;
        let reduced_kg_m2 = self.motor_kg_m2 * self.load_kg_m2 / (self.motor_kg_m2 + self.load_kg_m2);
        for _ in 0..parts as usize {
            let contact_nm = reduced_kg_m2 * self.parting_per_s2();
            let free_rad_per_s = self.motor_rad_per_s + gain * (drive_nm - contact_nm);
            self.motor_rad_per_s = oppose_motion(self.motor_rad_per_s, free_rad_per_s, gain, terms);
            self.load_rad_per_s += part_s * contact_nm / self.load_kg_m2;
            self.twist_rad += part_s * self.slip_rad_per_s();
        }
    }
}

/// Mean torque of the motor itself over a step, in which the current approaches its steady value at this voltage and speed.
fn own_nm(motor: &MotorParameters, at: &Instant, balance: &Balance) -> f64 {
    let resistance_ohm = motor.resistance_ohm + balance.resistance_ohm;
    let emf_v = motor.torque_constant_nm_per_a * at.speed_rad_per_s;
    let driving_v = at.voltage_v + balance.voltage_v - emf_v - resistance_ohm * at.current_a;
    let drops_v = balance.ripple.mean_drops_v(balance.drops());
    let lost_v = match at.current_a {
        0.0 => driving_v.clamp(-drops_v[1], drops_v[0]),
        current_a => against(current_a, drops_v),
    };
    let half_steps = 0.5 * at.step_s * resistance_ohm / motor.inductance_h;
    // Mean of an exponential approach, by the approximation of Pade.
    let approached = if at.open { 0.0 } else { half_steps / (1.0 + half_steps) };
    let mean_a = at.current_a + (driving_v - lost_v) / resistance_ohm * approached;
    motor.torque_constant_nm_per_a * mean_a - motor.viscous_friction_nm_s * at.speed_rad_per_s
}

/// Whether a blow and its ringing fall within one row.
fn hides_blows(scales: &Scales) -> bool {
    scales.interval_s >= BLOW_S
}

/// See the module.
pub struct Backlash;

static ABOUT: About = About {
    id: "backlash",
    title: "backlash between motor and load",
    acts_on: &[ActsOn::Torque],
    parameters: &[
        // Below, the flanks are practically always in contact.
        Parameter::within("gap_rad", Unit::Radian, LEAST_GAP_RAD, 1.0),
        Parameter::within("load_inertia_share", Unit::One, 0.0, MOST_SHARE),
        // Below, it would be a springy shaft; above, the blows of all contacts look alike.
        Parameter::within("contact_Hz", Unit::Hertz, 40.0, 1000.0),
        Parameter::within("contact_damping", Unit::One, 0.05, 0.95),
    ],
    linear_in: 0,
    law: "The load follows only in contact: a stiff spring with a dead zone of gap_rad; contact_Hz and contact_damping: frequency and damping ratio of load and motor in contact",
    looks_like: "After each reversal of torque the motor runs light for a moment, then hits; the missing torque is a pair of pulses",
    confused_with: &["shaft_compliance", "stribeck_friction"],
    experiment: "Reverse slowly from rest with an encoder on each side, or feel the play by hand",
    remedy: "Slow reversals; no derivative on the motor side at the gap; a dead-zone inverse in position control",
    source: "Nordin and Gutman, Automatica 38 (2002)",
    // Many gaps predict blows that nearly fit.
    simplification: Simplification::of_own(8e-2),
    // Neither a gap of nothing nor a gap before no load is backlash.
    strengths: &[0..1, 1..2],
    has_events: true,
    ..About::DEFAULT
};

impl Law for Backlash {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    /// Twist, speed of the load, and the free response of a step in contact.
    fn states(&self) -> usize {
        7
    }

    /// The load starts with the shaft's speed and in the middle of the gap.
    fn begins(&self, speed_rad_per_s: f64) -> Vec<f64> {
        let mut states = vec![0.0; self.states()];
        states[1] = speed_rad_per_s;
        states
    }

    fn longest_step_s(&self) -> f64 {
        LONGEST_STEP_S
    }

    fn motor_share(&self, values: &[f64]) -> f64 {
        1.0 - values[1]
    }

    /// The other torques on the motor decide when the flanks meet.
    fn turn(&self, _values: &[f64]) -> i8 {
        2
    }

    fn contribute(
        &self,
        values: &[f64],
        motor: &MotorParameters,
        at: &Instant,
        state: &mut [f64],
        balance: &mut Balance,
    ) {
        let (motion, memory) = state.split_at_mut(2);
        if (memory[0] - at.step_s).abs() > 1e-12 {
            memory.copy_from_slice(&InContact::new(values, at.step_s).to_remember());
        }
        let mut sides = Sides::new(values, motor, motion, at.speed_rad_per_s);
        let drive_nm = balance.torque_nm + own_nm(motor, at, balance);
        balance.torque_nm -= sides.take(&InContact::remembered(memory), drive_nm, balance);
        motion.copy_from_slice(&[sides.twist_rad, sides.load_rad_per_s]);
    }
}

impl Search for Backlash {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        let starts = |gaps_rad: &[f64], shares: &[f64], contact: [f64; 2]| -> Vec<Vec<f64>> {
            let of_share = |share: f64| gaps_rad.iter().map(move |gap_rad| [[*gap_rad, share], contact].concat());
            shares.iter().flat_map(|share| of_share(*share)).collect()
        };
        if hides_blows(scales) {
            let (gaps_rad, shares) = ([0.02, 0.035, 0.06, 0.09, 0.13, 0.2, 0.3], [0.3, 0.55]);
            return [HARD, SOFT].iter().flat_map(|contact| starts(&gaps_rad, &shares, *contact)).collect();
        }
        [starts(&[0.02, 0.05, 0.12], &[0.4], HARD), starts(&[0.12, 0.3], &[0.4], SOFT)].concat()
    }

    fn starts_fitted(&self, scales: &Scales) -> usize {
        if hides_blows(scales) { 6 } else { 1 }
    }

    /// A fit converges from a gap that is right to a fifth, beside a load that is about right.
    fn neighbours(&self, start: &[f64]) -> Vec<Vec<f64>> {
        let scaled =
            |[gap, share]: [f64; 2]| [&[gap * start[0], (share * start[1]).min(MOST_SHARE)], &start[2..]].concat();
        [[1.2, 1.0], [1.0 / 1.2, 1.0], [1.0, 1.25], [1.0, 0.8]].map(scaled).to_vec()
    }

    /// Blows that are predicted a little too early or too late fit as badly as no blows. Where a blow falls within one row, a
    /// wrong gap beside a wrong load fits nearly as well.
    fn elsewhere(&self, values: &[f64], scales: &Scales) -> Vec<Vec<f64>> {
        let near = [0.9, 1.1].map(|factor| [&[factor * values[0]], &values[1..]].concat());
        if !hides_blows(scales) {
            return near.to_vec();
        }
        let gaps = [0.5, 0.7, 0.9, 1.1, 1.4].map(|factor| factor * values[0]);
        let shares = [0.7, 1.0, 1.4, 1.9].map(|factor| (factor * values[1]).min(MOST_SHARE));
        let sides = gaps.into_iter().flat_map(|gap| shares.map(|share| [gap, share]));
        let with_contacts = sides.flat_map(|sides| [HARD, SOFT].map(|contact| [sides, contact].concat()));
        near.into_iter().chain(with_contacts).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FRICTION_NM: f64 = 0.004;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]
        /// What a held motor and its load reach at once is what they reach in short parts. Where a flank is met, or the motor
        /// is not held, nothing is taken at once.
        #[test]
        fn a_held_motor_waits_as_in_short_parts(
            twist_rad in -0.06f64..0.06,
            load_rad_per_s in -200.0f64..200.0,
            drive_nm in -0.008f64..0.008,
            moves: bool,
        ) {
            let terms =
                Balance { dry_forward_nm: FRICTION_NM, dry_backward_nm: FRICTION_NM, ..Balance::default() };
            let speed = if moves { 1.0 } else { 0.0 };
            let values = [0.1, 0.4, HARD[0], HARD[1]];
            let begin = || Sides::new(&values, &MotorParameters::PIVT6, &[twist_rad, load_rad_per_s], speed);
            let (mut at_once, mut in_parts) = (begin(), begin());
            let waits = at_once.waits_in_the_gap(LONGEST_STEP_S, drive_nm, &terms);
            in_parts.in_parts(LONGEST_STEP_S, drive_nm, &terms);
            let later_rad = twist_rad - load_rad_per_s * LONGEST_STEP_S;
            let is_in_the_gap = twist_rad.abs() <= 0.05 && later_rad.abs() <= 0.05;
            prop_assert_eq!(waits, !moves && drive_nm.abs() <= FRICTION_NM && is_in_the_gap);
            if waits {
                prop_assert!((at_once.twist_rad - in_parts.twist_rad).abs() < 1e-12);
                prop_assert_eq!(at_once.load_rad_per_s, in_parts.load_rad_per_s);
                prop_assert_eq!((at_once.motor_rad_per_s, in_parts.motor_rad_per_s), (0.0, 0.0));
            } else {
                prop_assert_eq!(at_once.twist_rad, twist_rad);
            }
        }
    }
}
