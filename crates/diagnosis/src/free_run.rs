//! Free-running simulation: the model alone, driven by the recorded command over a whole recording.
//!
//! Within a step the linear part is solved exactly (matrix exponential), also where the voltage changes within it. The
//! terms of the effects are constant over it. Those that oppose a state act implicitly: resistance and viscous friction by
//! the trapezoidal rule. A dry term moves its state towards zero and never beyond, so the shaft sticks and the diodes block
//! at any step (time stepping after Moreau). A current that touches zero in each period of the PWM follows the volts at the
//! end of the step.

mod reading;
mod replay;
mod run;

pub use reading::read;
pub use replay::Replay;

use crate::dataset::{Dataset, Stretch};
use motorbench_model::catalogue::{Balance, Coordinate, Instant};
use motorbench_model::{LinearSteps, Model};
use std::ops::Range;

/// The prediction of each measured quantity, in the order of [`Dataset::measured`].
pub type Prediction = Vec<Vec<f64>>;

/// Step size of the simulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Steps {
    /// For predictions that are compared with the data.
    Fine,
    /// Twice as long: for differences between two simulations, in which the errors of the steps cancel.
    Coarse,
    /// Half as long: for the error of the steps.
    Halved,
    /// At most this many seconds.
    AtMost(f64),
}

/// Longest step that the terms of a model allow.
pub fn longest_step_s(model: &Model) -> f64 {
    model.terms.iter().map(|term| term.effect.longest_step_s()).fold(f64::INFINITY, f64::min)
}

/// Simulates every stretch of the data.
pub fn free_run(model: &Model, data: &Dataset) -> Prediction {
    Replay::new(data).free_run(model)
}

/// The true motion of the model, before its sensors: one entry a sample of the data, NaN between stretches.
#[derive(Clone, Debug)]
pub struct Motion {
    current_a: Vec<f64>,
    speed_rad_per_s: Vec<f64>,
    angle_rad: Vec<f64>,
    /// Angle of the shaft: as measured, plus the lost counts of the model.
    shaft_rad: Vec<f64>,
    /// Mean of the current since the sample before, less the mean of the two samples.
    bulge_a: Vec<f64>,
}

impl Motion {
    fn not_known(samples: usize) -> Self {
        let column = || vec![f64::NAN; samples];
        Self {
            current_a: column(),
            speed_rad_per_s: column(),
            angle_rad: column(),
            shaft_rad: column(),
            bulge_a: column(),
        }
    }

    /// Whether the motor came to the end of each stretch with a current and a speed: what is not a number stays so.
    fn is_finite(&self, data: &Dataset) -> bool {
        let mut ends = data.stretches.iter().filter_map(|stretch| stretch.rows.clone().last());
        ends.all(|end| self.current_a[end].is_finite() && self.speed_rad_per_s[end].is_finite())
    }

    /// The motor between a row and the next one of its stretch.
    pub(crate) fn instant(&self, data: &Dataset, row: usize) -> Instant {
        Instant {
            time_s: data.time_s[row],
            voltage_v: if data.axis.drive.is_voltage() { data.command[row] } else { 0.0 },
            duty: data.duty[row],
            mean_duty: data.duty[row],
            supply_v: data.supply_v[row],
            open: data.open[row] || !data.axis.drive.is_voltage(),
            current_a: self.current_a[row],
            speed_rad_per_s: self.speed_rad_per_s[row],
            middle_rad_per_s: self.speed_rad_per_s[row],
            angle_rad: 0.5 * (self.shaft_rad[row] + self.shaft_rad[row + 1]),
            turned_rad: self.shaft_rad[row + 1] - self.shaft_rad[row],
            step_s: data.time_s[row + 1] - data.time_s[row],
        }
    }

    /// The angle at a time before a row, if the stretch had begun: a cubic with the speeds of the neighbouring rows.
    fn angle_before(&self, row: usize, first: usize, rows_s: &[f64], time_s: f64) -> Option<f64> {
        let from = (first..=row).rev().find(|row| rows_s[*row] <= time_s)?;
        if from == row {
            return Some(self.angle_rad[row]);
        }
        let interval_s = rows_s[from + 1] - rows_s[from];
        let turned_rad = self.angle_rad[from + 1] - self.angle_rad[from];
        let bent_rad = [from, from + 1].map(|at| self.speed_rad_per_s[at] * interval_s - turned_rad);
        let course = Course { from_rad: self.angle_rad[from], turned_rad, bent_rad };
        Some(course.angle_rad((time_s - rows_s[from]) / interval_s))
    }
}

