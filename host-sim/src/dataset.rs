//! Recordings made ready for identification: what drove the motor, what was measured, and which part is kept back.

use crate::recording::{Channel, Recording};
use crate::rig::{Readings, Rig, Timing};
use crate::terminal_text::short;
use std::f64::consts::TAU;
use std::ops::Range;

mod counter_stops;
mod edge_timing;
mod end_of_range;
mod mistakes;
mod row_order;
mod speed_window;
mod turns;

pub use counter_stops::CounterStop;
use edge_timing::Timed;
pub use edge_timing::{BetweenEdges, EdgeTiming, Edges};
pub use end_of_range::EndOfRange;
use speed_window::Found;
pub use speed_window::Window;
use turns::Ambiguous;

/// A pause of this many intervals begins a new stretch...
const GAP_INTERVALS: f64 = 10.0;
/// ... unless it is no longer than this and the command after it is the one before: then that was held.
const LONGEST_HELD_S: f64 = 1.0;
/// Stretches shorter than this are of no use.
const SHORTEST_STRETCH: usize = 20;
/// Less than this shows few of the causes, and those hardly apart.
const SHORTEST_S: f64 = 2.0;
/// Rows farther apart show nothing of a motor's dynamics.
const LONGEST_INTERVAL_S: f64 = 0.1;
/// Span over which an angle is differentiated: short against the motor, long against the encoder's step.
const DIFFERENCE_SPAN_S: f64 = 0.005;
/// A command missing for longer than this means that the bridge was off.
const OPEN_BRIDGE_S: f64 = 0.02;
/// Blocks of this length are kept back in turn, one in [`KEPT_BACK_EVERY`]; shorter in short recordings.
const BLOCK_S: f64 = 0.25;
const FEWEST_BLOCKS: f64 = 24.0;
const KEPT_BACK_EVERY: usize = 3;
/// Which of them is kept back.
const KEPT_BACK: usize = 1;
/// An error below this share of a quantity's spread is not worth a name: holding terms over half a millisecond, a friction
/// that bends before it slips and reading a speed as a mean cost up to as much.
pub const TOLERANCE: f64 = 0.01;
/// A share of the supply is no more than all of it, but for its rounding.
const GREATEST_DUTY: f64 = 1.05;
/// A motion that goes against its drive to this correlation is no motor's: that takes energy from what drives it.
const BACKWARD: f64 = -0.2;
/// PWM frequency of the firmware, where the rig file gives none.
const PWM_HZ: f64 = 20_000.0;

/// A measured quantity that the simulation has to meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// Armature current.
    Current,
    /// Speed as recorded.
    Speed,
    /// Speed as recorded, which is a difference of counts over a [`Stretch::window`].
    MeanSpeed,
    /// Speed as recorded, which is timed by [`Dataset::edge_timing`].
    TimedSpeed,
    /// Speed as the difference of recorded angles over a [`Stretch::window`].
    AngleDifference,
}

impl Output {
    /// Column name of what it was made from.
    pub fn channel(self) -> &'static str {
        match self {
            Self::Current => Channel::Current.column(),
            Self::Speed | Self::MeanSpeed | Self::TimedSpeed => Channel::Speed.column(),
            Self::AngleDifference => "omega_from_angle_rad_per_s",
        }
    }

    /// Its unit.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Current => "A",
            Self::Speed | Self::MeanSpeed | Self::TimedSpeed | Self::AngleDifference => "rad/s",
        }
    }
}

/// A measured quantity.
#[derive(Clone, Debug)]
pub struct Measured {
    /// What it is.
    pub output: Output,
    /// Its samples, missing ones as NaN.
    pub values: Vec<f64>,
    /// Standard deviation of its noise, from its own sample-to-sample unrest.
    pub noise: f64,
    /// What rounding to whole counts makes of it, or edges anywhere in their row; 0 of what is not counted.
    pub of_counting: f64,
    /// What no model of a bench is asked to know better: [`TOLERANCE`] of its spread, or the reading's own step.
    pub tolerance: f64,
}

impl Measured {
    /// Standard deviation of the noise in what a model leaves of it. Where counts are few they go up so evenly that their
    /// unrest tells less than all of it.
    pub fn noise_in(&self, residual: &[f64]) -> f64 {
        noise(residual).max(self.of_counting)
    }

    fn scale(&mut self, factor: f64) {
        self.values.iter_mut().for_each(|value| *value *= factor);
        for scale in [&mut self.noise, &mut self.of_counting, &mut self.tolerance] {
            *scale *= factor;
        }
    }

    /// Error of a model that is as good as can be asked, where the sensor has this noise.
    pub fn least_error(&self, noise: f64) -> f64 {
        noise.hypot(self.tolerance)
    }
}

/// Rows without a gap; the simulation begins anew with them.
#[derive(Clone, Debug, PartialEq)]
pub struct Stretch {
    /// Which.
    pub rows: Range<usize>,
    /// Usual time between them.
    pub interval_s: f64,
    /// Over which a speed that is a mean was taken.
    pub window: Window,
}

impl Stretch {
    /// Length of the window, of one row where a speed is that of the moment.
    pub fn window_s(&self) -> f64 {
        self.window.span.max(1) as f64 * self.interval_s
    }
}

