//! The loop as the core samples it: motor, hold, delay, sensors of speed and current, derivative filter, integral.
//!
//! At a tick the core takes its inputs and computes the law; the bridge follows [`DRIVE_DELAY_S`] later. The encoder
//! gives the position at the tick, and the speed as the mean over the last tick. With less than one edge a tick, it is
//! the mean between edges. A tachogenerator gives the speed at one instant ([`SpeedPath::Converted`]). The current is
//! the mean of conversions during the last tick.

use super::law::{ControlLaw, Signal};
use super::observer::CurrentObserver;
use super::weights::Weights;
pub use host_sim::trial::DRIVE_DELAY_S;
use motorbench_model::linear::frequency_response::{BodePoint, Margins, Sweep, bode, log_spaced};
use motorbench_model::linear::state_space::{Discrete, StateSpace};
use motorbench_model::linear::{Matrix, eigenvalues, motor_model, spectral_radius};
use motorbench_model::motor::MotorParameters;
use nalgebra::{Complex, DVector};
use std::f64::consts::PI;

/// Number of points of a frequency response in a plot.
const FREQUENCIES: usize = 400;
/// Lowest frequency that is evaluated, relative to the highest.
const LOWEST: f64 = 1e-5;

/// Source of the measured speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpeedPath {
    /// From the encoder: the mean over the last tick.
    Mean,
    /// From a tachogenerator: converted once a tick, then filtered by the core's low-pass. The converter is not
    /// synchronised with the tick. The model assumes the oldest possible conversion: one tick.
    Converted {
        /// Time constant of the low-pass; 0: none.
        filter_s: f64,
        /// Coefficient of the low-pass for one tick.
        filter_part: f64,
    },
}

/// Delay and speed measurement of a motor, for any law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorTiming {
    /// Time between two ticks.
    pub period_s: f64,
    /// Delay of the voltage beyond [`DRIVE_DELAY_S`].
    pub delay_s: f64,
    /// How the speed is measured.
    pub speed: SpeedPath,
}

impl MotorTiming {
    /// An encoder, and a bridge that follows the core at once.
    pub fn by_encoder(period_s: f64) -> Self {
        Self { period_s, delay_s: 0.0, speed: SpeedPath::Mean }
    }
}

/// Sampling of a law.
#[derive(Clone, Debug, PartialEq)]
pub struct Sampling {
    /// Time between two ticks.
    pub period_s: f64,
    /// Delay of the voltage beyond [`DRIVE_DELAY_S`].
    pub delay_s: f64,
    /// How the speed is measured.
    pub speed: SpeedPath,
    /// Coefficient of the PID's derivative filter for one tick; unused by an LQR.
    pub filter_part: f64,
    /// Time constant of that filter.
    pub filter_s: f64,
    /// Estimates a current that is not measured.
    pub observer: Option<CurrentObserver>,
}

impl Sampling {
    /// A tick of `period_s` with an encoder, and a derivative filter of `filter_s`.
    pub fn new(period_s: f64, filter_s: f64) -> Self {
        let filter_part = period_s / (filter_s + period_s);
        Self { period_s, delay_s: 0.0, speed: SpeedPath::Mean, filter_s, filter_part, observer: None }
    }
}

/// Feedback gains in the order of [`ControlLaw::feedback`], and the gain on the reference.
#[derive(Clone, Debug, PartialEq)]
pub struct Gains {
    /// Volts per unit of the signal.
    pub feedback: Vec<f64>,
    /// Volts per unit of the reference.
    pub reference: f64,
}

/// Everything except the gains as one linear system with the voltage as its input.
#[derive(Clone, Debug)]
pub struct SampledLoop {
    /// States: see [`SampledLoop::scales`].
    a: Matrix,
    b: Matrix,
    /// A row for each feedback gain.
    signals: Matrix,
    places: Places,
    period_s: f64,
}