/// Drives the motor of the model with the recorded command.
pub fn drive(model: &Model, data: &Dataset, steps: Steps) -> Motion {
    Replay::new(data).drive(model, steps)
}

/// The angle or position of the model alone, in each stretch from where it was measured first.
pub fn position(model: &Model, data: &Dataset) -> Vec<f64> {
    let mut position = drive(model, data, Steps::Fine).angle_rad;
    for Stretch { rows, .. } in &data.stretches {
        position[rows.clone()].iter_mut().for_each(|angle| *angle += data.angle_rad[rows.start]);
    }
    position
}

/// A motion with the first-order response of the linear motor to a small added torque and voltage. Where the motor was at
/// rest it stays at rest.
pub fn nudged(model: &Model, data: &Dataset, motion: &Motion, added: impl Fn(&Instant) -> Balance<'static>) -> Motion {
    let mut nudged = motion.clone();
    let mut steps = LinearSteps::new(&model.motor, inertia_kg_m2(model));
    for Stretch { rows: range, .. } in data.stretches.iter().filter(|stretch| !data.is_held(stretch)) {
        let (mut current_a, mut speed_rad_per_s, mut angle_rad) = (0.0, 0.0, 0.0);
        for index in range.start..range.end - 1 {
            let next = index + 1;
            let step_s = data.time_s[next] - data.time_s[index];
            let step = steps.of_length(step_s);
            let at = motion.instant(data, index);
            let before = speed_rad_per_s;
            let Balance { torque_nm, voltage_v, .. } = added(&at);
            [current_a, speed_rad_per_s] = match at.open {
                // Nothing is added to a current that is imposed.
                true => [0.0, step.speed_without_current(before, torque_nm)],
                false => step.respond(current_a, before, voltage_v, torque_nm),
            };
            if at.speed_rad_per_s == 0.0 && motion.speed_rad_per_s[next] == 0.0 {
                speed_rad_per_s = 0.0;
            }
            angle_rad += 0.5 * (before + speed_rad_per_s) * step_s;
            nudged.current_a[next] += current_a;
            nudged.speed_rad_per_s[next] += speed_rad_per_s;
            nudged.angle_rad[next] += angle_rad;
        }
    }
    nudged
}

/// The angle between two samples: a cubic with the speed at either. In 10 ms an accelerating shaft deviates visibly
/// from a straight line.
struct Course {
    from_rad: f64,
    turned_rad: f64,
    /// Slopes at the beginning and at the end, less that of the straight line.
    bent_rad: [f64; 2],
}

impl Course {
    /// As measured, with the speeds of the neighbouring samples of the same stretch.
    fn new(data: &Dataset, rows: Range<usize>, index: usize) -> Self {
        let (angle, time) = (&data.angle_rad, &data.time_s);
        let turned_rad = angle[index + 1] - angle[index];
        let interval_s = time[index + 1] - time[index];
        let slope = |from: usize, to: usize| (angle[to] - angle[from]) / (time[to] - time[from]) * interval_s;
        let first = index.saturating_sub(1).max(rows.start);
        let last = (index + 2).min(rows.end - 1);
        let bent_rad = [slope(first, index + 1) - turned_rad, slope(index, last) - turned_rad];
        Self { from_rad: angle[index], turned_rad, bent_rad }
    }

    /// The angle at a share of the time between the two, and the turn from `half` before it to `half` after it; zeros where
    /// nobody asks for them.
    fn around(course: Option<&Self>, middle: f64, half: f64) -> [f64; 2] {
        course.map_or([0.0; 2], |course| {
            [course.angle_rad(middle), course.angle_rad(middle + half) - course.angle_rad(middle - half)]
        })
    }

    /// `share`: of the time between the two.
    fn angle_rad(&self, share: f64) -> f64 {
        let rest = 1.0 - share;
        self.from_rad + share * self.turned_rad + share * rest * (rest * self.bent_rad[0] - share * self.bent_rad[1])
    }
}

/// Whether a term of the motor depends on the angle of the shaft.
fn acts_by_angle(model: &Model) -> bool {
    let effects = model.terms.iter().map(|term| term.effect).filter(|effect| effect.acts_on_motor());
    effects.map(|effect| effect.about()).any(|about| about.shown.over == Coordinate::Angle)
}

