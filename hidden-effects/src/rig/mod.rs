//! The bench: differential equations with small steps, friction that sticks, and a switched bridge where that matters.

mod drawing;

use crate::Motor;
use crate::live::Switch;
use rand::{Rng, RngExt};
use std::f64::consts::TAU;

const STEP_S: f64 = 20e-6;
const SWITCHED_STEP_S: f64 = 2.5e-6;
const DIODE_V: f64 = 1.0;
/// Junctions that carry less have their foot alone.
const FOOT_A: f64 = 1e-3;
/// The supply's capacitor evens out the pulses.
const SUPPLY_SMOOTHING_S: f64 = 0.5e-3;
/// Copper and its surroundings: share of resistance a kelvin.
const COPPER_PER_K: f64 = 0.00393;

/// Models of dry friction.
#[derive(Clone, Copy, Debug)]
enum Friction {
    /// A band around zero speed in which the shaft is held (Karnopp 1985).
    Karnopp,
    /// Bristles that bend (Canudas de Wit and others 1995).
    LuGre,
}

/// Constants of the hidden effects; zero if absent.
#[derive(Clone, Debug, Default)]
pub struct Hidden {
    coulomb_nm: f64,
    excess_nm: f64,
    stribeck_speed: f64,
    /// Of the ratio to the Stribeck speed: 2, or 1 (Tustin).
    stribeck_power: i32,
    asymmetry_nm: f64,
    warmup_share: f64,
    warmup_s: f64,
    drag: f64,
    load_nm: f64,
    step_nm: f64,
    step_s: f64,
    cogging_nm: f64,
    cogging_periods: f64,
    cogging_phase: f64,
    gravity_nm: f64,
    gravity_phase: f64,
    gap_rad: f64,
    /// Stiffness and energy loss of plastic to steel flanks.
    contact_hz: f64,
    contact_damping: f64,
    load_share: f64,
    spring_hz: f64,
    spring_damping: f64,
    drop_v: f64,
    /// What the bridge drops in place of that, where it grows with the current.
    darlingtons: Option<Darlingtons>,
    /// Share by which the drop is greater forwards and smaller backwards.
    drop_asymmetry: f64,
    /// The drop follows the mean current, as behind a filter or an amplifier, and rises over a knee.
    drop_averaged: bool,
    drop_knee_a: f64,
    sag_ohm: f64,
    /// No capacitor: the supply delivers the motor's whole current during a pulse.
    sags_in_pulses: bool,
    heating_k_per_w: f64,
    heating_s: f64,
    coasts: bool,
    /// Only at zero command; between pulses the bridge brakes.
    coasts_at_zero_duty: bool,
    shaker_nm: f64,
    shaker_hz: f64,
    saturation: f64,
    /// Share by which the bridge gives less backward, or, if negative, forward.
    weaker_backward: f64,
    /// Increase of the winding's resistance with speed.
    growth_ohm_s: f64,
    commutation: Commutation,
    /// Drag with the cube of the speed.
    cube: f64,
    dropouts: bool,
    dropout_s: f64,
    /// The counter stops repeatedly, for this long.
    counter_stops: bool,
    counter_stop_s: f64,
    spindle_nm: f64,
    spindle_revolutions: f64,
    spring_nm: f64,
    spring_rad: f64,
    /// A grip on the shaft, repeated, for this long.
    grip_nm: f64,
    grip_s: f64,
    pub(crate) delay_s: f64,
    /// By how much a command acts later in each second.
    pub(crate) delay_growth: f64,
    pub(crate) offset_a: f64,
    pub(crate) current_lag: Lag,
    pub(crate) speed_lag: Lag,
    pub(crate) clip_share: f64,
    pub(crate) eccentricity_rad: f64,
    pub(crate) eccentricity_phase: f64,
    pub(crate) lost_share: f64,
    pub(crate) lost_above: f64,
    /// The share applies to all counts above the limit, not only to the excess.
    pub(crate) lost_of_all: bool,
    /// Width of its onset as a multiple of that speed; 0: abrupt.
    pub(crate) lost_onset: f64,
    /// Each edge is lost with this probability, instead of every n-th.
    pub(crate) lost_at_random: bool,
    pub(crate) ripple: f64,
    pub(crate) ripples: f64,
    pub(crate) ripple_phase: f64,
    pub(crate) drift: f64,
    pub(crate) dead_band: f64,
}

