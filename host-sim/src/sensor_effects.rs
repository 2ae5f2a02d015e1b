//! The sensor effects of a model, below the core: offset, lag and saturation of the current sensor. Also an eccentric
//! or lossy encoder, and ripple and lag of a tachogenerator.

use crate::plant::PeriodEnd;
use motorbench_model::between_rows::Bulge;
use motorbench_model::catalogue::{Effect, Readings, Sampling, Sensor};
use motorbench_model::{Model, Term};

/// The effects of a model on its sensors, read once in a PWM period. A lag follows the current as it is sampled there.
#[derive(Clone, Debug, Default)]
pub struct SensorEffects {
    current_and_encoder: Vec<(Term, Vec<f64>)>,
    tachogenerator: Vec<(Term, Vec<f64>)>,
    /// Whether it has been read before.
    tachogenerator_was_read: bool,
    /// True angle at the last reading, and the encoder's error at the first: it counts from there.
    last: Option<Last>,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    angle_rad: f64,
    zero_rad: f64,
}

impl SensorEffects {
    /// The effects of a model.
    pub fn of(model: &Model) -> Self {
        let on_sensors = |effect: &dyn Effect| effect.about().sensor.is_some();
        let (tachogenerator, others): (Vec<_>, Vec<_>) = model
            .in_turn(on_sensors)
            .into_iter()
            .cloned()
            .partition(|term| term.effect.about().sensor == Some(Sensor::Tachogenerator));
        let with_state = |term: Term| {
            let states = vec![0.0; term.effect.states()];
            (term, states)
        };
        Self {
            current_and_encoder: others.into_iter().map(with_state).collect(),
            tachogenerator: tachogenerator.into_iter().map(with_state).collect(),
            tachogenerator_was_read: false,
            last: None,
        }
    }

    /// Readings of current sensor and encoder over PWM periods; `None` if they equal the true values.
    pub fn read(&mut self, period_s: f64, ends: &[PeriodEnd]) -> Option<Vec<PeriodEnd>> {
        let any = !self.current_and_encoder.is_empty();
        any.then(|| ends.iter().map(|end| self.read_one(period_s, end)).collect())
    }

    fn read_one(&mut self, period_s: f64, end: &PeriodEnd) -> PeriodEnd {
        let step_s = if self.last.is_some() { period_s } else { 0.0 };
        let last_rad = self.last.map_or(end.angle_rad, |last| last.angle_rad);
        let mut readings = Readings {
            current_a: end.sampled_a,
            speed_rad_per_s: (end.angle_rad - last_rad) / period_s,
            angle_rad: end.angle_rad,
        };
        let at = Sampling { angle_rad: end.angle_rad, step_s, bulge: Bulge::NONE, speed_bulge: Bulge::NONE };
        for (term, state) in &mut self.current_and_encoder {
            term.effect.sense(&term.values, &at, state, &mut readings);
        }
        let zero_rad = self.last.map_or(readings.angle_rad - end.angle_rad, |last| last.zero_rad);
        self.last = Some(Last { angle_rad: end.angle_rad, zero_rad });
        PeriodEnd { angle_rad: readings.angle_rad - zero_rad, sampled_a: readings.current_a }
    }

    /// The speed that a tachogenerator shows, `since_s` after it was read last.
    pub fn tachogenerator_rad_per_s(&mut self, since_s: f64, speed_rad_per_s: f64, angle_rad: f64) -> f64 {
        let mut readings = Readings { current_a: 0.0, speed_rad_per_s, angle_rad };
        let step_s = if self.tachogenerator_was_read { since_s } else { 0.0 };
        self.tachogenerator_was_read = true;
        let at = Sampling { angle_rad, step_s, bulge: Bulge::NONE, speed_bulge: Bulge::NONE };
        for (term, state) in &mut self.tachogenerator {
            term.effect.sense(&term.values, &at, state, &mut readings);
        }
        readings.speed_rad_per_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trial::Trial;
    use motorbench_core::message::Mode;
    use motorbench_core::settings::{Param, Settings};
    use motorbench_core::units::AMPERE;
    use motorbench_model::catalogue::effect;
    use motorbench_model::motor::MotorParameters;

    /// At 6 V after half a second: speed and current as the core measures them, and their true values.
    fn measured_and_true(id: &str, values: Vec<f64>) -> [f64; 4] {
        let model = Model::linear(MotorParameters::PIVT6).with(effect(id).unwrap(), values);
        let mut settings = Settings::defaults();
        settings.set(Param::SlewLimit, 30_000.0).unwrap();
        let mut trial = Trial::of_model(&model, settings).unwrap();
        trial.enter(Mode::OpenLoop);
        let last = *trial.follow(6.0, 0.5).last().unwrap();
        let measured_a = f64::from(trial.sample().current) / f64::from(AMPERE);
        [last.measured_rad_per_s, last.omega_rad_per_s, measured_a, last.i_a]
    }

    #[test]
    fn the_core_measures_what_the_sensors_show() {
        let [.., measured_a, true_a] = measured_and_true("current_offset", vec![0.2]);
        assert!((measured_a - true_a - 0.2).abs() < 0.05, "{measured_a} {true_a}");
        // Every tenth count is lost.
        let [measured, omega, ..] = measured_and_true("missed_counts", vec![0.1, 0.0, 1.0]);
        assert!((measured / omega - 0.9).abs() < 0.01, "{measured} {omega}");
    }

    /// A delayed voltage is commanded first, and acts later.
    #[test]
    fn the_motor_waits_for_a_late_voltage() {
        let moved_s = |delay_s: f64| {
            let model = Model::linear(MotorParameters::PIVT6).with(effect("actuation_delay").unwrap(), vec![delay_s]);
            let mut trial = Trial::of_model(&model, Settings::defaults()).unwrap();
            trial.enter(Mode::OpenLoop);
            let points = trial.follow(6.0, 0.1);
            points.iter().find(|point| point.i_a > 0.0).unwrap().t_s
        };
        let prompt_s = moved_s(0.0);
        for ticks in [1, 7, 50] {
            let delay_s = 1e-3 * f64::from(ticks);
            assert!((moved_s(delay_s) - prompt_s - delay_s).abs() < 1e-6, "{delay_s}");
        }
    }
}
