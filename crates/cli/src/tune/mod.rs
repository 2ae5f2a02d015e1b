//! The tuning console: live tuning of a board's speed loop in a terminal.
//!
//! [`Session`] has the board, the traces and the changes, and does not depend on a terminal. [`screen`] draws it.

mod account;
mod key;
pub mod screen;

pub use account::{Account, RecordingStore, StepTest, StoredRecording};
pub use key::Key;

use account::Recorded;
use host_sim::figures::step_figures;
use host_sim::trial::Point;
use motorbench_core::HARDWARE;
use motorbench_core::message::{Mode, Sample, State, Trip};
use motorbench_core::settings::{Param, Settings};
use motorbench_core::units::{AMPERE, FULL_RANGE, VOLT};
use motorbench_data::names::{setting_name, trip_words};
use motorbench_data::telemetry::speed_bit_rad_per_s;
use motorbench_link::board::{Board, BoardError, cause, leave_host, watch_host};
use motorbench_link::live::Live;
use motorbench_link::record::{Ended, Record, missing_ticks};
use motorbench_link::{Line, Link, Losses};
use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Length of the shown traces.
pub const SHOWN_S: f64 = 5.0;
/// Duration of a step test.
const STEP_S: f64 = 1.0;
/// A motor is at rest if its counts stay the same for so long and its speed is below this share of its range. The time
/// is well within the 200 ms of `trip_encoder`.
const AT_REST_S: f64 = 0.1;
const AT_REST_SHARE: f64 = 0.01;
/// A scripted session ends with an error if no samples come for so long.
const SILENT: Duration = Duration::from_secs(5);
/// A key changes a value by this factor. A value of zero first becomes this share of its range.
const FACTOR: f32 = 1.1;
const FIRST: f32 = 1e-5;

/// A loop that can be tuned: its mode on the console, and its gains.
#[derive(Clone, Copy, Debug)]
pub struct TunedLoop {
    /// The console's name.
    pub mode: &'static str,
    /// Its gains.
    pub gains: &'static [Param],
}

/// The two speed loops, side by side.
pub const LOOPS: [TunedLoop; 2] = [
    TunedLoop {
        mode: "speed",
        gains: &[Param::SpeedKp, Param::SpeedKi, Param::SpeedKd, Param::SpeedB, Param::SpeedTf],
    },
    TunedLoop {
        mode: "lqr_speed",
        gains: &[Param::LqrSpeedKw, Param::LqrSpeedKc, Param::LqrSpeedKi, Param::LqrSpeedKr],
    },
];

/// Both loops have a speed reference, also in a recording that begins before one of them drives.
pub const REFERENCE: Mode = Mode::SpeedPid;

/// A change that can be undone.
struct Change {
    param: Param,
    before: f32,
}

/// The state after a step test. At rest the loop must be off: its integral would push against the friction, and a
/// driven motor that does not turn trips.
#[derive(Clone, Copy, PartialEq, Eq)]
enum ReturnToRest {
    /// No step test: the loop follows its reference.
    Not,
    /// The motor is slowing down to rest.
    Begun,
    /// The motor is at rest, and the loop is off until it is needed.
    Over,
}

/// A value as a person would note it.
fn four_digits(value: f32) -> f32 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// Gains by their names on the console.
fn by_name(gains: &[Param], settings: &Settings) -> BTreeMap<String, f32> {
    gains.iter().map(|param| (setting_name(*param), settings.get(*param))).collect()
}

/// The gains of both loops.
fn all_gains(settings: &Settings) -> BTreeMap<String, f32> {
    LOOPS.iter().flat_map(|tuned| by_name(tuned.gains, settings)).collect()
}

/// The board, and the state of the session.
pub struct Session<L: Line> {
    link: Link<L>,
    settings: Settings,
    live: Option<Live>,
    keeper: Box<dyn RecordingStore>,
    recording: Option<Recorded>,
    /// Reasons for missing or incomplete recordings.
    not_kept: Vec<String>,
    loop_index: usize,
    selected: usize,
    armed: bool,
    reference: f64,
    /// Present reference of the board's loop, if it is known.
    told: Option<f64>,
    traces: VecDeque<Sample>,
    changes: Vec<Change>,
    step: Option<Vec<Sample>>,
    way_back: ReturnToRest,
    step_tests: Vec<StepTest>,
    /// Gains of the board at the start, and gains that were saved last.
    gains_before: BTreeMap<String, f32>,
    saved: Option<BTreeMap<String, f32>>,
    recordings: Vec<PathBuf>,
    /// Why the drive switched itself off.
    trip: Option<Trip>,
    message: String,
}

