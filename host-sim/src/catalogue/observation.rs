//! Observation items: how a recording was made, as far as no rig file says it. They are fitted beside the effects and are no
//! causes, so they are not in the catalogue's list.

use super::{About, ActsOn, Effect, Parameter, Scales};

/// The phase of the PWM in which a current is read at the moment of its row.
pub struct ReadingPhase;
/// By how much a command acts later than the program says: its duty waits for the next period of the PWM.
pub struct CommandTiming;

/// Of both what a catalogue entry needs; nobody is told of them as of a cause.
const ITEM: About = About {
    id: "",
    title: "",
    acts_on: ActsOn::Voltage,
    parameters: &[],
    linear_in: 0,
    law: "",
    looks_like: "",
    confused_with: &[],
    experiment: "",
    remedy: "",
    source: "Kristensen, Madsen, Jorgensen, Automatica 40 (2004)",
};

static PHASE: About = About {
    id: "reading_phase",
    title: "the phase of the PWM in which the current is read",
    parameters: &[Parameter::signed("periods")],
    law: "At time 0 this share of a period of the PWM has passed",
    ..ITEM
};

static TIMING: About = About {
    id: "command_timing",
    title: "the moment at which a command acts",
    parameters: &[Parameter::positive("late_s")],
    law: "u(t - late_s), late_s up to a period of the PWM",
    ..ITEM
};

impl Effect for ReadingPhase {
    fn about(&self) -> &'static About {
        &PHASE
    }

    fn starts(&self, _scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.5]]
    }

    fn is_observation(&self) -> bool {
        true
    }

    fn pwm_phase(&self, values: &[f64]) -> Option<f64> {
        Some(values[0])
    }

    fn acts_on_motor(&self) -> bool {
        false
    }

    fn changes_motion(&self) -> bool {
        true
    }
}

impl Effect for CommandTiming {
    fn about(&self) -> &'static About {
        &TIMING
    }

    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.5 / scales.pwm_hz]]
    }

    fn is_observation(&self) -> bool {
        true
    }

    fn delay_s(&self, values: &[f64]) -> f64 {
        values[0]
    }

    fn acts_on_motor(&self) -> bool {
        false
    }

    fn changes_motion(&self) -> bool {
        true
    }
}
