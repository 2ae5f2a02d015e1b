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

use crate::axis::{Axis, Drive, Motion};
use crate::catalogue::{Alone, CATALOGUE, DryLosses, Effect, OffPhase, Parameter, Scales, effect};
use crate::motor::{MotorParameters, NonPhysical};
use crate::unit::{Quantity, Unit};
use motorbench_text::keys;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use toml::de::DeTable;

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

    /// How many of its constants a fit moves.
    pub fn moving(&self) -> usize {
        let constants = self.effect.about().parameters.iter().zip(&self.values);
        constants.filter(|(constant, value)| constant.moves(**value)).count()
    }

    /// See [`Law::turn`](crate::catalogue::Law::turn).
    pub fn turn(&self) -> i8 {
        self.effect.turn(&self.values)
    }

    /// See [`Law::dry_losses`](crate::catalogue::Law::dry_losses).
    pub fn dry_losses(&self) -> DryLosses {
        self.effect.dry_losses(&self.values)
    }

    /// The same beside a motor with a quantity `factor` times as large, as [`Model::scaled`].
    pub fn scaled(&self, quantity: Quantity, factor: f64) -> Self {
        let constants = self.effect.about().parameters.iter().zip(&self.values);
        let values = constants.map(|(parameter, value)| value * factor.powf(quantity.power(parameter.unit))).collect();
        Self { effect: self.effect, values }
    }

    /// Whether it is more than nothing.
    pub fn is_there(&self) -> bool {
        let is_something = |index: usize| self.values[index] != self.effect.about().parameters[index].nothing();
        self.effect.about().strengths().into_iter().all(|mut group| group.any(is_something))
    }

    /// Whether it follows another of its laws than the usual one.
    pub fn has_another_law(&self) -> bool {
        let mut constants = self.effect.about().parameters.iter().zip(&self.values);
        constants.any(|(constant, value)| constant.default.is_some_and(|usual| usual != *value))
    }

    /// Places, parameters and values of its constants, without those at their defaults.
    pub fn without_defaults(&self) -> impl Iterator<Item = (usize, &'static Parameter, f64)> {
        let parameters = self.effect.about().parameters.iter().zip(&self.values).enumerate();
        parameters
            .filter(|(_, (parameter, value))| parameter.default != Some(**value))
            .map(|(index, (parameter, value))| (index, parameter, *value))
    }
}

impl std::fmt::Debug for Term {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let constants = self.without_defaults().map(|(_, parameter, value)| (parameter.name, value));
        write!(f, "{}{:?}", self.id(), constants.collect::<Vec<_>>())
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
    Syntax(String),
    /// A table that is none, and looks like one.
    #[error("line {line}: unknown table [{key}]; did you mean [{meant}]?")]
    UnknownTable {
        /// Where.
        line: usize,
        /// What stands there.
        key: String,
        /// What was meant.
        meant: &'static str,
    },
    /// An axis behind a drive, where a motor behind a bridge is needed.
    #[error(
        "[axis]: this model has no winding, so it cannot be driven by a voltage. `motorbench compare RECORDING MODEL` simulates it"
    )]
    Axis,
    /// A constant that no motor has.
    #[error("[motor] {0}")]
    Motor(#[from] NonPhysical),
    /// An effect that the catalogue does not have.
    #[error("line {line}: [effects.{id}]: no such effect{meant}; there are {known}")]
    UnknownEffect {
        /// Where.
        line: usize,
        /// What was asked for.
        id: String,
        /// What was meant, as the message says it.
        meant: String,
        /// What there is.
        known: String,
    },
    /// The constants of an effect are not those of the catalogue.
    #[error("line {line}: [effects.{id}]: expected {expected}; {name} is {what}")]
    EffectConstants {
        /// Where: of the constant, or of the effect that lacks it.
        line: usize,
        /// Which effect.
        id: String,
        /// Its constants.
        expected: String,
        /// Which is wrong.
        name: String,
        /// How.
        what: String,
    },
}