/// Recordings of one rig, one after the other.
#[derive(Clone, Debug, Default)]
pub struct Dataset {
    /// Its parts; those of one recording are alike.
    pub stretches: Vec<Stretch>,
    /// Time of each sample since the start of its recording.
    pub time_s: Vec<f64>,
    /// Voltage asked of the bridge from this sample to the next.
    pub voltage_v: Vec<f64>,
    /// The same as share of the supply.
    pub duty: Vec<f64>,
    /// By how much each command acted before its row, where rows are fewer than commands; empty: not at all.
    pub earlier_s: Vec<f64>,
    /// Supply voltage.
    pub supply_v: Vec<f64>,
    /// The bridge is off from this sample to the next.
    pub open: Vec<bool>,
    /// Known load torque.
    pub load_nm: Vec<f64>,
    /// Angle as measured, or as integrated from the measured speed: where on the revolution the motor is.
    pub angle_rad: Vec<f64>,
    /// What was measured.
    pub measured: Vec<Measured>,
    /// Samples that no fit sees.
    pub kept_back: Vec<bool>,
    /// Usual time between samples; of several recordings the first one's.
    pub interval_s: f64,
    /// Step of the encoder; 0 without one.
    pub count_rad: f64,
    /// PWM frequency.
    pub pwm_hz: f64,
    /// Whether that is known, and not to be found.
    pub pwm_is_known: bool,
    /// How it was recorded.
    pub timing: Timing,
    /// Over how long before its row each current is a mean; 0: it is that of the moment.
    pub current_window_s: f64,
    /// Whether each row had the command that had acted before it was read; the commands here have been moved.
    pub written_after: bool,
    /// Whether an encoder counts the motion.
    pub is_counted: bool,
    /// Where its counter stood though the motor turned...
    pub counter_stops: Vec<CounterStop>,
    /// ... and the rows of the motion that are missing for that, as they were read.
    pub read_in_stops: Vec<(usize, f64)>,
    /// Rows left out for a speed that no shaft can have had.
    pub impossible: usize,
    /// Where the range of a sensor of the speed ended before the motor's speed did.
    pub end_of_range: Option<EndOfRange>,
    /// Share of all counts that is taken for lost; angles and speeds are those with it.
    pub lost_share: f64,
    /// Columns in which there is no number.
    pub empty: Vec<Channel>,
    /// Whether the rig file says where in its window a mean speed stands.
    pub window_end_is_known: bool,
    /// Whether a speed is no more than taken for a mean since the row before.
    pub taken_over_its_row: bool,
    /// How a speed was timed by edges.
    pub edge_timing: Option<EdgeTiming>,
}

/// What one recording tells of how the speeds of all are made.
#[derive(Clone, Copy)]
enum SpeedReading {
    /// A difference of counts over so long.
    Mean { window_s: f64 },
    /// Timed by edges that are so far from each other.
    Timed { step_rad: f64 },
}

/// Why recordings cannot be used together with this rig file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DatasetError {
    /// A recording without time, among others with.
    #[error("{0}: no column t_s; a table of steady states is diagnosed alone")]
    NoTime(String),
    /// The same, with a column that looks like it.
    #[error("{0}")]
    OtherTime(String),
    /// Nothing says what drove the motor.
    #[error("{0}: neither u_V nor duty: record what the bridge was asked for")]
    NoDrive(String),
    /// A duty alone has no volts.
    #[error("{0}: duty without u_V needs the supply: [supply] voltage_V in the rig file, or a column supply_V")]
    NoSupply(String),
    /// A duty of more than all.
    #[error(
        "{0}: duty goes to {1}, and it is the share of the supply, from -1 to 1: `motorbench convert {0} NEW.csv --map duty=duty*0.01` if it is in percent, duty*0.00392157 if in 255 steps of a timer"
    )]
    NoShare(String, f64),
    /// A reading that opposes what drives it.
    #[error(
        "{name}: {column} goes against the voltage that drives it: one of them has the wrong sign; swap the channels of the encoder or the wires, or `motorbench convert {name} NEW.csv --map {column}={column}*-1`"
    )]
    Backward {
        /// Which recording.
        name: String,
        /// What has the wrong sign.
        column: &'static str,
    },
    /// A motion that is not said to go backwards.
    #[error(
        "{name}: {column} never goes backwards though the voltage does: it has no sign; count both channels of the encoder (a single one knows no direction), or record one direction alone"
    )]
    NoSign {
        /// Which recording.
        name: String,
        /// What has no sign.
        column: &'static str,
    },
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
        "{name}: {interval_s} s from sample to sample (t_s): nothing of a motor's dynamics is left; record at 100 Hz or more. Are the times in {unit}? Then `motorbench convert {name} NEW.csv --map t_s=t_s*{factor}`"
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
    /// An angle or a counter that goes round too fast.
    #[error(
        "{name}: {column} begins anew after {span:.4}, and from row to row ({interval_s:.4} s) it often goes nearly half of that or more: how far and which way cannot be told; record at least twice as often, or let the program count on"
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
        "{0}: the recorded motion is little more than the noise of its sensor (a fit of {1:.0} %): drive faster, record the speed by edge timing, or sample the angle less often"
    )]
    Drowned(String, f64),
    /// One operating point.
    #[error(
        "{0}: neither command nor motion changes, and one operating point says nothing of a motor: play the sequence `identify` (20 s), or write means of several such points as a table of steady states (no t_s)"
    )]
    Steady(String),
    /// Nothing happens in it.
    #[error(
        "{0}: the motor is never driven, or what moves is less than the noise of its sensor: play the sequence `identify` (20 s), which reverses and stops"
    )]
    Quiet(String),
}

