//! A brush motor behind an L293D, solved in closed form between switching instants.
//!
//! ```text
//! L di/dt = e - d sign(i) - R i - k w        e: what the bridge connects, d: what the conducting devices drop
//! J dw/dt = k i - b w - c sign(w) - load     c: Coulomb friction
//! ``` Both sign terms hold their quantity at zero as long as they can. The diodes keep a current from starting in the
//! wrong direction; friction keeps the shaft from moving. Between the instants where one of them lets go or takes hold,
//! the equations are linear with constant input. They are solved exactly, so a short electrical time constant costs
//! nothing.
//!
//! PWM periods in which neither sign changes are steps of one linear map ([`Steady`]); only the others are searched for
//! events.

mod course;
mod period;

use super::{Bridge, Inputs, Motion, PeriodEnd, Plant, Pwm};
use course::{Course, CurrentSample, Mode, Moving, parabola_root};
use motorbench_model::closed_form::Vector;
use period::{Period, Steady};

/// Longest stretch solved at once. Events inside it are found by the sign of what changed at its end. Within this time
/// nothing on a real motor changes its sign twice.
const LONGEST_STEP_S: f64 = 100e-6;
/// Bound on the changes of mode within one stretch; more would mean chattering without end.
const MAX_EVENTS: usize = 64;
/// How closely an event is located: a hundredth of a processor cycle.
const EVENT_TOLERANCE_S: f64 = 6e-10;
/// How far beyond the expected instant it is looked for.
const BEYOND_S: f64 = 0.4 * EVENT_TOLERANCE_S;
/// Bound on the steps for it.
const ROOT_STEPS: usize = 60;

/// Voltages lost in the bridge, taken as constant while current flows.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct BridgeLosses {
    /// Upper plus lower transistor while driving, in volts.
    #[serde(rename = "drive_V")]
    pub drive_v: f64,
    /// Transistor plus diode while braking, in volts.
    #[serde(rename = "brake_V")]
    pub brake_v: f64,
    /// One free-wheeling diode, in volts.
    #[serde(rename = "diode_V")]
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
    /// The last two: a tick ends the old and begins a new.
    periods: [Period; 2],
    state: Motion,
    supply_v: f64,
}

/// What acts on the shaft besides the motor, constant for a while.
#[derive(Clone, Copy, Debug)]
pub(super) struct Torques {
    /// Against positive rotation, whichever way the shaft turns.
    pub load_nm: f64,
    /// Against the motion; also what it takes to break loose.
    pub friction_nm: f64,
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
        Self {
            periods: [Period::new(&moving, [0.0; 3]); 2],
            parameters,
            moving,
            state: Motion::default(),
            supply_v: 0.0,
        }
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
    pub fn set_motion(&mut self, motion: Motion) {
        self.state = motion;
    }

    /// How it moves.
    pub fn motion(&self) -> &Motion {
        &self.state
    }

    /// Makes the winding's resistance another.
    pub(super) fn set_resistance_ohm(&mut self, resistance_ohm: f64) {
        self.parameters.resistance_ohm = resistance_ohm;
        self.moving = Moving::new(&self.parameters);
        self.periods.iter_mut().for_each(|period| period.lengths_s = [f64::NAN; 3]);
    }

    /// Advances from event to event.
    fn eventful(&mut self, dt_s: f64, inputs: &Inputs, sample: &mut CurrentSample) {
        self.supply_v = inputs.supply_v;
        if inputs.blocked {
            self.state.speed_rad_per_s = 0.0;
        }
        let mut left_s = dt_s;
        while left_s > 0.0 {
            self.stretch(left_s.min(LONGEST_STEP_S), inputs, sample);
            left_s -= LONGEST_STEP_S;
        }
    }

