//! A brush motor behind an L293D, solved in closed form between switching instants.
//!
//! ```text
//! L di/dt = e - d sign(i) - R i - k w        e: what the bridge connects, d: what the conducting devices drop
//! J dw/dt = k i - b w - c sign(w) - load     c: Coulomb friction
//! ```
//! Both sign terms hold their quantity at zero as long as they can: the diodes keep a current from starting in the wrong
//! direction, friction keeps the shaft from moving. Between the instants where one of them lets go or takes hold the
//! equations are linear with constant input and are solved exactly, so a short electrical time constant costs nothing.

use super::{Bridge, Inputs, Motion, Plant};

/// Longest stretch solved at once. Events inside it are found by the sign of what changed at its end, and within this
/// time nothing on a real motor changes its sign twice.
const LONGEST_STEP_S: f64 = 100e-6;
/// Bound on the changes of mode within one stretch; more would mean chattering without end.
const MAX_EVENTS: usize = 64;
/// How closely an event is located: a hundredth of a processor cycle.
const EVENT_TOLERANCE_S: f64 = 6e-10;
/// Bound on the steps for it.
const ROOT_STEPS: usize = 60;

/// Largest product of eigenvalue and time for the series below, and its terms' divisors: what follows is below 1e-16.
const SHORT: f64 = 0.05;
const SERIES: [(f64, f64); 6] = [
    (1.0 / 2.0, 1.0 / 3.0),
    (1.0 / 3.0, 1.0 / 4.0),
    (1.0 / 4.0, 1.0 / 5.0),
    (1.0 / 5.0, 1.0 / 6.0),
    (1.0 / 6.0, 1.0 / 7.0),
    (1.0 / 7.0, 1.0 / 8.0),
];

/// Voltages lost in the bridge, taken as constant while current flows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BridgeLosses {
    /// Upper plus lower transistor while driving, in volts.
    pub drive_v: f64,
    /// Transistor plus diode while braking, in volts.
    pub brake_v: f64,
    /// One free-wheeling diode, in volts.
    pub diode_v: f64,
}

impl BridgeLosses {
    /// Of a bridge whose transistors are counted to the motor, or lose nothing: the diodes are left.
    pub const DIODES: Self = Self { drive_v: 0.0, brake_v: 0.0, diode_v: 1.3 };
    /// L293D at 0.6 A, from its data sheet: V_CEsat 1.4 V above and 1.2 V below, diodes 1.3 V.
    pub const L293D: Self = Self { drive_v: 2.6, brake_v: 2.5, diode_v: 1.3 };
    /// A bridge without losses, for comparison with textbook formulas.
    pub const IDEAL: Self = Self { drive_v: 0.0, brake_v: 0.0, diode_v: 0.0 };

    /// The source `e` and the drop `d` of the circuit equation.
    #[inline]
    fn source_and_drop_v(&self, bridge: Bridge, supply_v: f64) -> (f64, f64) {
        match bridge {
            Bridge::Forward => (supply_v, self.drive_v),
            Bridge::Reverse => (-supply_v, self.drive_v),
            Bridge::Brake => (0.0, self.brake_v),
            Bridge::Coast => (0.0, supply_v + 2.0 * self.diode_v),
        }
    }
}

/// Constants of the motor, seen at its own shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DcMotorParameters {
    /// Armature resistance, positive.
    pub resistance_ohm: f64,
    /// Armature inductance, positive.
    pub inductance_h: f64,
    /// Torque constant, equal to the voltage constant in V s/rad; positive.
    pub torque_constant_nm_per_a: f64,
    /// Inertia of rotor and load, positive.
    pub inertia_kg_m2: f64,
    /// Viscous friction, not negative.
    pub viscous_friction_nms_per_rad: f64,
    /// Coulomb friction, also the torque it takes to break loose; not negative.
    pub coulomb_friction_nm: f64,
    /// Losses of the bridge.
    pub bridge: BridgeLosses,
}