impl Dataset {
    /// Puts recordings of one rig together.
    ///
    /// # Errors
    /// [`DatasetError`], which says what to record or to write into the rig file.
    pub fn new(recordings: &[Recording], rig: &Rig) -> Result<Self, DatasetError> {
        let mut all = Self::default();
        for (recording, one) in recordings.iter().zip(Self::each(recordings, rig)?) {
            if all.stretches.is_empty() {
                all = one;
                continue;
            }
            if !all.measured.iter().map(|m| m.output).eq(one.measured.iter().map(|m| m.output)) {
                return Err(DatasetError::Mixed(recording.name.clone(), recordings[0].name.clone()));
            }
            all.append(one);
        }
        let of_counting = all.noise_of_counting();
        for measured in &mut all.measured {
            if matches!(measured.output, Output::MeanSpeed | Output::AngleDifference) {
                measured.of_counting = of_counting;
            }
            measured.noise = measured.noise_in(&measured.values);
            let resolution = if measured.output == Output::Current { rig.current_sensor.resolution_a } else { None };
            measured.tolerance = (TOLERANCE * spread(&measured.values)).max(resolution.unwrap_or(0.0));
        }
        if rig.recording.command_delay_s.is_none() && row_order::is_written_after(&all) {
            all.written_after = true;
            row_order::move_commands(&mut all, row_order::Towards::Before);
        }
        all.keep_back(KEPT_BACK);
        if let Some(first) = recordings.first() {
            all.check(&first.name)?;
            all.check_signs(&first.name, &first.channels().collect::<Vec<_>>())?;
        }
        Ok(all)
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Whether it has none.
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// The measured current, where there is one.
    pub fn current(&self) -> Option<&Measured> {
        self.measured.iter().find(|measured| measured.output == Output::Current)
    }

    /// Speed or what stands for it.
    pub fn motion(&self) -> &Measured {
        &self.measured[self.motion_index()]
    }

    /// Which of [`measured`](Self::measured) it is.
    pub fn motion_index(&self) -> usize {
        let is_motion = |measured: &Measured| measured.output != Output::Current;
        self.measured.iter().position(is_motion).expect("checked when it was made")
    }

    /// What was found of how the recordings were made, where the rig file does not say it.
    pub fn notes(&self) -> Vec<String> {
        let mut notes: Vec<String> = self.empty.iter().map(|channel| without_a_number(*channel)).collect();
        if self.written_after {
            notes.push(row_order::WRITTEN_AFTER.into());
        }
        if self.has_moments() {
            notes.push(BETWEEN_ROWS.into());
        }
        if let Some(Stretch { window, interval_s, .. }) = self.stretches.first()
            && self.motion().output == Output::MeanSpeed
            && self.timing.speed_window_s.is_none()
        {
            notes.push(if self.taken_over_its_row { OVER_ITS_ROW.into() } else { window.note(*interval_s) });
        }
        notes.extend(self.edge_timing.as_ref().map(EdgeTiming::note));
        if let Some(first) = self.counter_stops.first() {
            notes.push(format!(
                "In {} places the counter stood while the motor was driven on (the first at {:.3} s, for {:.3} s): those rows are not compared. What holds the program up there, an interrupt or a serial line?",
                self.counter_stops.len(), self.time_s[first.rows.start], self.length_s(first)
            ));
        }
        if let Some(EndOfRange { value, rows }) = self.end_of_range {
            notes.push(format!(
                "{} runs against {} rad/s and stands there, in {:.0} % of the rows: the range of its sensor ends there. Those rows are not compared. Record slower, or with a sensor of more range.",
                self.motion().output.channel(), short(value), 100.0 * rows as f64 / self.len() as f64
            ));
        }
        if self.impossible > 0 {
            notes.push(format!(
                "{} rows are left out, each of a speed that no shaft can have had for one row alone: were lines garbled?",
                self.impossible
            ));
        }
        if self.span_s() < SHORTEST_S {
            notes.push(format!(
                "{:.1} s are little to tell causes apart: play the sequence `identify` (20 s), which shows most of them.",
                self.span_s()
            ));
        }
        if self.lost_share > 0.0 {
            notes.push(format!(
                "{:.1} % of all counts are taken for lost, by their scatter, and speeds and angles for as much greater: every constant here is one of the motor with that.",
                100.0 * self.lost_share
            ));
        }
        if self.timing.current_window_s.is_none() && self.current_window_s > 0.0 {
            notes.push(format!(
                "The current is taken for a mean over the {:.4} s before its row, which explains it as well as a lag or more inductance would: [recording] current_window_s in the rig file says what it is.",
                self.current_window_s
            ));
        }
        if !self.pwm_is_known && self.pwm_hz != PWM_HZ {
            notes.push(format!(
                "The model explains most with a PWM of {:.0} Hz, which may stand for something else in the current. [bridge] pwm_Hz in the rig file says what it is.",
                self.pwm_hz
            ));
        }
        notes
    }

    /// When the command of a row began to act.
    pub fn acts_from_s(&self, row: usize) -> f64 {
        self.time_s[row] - self.earlier_s.get(row).copied().unwrap_or(0.0)
    }

    /// Whether the moments of the commands are sought, and not those of their rows.
    pub fn has_moments(&self) -> bool {
        !self.earlier_s.is_empty()
    }

    /// The same with commands that changed between the rows, each in the middle between two; none where the rig file says
    /// when a command acts.
    pub fn with_commands_between(&self) -> Option<Self> {
        if self.timing.command_delay_s.is_some() {
            return None;
        }
        let mut other = Self { written_after: false, ..self.clone() };
        if self.written_after {
            row_order::move_commands(&mut other, row_order::Towards::After);
        }
        other.earlier_s = vec![0.0; self.len()];
        for row in self.stretches.iter().flat_map(|stretch| stretch.rows.clone().skip(1)) {
            other.earlier_s[row] = 0.5 * (self.time_s[row] - self.time_s[row - 1]);
        }
        Some(other)
    }

    /// The same with what had been counted without losses.
    pub fn with_counts_lost(&self, lost_share: f64) -> Self {
        Self { lost_share, ..self.with_motion_times(1.0 / (1.0 - lost_share)) }
    }

    /// The same with every angle and speed so many times as great.
    pub fn with_motion_times(&self, factor: f64) -> Self {
        let mut all = self.clone();
        all.count_rad *= factor;
        all.angle_rad.iter_mut().for_each(|angle| *angle *= factor);
        all.edge_timing.iter_mut().for_each(|timing| timing.step_rad *= factor);
        all.read_in_stops.iter_mut().for_each(|(_, read)| *read *= factor);
        all.measured[self.motion_index()].scale(factor);
        all
    }

    /// The same with every current so many times as great.
    pub fn with_current_times(&self, factor: f64) -> Self {
        let mut all = self.clone();
        let currents = all.measured.iter_mut().filter(|measured| measured.output == Output::Current);
        currents.for_each(|current| current.scale(factor));
        all
    }

    /// The same with every voltage so many times as great.
    pub fn with_voltage_times(&self, factor: f64) -> Self {
        let mut all = self.clone();
        all.voltage_v.iter_mut().chain(&mut all.supply_v).for_each(|voltage| *voltage *= factor);
        all
    }

    /// How long a counter stood.
    pub fn length_s(&self, stop: &CounterStop) -> f64 {
        self.time_s[stop.rows.end - 1] - self.time_s[stop.rows.start]
    }

    /// The same with the row in the middle of a mean speed's window and not at its end, where neither the columns nor the rig
    /// file say which.
    pub fn with_window_centred(&self) -> Option<Self> {
        if self.motion().output != Output::MeanSpeed || self.window_end_is_known {
            return None;
        }
        let mut other = self.clone();
        for Stretch { window, .. } in &mut other.stretches {
            window.ahead = window.span / 2;
        }
        other.integrate_mean_speed();
        Some(other)
    }

    /// The same with the speed timed the other way, or as a mean since the row before, where nothing says what it is.
    pub fn with_other_speed_reading(&self) -> Option<Self> {
        if self.timing.readings == Readings::Mean || self.timing.speed_window_s.is_some() {
            return None;
        }
        let mut other = self.clone();
        match (&mut other.edge_timing, self.motion().output) {
            (Some(timing), _) => timing.edges = Edges::SinceRowBefore,
            (None, Output::Speed) => other.take_speed_as_mean_of_its_row(),
            _ => return None,
        }
        Some(other)
    }

    fn take_speed_as_mean_of_its_row(&mut self) {
        let index = self.motion_index();
        self.measured[index].output = Output::MeanSpeed;
        self.stretches.iter_mut().for_each(|stretch| stretch.window = Window::up_to_now(1));
        (self.window_end_is_known, self.taken_over_its_row) = (true, true);
        // Of a recorded angle there is nothing to be made.
        if self.count_rad <= 0.0 {
            self.integrate_mean_speed();
        }
    }

    /// The angle, of which a mean speed was made, from it: in each stretch from zero.
    fn integrate_mean_speed(&mut self) {
        let speed = held(&self.motion().values);
        for Stretch { rows, window, .. } in &self.stretches {
            let of_stretch = speed_window::angle_rad(&speed[rows.clone()], *window, &self.time_s[rows.clone()]);
            self.angle_rad[rows.clone()].copy_from_slice(&of_stretch);
        }
    }

    /// Stops that the counts themselves show.
    fn find_counter_stops(&self) -> Vec<CounterStop> {
        // Of a recorded angle, or of the counts a speed was made of.
        if self.count_rad <= 0.0 {
            return Vec::new();
        }
        let count = |row: usize| match self.motion().values[row].is_finite() {
            true => (self.angle_rad[row] / self.count_rad).round(),
            false => f64::NAN,
        };
        let of_stretch = |Stretch { rows, .. }: &Stretch| {
            let counts: Vec<f64> = rows.clone().map(count).collect();
            let stops = counter_stops::find(&counts, &self.voltage_v[rows.clone()]).into_iter();
            stops.map(|stop| stop.later_by(rows.start)).collect::<Vec<_>>()
        };
        self.stretches.iter().flat_map(of_stretch).collect()
    }

    /// No model says when a counter stands: rows in whose window it did are missing, and the angle goes on.
    pub fn leave_out(&mut self, stops: Vec<CounterStop>) {
        let is_recorded = self.motion().output == Output::Speed;
        for stop in stops {
            let stretch = self.stretches.iter().find(|stretch| stretch.rows.contains(&stop.rows.start));
            let Some(Stretch { rows, interval_s, window }) = stretch.cloned() else { continue };
            // What a board made of a speed it had from elsewhere takes no longer than a difference of angles.
            let span = if is_recorded { (DIFFERENCE_SPAN_S / interval_s).ceil() as usize } else { window.span };
            let seen_from = stop.rows.start.saturating_sub(span).max(rows.start);
            self.leave_out_motion(seen_from..(stop.rows.end + span).min(rows.end));
            for row in stop.rows.start..rows.end {
                self.angle_rad[row] += stop.lost_before(row) * self.count_rad;
            }
            self.counter_stops.push(stop);
        }
        self.counter_stops.sort_by_key(|stop| stop.rows.start);
    }

    fn leave_out_motion(&mut self, rows: Range<usize>) {
        let index = self.motion_index();
        let motion = &mut self.measured[index];
        for row in rows {
            let read = std::mem::replace(&mut motion.values[row], f64::NAN);
            if read.is_finite() {
                self.read_in_stops.push((row, read));
            }
        }
    }

    /// What rounding to whole counts makes of a speed at both ends of its window.
    fn noise_of_counting(&self) -> f64 {
        let of_stretch = |stretch: &Stretch| {
            (self.count_rad / 6_f64.sqrt() / stretch.window_s()).powi(2) * stretch.rows.len() as f64
        };
        (self.stretches.iter().map(of_stretch).sum::<f64>() / self.len().max(1) as f64).sqrt()
    }

    /// Recordings one by one. How a speed was made in some, it was made in all of them: too little may move in the others.
    fn each(recordings: &[Recording], rig: &Rig) -> Result<Vec<Self>, DatasetError> {
        let of = |recording| Self::of(recording, rig, None);
        let mut each = recordings.iter().map(of).collect::<Result<Vec<_>, _>>()?;
        let told = each.iter().find_map(Self::speed_reading);
        for (recording, one) in recordings.iter().zip(&mut each).filter(|_| told.is_some()) {
            if one.motion().output == Output::Speed {
                *one = Self::of(recording, rig, told)?;
            }
        }
        Ok(each)
    }

    fn speed_reading(&self) -> Option<SpeedReading> {
        let window_s = |stretch: &Stretch| SpeedReading::Mean { window_s: stretch.window_s() };
        match self.motion().output {
            Output::MeanSpeed => self.stretches.first().map(window_s),
            _ => self.edge_timing.as_ref().map(|timing| SpeedReading::Timed { step_rad: timing.step_rad }),
        }
    }

    /// `told`: by another recording.
    fn of(recording: &Recording, rig: &Rig, told: Option<SpeedReading>) -> Result<Self, DatasetError> {
        let name = || recording.name.clone();
        let no_time =
            || recording.advice_on_time().map_or_else(|| DatasetError::NoTime(name()), DatasetError::OtherTime);
        let time_s = recording.time_s().ok_or_else(no_time)?.to_vec();
        let interval_s = median(time_s.windows(2).map(|pair| pair[1] - pair[0]));
        if interval_s > LONGEST_INTERVAL_S {
            return Err(too_slow(name(), interval_s));
        }
        if time_s.len() < 4 * SHORTEST_STRETCH {
            return Err(DatasetError::TooShort(name(), time_s.len()));
        }
        let mut data = Self {
            interval_s,
            pwm_hz: rig.bridge.pwm_hz.unwrap_or(PWM_HZ),
            // Who knows where in its period the current is sampled has this project's firmware, or says so.
            pwm_is_known: rig.bridge.pwm_hz.is_some() || rig.recording.current_sampled_at.is_some(),
            timing: rig.recording,
            current_window_s: match rig.recording.readings {
                Readings::Instant => rig.recording.current_window_s.unwrap_or(0.0),
                // That is a window by itself.
                Readings::Mean => 0.0,
            },
            is_counted: rig.encoder.counts_per_rev.is_some(),
            empty: recording.empty.clone(),
            time_s: time_s.iter().map(|t_s| t_s - time_s[0]).collect(),
            ..Self::default()
        };
        data.read_drive(recording, rig, &time_s)?;
        let window = data.read_motion(recording, rig, &time_s, told)?;
        data.load_nm = recording.get(Channel::LoadTorque).map_or_else(|| vec![0.0; time_s.len()], held);
        let stretches = stretches(&time_s, interval_s, &data.voltage_v).into_iter();
        data.stretches = stretches.map(|rows| Stretch { rows, interval_s, window }).collect();
        if data.motion().output == Output::MeanSpeed {
            data.integrate_mean_speed();
        }
        data.leave_out(data.find_counter_stops());
        Ok(data)
    }

    fn read_drive(&mut self, recording: &Recording, rig: &Rig, time_s: &[f64]) -> Result<(), DatasetError> {
        let duty = recording.get(Channel::Duty);
        let voltage = recording.get(Channel::Voltage);
        let command = voltage.or(duty).ok_or_else(|| DatasetError::NoDrive(recording.name.clone()))?;
        self.open = open_bridge(command, time_s);
        let nominal_v = rig.supply.voltage_v;
        self.supply_v = match (recording.get(Channel::Supply), nominal_v, voltage) {
            (Some(measured), _, _) => held(measured),
            (None, Some(volts), _) => vec![volts; command.len()],
            // The greatest voltage is at most the supply; it only sets the scale of the duty.
            (None, None, Some(voltage)) => vec![greatest(voltage).max(1e-3); command.len()],
            (None, None, None) => return Err(DatasetError::NoSupply(recording.name.clone())),
        };
        let duty = match (duty, voltage) {
            (Some(duty), _) => held(duty),
            (None, _) => held(command).iter().zip(&self.supply_v).map(|(u, supply)| u / supply).collect(),
        };
        self.voltage_v = match voltage {
            Some(voltage) => held(voltage),
            None => duty.iter().zip(&self.supply_v).map(|(duty, supply)| duty * supply).collect(),
        };
        if voltage.is_none() && greatest(&duty) > GREATEST_DUTY {
            return Err(DatasetError::NoShare(recording.name.clone(), greatest(&duty)));
        }
        self.duty = duty;
        Ok(())
    }

    /// Returns the window of a speed that is a mean.
    fn read_motion(
        &mut self,
        recording: &Recording,
        rig: &Rig,
        time_s: &[f64],
        told: Option<SpeedReading>,
    ) -> Result<Window, DatasetError> {
        if let Some(current) = recording.get(Channel::Current) {
            self.add(Output::Current, current.to_vec());
        }
        let speed = recording
            .get(Channel::Speed)
            .map(<[f64]>::to_vec)
            .or_else(|| recording.get(Channel::Rpm).map(|rpm| rpm.iter().map(|rpm| rpm * TAU / 60.0).collect()));
        let counts = recording.get(Channel::Counts);
        let interval_s = self.interval_s;
        let too_fast = |channel: Channel| {
            move |Ambiguous { span }| {
                let column = channel.column();
                DatasetError::Aliased { name: recording.name.clone(), column, span, interval_s }
            }
        };
        let angle = match (recording.get(Channel::Angle), counts, rig.encoder.counts_per_rev) {
            (Some(angle), _, _) => Some(turns::angle_rad(angle).map_err(too_fast(Channel::Angle))?),
            (None, Some(counts), Some(per_rev)) => {
                let counts = turns::counts(counts, per_rev).map_err(too_fast(Channel::Counts))?;
                Some(counts.iter().map(|count| count * TAU / per_rev).collect())
            }
            (None, Some(_), None) if speed.is_none() => {
                return Err(DatasetError::NoCountsPerRev(recording.name.clone()));
            }
            _ => None,
        };
        self.is_counted |= angle.is_some() || counts.is_some();
        self.angle_rad = match (&angle, &speed) {
            (Some(angle), _) => held(angle),
            (None, Some(speed)) => integrated(speed, time_s),
            (None, None) => return Err(DatasetError::NoMotion(recording.name.clone())),
        };
        if let Some(angle) = &angle {
            self.count_rad = speed_window::count_rad(angle).unwrap_or(0.0);
        }
        Ok(match (speed, angle) {
            // Then the angle says more.
            (Some(speed), Some(angle)) if speed_window::is_made_of(&speed, &angle, self.interval_s) => {
                self.add_difference(&angle, time_s)
            }
            (Some(speed), _) => self.add_speed(speed, rig, time_s, told),
            (None, Some(angle)) => self.add_difference(&angle, time_s),
            (None, None) => unreachable!("one of them was there a line ago"),
        })
    }

    fn add_difference(&mut self, angle_rad: &[f64], time_s: &[f64]) -> Window {
        let window = Window::up_to_now((DIFFERENCE_SPAN_S / self.interval_s).round().max(1.0) as usize);
        self.add(Output::AngleDifference, difference(angle_rad, time_s, window));
        window
    }

    /// A speed, and over which window it was taken where it is a difference of counts.
    fn add_speed(&mut self, mut speed: Vec<f64>, rig: &Rig, time_s: &[f64], told: Option<SpeedReading>) -> Window {
        self.impossible = mistakes::take_out_impossible(&mut speed);
        let rows = |length_s: f64| (length_s / self.interval_s).round() as usize;
        let given = match (rig.recording.speed_window_s, told) {
            (Some(window_s), _) | (None, Some(SpeedReading::Mean { window_s })) => {
                Some(Found { span: rows(window_s), ahead: None })
            }
            (None, _) => None,
        };
        let found = || speed_window::of_counts(&speed, time_s, self.interval_s, rig.encoder.counts_per_rev?);
        let Some(Found { span, ahead }) = given.or_else(found).filter(|found| found.span > 0) else {
            match given {
                None => self.add_timed_speed(speed, time_s, rig, told),
                Some(_) => self.add_speed_of_the_moment(speed),
            }
            return Window::up_to_now(0);
        };
        let ahead = rig.recording.speed_ahead_s.map(rows).or(ahead);
        self.window_end_is_known = ahead.is_some();
        self.count_rad = rig.encoder.counts_per_rev.map_or(0.0, |per_rev| TAU / per_rev);
        self.add(Output::MeanSpeed, speed);
        Window { span, ahead: ahead.unwrap_or(0).min(span) }
    }

    /// A speed that is timed by edges, or one of the moment.
    fn add_timed_speed(&mut self, speed: Vec<f64>, time_s: &[f64], rig: &Rig, told: Option<SpeedReading>) {
        let timed = match told {
            // The firmware says what its readings are.
            _ if rig.recording.readings == Readings::Mean => None,
            Some(SpeedReading::Timed { step_rad }) => Some(Timed::new(&speed, time_s, step_rad)),
            _ => Timed::recognised(&speed, time_s, rig.encoder.counts_per_rev),
        };
        match timed {
            Some(timed) => {
                let timing = timed.timing();
                if self.count_rad <= 0.0 {
                    self.angle_rad = timed.angle_rad(timing.between());
                }
                self.edge_timing = Some(timing);
                self.add(Output::TimedSpeed, timed.readings());
                let index = self.motion_index();
                self.measured[index].of_counting = timed.noise();
            }
            None => self.add_speed_of_the_moment(speed),
        }
    }

    /// What polls an encoder at its fastest stands as well, and has a law; that is a speed of counts.
    fn add_speed_of_the_moment(&mut self, mut speed: Vec<f64>) {
        self.end_of_range = end_of_range::leave_out(&mut speed);
        self.add(Output::Speed, speed);
    }

    fn add(&mut self, output: Output, values: Vec<f64>) {
        self.measured.push(Measured { output, values, noise: 0.0, of_counting: 0.0, tolerance: 0.0 });
    }

    fn append(&mut self, other: Self) {
        let before = self.len();
        let moved = |rows: Range<usize>| rows.start + before..rows.end + before;
        self.stretches.extend(other.stretches.into_iter().map(|one| Stretch { rows: moved(one.rows), ..one }));
        self.time_s.extend(other.time_s);
        self.voltage_v.extend(other.voltage_v);
        self.duty.extend(other.duty);
        self.supply_v.extend(other.supply_v);
        self.open.extend(other.open);
        self.load_nm.extend(other.load_nm);
        self.angle_rad.extend(other.angle_rad);
        self.counter_stops.extend(other.counter_stops.into_iter().map(|stop| stop.later_by(before)));
        self.read_in_stops.extend(other.read_in_stops.into_iter().map(|(row, read)| (row + before, read)));
        self.impossible += other.impossible;
        self.end_of_range = match (self.end_of_range, other.end_of_range) {
            (Some(mine), Some(theirs)) => {
                Some(EndOfRange { value: mine.value.max(theirs.value), rows: mine.rows + theirs.rows })
            }
            (mine, theirs) => mine.or(theirs),
        };
        for (mine, theirs) in self.measured.iter_mut().zip(other.measured) {
            mine.values.extend(theirs.values);
            mine.of_counting = mine.of_counting.max(theirs.of_counting);
        }
        if let (Some(mine), Some(theirs)) = (&mut self.edge_timing, other.edge_timing) {
            mine.append(theirs);
        }
    }

    /// The same data with each of the other parts kept back in turn.
    pub fn with_others_kept_back(&self) -> impl Iterator<Item = Self> {
        (0..KEPT_BACK_EVERY).filter(|part| *part != KEPT_BACK).map(|part| {
            let mut other = self.clone();
            other.keep_back(part);
            other
        })
    }

    /// Whether it was driven in one way from beginning to end.
    pub fn is_steady(&self) -> bool {
        spread(&self.voltage_v) < 1e-3 * greatest(&self.voltage_v)
    }

    /// How long all stretches are together.
    fn span_s(&self) -> f64 {
        self.stretches.iter().map(|Stretch { rows, .. }| self.time_s[rows.end - 1] - self.time_s[rows.start]).sum()
    }

    fn keep_back(&mut self, part: usize) {
        let block = (BLOCK_S.min(self.span_s() / FEWEST_BLOCKS) / self.interval_s).max(1.0) as usize;
        self.kept_back = (0..self.len()).map(|index| (index / block) % KEPT_BACK_EVERY == part).collect();
    }

    fn check(&self, name: &str) -> Result<(), DatasetError> {
        let longest = self.stretches.iter().map(|stretch| stretch.rows.len()).max().unwrap_or(0);
        if longest < 4 * SHORTEST_STRETCH {
            return Err(DatasetError::TooShort(name.into(), longest));
        }
        let motion = self.motion();
        let moves = greatest(&motion.values) > 5.0 * motion.noise.max(1e-9);
        if greatest(&self.voltage_v) < 1e-6 || !moves {
            return Err(DatasetError::Quiet(name.into()));
        }
        Ok(())
    }

    /// What a motor that nothing else drives never does: give energy back all the time.
    fn check_signs(&self, name: &str, recorded: &[Channel]) -> Result<(), DatasetError> {
        // In a short piece it may just be turning round.
        if self.load_nm.iter().any(|load| *load != 0.0) || self.span_s() < SHORTEST_S {
            return Ok(());
        }
        let drive: Vec<f64> =
            self.voltage_v.iter().zip(&self.open).map(|(volts, open)| if *open { 0.0 } else { *volts }).collect();
        let against = |measured: &&Measured| correlation(&drive, &measured.values) < BACKWARD;
        let column = |measured: &Measured| {
            let made_of = match measured.output {
                Output::Current => [Channel::Current; 2],
                Output::AngleDifference => [Channel::Angle, Channel::Counts],
                Output::Speed | Output::MeanSpeed | Output::TimedSpeed => [Channel::Speed, Channel::Rpm],
            };
            made_of.into_iter().find(|channel| recorded.contains(channel)).unwrap_or(made_of[0]).column()
        };
        if mistakes::has_no_sign(&drive, &self.motion().values) {
            return Err(DatasetError::NoSign { name: name.into(), column: column(self.motion()) });
        }
        match self.measured.iter().find(against) {
            Some(measured) => Err(DatasetError::Backward { name: name.into(), column: column(measured) }),
            None => Ok(()),
        }
    }
}

/// Largest magnitude; missing values do not count.
pub fn greatest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most: f64, value| most.max(value.abs()))
}

