//! How recordings are made ready for a fit.

/// Shorter stretches are not used.
pub const SHORTEST_STRETCH: usize = 20;
/// A shorter recording shows few causes, and hardly separates them.
pub const SHORTEST_S: f64 = 2.0;
/// Rows farther apart show the motor's dynamics only if they show its steps in part...
pub const LONGEST_INTERVAL_S: f64 = 0.1;
/// ... and times of rows still farther apart are hardly in seconds.
pub const LONGEST_OF_ALL_S: f64 = 0.25;
/// A step has this share of its change left after one row, if a row is four time constants. Less is hidden by noise.
pub const LEFT_AFTER_A_ROW: f64 = 0.02;
/// A change of the command by this share of the greatest is a step...
pub const STEP: f64 = 0.25;
/// ... if it is followed by so many rows of the same command, after which the speed has settled.
pub const SETTLED: usize = 4;
/// A row longer than this many usual ones spans missing rows.
pub const LONG_ROW: f64 = 1.5;
/// Time over which an angle is differentiated: short against the motor, long against the encoder's step.
pub const DIFFERENCE_SPAN_S: f64 = 0.005;
/// A row whose command is this share of the greatest one has its magnitude...
pub const SAME_MAGNITUDE: f64 = 0.97;
/// ... and if only one magnitude was played, at least this share of the rows have it, of those in which the motor is
/// driven or turns...
pub const ONE_MAGNITUDE_ROWS: f64 = 0.98;
/// ... by more than this share of the greatest.
pub const AT_REST: f64 = 0.05;
/// PWM frequency of the firmware, where the rig file gives none.
pub const PWM_HZ: f64 = motorbench_core::HARDWARE.pwm_hz as f64;
/// A share of the supply is at most one, apart from rounding.
pub const GREATEST_DUTY: f64 = 1.05;

/// [`crate::dataset::columns`].
pub(crate) mod columns {
    /// Median of the magnitude of a standard normal.
    pub const NORMAL_MEDIAN: f64 = 0.6745;
}

/// [`crate::dataset::contradictions`].
pub(crate) mod contradictions {
    /// A larger deviation is no rounding, ripple or tolerance of a sensor.
    pub const OFF: f64 = 0.05;
    /// If fewer counts than expected come, up to this share may be lost counts.
    pub const LOST: f64 = 0.25;
    /// Both columns are compared over this time, which is long against the delays of filters and windows...
    pub const BLOCK_S: f64 = 0.25;
    /// ... if the motion covers at least this many counts.
    pub const FEWEST_COUNTS: f64 = 50.0;
    /// Fewer blocks prove nothing...
    pub const FEWEST_BLOCKS: usize = 5;
    /// ... nor do blocks that scatter by more than this part of the deviation of their median.
    pub const AGREE: f64 = 0.25;
    /// A smaller share of the supply has too large a rounding error.
    pub const SUBSTANTIAL_DUTY: f64 = 0.2;
    /// A supply that sags, or is raised by a braking motor, deviates in many rows, but not in this share of them.
    pub const AS_IT_STANDS: f64 = 0.1;
    pub const FEWEST_ROWS: usize = 50;
}

/// [`crate::dataset::counted_edges`].
pub(crate) mod counted_edges {
    /// A speed is timed so if this share of the times from edge to edge connect the rows, and there are at least this many.
    pub const LEAST_SHARE: f64 = 0.95;
    pub const FEWEST_TIMES: usize = 100;
    /// The last edge before a row is at most this many edge times old, by the reading.
    pub const OLDEST_STEPS: f64 = 3.0;
    /// Relative rounding error of a program's quotient.
    pub const QUOTIENT: f64 = 2e-4;
    /// A shaft is at rest if no edge comes for this long, and for as long as a shaft at the second speed takes from edge to
    /// edge. This share is left out at either end, where it stops or starts within an edge.
    pub const STILL_S: f64 = 0.02;
    pub const CREEP_RAD_PER_S: f64 = 0.16;
    pub const STILL_ENDS: f64 = 0.25;
}