/// Indices of the states.
#[derive(Clone, Copy, Debug)]
struct Places {
    speed: usize,
    current: usize,
    position: Option<usize>,
    /// Voltages on their way.
    waiting: usize,
    measured_speed: usize,
    mean_current: usize,
    filter: usize,
    integral: usize,
    /// First state of the current observer; the number of states if there is none.
    estimate: usize,
    size: usize,
}

impl Places {
    fn new(law: ControlLaw, waiting: usize, observer: usize) -> Self {
        let position = law.is_position().then_some(2);
        let measured_speed = 2 + usize::from(law.is_position()) + waiting;
        Self {
            speed: 0,
            current: 1,
            position,
            waiting,
            measured_speed,
            mean_current: measured_speed + 1,
            filter: measured_speed + 2,
            integral: measured_speed + 3,
            estimate: measured_speed + 4,
            size: measured_speed + 4 + observer,
        }
    }

    /// The controlled quantity.
    fn output(&self) -> usize {
        self.position.unwrap_or(self.speed)
    }

    /// States that affect the measured speed, which is the last of them.
    fn measured_speed_states(&self) -> impl Iterator<Item = usize> + Clone {
        [self.speed, self.current].into_iter().chain(self.measured_speed - self.waiting..=self.measured_speed)
    }

    /// What the law uses as the controlled quantity.
    fn measured_output(&self) -> usize {
        self.position.unwrap_or(self.measured_speed)
    }
}

/// Speed, current and their integrals for an armature.
fn with_integrals(armature: &StateSpace) -> StateSpace {
    let mut a = Matrix::zeros(4, 4);
    a.view_mut((0, 0), (2, 2)).copy_from(&armature.a);
    a.view_mut((2, 0), (2, 2)).fill_with_identity();
    let mut b = Matrix::zeros(4, 1);
    b.view_mut((0, 0), (2, 1)).copy_from(&armature.b);
    StateSpace { a, b, c: Matrix::identity(4, 4) }
}

/// The motor as the speed sensor sees it. States: speed, current, voltages on their way, measured speed. Input:
/// voltage; output: measured speed.
pub fn motor_with_speed_sensor(motor: &MotorParameters, timing: &MotorTiming) -> Discrete {
    let MotorTiming { period_s, delay_s, speed } = *timing;
    let sampling = Sampling { speed, delay_s, ..Sampling::new(period_s, 0.0) };
    let sampled = SampledLoop::new(motor, ControlLaw::SpeedLqr, &sampling);
    let seen: Vec<usize> = sampled.places.measured_speed_states().collect();
    let mut c = Matrix::zeros(1, seen.len());
    c[(0, seen.len() - 1)] = 1.0;
    Discrete { a: sampled.a.select_rows(&seen).select_columns(&seen), b: sampled.b.select_rows(&seen), c, period_s }
}