/// Inertia of the motor's own shaft; a fit may try to make it zero.
fn inertia_kg_m2(model: &Model) -> f64 {
    model.motor.inertia_kg_m2 * model.motor_share().max(0.01)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::HeldRotor;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use motorbench_model::catalogue::effect;
    use motorbench_model::motor::MotorParameters;
    use proptest::prelude::*;
    use std::fmt::Write as _;

    /// Steps of the command, recorded every `interval_s`; the measured values do not matter.
    fn stepped(interval_s: f64) -> Dataset {
        let mut text = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        for row in 0..(0.4 / interval_s).round() as usize {
            let time_s = row as f64 * interval_s;
            let volts = if (time_s * 50.0 + 1e-6).floor() % 2.0 == 0.0 { 12.0 } else { -3.0 };
            let (speed, current) = if row % 2 == 0 { (100, 0) } else { (101, 1) };
            let _ = writeln!(text, "{time_s:.6},{volts},{speed},{current}");
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        Dataset::new(&[recording], &Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap()).unwrap()
    }

    /// Of sensors as well as of the motor: the order of discovery is not the order of action.
    #[test]
    fn the_order_of_effects_does_not_change_the_simulation() {
        let effects: [(&str, &[f64]); 5] = [
            ("current_lag", &[2e-3, 0.0, 0.0]),
            ("current_offset", &[-0.3]),
            ("current_clipping", &[0.8]),
            ("encoder_eccentricity", &[0.02, 0.01]),
            ("missed_counts", &[0.3, 50.0, 1.0, 0.0, 0.0]),
        ];
        let with = |model: Model, (id, values): &(&str, &[f64])| model.with(effect(id).unwrap(), values.to_vec());
        let linear = || Model::linear(MotorParameters::PIVT6);
        let data = stepped(1e-3);
        let as_listed = free_run(&effects.iter().fold(linear(), with), &data);
        assert_eq!(free_run(&effects.iter().rev().fold(linear(), with), &data), as_listed);
        assert!(as_listed[0].iter().all(|current| current.abs() <= 0.8), "the range ends what the offset has moved");
    }

    /// Not half a step earlier or later, wherever in a row that is.
    #[test]
    fn a_load_step_begins_at_its_time() {
        let speed_after = |interval_s: f64, time_s: f64| {
            let data = stepped(interval_s);
            let model = Model::linear(MotorParameters::PIVT6).with(effect("load_step").unwrap(), vec![0.02, time_s]);
            free_run(&model, &data)[1][(0.15 / interval_s).round() as usize]
        };
        for time_s in [0.1450, 0.1452, 0.1457] {
            let (coarse, fine) = (speed_after(1e-3, time_s), speed_after(50e-6, time_s));
            let by_a_step = 0.02 / MotorParameters::PIVT6.inertia_kg_m2 * 0.25e-3;
            assert!((coarse - fine).abs() < 0.2 * by_a_step, "{time_s}: {coarse} {fine}, {by_a_step} by half a step");
        }
    }

    /// Whatever torque acts, the winding alone determines the current.
    #[test]
    fn a_rotor_that_is_held_does_not_turn() {
        let mut data = stepped(1e-3);
        data.origin.held_rotor = vec![HeldRotor { name: "run.csv".into(), rows: 0..data.len() }];
        data.measured[1].values.fill(f64::NAN);
        let motor = MotorParameters::PIVT6;
        let model = Model::linear(motor).with(effect("coulomb_friction").unwrap(), vec![0.01]);
        let model = model.with(effect("cogging").unwrap(), vec![0.02, 0.01, 12.0]);
        let prediction = free_run(&model, &data);
        assert!(prediction[1].iter().all(|speed| speed.abs() < 1e-9), "{:?}", prediction[1]);
        // Each level lasts for many time constants of the winding.
        let end_of_level = 19;
        let settled_a = data.command[end_of_level - 1] / motor.resistance_ohm;
        let share_left = (-18e-3 * motor.resistance_ohm / motor.inductance_h).exp();
        let flows_a = prediction[0][end_of_level];
        assert!((flows_a - settled_a).abs() < (1e-3 + 2.0 * share_left) * settled_a, "{flows_a} {settled_a}");
    }

    /// From a start at rest, and where the bridge opens and closes within a step.
    #[test]
    fn a_delay_shifts_the_commands() {
        let mut text = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        for row in 0..300 {
            let volts = if row / 50 % 2 == 0 { "12" } else { "" };
            let _ = writeln!(text, "{:.3},{volts},{},{}", f64::from(row) * 1e-3, row / 2 + row % 2, row % 2);
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        let data = Dataset::new(&[recording], &Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap()).unwrap();
        assert!(data.open[75] && !data.open[25]);
        let linear = Model::linear(MotorParameters::PIVT6);
        let late = |delay_s: f64| free_run(&linear.with(effect("actuation_delay").unwrap(), vec![delay_s]), &data);
        let [at_once, by_two_rows, between] = [0.0, 2e-3, 1.37e-3].map(late);
        for channel in 0..2 {
            let largest = at_once[channel].iter().fold(0.0_f64, |most, value| most.max(value.abs()));
            for row in 2..300 {
                let (later, earlier) = (by_two_rows[channel][row], at_once[channel][row - 2]);
                assert!((later - earlier).abs() < 1e-3 * largest, "channel {channel}, row {row}: {later} {earlier}");
            }
        }
        assert_eq!(by_two_rows[0][..3], [0.0; 3], "nothing has acted yet");
        // After the bridge has opened no current flows; before that it does.
        let [before, after] = [51, 52].map(|row| between[0][row]);
        assert!(before > 0.1 && after == 0.0, "{before} {after}");
    }

    #[test]
    fn a_clock_drift_is_a_delay_that_grows() {
        let data = stepped(1e-3);
        let linear = Model::linear(MotorParameters::PIVT6);
        let with = |id: &str, value: f64| free_run(&linear.with(effect(id).unwrap(), vec![value]), &data)[1].clone();
        let (at_once, late) = (free_run(&linear, &data)[1].clone(), with("actuation_delay", 1e-3));
        let error = |one: &[f64], other: &[f64], rows: Range<usize>| {
            rows.map(|row| (one[row] - other[row]).abs()).fold(0.0, f64::max)
        };
        let moved = error(&at_once, &late, 0..400);
        // 5000 ppm: 1 ms in the middle, and twice that at the end.
        let later = with("clock_drift", 5000.0);
        assert!(error(&later, &at_once, 0..20) < 0.15 * moved, "at the begin it is not late");
        assert!(error(&later, &late, 180..220) < 0.4 * moved, "in the middle it is as late as the delay");
        assert!(error(&later, &late, 340..400) > 0.5 * moved, "at the end it is later");
        let earlier = with("clock_drift", -5000.0);
        assert!(error(&earlier[0..399], &at_once[1..400], 180..220) < 0.4 * moved, "in the middle it is a row early");
        assert!(error(&earlier[0..397], &at_once[2..399], 340..397) < 0.4 * moved, "at the end it is two rows early");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// Compared with the mean of a simulation with forty times as many rows.
        #[test]
        fn a_current_is_averaged_before_its_row(window_s in 0.2e-3_f64..3e-3, inductance_h in 0.5e-3_f64..12e-3) {
            let model = Model::linear(MotorParameters { inductance_h, ..MotorParameters::PIVT6 });
            let mut data = stepped(1e-3);
            data.origin.current_window_s = window_s;
            let means = &free_run(&model, &data)[0];
            let fine = stepped(25e-6);
            let currents = &free_run(&model, &fine)[0];
            let mut charges = vec![0.0];
            for pair in currents.windows(2) {
                charges.push(charges[charges.len() - 1] + 25e-6 * 0.5 * (pair[0] + pair[1]));
            }
            let charge = |time_s: f64| {
                let place = (time_s / 25e-6).max(0.0);
                let (row, part) = (place.floor() as usize, place.fract());
                charges[row] + part * (charges[row + 1] - charges[row])
            };
            let greatest = currents.iter().fold(0.0, |most: f64, current| most.max(current.abs()));
            for (row, found) in means.iter().enumerate().skip(4).take(386) {
                let time_s = row as f64 * 1e-3;
                let mean = (charge(time_s) - charge(time_s - window_s)) / window_s;
                prop_assert!((found - mean).abs() < 0.01 * greatest, "row {row}: {found} {mean}");
            }
        }

    }
}