/// [`crate::dataset::counter_stops`].
pub(crate) mod counter_stops {
    /// A stop loses at least this many counts, and at least as many on either side show the speed.
    pub const FEWEST_COUNTS: f64 = 8.0;
    /// Between equal times before a stop, or after it, the speed changes by less than this factor. A motor that brakes
    /// evenly to a standstill, or starts from one, turns three times as far in the farther of them.
    pub const ABRUPT: f64 = 1.6;
    /// The command during a stop is at least this share of the one before.
    pub const STILL_DRIVEN: f64 = 0.7;
    /// Fewer stops may be single events of any kind.
    pub const FEWEST: usize = 3;
    /// So many lengths of a stop are looked at on either side. The shaft stands where it turns less than this share of what a
    /// stop loses. A counter is blocked less than a third of the time, and apart from that the shaft hardly stands.
    pub const AROUND: usize = 10;
    pub const STILL_TURNING: f64 = 0.5;
    pub const MOST_STANDING: f64 = 1.0 / 3.0;
    pub const MOST_STANDING_APART: f64 = 0.25;
    /// Rows over which a change of speed is evaluated: one row shows the fastest, three have less rounding.
    pub const SPANS: [usize; 2] = [1, 3];
    /// Rows right before and after a stop that a model found show the speed there.
    pub const BESIDE: usize = 2;
    /// Rounding error of a second difference of whole counts.
    pub const ROUNDED: f64 = 2.0;
}

/// [`crate::dataset::dead_current`].
pub(crate) mod dead_current {
    /// A reading within this many steps of the sensor's resolution stands still: a step to either side, and how a file rounds
    /// them. Where the rig file states no resolution, only one that is the same in all rows does.
    pub const MOST_STEPS: f64 = 2.5;
    /// A sensor that is coarse beside the current follows the voltage by at least this. Such a reading does not stand still.
    pub const FOLLOWS: f64 = 0.1;
    /// A motion that is this many times its noise is one.
    pub const MOVES: f64 = 5.0;
}

/// [`crate::dataset::edge_timing`].
pub(crate) mod edge_timing {
    /// A speed worth a look has so many rows that repeat the two before them, or fade.
    pub const FEWEST_OLD_ROWS: usize = 30;
    /// Edges a revolution that are looked for, in steps of this factor.
    pub const FEWEST_EDGES: f64 = 1.0;
    pub const MOST_EDGES: f64 = 4000.0;
    pub const CLOSER: f64 = 1.02;
    /// A fading speed is one step over a time: to this share.
    pub const SAME_STEP: f64 = 0.03;
    /// A time from edge to edge is looked at where it takes so many rows...
    pub const SLOW_ROWS: f64 = 3.0;
    /// ... and agrees with the speed that is read at its end to so many, since edges come anywhere in their row.
    pub const KNOWN_TO_ROWS: f64 = 1.2;
    /// Edges that are so many rows apart are not in two rows after each other.
    pub const APART_ROWS: f64 = 2.0;
    /// So many times are looked at, fewer where the rig file tells the encoder, of which this share agrees...
    pub const FEWEST_TIMES: usize = 20;
    pub const FEWEST_OF_RIG: usize = 8;
    pub const LEAST_SHARE: f64 = 0.85;
    /// ... and the longest of them is this many times the shortest: a speed that is made anew after so many rows has one.
    pub const LEAST_RANGE: f64 = 1.5;
    /// The encoder that the rig file tells of, counted by all edges, by those of one channel, by half of these.
    pub const DECODED: [f64; 3] = [1.0, 2.0, 4.0];
    /// A shaft that gathers speed evenly from rest takes, for the two steps to its first reading, this many times what that says.
    pub const STEPS_FROM_REST: f64 = 4.0;
}

/// [`crate::dataset::end_of_range`].
pub(crate) mod end_of_range {
    /// Rows at the end of a range: as a share of all, and one after the other.
    pub const LEAST_SHARE: f64 = 0.02;
    pub const LEAST_ROWS: f64 = 5.0;
    /// Before it stops a reading goes on by this many of its own steps a row, as a middle of all stops...
    pub const LEAST_STEPS: f64 = 3.0;
    /// ... and by this share of its greatest.
    pub const LEAST_OF_GREATEST: f64 = 0.05;
    /// Of the greatest reading: less than any sensor tells apart.
    pub const CALCULATED: f64 = 1e-7;
    /// Rows over which that is seen.
    pub const ON_ITS_WAY: usize = 3;
}