/// A bridge of bipolar transistors, as an L293D: what it drops grows with the current, and other transistors and diodes
/// carry that in the off phase.
#[derive(Clone, Copy, Debug)]
struct Darlingtons {
    in_pulse: Junctions,
    in_off_phase: Junctions,
}

/// Junctions in series with what resistance they have.
#[derive(Clone, Copy, Debug)]
struct Junctions {
    /// At [`FOOT_A`] and below.
    foot_v: f64,
    /// More for each e-fold of the current.
    fold_v: f64,
    resistance_ohm: f64,
}

impl Junctions {
    fn drop_v(self, current_a: f64) -> f64 {
        let current_a = current_a.abs();
        self.foot_v + self.fold_v * (1.0 + current_a / FOOT_A).ln() + self.resistance_ohm * current_a
    }
}

impl Darlingtons {
    /// Around the curves of an L293D's data sheet and of a simulated one.
    fn draw(random: &mut impl Rng) -> Self {
        let fold_v = random.random_range(0.025..0.06);
        let foot_v = random.random_range(1.4..2.0);
        let resistance_ohm = random.random_range(0.4..1.2);
        let in_pulse = Junctions { foot_v, fold_v, resistance_ohm };
        let in_off_phase = Junctions {
            foot_v: foot_v - random.random_range(0.1..0.6),
            fold_v,
            resistance_ohm: resistance_ohm + random.random_range(0.0..0.8),
        };
        Self { in_pulse, in_off_phase }
    }
}

/// Ripple of the torque constant: brushes take the EMF of one coil after the other.
#[derive(Clone, Copy, Debug, Default)]
struct Commutation {
    /// Amplitude of the first harmonic, as a share of the mean.
    depth: f64,
    ripples_per_rev: f64,
    /// Width of a brush, in ripples.
    brush_width: f64,
    phase: f64,
}

impl Commutation {
    /// Harmonics that are computed.
    const HARMONICS: u8 = 4;

    fn draw(depth: f64, phase: f64, random: &mut impl Rng) -> Self {
        let segments = [5.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0][random.random_range(0..8)];
        // With an odd number the two brushes commutate in turn.
        let ripples_per_rev = if segments % 2.0 == 1.0 { 2.0 * segments } else { segments };
        Self { depth, ripples_per_rev, brush_width: random.random_range(0.3..0.8), phase }
    }

    /// By what share of its mean the torque constant is greater at an angle. The EMF of a coil is a sine, and each coil
    /// has its crest. This is the Fourier series of `cos(x)` for `|x| < pi / n`, each harmonic averaged over the width
    /// of a brush.
    fn share(self, angle: f64) -> f64 {
        if self.depth == 0.0 {
            return 0.0;
        }
        let harmonic = |order: f64| {
            let of_crests = 1.0 / ((order * self.ripples_per_rev).powi(2) - 1.0);
            let half_brush = 0.5 * TAU * order * self.brush_width;
            of_crests * half_brush.sin() / half_brush
        };
        let wave = |order: u8| {
            let sign = if order % 2 == 1 { 1.0 } else { -1.0 };
            let order = f64::from(order);
            sign * harmonic(order) * (order * (self.ripples_per_rev * angle + self.phase)).cos()
        };
        self.depth / harmonic(1.0) * (1..=Self::HARMONICS).map(wave).sum::<f64>()
    }
}

/// A low-pass of the first order before a reading.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Lag {
    pub(crate) time_constant_s: f64,
    /// The filter is the program's, applied to its readings, and not the sensor's.
    pub(crate) in_program: bool,
    /// Whether that is a Butterworth filter.
    pub(crate) is_butterworth: bool,
}

