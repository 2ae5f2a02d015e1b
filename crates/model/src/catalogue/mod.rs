//! The catalogue of effects: what a real motor, bridge or sensor does that the linear motor does not. One file each.
//!
//! An effect's file holds three things:
//! - [`About`]: what is known of it, as data; its constants with their units among them.
//! - [`Law`]: its terms in the two equations of the motor, or in a reading.
//! - [`Search`]: how a diagnosis finds it.
//!
//! A new effect is one file, its line in [`CATALOGUE`] (with its `mod`) and its name in `docs/reference/diagnosis.schema.json`.

mod about;
mod actuation_delay;
mod backlash;
mod bridge_asymmetry;
mod clock_drift;
mod coast_decay;
mod cogging;
mod commutation_ripple;
mod coulomb_friction;
mod current_clipping;
mod current_lag;
mod current_offset;
mod drop_asymmetry;
mod encoder_eccentricity;
mod friction_asymmetry;
mod friction_warmup;
mod gravity_unbalance;
mod law;
mod load_step;
mod load_torque;
mod low_pass;
mod missed_counts;
mod parameter;
mod quadratic_drag;
mod resistance_growing_with_speed;
mod search;
mod shaft_compliance;
mod slow_drift;
mod speed_lag;
mod stribeck_friction;
mod supply_sag;
mod tacho_ripple;
mod voltage_drop;
mod winding_heating;

pub use about::{About, ActsOn, Alone, Coordinate, Sensor, Shown, Simplification, Strength};
pub use law::{Balance, DryLosses, Instant, Law, OffPhase, Readings, Sampling, Wave};
pub use parameter::Parameter;
pub use search::{Channels, Scales, Search};

use crate::unit::Unit;

/// Every effect the diagnosis knows. [`Law::turn`] says in which order they act.
pub static CATALOGUE: &[&dyn Effect] = &[
    &coulomb_friction::CoulombFriction,
    &stribeck_friction::StribeckFriction,
    &friction_asymmetry::FrictionAsymmetry,
    &quadratic_drag::QuadraticDrag,
    &load_torque::LoadTorque,
    &load_step::LoadStep,
    &friction_warmup::FrictionWarmup,
    &cogging::Cogging,
    &gravity_unbalance::GravityUnbalance,
    &backlash::Backlash,
    &shaft_compliance::ShaftCompliance,
    &voltage_drop::VoltageDrop,
    &drop_asymmetry::DropAsymmetry,
    &bridge_asymmetry::BridgeAsymmetry,
    &supply_sag::SupplySag,
    &resistance_growing_with_speed::ResistanceGrowingWithSpeed,
    &winding_heating::WindingHeating,
    &commutation_ripple::CommutationRipple,
    &coast_decay::CoastDecay,
    &actuation_delay::ActuationDelay,
    &clock_drift::ClockDrift,
    &current_lag::CurrentLag,
    &current_offset::CurrentOffset,
    &current_clipping::CurrentClipping,
    &missed_counts::MissedCounts,
    &encoder_eccentricity::EncoderEccentricity,
    &tacho_ripple::TachoRipple,
    &speed_lag::SpeedLag,
];

/// A command that acts late.
pub const ACTUATION_DELAY: &str = "actuation_delay";

/// The drop of bridge and brushes.
pub const VOLTAGE_DROP: &str = "voltage_drop";

/// Effects that nearly every drive has.
pub const USUAL: [&str; 2] = ["coulomb_friction", VOLTAGE_DROP];

/// A rival that is no effect: more inductance than the winding has. Its one value is the time by which that lengthens the
/// winding's time constant, in seconds.
pub const INDUCTANCE: &str = "parameter:inductance";

/// An effect: what is known of it, its law, and how a diagnosis searches for it.
pub trait Effect: Law + Search {}

impl<T: Law + Search> Effect for T {}

