//! Converts recordings into a data set: the command, the motion, and the averaging window of each reading.

use super::columns::{correlation, greatest, held, integrated, median};
use super::counted_edges::Counted;
use super::edge_timing::Timed;
use super::speed_window::{self, Found, Window};
use super::turns::{self, Ambiguous};
use super::{
    DIFFERENCE_SPAN_S, Dataset, DatasetError, GREATEST_DUTY, LONGEST_INTERVAL_S, LONGEST_OF_ALL_S, LimitedDuty,
    Measured, Origin, Output, SHORTEST_S, SHORTEST_STRETCH, Stretch, difference, end_of_range, mistakes,
};
use crate::configuration::dataset::reading::{
    BACKWARD, GAP_INTERVALS, GREATEST_LIMITED_DUTY, LONGEST_HELD_S, OPEN_BRIDGE_S,
};
use motorbench_data::recording::{Channel, Recording};
use motorbench_data::rig::{Readings, Rig};
use motorbench_model::{Axis, Drive, Motion};
use std::f64::consts::TAU;
use std::ops::Range;

/// What one recording shows about how all speeds were made.
#[derive(Clone, Copy)]
enum SpeedReading {
    /// A difference of counts over this window.
    Mean { window_s: f64 },
    /// Timed by edges at this distance.
    Timed { step_rad: f64 },
}