impl Model {
    /// A linear motor alone.
    pub fn linear(motor: MotorParameters) -> Self {
        Self { motor, terms: Vec::new() }
    }

    /// Whether each of its constants is a finite number.
    pub fn is_finite(&self) -> bool {
        let of_motor = self.motor.named().into_iter().map(|(_, value)| value);
        let of_terms = self.terms.iter().flat_map(|term| term.values.iter().copied());
        of_motor.chain(of_terms).all(f64::is_finite)
    }

    /// By how much the voltage comes later than it was asked for.
    pub fn delay_s(&self) -> f64 {
        self.terms.iter().map(|term| term.effect.delay_s(&term.values)).sum()
    }

    /// By how much that grows in each second of the recording.
    pub fn delay_growth(&self) -> f64 {
        self.terms.iter().map(|term| term.effect.delay_growth(&term.values)).sum()
    }

    /// By how much a tachogenerator shows the speed later than it is.
    pub fn tachogenerator_lag_s(&self) -> f64 {
        self.terms.iter().map(|term| term.effect.tachogenerator_lag_s(&term.values)).sum()
    }

    /// The same with one effect more. Its last constants may be left out if they have defaults.
    pub fn with(&self, effect: &'static dyn Effect, mut values: Vec<f64>) -> Self {
        let defaults = effect.about().parameters[values.len()..].iter().map(|parameter| parameter.default);
        values.extend(defaults.map(|value| value.expect("a constant without a default is given")));
        let mut terms = self.terms.clone();
        terms.push(Term { effect, values });
        Self { motor: self.motor, terms }
    }

    /// The same with one effect more, at the first of its starts.
    pub fn with_start(&self, effect: &'static dyn Effect, scales: &Scales) -> Self {
        self.with(effect, effect.starts(scales).swap_remove(0))
    }

    /// The same with other values of one of its terms.
    pub fn with_values(&self, term: usize, values: Vec<f64>) -> Self {
        let mut model = self.clone();
        model.terms[term].values = values;
        model
    }

    /// The same without an effect.
    pub fn without(&self, id: &str) -> Self {
        let terms = self.terms.iter().filter(|term| term.id() != id).cloned().collect();
        Self { motor: self.motor, terms }
    }

    /// Those of its terms that are chosen, in their turn.
    pub fn in_turn(&self, chosen: impl Fn(&dyn Effect) -> bool) -> Vec<&Term> {
        let mut terms: Vec<&Term> = self.terms.iter().filter(|term| chosen(term.effect)).collect();
        terms.sort_by_key(|term| term.turn());
        terms
    }

    /// Whether it has an effect.
    pub fn has(&self, id: &str) -> bool {
        self.term(id).is_some()
    }

    /// One of its effects.
    pub fn term(&self, id: &str) -> Option<&Term> {
        self.terms.iter().find(|term| term.id() == id)
    }

    /// The same with the constants that it [holds](Self::holds) at their prior means.
    pub fn with_prior_means(mut self) -> Self {
        for index in 0..self.terms.len() {
            if self.holds(&self.terms[index]) {
                let term = &mut self.terms[index];
                for (value, constant) in term.values.iter_mut().zip(term.effect.about().parameters) {
                    *value = constant.known.map_or(*value, |(mean, _)| mean);
                }
            }
        }
        self
    }

    /// Whether a term's constants are held at their prior means: the data cannot tell them from another of its effects.
    pub fn holds(&self, term: &Term) -> bool {
        term.effect.about().held_beside.is_some_and(|id| self.has(id))
    }

    /// The model that does the same where a quantity is `factor` times as large: each constant times that power of it that
    /// its unit has.
    pub fn scaled(&self, quantity: Quantity, factor: f64) -> Self {
        let times = |unit: Unit| factor.powf(quantity.power(unit));
        let [resistance, inductance, torque_constant, inertia, viscous] = MotorParameters::UNITS.map(times);
        let motor = MotorParameters {
            resistance_ohm: self.motor.resistance_ohm * resistance,
            inductance_h: self.motor.inductance_h * inductance,
            torque_constant_nm_per_a: self.motor.torque_constant_nm_per_a * torque_constant,
            inertia_kg_m2: self.motor.inertia_kg_m2 * inertia,
            viscous_friction_nm_s: self.motor.viscous_friction_nm_s * viscous,
        };
        Self { motor, terms: self.terms.iter().map(|term| term.scaled(quantity, factor)).collect() }
    }

