//! A PWM period in which shaft and current keep their signs, as one linear map.

use super::super::Motion;
use super::Torques;
use super::course::Moving;
use motorbench_model::closed_form::{Matrix, Vector, apply, combine, dot, product, row_times};

/// Currents within a PWM period.
pub(super) struct Currents {
    /// At the end of the pulse.
    pub(super) pulse_a: f64,
    /// Where it is sampled.
    pub(super) sampled_a: f64,
}

/// What becomes of a state and of constant inputs in some time while both move.
#[derive(Clone, Copy, Debug)]
pub(super) struct Transition {
    pub(super) of_state: Matrix,
    pub(super) of_u: Matrix,
    /// What the constant inputs add to the angle; what the state adds is the first row of `of_u`.
    pub(super) turned_of_u: Vector,
}

impl Transition {
    pub(super) fn new(moving: &Moving, t: f64) -> Self {
        let weights = moving.both.weights(t);
        Self {
            of_state: combine(weights.exponential, &moving.a),
            of_u: combine(weights.integral, &moving.a),
            turned_of_u: combine(weights.second, &moving.a)[0],
        }
    }
}

/// What a PWM period makes of a state and of inputs while both move. Each in three parts: speed and current at the end
/// of the pulse, the same at the end of the period, and the angle turned with the sampled current.
#[derive(Clone, Copy, Debug)]
pub(super) struct Period {
    /// Pulse, start to sample, whole period.
    pub(super) lengths_s: [f64; 3],
    pub(super) of_state: [Matrix; 3],
    pub(super) of_torque: [Vector; 3],
    /// Of a voltage during the pulse, and during the rest.
    pub(super) of_voltages: [[Vector; 3]; 2],
}

impl Period {
    pub(super) fn new(moving: &Moving, lengths_s: [f64; 3]) -> Self {
        let [pulse_s, sampled_s, period_s] = lengths_s;
        let in_pulse = sampled_s < pulse_s;
        // To the sample from the last switching before it.
        let since_s = if in_pulse { sampled_s } else { sampled_s - pulse_s };
        let [pulse, rest, sampled] = [pulse_s, period_s - pulse_s, since_s].map(|t| Transition::new(moving, t));
        let of_inputs = |u_pulse: Vector, u_rest: Vector| {
            let middle = apply(&pulse.of_u, u_pulse);
            let end = [0, 1].map(|row| dot(rest.of_state[row], middle) + dot(rest.of_u[row], u_rest));
            let turned = dot(pulse.turned_of_u, u_pulse) + dot(rest.of_u[0], middle) + dot(rest.turned_of_u, u_rest);
            let sampled = if in_pulse {
                dot(sampled.of_u[1], u_pulse)
            } else {
                dot(sampled.of_state[1], middle) + dot(sampled.of_u[1], u_rest)
            };
            [middle, end, [turned, sampled]]
        };
        let turned_in_rest = row_times(rest.of_u[0], &pulse.of_state);
        let turned = [0, 1].map(|of| pulse.of_u[0][of] + turned_in_rest[of]);
        let at_sample = sampled.of_state[1];
        let at_sample = if in_pulse { at_sample } else { row_times(at_sample, &pulse.of_state) };
        let (torque, voltage) = ([moving.per_inertia, 0.0], [0.0, moving.per_inductance]);
        Self {
            lengths_s,
            of_state: [pulse.of_state, product(&rest.of_state, &pulse.of_state), [turned, at_sample]],
            of_torque: of_inputs(torque, torque),
            of_voltages: [of_inputs(voltage, [0.0; 2]), of_inputs([0.0; 2], voltage)],
        }
    }
}

/// A quantity after a part of a PWM period: factors of speed and current at its start and of the torque, and a
/// constant.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) of_state: Vector,
    pub(super) of_torque: f64,
    pub(super) constant: f64,
}

impl Row {
    #[inline(always)]
    pub(super) fn of(&self, state: &Motion, torque_nm: f64) -> f64 {
        let constant = self.constant + self.of_torque * torque_nm;
        self.of_state[0] * state.speed_rad_per_s + (self.of_state[1] * state.current_a + constant)
    }
}

/// A PWM period in which shaft and current keep their signs, as one linear map of the state at its start.
pub(super) struct Steady {
    /// Speed and current at the end of the pulse and of the period.
    pub(super) pulse: [Row; 2],
    pub(super) end: [Row; 2],
    /// Angle turned.
    pub(super) turned: Row,
    /// Current where it is sampled.
    pub(super) sampled: Row,
    /// Signs that speed and current must keep; 0 where it does not matter.
    pub(super) signs: Vector,
}

impl Steady {
    /// `voltages`: in the pulse, in the rest.
    pub(super) fn new(period: &Period, voltages: [f64; 2], signs: Vector) -> Self {
        let row = |part: usize, row: usize| Row {
            of_state: period.of_state[part][row],
            of_torque: period.of_torque[part][row],
            constant: period.of_voltages[0][part][row] * voltages[0] + period.of_voltages[1][part][row] * voltages[1],
        };
        Self {
            pulse: [row(0, 0), row(0, 1)],
            end: [row(1, 0), row(1, 1)],
            turned: row(2, 0),
            sampled: row(2, 1),
            signs,
        }
    }

    /// The state a period later and the currents within it, if the signs are kept.
    #[inline(always)]
    pub(super) fn next(&self, state: &Motion, torques: &Torques) -> Option<(Motion, Currents)> {
        let torque_nm = -torques.load_nm - self.signs[0] * torques.friction_nm;
        let end = self.end.map(|row| row.of(state, torque_nm));
        let pulse = self.pulse.map(|row| row.of(state, torque_nm));
        let kept =
            |of: usize| self.signs[of] == 0.0 || (self.signs[of] * pulse[of] > 0.0 && self.signs[of] * end[of] > 0.0);
        let next = Motion {
            speed_rad_per_s: end[0],
            current_a: end[1],
            angle_rad: state.angle_rad + self.turned.of(state, torque_nm),
        };
        let currents = Currents { pulse_a: pulse[1], sampled_a: self.sampled.of(state, torque_nm) };
        (kept(0) && kept(1)).then_some((next, currents))
    }
}