impl Dataset {
    /// Reads the recordings one by one. The way in which a speed was made is the same in all: in some of them too
    /// little may move to show it.
    pub(super) fn each(recordings: &[Recording], rig: &Rig) -> Result<Vec<Self>, DatasetError> {
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
            _ => self.origin.edge_timing.as_ref().map(|timing| SpeedReading::Timed { step_rad: timing.step_rad }),
        }
    }

    /// `told`: by another recording.
    fn of(recording: &Recording, rig: &Rig, told: Option<SpeedReading>) -> Result<Self, DatasetError> {
        let name = || recording.name.clone();
        let no_time =
            || recording.advice_on_time().map_or_else(|| DatasetError::NoTime(name()), DatasetError::OtherTime);
        let time_s = recording.time_s().ok_or_else(no_time)?.to_vec();
        let interval_s = median(time_s.windows(2).map(|pair| pair[1] - pair[0]));
        if interval_s >= LONGEST_OF_ALL_S {
            return Err(DatasetError::too_slow(name(), interval_s));
        }
        if time_s.len() < 4 * SHORTEST_STRETCH {
            return Err(DatasetError::TooShort(name(), time_s.len()));
        }
        let mut data = Self {
            interval_s,
            axis: axis(recording, rig)?,
            origin: Origin::of(recording, rig),
            time_s: time_s.iter().map(|t_s| t_s - time_s[0]).collect(),
            ..Self::default()
        };
        data.read_drive(recording, rig, &time_s)?;
        let window = data.read_motion(recording, rig, &time_s, told)?;
        if interval_s > LONGEST_INTERVAL_S && !data.shows_steps() {
            return Err(DatasetError::too_slow(name(), interval_s));
        }
        let load = recording.get(Channel::LoadTorque).or_else(|| recording.get(Channel::LoadForce));
        data.load_nm = load.map_or_else(|| vec![0.0; time_s.len()], held);
        let window = data.thin(window);
        let interval_s = data.interval_s;
        let stretches = stretches(&data.time_s, interval_s, &data.command).into_iter();
        data.stretches = stretches.map(|rows| Stretch { rows, interval_s, window }).collect();
        if data.stretches.iter().all(|stretch| stretch.rows.len() <= window.span) {
            return Err(DatasetError::LongWindow(name(), window.span as f64 * interval_s));
        }
        if data.motion().output == Output::MeanSpeed {
            data.integrate_mean_speed();
        }
        data.leave_out(data.find_counter_stops());
        Ok(data)
    }

    fn read_drive(&mut self, recording: &Recording, rig: &Rig, time_s: &[f64]) -> Result<(), DatasetError> {
        if !self.axis.drive.is_voltage() {
            self.read_imposed(recording, rig, time_s);
            return Ok(());
        }
        let duty = recording.get(Channel::Duty);
        let voltage = recording.get(Channel::Voltage);
        let command = voltage.or(duty).ok_or_else(|| DatasetError::NoDrive(recording.name.clone()))?;
        self.open = open_bridge(command, time_s);
        let nominal_v = rig.supply.voltage_v;
        self.supply_v = match (recording.get(Channel::Supply), nominal_v, voltage) {
            (Some(measured), _, _) => held(measured),
            (None, Some(volts), _) => vec![volts; command.len()],
            // The greatest voltage is at most the supply; it only scales the duty.
            (None, None, Some(voltage)) => vec![greatest(voltage).max(1e-3); command.len()],
            (None, None, None) => return Err(DatasetError::NoSupply(recording.name.clone())),
        };
        let duty = match (duty, voltage) {
            (Some(duty), None) => self.limited(held(duty)),
            (Some(duty), Some(_)) => held(duty),
            (None, _) => held(command).iter().zip(&self.supply_v).map(|(u, supply)| u / supply).collect(),
        };
        self.command = match voltage {
            Some(voltage) => held(voltage),
            None => duty.iter().zip(&self.supply_v).map(|(duty, supply)| duty * supply).collect(),
        };
        if voltage.is_none() && greatest(&duty) > GREATEST_DUTY {
            return Err(DatasetError::NoShare(recording.name.clone(), greatest(&duty)));
        }
        self.duty = duty;
        Ok(())
    }

    /// A duty that goes a little beyond the whole supply: a timer takes what is more than its period for the period. No
    /// unit makes a share less than twice as large.
    fn limited(&mut self, mut duty: Vec<f64>) -> Vec<f64> {
        let beyond = duty.iter().filter(|duty| duty.abs() > GREATEST_DUTY).count();
        if beyond > 0 && greatest(&duty) < GREATEST_LIMITED_DUTY {
            self.origin.limited_duty = Some(LimitedDuty { rows: beyond, greatest: greatest(&duty) });
            duty.iter_mut().for_each(|duty| *duty = duty.clamp(-1.0, 1.0));
        }
        duty
    }

    /// A current, torque or force that a drive imposes.
    fn read_imposed(&mut self, recording: &Recording, rig: &Rig, time_s: &[f64]) {
        let imposed = imposed_channel(self.axis.drive, recording).and_then(|channel| recording.get(channel));
        let imposed = imposed.expect("it decided on the drive");
        self.open = open_bridge(imposed, time_s);
        self.command = held(imposed);
        if self.axis.drive == Drive::Current {
            self.command = match rig.recording.readings {
                Readings::Instant => means_until_next(&self.command),
                Readings::Mean => {
                    (0..imposed.len()).map(|row| self.command[(row + 1).min(imposed.len() - 1)]).collect()
                }
            };
        }
        let most = greatest(&self.command).max(f64::MIN_POSITIVE);
        self.supply_v = vec![most; imposed.len()];
        self.duty = self.command.iter().map(|command| command / most).collect();
    }

    /// Returns the window of a speed that is a mean.
    fn read_motion(
        &mut self,
        recording: &Recording,
        rig: &Rig,
        time_s: &[f64],
        told: Option<SpeedReading>,
    ) -> Result<Window, DatasetError> {
        if let Some(current) = recording.get(Channel::Current).filter(|_| self.axis.drive.is_voltage()) {
            self.add(Output::Current, current.to_vec());
        }
        let speed = recording
            .get(Channel::Speed)
            .or_else(|| recording.get(Channel::Velocity))
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
            // A position has no turn after which it could begin again.
            (None, _, _) if recording.get(Channel::Position).is_some() => {
                recording.get(Channel::Position).map(<[f64]>::to_vec)
            }
            (Some(angle), _, _) => Some(turns::angle_rad(time_s, angle).map_err(too_fast(Channel::Angle))?),
            (None, Some(counts), Some(per_rev)) => {
                let counts = turns::counts(time_s, counts, per_rev).map_err(too_fast(Channel::Counts))?;
                Some(counts.iter().map(|count| count * TAU / per_rev).collect())
            }
            (None, Some(_), None) if speed.is_none() => {
                return Err(DatasetError::NoCountsPerRev(recording.name.clone()));
            }
            _ => None,
        };
        self.origin.is_counted |= angle.is_some() || counts.is_some();
        self.angle_rad = match (&angle, &speed) {
            (Some(angle), _) => held(angle),
            (None, Some(speed)) => integrated(speed, time_s),
            (None, None) => return Err(DatasetError::NoMotion(recording.name.clone())),
        };
        if let Some(angle) = &angle {
            self.count_rad = speed_window::count_rad(angle).unwrap_or(0.0);
        }
        Ok(match (speed, angle) {
            // Then the angle contains more.
            (Some(speed), Some(angle)) if speed_window::is_made_of(&speed, &angle, self.interval_s) => {
                self.add_difference(&angle, time_s)
            }
            (Some(speed), angle) => self.add_speed(speed, angle.as_deref(), rig, time_s, told),
            (None, Some(angle)) => self.add_difference(&angle, time_s),
            (None, None) => unreachable!("one of them was there a line ago"),
        })
    }

    fn add_difference(&mut self, angle_rad: &[f64], time_s: &[f64]) -> Window {
        let window = Window::up_to_now((DIFFERENCE_SPAN_S / self.interval_s).round().max(1.0) as usize);
        self.add(Output::AngleDifference, difference(angle_rad, time_s, window));
        window
    }

    /// Adds a speed, with the window over which it was taken if it is a difference of counts.
    fn add_speed(
        &mut self,
        mut speed: Vec<f64>,
        angle: Option<&[f64]>,
        rig: &Rig,
        time_s: &[f64],
        told: Option<SpeedReading>,
    ) -> Window {
        self.origin.impossible = mistakes::take_out_impossible(&mut speed);
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
                None if self.add_counted_speed(&speed, angle, rig, time_s, told) => {}
                None => self.add_timed_speed(speed, time_s, rig, told),
                Some(_) => self.add_speed_of_the_moment(speed),
            }
            return Window::up_to_now(0);
        };
        let ahead = rig.recording.speed_ahead_s.map(rows).or(ahead);
        self.origin.window_end_is_known = ahead.is_some();
        self.count_rad = rig.encoder.counts_per_rev.map_or(0.0, |per_rev| TAU / per_rev);
        self.add(Output::MeanSpeed, speed);
        Window { span, ahead: ahead.unwrap_or(0).min(span) }
    }

    /// Adds a speed of this project's firmware, if the counts beside it connect edge to edge. Returns whether it did.
    fn add_counted_speed(
        &mut self,
        speed: &[f64],
        angle_rad: Option<&[f64]>,
        rig: &Rig,
        time_s: &[f64],
        told: Option<SpeedReading>,
    ) -> bool {
        let is_of_counts = self.origin.timing.readings == Readings::Mean && rig.tachogenerator.feedback != Some(true);
        let Some(angle_rad) = angle_rad.filter(|_| is_of_counts) else { return false };
        let counted = Counted::new(angle_rad, speed, time_s, self.count_rad, self.interval_s);
        let Some(readings) = counted.readings(matches!(told, Some(SpeedReading::Timed { .. }))) else { return false };
        self.origin.edge_timing = Some(readings.timing);
        self.add(Output::TimedSpeed, readings.speed);
        let index = self.motion_index();
        self.measured[index].of_counting = readings.noise;
        true
    }

    /// Adds a speed that is timed by edges, or an instantaneous one.
    fn add_timed_speed(&mut self, speed: Vec<f64>, time_s: &[f64], rig: &Rig, told: Option<SpeedReading>) {
        let timed = match told {
            // The firmware documents its readings.
            _ if rig.recording.readings == Readings::Mean => None,
            Some(SpeedReading::Timed { step_rad }) => Some(Timed::new(&speed, time_s, step_rad)),
            _ => Timed::recognised(&speed, time_s, rig.encoder.counts_per_rev),
        };
        match timed {
            Some(timed) => {
                let timing = timed.timing();
                if self.count_rad <= 0.0 {
                    self.angle_rad = timed.angle_rad(&timing.between);
                }
                self.origin.edge_timing = Some(timing);
                self.add(Output::TimedSpeed, timed.readings());
                let index = self.motion_index();
                self.measured[index].of_counting = timed.noise();
            }
            None => self.add_speed_of_the_moment(speed),
        }
    }

    /// A sensor that is polled too slowly saturates as well, but regularly: that is a speed of counts.
    fn add_speed_of_the_moment(&mut self, mut speed: Vec<f64>) {
        self.origin.end_of_range = end_of_range::leave_out(&mut speed);
        self.add(Output::Speed, speed);
    }

    pub(super) fn add(&mut self, output: Output, values: Vec<f64>) {
        self.measured.push(Measured {
            output,
            values,
            noise: 0.0,
            of_counting: 0.0,
            unrest_of_counting: 0.0,
            correlated_rows: 1,
            tolerance: 0.0,
        });
    }

    pub(super) fn check(&self, name: &str) -> Result<(), DatasetError> {
        let longest = self.stretches.iter().map(|stretch| stretch.rows.len()).max().unwrap_or(0);
        if longest < 4 * SHORTEST_STRETCH {
            return Err(DatasetError::TooShort(name.into(), longest));
        }
        let motion = self.motion();
        let moves = greatest(&motion.values) > 5.0 * motion.noise.max(1e-9);
        if greatest(&self.command) < 1e-6 || !moves {
            return Err(DatasetError::Quiet(name.into()));
        }
        Ok(())
    }

    /// What a motor without an external drive never does: return energy all the time.
    pub(super) fn check_signs(&mut self, name: &str, recorded: &[Channel]) -> Result<(), DatasetError> {
        // In a short piece it may just be reversing.
        if self.load_nm.iter().any(|load| *load != 0.0) || self.span_s() < SHORTEST_S {
            return Ok(());
        }
        let drive: Vec<f64> =
            self.command.iter().zip(&self.open).map(|(volts, open)| if *open { 0.0 } else { *volts }).collect();
        let is_magnitude = |current: &Measured| mistakes::is_a_magnitude(&drive, &current.values);
        self.origin.current_is_magnitude = self.axis.drive.is_voltage() && self.current().is_some_and(is_magnitude);
        let against = |measured: &&Measured| correlation(&drive, &measured.values) < BACKWARD;
        let column = |measured: &Measured| {
            let made_of = match measured.output {
                Output::Current => [Channel::Current; 3],
                Output::AngleDifference => [Channel::Angle, Channel::Counts, Channel::Position],
                Output::Speed | Output::MeanSpeed | Output::TimedSpeed => {
                    [Channel::Speed, Channel::Rpm, Channel::Velocity]
                }
            };
            made_of.into_iter().find(|channel| recorded.contains(channel)).unwrap_or(made_of[0]).column()
        };
        if mistakes::has_no_sign(&drive, &self.motion().values) {
            return Err(DatasetError::NoSign {
                name: name.into(),
                column: column(self.motion()),
                drive: self.axis.drive_words(),
            });
        }
        match self.measured.iter().find(against) {
            Some(measured) => Err(DatasetError::Backward {
                name: name.into(),
                column: column(measured),
                drive: self.axis.drive_words(),
            }),
            None => Ok(()),
        }
    }
}