/// Standard deviation of what is not missing.
pub fn spread(values: &[f64]) -> f64 {
    let finite = || values.iter().filter(|value| value.is_finite());
    let count = finite().count().max(1) as f64;
    let mean = finite().sum::<f64>() / count;
    (finite().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt()
}

/// Of what is not missing, about zero.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let sum = |of: fn(f64, f64) -> f64| -> f64 {
        a.iter().zip(b).map(|(a, b)| of(*a, *b)).filter(|product| product.is_finite()).sum()
    };
    sum(|a, b| a * b) / (sum(|a, _| a * a) * sum(|_, b| b * b)).sqrt().max(f64::MIN_POSITIVE)
}

/// Said of commands that changed between rows.
const BETWEEN_ROWS: &str = "The commands changed between rows, and the rows do not say when: the moments of these changes were found in the readings, in the data kept back as well, and the intervals do not know what they leave open. Write a row for each command; [recording] command_delay_s = 0 in the rig file takes them as they stand.";

/// Said of a speed that is no more than taken for that.
const OVER_ITS_ROW: &str = "The speed is taken for a mean since the row before, which explains it as well as a delay would: [recording] speed_window_s in the rig file says what it is (0: of the moment).";

fn without_a_number(channel: Channel) -> String {
    format!("{} has no number in any row, and is taken for not recorded.", channel.column())
}

