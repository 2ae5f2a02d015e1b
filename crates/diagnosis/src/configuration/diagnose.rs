//! The diagnosis.

/// A model that explains less than this of the motion, and leaves only noise, cannot be judged: the recording is mostly
/// noise.
pub const LEAST_FIT_PERCENT: f64 = 20.0;
/// Tolerance of a data sheet: logarithm of found over nominal.
pub const DATA_SHEET_TOLERANCE: f64 = 0.25;
/// A sensor is blamed if it explains the rest better than torque or voltage by this much log-likelihood.
pub const LEAST_LOG_LIKELIHOOD_GAIN: f64 = 10.0;
/// By how much a drop may differ between pulse and off phase, as a share of it (one standard deviation). The current flows
/// through two transistors in the pulse, and through a transistor and a diode in the off phase. A bridge of Darlingtons
/// in a circuit simulator drops 5 to 25 % less there, and an L298 with Schottky diodes a third less (1.7 V for 2.5 V).
pub const DROP_DIFFERENCE: f64 = 0.2;

/// [`crate::diagnose::advice`].
pub(crate) mod advice {
    /// A value that is off by more than this factor is probably in another unit, or decoded otherwise.
    pub const OTHER_UNIT: f64 = 2.5;
    /// An error this many times the sensor's noise is reported, even if it is too small for a name.
    pub const REPORTED_ABOVE_NOISE: f64 = 1.5;
}

/// [`crate::diagnose::bad_stretches`].
pub(crate) mod bad_stretches {
    /// A block stands out by this multiple of the usual lack. Even a law that is missing acts in many blocks, so it is usual.
    pub const STANDS_OUT: f64 = 5.0;
    /// Its neighbours belong to it from this share of its lack on.
    pub const BELONGS: f64 = 0.2;
    /// At most so many places are left out, and this share of a recording. More is a cause, and no accident.
    pub const MOST_PLACES: usize = 4;
    pub const MOST_LEFT_OUT: f64 = 0.15;
    /// Effects are selected without a stretch if it has three quarters of the squares that remain, so that half of the rest is
    /// left. A law that is missing acts elsewhere as well.
    pub const LEFT_OF_REST: f64 = 0.5;
}

/// [`crate::diagnose::causes`].
pub(crate) mod causes {
    /// A value is called wrong when it is this many standard errors beyond the tolerance...
    pub const BEYOND_TOLERANCE_SIGMAS: f64 = 3.0;
    /// ... and each standard error (of a logarithm) counts at least as this: the tolerance itself is not sharp.
    pub const LEAST_SPREAD: f64 = 0.02;
    /// The smallest usual bridge of transistors, an L293D: 1.9 V with hardly any current, and up to 3.6 V at 0.6 A (data sheet
    /// SLRS008, 6.5).
    pub const LEAST_RATING_A: f64 = 0.6;
    /// An inductance or a lag is visible if its time constant is at least this share of the time between rows.
    pub const LEAST_ROWS: f64 = 0.3;
}

/// [`crate::diagnose::command_times`].
pub(crate) mod command_times {
    /// At shorter row intervals commands are hardly missing, unless a row is missing...
    pub const SHORTEST_ROW_S: f64 = 1.5e-3;
    /// ... which shows as a long row, or commands and rows have separate clocks: then they change in at most this share of
    /// the rows.
    pub const RARELY: f64 = 0.05;
    /// A change by this share of the greatest voltage gets a time of its own; smaller ones are put in the middle between
    /// the rows.
    pub const LEAST_CHANGE: f64 = 0.002;
    /// The response to a change is evaluated for this long.
    pub const ANSWER_S: f64 = 0.1;
    /// Times and model are estimated in turn: this often the times of all changes at once, which is enough for great
    /// steps...
    pub const ROUNDS_TOGETHER: usize = 2;
    /// ... and this often those of every second one, so that each gets two such rounds.
    pub const ROUNDS_APART: usize = 4;
    /// Shift for the numerical derivative, as a share of the row.
    pub const SHIFT: f64 = 0.1;
    /// Where more than noise remains, the estimated times have to lower the cost to this share...
    pub const LEAST_GAIN: f64 = 0.5;
    /// ... to this share for short row intervals, where commands are hardly missing...
    pub const LEAST_GAIN_OF_CLOSE_ROWS: f64 = 0.2;
    /// ... and times found with a poorer model, to this share of their previous cost.
    pub const CLOSER: f64 = 0.98;
    /// How much earlier than its row a smooth command acts, as shares of the row. Two commands a row are held for half a row
    /// less, so they act a quarter of a row earlier; very many, half a row. A delay in whole commands adds a quarter.
    pub const EARLIER: [f64; 3] = [0.25, 0.5, 0.75];
}