impl Lag {
    fn draw(time_constant_s: f64, random: &mut impl Rng) -> Self {
        let drawn: f64 = random.random();
        Self { time_constant_s, in_program: drawn < 0.4, is_butterworth: drawn < 0.16 }
    }

    fn is_of_sensor(self) -> bool {
        self.time_constant_s > 0.0 && !self.in_program
    }

    /// By how much what is `behind` so far comes closer.
    fn change(self, behind: f64, dt: f64) -> f64 {
        dt / self.time_constant_s * behind
    }
}

/// A bench and its state.
#[derive(Clone, Debug)]
pub struct Bench {
    pub motor: Motor,
    pub hidden: Hidden,
    pub supply_v: f64,
    pub counts_per_rev: f64,
    pub top_speed: f64,
    friction: Friction,
    pwm_period_s: f64,
    pub time_s: f64,
    pub current_a: f64,
    /// Current as it is read: without the ripple of the PWM.
    pub smooth_a: f64,
    /// The same behind the sensor's filter.
    pub lagged_a: f64,
    /// The speed behind the capacitor of a tachogenerator.
    lagged_rad_per_s: f64,
    summed_as: f64,
    summed_s: f64,
    /// Current drawn from the supply behind its capacitor.
    drawn_a: f64,
    pub speed: f64,
    pub angle: f64,
    bristle: f64,
    load_speed: f64,
    twist: f64,
    heat_k: f64,
    moments_seed: f64,
}

impl Bench {
    /// Reading of the current sensor.
    pub fn reading_a(&self) -> f64 {
        if self.hidden.current_lag.is_of_sensor() { self.lagged_a } else { self.smooth_a }
    }

    /// Reading of a tachogenerator: its ripple is proportional to the speed.
    fn tachogenerator_rad_per_s(&self) -> f64 {
        let Hidden { ripple, ripples, ripple_phase, .. } = self.hidden;
        self.speed * (1.0 + ripple * (ripples * self.angle + ripple_phase).sin())
    }

    /// The same behind its capacitor, where it has one.
    pub fn shown_rad_per_s(&self) -> f64 {
        if self.hidden.speed_lag.is_of_sensor() { self.lagged_rad_per_s } else { self.tachogenerator_rad_per_s() }
    }

    /// The angle by the disc of the encoder.
    pub fn seen_rad(&self) -> f64 {
        self.angle + self.hidden.eccentricity_rad * (self.angle + self.hidden.eccentricity_phase).sin()
    }

    /// Lets time pass under one duty.
    pub fn run(&mut self, duty: f64, duration_s: f64) {
        let step_s = if self.switches() { SWITCHED_STEP_S } else { STEP_S };
        let steps = (duration_s / step_s).round().max(1.0);
        for _ in 0..steps as usize {
            self.step(duty, duration_s / steps);
        }
    }

    /// Whether a switched supply differs from its mean: with diodes, and with a drop, which the current ripple smooths.
    fn switches(&self) -> bool {
        self.hidden.coasts || self.hidden.drop_v > 0.0 && !self.hidden.drop_averaged
    }

    fn step(&mut self, duty: f64, dt: f64) {
        self.electrical(duty, dt);
        self.mechanical(dt);
        self.time_s += dt;
        if self.switches() {
            self.oversample(dt);
        } else {
            self.smooth_a = self.current_a;
        }
        if self.hidden.speed_lag.is_of_sensor() {
            self.lagged_rad_per_s +=
                self.hidden.speed_lag.change(self.tachogenerator_rad_per_s() - self.lagged_rad_per_s, dt);
        }
        if self.hidden.current_lag.is_of_sensor() {
            self.lagged_a += self.hidden.current_lag.change(self.smooth_a - self.lagged_a, dt);
        }
    }

    /// The reading is the mean of the last whole PWM period.
    fn oversample(&mut self, dt: f64) {
        self.summed_as += dt * self.current_a;
        self.summed_s += dt;
        if self.summed_s > self.pwm_period_s - 0.5 * dt {
            self.smooth_a = self.summed_as / self.summed_s;
            (self.summed_as, self.summed_s) = (0.0, 0.0);
        }
    }