impl dyn Effect + '_ {
    /// See [`About::acts_on_motor`].
    pub fn acts_on_motor(&self) -> bool {
        self.about().acts_on_motor()
    }

    /// See [`About::changes_motion`].
    pub fn changes_motion(&self) -> bool {
        self.about().changes_motion()
    }

    /// See [`About::has_events`].
    pub fn has_events(&self) -> bool {
        self.about().has_events
    }

    /// See [`About::is_of_switching`].
    pub fn is_of_switching(&self) -> bool {
        self.about().is_of_switching
    }

    /// See [`About::simplification`].
    pub fn simplification(&self) -> Simplification {
        self.about().simplification
    }

    /// Whether a recording of these channels says anything of it.
    pub fn shows_in(&self, channels: &Channels) -> bool {
        let is_recorded = match self.about().sensor {
            None => true,
            Some(Sensor::Current) => channels.current,
            Some(Sensor::Encoder) => channels.counts,
            Some(Sensor::Tachogenerator) => channels.speed,
        };
        is_recorded && channels.axis.allows(self.about()) && self.can_show_in(channels)
    }
}

/// The effect with this identifier.
pub fn effect(id: &str) -> Option<&'static dyn Effect> {
    CATALOGUE.iter().copied().find(|effect| effect.about().id == id)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Drive;
    use crate::motor::MotorParameters;

    #[test]
    fn identifiers_are_unique_and_references_exist() {
        for (index, entry) in CATALOGUE.iter().enumerate() {
            let about = entry.about();
            assert!(CATALOGUE[..index].iter().all(|other| other.about().id != about.id), "{}", about.id);
            let required = about.requires.map(|(other, _)| other);
            for other in about.confused_with.iter().copied().chain(required).chain(about.held_beside) {
                assert!(effect(other).is_some(), "{}: refers to {other}, which is not in the catalogue", about.id);
            }
        }
    }

    /// Data of an effect that have to agree with each other.
    #[test]
    fn an_effect_acts_on_the_motor_or_on_the_reading_of_its_sensor() {
        for about in CATALOGUE.iter().map(|effect| effect.about()) {
            let places: &[ActsOn] = match about.sensor {
                None => &[ActsOn::Torque, ActsOn::Voltage],
                Some(Sensor::Current) => &[ActsOn::CurrentSensor],
                Some(Sensor::Encoder | Sensor::Tachogenerator) => &[ActsOn::AngleSensor],
            };
            assert!(!about.acts_on.is_empty(), "{}", about.id);
            assert!(about.acts_on.iter().all(|place| places.contains(place)), "{}", about.id);
            for group in about.strengths() {
                assert!(!group.is_empty() && group.end <= about.parameters.len(), "{}", about.id);
            }
        }
    }

    /// A simulation computes such terms once.
    #[test]
    fn what_is_steady_adds_the_same_at_every_instant() {
        let motor = MotorParameters::PIVT6;
        let scales = Scales {
            drive: Drive::Voltage,
            motor,
            voltage_v: 12.0,
            supply_v: 12.0,
            speed_rad_per_s: 100.0,
            current_a: 1.0,
            duration_s: 10.0,
            interval_s: 1e-3,
            pwm_hz: 1000.0,
        };
        let instants = [
            Instant { duty: 0.3, voltage_v: 3.6, supply_v: 12.0, step_s: 1e-3, ..Instant::default() },
            Instant {
                time_s: 4.0,
                voltage_v: -9.0,
                duty: -0.75,
                mean_duty: -0.75,
                supply_v: 12.0,
                open: true,
                current_a: -0.8,
                speed_rad_per_s: -70.0,
                middle_rad_per_s: -70.0,
                angle_rad: 2.0,
                turned_rad: -0.07,
                step_s: 1e-3,
            },
        ];
        let mut steady = 0;
        for effect in CATALOGUE {
            for values in effect.starts(&scales).into_iter().filter(|values| effect.is_steady(values)) {
                assert!(effect.acts_on_motor() && effect.begins(0.0).is_empty(), "{}", effect.about().id);
                let [at_rest, in_motion] = instants.map(|at| {
                    let mut sum = Balance { dry_forward_nm: 1e-2, dry_backward_nm: 1e-2, ..Balance::default() };
                    effect.contribute(&values, &motor, &at, &mut [], &mut sum);
                    format!("{sum:?}")
                });
                assert_eq!(at_rest, in_motion, "{} {values:?}", effect.about().id);
                steady += 1;
            }
        }
        assert!(steady > 0);
    }
}