/// [`crate::diagnose::counter_stops`].
pub(crate) mod counter_stops {
    /// Number of rows before and after a stop that show the speed error of the model there.
    pub const BESIDE: usize = 6;
    /// A stop is evaluated again if its lost counts change by this much.
    pub const MOVED_COUNTS: f64 = 2.0;
    /// A standstill of the counter is a stop if the model passes this many counts, at this many standard errors...
    pub const LEAST_COUNTS: f64 = 5.0;
    pub const LEAST_SIGMAS: f64 = 4.0;
    /// ... and if the motor turned right before and right after it at no less than this share of its speed some rows away.
    pub const STILL_TURNING: f64 = 0.7;
    /// Number of rows that count as right before or right after.
    pub const NEXT: usize = 2;
}

/// [`crate::diagnose::current_window`].
pub(crate) mod current_window {
    /// Windows tried first; the longest is a period of the slowest PWM of an Uno's timers.
    pub const LOOKED_AT_S: [f64; 6] = [0.2e-3, 0.4e-3, 0.7e-3, 1.0e-3, 1.5e-3, 2.05e-3];
    /// Then finer steps around the best.
    pub const CLOSER: [f64; 3] = [1.2, 1.1, 1.05];
    /// A lag of the current up to half of the longest window may be a window.
    pub const LATEST_S: f64 = 1.25e-3;
    /// A window has to lower the cost to this share of that without any delay.
    pub const LEAST_GAIN: f64 = 0.99;
    /// If a rest remains that a window does not explain, to this share: a part of anything may be a delay.
    pub const LEAST_BESIDE: f64 = 0.6;
    /// An inductance this many times the nominal one may be a window.
    pub const EXCESSIVE_INDUCTANCE: f64 = 1.2;
}

/// [`crate::diagnose::data_sheet`].
pub(crate) mod data_sheet {
    /// Standard deviation of the logarithm of a nominal viscous friction.
    pub const VISCOUS_SPREAD: f64 = 0.5;
    /// Squared deviations of R, k and J from their nominal values, in standard deviations, for each nominal value: more is
    /// implausible.
    pub const IMPLAUSIBLE_EACH: f64 = 8.0;
    /// An inductance this many times the nominal one may be an effect.
    pub const EXCESSIVE_INDUCTANCE: f64 = 1.35;
    /// The most that a bridge of transistors and the brushes behind it drop: 3.6 V (ST L293D data sheet, both saturation voltages
    /// at their maximum), and 1 V for carbon brushes.
    pub const MOST_DROP_V: f64 = 4.6;
}

/// [`crate::diagnose::determined`].
pub(crate) mod determined {
    /// Data that leave more than this share of what was known before did not determine a quantity.
    pub const MOST_OF_PRIOR: f64 = 0.5;
    /// A model without friction and drop has no dead band, and no fitted constant moves it by more than rounding: then the fit
    /// does not say how large one may be that was not seen.
    pub const MOVED_BY_A_CONSTANT: f64 = 1e-9;
    /// Full range of a PWM value of 8 bits.
    pub const PWM_FULL: f64 = 255.0;
    /// A constant whose interval spans an order of magnitude is not determined.
    pub const WIDEST: f64 = 10.0;
}

