//! The way of the state between two events: which signs hold, how long they hold, and the closed form meanwhile.

use super::super::{Inputs, Motion};
use super::DcMotorParameters;
use motorbench_model::closed_form::{Family, Matrix, Vector, apply};

/// A sample of the current on the way.
pub(super) struct CurrentSample {
    /// From now on.
    pub(super) in_s: f64,
    pub(super) current_a: f64,
}

impl CurrentSample {
    /// Passes a part of the way, at its end included.
    #[inline]
    pub(super) fn pass(&mut self, course: &Course, dt_s: f64) {
        if (0.0..=dt_s).contains(&self.in_s) {
            self.current_a = if course.holds_current() { 0.0 } else { course.at(self.in_s).0.current_a };
        }
        self.in_s -= dt_s;
    }
}

/// Which of the two sign terms hold their quantity at zero, and the constant inputs otherwise.
pub(super) struct Mode {
    /// Sign of the current; 0 while the diodes hold it at zero.
    pub(super) current: f64,
    /// Sign of the speed; 0 while friction holds the shaft.
    pub(super) speed: f64,
    pub(super) source_v: f64,
    pub(super) drop_v: f64,
    pub(super) load_torque_nm: f64,
    pub(super) blocked: bool,
}

impl Mode {
    pub(super) fn of(p: &DcMotorParameters, state: &Motion, inputs: &Inputs) -> Self {
        let (source_v, drop_v) = p.bridge.source_and_drop_v(inputs.bridge, inputs.supply_v);
        let open_v = source_v - p.torque_constant_nm_per_a * state.speed_rad_per_s;
        let free_nm = p.torque_constant_nm_per_a * state.current_a - inputs.load_torque_nm;
        let speed = match inputs.blocked {
            true => 0.0,
            false => direction(state.speed_rad_per_s, free_nm, p.coulomb_friction_nm),
        };
        Self {
            current: direction(state.current_a, open_v, drop_v),
            speed,
            source_v,
            drop_v,
            load_torque_nm: inputs.load_torque_nm,
            blocked: inputs.blocked,
        }
    }

    /// Not negative as long as the state still belongs to this mode.
    pub(super) fn margin(&self, p: &DcMotorParameters, state: &Motion) -> f64 {
        let [current, speed] = self.margins(p, state);
        current.min(speed)
    }

    /// Margin of the current, margin of the speed.
    pub(super) fn margins(&self, p: &DcMotorParameters, state: &Motion) -> [f64; 2] {
        let current = if self.current != 0.0 {
            if self.drop_v > 0.0 { self.current * state.current_a } else { f64::INFINITY }
        } else {
            self.drop_v - (self.source_v - p.torque_constant_nm_per_a * state.speed_rad_per_s).abs()
        };
        let speed = if self.speed != 0.0 {
            if p.coulomb_friction_nm > 0.0 { self.speed * state.speed_rad_per_s } else { f64::INFINITY }
        } else if self.blocked {
            f64::INFINITY
        } else {
            p.coulomb_friction_nm - (p.torque_constant_nm_per_a * state.current_a - self.load_torque_nm).abs()
        };
        [current, speed]
    }

    /// Rate of the margin, with the rates of speed and current: of the lesser one.
    pub(super) fn margin_slope(&self, p: &DcMotorParameters, state: &Motion, rate: Vector) -> f64 {
        let [current, speed] = self.margins(p, state);
        let k = p.torque_constant_nm_per_a;
        if current <= speed {
            let open_v = self.source_v - k * state.speed_rad_per_s;
            if self.current != 0.0 { self.current * rate[1] } else { open_v.signum() * k * rate[0] }
        } else {
            let free_nm = k * state.current_a - self.load_torque_nm;
            if self.speed != 0.0 { self.speed * rate[0] } else { -free_nm.signum() * k * rate[1] }
        }
    }

    /// Puts what has just crossed zero exactly there, so that the next mode can hold it.
    pub(super) fn hold(&self, mut state: Motion) -> Motion {
        if self.current * state.current_a < 0.0 {
            state.current_a = 0.0;
        }
        if self.speed * state.speed_rad_per_s < 0.0 {
            state.speed_rad_per_s = 0.0;
        }
        state
    }
}