/// What a recording says that was imposed, and how its axis moves.
fn axis(recording: &Recording, rig: &Rig) -> Result<Axis, DatasetError> {
    let name = || recording.name.clone();
    let moves = |motion: Motion| recording.channels().find(|channel| channel.motion() == Some(motion));
    let motion = match (moves(Motion::Rotary), moves(Motion::Linear), rig.axis.stated()) {
        (Some(rotary), Some(linear), _) => {
            return Err(DatasetError::TwoMotions(name(), rotary.column(), linear.column()));
        }
        (Some(channel), None, Some(Motion::Linear)) => {
            return Err(DatasetError::OtherMotion(name(), channel.column(), "linear"));
        }
        (None, Some(channel), Some(Motion::Rotary)) => {
            return Err(DatasetError::OtherMotion(name(), channel.column(), "rotary"));
        }
        (_, Some(_), _) => Motion::Linear,
        (_, None, stated) => stated.unwrap_or_default(),
    };
    let voltage = [Channel::Voltage, Channel::Duty].into_iter().find(|channel| recording.get(*channel).is_some());
    let torque = imposed_channel(Drive::Torque, recording);
    let drive = match (voltage, torque, recording.get(Channel::Current)) {
        (Some(voltage), Some(torque), _) => {
            return Err(DatasetError::TwoDrives(name(), voltage.column(), torque.column()));
        }
        (Some(_), None, _) | (None, None, None) => Drive::Voltage,
        (None, Some(_), _) => Drive::Torque,
        (None, None, Some(_)) => Drive::Current,
    };
    Ok(Axis { drive, motion })
}

