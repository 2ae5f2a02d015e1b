//! Estimates of a current that is not measured, from speed and voltage. There are two: the core's observer of the
//! armature (`motorbench_core::observer`), and a steady-state Kalman filter for comparison.
//!
//! ```text
//! x(k+1) = A x(k) + B u(k) + w(k)        y(k) = C x(k) + v(k)
//! estimate(k|k) = estimate(k|k-1) + M (y(k) - C estimate(k|k-1))
//! estimate(k+1|k) = A estimate(k|k) + B u(k)
//! ```
//! `x` is speed, current, the voltages on their way and the measured speed `y`, in the order of [`motor_with_speed_sensor`]. `w` (an
//! unknown voltage and torque) and `v` are white noise. The larger the unknown torque, the more the filter becomes the
//! armature alone, since the acceleration then says little about the current.

use super::sampled_loop::{MotorTiming, SpeedPath, motor_with_speed_sensor};
use motorbench_model::linear::Matrix;
use motorbench_model::linear::riccati::{self, NoSolution};
use motorbench_model::linear::state_space::Discrete;
use motorbench_model::motor::MotorParameters;

/// Index of the current, and of the voltage that has been on its way for longest.
const CURRENT: usize = 1;
const VOLTAGE: usize = 2;
/// Shortest winding time. A faster winding follows the voltage within the tick; zero would select the sensor.
const LEAST_WINDING_TIME_MS: f64 = 1e-3;

/// Standard deviations of the unknown quantities relative to each other, as voltages. The torque counts as the voltage
/// that causes it at standstill, the error of the measured speed as its back-EMF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unknown {
    /// Unknown voltage in the armature.
    pub voltage: f64,
    /// Unknown torque at the shaft.
    pub torque: f64,
    /// Error of the measured speed.
    pub speed: f64,
}

/// The observer as a system of its own: `z(k+1) = A z(k) + b u(k) + g y(k)`, `current(k) = c z(k) + d y(k)`.
#[derive(Clone, Debug, PartialEq)]
pub struct CurrentObserver {
    /// `A`; `z` is the estimate of [`motor_with_speed_sensor`]'s states before the measurement.
    pub a: Matrix,
    /// `b`, one column.
    pub of_voltage: Matrix,
    /// `g`, one column.
    pub of_speed: Matrix,
    /// `c`, one row.
    pub current: Matrix,
    /// `d`, in amperes per rad/s.
    pub direct: f64,
}

/// The core's `winding_time` in ms with which its low-pass matches the winding: `a = T / (time + T) = 1 - exp(-T R /
/// L)`.
pub fn winding_time_ms(motor: &MotorParameters, period_s: f64) -> f64 {
    let time_s = period_s / (period_s * motor.resistance_ohm / motor.inductance_h).exp_m1();
    (1e3 * time_s).max(LEAST_WINDING_TIME_MS)
}

impl CurrentObserver {
    /// The core's observer: `i(k) = (1 - a) i(k-1) + a (u(k-1) - k w(k)) / R`, with the states of [`motor_with_speed_sensor`].
    pub fn of_core(motor: &MotorParameters, timing: &MotorTiming) -> Self {
        let states = motor_with_speed_sensor(motor, timing).a.nrows();
        // The core does not know the delay: it uses the voltage of the previous tick.
        let youngest = states - 2;
        let part = timing.period_s / (1e-3 * winding_time_ms(motor, timing.period_s) + timing.period_s);
        let conductance = part / motor.resistance_ohm;
        let of_speed = -conductance * motor.torque_constant_nm_per_a;
        let mut observer = Self {
            a: Matrix::zeros(states, states),
            of_voltage: Matrix::zeros(states, 1),
            of_speed: Matrix::zeros(states, 1),
            current: Matrix::zeros(1, states),
            direct: of_speed,
        };
        observer.current[CURRENT] = 1.0 - part;
        observer.current[youngest] = conductance;
        observer.a.row_mut(CURRENT).copy_from(&observer.current);
        observer.of_speed[CURRENT] = of_speed;
        observer.of_voltage[youngest] = 1.0;
        observer
    }

    /// The Kalman filter.
    ///
    /// # Errors
    /// [`NoSolution`] if the speed does not depend on the current.
    pub fn new(motor: &MotorParameters, timing: &MotorTiming, unknown: &Unknown) -> Result<Self, NoSolution> {
        let system = motor_with_speed_sensor(motor, timing);
        let (a, b, c) = (&system.a, &system.b, &system.c);
        let states = a.nrows();
        // Effect of a constant volt and of a constant torque during one tick. The mean over the tick shows half of it.
        // A conversion that is one tick old shows none.
        let waiting = VOLTAGE..states - 1;
        let next = if waiting.len() > 1 { a.column(VOLTAGE + 1) } else { b.column(0) };
        let mut voltage = a.column(VOLTAGE) + next;
        voltage.rows_mut(VOLTAGE, waiting.len()).fill(0.0);
        let per_volt = motor.torque_constant_nm_per_a / motor.resistance_ohm / motor.inertia_kg_m2 * timing.period_s;
        let mut torque = nalgebra::DVector::zeros(states);
        torque[0] = per_volt;
        if timing.speed == SpeedPath::Mean {
            torque[states - 1] = 0.5 * per_volt;
        }
        let scatter = unknown.speed / motor.torque_constant_nm_per_a;
        let process = unknown.voltage.powi(2) * &voltage * voltage.transpose()
            + unknown.torque.powi(2) * &torque * torque.transpose();
        let gain = kalman_gain(&system, &process, &Matrix::from_element(1, 1, scatter * scatter))?;
        let corrected = Matrix::identity(states, states) - &gain * c;
        Ok(Self {
            a: a * &corrected,
            of_voltage: b.clone(),
            of_speed: a * &gain,
            current: corrected.rows(1, 1).into_owned(),
            direct: gain[(1, 0)],
        })
    }
}