impl DcMotorParameters {
    /// The PIVT-6 25/3A: electrical time constant 2 ms, mechanical 25 ms.
    pub const PIVT6: Self = Self {
        resistance_ohm: 5.84,
        inductance_h: 11.7e-3,
        torque_constant_nm_per_a: 0.072,
        inertia_kg_m2: 2.22e-5,
        viscous_friction_nms_per_rad: 5e-6,
        coulomb_friction_nm: 0.0,
        bridge: BridgeLosses::L293D,
    };
}

/// The motor and its state.
#[derive(Clone, Debug)]
pub struct DcMotor {
    parameters: DcMotorParameters,
    moving: Moving,
    /// For the lengths of the parts of PWM periods with and without a sample in them, used in turn.
    transitions: [Transition; 4],
    state: State,
    supply_v: f64,
}

#[derive(Clone, Copy, Debug, Default)]
struct State {
    speed_rad_per_s: f64,
    current_a: f64,
    angle_rad: f64,
}

impl DcMotor {
    /// A motor at rest.
    ///
    /// # Panics
    /// If a parameter that has to be positive is not.
    pub fn new(parameters: DcMotorParameters) -> Self {
        let DcMotorParameters { resistance_ohm, inductance_h, torque_constant_nm_per_a, inertia_kg_m2, .. } =
            parameters;
        for (name, value) in [
            ("resistance_ohm", resistance_ohm),
            ("inductance_h", inductance_h),
            ("torque_constant_nm_per_a", torque_constant_nm_per_a),
            ("inertia_kg_m2", inertia_kg_m2),
        ] {
            assert!(value > 0.0, "{name} must be positive, not {value}");
        }
        let moving = Moving::new(&parameters);
        Self { parameters, moving, transitions: [moving.transition(0.0); 4], state: State::default(), supply_v: 0.0 }
    }

    /// The constants it was made with.
    pub fn parameters(&self) -> &DcMotorParameters {
        &self.parameters
    }

    /// Sets the shaft turning, as an outside drive would.
    pub fn set_speed_rad_per_s(&mut self, speed_rad_per_s: f64) {
        self.state.speed_rad_per_s = speed_rad_per_s;
    }

    /// Sets it moving.
    pub fn set_motion(&mut self, Motion { angle_rad, speed_rad_per_s, current_a }: Motion) {
        self.state = State { speed_rad_per_s, current_a, angle_rad };
    }

    /// Advances through one stretch, from event to event.
    fn stretch(&mut self, dt_s: f64, inputs: &Inputs) {
        let mut left_s = dt_s;
        for _ in 0..MAX_EVENTS {
            let mode = Mode::of(&self.parameters, &self.state, inputs);
            let end = self.solve_whole(&mode, left_s);
            let margin = mode.margin(&self.parameters, &end);
            if margin >= 0.0 {
                self.state = end;
                return;
            }
            let event_s = self.event_s(&mode, left_s, margin);
            self.state = mode.hold(self.solve(&mode, event_s));
            left_s -= event_s;
        }
    }

    /// When the margin becomes negative, given that it is `end_margin` after `end_s`; the returned instant is just
    /// beyond. Newton's method, kept within the bracket.
    fn event_s(&self, mode: &Mode, end_s: f64, end_margin: f64) -> f64 {
        let start_margin = mode.margin(&self.parameters, &self.state).max(0.0);
        let (mut inside_s, mut beyond_s) = (0.0, end_s);
        let mut t = end_s * start_margin / (start_margin - end_margin);
        for _ in 0..ROOT_STEPS {
            // Away from either end, so that a root close to one end is enclosed at once.
            t = t.clamp(inside_s + 0.5 * EVENT_TOLERANCE_S, beyond_s - 0.5 * EVENT_TOLERANCE_S);
            let state = self.solve(mode, t);
            let margin = mode.margin(&self.parameters, &state);
            if margin >= 0.0 {
                inside_s = t;
            } else {
                beyond_s = t;
            }
            if beyond_s - inside_s < EVENT_TOLERANCE_S {
                break;
            }
            let slope = self.margin_slope(mode, &state);
            let newton_s = t - margin / slope;
            let enclosed = newton_s > inside_s && newton_s < beyond_s;
            // Just beyond the root, and then just inside it.
            let aside_s = if margin >= 0.0 { 0.4 * EVENT_TOLERANCE_S } else { -0.4 * EVENT_TOLERANCE_S };
            t = if enclosed { newton_s + aside_s } else { 0.5 * (inside_s + beyond_s) };
        }
        beyond_s
    }