    /// Torque constant at the present current and angle, and the one of the back-EMF with it.
    fn torque_constant(&self) -> f64 {
        let peak_a = self.supply_v / self.motor.resistance_ohm;
        let saturated = 1.0 - self.hidden.saturation * (self.current_a / peak_a).abs().min(1.0);
        self.motor.torque_constant_nm_per_a * saturated * (1.0 + self.hidden.commutation.share(self.angle))
    }

    /// A step with a given state of the bridge.
    pub(crate) fn switched_step(&mut self, switch: Switch, dt: f64) {
        let [pulse_drop_v, braking_v] = self.drops_v();
        let given_v = self.supply_v - self.hidden.sag_ohm * self.drawn_a;
        let (source_v, drop_v) = match switch {
            Switch::Forward => (given_v, pulse_drop_v),
            Switch::Reverse => (-self.passed_on(-1.0) * given_v, pulse_drop_v),
            Switch::Short => (0.0, braking_v),
            Switch::Off => (0.0, self.supply_v + 2.0 * DIODE_V),
        };
        self.armature(source_v, drop_v, dt);
        self.mechanical(dt);
        self.time_s += dt;
        let draw_a = match switch {
            Switch::Forward => self.current_a,
            Switch::Reverse => -self.current_a,
            Switch::Short | Switch::Off => 0.0,
        };
        let share = if self.hidden.sags_in_pulses { 1.0 } else { dt / SUPPLY_SMOOTHING_S };
        self.drawn_a += share * (draw_a - self.drawn_a);
    }

    fn electrical(&mut self, duty: f64, dt: f64) {
        let (source_v, drop_v) = self.bridge(duty, self.supply_under(duty), dt);
        self.armature(source_v, drop_v, dt);
    }

    /// Supply voltage while it drives with this duty.
    fn supply_under(&self, duty: f64) -> f64 {
        let drawn = if self.hidden.sags_in_pulses { duty.signum() } else { duty };
        let given_v = self.supply_v - self.hidden.sag_ohm * drawn * self.current_a;
        if self.dropped_out() { 0.0 } else { self.passed_on(duty) * given_v }
    }

    /// Share of the supply that the bridge passes on in the direction of a duty.
    fn passed_on(&self, duty: f64) -> f64 {
        1.0 - (-duty.signum() * self.hidden.weaker_backward).max(0.0)
    }

    fn armature(&mut self, source_v: f64, drop_v: f64, dt: f64) {
        let winding_ohm = self.motor.resistance_ohm * (1.0 + COPPER_PER_K * self.heat_k);
        let resistance_ohm = winding_ohm + self.hidden.growth_ohm_s * self.speed.abs();
        let emf_v = self.torque_constant() * self.speed;
        let free_a =
            self.current_a + dt / self.motor.inductance_h * (source_v - resistance_ohm * self.current_a - emf_v);
        // The drop opposes the current and cannot reverse it.
        let drop_v = drop_v * (1.0 + self.hidden.drop_asymmetry * free_a.signum());
        let lost_a = dt / self.motor.inductance_h * drop_v;
        self.current_a = free_a.signum() * (free_a.abs() - lost_a).max(0.0);
        let power_w = winding_ohm * self.current_a * self.current_a;
        if self.hidden.heating_s > 0.0 {
            self.heat_k += dt / self.hidden.heating_s * (self.hidden.heating_k_per_w * power_w - self.heat_k);
        }
    }