    /// What of the inertia turns with the motor's own shaft.
    pub fn motor_share(&self) -> f64 {
        self.terms.iter().map(|term| term.effect.motor_share(&term.values)).product()
    }

    /// What its effects take at any speed and current.
    pub fn dry_losses(&self) -> DryLosses {
        self.terms.iter().map(Term::dry_losses).sum()
    }

    /// What a bridge does between pulses for it.
    pub fn off_phase(&self) -> OffPhase {
        self.terms.iter().find_map(|term| term.effect.off_phase(&term.values)).unwrap_or(OffPhase::Brakes)
    }

    /// What an effect is in a model that lacks the effect it requires; `None` if the model does not lack it.
    pub fn alone(&self, effect: &dyn Effect) -> Option<Alone> {
        effect.about().requires.filter(|(other, _)| !self.has(other)).map(|(_, alone)| alone)
    }

    /// Reads a model file.
    ///
    /// # Errors
    /// [`ModelError`], which names line or key.
    pub fn parse(text: &str) -> Result<Self, ModelError> {
        let syntax = |error: toml::de::Error| ModelError::Syntax(keys::explained(&error));
        if DeTable::parse(text).map_err(syntax)?.get_ref().contains_key("axis") {
            return Err(ModelError::Axis);
        }
        // Other tables belong to the rig or the scenario in whose file the model stands.
        for key in DeTable::parse(text).map_err(syntax)?.get_ref().keys().map(|key| key.get_ref()) {
            let slip = |meant: &&str| *meant != key.as_ref();
            if let Some(meant) = keys::nearest(key, ["motor", "effects"]).filter(slip) {
                let line = keys::line(text, &[key]).unwrap_or(1);
                return Err(ModelError::UnknownTable { line, key: key.to_string(), meant });
            }
        }
        let file: ModelFile = toml::from_str(text).map_err(syntax)?;
        file.motor.check()?;
        let term = |(id, constants): (&String, _)| read_term(text, id, constants);
        let terms = file.effects.iter().map(term).collect::<Result<_, _>>()?;
        Ok(Self { motor: file.motor, terms })
    }

    /// Reads a model file of a motor, or of an axis behind a drive.
    ///
    /// # Errors
    /// [`ModelError`], which names line or key.
    pub fn parse_with_axis(text: &str) -> Result<(Axis, Self), ModelError> {
        match Self::parse(text) {
            Err(ModelError::Axis) => {}
            other => return other.map(|model| (Axis::default(), model)),
        }
        let file: AxisFile = toml::from_str(text).map_err(|error| ModelError::Syntax(keys::explained(&error)))?;
        let table = file.axis;
        let axis = Axis { drive: table.drive, motion: table.motion };
        let motor = table.motor()?;
        let term = |(id, constants): (&String, &BTreeMap<String, f64>)| {
            read_term(text, id, &with_rotary_names(axis.motion, id, constants))
        };
        let terms = file.effects.iter().map(term).collect::<Result<_, _>>()?;
        Ok((axis, Self { motor, terms }))
    }

    /// The model of an axis as a file. A motor behind a bridge has the [usual one](Self::to_toml).
    pub fn to_toml_of(&self, axis: Axis) -> String {
        if axis.is_usual() {
            return self.to_toml();
        }
        let table = AxisTable::of(axis, &self.motor);
        let file = AxisFile { axis: table, effects: self.effects() };
        axis.motion.words(&toml::to_string(&file).expect("numbers and names are TOML")).into_owned()
    }

    /// Its effects by their identifiers, the constants of each by their names.
    pub fn effects(&self) -> BTreeMap<String, BTreeMap<String, f64>> {
        let constants =
            |term: &Term| term.without_defaults().map(|(_, parameter, value)| (parameter.name.into(), value)).collect();
        self.terms.iter().map(|term| (term.id().into(), constants(term))).collect()
    }