impl<L: Line> Session<L> {
    /// Starts a session with the settings of the board. `reference` in rad/s. `live` gets every sample, `keeper` the
    /// recordings.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn new(
        mut link: Link<L>,
        reference: f64,
        live: Option<Live>,
        keeper: Box<dyn RecordingStore>,
    ) -> Result<Self, BoardError> {
        link.command("disarm")?;
        let settings = link.settings()?;
        watch_host(&mut link, &settings)?;
        Ok(Self {
            link,
            settings,
            live,
            keeper,
            recording: None,
            not_kept: Vec::new(),
            loop_index: 0,
            selected: 0,
            armed: false,
            reference,
            told: None,
            traces: VecDeque::new(),
            changes: Vec::new(),
            step: None,
            way_back: ReturnToRest::Not,
            step_tests: Vec::new(),
            gains_before: all_gains(&settings),
            saved: None,
            recordings: Vec::new(),
            trip: None,
            message: "a arms, s tests a step, q quits".into(),
        })
    }

    fn ticks(&self, time_s: f64) -> u32 {
        (time_s * f64::from(self.settings.get(Param::TickRate))) as u32
    }

    /// The loop that is tuned.
    pub fn tuned(&self) -> TunedLoop {
        LOOPS[self.loop_index]
    }

    /// Fetches the telemetry and sends keep-alive lines.
    ///
    /// # Errors
    /// [`BoardError`], if the board is gone.
    pub fn poll(&mut self) -> Result<(), BoardError> {
        self.link.stay_alive()?;
        let came = self.link.samples(0.02)?;
        if let Some(trip) = came.iter().map(|sample| sample.trip).find(|trip| *trip != Trip::None)
            && self.armed
        {
            self.armed = false;
            self.step = None;
            self.trip = Some(trip);
            self.message =
                format!("the drive tripped ({}): {}; then a clears it and arms", trip_words(trip), cause(trip));
        }
        if let Some(step) = &mut self.step {
            step.extend(came.iter().copied());
        }
        if let Some(Err(error)) = self.live.as_ref().map(|live| live.send_samples(&came, &self.settings)) {
            self.live = None;
            self.message = format!("sending to the plotter has stopped: {error}");
        }
        self.keep(&came);
        self.traces.extend(came);
        let kept = self.ticks(SHOWN_S) as usize;
        self.traces.drain(..self.traces.len().saturating_sub(kept));
        if self.step.as_ref().is_some_and(|step| !self.course(step).1.is_empty()) {
            self.finish_step()?;
        }
        if self.armed && self.way_back == ReturnToRest::Begun && self.is_at_rest() {
            self.way_back = ReturnToRest::Over;
            self.link.command("stop")?;
        }
        Ok(())
    }

    /// Whether the motor has been at rest.
    fn is_at_rest(&self) -> bool {
        let ticks = self.ticks(AT_REST_S) as usize;
        let Some(last) = self.traces.back().filter(|_| self.traces.len() > ticks) else { return false };
        f64::from(last.speed).abs() < AT_REST_SHARE * f64::from(FULL_RANGE)
            && self.traces.iter().rev().take(ticks).all(|sample| sample.counts == last.counts)
    }

    /// Carries out a key. If the board refuses, its reply becomes the message.
    ///
    /// # Errors
    /// [`BoardError`], if the board is gone.
    pub fn press(&mut self, key: Key) -> Result<(), BoardError> {
        match self.obey(key) {
            Err(BoardError::Refused { reply, .. }) => {
                self.message = reply;
                Ok(())
            }
            // The cause of the trip is still present.
            Err(BoardError::Tripped(trip) | BoardError::TrippedBefore(trip)) => {
                self.message = format!("no drive ({}): {}; then a clears it and arms", trip_words(trip), cause(trip));
                Ok(())
            }
            other => other,
        }
    }

    fn obey(&mut self, key: Key) -> Result<(), BoardError> {
        match key {
            Key::Up => self.select(-1),
            Key::Down => self.select(1),
            Key::Less => self.scale(1.0 / FACTOR),
            Key::More => self.scale(FACTOR),
            Key::Lower => self.refer(self.reference - 5.0),
            Key::Higher => self.refer(self.reference + 5.0),
            Key::Arm => self.arm(),
            Key::Stop => self.stop(),
            Key::Step => self.begin_step(),
            Key::Switch => self.switch(),
            Key::Undo => self.undo(),
            Key::Save => self.save(),
            Key::Record => self.record(),
        }
    }

    /// Presses one key after another, each after the last one has finished: a step test includes the way back to rest.
    /// Ends at the first key without effect. `stop` is polled; `says` gets the result of each key.
    pub fn play(&mut self, keys: &[Key], stop: &dyn Fn() -> bool, says: &dyn Fn(Key, &str)) -> Ended {
        for key in keys {
            match self.play_key(*key, stop) {
                Ok(()) => says(*key, &self.message),
                Err(ended) => return ended,
            }
        }
        Ended::Complete
    }

    fn play_key(&mut self, key: Key, stop: &dyn Fn() -> bool) -> Result<(), Ended> {
        let tests = self.step_tests.len();
        self.obey(key)?;
        if key == Key::Step {
            self.wait(stop, |session| session.step.is_none())?;
            if self.step_tests.len() == tests {
                return Err(Ended::Refused(self.message.clone()));
            }
            let rest = self.tick() + self.ticks(STEP_S);
            self.wait(stop, |session| session.tick() >= rest)?;
        }
        // Takes new samples and keeps the board alive.
        self.wait(stop, |_| true)
    }

    /// Takes samples until a condition holds.
    fn wait(&mut self, stop: &dyn Fn() -> bool, is: impl Fn(&Self) -> bool) -> Result<(), Ended> {
        let (mut came, mut last) = (Instant::now(), self.tick());
        loop {
            self.poll()?;
            match self.trip {
                Some(trip) => return Err(Ended::Tripped(trip)),
                None if stop() => return Err(Ended::Interrupted),
                None if !self.not_kept.is_empty() => return Err(Ended::Failed(self.not_kept.join("; "))),
                None if is(self) => return Ok(()),
                None => {}
            }
            if self.tick() != last {
                (came, last) = (Instant::now(), self.tick());
            } else if came.elapsed() > SILENT {
                return Err(BoardError::Silent { line: "stream binary".into() }.into());
            }
        }
    }

    /// Reference of the last sample.
    fn tick(&self) -> u32 {
        self.traces.back().map_or(0, |sample| sample.tick)
    }

    /// The account of the session. An incomplete recording makes it a failure, whatever else ended it.
    pub fn account(&self, ended: Ended) -> Account {
        let gains_after = all_gains(&self.settings);
        let ended = match ended {
            Ended::Complete if !self.not_kept.is_empty() => Ended::Failed(self.not_kept.join("; ")),
            ended => ended,
        };
        Account {
            firmware: self.link.firmware.clone(),
            gains_before: self.gains_before.clone(),
            saved: self.saved.as_ref() == Some(&gains_after),
            gains_after,
            step_tests: self.step_tests.clone(),
            // On some systems file names are arbitrary bytes, but JSON is text.
            recordings: self.recordings.iter().map(|file| file.to_string_lossy().into_owned()).collect(),
            ended,
        }
    }

    fn select(&mut self, by: isize) -> Result<(), BoardError> {
        let count = self.tuned().gains.len() as isize;
        self.selected = (self.selected as isize + by).rem_euclid(count) as usize;
        let param = self.tuned().gains[self.selected];
        self.message = format!("{} {}", setting_name(param), self.settings.get(param));
        Ok(())
    }

    fn scale(&mut self, factor: f32) -> Result<(), BoardError> {
        let param = self.tuned().gains[self.selected];
        let before = self.settings.get(param);
        let value = four_digits(if before == 0.0 { FIRST * param.range().1 } else { before * factor });
        self.set(param, value)?;
        self.changes.push(Change { param, before });
        Ok(())
    }

    fn set(&mut self, param: Param, value: f32) -> Result<(), BoardError> {
        self.link.command(&format!("set {} {value}", setting_name(param)))?;
        self.settings.values[param as usize] = value;
        self.message = format!("{} {value}", setting_name(param));
        Ok(())
    }

    fn undo(&mut self) -> Result<(), BoardError> {
        let Some(Change { param, before }) = self.changes.pop() else {
            self.message = "nothing to undo".into();
            return Ok(());
        };
        self.set(param, before)
    }

    fn refer(&mut self, reference: f64) -> Result<(), BoardError> {
        self.reference = reference;
        self.message = format!("reference {reference} rad/s");
        if self.armed {
            self.close_loop()?;
            self.tell(reference)?;
        }
        Ok(())
    }

    fn tell(&mut self, reference: f64) -> Result<(), BoardError> {
        self.link.command(&format!("ref {reference}"))?;
        self.told = Some(reference);
        Ok(())
    }

    fn arm(&mut self) -> Result<(), BoardError> {
        self.link.command("clear")?;
        // All samples that come meanwhile go to traces and recording.
        self.poll()?;
        if let Some(Sample { trip, .. }) = self.traces.back().filter(|sample| sample.trip != Trip::None) {
            return Err(BoardError::Tripped(*trip));
        }
        self.link.command("arm")?;
        self.enter_mode()?;
        self.armed = true;
        self.trip = None;
        self.message = "armed; space stops".into();
        Ok(())
    }

    fn enter_mode(&mut self) -> Result<(), BoardError> {
        self.way_back = ReturnToRest::Not;
        self.told = None;
        self.link.command(&format!("mode {}", self.tuned().mode))
    }

    /// Switches the loop on again that was switched off at rest.
    fn close_loop(&mut self) -> Result<(), BoardError> {
        match self.way_back {
            ReturnToRest::Over => self.enter_mode(),
            ReturnToRest::Not | ReturnToRest::Begun => {
                self.way_back = ReturnToRest::Not;
                Ok(())
            }
        }
    }

    /// Switches the drive off, whatever else is running.
    fn stop(&mut self) -> Result<(), BoardError> {
        self.step = None;
        self.armed = false;
        self.message = "stopped".into();
        self.link.command("disarm")
    }

    fn switch(&mut self) -> Result<(), BoardError> {
        self.loop_index = 1 - self.loop_index;
        self.selected = 0;
        if self.armed {
            self.enter_mode()?;
        }
        self.message = format!("{} is tuned", self.tuned().mode);
        Ok(())
    }

    fn begin_step(&mut self) -> Result<(), BoardError> {
        if !self.armed {
            self.message = "a arms first".into();
            return Ok(());
        }
        if self.told == Some(self.reference) {
            self.message = self.no_step();
            return Ok(());
        }
        self.close_loop()?;
        self.poll()?;
        self.step = Some(Vec::new());
        self.message = "step test".into();
        self.tell(self.reference)
    }

    fn no_step(&self) -> String {
        let reference = self.reference;
        format!(
            "no step: the reference is {reference} rad/s already. Press space, a, s to start from rest, or choose another with -/+"
        )
    }

    /// The samples that the figures of a step test are of, and those after them: the same time in each test, however many
    /// came at once. It begins where the reference changes, as the board takes it a little after it was sent.
    fn course<'a>(&self, step: &'a [Sample]) -> (&'a [Sample], &'a [Sample]) {
        let reference = |sample: &Sample| self.point(sample).reference;
        let begun = step.iter().position(|sample| reference(sample) != reference(&step[0])).unwrap_or(0);
        let since = &step[begun..];
        let length = self.ticks(STEP_S);
        since.split_at(since.partition_point(|sample| sample.tick.wrapping_sub(since[0].tick) < length))
    }

    fn finish_step(&mut self) -> Result<(), BoardError> {
        let samples = self.step.take().unwrap_or_default();
        let (course, _) = self.course(&samples);
        let points: Vec<Point> = course.iter().map(|sample| self.point(sample)).collect();
        let figures = step_figures(&points, |point| point.measured_rad_per_s, self.reference);
        let TunedLoop { mode, gains } = self.tuned();
        let missing_ticks = missing_ticks(course);
        if (figures.to - figures.from).abs() < speed_bit_rad_per_s(&self.settings) {
            self.message = self.no_step();
        } else {
            self.step_tests.push(StepTest { mode, gains: by_name(gains, &self.settings), figures, missing_ticks });
            self.message = "step test done".into();
        }
        self.way_back = ReturnToRest::Begun;
        self.tell(0.0)
    }

    fn record(&mut self) -> Result<(), BoardError> {
        if let Some(kept) = self.end_recording(None) {
            self.message = kept.text;
            return Ok(());
        }
        // Earlier samples do not belong to it; they have gaps while a board lists its settings.
        self.poll()?;
        match self.keeper.begin(&self.settings, &self.link.firmware) {
            Ok(()) => {
                let begun = Recorded { samples: Vec::new(), losses: self.link.losses(), settings: self.settings };
                self.recording = Some(begun);
                self.message = "recording; r ends it".into();
            }
            Err(why) => self.is_not_kept(why),
        }
        Ok(())
    }

    /// A user reads the message, now and at the end of the session. A scripted session ends.
    fn is_not_kept(&mut self, why: String) {
        self.message.clone_from(&why);
        self.not_kept.push(why);
    }

    /// Adds samples to the running recording. If they cannot be stored, the recording ends.
    fn keep(&mut self, came: &[Sample]) {
        let Some(recording) = &mut self.recording else { return };
        match self.keeper.grow(came, &self.settings) {
            Ok(()) => recording.samples.extend(came),
            Err(why) => {
                let kept = self.closed_recording(Some(&BoardError::Failed(why.clone())));
                let kept = kept.map(|kept| format!("; {}", kept.text)).unwrap_or_default();
                self.is_not_kept(why + &kept);
            }
        }
    }

    /// Ends the running recording and reports its result. `failed`: why it could not continue.
    pub fn end_recording(&mut self, failed: Option<&BoardError>) -> Option<StoredRecording> {
        let kept = self.closed_recording(failed)?;
        if !kept.is_whole {
            self.not_kept.push(kept.text.clone());
        }
        Some(kept)
    }

    fn closed_recording(&mut self, failed: Option<&BoardError>) -> Option<StoredRecording> {
        let Recorded { samples, losses: before, settings } = self.recording.take()?;
        let now = self.link.losses();
        let record = Record {
            samples,
            settings: self.settings,
            ended: failed.map_or(Ended::Complete, |error| Ended::Failed(error.to_string())),
            losses: Losses {
                lost_frames: now.lost_frames - before.lost_frames,
                damaged_frames: now.damaged_frames - before.damaged_frames,
            },
        };
        let kept = self.keeper.keep(&record, &settings, &self.link.firmware);
        self.recordings.extend(kept.file.clone());
        Some(kept)
    }

    fn save(&mut self) -> Result<(), BoardError> {
        // The board keeps its original `trip_host`.
        self.armed = false;
        leave_host(&mut self.link, &self.settings)?;
        self.link.save()?;
        self.saved = Some(all_gains(&self.settings));
        watch_host(&mut self.link, &self.settings)?;
        self.message = "saved on the board; disarmed".into();
        Ok(())
    }

    /// Switches the drive off and restores the board's `trip_host`.
    ///
    /// # Errors
    /// [`BoardError`], if the board is gone.
    pub fn leave(&mut self) -> Result<(), BoardError> {
        leave_host(&mut self.link, &self.settings)
    }

    fn point(&self, sample: &Sample) -> Point {
        let unit = speed_bit_rad_per_s(&self.settings);
        let moves = sample.state.mode().is_speed();
        let supply_v = f64::from(sample.supply) / f64::from(VOLT);
        let speed = f64::from(sample.speed) * unit;
        let duty = f64::from(sample.duty) / f64::from(HARDWARE.pwm_steps);
        Point {
            t_s: f64::from(sample.tick) / f64::from(self.settings.get(Param::TickRate)),
            reference: if moves { f64::from(sample.reference) * unit } else { 0.0 },
            measured_rad_per_s: speed,
            omega_rad_per_s: speed,
            theta_rad: 0.0,
            i_a: f64::from(sample.current) / f64::from(AMPERE),
            u_v: duty * supply_v,
            limited: sample.state.has(State::LIMITED),
        }
    }
}