    /// Source and drop of the circuit.
    fn bridge(&self, duty: f64, supply_v: f64, dt: f64) -> (f64, f64) {
        if !self.switches() {
            let shares = self.current_a.abs() / self.hidden.drop_knee_a.max(f64::MIN_POSITIVE);
            return (
                duty * supply_v,
                self.hidden.drop_v * if self.hidden.drop_knee_a > 0.0 { shares.tanh() } else { 1.0 },
            );
        }
        // The switching instant lies within one of the steps. Half a step's grace for the rounding of the time.
        let period_s = self.pwm_period_s;
        let length = dt / period_s;
        let phase = (self.time_s / period_s + 0.5 * length).fract() - 0.5 * length;
        // A step may end in the next period.
        let on_until = |end: f64| end.clamp(0.0, duty.abs()) + (end - 1.0).clamp(0.0, duty.abs());
        let on = (on_until(phase + length) - on_until(phase)) / length;
        let coasts = self.hidden.coasts && (duty == 0.0 || !self.hidden.coasts_at_zero_duty);
        let [pulse_drop_v, braking_v] = self.drops_v();
        let off_v = if coasts { supply_v + 2.0 * DIODE_V } else { braking_v };
        (on * supply_v * duty.signum(), on * pulse_drop_v + (1.0 - on) * off_v)
    }

    /// What the bridge drops in the pulse, and while it brakes.
    fn drops_v(&self) -> [f64; 2] {
        let by_current =
            |Darlingtons { in_pulse, in_off_phase }| [in_pulse, in_off_phase].map(|one| one.drop_v(self.current_a));
        self.hidden.darlingtons.map_or([self.hidden.drop_v; 2], by_current)
    }