    /// The model as a file.
    pub fn to_toml(&self) -> String {
        toml::to_string(&ModelFile { motor: self.motor, effects: self.effects() }).expect("numbers and names are TOML")
    }
}

#[derive(Serialize, Deserialize)]
struct AxisFile {
    axis: AxisTable,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    effects: BTreeMap<String, BTreeMap<String, f64>>,
}

/// What a drive leaves of the motor's constants. Those of a linear axis are read by their own names.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct AxisTable {
    drive: Drive,
    motion: Motion,
    #[serde(skip_serializing_if = "Option::is_none")]
    resistance_ohm: Option<f64>,
    #[serde(rename = "inductance_H", skip_serializing_if = "Option::is_none")]
    inductance_h: Option<f64>,
    #[serde(
        rename = "torque_constant_Nm_per_A",
        alias = "force_constant_N_per_A",
        skip_serializing_if = "Option::is_none"
    )]
    torque_constant_nm_per_a: Option<f64>,
    #[serde(alias = "mass_kg")]
    inertia_kg_m2: f64,
    #[serde(rename = "viscous_friction_Nm_s", alias = "viscous_friction_N_s_per_m")]
    viscous_friction_nm_s: f64,
}

impl AxisTable {
    fn of(axis: Axis, motor: &MotorParameters) -> Self {
        let has = |place: usize, value: f64| axis.drive.has_constant(place).then_some(value);
        Self {
            drive: axis.drive,
            motion: axis.motion,
            resistance_ohm: has(0, motor.resistance_ohm),
            inductance_h: has(1, motor.inductance_h),
            torque_constant_nm_per_a: has(2, motor.torque_constant_nm_per_a),
            inertia_kg_m2: motor.inertia_kg_m2,
            viscous_friction_nm_s: motor.viscous_friction_nm_s,
        }
    }

    /// With ones in the place of what a drive has not.
    fn motor(&self) -> Result<MotorParameters, NonPhysical> {
        let motor = MotorParameters {
            resistance_ohm: self.resistance_ohm.unwrap_or(1.0),
            inductance_h: self.inductance_h.unwrap_or(1.0),
            torque_constant_nm_per_a: self.torque_constant_nm_per_a.unwrap_or(1.0),
            inertia_kg_m2: self.inertia_kg_m2,
            viscous_friction_nm_s: self.viscous_friction_nm_s,
        };
        motor.check().map(|()| motor)
    }
}

/// Constants of an effect by the names that they have inside.
fn with_rotary_names(motion: Motion, id: &str, constants: &BTreeMap<String, f64>) -> BTreeMap<String, f64> {
    let parameters = effect(id).map_or(&[][..], |effect| effect.about().parameters);
    let inside = |name: &String| {
        let known = parameters.iter().find(|parameter| motion.words(parameter.name) == name.as_str());
        known.map_or_else(|| name.clone(), |parameter| parameter.name.to_owned())
    };
    constants.iter().map(|(name, value)| (inside(name), *value)).collect()
}

