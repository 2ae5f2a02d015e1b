//! How recordings were made, from the rig file or from the recordings themselves.

use super::{
    Contradiction, CounterStop, EdgeTiming, EndOfRange, HeldRotor, LateReadings, Output, PWM_HZ, contradictions,
};
use motorbench_data::recording::{Channel, Recording};
use motorbench_data::rig::{Readings, Rig, Timing};
use std::ops::Range;

/// What a speed that several rows share is a mean of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Averaged {
    /// Of the readings at the last rows, as a program averages them.
    Readings,
    /// Over the time between them.
    Time,
}

/// Where in a period of the PWM its pulse is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pulse {
    /// It begins with the period, as in fast PWM.
    #[default]
    AtBegin,
    /// In the middle, as in phase-correct PWM: `analogWrite` on the pins 3, 9, 10 and 11 of an Uno.
    InMiddle,
}

impl Pulse {
    /// Wherever a timer may put it.
    pub const ALL: [Self; 2] = [Self::AtBegin, Self::InMiddle];

    /// Share of a period that passes before the pulse of a duty.
    pub fn begins_at(self, duty: f64) -> f64 {
        match self {
            Self::AtBegin => 0.0,
            Self::InMiddle => 0.5 * (1.0 - duty.abs()).max(0.0),
        }
    }
}

/// When a timer takes a new duty.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Latch {
    /// With the next period, as timers with double-buffered registers do (ATmega328P data sheet, 15.7 and 16.9).
    #[default]
    WithPeriod,
    /// The same where the commands come at other times than the rows say: half a period later on average.
    OnAverage,
    /// At once.
    AtOnce,
}

/// A duty that went beyond the whole supply.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LimitedDuty {
    /// In how many rows.
    pub rows: usize,
    /// Greatest magnitude.
    pub greatest: f64,
}

/// Hum of the mains that was taken out of a sensor's readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hum {
    /// Of which quantity.
    pub of: Output,
    /// Its frequency.
    pub hz: f64,
    /// Its amplitude, in the unit of the quantity.
    pub amplitude: f64,
}

/// How recordings were made. For several recordings of one rig: what the rig file says of all, and what each adds.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// PWM frequency.
    pub pwm_hz: f64,
    /// Whether it is known; otherwise it is estimated.
    pub pwm_is_known: bool,
    /// Where the ripple of the current shows the frequency: the one that the rig file states, if any.
    pub ripple_shows: Option<Option<f64>>,
    /// Share of a PWM period that has passed at time 0, where the recording shows it.
    pub pwm_phase: Option<f64>,
    /// Where in that period the pulse is.
    pub pulse: Pulse,
    /// Time constant of a low-pass in front of the conversion that the ripple of the current shows; 0: none.
    pub current_filter_s: f64,
    /// When the timer takes the duty of a command.
    pub latch: Latch,
    /// How it was recorded.
    pub timing: Timing,
    /// An assumed drop of the bridge that the recordings do not show; every model is simulated behind it.
    pub hidden_drop_v: f64,
    /// Whether the current sensor has no sign.
    pub current_is_magnitude: bool,
    /// Averaging time of the current before each row; 0: an instantaneous value.
    pub current_window_s: f64,
    /// Whether each row was written after its command had acted; the commands here have been moved.
    pub written_after: bool,
    /// Share of a row by which smooth commands act before their rows, where a program sends more commands than it writes.
    pub smooth_earlier: Option<f64>,
    /// Whether an encoder counts the motion.
    pub is_counted: bool,
    /// Stops of the counter...
    pub counter_stops: Vec<CounterStop>,
    /// ... and the motion as read in the rows that are missing because of them.
    pub read_in_stops: Vec<(usize, f64)>,
    /// Hum of the mains that was in the readings.
    pub hums: Vec<Hum>,
    /// Number of rows left out because no shaft can have their speed.
    pub impossible: usize,
    /// Rows that do not follow their command and are left out.
    pub left_out: Vec<Range<usize>>,
    /// How the files were read, where that is not plain.
    pub reading: Vec<String>,
    /// Number of rows left out because their time is missing.
    pub without_time: usize,
    /// A duty beyond the whole supply, which was limited to it.
    pub limited_duty: Option<LimitedDuty>,
    /// The end of a speed sensor's range, if the motor exceeded it.
    pub end_of_range: Option<EndOfRange>,
    /// Share of all counts that is assumed to be lost; angles and speeds here include it.
    pub lost_share: f64,
    /// Values of the rig file that they contradict, each once.
    pub contradictions: Vec<Contradiction>,
    /// Columns in which there is no number.
    pub empty: Vec<Channel>,
    /// Recordings with the rotor held.
    pub held_rotor: Vec<HeldRotor>,
    /// Constant reading of a dead current sensor.
    pub dead_current_a: Option<f64>,
    /// Whether the rig file gives the position of a mean speed in its window.
    pub window_end_is_known: bool,
    /// Whether a speed is assumed to be a mean since the row before.
    pub taken_over_its_row: bool,
    /// The speed was found to be a mean over several rows.
    pub averaged: Option<Averaged>,
    /// Whether the angle was estimated from the ripple of the speed.
    pub angle_by_ripple: bool,
    /// The readings were found to come late by a time that changes; they have been moved.
    pub late_readings: Option<LateReadings>,
    /// How a speed was timed by edges.
    pub edge_timing: Option<EdgeTiming>,
}