    /// Speed that is not counted.
    pub(crate) fn uncounted(&self) -> f64 {
        if self.hidden.counter_stops {
            return if self.counter_stands() { self.speed } else { 0.0 };
        }
        let excess = self.speed.abs() - self.lost_above();
        let onset = (excess / (self.hidden.lost_onset * self.lost_above()).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let lost_of = if self.hidden.lost_of_all { onset * self.speed.abs() } else { excess.max(0.0) };
        self.hidden.lost_share * lost_of * self.speed.signum()
    }

    /// No edge is counted.
    pub(crate) fn counter_stands(&self) -> bool {
        self.hidden.counter_stops && self.is_within(self.hidden.counter_stop_s)
    }

    /// Speed of the bench at nine tenths of the supply; above a share of it counts are lost.
    fn lost_above(&self) -> f64 {
        let friction_v = self.hidden.coulomb_nm * self.motor.resistance_ohm / self.motor.torque_constant_nm_per_a;
        let reached = (0.9 * self.supply_v - self.hidden.drop_v - friction_v) / self.motor.torque_constant_nm_per_a;
        self.hidden.lost_above * reached
    }

    fn dropped_out(&self) -> bool {
        self.hidden.dropouts && self.is_within(self.hidden.dropout_s)
    }

    /// Whether less than this time has passed since a random moment, one within each second.
    fn is_within(&self, length_s: f64) -> bool {
        let second = self.time_s.floor();
        let moment = ((second + self.moments_seed) * 12.9898).sin().abs() * 0.9;
        (0.0..length_s).contains(&(self.time_s - second - moment))
    }

    fn mechanical(&mut self, dt: f64) {
        let hidden = &self.hidden;
        let behind = hidden.load_share > 0.0;
        let inertia = self.motor.inertia_kg_m2 * (1.0 - hidden.load_share);
        let mut torque = self.torque_constant() * self.current_a - self.outer_torque();
        let mut pull = 0.0;
        if behind {
            pull = self.coupling();
            torque -= pull;
        }
        torque -= self.motor.viscous_friction_nm_s * self.warm() * self.speed;
        match self.friction {
            Friction::Karnopp => self.karnopp(torque, inertia, dt),
            Friction::LuGre => self.lugre(torque, inertia, dt),
        }
        self.angle += dt * self.speed;
        if behind {
            self.load_speed += dt * pull / (self.motor.inertia_kg_m2 * self.hidden.load_share);
            self.twist += dt * (self.speed - self.load_speed);
        }
    }

    fn outer_torque(&self) -> f64 {
        let hidden = &self.hidden;
        let mut torque = hidden.load_nm + hidden.drag * self.speed * self.speed.abs();
        torque += hidden.cube * self.speed.powi(3);
        if self.time_s >= hidden.step_s {
            torque += hidden.step_nm;
        }
        torque += hidden.cogging_nm * (hidden.cogging_periods * self.angle + hidden.cogging_phase).sin();
        torque += hidden.gravity_nm * (self.angle + hidden.gravity_phase).sin();
        torque += hidden.shaker_nm * (TAU * hidden.shaker_hz * self.time_s).sin();
        if hidden.spindle_nm > 0.0 {
            let turn = (self.angle / TAU / hidden.spindle_revolutions).rem_euclid(1.0);
            // Binds over a fifth of its period.
            let bound = if turn < 0.2 { hidden.spindle_nm } else { 0.0 };
            torque += bound * self.sense();
        }
        if hidden.spring_nm > 0.0 {
            torque += hidden.spring_nm * (self.angle / hidden.spring_rad).tanh();
        }
        if hidden.grip_nm > 0.0 && self.is_within(hidden.grip_s) {
            torque += hidden.grip_nm * self.sense();
        }
        torque
    }

    /// Torque of the motion; smaller near standstill, so that binding does not drive.
    fn sense(&self) -> f64 {
        (self.speed / (0.01 * self.top_speed)).clamp(-1.0, 1.0)
    }

    /// Torque in the spring or the contact between motor and load.
    fn coupling(&self) -> f64 {
        let hidden = &self.hidden;
        let reduced = self.motor.inertia_kg_m2 * hidden.load_share * (1.0 - hidden.load_share);
        let slip = self.speed - self.load_speed;
        if hidden.spring_hz > 0.0 {
            let rate = TAU * hidden.spring_hz;
            return reduced * (rate * rate * self.twist + 2.0 * hidden.spring_damping * rate * slip);
        }
        let half = 0.5 * hidden.gap_rad;
        let depth = self.twist - self.twist.clamp(-half, half);
        if depth == 0.0 {
            return 0.0;
        }
        let rate = TAU * hidden.contact_hz;
        let force = reduced * (rate * rate * depth + 2.0 * hidden.contact_damping * rate * slip);
        if depth > 0.0 { force.max(0.0) } else { force.min(0.0) }
    }

    /// Factor of all friction during the warm-up.
    fn warm(&self) -> f64 {
        if self.hidden.warmup_s > 0.0 {
            1.0 + self.hidden.warmup_share * (-self.time_s / self.hidden.warmup_s).exp()
        } else {
            1.0
        }
    }

    fn dry_level(&self, direction: f64) -> f64 {
        let hidden = &self.hidden;
        let excess = if hidden.excess_nm > 0.0 {
            hidden.excess_nm * (-(self.speed / hidden.stribeck_speed).abs().powi(hidden.stribeck_power)).exp()
        } else {
            0.0
        };
        (hidden.coulomb_nm * self.warm() + excess + hidden.asymmetry_nm * direction).max(0.0)
    }

    /// Standstill is exact here, not a band of speeds: within a PWM period a starting shaft gains less speed than any
    /// band.
    fn karnopp(&mut self, torque: f64, inertia: f64, dt: f64) {
        let rests = self.speed == 0.0;
        let direction = if rests { torque.signum() } else { self.speed.signum() };
        let level = self.dry_level(direction);
        if rests && torque.abs() <= level {
            return;
        }
        let before = self.speed;
        self.speed += dt / inertia * (torque - level * direction);
        // Friction stops a shaft but does not reverse it.
        if before * self.speed < 0.0 {
            self.speed = 0.0;
        }
    }

    fn lugre(&mut self, torque: f64, inertia: f64, dt: f64) {
        let level = self.dry_level(if self.speed == 0.0 { torque.signum() } else { self.speed.signum() });
        if level <= 0.0 {
            self.speed += dt / inertia * torque;
            return;
        }
        // Bristles bend by 2 mrad before they slip.
        let stiffness = level / 0.002;
        let damping = 0.5 * (stiffness * inertia).sqrt();
        let bend = self.speed - stiffness * self.speed.abs() / level * self.bristle;
        self.bristle += dt * bend;
        self.bristle = self.bristle.clamp(-0.002, 0.002);
        let friction =
            stiffness * self.bristle + damping * bend * (-(self.speed / (0.02 * self.top_speed)).powi(2)).exp();
        self.speed += dt / inertia * (torque - friction);
    }
}