/// [`crate::diagnose::hidden_drop`].
pub(crate) mod hidden_drop {
    /// Usual drop of bridges and its standard deviation: almost zero with MOSFETs, two to three volts with bipolar
    /// transistors.
    pub const USUAL_V: (f64, f64) = (1.6, 1.2);
    /// A bridge leaves at least this share of the voltage.
    pub const LEAST_LEFT: f64 = 0.3;
}

/// [`crate::diagnose::interpretation`].
pub(crate) mod interpretation {
    /// With this evidence an effect is real, though its strength may be unknown: the data may lack the scale that it is
    /// proportional to, such as that of all torques. Right names had more, wrong names less.
    pub const BEYOND_DOUBT_SIGMAS: f64 = 12.0;
}

/// [`crate::diagnose::judge`].
pub(crate) mod judge {
    /// Parts of this length count as independent.
    pub const BLOCK_S: f64 = 0.1;
    /// Above this multiple of the noise floor an effect is missing.
    pub const NOT_NOISE: f64 = 1.15;
    /// Evidence in natural units that is called very strong (Kass and Raftery, Journal of the American Statistical Association
    /// 90 (1995)).
    pub const VERY_STRONG_NATS: f64 = 5.0;
    /// A block whose error is this multiple of the usual one is no usual one.
    pub const FAR_OFF: f64 = 3.0;
    /// After so many rounds the usual error no longer changes.
    pub const USUAL_ROUNDS: usize = 30;
    /// A simpler model whose cost is at most this multiple counts as equally good.
    pub const AS_GOOD: f64 = 1.02;
    /// Resamples of the block bootstrap.
    pub const RESAMPLES: usize = 200;
}

/// [`crate::diagnose::late_readings`].
pub(crate) mod late_readings {
    /// A lateness is another than usual if it differs by this share of its range.
    pub const ANOTHER: f64 = 0.25;
    /// Model and lateness are estimated in turn, this often...
    pub const ROUNDS: usize = 8;
    /// ... while that lowers the cost to this share.
    pub const CLOSER: f64 = 0.9;
    /// Share of the first error that is expected of anything else.
    pub const NOT_LATENESS: f64 = 0.2;
    /// Time constants of the motors that the search begins with. One that is far off finds another lateness.
    pub const TIME_CONSTANTS_S: [f64; 3] = [super::lateness::QUICK_S, 0.02, 0.1];
    /// Dead bands of these motors, as shares of the greatest command: friction and drop of small motors take 3 to 14 % of it.
    pub const DEAD_BANDS: [f64; 5] = [0.03, 0.05, 0.07, 0.1, 0.14];
    /// The best of these motors are fitted, and the best fits are improved in turn with the lateness.
    pub const BEGUN: usize = 4;
    pub const FOLLOWED: usize = 2;
    /// A usual model whose dead band takes more of the greatest command has found no speed.
    pub const MOST_DEAD: f64 = 0.9;
    /// First and last step in the search for what is the motor's own of a lateness.
    pub const FIRST_STEP_S: f64 = 0.02;
    pub const LAST_STEP_S: f64 = 1e-3;
}

/// [`crate::diagnose::lateness`].
pub(crate) mod lateness {
    /// Readings in this time count as one: a jump within it is not seen.
    pub const BLOCK_S: f64 = 4e-3;
    /// The same where motors and rates of growth are compared.
    pub const LONG_BLOCK_S: f64 = 3.0 * BLOCK_S;
    /// Time constant of a motor that answers at once.
    pub const QUICK_S: f64 = BLOCK_S;
    /// A buffer of 4096 bytes at 115,200 bits a second holds 0.36 s.
    pub const LATEST_S: f64 = 0.5;
    /// Price of a jump in natural units: it may be at any of some 5000 blocks, to any of some 100 times.
    pub const JUMP_NATS: f64 = 13.0;
    /// A block costs at most this: less than a jump, so that some readings that nothing explains cause none.
    pub const MOST_NATS: f64 = 6.0;
    /// Fastest growth that is tried, and the differences between two that are.
    pub const FASTEST_GROWTH: f64 = 0.15;
    pub const COARSE_GROWTH: f64 = 1e-2;
    pub const FINE_GROWTH: f64 = 1e-3;
    /// Steps of Gauss and Newton for the lateness between two jumps.
    pub const REFINED: usize = 2;
}