    /// Rate of the margin: the negative one where both change.
    fn margin_slope(&self, mode: &Mode, state: &State) -> f64 {
        const STEP_S: f64 = 1e-9;
        let (p, u) = (&self.parameters, self.rates(mode));
        let a = &self.moving.a;
        let x = [state.speed_rad_per_s, state.current_a];
        let rate =
            |row: usize, moves: f64| if moves == 0.0 { 0.0 } else { a[row][0] * x[0] + a[row][1] * x[1] + u[row] };
        let later = State {
            speed_rad_per_s: x[0] + STEP_S * rate(0, mode.speed),
            current_a: x[1] + STEP_S * rate(1, mode.current),
            ..*state
        };
        (mode.margin(p, &later) - mode.margin(p, state)) / STEP_S
    }

    /// The end of a stretch in which shaft and current keep their signs, if it is one.
    #[inline(always)]
    fn undisturbed(&mut self, start: State, t: f64, bridge: Bridge, inputs: &Inputs) -> Option<State> {
        let (w, i, p) = (start.speed_rad_per_s, start.current_a, &self.parameters);
        if inputs.blocked || t > LONGEST_STEP_S || w == 0.0 {
            return None;
        }
        let (source_v, drop_v) = p.bridge.source_and_drop_v(bridge, inputs.supply_v);
        let friction_nm = p.coulomb_friction_nm.copysign(w);
        // From zero the current flows as it is driven, if it is driven at all.
        let drive_v = source_v - p.torque_constant_nm_per_a * w;
        let flow = if i != 0.0 { i } else { drive_v };
        if i == 0.0 && drive_v.abs() <= drop_v {
            return None;
        }
        let u = [
            (-inputs.load_torque_nm - friction_nm) * self.moving.per_inertia,
            (source_v - drop_v.copysign(flow)) * self.moving.per_inductance,
        ];
        let transition = self.transition(t);
        let end = self.transitions[transition].apply(&u, &start);
        let keeps = |before: f64, after: f64, term: f64| term == 0.0 || before * after > 0.0;
        let undisturbed = keeps(flow, end.current_a, drop_v) && keeps(w, end.speed_rad_per_s, friction_nm);
        undisturbed.then_some(end)
    }

    /// Advances from event to event.
    #[inline(never)]
    fn eventful(&mut self, dt_s: f64, inputs: &Inputs) {
        if inputs.blocked {
            self.state.speed_rad_per_s = 0.0;
        }
        let mut left_s = dt_s;
        while left_s > 0.0 {
            self.stretch(left_s.min(LONGEST_STEP_S), inputs);
            left_s -= LONGEST_STEP_S;
        }
    }

    /// The state at the end of a stretch if the mode does not change.
    fn solve_whole(&mut self, mode: &Mode, t: f64) -> State {
        // Other lengths than those of whole parts of a PWM period do not come again.
        match self.transitions.iter().find(|kept| kept.t == t) {
            Some(kept) if mode.speed != 0.0 && mode.current != 0.0 => kept.apply(&self.rates(mode), &self.state),
            _ => self.solve(mode, t),
        }
    }

    /// Constant part of the rates of speed and current.
    fn rates(&self, mode: &Mode) -> [f64; 2] {
        let voltage_v = mode.source_v - mode.current * mode.drop_v;
        let torque_nm = -mode.load_torque_nm - mode.speed * self.parameters.coulomb_friction_nm;
        [torque_nm * self.moving.per_inertia, voltage_v * self.moving.per_inductance]
    }