    /// Advances through one stretch.
    fn stretch(&mut self, dt_s: f64, inputs: &Inputs, sample: &mut CurrentSample) {
        let mut left_s = dt_s;
        for _ in 0..MAX_EVENTS {
            let mode = Mode::of(&self.parameters, &self.state, inputs);
            let course = Course::new(&self.moving, &mode, self.state, self.rates(&mode));
            let (end, _) = course.at(left_s);
            let margin = mode.margin(&self.parameters, &end);
            if margin >= 0.0 {
                sample.pass(&course, left_s);
                self.state = end;
                return;
            }
            let (event_s, state) = self.event(&mode, &course, (left_s, end));
            sample.pass(&course, event_s);
            self.state = mode.hold(state);
            left_s -= event_s;
        }
    }

    /// Takes a PWM period from event to event; also gives the current at the end of its pulse.
    fn eventful_period(&mut self, pwm: &Pwm, inputs: &Inputs) -> (PeriodEnd, f64) {
        let mut sample = CurrentSample { in_s: pwm.sampled_s, current_a: self.state.current_a };
        let [(pulse, pulse_s), (rest, rest_s)] = pwm.parts(0.0, pwm.period_s);
        self.eventful(pulse_s, &Inputs { bridge: pulse, ..*inputs }, &mut sample);
        let pulse_a = self.state.current_a;
        self.eventful(rest_s, &Inputs { bridge: rest, ..*inputs }, &mut sample);
        (PeriodEnd { angle_rad: self.state.angle_rad, sampled_a: sample.current_a }, pulse_a)
    }

    /// When the margin becomes negative, and the state then, given an instant and a state beyond; the instant is just
    /// beyond. Newton's method from the root of a parabola, kept within the bracket.
    fn event(&self, mode: &Mode, course: &Course, mut beyond: (f64, Motion)) -> (f64, Motion) {
        let p = &self.parameters;
        let (end_s, end_margin) = (beyond.0, mode.margin(p, &beyond.1));
        if end_s <= EVENT_TOLERANCE_S {
            return beyond;
        }
        let start_margin = mode.margin(p, &course.start).max(0.0);
        let start_slope = mode.margin_slope(p, &course.start, course.rate);
        // Mostly good to a thousandth of the tolerance: a little beyond, the first look encloses the event.
        let mut t = parabola_root(start_margin, start_slope, end_s, end_margin) + BEYOND_S;
        let mut inside_s = 0.0;
        for _ in 0..ROOT_STEPS {
            // Away from either end, so that a root close to one end is enclosed at once.
            t = t.clamp(inside_s + 0.5 * EVENT_TOLERANCE_S, beyond.0 - 0.5 * EVENT_TOLERANCE_S);
            let (state, rate) = course.at(t);
            let margin = mode.margin(p, &state);
            let newton_s = t - margin / mode.margin_slope(p, &state, rate);
            if margin >= 0.0 {
                inside_s = t;
            } else {
                beyond = (t, state);
                // The margin is as good as straight over so short a time.
                inside_s = if (0.0..EVENT_TOLERANCE_S).contains(&(t - newton_s)) { newton_s } else { inside_s };
            }
            if beyond.0 - inside_s < EVENT_TOLERANCE_S {
                break;
            }
            let enclosed = newton_s > inside_s && newton_s < beyond.0;
            t = if enclosed { newton_s + BEYOND_S } else { 0.5 * (inside_s + beyond.0) };
        }
        beyond
    }

    /// Constant part of the rates of speed and current.
    fn rates(&self, mode: &Mode) -> Vector {
        let voltage_v = mode.source_v - mode.current * mode.drop_v;
        let torque_nm = -mode.load_torque_nm - mode.speed * self.parameters.coulomb_friction_nm;
        [torque_nm * self.moving.per_inertia, voltage_v * self.moving.per_inductance]
    }

    /// The maps of a PWM period of these lengths, computed if it is neither of the last two.
    fn period(&mut self, pwm: &Pwm) -> Period {
        let lengths_s = [pwm.pulse_s, pwm.sampled_s, pwm.period_s];
        if self.periods[0].lengths_s != lengths_s {
            self.periods.swap(0, 1);
        }
        if self.periods[0].lengths_s != lengths_s {
            self.periods[0] = Period::new(&self.moving, lengths_s);
        }
        self.periods[0]
    }

