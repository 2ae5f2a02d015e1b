//! The extended model: the linear motor and the effects found, with their constants.
//!
//! As a file:
//! ```toml
//! [motor]
//! resistance_ohm = 5.8
//! # …
//! [effects.coulomb_friction]
//! torque_Nm = 0.004
//! ```

use crate::catalogue::{Effect, effect};
use crate::motor::{MotorParameters, NonPhysical};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// An effect with values for its constants.
#[derive(Clone)]
pub struct Term {
    /// Which effect.
    pub effect: &'static dyn Effect,
    /// Its constants, in the order of [`About::parameters`](crate::catalogue::About::parameters).
    pub values: Vec<f64>,
}

impl Term {
    /// Identifier of its effect.
    pub fn id(&self) -> &'static str {
        self.effect.about().id
    }

    /// Names and values of its constants.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, f64)> {
        self.effect.about().parameters.iter().map(|parameter| parameter.name).zip(self.values.iter().copied())
    }
}

impl std::fmt::Debug for Term {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}{:?}", self.id(), self.named().collect::<Vec<_>>())
    }
}

/// See the module.
#[derive(Clone, Debug)]
pub struct Model {
    /// The linear motor.
    pub motor: MotorParameters,
    /// What it takes besides.
    pub terms: Vec<Term>,
}

#[derive(Serialize, Deserialize)]
struct ModelFile {
    motor: MotorParameters,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    effects: BTreeMap<String, BTreeMap<String, f64>>,
}

/// Why a model file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// It is not TOML, a constant of the motor is missing, or a value is not a number.
    #[error("{0}")]
    Syntax(#[from] toml::de::Error),
    /// A constant that no motor has.
    #[error("[motor] {0}")]
    Motor(#[from] NonPhysical),
    /// An effect that the catalogue does not have.
    #[error("[effects.{id}]: no such effect; there are {known}")]
    UnknownEffect {
        /// What was asked for.
        id: String,
        /// What there is.
        known: String,
    },
    /// The constants of an effect are not those of the catalogue.
    #[error("[effects.{id}]: expected {expected}; {name} is {what}")]
    EffectConstants {
        /// Which effect.
        id: String,
        /// Its constants.
        expected: String,
        /// Which is wrong.
        name: String,
        /// How.
        what: &'static str,
    },
}

impl Model {
    /// A linear motor alone.
    pub fn linear(motor: MotorParameters) -> Self {
        Self { motor, terms: Vec::new() }
    }

    /// The same with one effect more.
    pub fn with(&self, effect: &'static dyn Effect, values: Vec<f64>) -> Self {
        let mut terms = self.terms.clone();
        terms.push(Term { effect, values });
        Self { motor: self.motor, terms }
    }

    /// The same without an effect.
    pub fn without(&self, id: &str) -> Self {
        let terms = self.terms.iter().filter(|term| term.id() != id).cloned().collect();
        Self { motor: self.motor, terms }
    }

    /// Whether it has an effect.
    pub fn has(&self, id: &str) -> bool {
        self.terms.iter().any(|term| term.id() == id)
    }

    /// Whether it has the effect that one of its own makes no sense without.
    pub fn has_what_it_needs(&self, id: &str) -> bool {
        let needed = effect(id).and_then(|effect| effect.needs());
        needed.is_none_or(|needed| self.has(needed))
    }

    /// Reads a model file.
    ///
    /// # Errors
    /// [`ModelError`], which names line or key.
    pub fn parse(text: &str) -> Result<Self, ModelError> {
        let file: ModelFile = toml::from_str(text)?;
        file.motor.check()?;
        let terms = file.effects.iter().map(|(id, constants)| read_term(id, constants)).collect::<Result<_, _>>()?;
        Ok(Self { motor: file.motor, terms })
    }

    /// The model as a file.
    pub fn to_toml(&self) -> String {
        let effects = self
            .terms
            .iter()
            .map(|term| (term.id().into(), term.named().map(|(name, value)| (name.into(), value)).collect()))
            .collect();
        toml::to_string(&ModelFile { motor: self.motor, effects }).expect("numbers and names are TOML")
    }
}

fn read_term(id: &str, constants: &BTreeMap<String, f64>) -> Result<Term, ModelError> {
    let Some(effect) = effect(id) else {
        let known = crate::catalogue::CATALOGUE.map(|effect| effect.about().id).join(", ");
        return Err(ModelError::UnknownEffect { id: id.into(), known });
    };
    let parameters = effect.about().parameters;
    let error = |name: &str, what| ModelError::EffectConstants {
        id: id.into(),
        expected: parameters.iter().map(|parameter| parameter.name).collect::<Vec<_>>().join(", "),
        name: name.into(),
        what,
    };
    if let Some(name) = constants.keys().find(|name| parameters.iter().all(|parameter| parameter.name != *name)) {
        return Err(error(name, "unknown"));
    }
    let mut values = Vec::new();
    for parameter in parameters {
        let value = *constants.get(parameter.name).ok_or_else(|| error(parameter.name, "missing"))?;
        if !(parameter.min..=parameter.max).contains(&value) || !value.is_finite() {
            return Err(error(parameter.name, "out of range"));
        }
        values.push(value);
    }
    Ok(Term { effect, values })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_file_comes_back() {
        let model = Model::linear(MotorParameters::PIVT6)
            .with(effect("cogging").unwrap(), vec![1e-3, -2e-3, 7.0])
            .with(effect("voltage_drop").unwrap(), vec![1.5]);
        let read = Model::parse(&model.to_toml()).unwrap();
        assert_eq!(read.motor, model.motor);
        assert_eq!(format!("{:?}", read.terms), format!("{:?}", model.terms));
    }

    #[test]
    fn errors_say_where() {
        let motor = Model::linear(MotorParameters::PIVT6).to_toml();
        let message = |more: &str| Model::parse(&format!("{motor}{more}")).unwrap_err().to_string();
        assert!(
            message("[effects.rust]\nx = 1").contains("[effects.rust]: no such effect; there are coulomb_friction")
        );
        assert!(message("[effects.coulomb_friction]\nx = 1").contains("expected torque_Nm; x is unknown"));
        assert!(message("[effects.coulomb_friction]").contains("torque_Nm is missing"));
        assert!(message("[effects.coulomb_friction]\ntorque_Nm = -1").contains("out of range"));
        assert!(Model::parse("[motor]\nresistance_ohm = 1").unwrap_err().to_string().contains("missing field"));
    }
}