/// Means from each value to the next one, by the cubic through the two and their neighbours. A straight line loses a tenth of
/// a current that balances cogging in six rows a period.
fn means_until_next(values: &[f64]) -> Vec<f64> {
    let last = values.len() - 1;
    let at = |row: usize| values[row.min(last)];
    let mean = |row: usize| (13.0 * (at(row) + at(row + 1)) - at(row.saturating_sub(1)) - at(row + 2)) / 24.0;
    (0..values.len()).map(mean).collect()
}

/// The column of what a drive imposes.
fn imposed_channel(drive: Drive, recording: &Recording) -> Option<Channel> {
    let of: &[Channel] = match drive {
        Drive::Voltage => &[Channel::Voltage, Channel::Duty],
        Drive::Current => &[Channel::Current],
        Drive::Torque => &[Channel::Torque, Channel::Force],
    };
    of.iter().copied().find(|channel| recording.get(*channel).is_some())
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

fn stretches(time_s: &[f64], interval_s: f64, command: &[f64]) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut start = 0;
    let is_gap = |index: usize| {
        let pause_s = time_s[index] - time_s[index - 1];
        let is_held = pause_s < LONGEST_HELD_S && command[index] == command[index - 1];
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

    #[test]
    fn a_wave_keeps_its_mean_between_rows() {
        for rows_per_period in [6.0, 20.0] {
            let rate = TAU / rows_per_period;
            let values: Vec<f64> = (0..60).map(|row| (rate * f64::from(row)).sin()).collect();
            let exact = |row: f64| ((rate * row).cos() - (rate * (row + 1.0)).cos()) / rate;
            let means = means_until_next(&values);
            let off = (2..57).map(|row| (means[row] - exact(row as f64)).abs()).fold(0.0, f64::max);
            assert!(off < 0.025, "{rows_per_period} rows a period: {off}");
        }
        assert_eq!(means_until_next(&[2.0; 5]), [2.0; 5]);
    }
}