fn too_slow(name: String, interval_s: f64) -> DatasetError {
    let (unit, factor) = match 1e-3 * interval_s > LONGEST_INTERVAL_S {
        true => ("microseconds", 1e-6),
        false => ("milliseconds", 1e-3),
    };
    DatasetError::TooSlow { name, interval_s, unit, factor }
}

/// Middle of what is not missing; 0 of nothing.
pub fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Rows that follow one another, put together.
pub fn runs(rows: impl Iterator<Item = usize>) -> Vec<Range<usize>> {
    let rows: Vec<usize> = rows.collect();
    rows.chunk_by(|row, next| row + 1 == *next).map(|run| run[0]..run[run.len() - 1] + 1).collect()
}

/// Median of the magnitude of a standard normal.
pub const NORMAL_MEDIAN: f64 = 0.6745;

/// Standard deviation of white noise on a smooth signal, from its third differences, which are nearly free of the signal.
/// Robust against steps (median), and against a coarse rounding that leaves most differences at zero (trimmed mean square).
pub fn noise(values: &[f64]) -> f64 {
    let mut third: Vec<f64> =
        values.windows(4).map(|w| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).abs()).filter(|v| v.is_finite()).collect();
    third.sort_unstable_by(f64::total_cmp);
    let middle = third.get(third.len() / 2).copied().unwrap_or(0.0);
    let kept = &third[..third.len() * 9 / 10];
    let square = kept.iter().map(|value| value * value).sum::<f64>() / kept.len().max(1) as f64;
    // 0.787: root mean square of a standard normal below its ninth decile;
    // 20: sum of the squares of 1, 3, 3, 1.
    let spread = (middle / NORMAL_MEDIAN).max(square.sqrt() / 0.787) / 20_f64.sqrt();
    spread.max(1e-4 * greatest(values)).max(f64::MIN_POSITIVE)
}