fn read_term(text: &str, id: &str, constants: &BTreeMap<String, f64>) -> Result<Term, ModelError> {
    let at = keys::line(text, &["effects", id]).unwrap_or(1);
    let Some(effect) = effect(id) else {
        let known: Vec<&str> = CATALOGUE.iter().map(|effect| effect.about().id).collect();
        let meant = keys::suggestion(keys::nearest(id, known.iter().copied()));
        return Err(ModelError::UnknownEffect { line: at, id: id.into(), meant, known: known.join(", ") });
    };
    let parameters = effect.about().parameters;
    let error = |name: &str, what: String| ModelError::EffectConstants {
        line: keys::line(text, &["effects", id, name]).unwrap_or(at),
        id: id.into(),
        expected: parameters.iter().map(|parameter| parameter.name).collect::<Vec<_>>().join(", "),
        name: name.into(),
        what,
    };
    if let Some(name) = constants.keys().find(|name| parameters.iter().all(|parameter| parameter.name != *name)) {
        let meant = keys::nearest(name, parameters.iter().map(|parameter| parameter.name));
        return Err(error(name, format!("unknown{}", keys::suggestion(meant))));
    }
    let mut values = Vec::new();
    for parameter in parameters {
        let given = constants.get(parameter.name).copied().or(parameter.default);
        let value = given.ok_or_else(|| error(parameter.name, "missing".into()))?;
        if !(parameter.min..=parameter.max).contains(&value) || !value.is_finite() {
            return Err(error(parameter.name, "out of range".into()));
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
    fn the_file_of_an_axis_comes_back_in_its_own_units() {
        let motor = MotorParameters {
            resistance_ohm: 1.0,
            inductance_h: 1.0,
            torque_constant_nm_per_a: 1.0,
            inertia_kg_m2: 95.1,
            viscous_friction_nm_s: 203.5,
        };
        let model = Model::linear(motor).with(effect("coulomb_friction").unwrap(), vec![20.4]);
        let axis = Axis { drive: Drive::Torque, motion: Motion::Linear };
        let text = model.to_toml_of(axis);
        for part in ["mass_kg = 95.1", "viscous_friction_N_s_per_m = 203.5", "force_N = 20.4", "drive = \"force\""] {
            assert!(text.contains(part), "{text}");
        }
        assert!(!text.contains("ohm") && !text.contains("Nm"), "{text}");
        let (read_axis, read) = Model::parse_with_axis(&text).unwrap();
        assert_eq!((read_axis, read.motor), (axis, motor));
        assert_eq!(format!("{:?}", read.terms), format!("{:?}", model.terms));
        assert!(Model::parse(&text).unwrap_err().to_string().contains("no winding"));
    }

    #[test]
    fn errors_say_where() {
        let motor = Model::linear(MotorParameters::PIVT6).to_toml();
        let message = |more: &str| Model::parse(&format!("{motor}{more}")).unwrap_err().to_string();
        assert!(
            message("[effects.rust]\nx = 1").contains("[effects.rust]: no such effect; there are coulomb_friction")
        );
        assert!(message("[effects.coulomb_friction]\nx = 1").contains("expected torque_Nm; x is unknown"));
        // The motor's table takes six lines, and the key stands in the second after it.
        let slip = message("[effects.coulomb_friction]\ntorque_nm = 1");
        assert!(
            slip.starts_with("line 8: ") && slip.contains("torque_nm is unknown (did you mean torque_Nm?)"),
            "{slip}"
        );
        let slip = message("[effects.coulomb_frition]\ntorque_Nm = 1");
        assert!(slip.contains("line 7: ") && slip.contains("did you mean coulomb_friction?"), "{slip}");
        assert_eq!(message("[efects.x]"), "line 7: unknown table [efects]; did you mean [effects]?");
        let slip = Model::parse(&motor.replace("inductance_H", "inductance_h")).unwrap_err().to_string();
        assert!(slip.contains("line 3") && slip.contains("did you mean `inductance_H`?"), "{slip}");
        assert!(message("[effects.coulomb_friction]").contains("torque_Nm is missing"));
        assert!(message("[effects.coulomb_friction]\ntorque_Nm = -1").contains("out of range"));
        assert!(Model::parse("[motor]\nresistance_ohm = 1").unwrap_err().to_string().contains("missing field"));
    }

    #[test]
    fn dry_losses_are_of_friction_its_asymmetry_and_the_bridge() {
        let file = Model::linear(MotorParameters::PIVT6).to_toml()
            + "[effects.coulomb_friction]\ntorque_Nm = 0.5\n[effects.friction_asymmetry]\ndifference_Nm = 0.25\n\
               [effects.voltage_drop]\ndrop_V = 2.0\n";
        let losses = Model::parse(&file).unwrap().dry_losses();
        assert_eq!((losses.friction_forward_nm, losses.friction_reverse_nm), (0.625, 0.375));
        assert_eq!(losses.bridge_drop_v, 2.0);
    }
}