impl SampledLoop {
    /// The loop of a law around a motor.
    pub fn new(motor: &MotorParameters, law: ControlLaw, sampling: &Sampling) -> Self {
        let period_s = sampling.period_s;
        let plant =
            with_integrals(&motor_model::armature(motor)).discretise(period_s, DRIVE_DELAY_S + sampling.delay_s);
        let places =
            Places::new(law, plant.a.nrows() - 4, sampling.observer.as_ref().map_or(0, |observer| observer.a.nrows()));
        let mut a = Matrix::zeros(places.size, places.size);
        let mut b = Matrix::zeros(places.size, 1);
        // Maps rows of the plant (speed, current, angle, charge, voltages on their way) to states of the loop. Angle
        // and charge start each tick at zero if only their change matters.
        let first_waiting = places.measured_speed - places.waiting;
        let columns = |column: usize| match column {
            0 | 1 => Some(column),
            2 | 3 => None,
            waiting => Some(first_waiting + waiting - 4),
        };
        let mut take = |to: usize, from: usize, factor: f64| {
            for column in 0..plant.a.ncols() {
                if let Some(place) = columns(column) {
                    a[(to, place)] = factor * plant.a[(from, column)];
                }
            }
            b[(to, 0)] = factor * plant.b[(from, 0)];
        };
        take(places.speed, 0, 1.0);
        take(places.current, 1, 1.0);
        for waiting in 0..places.waiting {
            take(first_waiting + waiting, 4 + waiting, 1.0);
        }
        if sampling.speed == SpeedPath::Mean {
            take(places.measured_speed, 2, 1.0 / period_s);
        }
        take(places.mean_current, 3, 1.0 / period_s);
        if let Some(position) = places.position {
            take(position, 2, 1.0);
            a[(position, position)] = 1.0;
        }
        if let SpeedPath::Converted { filter_part, .. } = sampling.speed {
            a[(places.measured_speed, places.measured_speed)] = 1.0 - filter_part;
            a[(places.measured_speed, places.speed)] = filter_part;
        }
        a[(places.filter, places.filter)] = 1.0 - sampling.filter_part;
        a[(places.filter, places.measured_speed)] = sampling.filter_part;
        a[(places.integral, places.integral)] = 1.0;
        a[(places.integral, places.measured_output())] = period_s;
        if let Some(observer) = &sampling.observer {
            let (at, size) = (places.estimate, observer.a.nrows());
            a.view_mut((at, at), (size, size)).copy_from(&observer.a);
            a.view_mut((at, places.measured_speed), (size, 1)).copy_from(&observer.of_speed);
            b.view_mut((at, 0), (size, 1)).copy_from(&observer.of_voltage);
        }
        let signals = signals(law, &places, sampling);
        Self { a, b, signals, places, period_s }
    }

    /// Time between two ticks.
    pub fn period_s(&self) -> f64 {
        self.period_s
    }

    /// Number of states.
    pub fn states(&self) -> usize {
        self.places.size
    }

    /// `A` and `B` from the voltage, for the Riccati equation.
    pub fn system(&self) -> (&Matrix, &Matrix) {
        (&self.a, &self.b)
    }

    /// A row for each feedback gain: the signal it acts on.
    pub fn signals(&self) -> &Matrix {
        &self.signals
    }

    /// Change of the states in each tick by a constant load torque of 1 Nm, for this motor and sampling.
    pub fn load(&self, motor: &MotorParameters, sampling: &Sampling) -> DVector<f64> {
        let braked = Matrix::from_row_slice(2, 1, &[-1.0 / motor.inertia_kg_m2, 0.0]);
        let armature = StateSpace { b: braked, ..motor_model::armature(motor) };
        let moved = with_integrals(&armature).discretise(self.period_s, 0.0).b;
        let mut load = DVector::zeros(self.states());
        load[self.places.speed] = moved[0];
        load[self.places.current] = moved[1];
        load[self.places.mean_current] = moved[3] / self.period_s;
        if sampling.speed == SpeedPath::Mean {
            load[self.places.measured_speed] = moved[2] / self.period_s;
        }
        if let Some(position) = self.places.position {
            load[position] = moved[2];
        }
        load
    }

    /// Integral of the error after the loop has compensated a load: the value that the integral has reached.
    pub fn error_integral(&self, gains: &Gains, load: &DVector<f64>) -> Option<f64> {
        let moved = Matrix::identity(self.states(), self.states()) - self.closed(gains).a;
        moved.lu().solve(load).map(|settled| settled[self.places.integral].abs())
    }

    /// Weights on the squares of the states; the square of the voltage has weight one.
    pub fn weights(&self, weights: &Weights) -> Matrix {
        let [angle, speed, current, integral] = weights.relative();
        let Places { position, .. } = self.places;
        let mut q = Matrix::zeros(self.states(), self.states());
        for (place, weight) in [
            (position, angle),
            (Some(self.places.speed), speed),
            (Some(self.places.current), current),
            (Some(self.places.integral), integral),
        ] {
            if let Some(place) = place {
                q[(place, place)] = weight;
            }
        }
        q
    }