/// Missing values take the last one that was there.
fn held(values: &[f64]) -> Vec<f64> {
    let first = values.iter().copied().find(|value| value.is_finite()).unwrap_or(0.0);
    values
        .iter()
        .scan(first, |last, value| {
            if value.is_finite() {
                *last = *value;
            }
            Some(*last)
        })
        .collect()
}

/// Where the command is missing for longer than a lost sample.
fn open_bridge(command: &[f64], time_s: &[f64]) -> Vec<bool> {
    let mut open = vec![false; command.len()];
    let mut start = 0;
    while start < command.len() {
        let end = (start..command.len()).find(|index| !command[*index].is_nan()).unwrap_or(command.len());
        if end > start && time_s[end - 1] - time_s[start] >= OPEN_BRIDGE_S {
            open[start..end].fill(true);
        }
        start = end + 1;
    }
    open
}

fn integrated(speed: &[f64], time_s: &[f64]) -> Vec<f64> {
    let speed = held(speed);
    let mut angle_rad = vec![0.0];
    for index in 1..speed.len() {
        let mean = 0.5 * (speed[index] + speed[index - 1]);
        angle_rad.push(angle_rad[index - 1] + mean * (time_s[index] - time_s[index - 1]));
    }
    angle_rad
}

/// Mean speed over a window; missing where that is not whole.
pub fn difference(angle_rad: &[f64], time_s: &[f64], window: Window) -> Vec<f64> {
    let of = |index: usize| {
        let (first, last) = window.rows(index, angle_rad.len())?;
        Some((angle_rad[last] - angle_rad[first]) / (time_s[last] - time_s[first]))
    };
    (0..angle_rad.len()).map(|index| of(index).unwrap_or(f64::NAN)).collect()
}