    /// Where the transition of this length is kept: the lengths of a PWM period's parts come again and again.
    #[inline]
    fn transition(&mut self, t: f64) -> usize {
        match self.transitions.iter().position(|kept| kept.t == t) {
            Some(index) => index,
            None => self.new_transition(t),
        }
    }

    #[cold]
    fn new_transition(&mut self, t: f64) -> usize {
        self.transitions.rotate_right(1);
        self.transitions[0] = self.moving.transition(t);
        0
    }

    /// The state `t` seconds later if the mode does not change.
    fn solve(&self, mode: &Mode, t: f64) -> State {
        let (p, start, u) = (&self.parameters, &self.state, self.rates(mode));
        match (mode.speed != 0.0, mode.current != 0.0) {
            (true, true) if self.moving.is_short(t) => self.moving.series(&u, start, t),
            (true, true) => self.moving.transition(t).apply(&u, start),
            (true, false) => {
                let decay = p.viscous_friction_nms_per_rad * self.moving.per_inertia;
                let (speed_rad_per_s, turned_rad) = first_order(decay, u[0], start.speed_rad_per_s, t);
                State { angle_rad: start.angle_rad + turned_rad, speed_rad_per_s, current_a: 0.0 }
            }
            (false, true) => {
                let (current_a, _) =
                    first_order(p.resistance_ohm * self.moving.per_inductance, u[1], start.current_a, t);
                State { angle_rad: start.angle_rad, speed_rad_per_s: 0.0, current_a }
            }
            (false, false) => State { angle_rad: start.angle_rad, speed_rad_per_s: 0.0, current_a: 0.0 },
        }
    }
}

impl Default for DcMotor {
    fn default() -> Self {
        Self::new(DcMotorParameters::PIVT6)
    }
}

impl Plant for DcMotor {
    fn advance(&mut self, dt_s: f64, inputs: &Inputs) {
        self.supply_v = inputs.supply_v;
        match self.undisturbed(self.state, dt_s, inputs.bridge, inputs) {
            Some(end) => self.state = end,
            None => self.eventful(dt_s, inputs),
        }
    }

    fn advance_switched(&mut self, parts: [(Bridge, f64); 2], inputs: &Inputs) {
        self.supply_v = inputs.supply_v;
        // The state stays in registers as long as nothing happens.
        let mut state = self.state;
        for (bridge, dt_s) in parts.into_iter().filter(|(_, dt_s)| *dt_s > 0.0) {
            state = match self.undisturbed(state, dt_s, bridge, inputs) {
                Some(end) => end,
                None => {
                    self.state = state;
                    self.eventful(dt_s, &Inputs { bridge, ..*inputs });
                    self.state
                }
            };
        }
        self.state = state;
    }

    fn angle_rad(&self) -> f64 {
        self.state.angle_rad
    }

    fn speed_rad_per_s(&self) -> f64 {
        self.state.speed_rad_per_s
    }

    fn current_a(&self) -> f64 {
        self.state.current_a
    }

    fn supply_v(&self) -> f64 {
        self.supply_v
    }
}

/// Which of the two sign terms hold their quantity at zero, and the constant inputs otherwise.
struct Mode {
    /// Sign of the current; 0 while the diodes hold it at zero.
    current: f64,
    /// Sign of the speed; 0 while friction holds the shaft.
    speed: f64,
    source_v: f64,
    drop_v: f64,
    load_torque_nm: f64,
    blocked: bool,
}