/// `M` (states x outputs) for a system with measured outputs, from the dual Riccati equation.
///
/// # Errors
/// [`NoSolution`] if an unstable mode does not show in the outputs, or `measurement` is singular.
pub fn kalman_gain(system: &Discrete, process: &Matrix, measurement: &Matrix) -> Result<Matrix, NoSolution> {
    let (a, c) = (&system.a, &system.c);
    let covariance = riccati::solve(&a.transpose(), &c.transpose(), process, measurement)?;
    let innovation = c * &covariance * c.transpose() + measurement;
    Ok(innovation.lu().solve(&(c * covariance)).ok_or(NoSolution)?.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_model::linear::spectral_radius;

    /// The scalar filter in closed form: `p = a^2 p r / (p + r) + q` with `a = q = r = 1` is the golden ratio.
    #[test]
    fn the_gain_of_a_random_walk_is_the_golden_section() {
        let one = Matrix::identity(1, 1);
        let walk = Discrete { a: one.clone(), b: one.clone(), c: one.clone(), period_s: 1.0 };
        let gain = kalman_gain(&walk, &one, &one).unwrap()[(0, 0)];
        assert!((gain - 0.5 * (5.0_f64.sqrt() - 1.0)).abs() < 1e-12, "{gain}");
    }

    /// From a wrong start, and with the motor driven in both directions, the estimate converges to the motor's current.
    #[test]
    fn the_current_follows_from_speed_and_voltage() {
        let motor = MotorParameters::PIVT6;
        let system = motor_with_speed_sensor(&motor, &MotorTiming::by_encoder(1e-3));
        for (voltage, torque) in [(1.0, 0.1), (0.1, 1.0)] {
            let unknown = Unknown { voltage, torque, speed: 0.1 };
            let observer = CurrentObserver::new(&motor, &MotorTiming::by_encoder(1e-3), &unknown).unwrap();
            assert!(spectral_radius(&observer.a) < 0.99);
            let mut x = nalgebra::DVector::zeros(system.a.nrows());
            let mut z = nalgebra::DVector::repeat(x.len(), 3.0);
            let mut largest = 0.0_f64;
            for tick in 0..600 {
                let speed = (&system.c * &x)[0];
                let current = (&observer.current * &z)[0] + observer.direct * speed;
                let u = if tick / 20 % 2 == 0 { 6.0 } else { -4.0 };
                if tick > 500 {
                    assert!((current - x[1]).abs() < 1e-3, "{tick}: {current} A for {} A", x[1]);
                    largest = largest.max(x[1].abs());
                }
                z = &observer.a * z + &observer.of_voltage * u + &observer.of_speed * speed;
                x = &system.a * x + &system.b * u;
            }
            assert!(largest > 0.5, "{largest}");
        }
    }

    /// The core's arithmetic with the settings of a design, compared with the observer that the design assumes.
    #[test]
    fn the_core_observes_what_the_design_says() {
        use motorbench_core::observer::{ObserverConfig, ObserverState};
        use motorbench_core::quantiser::Quantiser;
        use motorbench_core::settings::{Param, Settings};
        use motorbench_core::units::{AMPERE, FULL_RANGE, VOLT};
        for (inductance_h, period_s) in [(11.7e-3, 1e-3), (58.4e-3, 1e-3), (11.7e-3, 0.5e-3), (0.3e-3, 1e-3)] {
            let motor = MotorParameters { inductance_h, ..MotorParameters::PIVT6 };
            let mut settings = Settings::defaults();
            for (param, value) in [
                (Param::TickRate, 1.0 / period_s),
                (Param::Resistance, motor.resistance_ohm),
                (Param::TorqueConstant, motor.torque_constant_nm_per_a),
                (Param::WindingTime, winding_time_ms(&motor, period_s)),
            ] {
                settings.set(param, value as f32).unwrap();
            }
            let config = Quantiser::build(&settings, ObserverConfig::quantised).unwrap();
            let range = f64::from(settings.get(Param::SpeedRange));
            let mut core = ObserverState::default();
            let observer = CurrentObserver::of_core(&motor, &MotorTiming::by_encoder(period_s));
            let mut z = nalgebra::DVector::zeros(observer.a.nrows());
            let mut before_v = 0.0;
            for tick in 0..400 {
                let (u, speed) = (if tick / 30 % 2 == 0 { 7.0 } else { -5.0 }, 60.0 * (f64::from(tick) * 0.02).sin());
                let bits = [before_v * f64::from(VOLT), speed / range * f64::from(FULL_RANGE)].map(|bits| bits as i16);
                let found_a = f64::from(core.step(&config, bits[0], bits[1], 0)) / f64::from(AMPERE);
                let current_a = (&observer.current * &z)[0] + observer.direct * speed;
                // The rounding of both constants.
                assert!((found_a - current_a).abs() < 6e-3, "{tick}: {found_a} A for {current_a} A");
                z = &observer.a * z + &observer.of_voltage * u + &observer.of_speed * speed;
                before_v = u;
            }
        }
    }

    #[test]
    fn what_grows_unseen_cannot_be_observed() {
        let system = Discrete {
            a: Matrix::from_diagonal(&nalgebra::dvector![0.5, 1.1]),
            b: Matrix::zeros(2, 1),
            c: Matrix::from_row_slice(1, 2, &[1.0, 0.0]),
            period_s: 1.0,
        };
        assert!(kalman_gain(&system, &Matrix::identity(2, 2), &Matrix::identity(1, 1)).is_err());
    }
}
