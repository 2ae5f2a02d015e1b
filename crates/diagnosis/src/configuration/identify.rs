//! The fit.

/// The time of an event is located to this part of a row: the fit moves it further.
pub const LOCATED_ROWS: f64 = 0.25;

/// [`crate::identify::prior`].
pub(crate) mod prior {
    /// Standard deviation of the logarithm of a nominal value.
    pub const NOMINAL_SPREAD: f64 = 0.2;
    /// The same for a value estimated from the data's extremes alone.
    pub const GUESS_SPREAD: f64 = 1.5;
    /// The same for the scale of all resistances, if no current was measured and no nominal value is given.
    pub const SCALE_SPREAD: f64 = 2.5;
    /// A nominal viscous friction is little more than an order of magnitude.
    pub const FRICTION_SPREAD: f64 = 1.0;
    /// The same without a nominal value: viscous friction takes a tenth of a small motor's voltage at most.
    pub const UNKNOWN_FRICTION_SPREAD: f64 = 5.0;
    /// Standard deviation of a bridge's drop that the rig file gives.
    pub const GIVEN_DROP_SPREAD_V: f64 = 0.3;
    /// Electromechanical and electromagnetic time constant of a small motor, for a start without nominal values.
    pub const USUAL_TIME_CONSTANTS_S: (f64, f64) = (0.05, 0.001);
    /// Where the lateness of readings was followed, this is left of it: on recordings with a known one up to 4 ms.
    pub const LATE_READINGS_S: f64 = 4e-3;
}

/// [`crate::identify::promises`].
pub(crate) mod promises {
    /// An expected gain below this, in units of noise, is not worth a fit.
    pub const LEAST_PROMISE: f64 = 20.0;
    /// The starts of this many most promising effects are refined, where they have this share of the best expected gain.
    pub const REFINED: usize = 8;
    pub const WORTH_A_WALK: f64 = 0.1;
    /// That is by this many halvings, or by moving to a better neighbour at most this often.
    pub const REFINEMENTS: u8 = 6;
    pub const MOST_NEIGHBOURS: usize = 8;
    /// Of many starts of an effect that responds linearly, so many are simulated whole: the best by its linear response.
    pub const SCREENED: usize = 3;
    /// Two effects are fitted together if at least half of their gain shows only then. Otherwise they are found one by one.
    pub const MORE_TOGETHER: f64 = 2.0;
}

/// [`crate::identify::search`].
pub(crate) mod search {
    /// A step is tried with this many dampings, and with this many while the sensitivities are only corrected. If these fail,
    /// the correction has failed, and a shorter step would hide it.
    pub const TRIES: usize = 6;
    pub const TRIES_CORRECTED: usize = 3;
    /// A step that gains more than this share of the cost needs new sensitivities.
    pub const FAR: f64 = 0.8;
    /// So does one that keeps hardly anything of what they promised, as in methods of trust regions.
    pub const LEAST_KEPT: f64 = 0.05;
}

/// [`crate::identify::recording_items`].
pub(crate) mod recording_items {
    /// Finite differences on both sides, in units of an item: small beside what the data tell, and large beside rounding.
    pub const DIFFERENCE: f64 = 2e-3;
    /// The farthest that one step moves an item: beyond it, its effect is not linear.
    pub const LONGEST: f64 = 0.1;
    /// Steps and dampings as in a fit. It ends where a step gains less than this share of the cost.
    pub const STEPS: usize = 8;
    pub const TRIES: usize = 5;
    pub const LEAST_GAIN: f64 = 5e-4;
}

/// [`crate::identify::sensitivities`].
pub(crate) mod sensitivities {
    /// Relative step of the finite differences.
    pub const DIFFERENCE: f64 = 2e-3;
    /// The same for a model with events that shift in time: long enough to average over several of them, since a single one
    /// misleads. Where every edge of the PWM is simulated, the events of its switching have their own times within a step: there
    /// the usual one is right.
    pub const DIFFERENCE_OVER_EVENTS: f64 = 4e-2;
}

/// [`crate::identify::speed_window`].
pub(crate) mod speed_window {
    /// A window that reaches ahead has to lower the cost to this share: most programs know nothing of what is to come.
    pub const LEAST_SHARE: f64 = 0.97;
}

/// [`crate::identify::uncertainty`].
pub(crate) mod uncertainty {
    /// Residuals further apart than this count as independent. Of several block lengths the one with the widest interval
    /// counts. Longer blocks include model errors that belong to one manner of driving.
    pub const BLOCKS_S: [f64; 2] = [0.2, 2.0];
    /// Relative error (one standard deviation) of the motor's constants from the model's simplifications other than its
    /// steps, such as readings at an instant. It was measured on benches with known constants. Effects add theirs, see
    /// [`motorbench_model::catalogue::Simplification`].
    pub const SYSTEMATIC: f64 = 7e-4;
    /// The same for an effect's constants if the PWM frequency was assumed: it comes from a list, and the shaft is assumed
    /// to turn evenly within its period.
    pub const GUESSED_PWM: f64 = 3e-3;
    /// Half an interval of 95 % in standard errors.
    pub const Z95: f64 = 1.96;
    /// Step of the derivatives of a quantity, in coordinates of the fit.
    pub const DIFFERENCE: f64 = 1e-5;
}

/// [`crate::identify::unknown_scale`].
pub(crate) mod unknown_scale {
    /// Golden section.
    pub const SECTION: f64 = 0.618_033_988_749_895;
    /// Logarithm of the greatest factor looked at, and how closely the best one is found.
    pub const WIDEST: f64 = 4.0;
    pub const CLOSENESS: f64 = 1e-4;
    /// Coordinates that differ by less, or by this share, are the same.
    pub const ROUNDING: f64 = 1e-9;
    /// Step for the derivatives of the coordinates.
    pub const DIFFERENCE: f64 = 1e-6;
}

/// [`crate::identify::unknowns`].
pub(crate) mod unknowns {
    /// A constant that selects another law at zero is limited to this share of its start.
    pub const LEAST_OF_START: f64 = 0.01;
    /// A process longer than this many recordings cannot be told from a constant contribution.
    pub const SLOWEST: f64 = 5.0;
}
