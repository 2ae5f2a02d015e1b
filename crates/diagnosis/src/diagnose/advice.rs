//! What a person should do, and notes on what a result rests on.

use super::causes::{RESISTANCE_OHM, is_wrong};
use super::outcome::{Cause, Outcome, Parameter, Quality};
use super::select::Standing;
pub(super) use crate::configuration::diagnose::advice::OTHER_UNIT;
use crate::configuration::diagnose::advice::REPORTED_ABOVE_NOISE;
use crate::dataset::{Dataset, TOLERANCE};
use motorbench_model::catalogue::{INDUCTANCE, USUAL};
use motorbench_model::linear::motor_model::TimeConstants;
use motorbench_model::motor::MotorParameters;
use motorbench_model::{Drive, Model, Term};
use motorbench_text::terminal_text::short;

/// Advice on constants that were found beside an unknown effect.
const BESIDE_UNEXPLAINED: &str =
    "Until this is explained, all constants are approximate. Their intervals contain the noise, not the missing cause.";
/// The constant without which an imposed current has no torque.
const TORQUE_CONSTANT: &str = "torque_constant_Nm_per_A";
/// Begin of the name of viscous friction, of a shaft or a carriage.
const VISCOUS_FRICTION: &str = "viscous_friction";
/// Notes on an imposed current.
const IMPOSED_CURRENT: &str = "No voltage was recorded, so the current is the input. Bridge and winding cannot be judged: record u_V or duty as well if they matter.";
const IN_AMPERES: &str = "Without [motor] torque_constant_Nm_per_A in the rig file the scale of all torques is unknown: here 1 Nm stands for the torque of 1 A.";
/// Against an off phase that coasts where the motor never reverses, as behind a single transistor.
const OF_ONE_TRANSISTOR: &str = "With a bridge leave enable high. One transistor and a diode always coast so at small currents: a second transistor in place of the diode, or a higher PWM frequency, makes the motor linear";

/// Note on effects that a model contains without a name, beside what remains.
pub(super) fn of_unnamed(model: &Model, named: &[Standing]) -> Option<String> {
    let is_named = |term: &&Term| named.iter().any(|standing| standing.id == term.id());
    let unnamed = model.terms.iter().filter(|term| !is_named(term)).map(|term| term.effect.about().title);
    let unnamed: Vec<&str> = unnamed.collect();
    (!unnamed.is_empty()).then(|| {
        format!(
            "The constants allow for what explains too little to be named: {}. A model without it would bend them.",
            unnamed.join(", ")
        )
    })
}

impl Outcome {
    /// Note on a nominal value that the constants contradict, where another reason is more likely than a wrong value.
    pub(super) fn contradiction(&self, cause: &Cause, motor: &MotorParameters) -> Option<String> {
        let (name, found) = cause.parameters.iter().next()?;
        let nominal = self.parameters.get(name.as_str())?.nominal?;
        let [low, high] = found.ci95?;
        let likelier = match self.unexplained {
            Some(_) => "More likely what has no name bends it.".to_owned(),
            None => "More likely it is of the reading: a filter, a window or a delay that the rig file does not state."
                .to_owned(),
        };
        let of_winding = (cause.effect == INDUCTANCE).then(|| {
            let milliseconds = 1e3 * TimeConstants::of(motor).electromagnetic_s;
            format!(" It would be a winding of {} ms, which a filter or a delay resembles.", short(milliseconds))
        });
        Some(format!(
            "{name} = {} [{}, {}] contradicts the {} of the rig file. {likelier}{} Do not correct the rig file by it.",
            short(found.value),
            short(low),
            short(high),
            short(nominal),
            of_winding.unwrap_or_default()
        ))
    }

    /// Note on a resistance that is too large for the winding alone, if `bridge_ohm` of it may be the bridge's.
    pub(super) fn of_circuit(&self, bridge_ohm: f64) -> Option<String> {
        let found = self.parameters.get(RESISTANCE_OHM)?;
        (is_wrong(found, 0.0) && !is_wrong(found, bridge_ohm)).then(|| {
            format!(
                "{RESISTANCE_OHM} = {} is that of the circuit. The winding may well have the {} of the rig file. What a bridge of transistors drops grows with the current, here by up to {} ohm. An ohmmeter at the winding tells them apart.",
                short(found.value),
                short(found.nominal.unwrap_or(found.value)),
                short(bridge_ohm)
            )
        })
    }

    /// Constants of the motor that the data do not determine. Viscous friction may be nothing, which is known then.
    pub fn undetermined(&self) -> impl Iterator<Item = &'static str> {
        let may_be_nothing = |name: &str| name.starts_with(VISCOUS_FRICTION);
        let unknown =
            move |(name, found): &(&&'static str, &Parameter)| !may_be_nothing(name) && !found.is_determined();
        self.parameters.iter().filter(unknown).map(|(name, _)| *name)
    }