/// The sign in which a quantity moves: its own, or that of what drives it from zero, or 0 if `hold` resists that.
pub(super) fn direction(value: f64, drive: f64, hold: f64) -> f64 {
    if value != 0.0 {
        value.signum()
    } else if drive.abs() > hold || hold == 0.0 {
        drive.signum()
    } else {
        0.0
    }
}

/// The first root of a margin between 0 and `end_s`. The parabola has the value and slope of the margin at the start,
/// and its value at the end, which is negative.
pub(super) fn parabola_root(start: f64, slope: f64, end_s: f64, end: f64) -> f64 {
    let bend = (end - start - slope * end_s) / (end_s * end_s);
    let root = (slope * slope - 4.0 * bend * start).max(0.0).sqrt();
    if slope > 0.0 { -0.5 * (slope + root) / bend } else { 2.0 * start / (root - slope).max(f64::MIN_POSITIVE) }
}

/// `x' = A x + u` with `x` = (speed, current).
#[derive(Clone, Copy, Debug)]
pub(super) struct Moving {
    pub(super) per_inertia: f64,
    pub(super) per_inductance: f64,
    pub(super) a: Matrix,
    /// Both move; the current is held at zero; the shaft is held.
    pub(super) both: Family,
    pub(super) speed_alone: Family,
    pub(super) current_alone: Family,
}

impl Moving {
    pub(super) fn new(p: &DcMotorParameters) -> Self {
        let (l, j, k) = (p.inductance_h, p.inertia_kg_m2, p.torque_constant_nm_per_a);
        let a = [[-p.viscous_friction_nms_per_rad / j, k / j], [-k / l, -p.resistance_ohm / l]];
        Self {
            per_inertia: j.recip(),
            per_inductance: l.recip(),
            a,
            both: Family::new(a[0][0] + a[1][1], a[0][0] * a[1][1] - a[0][1] * a[1][0]),
            speed_alone: Family::new(a[0][0], 0.0),
            current_alone: Family::new(a[1][1], 0.0),
        }
    }
}

/// The way from a state on as long as its mode does not change.
pub(super) struct Course<'a> {
    pub(super) start: Motion,
    /// Rates of speed and current at the start, and what A makes of them.
    pub(super) rate: Vector,
    pub(super) bend: Vector,
    pub(super) family: &'a Family,
}

impl<'a> Course<'a> {
    pub(super) fn new(moving: &'a Moving, mode: &Mode, start: Motion, u: Vector) -> Self {
        let (speed, current) = (mode.speed != 0.0, mode.current != 0.0);
        // What is held is zero, and so is its rate.
        let start = Motion {
            speed_rad_per_s: if speed { start.speed_rad_per_s } else { 0.0 },
            current_a: if current { start.current_a } else { 0.0 },
            ..start
        };
        let masked = |x: Vector| [if speed { x[0] } else { 0.0 }, if current { x[1] } else { 0.0 }];
        let of_state = apply(&moving.a, [start.speed_rad_per_s, start.current_a]);
        let rate = masked([of_state[0] + u[0], of_state[1] + u[1]]);
        let family = match (speed, current) {
            (true, true) => &moving.both,
            (true, false) => &moving.speed_alone,
            (false, _) => &moving.current_alone,
        };
        Self { start, rate, bend: masked(apply(&moving.a, rate)), family }
    }

    /// Whether the current stays at zero.
    pub(super) fn holds_current(&self) -> bool {
        self.start.current_a == 0.0 && self.rate[1] == 0.0 && self.bend[1] == 0.0
    }

    /// The state after `t`, and the rates of speed and current then.
    #[inline]
    pub(super) fn at(&self, t: f64) -> (Motion, Vector) {
        let weights = self.family.weights(t);
        let of = |weights: Vector, index: usize| weights[0] * self.rate[index] + weights[1] * self.bend[index];
        let state = Motion {
            speed_rad_per_s: self.start.speed_rad_per_s + of(weights.integral, 0),
            current_a: self.start.current_a + of(weights.integral, 1),
            angle_rad: self.start.angle_rad + (self.start.speed_rad_per_s * t + of(weights.second, 0)),
        };
        (state, [of(weights.exponential, 0), of(weights.exponential, 1)])
    }
}