    /// Size of the states at about one volt in a loop of `speed_rad_per_s`: scales for numerical work.
    pub fn scales(&self, motor: &MotorParameters, speed_rad_per_s: f64) -> DVector<f64> {
        let (speed, current) = (1.0 / motor.torque_constant_nm_per_a, 1.0 / motor.resistance_ohm);
        let mut scales = DVector::repeat(self.states(), 1.0);
        for (place, scale) in [
            (self.places.speed, speed),
            (self.places.current, current),
            (self.places.measured_speed, speed),
            (self.places.mean_current, current),
            (self.places.filter, speed),
            (self.places.integral, speed / speed_rad_per_s),
        ] {
            scales[place] = scale;
        }
        if let Some(position) = self.places.position {
            scales[position] = speed / speed_rad_per_s;
            scales[self.places.integral] /= speed_rad_per_s;
        }
        // The observer's states are those of the motor, in the same order.
        if self.places.estimate < self.states() {
            let seen = self.places.measured_speed_states().map(|place| scales[place]).collect::<Vec<_>>();
            seen.iter().enumerate().for_each(|(at, scale)| scales[self.places.estimate + at] = *scale);
        }
        scales
    }

    /// Initial states of a loop, one in each column, in units of the scales: speed, current, position and integral.
    /// Each has been constant for long, so sensors, filters and observer agree with it. Otherwise the optimum would
    /// guard against sensor errors.
    pub fn deviations(&self) -> Matrix {
        let Places { speed, current, position, measured_speed, mean_current, filter, integral, estimate, .. } =
            self.places;
        let estimated = |seen: usize| (estimate < self.states()).then(|| estimate + seen);
        let last_seen = self.places.measured_speed_states().count() - 1;
        let of_speed = [Some(speed), Some(measured_speed), Some(filter), estimated(0), estimated(last_seen)];
        let of_current = [Some(current), Some(mean_current), estimated(1), None, None];
        let alone = |place: Option<usize>| [place, None, None, None, None];
        let columns = [of_speed, of_current, alone(position), alone(Some(integral))];
        let mut deviations = Matrix::zeros(self.states(), columns.len());
        for (column, places) in columns.iter().enumerate() {
            for place in places.iter().flatten() {
                deviations[(*place, column)] = 1.0;
            }
        }
        deviations
    }

    /// From the reference to the controlled quantity, the voltage and the current.
    pub fn closed(&self, gains: &Gains) -> Discrete {
        let feedback = self.feedback_row(gains);
        let mut b = &self.b * gains.reference;
        b[(self.places.integral, 0)] -= self.period_s;
        let mut c = Matrix::zeros(3, self.states());
        c[(0, self.places.output())] = 1.0;
        c.set_row(1, &(-&feedback).row(0));
        c[(2, self.places.current)] = 1.0;
        Discrete { a: &self.a - &self.b * feedback, b, c, period_s: self.period_s }
    }

    /// The gains as one row on the states.
    fn feedback_row(&self, gains: &Gains) -> Matrix {
        Matrix::from_row_slice(1, gains.feedback.len(), &gains.feedback) * &self.signals
    }

    /// Largest magnitude of the closed loop's eigenvalues.
    pub fn spectral_radius(&self, gains: &Gains) -> f64 {
        spectral_radius(&self.closed(gains).a)
    }

    /// Frequency response of the loop, opened at the voltage, for a plot.
    pub fn open_loop(&self, gains: &Gains) -> Vec<BodePoint> {
        let [from, to] = self.frequency_range();
        bode(response(&self.open_loop_system(gains)), log_spaced(from, to, FREQUENCIES))
    }

    /// Margins of a stable loop.
    pub fn margins(&self, gains: &Gains) -> Margins {
        let (open, closed) = (self.open_loop_system(gains), self.closed(gains));
        // Peaks of the response are at its own poles, those of the sensitivity at the closed loop's.
        let poles: Vec<_> = [&open, &closed].into_iter().flat_map(poles_rad_per_s).collect();
        Margins::of(&Sweep::new(response(&open), self.frequency_range(), &poles))
    }