/// [`crate::diagnose::mains_hum`].
pub(crate) mod mains_hum {
    /// Frequencies of the mains, and of what is rectified from them.
    pub const MAINS_HZ: [f64; 4] = [50.0, 60.0, 100.0, 120.0];
    /// How far a clock of the board and the grid together may be off.
    pub const MOST_OFF_HZ: f64 = 0.4;
    /// The recording is summed in parts of this length first.
    pub const PART_S: f64 = 0.1;
    /// Frequencies lie closer than a line is wide by at least this factor.
    pub const FINER: usize = 4;
    /// So far beside a line is compared what else there is.
    pub const BESIDE_HZ: std::ops::Range<f64> = 0.8..2.5;
    /// A line has this multiple of the greatest power beside it. Harmonics of a command that repeats are as strong as their
    /// neighbours.
    pub const OVER_OTHERS: f64 = 10.0;
    /// In each of so many parts of a recording the line differs by less than this share of its amplitude.
    pub const PARTS_ALIKE: usize = 6;
    pub const COHERENT: f64 = 0.5;
    /// A line with less of the noise floor than this changes an error by less than a tenth.
    pub const LEAST_OF_FLOOR: f64 = 0.4;
    /// A sensor is read this often in a period.
    pub const ROWS_A_PERIOD: f64 = 2.5;
}

/// [`crate::diagnose::missing`].
pub(crate) mod missing {
    /// Standard deviations of the walk over a second that are tried, as shares of the discrepancy's own size.
    pub const WALKS: [f64; 4] = [0.1, 1.0, 10.0, 100.0];
    /// In this time a lacking torque makes the error of the speed, where no winding limits it.
    pub const WITHIN_S: f64 = 0.1;
    /// A winding warms up in this share of the recording. A slower warm-up does not show, and a faster one is hardly
    /// possible.
    pub const WARMING: f64 = 0.3;
    /// The warmth of a winding changes with time, so it has to explain this many times as much as the time does.
    pub const MORE_THAN_TIME: f64 = 1.2;
}

/// [`crate::diagnose::prediction`].
pub(crate) mod prediction {
    /// A delay is found to this share of a row.
    pub const CLOSENESS: f64 = 0.1;
}

/// [`crate::diagnose::pwm_frequency`].
pub(crate) mod pwm_frequency {
    /// Frequencies of an Uno's timers with the usual settings, and of this project's firmware.
    pub const USUAL_HZ: [f64; 6] = [490.0, 980.0, 1960.0, 3920.0, 7810.0, crate::dataset::PWM_HZ];
    /// Another frequency is fitted if it changes the present cost by this share...
    pub const SHOWS: f64 = 1e-3;
    /// ... and among those as good as the best, the inductance nearest to its nominal value decides, if it is nearer than
    /// the present one by this factor.
    pub const NEARER: f64 = 1.3;
    /// While a rest remains, and before any effect is known, it has to lower the cost to this share: a missing effect makes
    /// some winding fit a little better.
    pub const LEAST_LOG_LIKELIHOOD_GAIN: f64 = 0.6;
}

/// [`crate::diagnose::pwm_phase`].
pub(crate) mod pwm_phase {
    /// Phases that are tried first, and the number of halvings that refine the best one. Where commands wait for a slow PWM, a
    /// slightly other phase lets some of them act a whole period later.
    pub const PHASES: usize = 12;
    pub const PHASES_OF_SLOW: usize = 192;
    /// A ripple tells the phase to this share of a period: the winding's lag is known by nominal values alone, and a bridge may
    /// coast.
    pub const RIPPLE_TELLS: f64 = 0.25;
    /// Where no ripple tells it, or the PWM is slow, so many phases are fitted, far from each other.
    pub const FITTED: usize = 4;
    pub const HALVINGS: i32 = 4;
    /// The low-pass in front of a conversion that is tried first, in periods.
    pub const FIRST_FILTER: f64 = 0.1;
    /// The time of a mean of currents is sought from these on, in periods. A mean over a whole one has no ripple.
    pub const FIRST_WINDOWS: [f64; 2] = [0.2, 0.5];
    /// So many ripples are compared: rows in step see several frequencies as the same one, and either pulse much alike.
    pub const RIPPLES: usize = 6;
    /// A phase shows in any part of a recording in which the command changes; this much suffices.
    pub const EXCERPT_S: f64 = 3.0;
    /// So many periods of the PWM shorter and longer: beyond a kink of the cost, and near enough for the same phase.
    pub const BESIDE: f64 = 0.02;
}

