//! Why recordings cannot be used, each with where and what to do.

use super::LONGEST_INTERVAL_S;
use motorbench_text::terminal_text::short;

/// Why recordings cannot be used together with this rig file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DatasetError {
    /// A recording without time, among others with.
    #[error("{0}: no column t_s; a table of steady states is diagnosed alone")]
    NoTime(String),
    /// The same, with a column that looks like it.
    #[error("{0}")]
    OtherTime(String),
    /// One recording given as two.
    #[error("{0} has the same rows as {1}. Its noise would count twice as evidence: leave one of them out")]
    Twice(String, String),
    /// Nothing says what drove the motor.
    #[error(
        "{0}: nothing says what drove the motor. Record the command of the bridge (u_V or duty), or of a drive the current or the command (i_A, torque_Nm, force_N)"
    )]
    NoDrive(String),
    /// A duty alone has no volts.
    #[error("{0}: duty without u_V needs the supply: [supply] voltage_V in the rig file, or a column supply_V")]
    NoSupply(String),
    /// A duty of more than all.
    #[error(
        "{0}: duty reaches {1}; it must be a share of the supply from -1 to 1. If it is in percent: --column duty=duty/100; if in 255 steps of a timer: --column duty=duty/255"
    )]
    NoShare(String, f64),
    /// A reading that opposes what drives it.
    #[error(
        "{name}: {column} has the opposite sign of the {drive} that drives it. Exchange the encoder's channels or the motor's wires, or add --column {column}={column}*-1"
    )]
    Backward {
        /// Which recording.
        name: String,
        /// What has the wrong sign.
        column: &'static str,
        /// What is imposed.
        drive: &'static str,
    },
    /// A motion that is not said to go backwards.
    #[error(
        "{name}: the {drive} reverses but {column} never becomes negative, so it has no sign. Count both channels of the encoder, or record one direction only. If another column has the direction: --column '{column}*sign(dir)={column}'"
    )]
    NoSign {
        /// Which recording.
        name: String,
        /// What has no sign.
        column: &'static str,
        /// What is imposed.
        drive: &'static str,
    },
    /// Two inputs of one plant.
    #[error(
        "{0}: {1} and {2} both say what drives the motor. A bridge has a voltage, a drive a torque or a force: leave one of the columns out"
    )]
    TwoDrives(String, &'static str, &'static str),
    /// An axis that turns and does not.
    #[error("{0}: {1} is of a rotary axis and {2} of a linear one: leave out what is not of this axis")]
    TwoMotions(String, &'static str, &'static str),
    /// Columns of another axis than the rig file's.
    #[error(
        "{0}: the rig file says that the axis is {2}, and {1} is a column of the other kind. Correct [axis] motion, or map the column to one of this kind (linear: x_m, v_m_per_s, force_N; rotary: theta_rad, omega_rad_per_s, torque_Nm)"
    )]
    OtherMotion(String, &'static str, &'static str),
    /// Counts alone have no angle.
    #[error("{0}: counts without an angle or a speed need [encoder] counts_per_rev in the rig file")]
    NoCountsPerRev(String),
    /// Nothing was measured.
    #[error(
        "{0}: no measured motion: record omega_rad_per_s, rpm, theta_rad or counts (and i_A if there is a current sensor)"
    )]
    NoMotion(String),
    /// Recordings of one rig with other columns.
    #[error("{0}: its columns differ from those of {1}: diagnose them one by one")]
    Mixed(String, String),
    /// Too slow, or with times in another unit.
    #[error(
        "{name}: rows are {} s apart (t_s), too far to show the motor's dynamics: record at 100 Hz or more. Are the times in {unit}? Then add --column t_s=t_s*{factor}", short(*.interval_s)
    )]
    TooSlow {
        /// Which recording.
        name: String,
        /// Usual time between samples.
        interval_s: f64,
        /// In which the times would make sense.
        unit: &'static str,
        /// What brings them to seconds.
        factor: f64,
    },
    /// Too short.
    #[error("{0}: {1} samples without a gap are too few: record at least 2 s at 100 Hz or more")]
    TooShort(String, usize),
    /// A mean over more than there is.
    #[error("{0}: [recording] speed_window_s = {1:.3} s is longer than any part of the recording. Is it in seconds?")]
    LongWindow(String, f64),
    /// An angle or a counter that goes round too fast.
    #[error(
        "{name}: {column} wraps after {span:.4}, and often changes by half of that or more from row to row ({interval_s:.4} s). Direction and distance are then unknown. Record at least twice as often, or let the counter run on"
    )]
    Aliased {
        /// Which recording.
        name: String,
        /// What goes round.
        column: &'static str,
        /// After what.
        span: f64,
        /// Usual time between samples.
        interval_s: f64,
    },
    /// The noise is greater than what moves.
    #[error(
        "{0}: the recorded motion is hardly above the noise of its sensor (fit {1:.0} %): drive faster, time the edges, or sample the angle less often"
    )]
    Drowned(String, f64),
    /// One operating point.
    #[error(
        "{0}: neither command nor motion changes, and one operating point cannot identify a motor. Record the sequence `identify` (20 s), or give the means of several such points as a table of steady states (no t_s)"
    )]
    Steady(String),
    /// The rotor is held, and nothing else was recorded.
    #[error(
        "{0}: the motor is driven and draws current but does not turn: the rotor is held. This shows resistance, inductance and drop only. Diagnose it together with a recording of the same rig that turns: `motorbench diagnose TURNING.csv {0}`"
    )]
    Held(String),
    /// Nothing happens in it.
    #[error(
        "{0}: the motor is never driven, or its motion is below the noise of its sensor. Record the sequence `identify` (20 s), which reverses and stops"
    )]
    Quiet(String),
}

impl DatasetError {
    /// With the unit in which such times would make sense.
    pub(super) fn too_slow(name: String, interval_s: f64) -> Self {
        let (unit, factor) = match 1e-3 * interval_s > LONGEST_INTERVAL_S {
            true => ("microseconds", 1e-6),
            false => ("milliseconds", 1e-3),
        };
        Self::TooSlow { name, interval_s, unit, factor }
    }
}