    /// From the reference to the controlled quantity.
    pub fn bandwidth_rad_per_s(&self, gains: &Gains) -> Option<f64> {
        let closed = self.closed(gains);
        Sweep::new(response(&closed), self.frequency_range(), &poles_rad_per_s(&closed)).bandwidth_rad_per_s()
    }

    /// From the voltage to the feedback of the gains.
    fn open_loop_system(&self, gains: &Gains) -> Discrete {
        Discrete { a: self.a.clone(), b: self.b.clone(), c: self.feedback_row(gains), period_s: self.period_s }
    }

    /// Range of evaluated frequencies, in rad/s, up to half the sampling frequency.
    fn frequency_range(&self) -> [f64; 2] {
        let highest = PI / self.period_s;
        [LOWEST * highest, highest]
    }
}

/// Response from the first input to the first output.
fn response(system: &Discrete) -> impl Fn(f64) -> Complex<f64> {
    move |omega| system.at(omega).map_or(Complex::new(f64::NAN, 0.0), |values| values[(0, 0)])
}

/// Poles in the s plane.
fn poles_rad_per_s(system: &Discrete) -> Vec<Complex<f64>> {
    eigenvalues(&system.a).iter().map(|pole| pole.ln() / system.period_s).collect()
}

fn signals(law: ControlLaw, places: &Places, sampling: &Sampling) -> Matrix {
    let feedback = law.feedback();
    let mut rows = Matrix::zeros(feedback.len(), places.size);
    for (row, (_, signal)) in feedback.iter().enumerate() {
        let mut add = |place: usize, factor: f64| rows[(row, place)] = factor;
        match signal {
            Signal::Position => add(places.measured_output(), 1.0),
            Signal::Speed => add(places.measured_speed, 1.0),
            Signal::Current => match &sampling.observer {
                None => add(places.mean_current, 1.0),
                Some(observer) => {
                    add(places.measured_speed, observer.direct);
                    observer.current.iter().enumerate().for_each(|(at, &part)| add(places.estimate + at, part));
                }
            },
            Signal::Integral => add(places.integral, 1.0),
            Signal::Derivative => {
                // The speed minus the filter's state before this tick.
                let rate = 1.0 / (sampling.filter_s + sampling.period_s);
                add(places.measured_speed, rate);
                add(places.filter, -rate);
            }
            Signal::FilteredSpeed => {
                add(places.measured_speed, sampling.filter_part);
                add(places.filter, 1.0 - sampling.filter_part);
            }
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without feedback the model's mean speed is the mean of the motor's exact step response.
    #[test]
    fn what_the_sensors_see_is_the_mean_over_the_tick() {
        let motor = MotorParameters::PIVT6;
        let sampled = SampledLoop::new(&motor, ControlLaw::SpeedLqr, &Sampling::new(1e-3, 0.0));
        let mut c = Matrix::zeros(2, sampled.states());
        c[(0, sampled.places.measured_speed)] = 1.0;
        c[(1, sampled.places.mean_current)] = 1.0;
        let system = Discrete { a: sampled.a.clone(), b: sampled.b.clone(), c, period_s: 1e-3 };
        let sampled = system.step_response(40);
        // The same with the step 0.2 ms late, in steps of 1 us.
        let fine = motor_model::armature(&motor).discretise(1e-6, 0.2e-3).step_response(40_001);
        for tick in 1..40 {
            for signal in 0..2 {
                let within = fine.row(signal);
                let inside: f64 = (0..1000).map(|at| within[(tick - 1) * 1000 + at]).sum::<f64>();
                let ends = 0.5 * (within[tick * 1000] - within[(tick - 1) * 1000]);
                let mean = (inside + ends) / 1000.0;
                assert!((sampled[(signal, tick)] - mean).abs() < 1e-6, "{tick}: {} {mean}", sampled[(signal, tick)]);
            }
        }
    }
}