/// [`crate::dataset::held_out`].
pub(crate) mod held_out {
    /// Length of a block. It is shorter in short recordings, which would have fewer blocks than this.
    pub const BLOCK_S: f64 = 0.25;
    pub const FEWEST_BLOCKS: f64 = 24.0;
    /// One block in so many is held out, and which of them.
    pub const EVERY: usize = 3;
    pub const HELD_OUT: usize = 1;
    /// Evenly spread, the held-out part has a third of all changes of the motion. With less than a twentieth it judges what it
    /// hardly sees, and with more than half of them the fit does.
    pub const FAIR: std::ops::RangeInclusive<f64> = 0.05..=0.5;
    /// A change is that over this part of a block: at most 16 ms, short against the response of a motor.
    pub const PART_OF_BLOCK: usize = 16;
}

/// [`crate::dataset::held_rotor`].
pub(crate) mod held_rotor {
    /// A motion within this multiple of its noise, or these counts in its window, is none...
    pub const NOISES: f64 = 5.0;
    pub const COUNTS: f64 = 3.0;
    /// ... except in this share of the driven rows: a clamp yields a little with each step.
    pub const GIVES_WAY: f64 = 0.01;
    /// A row is driven from this share of the greatest voltage on.
    pub const DRIVEN: f64 = 0.3;
    /// Without a back-EMF the present command explains this share of the current's variance. It is computed as the mean in
    /// this many parts of the voltage range, in rows in which the winding has settled.
    pub const ANSWERS: f64 = 0.9;
    pub const PARTS: usize = 32;
    pub const SETTLED_S: f64 = 0.01;
}

/// [`crate::dataset::measured`].
pub(crate) mod measured {
    /// An error below this share of a quantity's spread is not named. Terms held over a millisecond, a friction that
    /// bends before it slips, and a speed read as a mean cause up to as much.
    pub const TOLERANCE: f64 = 0.01;
    /// Speeds from row to row share a count with the next. Their scatter makes them seem noisier by this factor than
    /// counting does: the root of 7/4 comes from third differences of rounding, the rest from the whole numbers.
    pub const SHARED_COUNTS: f64 = 1.7;
    /// The noise of a sensor is correlated for no longer than this: its low-pass is faster than what it is to show. What
    /// moves a motor acts for longer.
    pub const LONGEST_CORRELATION_S: f64 = 4e-3;
}

/// [`crate::dataset::mistakes`].
pub(crate) mod mistakes {
    /// A value is substantial from this share of the greatest on.
    pub const SUBSTANTIAL: f64 = 0.1;
    /// A direction counts if this share of the rows has it.
    pub const OFTEN: f64 = 0.05;
    /// A speed without a sign correlates with the magnitude of the voltage by more than this.
    pub const FOLLOWS: f64 = 0.5;
    /// A single row is impossible if it is this many times as fast as all but a hundredth of the rows.
    pub const IMPOSSIBLE: f64 = 3.0;
    pub const ALL_BUT: f64 = 0.01;
}

/// [`crate::dataset::noise`].
pub(crate) mod noise {
    /// Rows at different distances scatter alike within this factor: noise behind a low-pass does from two of its time
    /// constants on. What is smooth scatters with the third power of the distance.
    pub const SAME_SCATTER: f64 = 1.2;
    /// Of white noise rows at all distances scatter alike, but for the chance of some hundred rows.
    pub const NOT_WHITE: f64 = 1.05;
}

/// [`crate::dataset::pwm`].
pub(crate) mod pwm {
    /// Every edge of a PWM is simulated up to this frequency, which takes no more steps than the usual ones of half a
    /// millisecond. A faster one is averaged.
    pub const MOST_HZ: f64 = 1500.0;
    /// Standard deviation of the moment at which a program reads a current. A conversion begins with the next clock of the
    /// converter, 8 us on an Uno (ATmega328P data sheet, 24.4), and `micros()` counts in steps of 4 us; both are uniform.
    pub const MOMENT_S: f64 = 2.6e-6;
}

