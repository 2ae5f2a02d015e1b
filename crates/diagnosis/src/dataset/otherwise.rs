//! The same recordings with another interpretation: another scale, or another choice of what the rig file leaves open.

use super::{Averaged, Dataset, Output, Stretch, Window, row_order};
use motorbench_data::rig::Readings;

impl Dataset {
    /// With each command in the row in which it was written; `None` if the rig file says when a command acts.
    pub fn with_commands_as_written(&self) -> Option<Self> {
        if self.origin.timing.command_delay_s.is_some() {
            return None;
        }
        let mut other = self.clone();
        if std::mem::take(&mut other.origin.written_after) {
            row_order::move_commands(&mut other, row_order::Towards::After);
        }
        Some(other)
    }

    /// With commands that changed in the middle before these rows.
    pub fn with_commands_between(&self, rows: &[usize]) -> Self {
        self.with_commands_earlier(rows, 0.5)
    }

    /// With smooth commands that changed before these rows, by a share of the time since the row before.
    pub fn with_smooth_commands_earlier(&self, rows: &[usize], share: f64) -> Self {
        let mut other = self.with_commands_earlier(rows, share);
        other.origin.smooth_earlier = Some(share);
        other
    }

    fn with_commands_earlier(&self, rows: &[usize], share: f64) -> Self {
        let mut other = self.clone();
        other.earlier_s = vec![0.0; self.len()];
        for row in rows.iter().copied() {
            other.earlier_s[row] = share * (self.time_s[row] - self.time_s[row - 1]);
        }
        other
    }

    /// With the counts as they would be without losses.
    pub fn with_counts_lost(&self, lost_share: f64) -> Self {
        let mut other = self.with_motion_times(1.0 / (1.0 - lost_share));
        other.origin.lost_share = lost_share;
        other
    }

    /// With every angle and speed multiplied.
    pub fn with_motion_times(&self, factor: f64) -> Self {
        let mut all = self.clone();
        all.count_rad *= factor;
        all.angle_rad.iter_mut().for_each(|angle| *angle *= factor);
        all.origin.edge_timing.iter_mut().for_each(|timing| timing.step_rad *= factor);
        all.origin.read_in_stops.iter_mut().for_each(|(_, read)| *read *= factor);
        all.measured[self.motion_index()].scale(factor);
        all
    }

    /// With every current multiplied.
    pub fn with_current_times(&self, factor: f64) -> Self {
        let mut all = self.clone();
        let currents = all.measured.iter_mut().filter(|measured| measured.output == Output::Current);
        currents.for_each(|current| current.scale(factor));
        all
    }

    /// Behind a bridge with a drop that the recordings do not show.
    pub fn behind_a_drop(&self, drop_v: f64) -> Self {
        let mut all = self.clone();
        all.origin.hidden_drop_v = drop_v;
        all
    }

    /// With every voltage multiplied.
    pub fn with_voltage_times(&self, factor: f64) -> Self {
        let mut all = self.clone();
        all.command.iter_mut().chain(&mut all.supply_v).for_each(|voltage| *voltage *= factor);
        all.origin.hidden_drop_v *= factor;
        all
    }

    /// With nothing held out, for the constants that are reported.
    pub fn with_nothing_held_out(&self) -> Self {
        let mut other = self.clone();
        other.held_out.fill(false);
        other
    }

    /// With the row in the middle of a mean speed's window instead of at its end, where neither the columns nor the rig
    /// file say which.
    pub fn with_window_centred(&self) -> Option<Self> {
        let is_centred = |stretch: &Stretch| stretch.window.ahead == stretch.window.span / 2;
        let is_known = self.origin.window_end_is_known || self.stretches.iter().all(is_centred);
        if self.motion().output != Output::MeanSpeed || is_known {
            return None;
        }
        let mut other = self.clone();
        for Stretch { window, .. } in &mut other.stretches {
            window.ahead = window.span / 2;
        }
        other.integrate_mean_speed();
        Some(other)
    }

    /// With the speed timed in the other way, or as a mean since the row before, where nothing says what it is.
    pub fn with_other_speed_reading(&self) -> Option<Self> {
        if self.is_speed_reading_told() {
            return None;
        }
        let mut other = self.clone();
        match (&mut other.origin.edge_timing, self.motion().output) {
            (timing @ Some(_), _) => *timing = Some(timing.take()?.since_row_before()?),
            (None, Output::Speed) => other.take_speed_as_mean_over(1),
            _ => return None,
        }
        Some(other)
    }

    /// With the speed as a mean over the last `rows` intervals, where nothing says what it is.
    pub fn with_speed_averaged(&self, rows: usize, averaged: Averaged) -> Option<Self> {
        let may_be = !self.is_speed_reading_told() && self.motion().output == Output::Speed;
        may_be.then(|| self.averaged_over(rows, averaged))
    }

    /// With a stated window of several rows as one of readings, where neither the columns nor the rig file say more of it.
    /// The window of ten readings reaches over nine intervals, and is often said to have ten.
    pub fn with_window_of_readings(&self) -> impl Iterator<Item = Self> {
        let may_be = self.origin.timing.speed_window_s.is_some()
            && self.motion().output == Output::MeanSpeed
            && !self.origin.window_end_is_known;
        let span = self.stretches.first().filter(|_| may_be).map_or(0, |stretch| stretch.window.span);
        (span.saturating_sub(1)..=span)
            .filter(|rows| *rows > 1)
            .map(|rows| self.averaged_over(rows, Averaged::Readings))
    }

    fn averaged_over(&self, rows: usize, averaged: Averaged) -> Self {
        let mut other = self.clone();
        other.take_speed_as_mean_over(rows);
        other.origin.averaged = Some(averaged);
        other
    }

    fn is_speed_reading_told(&self) -> bool {
        self.origin.timing.readings == Readings::Mean || self.origin.timing.speed_window_s.is_some()
    }

    fn take_speed_as_mean_over(&mut self, rows: usize) {
        let index = self.motion_index();
        self.measured[index].output = Output::MeanSpeed;
        self.stretches.iter_mut().for_each(|stretch| stretch.window = Window::up_to_now(rows));
        self.origin.window_end_is_known = true;
        self.origin.taken_over_its_row = rows == 1;
        // A recorded angle leaves no choice.
        if self.count_rad <= 0.0 {
            self.integrate_mean_speed();
        }
    }
}