impl Mode {
    fn of(p: &DcMotorParameters, state: &State, inputs: &Inputs) -> Self {
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
    fn margin(&self, p: &DcMotorParameters, state: &State) -> f64 {
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
        current.min(speed)
    }

    /// Puts what has just crossed zero exactly there, so that the next mode can hold it.
    fn hold(&self, mut state: State) -> State {
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
fn direction(value: f64, drive: f64, hold: f64) -> f64 {
    if value != 0.0 {
        value.signum()
    } else if drive.abs() > hold || hold == 0.0 {
        drive.signum()
    } else {
        0.0
    }
}

/// `x' = u - a x`: the value after `t` and its integral.
fn first_order(a: f64, u: f64, x: f64, t: f64) -> (f64, f64) {
    let (z, slope) = (-a * t, u - a * x);
    let phi1 = if z.abs() < 1e-8 { 1.0 + z / 2.0 } else { z.exp_m1() / z };
    // The quotient loses digits for small arguments, where the series has long converged.
    let phi2 = if z.abs() < 1e-4 { 0.5 + z / 6.0 + z * z / 24.0 } else { (phi1 - 1.0) / z };
    (x + slope * t * phi1, x * t + slope * t * t * phi2)
}

type Matrix = [[f64; 2]; 2];

/// `x' = A x + u` with `x` = (speed, current), by the exponential of the 2x2 matrix.
#[derive(Clone, Copy, Debug)]
struct Moving {
    per_inertia: f64,
    per_inductance: f64,
    a: Matrix,
    inverse: Matrix,
    /// Mean of the eigenvalues.
    mean: f64,
    /// Half their distance: real if `oscillating` is false, otherwise imaginary.
    half_distance: f64,
    oscillating: bool,
}

impl Moving {
    fn new(p: &DcMotorParameters) -> Self {
        let (l, j, k) = (p.inductance_h, p.inertia_kg_m2, p.torque_constant_nm_per_a);
        let a = [[-p.viscous_friction_nms_per_rad / j, k / j], [-k / l, -p.resistance_ohm / l]];
        let determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0];
        let mean = 0.5 * (a[0][0] + a[1][1]);
        let discriminant = mean * mean - determinant;
        Self {
            per_inertia: j.recip(),
            per_inductance: l.recip(),
            a,
            inverse: [[a[1][1] / determinant, -a[0][1] / determinant], [-a[1][0] / determinant, a[0][0] / determinant]],
            mean,
            half_distance: discriminant.abs().sqrt(),
            oscillating: discriminant < 0.0,
        }
    }

    /// Whether [`series`](Self::series) is exact to the last digits.
    fn is_short(&self, t: f64) -> bool {
        (self.half_distance - self.mean) * t < SHORT
    }

    /// The state after a short time by Taylor's series, which for a single state is cheaper than the exponential.
    fn series(&self, u: &[f64; 2], start: &State, t: f64) -> State {
        let (a, x) = (&self.a, [start.speed_rad_per_s, start.current_a]);
        let mut term = [(a[0][0] * x[0] + a[0][1] * x[1] + u[0]) * t, (a[1][0] * x[0] + a[1][1] * x[1] + u[1]) * t];
        let mut end = State {
            speed_rad_per_s: x[0] + term[0],
            current_a: x[1] + term[1],
            angle_rad: start.angle_rad + t * (x[0] + 0.5 * term[0]),
        };
        for (over, over_next) in SERIES {
            let step = t * over;
            term = [(a[0][0] * term[0] + a[0][1] * term[1]) * step, (a[1][0] * term[0] + a[1][1] * term[1]) * step];
            end.speed_rad_per_s += term[0];
            end.current_a += term[1];
            end.angle_rad += t * over_next * term[0];
        }
        end
    }

    fn transition(&self, t: f64) -> Transition {
        let e = self.exponential(t);
        let once = times(&self.inverse, &[[e[0][0] - 1.0, e[0][1]], [e[1][0], e[1][1] - 1.0]]);
        let twice = times(&self.inverse, &[[once[0][0] - t, once[0][1]], [once[1][0], once[1][1] - t]]);
        let column = |of: &Matrix, index: usize| [of[0][index], of[1][index]];
        Transition {
            t,
            of_speed: column(&e, 0),
            of_current: column(&e, 1),
            of_u: [column(&once, 0), column(&once, 1)],
            turned_of_current: once[0][1],
            turned_of_u: twice[0],
        }
    }

    /// `exp(A t)` for real, double or complex eigenvalues.
    fn exponential(&self, t: f64) -> Matrix {
        let (m, s, a) = (self.mean, self.half_distance, &self.a);
        let (cosine, sine_over_s) = if s * t < 1e-6 {
            let scale = (m * t).exp();
            (scale, scale * t)
        } else if self.oscillating {
            let (scale, (sine, cosine)) = ((m * t).exp(), (s * t).sin_cos());
            (scale * cosine, scale * sine / s)
        } else {
            let (slow, fast) = (((m + s) * t).exp(), ((m - s) * t).exp());
            (0.5 * (slow + fast), 0.5 * (slow - fast) / s)
        };
        [
            [cosine + sine_over_s * (a[0][0] - m), sine_over_s * a[0][1]],
            [sine_over_s * a[1][0], cosine + sine_over_s * (a[1][1] - m)],
        ]
    }
}

/// What becomes of a state and of constant inputs in `t` seconds.
#[derive(Clone, Copy, Debug)]
struct Transition {
    t: f64,
    /// Columns of the exponential, what speed and current at the start become.
    of_speed: [f64; 2],
    of_current: [f64; 2],
    /// Columns of its integral, what the constant inputs become; its first row is the angle turned.
    of_u: Matrix,
    turned_of_current: f64,
    /// First row of the integral of that, for the angle.
    turned_of_u: [f64; 2],
}

impl Transition {
    #[inline(always)]
    fn apply(&self, u: &[f64; 2], start: &State) -> State {
        let (w, i) = (start.speed_rad_per_s, start.current_a);
        let next = |row: usize| {
            self.of_speed[row] * w + self.of_current[row] * i + (self.of_u[0][row] * u[0] + self.of_u[1][row] * u[1])
        };
        let turned = self.of_u[0][0] * w + self.turned_of_current * i;
        State {
            speed_rad_per_s: next(0),
            current_a: next(1),
            angle_rad: start.angle_rad + (turned + (self.turned_of_u[0] * u[0] + self.turned_of_u[1] * u[1])),
        }
    }
}

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    let cell = |r: usize, c: usize| a[r][0] * b[0][c] + a[r][1] * b[1][c];
    [[cell(0, 0), cell(0, 1)], [cell(1, 0), cell(1, 1)]]
}

#[cfg(test)]
mod tests {
    use super::*;