fn stretches(time_s: &[f64], interval_s: f64, voltage_v: &[f64]) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut start = 0;
    let is_gap = |index: usize| {
        let pause_s = time_s[index] - time_s[index - 1];
        let is_held = pause_s < LONGEST_HELD_S && voltage_v[index] == voltage_v[index - 1];
        pause_s > GAP_INTERVALS * interval_s && !is_held
    };
    for index in 1..=time_s.len() {
        if index == time_s.len() || is_gap(index) {
            if index - start >= SHORTEST_STRETCH {
                found.push(start..index);
            }
            start = index;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::fmt::Write as _;

    const COUNTS_PER_REV: f64 = 400.0;

    /// Counts of a shaft that goes both ways, and the duty of each half second.
    fn counts(time_s: f64) -> f64 {
        ((300.0 * (1.0 - (2.0 * time_s).cos()) - 40.0 * time_s) * COUNTS_PER_REV / TAU).floor()
    }

    fn duty(time_s: f64) -> f64 {
        (7.0 * (2.0 * time_s).floor()).sin()
    }

    /// Rows of time, duty and what `reading` says.
    fn recording(time_s: &[f64], column: &str, reading: impl Fn(f64) -> String) -> Recording {
        let mut text = format!("t_s,duty,{column}\n");
        for time_s in time_s {
            let _ = writeln!(text, "{time_s:.4},{:.4},{}", duty(*time_s), reading(*time_s));
        }
        Recording::parse("run.csv", text.as_bytes(), &[]).unwrap()
    }

    fn dataset(recordings: &[Recording]) -> Dataset {
        let rig = format!("[supply]\nvoltage_V = 12\n[encoder]\ncounts_per_rev = {COUNTS_PER_REV}\n");
        Dataset::new(recordings, &Rig::parse("rig.toml", &rig).unwrap()).unwrap()
    }

    fn rows(interval_s: f64, length_s: f64) -> Vec<f64> {
        (0..(length_s / interval_s) as usize).map(|row| row as f64 * interval_s).collect()
    }

    /// Where it begins does not matter, nor where the sketch lets it wrap.
    #[test]
    fn an_angle_within_a_revolution_goes_on_beyond_it() {
        let time_s = rows(1e-3, 4.0);
        let angle_rad = |time_s: f64| counts(time_s) * TAU / COUNTS_PER_REV;
        let whole = dataset(&[recording(&time_s, "theta_rad", |t_s| format!("{:.5}", angle_rad(t_s)))]);
        for least_rad in [0.0, -0.5 * TAU, -1.0] {
            let wrapped = |t_s: f64| format!("{:.5}", least_rad + (angle_rad(t_s) - least_rad).rem_euclid(TAU));
            let wrapped = dataset(&[recording(&time_s, "theta_rad", wrapped)]);
            for (row, (angle, other)) in wrapped.angle_rad.iter().zip(&whole.angle_rad).enumerate() {
                let since = [angle - wrapped.angle_rad[0], other - whole.angle_rad[0]];
                assert!((since[0] - since[1]).abs() < 1e-4, "row {row}: {since:?}");
            }
        }
    }

    /// A count that is not there is none that stands still.
    #[test]
    fn missing_counts_are_missing() {
        let time_s = rows(1e-3, 4.0);
        let whole = dataset(&[recording(&time_s, "counts", |t_s| counts(t_s).to_string())]);
        let is_missing = |t_s: f64| (t_s * 1e3).round() as usize % 97 == 50;
        let some = |t_s: f64| if is_missing(t_s) { String::new() } else { (counts(t_s) as i64 as i16).to_string() };
        let some = dataset(&[recording(&time_s, "counts", some)]);
        let pairs = || some.motion().values.iter().zip(&whole.motion().values);
        assert!(pairs().all(|(some, whole)| some.is_nan() || (some - whole).abs() < 1e-9));
        assert_eq!(pairs().filter(|(some, whole)| some.is_nan() && whole.is_finite()).count(), 2 * 41);
    }

    proptest! {
        /// Over a pause the motor goes on as it was told, if it was told nothing else.
        #[test]
        fn a_pause_divides_where_the_command_may_have_changed(from_s in 0.6_f64..3.4, length_s in 0.02_f64..0.4) {
            let mut time_s = rows(1e-3, 4.0);
            time_s.retain(|t_s| !(from_s..from_s + length_s).contains(t_s));
            let data = dataset(&[recording(&time_s, "counts", |t_s| counts(t_s).to_string())]);
            let after = time_s.iter().position(|t_s| *t_s > from_s).unwrap();
            let is_held = duty(time_s[after - 1]) == duty(time_s[after]);
            prop_assert_eq!(data.stretches.len(), if is_held { 1 } else { 2 });
        }
    }

    /// A program that writes milliseconds into t_s, or microseconds; a table by hand.
    #[test]
    fn what_is_too_slow_to_show_a_motor_is_refused() {
        for (scale, expected) in [(1e3, "in milliseconds? Then"), (1e6, "--map t_s=t_s*0.000001")] {
            let time_s: Vec<f64> = rows(1e-3, 4.0).iter().map(|t_s| scale * t_s).collect();
            let slow = recording(&time_s, "counts", |t_s| counts(t_s / scale).to_string());
            let error = Dataset::new(&[slow], &Rig::default()).unwrap_err().to_string();
            assert!(error.contains(expected) && error.contains("100 Hz or more"), "{error}");
        }
    }

    /// An encoder beside it does not make it one of counts.
    #[test]
    fn a_speed_that_runs_against_its_end_does_so_beside_an_encoder() {
        let speed = |t_s: f64| (600.0 * (2.0 * t_s).sin() - 40.0).clamp(-300.0, 300.0);
        let data = dataset(&[recording(&rows(1e-3, 4.0), "omega_rad_per_s", |t_s| format!("{:.3}", speed(t_s)))]);
        assert_eq!(data.end_of_range.map(|end| end.value), Some(300.0));
    }

    #[test]
    fn a_current_of_nothing_is_none() {
        let mut text = String::from("t_s,duty,counts,i_A\n");
        for t_s in rows(1e-3, 4.0) {
            let _ = writeln!(text, "{t_s:.4},{:.4},{},nan", duty(t_s), counts(t_s));
        }
        let data = dataset(&[Recording::parse("run.csv", text.as_bytes(), &[]).unwrap()]);
        assert!(data.current().is_none());
        assert!(data.notes().iter().any(|note| note.starts_with("i_A has no number")), "{:?}", data.notes());
    }

    /// Each has speeds over as long as its own rows let it.
    #[test]
    fn recordings_of_one_rig_may_have_other_rates() {
        let at = |interval_s: f64| recording(&rows(interval_s, 4.0), "counts", |t_s| counts(t_s).to_string());
        let data = dataset(&[at(5e-3), at(1e-3), at(2.5e-3)]);
        let of = |stretch: &Stretch| (stretch.rows.len(), stretch.window.span);
        assert_eq!(data.stretches.iter().map(of).collect::<Vec<_>>(), [(800, 1), (4000, 5), (1600, 2)]);
        for Stretch { rows, .. } in &data.stretches {
            let greatest = greatest(&data.motion().values[rows.clone()]);
            assert!((greatest / 600.0 - 1.0).abs() < 0.1, "{greatest}");
        }
    }

    /// What does not hold as it stands, and how it is mended.
    fn refusal(text: &str) -> String {
        let rig = Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap();
        Dataset::new(&[Recording::parse("run.csv", text.as_bytes(), &[]).unwrap()], &rig).unwrap_err().to_string()
    }

    #[test]
    fn a_duty_in_percent_or_steps_is_told_so() {
        for scale in [100.0, 255.0] {
            let mut text = String::from("t_s,duty,omega_rad_per_s\n");
            for t_s in rows(1e-3, 4.0) {
                let _ = writeln!(text, "{t_s:.4},{:.1},{:.3}", scale * duty(t_s), 50.0 * duty(t_s - 0.1));
            }
            let error = refusal(&text);
            assert!(error.contains("duty*0.01") && error.contains("255 steps"), "{error}");
        }
    }

    #[test]
    fn what_runs_against_its_drive_has_the_wrong_sign() {
        for (column, motion, current) in [("omega_rad_per_s", -1.0, 1.0), ("i_A", 1.0, -1.0)] {
            let mut text = String::from("t_s,duty,omega_rad_per_s,i_A\n");
            for t_s in rows(1e-3, 4.0) {
                let speed = 50.0 * motion * duty(t_s - 0.05);
                let _ = writeln!(text, "{t_s:.4},{:.4},{speed:.3},{:.4}", duty(t_s), current * duty(t_s - 0.001));
            }
            let error = refusal(&text);
            assert!(error.contains(&format!("--map {column}={column}*-1`")), "{error}");
        }
    }
}
