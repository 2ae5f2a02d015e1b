//! Why a design fails, and what to do.

use super::robustness::Weakness;
use super::specification::ImpossibleSpecification;
use super::weights::BadWeight;
use motorbench_model::motor::NonPhysical;

/// Why a design failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DesignError {
    /// The parameters of the model are not those of a motor.
    #[error("the motor's {0}")]
    Model(#[from] NonPhysical),
    /// No loop can meet the specification.
    #[error("the specification's {0}")]
    Specification(#[from] ImpossibleSpecification),
    /// The encoder's edges come faster than the chip can count.
    #[error(
        "the encoder gives {edges_per_s:.0} edges/s at no load, but the chip can count {limit_per_s:.0}: lower the supply or use a coarser encoder"
    )]
    TooFast {
        /// Edge rate at the no-load speed.
        edges_per_s: f64,
        /// Edge rate that the chip can count.
        limit_per_s: f64,
    },
    /// The law needs an encoder.
    #[error(
        "the {law} needs an encoder, and the rig file has none. Add encoder.counts_per_rev. A speed loop can use a tachogenerator instead"
    )]
    NoEncoder {
        /// Which law.
        law: &'static str,
    },
    /// The firmware cannot measure the voltage of the tachogenerator.
    #[error("the tachogenerator: {what}")]
    Tachogenerator {
        /// The problem, and what to do.
        what: String,
    },
    /// The core cannot hold a setting.
    #[error("{name} = {value} {unit} {why}: {advice}")]
    Setting {
        /// Its name on the console.
        name: String,
        /// The value.
        value: f64,
        /// Its unit.
        unit: String,
        /// The rule that it breaks.
        why: &'static str,
        /// What to do.
        advice: &'static str,
    },
    /// No loop reached the bandwidth or the settling time.
    #[error("the {law} cannot be that fast: {reached}. Ask for a lower bandwidth, or allow more overshoot")]
    TooSlow {
        /// Which law.
        law: &'static str,
        /// The best that was reached.
        reached: String,
    },
    /// No loop that is fast enough meets the overshoot.
    #[error(
        "the {law} overshoots by at least {found_percent:.1} %, but only {asked_percent} % are allowed: allow more, or ask for another speed"
    )]
    Overshoot {
        /// Which law.
        law: &'static str,
        /// Smallest overshoot that was found.
        found_percent: f64,
        /// Allowed overshoot.
        asked_percent: f64,
    },
    /// With gains rounded to the core's formats, the loop misses the specification.
    #[error(
        "with gains rounded to the core's formats, the {law} misses the specification: bandwidth {bandwidth_hz:.3} Hz, settling {settling_s:.3} s, overshoot {overshoot_percent:.1} %. Ask for a faster loop"
    )]
    Quantised {
        /// Which law.
        law: &'static str,
        /// Bandwidth with the rounded gains.
        bandwidth_hz: f64,
        /// Settling time.
        settling_s: f64,
        /// Overshoot.
        overshoot_percent: f64,
    },
    /// The loop is not robust enough.
    #[error("the {law} is not robust: {weakness}; ask for a slower loop")]
    NotRobust {
        /// Which law.
        law: &'static str,
        /// The margin that it lacks.
        weakness: Weakness,
    },
    /// The voltage is delayed more than the states of the loop can hold.
    #[error(
        "the model's actuation_delay.delay_s = {delay_s} s exceeds the {most_s} s that a design can handle at this tick rate (a tachogenerator's speed_lag.time_constant_s is included). Find and remove what delays the voltage or the reading"
    )]
    Delay {
        /// Delay of the model.
        delay_s: f64,
        /// Longest delay that can be handled.
        most_s: f64,
    },
    /// The weights are not valid.
    #[error(transparent)]
    BadWeight(#[from] BadWeight),
    /// The given weights have no gains.
    #[error("the {law} with {options} has no gains with which a step settles within {within_s} s; {WEIGHTS_ADVICE}")]
    NoGains {
        /// Which law.
        law: &'static str,
        /// The weights.
        options: String,
        /// Longest response that was simulated.
        within_s: f64,
    },
    /// The given weights are so far apart that the problem has no numerical solution.
    #[error(
        "the {law} with {options} has no solution: the largest weight is {times:.0e} times the smallest. A weight is one over the square of an acceptable deviation. Bring the weights closer together, or give the deviations (--largest, --largest-V)"
    )]
    OutOfProportion {
        /// Which law.
        law: &'static str,
        /// The weights.
        options: String,
        /// Ratio of the largest weight to the smallest.
        times: f64,
    },
    /// Weights were given, and the loop is refused for another reason.
    #[error("with {options}, {error}; {WEIGHTS_ADVICE}")]
    GivenWeights {
        /// The weights.
        options: String,
        /// Reason of the refusal.
        error: Box<Self>,
    },
    /// The core in closed loop differs from the linear loop.
    #[error("the {law} fails in fixed point: {what}; ask for a slower loop, or raise current-limit-A")]
    Trial {
        /// Which law.
        law: &'static str,
        /// What went wrong.
        what: String,
    },
    /// The core fails in closed loop with the effects of the model.
    #[error(
        "with the effects of the model the {law} fails: {what}. Ask for a slower loop, raise current-limit-A, or compensate friction and drop (--compensate)"
    )]
    WithEffects {
        /// Which law.
        law: &'static str,
        /// What went wrong.
        what: String,
    },
}

/// Advice for a loop with given weights.
pub(super) const WEIGHTS_ADVICE: &str = "a larger r makes the loop slower, a smaller weight on the integral reduces overshoot, a larger weight on the speed adds damping";