    const IDEAL: DcMotorParameters = DcMotorParameters { bridge: BridgeLosses::IDEAL, ..DcMotorParameters::PIVT6 };
    const WITH_FRICTION: DcMotorParameters =
        DcMotorParameters { coulomb_friction_nm: 0.01, viscous_friction_nms_per_rad: 0.0, ..IDEAL };

    fn inputs(bridge: Bridge) -> Inputs {
        Inputs { bridge, ..Inputs::default() }
    }

    fn after(parameters: DcMotorParameters, dt_s: f64, inputs: &Inputs) -> DcMotor {
        let mut motor = DcMotor::new(parameters);
        motor.advance(dt_s, inputs);
        motor
    }

    /// The equations of the ideal bridge again, by many small steps of the classical Runge-Kutta method.
    fn runge_kutta(p: &DcMotorParameters, voltage_v: f64, dt_s: f64, steps: u32) -> [f64; 3] {
        let slope = |x: [f64; 3]| {
            let current = (voltage_v - p.resistance_ohm * x[2] - p.torque_constant_nm_per_a * x[1]) / p.inductance_h;
            let torque = p.torque_constant_nm_per_a * x[2] - p.viscous_friction_nms_per_rad * x[1];
            [x[1], torque / p.inertia_kg_m2, current]
        };
        let ahead = |x: [f64; 3], d: [f64; 3], h: f64| std::array::from_fn(|i| x[i] + h * d[i]);
        let h = dt_s / f64::from(steps);
        (0..steps).fold([0.0; 3], |x, _| {
            let a = slope(x);
            let b = slope(ahead(x, a, h / 2.0));
            let c = slope(ahead(x, b, h / 2.0));
            let d = slope(ahead(x, c, h));
            std::array::from_fn(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]))
        })
    }

    fn assert_close(motor: &DcMotor, expected: [f64; 3]) {
        for (value, expected) in [motor.angle_rad(), motor.speed_rad_per_s(), motor.current_a()].iter().zip(expected) {
            assert!((value - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{motor:?} instead of {expected}");
        }
    }

    #[test]
    fn agrees_with_runge_kutta_for_real_and_complex_eigenvalues() {
        let oscillating = DcMotorParameters { inertia_kg_m2: 2e-6, ..IDEAL };
        for parameters in [IDEAL, oscillating] {
            let motor = after(parameters, 0.03, &inputs(Bridge::Forward));
            assert_close(&motor, runge_kutta(&parameters, 12.0, 0.03, 20_000));
        }
    }

    #[test]
    fn many_short_steps_are_one_long_step() {
        let one = after(DcMotorParameters::PIVT6, 0.02, &inputs(Bridge::Forward));
        let mut many = DcMotor::default();
        (0..320_000).for_each(|_| many.advance(62.5e-9, &inputs(Bridge::Forward)));
        let expected = [one.angle_rad(), one.speed_rad_per_s(), one.current_a()];
        for (value, expected) in [many.angle_rad(), many.speed_rad_per_s(), many.current_a()].iter().zip(expected) {
            assert!((value - expected).abs() < 1e-8 * expected.abs(), "{value} {expected}");
        }
    }

    #[test]
    fn an_electrical_time_constant_of_a_microsecond_is_no_difficulty() {
        let stiff = DcMotorParameters { inductance_h: 5.84e-6, ..IDEAL };
        let motor = after(stiff, 0.025, &inputs(Bridge::Forward));
        // Then the speed rises with J R / k^2 alone.
        let k = IDEAL.torque_constant_nm_per_a;
        let damping = k * k / IDEAL.resistance_ohm + IDEAL.viscous_friction_nms_per_rad;
        let end = k * 12.0 / IDEAL.resistance_ohm / damping;
        let expected = end * (1.0 - (-0.025 * damping / IDEAL.inertia_kg_m2).exp());
        assert!((motor.speed_rad_per_s() / expected - 1.0).abs() < 1e-3, "{motor:?} {expected}");
    }

    #[test]
    fn reaches_the_speed_of_the_balance_of_torques() {
        let loaded = Inputs { load_torque_nm: -0.02, ..inputs(Bridge::Reverse) };
        let motor = after(DcMotorParameters::PIVT6, 1.0, &loaded);
        let p = DcMotorParameters::PIVT6;
        let (k, r, b) = (p.torque_constant_nm_per_a, p.resistance_ohm, p.viscous_friction_nms_per_rad);
        // The load works against this direction. Driving loses 2.6 V as long as the current flows in the driving direction.
        let speed = (-(12.0 - 2.6) * k / r + 0.02) / (b + k * k / r);
        assert!((motor.speed_rad_per_s() - speed).abs() < 1e-6, "{motor:?} {speed}");
        assert!((motor.current_a() - (b * speed - 0.02) / k).abs() < 1e-6);
    }

    #[test]
    fn friction_holds_until_the_torque_exceeds_it() {
        let below = Inputs { supply_v: 0.8, ..inputs(Bridge::Forward) };
        let motor = after(WITH_FRICTION, 1.0, &below);
        assert_eq!((motor.speed_rad_per_s(), motor.angle_rad()), (0.0, 0.0));
        assert!((motor.current_a() - 0.8 / 5.84).abs() < 1e-9);
        let above = Inputs { supply_v: 0.82, ..below };
        assert!(after(WITH_FRICTION, 1.0, &above).angle_rad() > 0.0);
    }

    #[test]
    fn break_away_comes_at_its_exact_time() {
        // i(t) = V / R (1 - exp(-t R / L)) reaches c / k.
        let current_a = WITH_FRICTION.coulomb_friction_nm / WITH_FRICTION.torque_constant_nm_per_a;
        let time_s = -11.7e-3 / 5.84 * (1.0 - current_a * 5.84 / 12.0_f64).ln();
        let drive = inputs(Bridge::Forward);
        assert_eq!(after(WITH_FRICTION, time_s - 2e-9, &drive).speed_rad_per_s(), 0.0);
        assert!(after(WITH_FRICTION, time_s + 2e-7, &drive).speed_rad_per_s() > 0.0);
    }

    #[test]
    fn friction_stops_the_shaft_for_good() {
        let mut motor = DcMotor::new(WITH_FRICTION);
        motor.set_speed_rad_per_s(45.0);
        // Open circuit: 0.01 Nm stop 45 rad/s in J w / c.
        let time_s = 2.22e-5 * 45.0 / 0.01;
        motor.advance(time_s * 0.999, &inputs(Bridge::Coast));
        assert!(motor.speed_rad_per_s() > 0.0);
        motor.advance(time_s * 0.002, &inputs(Bridge::Coast));
        assert_eq!(motor.speed_rad_per_s(), 0.0);
        assert!((motor.angle_rad() - 45.0 * time_s / 2.0).abs() < 1e-9);
    }

    #[test]
    fn braking_stops_faster_than_coasting() {
        let run_out = |bridge| {
            let mut motor = DcMotor::new(IDEAL);
            motor.set_speed_rad_per_s(100.0);
            motor.advance(0.03, &inputs(bridge));
            motor
        };
        let (coasting, braking) = (run_out(Bridge::Coast), run_out(Bridge::Brake));
        assert_eq!(coasting.current_a(), 0.0, "open circuit");
        assert!((coasting.speed_rad_per_s() - 100.0 * (-5e-6 / 2.22e-5 * 0.03_f64).exp()).abs() < 1e-9);
        assert!(braking.speed_rad_per_s() < 40.0 && braking.current_a() < 0.0);
    }

    #[test]
    fn coasting_current_flows_back_into_the_supply_and_stops_at_zero() {
        let mut motor = after(DcMotorParameters::PIVT6, 0.002, &inputs(Bridge::Forward));
        let current_a = motor.current_a();
        // About L i / (supply + diodes + R i / 2): half a millisecond; meanwhile the speed hardly changes.
        let against_v = 12.0 + 2.6 + 0.072 * motor.speed_rad_per_s();
        let zero_s = 11.7e-3 / 5.84 * (1.0 + current_a * 5.84 / against_v).ln();
        motor.advance(zero_s * 0.95, &inputs(Bridge::Coast));
        assert!(motor.current_a() > 0.0);
        motor.advance(zero_s * 0.10, &inputs(Bridge::Coast));
        assert_eq!(motor.current_a(), 0.0);
        motor.advance(0.01, &inputs(Bridge::Coast));
        assert_eq!(motor.current_a(), 0.0);
    }

    #[test]
    fn blocked_rotor_draws_the_stall_current() {
        let blocked = Inputs { blocked: true, ..inputs(Bridge::Forward) };
        let motor = after(DcMotorParameters::PIVT6, 0.1, &blocked);
        assert!((motor.current_a() - (12.0 - 2.6) / 5.84).abs() < 1e-9);
        assert_eq!((motor.angle_rad(), motor.speed_rad_per_s()), (0.0, 0.0));
    }

    #[test]
    fn energy_is_conserved() {
        // Supply energy = heat + kinetic + magnetic energy, summed over short steps.
        let mut motor = DcMotor::new(IDEAL);
        let (mut supplied_j, mut heat_j) = (0.0, 0.0);
        let dt_s = 1e-6;
        for _ in 0..50_000 {
            let before = (motor.current_a(), motor.speed_rad_per_s());
            motor.advance(dt_s, &inputs(Bridge::Forward));
            let (current, speed) = (0.5 * (before.0 + motor.current_a()), 0.5 * (before.1 + motor.speed_rad_per_s()));
            supplied_j += 12.0 * current * dt_s;
            heat_j += (5.84 * current * current + 5e-6 * speed * speed) * dt_s;
        }
        let stored_j = 0.5 * 2.22e-5 * motor.speed_rad_per_s().powi(2) + 0.5 * 11.7e-3 * motor.current_a().powi(2);
        assert!((supplied_j - heat_j - stored_j).abs() < 1e-6 * supplied_j, "{supplied_j} {heat_j} {stored_j}");
    }
}
