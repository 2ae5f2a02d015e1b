//! A constant of an effect.

use crate::unit::Unit;

/// A constant of an effect.
#[derive(Debug)]
pub struct Parameter {
    /// Its name in model files and results; it ends with the suffix of its unit.
    pub name: &'static str,
    /// Its unit.
    pub unit: Unit,
    /// Whether a fit may move it. The others are whole numbers or choices between two laws, which are tried one by one.
    pub fitted: bool,
    /// Its default, which model files and results leave out.
    pub default: Option<f64>,
    /// Least value that makes sense.
    pub min: f64,
    /// Greatest value that makes sense.
    pub max: f64,
    /// Prior mean and standard deviation, where something is known of it before any recording.
    pub known: Option<(f64, f64)>,
    /// Whether it is a time constant that is limited by the length of the recording. A much longer one looks like a constant.
    pub slow: bool,
    /// Greatest share of the no-load speed that it may reach. Above it another effect's law holds.
    pub most_of_speed: f64,
}

impl Parameter {
    /// A constant without a sign.
    pub(super) const fn positive(name: &'static str, unit: Unit) -> Self {
        Self::within(name, unit, 0.0, f64::INFINITY)
    }

    /// A constant that may have either sign.
    pub(super) const fn signed(name: &'static str, unit: Unit) -> Self {
        Self::within(name, unit, f64::NEG_INFINITY, f64::INFINITY)
    }

    /// A constant within bounds.
    pub(super) const fn within(name: &'static str, unit: Unit, min: f64, max: f64) -> Self {
        assert!(unit.is_said_by(name), "the name of a constant ends with the suffix of its unit");
        Self {
            name,
            unit,
            fitted: true,
            default: None,
            min,
            max,
            known: None,
            slow: false,
            most_of_speed: f64::INFINITY,
        }
    }

    /// The time constant of a process that goes on while the motor runs.
    pub(super) const fn slow(name: &'static str, min: f64, max: f64) -> Self {
        Self { slow: true, ..Self::within(name, Unit::Second, min, max) }
    }

    /// A speed up to a share of the no-load speed.
    pub(super) const fn of_speed(name: &'static str, most_of_speed: f64) -> Self {
        Self { most_of_speed, ..Self::positive(name, Unit::RadianPerSecond) }
    }

    /// A whole number, tried and not fitted.
    pub(super) const fn tried(name: &'static str) -> Self {
        Self { fitted: false, ..Self::within(name, Unit::One, 1.0, f64::INFINITY) }
    }

    /// A choice between two laws, 0 or 1, tried and not fitted; 0 is the default.
    pub(super) const fn choice(name: &'static str) -> Self {
        Self { fitted: false, ..Self::of_another_law(name, Unit::One, 1.0) }
    }

    /// A constant that only the less usual law has; its default 0 stands for the usual one.
    pub(super) const fn of_another_law(name: &'static str, unit: Unit, max: f64) -> Self {
        Self { default: Some(0.0), ..Self::within(name, unit, 0.0, max) }
    }

    /// Of a strength: the value at which the effect is absent.
    pub fn nothing(&self) -> f64 {
        self.min.max(0.0)
    }

    /// Whether it is a whole number of something.
    pub fn is_number(&self) -> bool {
        !self.fitted && self.default.is_none()
    }

    /// Whether it is a choice between two laws.
    pub fn is_choice(&self) -> bool {
        !self.fitted && self.default.is_some()
    }

    /// Whether a fit moves it from this value. From a default it does not: that would change the law.
    pub fn moves(&self, value: f64) -> bool {
        self.fitted && self.default != Some(value)
    }
}