    /// Note on such constants.
    pub(super) fn advice_on_undetermined(&self) -> Option<String> {
        let names: Vec<&str> = self.undetermined().collect();
        (!names.is_empty()).then(|| {
            format!(
                "These data do not determine {}: the interval spans more than an order of magnitude, and the value is little more than a guess.",
                names.join(", ")
            )
        })
    }

    /// Note on an error above the noise that is too small for a name.
    pub(super) fn small_rest(&self) -> Option<String> {
        let (reached, floor) = (&self.fit["extended"], &self.fit["noise_floor"]);
        let times = |(channel, quality): (&&'static str, &Quality)| (quality.rmse / floor[channel].rmse, *channel);
        let (times, channel) = reached.iter().map(times).max_by(|a, b| a.0.total_cmp(&b.0))?;
        (self.unexplained.is_none() && times > REPORTED_ABOVE_NOISE).then(|| {
            format!(
                "The error left in {channel} is {times:.1} times the noise of its sensor, but less than {:.0} % of its range. A small effect may be missing; effects that small are not searched for.",
                100.0 * TOLERANCE
            )
        })
    }

    pub(super) fn advice_on_values(&self) -> Vec<String> {
        let mut advice = Vec::new();
        let wrong =
            |name: &str| self.causes.iter().any(|cause| cause.is_value() && cause.parameters.contains_key(name));
        for (name, parameter) in self.parameters.iter().filter(|(name, found)| wrong(name) && !is_other_unit(found)) {
            let nominal = parameter.nominal.map_or_else(String::new, short);
            advice.push(format!("Write {name} = {} into the rig file in place of {nominal}.", short(parameter.value)));
        }
        if self.causes.iter().any(Cause::is_value) && self.parameters.values().any(is_other_unit) {
            advice.push(
                "A value this far off is probably a wrong unit. Check: i_A in amperes; speed in rad/s, not rpm; counts_per_rev after x4 decoding; the sensor on the motor's shaft, not behind a gear.".into(),
            );
        }
        advice
    }

    pub(super) fn advice(&self, data: &Dataset) -> Vec<String> {
        let mut advice = Vec::new();
        let reverses = |sign: f64| data.motion().values.iter().any(|speed| sign * speed > 10.0 * data.motion().noise);
        let is_one_way = !(reverses(1.0) && reverses(-1.0));
        for cause in &self.causes {
            let Some(about) = motorbench_model::catalogue::effect(&cause.effect).map(|effect| effect.about()) else {
                continue;
            };
            if !cause.not_separable_from.is_empty() {
                let others = cause.not_separable_from.join(" or ");
                advice
                    .push(format!("{} could as well be {others}. To tell them apart: {}.", about.id, about.experiment));
            }
            let remedy = if about.id == "coast_decay" && is_one_way { OF_ONE_TRANSISTOR } else { about.remedy };
            advice.push(format!("Against {}: {remedy}.", about.title));
        }
        advice.extend(self.advice_on_values());
        if let Some(unexplained) = &self.unexplained {
            advice.push(format!(
                "An effect outside the catalogue is missing: {}. See the plots of what remains in the report (--report).",
                unexplained.place()
            ));
            advice.push(BESIDE_UNEXPLAINED.into());
        }
        advice.extend(data.notes());
        if data.current().is_none() && data.axis.drive.is_voltage() {
            advice.push(self.advice_without_current());
        }
        if data.axis.drive == Drive::Current {
            advice.push(IMPOSED_CURRENT.into());
            if self.parameters.get(TORQUE_CONSTANT).is_some_and(|constant| constant.nominal.is_none()) {
                advice.push(IN_AMPERES.into());
            }
        }
        if is_one_way {
            advice.push(
                "The motor never reverses in this recording. Friction and differences between directions show only when it passes zero both ways: record the sequence `identify`.".into(),
            );
        }
        advice
    }

    /// What a recording without the current says of friction and drop together.
    fn advice_without_current(&self) -> String {
        let is_dry = |cause: &Cause| USUAL.contains(&cause.effect.as_str());
        let of = |name: &str| {
            self.determined.get(name).map(|found| format!("{name} = {} {}", short(found.value), found.unit))
        };
        match of("kS").filter(|_| self.causes.iter().any(is_dry)) {
            Some(sum) => {
                let others = ["kV", "kA"].into_iter().filter_map(of).collect::<Vec<_>>().join(", ");
                format!(
                    "Without the current, friction and a voltage drop cannot be told apart. Their sum is sure: {sum}, with {others}. Record i_A as well to know each."
                )
            }
            None => "Without the current, torque and voltage can hardly be told apart: record i_A as well.".into(),
        }
    }
}

/// Whether a value is so far from its nominal value that another unit is likelier than another motor.
fn is_other_unit(parameter: &Parameter) -> bool {
    parameter.nominal.is_some_and(|nominal| (parameter.value / nominal).ln().abs() > OTHER_UNIT.ln())
}