impl Origin {
    /// From a rig file, before anything is found.
    pub(super) fn of(recording: &Recording, rig: &Rig) -> Self {
        Self {
            pwm_hz: rig.bridge.pwm_hz.unwrap_or(PWM_HZ),
            // A known sampling time of the current means this project's firmware, or a rig file that gives it.
            pwm_is_known: rig.bridge.pwm_hz.is_some() || rig.recording.current_sampled_at.is_some(),
            timing: rig.recording,
            current_window_s: match rig.recording.readings {
                Readings::Instant => rig.recording.current_window_s.unwrap_or(0.0),
                // That is a window by itself.
                Readings::Mean => 0.0,
            },
            is_counted: rig.encoder.counts_per_rev.is_some(),
            contradictions: contradictions(recording, rig),
            empty: recording.empty.clone(),
            reading: recording.notes.clone(),
            without_time: recording.without_time,
            ..Self::default()
        }
    }

    /// Where in its PWM period a current of this time is sampled, as far as that is known.
    pub fn current_sampled_at(&self, time_s: f64) -> Option<f64> {
        let at = |phase: f64| {
            let periods = phase + time_s * self.pwm_hz;
            periods - periods.floor()
        };
        self.timing.current_sampled_at.or(self.pwm_phase.map(at))
    }

    /// Puts the PWM ahead by so many periods, where its phase is known.
    pub fn move_pwm(&mut self, periods: f64) {
        self.pwm_phase = self.pwm_phase.map(|phase| (phase + periods).rem_euclid(1.0));
    }

    /// Whether each current is a mean over a time that neither the rig file nor a ripple tells.
    pub fn is_current_window_assumed(&self) -> bool {
        self.timing.current_window_s.is_none() && self.pwm_phase.is_none() && self.current_window_s > 0.0
    }

    /// The share of its period at which a PWM that is averaged takes a duty that comes at this time.
    pub fn takes_duty_at(&self, time_s: f64) -> f64 {
        match self.pwm_phase {
            Some(phase) if self.latch == Latch::AtOnce => (phase + time_s * self.pwm_hz).rem_euclid(1.0),
            _ => 0.0,
        }
    }

    /// Begin and end of the PWM period around a time.
    pub fn period_around_s(&self, time_s: f64) -> [f64; 2] {
        let phase = self.pwm_phase.unwrap_or(0.0);
        let begun = (phase + time_s * self.pwm_hz).floor();
        [begun, begun + 1.0].map(|periods| (periods - phase) / self.pwm_hz)
    }

    /// Adds another recording, which begins after this many rows.
    pub(super) fn append(&mut self, other: Self, before: usize) {
        self.counter_stops.extend(other.counter_stops.into_iter().map(|stop| stop.later_by(before)));
        self.read_in_stops.extend(other.read_in_stops.into_iter().map(|(row, read)| (row + before, read)));
        self.impossible += other.impossible;
        self.without_time += other.without_time;
        self.reading.extend(other.reading.into_iter().filter(|note| !self.reading.contains(note)).collect::<Vec<_>>());
        let is_new = |found: &Contradiction| self.contradictions.iter().all(|known| known.key != found.key);
        let new: Vec<Contradiction> = other.contradictions.into_iter().filter(is_new).collect();
        self.contradictions.extend(new);
        self.empty.extend(other.empty.into_iter().filter(|channel| !self.empty.contains(channel)).collect::<Vec<_>>());
        self.held_rotor.extend(other.held_rotor.into_iter().map(|held| held.later_by(before)));
        self.limited_duty = match (self.limited_duty, other.limited_duty) {
            (Some(mine), Some(theirs)) => {
                Some(LimitedDuty { rows: mine.rows + theirs.rows, greatest: mine.greatest.max(theirs.greatest) })
            }
            (mine, theirs) => mine.or(theirs),
        };
        self.current_is_magnitude |= other.current_is_magnitude;
        self.dead_current_a = self.dead_current_a.or(other.dead_current_a);
        self.end_of_range = match (self.end_of_range, other.end_of_range) {
            (Some(mine), Some(theirs)) => {
                Some(EndOfRange { value: mine.value.max(theirs.value), rows: mine.rows + theirs.rows })
            }
            (mine, theirs) => mine.or(theirs),
        };
        if let (Some(mine), Some(theirs)) = (&mut self.edge_timing, other.edge_timing) {
            mine.append(theirs);
        }
    }
}