    /// The map of a PWM period from the present state on, if shaft and current can keep their signs through one.
    fn steady(&self, period: &Period, pwm: &Pwm, inputs: &Inputs, rubs: bool) -> Option<Steady> {
        let (w, i, p) = (self.state.speed_rad_per_s, self.state.current_a, &self.parameters);
        let (pulse_v, pulse_drop_v) = p.bridge.source_and_drop_v(pwm.pulse, inputs.supply_v);
        let (rest_v, rest_drop_v) = p.bridge.source_and_drop_v(pwm.rest, inputs.supply_v);
        let drops = pulse_drop_v > 0.0 || rest_drop_v > 0.0;
        if inputs.blocked || pwm.period_s > LONGEST_STEP_S || (rubs && w == 0.0) || (drops && i == 0.0) {
            return None;
        }
        let signs = [if rubs { w.signum() } else { 0.0 }, if drops { i.signum() } else { 0.0 }];
        let voltages = [pulse_v - signs[1] * pulse_drop_v, rest_v - signs[1] * rest_drop_v];
        Some(Steady::new(period, voltages, signs))
    }

    /// [`Plant::advance`] under other torques than those of inputs and parameters.
    pub(super) fn advance_under(&mut self, dt_s: f64, inputs: &Inputs, torques: Torques) {
        self.parameters.coulomb_friction_nm = torques.friction_nm;
        self.advance(dt_s, &Inputs { load_torque_nm: torques.load_nm, ..*inputs });
    }

    /// [`Plant::advance_pwm`] under torques that change from period to period. They are asked for once at the start of
    /// each, given the state then and the current at the end of the last pulse. Returns that of the last.
    #[inline(always)]
    pub(super) fn advance_pwm_under(
        &mut self,
        pwm: &Pwm,
        inputs: &Inputs,
        ends: &mut [PeriodEnd],
        mut torques: impl FnMut(&Motion, f64) -> Torques,
    ) -> f64 {
        self.supply_v = inputs.supply_v;
        let period = self.period(pwm);
        let mut pulse_a = self.state.current_a;
        let mut steady = None;
        // The state stays in registers as long as nothing changes its sign.
        let mut state = self.state;
        for end in ends {
            let now = torques(&state, pulse_a);
            if steady.is_none() {
                self.state = state;
                steady = self.steady(&period, pwm, inputs, now.friction_nm > 0.0);
            }
            if let Some((next, currents)) = steady.as_ref().and_then(|steady| steady.next(&state, &now)) {
                state = next;
                pulse_a = currents.pulse_a;
                *end = PeriodEnd { angle_rad: state.angle_rad, sampled_a: currents.sampled_a };
                continue;
            }
            steady = None;
            self.state = state;
            self.parameters.coulomb_friction_nm = now.friction_nm;
            (*end, pulse_a) = self.eventful_period(pwm, &Inputs { load_torque_nm: now.load_nm, ..*inputs });
            state = self.state;
        }
        self.state = state;
        pulse_a
    }
}

impl Default for DcMotor {
    fn default() -> Self {
        Self::new(DcMotorParameters::PIVT6)
    }
}

impl Plant for DcMotor {
    fn advance(&mut self, dt_s: f64, inputs: &Inputs) {
        let mut nobody_looks = CurrentSample { in_s: -1.0, current_a: 0.0 };
        self.eventful(dt_s, inputs, &mut nobody_looks);
    }

    fn advance_period(&mut self, pwm: &Pwm, inputs: &Inputs) -> PeriodEnd {
        self.eventful_period(pwm, inputs).0
    }

    fn advance_pwm(&mut self, pwm: &Pwm, inputs: &Inputs, ends: &mut [PeriodEnd]) {
        let torques = Torques { load_nm: inputs.load_torque_nm, friction_nm: self.parameters.coulomb_friction_nm };
        self.advance_pwm_under(pwm, inputs, ends, |_, _| torques);
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