/// [`crate::diagnose::pwm_ripple`].
pub(crate) mod pwm_ripple {
    /// Frequencies of an Uno's timers: 16 MHz over a prescaler, and over 256 or 510 counts (ATmega328P data sheet, 15.7, 16.9
    /// and 18.7).
    pub const TIMER_HZ: [f64; 6] = [490.196, 976.5625, 1960.784, 3921.569, 7812.5, 980.392];
    /// How far a clock may be from its nominal frequency: a ceramic resonator is within half a percent, and a figure in a rig
    /// file is rounded.
    pub const CLOCK_TOLERANCE: f64 = 0.006;
    /// A stated frequency may mean that of a timer this near: "1 kHz" for 976.6 Hz.
    pub const MEANS: f64 = 0.05;
    /// Half of the time whose mean is taken off: what the model lacks mostly changes more slowly.
    pub const AROUND_S: f64 = 0.25;
    /// What else the residual has is judged from this far beside a peak, in widths of it.
    pub const BESIDE: std::ops::Range<f64> = 3.0..30.0;
    /// Frequencies lie closer than a ripple is wide by this factor, and so do the parts of the recording that are summed first.
    pub const FINER: f64 = 8.0;
}

/// [`crate::diagnose::random_losses`].
pub(crate) mod random_losses {
    /// With fewer counts in a window their rounding is too regular.
    pub const FEWEST_COUNTS: f64 = 2.0;
    /// Fewest windows.
    pub const FEWEST: usize = 400;
    /// Tolerance of the correlations against those of independent steps.
    pub const LOOSE: f64 = 0.08;
    /// Lags at which independent steps have no correlation.
    pub const FAR: [usize; 2] = [3, 4];
    /// The shares lost in the slower and the faster half agree to this factor.
    pub const EVEN: f64 = 1.5;
    /// Number of blocks for the error of the share, and the multiple of its error at which it is beyond doubt.
    pub const BLOCKS: usize = 20;
    pub const LEAST_SIGMAS: f64 = 8.0;
    /// Smaller shares are not named.
    pub const LEAST_SHARE: f64 = 0.005;
    /// With a greater share the encoder would not work at all.
    pub const MOST: f64 = 0.9;
}

/// [`crate::diagnose::ripple_phase`].
pub(crate) mod ripple_phase {
    /// The phase is estimated over this many cells of this length.
    pub const CELL_S: f64 = 0.1;
    pub const CELLS: usize = 4;
    /// Slower errors of the model are not ripple.
    pub const SLOW_S: f64 = 0.2;
    /// A window has at least this many ripples; fewer follow any error of the model.
    pub const FEWEST_RIPPLES: f64 = 3.0;
    /// The right number of ripples explains this multiple of what most numbers explain, and of the next best.
    pub const CLEAR: [f64; 2] = [3.0, 1.5];
    /// A window gives the phase if it explains this multiple of the squared noise.
    pub const TELLS_PHASE: f64 = 12.0;
    /// Number of corrections, each from the rest of the one before.
    pub const ROUNDS: usize = 2;
    /// The ripple with the corrected angle has to lower the cost to this share.
    pub const LEAST_GAIN: f64 = 0.9;
}

/// [`crate::diagnose::scale`].
pub(crate) mod scale {
    use std::f64::consts::TAU;

