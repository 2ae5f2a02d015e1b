//! How recordings came to be, by the rig file or by what they show themselves.

use super::{Contradiction, CounterStop, EdgeTiming, EndOfRange, HeldRotor, PWM_HZ, contradictions};
use crate::recording::{Channel, Recording};
use crate::rig::{Readings, Rig, Timing};

/// See the module. Of several recordings of one rig: what the rig file says of all of them, and what each adds.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// PWM frequency.
    pub pwm_hz: f64,
    /// Whether that is known, and not to be found.
    pub pwm_is_known: bool,
    /// Share of a period of the PWM that has passed at time 0, where the current is read at the moment of its row.
    pub pwm_phase: Option<f64>,
    /// How it was recorded.
    pub timing: Timing,
    /// A drop of the bridge that they do not show; every model is simulated behind it.
    pub hidden_drop_v: f64,
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
    /// Rows left out for want of a time.
    pub without_time: usize,
    /// Where the range of a sensor of the speed ended before the motor's speed did.
    pub end_of_range: Option<EndOfRange>,
    /// Share of all counts that is taken for lost; angles and speeds are those with it.
    pub lost_share: f64,
    /// What of the rig file they contradict, each value once.
    pub contradictions: Vec<Contradiction>,
    /// Columns in which there is no number.
    pub empty: Vec<Channel>,
    /// Recordings with the rotor held.
    pub held_rotor: Vec<HeldRotor>,
    /// At what the reading of a current sensor that is dead stands.
    pub dead_current_a: Option<f64>,
    /// Whether the rig file says where in its window a mean speed stands.
    pub window_end_is_known: bool,
    /// Whether a speed is no more than taken for a mean since the row before.
    pub taken_over_its_row: bool,
    /// Whether the angle was found by the ripple of the speed.
    pub angle_by_ripple: bool,
    /// How a speed was timed by edges.
    pub edge_timing: Option<EdgeTiming>,
}

impl Origin {
    /// What a rig file says, and nothing found yet.
    pub(super) fn of(recording: &Recording, rig: &Rig) -> Self {
        Self {
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
            contradictions: contradictions(recording, rig),
            empty: recording.empty.clone(),
            without_time: recording.without_time,
            ..Self::default()
        }
    }

    /// Where in its period of the PWM a current of this time is read, as far as that is known.
    pub fn sampled_at(&self, time_s: f64, phase: Option<f64>) -> Option<f64> {
        let at = |phase: f64| (phase + time_s * self.pwm_hz).rem_euclid(1.0);
        self.timing.current_sampled_at.or(phase.or(self.pwm_phase).map(at))
    }

    /// With what another recording shows, which begins after so many rows.
    pub(super) fn append(&mut self, other: Self, before: usize) {
        self.counter_stops.extend(other.counter_stops.into_iter().map(|stop| stop.later_by(before)));
        self.read_in_stops.extend(other.read_in_stops.into_iter().map(|(row, read)| (row + before, read)));
        self.impossible += other.impossible;
        self.without_time += other.without_time;
        let is_new = |found: &Contradiction| self.contradictions.iter().all(|known| known.key != found.key);
        let new: Vec<Contradiction> = other.contradictions.into_iter().filter(is_new).collect();
        self.contradictions.extend(new);
        self.empty.extend(other.empty.into_iter().filter(|channel| !self.empty.contains(channel)).collect::<Vec<_>>());
        self.held_rotor.extend(other.held_rotor.into_iter().map(|held| held.later_by(before)));
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