/// [`crate::dataset::reading`].
pub(crate) mod reading {
    /// A pause of this many intervals begins a new stretch...
    pub const GAP_INTERVALS: f64 = 10.0;
    /// ... unless it is at most this long and the command after it is the one before: then the command was held.
    pub const LONGEST_HELD_S: f64 = 1.0;
    /// If a command is missing for longer than this, the bridge was off.
    pub const OPEN_BRIDGE_S: f64 = 0.02;
    /// A duty beyond the whole supply is limited up to here.
    pub const GREATEST_LIMITED_DUTY: f64 = 2.0;
    /// A motion with this correlation against its drive is impossible: a motor takes energy from its drive.
    pub const BACKWARD: f64 = -0.2;
}

/// [`crate::dataset::resolution`].
pub(crate) mod resolution {
    /// A step is seen in so many gaps between the values that occur, each read so often in the mean.
    pub const FEWEST_GAPS: usize = 4;
    pub const FEWEST_READINGS: usize = 5;
    /// A gap is a whole number of steps, to this share of it: a file rounds a step to two digits at least.
    pub const UNEVEN: f64 = 0.2;
}

/// [`crate::dataset::row_order`].
pub(crate) mod row_order {
    /// Rows after a change of the command in which its response is evaluated; later ones depend on the levels.
    pub const ROWS: usize = 12;
    /// The response in the command's own row counts from this many standard errors on...
    pub const LEAST_SIGMAS: f64 = 8.0;
    /// ... if it is this share of the greatest in any row. A feedback of the readings is far smaller, and so is the
    /// response of a winding before a sensor that is read shortly after the command. A motion begins slowly.
    pub const LEAST_SHARE_OF_CURRENT: f64 = 0.2;
    pub const LEAST_SHARE_OF_MOTION: f64 = 0.08;
    /// Rows for each coefficient, at least.
    pub const ROWS_PER_COEFFICIENT: usize = 10;
}

/// [`crate::dataset::speed_window`].
pub(crate) mod speed_window {
    /// Longest window that is tried.
    pub const LONGEST_S: f64 = 0.1;
    /// At least this share of the rows in motion has to agree, and at least so many rows.
    pub const LEAST_SHARE: f64 = 0.98;
    pub const FEWEST_ROWS: usize = 50;
    /// One in so many of all rows with a count has to agree: the few rows of one peak may agree by chance.
    pub const ONE_IN: usize = 40;
    /// A window is rejected early if a smaller share of the fewest rows agrees.
    pub const HOPELESS_SHARE: f64 = 0.9;
    /// A row agrees to this part of a count.
    pub const CLOSE: f64 = 0.1;
    /// A least step has at most this many parts; the next greater steps are up to this many times it.
    pub const MOST_PARTS: u32 = 4;
    pub const NEXT_GREATER: f64 = 6.0;
    /// Two speeds of the same counts differ by less than this part of a count; a speed timed by edges does not.
    pub const SAME: f64 = 0.25;
    /// Rows with fewer counts in the window contain too little.
    pub const FEWEST_COUNTS: f64 = 3.0;
    /// Intervals are equal when they differ by less than this share.
    pub const EVEN: f64 = 0.01;
}

/// [`crate::dataset::thinned`].
pub(crate) mod thinned {
    /// Rows closer than this are thinned. The speed of a small motor changes over tens of milliseconds.
    pub const SHORTEST_ROW_S: f64 = 1e-3;
}

/// [`crate::dataset::turns`].
pub(crate) mod turns {
    /// An angle within a revolution may exceed it by this much.
    pub const ROUNDED: f64 = 1e-3;
    /// Overflow spans of counters whose steps from row to row are small against them.
    pub const LONG_SPANS: [f64; 2] = [65_536.0, 4_294_967_296.0];
    /// A counter of one byte.
    pub const BYTE: f64 = 256.0;
    /// A step of more than this share of the span may as well be one in the other direction.
    pub const MOST_OF_SPAN: f64 = 0.4;
    /// This many such steps are more than a glitch.
    pub const AMBIGUOUS_SHARE: f64 = 0.01;
}