    /// Three constants that agree on one factor to this tolerance are in another scale.
    pub const SAME_FACTOR: f64 = 0.06;
    /// Constants of a data sheet differ from a common factor by at most this...
    pub const NEARLY: f64 = 0.3;
    /// ... or by this part of it: at a factor of a thousand much may remain.
    pub const ROUGHLY: f64 = 0.1;
    /// Counts are lost at all speeds if at this share of the greatest speed...
    pub const FROM_STANDSTILL: f64 = 0.05;
    /// ... nearly the same share is lost.
    pub const EVEN: f64 = 0.9;
    /// Usual wrong factors: of counts, of a speed's unit, of a current's unit.
    pub const DECODINGS: [f64; 2] = [2.0, 4.0];
    pub const SPEED_UNITS: [f64; 3] = [60.0 / TAU, 360.0 / TAU, 1.0 / TAU];
    pub const MILLIAMPERES: [f64; 1] = [1000.0];
    /// A factor within this of a usual one is that one: one data sheet in twenty is further off.
    pub const KNOWN: f64 = 0.18;
    /// Quantiles of Student's distribution for a 95 % interval with one and with two degrees of freedom.
    pub const STUDENT: [f64; 2] = [12.7, 4.30];
}

/// [`crate::diagnose::select`].
pub(crate) mod select {
    /// Largest number of effects.
    pub const MOST_EFFECTS: usize = 7;
    /// An effect is tried further with this significance...
    pub const LEAST_SIGMAS: f64 = 3.0;
    /// ... and if it explains at least this share of the remaining error.
    pub const LEAST_SHARE: f64 = 0.02;
    /// Two models closer than this cannot be told apart.
    pub const SAME_SIGMAS: f64 = 2.5;
    pub const SAME_SHARE: f64 = 0.02;
    /// Another law of an effect, or a rival, is fitted further if its cost so far is at most this multiple of the present
    /// one.
    pub const NEAR: f64 = 10.0;
    /// Up to this multiple of the noise floor a rest may come from the simplifications of the laws.
    pub const SMALL_REST: f64 = 2.0;
    /// A drop of half the supply, less a tenth for the uncertainty of a fit.
    pub const HALF_SUPPLY: f64 = 0.45;
}

/// [`crate::diagnose::select::backward`].
pub(crate) mod select_backward {
    /// Significance needed to name an effect, all others being present. Many effects are tried, and residuals have long
    /// tails. Right names have more than ten on generated benches.
    pub const NAMED_SIGMAS: f64 = 6.0;
    /// Evidence names an effect that explains at least this share of the remaining error: a smaller one may be what another law
    /// leaves out.
    pub const MATTERS_SHARE: f64 = 0.1;
    /// A usual effect also matters if resistance, torque constant or inertia are off by a twentieth without it. Recordings
    /// determine them to some percent.
    pub const MOVES_A_CONSTANT: f64 = 0.05;
    /// Held-out data confirm what the seen data show with very strong evidence from this significance on: once in forty times by
    /// chance.
    pub const CONFIRMED_SIGMAS: f64 = 2.0;
    /// Significance of an effect whose usual companion is absent; wrong names had ten.
    pub const ALONE_SIGMAS: f64 = 50.0;
    /// A similar law outside the catalogue is the better one with this significance, however small its gain.
    pub const OTHER_LAW_SIGMAS: f64 = 3.0;
    /// An effect that raises the error of one quantity by this factor beyond the noise explains another quantity at its
    /// cost.
    pub const SPOILT: f64 = 1.5;
    /// No law of a bridge's transistors follows them more closely than to some percent of their drop: typical and greatest
    /// values differ by a third (ST L293D data sheet), and they change with the temperature.
    pub const LEAST_OF_DRY_LOSSES: f64 = 0.03;
    /// Number of rivals fitted in place of an effect. Beside the best, only those that promise this share of its gain.
    pub const RIVALS: usize = 3;
    pub const RIVAL_SHARE: f64 = 0.7;
    /// If a model without the effect needs this many more squared deviations from the data sheet, that counts for the
    /// effect: it is likelier than such a motor.
    pub const IMPLAUSIBLE_SQUARES: f64 = 18.0;
    /// For a wave, this many other numbers of periods are tried. It is rejected if more than half of them gain this share
    /// of its gain and leave less than this multiple of its rest.
    pub const OTHER_NUMBERS: usize = 6;
    pub const GAINED_BY_ANY: f64 = 0.5;
    pub const LEFT_BY_ANY: f64 = 2.0;
}

/// [`crate::diagnose::select::forward`].
pub(crate) mod select_forward {
    /// Number of candidates fitted at each step, the most promising ones, and those that promise nearly as much as the best: a
    /// promise is of the first order.
    pub const TRIED: usize = 4;
    pub const NEARLY_AS_PROMISING: f64 = 0.7;
    /// At each step only effects that promise this share of the best one's promise are fitted.
    pub const TRIED_SHARE: f64 = 0.2;
    /// While a rest remains, this many effects are added without evidence: two that hide each other show it only together.
    pub const MOST_WITHOUT_EVIDENCE: usize = 3;
    /// They have to lower the cost to this share.
    pub const LEAST_COST_WITHOUT_EVIDENCE: f64 = 0.9;
    /// If the cost falls to this share but rises in places, the fit has not converged yet.
    pub const NOT_THERE_YET: f64 = 0.5;
    /// Number of starts that are fitted before what they reached limits the next ones, or ends the search.
    pub const AT_A_TIME: usize = 6;
}

/// [`crate::diagnose::select::winding`].
pub(crate) mod select_winding {
    /// Spread of the logarithm of an inductance that is held fixed.
    pub const HELD_SPREAD: f64 = 0.01;
}

/// [`crate::diagnose::speed_reading`].
pub(crate) mod speed_reading {
    /// Without a delay, another reading has to lower the cost to this share. Rows are mostly short beside the motor's time
    /// constant, and many causes fit a little better with a small delay.
    pub const LEAST_GAIN: f64 = 0.9;
    /// A mean over a window is late by half of it. Windows between these multiples of what a lag suggests are tried...
    pub const WINDOWS: std::ops::RangeInclusive<f64> = 0.6..=1.6;
    /// ... in so many steps, and in as many again around the best.
    pub const WINDOW_STEPS: usize = 8;
}

/// [`crate::diagnose::trust`].
pub(crate) mod trust {
    /// A name needs at least this multiple of the unexplained rest. The largest part of an unknown effect often resembles a
    /// known one.
    pub const LEAST_OF_REST: f64 = 3.0;
    /// The multiple for effects that nearly every bench has, if they are significant by themselves. In place of an unknown
    /// effect none of eighteen benches without them showed one.
    pub const LEAST_OF_USUAL: f64 = 0.5;
    /// The multiple for an effect that fits any course over time. Right names had a hundred, wrong ones up to six.
    pub const LEAST_OF_ANY_COURSE: f64 = 20.0;
    /// The multiple for a fault of a sensor beside a rest below the threshold. There the law of a torque may differ from
    /// the named one, and a sensor's fault would absorb the difference. Right names had three and more, wrong ones one.
    pub const LEAST_OF_SMALL_REST: f64 = 2.0;
}

/// [`crate::diagnose::unseen_losses`].
pub(crate) mod unseen_losses {
    /// The model is right otherwise if the middle half of its residual is at most this multiple of the noise.
    pub const RIGHT_OTHERWISE: f64 = 1.5;
    /// A moment stands out from this many standard deviations on...
    pub const STANDS_OUT: f64 = 6.0;
    /// ... or from this many counts, beyond the error that is tolerated of a model.
    pub const LEAST_COUNTS: f64 = 2.5;
    /// At most this share of all rows may stand out.
    pub const MOST_ROWS: f64 = 0.1;
    /// Of the moments that stand out, at least this share are losses.
    pub const LEAST_SHARE: f64 = 0.9;
    /// In the middle of a burst at most this share of the turned angle is counted; several short bursts may be one moment.
    pub const MOST_COUNTED: f64 = 0.5;
    /// Fewer abrupt ends than this prove nothing...
    pub const FEWEST_ABRUPT: usize = 3;
    /// ... and an end is abrupt if the speed returns faster by this factor than a shaft could.
    pub const ABRUPT: f64 = 1.4;
}
