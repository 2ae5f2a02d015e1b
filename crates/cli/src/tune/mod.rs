//! The tuning console: a board's speed loop under the fingers, in a terminal.
//!
//! [`Session`] is the board, the traces and what was changed; it knows nothing of a terminal. [`screen`] draws it.

pub mod screen;

use host_sim::figures::{Figures, step_figures};
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

/// The traces show this long.
pub const SHOWN_S: f64 = 5.0;
/// A step test lasts this long.
const STEP_S: f64 = 1.0;
/// A motor whose counts stay the same for so long, and whose speed is below this share of its range, stands: well within the
/// 200 ms of `trip_encoder`.
const STANDS_S: f64 = 0.1;
const STANDS_SHARE: f64 = 0.01;
/// A session without a person gives up when nothing has come for so long.
const SILENT: Duration = Duration::from_secs(5);
/// A key changes a value by this factor; one that is zero becomes this share of its range first.
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

/// What both are asked for is a speed, also in a recording that begins before one of them drives.
pub const REFERENCE: Mode = Mode::SpeedPid;

/// A change that can be taken back.
struct Change {
    param: Param,
    before: f32,
}

/// What follows a step test. Left on at rest, the loop's integral pushes against the friction, and what is driven and does
/// not turn trips.
#[derive(Clone, Copy, PartialEq, Eq)]
enum WayBack {
    /// There is none: the loop goes by its reference.
    Not,
    /// The motor is on its way to rest.
    Begun,
    /// It stands; the loop is off until it is needed.
    Over,
}

/// A recording under way.
struct Recorded {
    samples: Vec<Sample>,
    /// What had been lost on the line before.
    losses: Losses,
    /// The gains it began with.
    settings: Settings,
}

/// A recording that was ended.
pub struct Kept {
    /// What to tell the person.
    pub text: String,
    /// Where it is, if anything of it had come.
    pub file: Option<PathBuf>,
    /// Whether all that belongs to it could be written.
    pub is_whole: bool,
}

/// Where recordings go.
pub trait Keeper {
    /// Finds out whether one can be kept, made with these gains and this firmware.
    ///
    /// # Errors
    /// Why it cannot, with what to do.
    fn begin(&mut self, settings: &Settings, firmware: &str) -> Result<(), String>;

    /// Keeps what has come of the recording under way, so that a program that dies costs none of it.
    ///
    /// # Errors
    /// Why it cannot, with what to do; the recording then ends.
    fn grow(&mut self, samples: &[Sample], settings: &Settings) -> Result<(), String>;

    /// Ends one, made with the gains of `before` at first.
    fn keep(&mut self, record: &Record, before: &Settings, firmware: &str) -> Kept;
}

/// A step test that was made.
#[derive(Clone, Debug, serde::Serialize)]
pub struct StepTest {
    /// The loop, by the console's name of its mode.
    pub mode: &'static str,
    /// Its gains at the time.
    pub gains: BTreeMap<String, f32>,
    /// What the loop made of it.
    #[serde(flatten)]
    pub figures: Figures,
    /// Ticks of it of which nothing came.
    pub missing_ticks: u32,
}

/// A whole session, for a program.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Account {
    /// What the firmware says of itself.
    pub firmware: String,
    /// Gains of both loops when it began.
    pub gains_before: BTreeMap<String, f32>,
    /// Gains of both loops when it ended.
    pub gains_after: BTreeMap<String, f32>,
    /// Whether those are what the board keeps, saved in this session.
    pub saved: bool,
    /// In the order in which they were made.
    pub step_tests: Vec<StepTest>,
    /// In the order in which they were made.
    pub recordings: Vec<String>,
    /// How it ended.
    pub ended: Ended,
}

impl Account {
    /// In what state the board was left, and where the recordings are.
    pub fn left(&self) -> Vec<String> {
        let gains = match (self.saved, self.gains_after == self.gains_before) {
            (true, _) => "the board keeps these gains",
            (false, true) => "the gains are as before",
            (false, false) => "the changed gains are not saved and last until the next reset",
        };
        let recordings = format!("recordings: {}", self.recordings.join(", "));
        [Some(format!("the drive is off; {gains}")), (!self.recordings.is_empty()).then_some(recordings)]
            .into_iter()
            .flatten()
            .collect()
    }
}

/// What a person would write down.
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

/// The board and what the person does with it.
pub struct Session<L: Line> {
    link: Link<L>,
    settings: Settings,
    live: Option<Live>,
    keeper: Box<dyn Keeper>,
    recording: Option<Recorded>,
    /// Why some could not be kept, or not all of them.
    not_kept: Vec<String>,
    loop_index: usize,
    selected: usize,
    armed: bool,
    reference: f64,
    /// What the loop on the board goes by, where that is known.
    told: Option<f64>,
    traces: VecDeque<Sample>,
    changes: Vec<Change>,
    step: Option<Vec<Sample>>,
    way_back: WayBack,
    step_tests: Vec<StepTest>,
    /// The gains as the board had them, and as they were saved last.
    gains_before: BTreeMap<String, f32>,
    saved: Option<BTreeMap<String, f32>>,
    recordings: Vec<PathBuf>,
    /// Why the drive switched itself off.
    trip: Option<Trip>,
    message: String,
}

impl<L: Line> Session<L> {
    /// With the settings as the board has them. `reference` in rad/s; `live` gets every sample, `keeper` recordings.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn new(
        mut link: Link<L>,
        reference: f64,
        live: Option<Live>,
        keeper: Box<dyn Keeper>,
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
            way_back: WayBack::Not,
            step_tests: Vec::new(),
            gains_before: all_gains(&settings),
            saved: None,
            recordings: Vec::new(),
            trip: None,
            message: "a arms, s tests a step, q quits".into(),
        })
    }

    /// The loop that is tuned.
    pub fn tuned(&self) -> TunedLoop {
        LOOPS[self.loop_index]
    }

    /// Fetches the telemetry and keeps the board from missing its host.
    ///
    /// # Errors
    /// [`BoardError`], when the board is gone.
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
            self.message = format!("nothing more is sent to the plotter: {error}");
        }
        self.keep(&came);
        self.traces.extend(came);
        let rate_hz = f64::from(self.settings.get(Param::TickRate));
        let kept = (SHOWN_S * rate_hz) as usize;
        self.traces.drain(..self.traces.len().saturating_sub(kept));
        if self.step.as_ref().is_some_and(|step| step.len() as f64 > STEP_S * rate_hz) {
            self.finish_step()?;
        }
        if self.armed && self.way_back == WayBack::Begun && self.stands() {
            self.way_back = WayBack::Over;
            self.link.command("stop")?;
        }
        Ok(())
    }

    /// Whether the motor has not turned of late.
    fn stands(&self) -> bool {
        let ticks = (STANDS_S * f64::from(self.settings.get(Param::TickRate))) as usize;
        let Some(last) = self.traces.back().filter(|_| self.traces.len() > ticks) else { return false };
        f64::from(last.speed).abs() < STANDS_SHARE * f64::from(FULL_RANGE)
            && self.traces.iter().rev().take(ticks).all(|sample| sample.counts == last.counts)
    }

    /// Does what a key asks; a refusal of the board becomes the message.
    ///
    /// # Errors
    /// [`BoardError`], when the board is gone.
    pub fn press(&mut self, key: Key) -> Result<(), BoardError> {
        match self.obey(key) {
            Err(BoardError::Refused { reply, .. }) => {
                self.message = reply;
                Ok(())
            }
            // Its cause is still there.
            Err(BoardError::Tripped(trip)) => {
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

    /// Presses one key after another, each when what the one before began is over: a step test and the way back to rest.
    /// Ends at the first that does nothing. `stop` is asked again and again; `says` gets what each did.
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
            let rest = self.tick() + (STEP_S * f64::from(self.settings.get(Param::TickRate))) as u32;
            self.wait(stop, |session| session.tick() >= rest)?;
        }
        // What came meanwhile, and a word to the board.
        self.wait(stop, |_| true)
    }

    /// Takes what comes until something is so.
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

    /// Of the last sample.
    fn tick(&self) -> u32 {
        self.traces.back().map_or(0, |sample| sample.tick)
    }

    /// What the session was. One that lacks what a recording should have kept has failed, whoever has ended it.
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
            // Names are bytes to some systems, and JSON is text.
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
        // Nothing that comes meanwhile is lost to traces and recording.
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
        self.way_back = WayBack::Not;
        self.told = None;
        self.link.command(&format!("mode {}", self.tuned().mode))
    }

    /// The loop again, where it was switched off at rest.
    fn close_loop(&mut self) -> Result<(), BoardError> {
        match self.way_back {
            WayBack::Over => self.enter_mode(),
            WayBack::Not | WayBack::Begun => {
                self.way_back = WayBack::Not;
                Ok(())
            }
        }
    }

    /// Without drive, whatever else goes on.
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

    fn finish_step(&mut self) -> Result<(), BoardError> {
        let samples = self.step.take().unwrap_or_default();
        let points: Vec<Point> = samples.iter().map(|sample| self.point(sample)).collect();
        // The board has taken the reference a little after it was told.
        let begun = points.iter().position(|point| point.reference != points[0].reference).unwrap_or(0);
        let figures = step_figures(&points[begun..], |point| point.measured_rad_per_s, self.reference);
        let TunedLoop { mode, gains } = self.tuned();
        let missing_ticks = missing_ticks(&samples[begun..]);
        if (figures.to - figures.from).abs() < speed_bit_rad_per_s(&self.settings) {
            self.message = self.no_step();
        } else {
            self.step_tests.push(StepTest { mode, gains: by_name(gains, &self.settings), figures, missing_ticks });
            self.message = "step test done".into();
        }
        self.way_back = WayBack::Begun;
        self.tell(0.0)
    }

    fn record(&mut self) -> Result<(), BoardError> {
        if let Some(kept) = self.end_recording(None) {
            self.message = kept.text;
            return Ok(());
        }
        // What had come before is none of it, with the gaps of a board that was listing its settings.
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

    /// A person reads it, now and when the session is over; one without a person ends.
    fn is_not_kept(&mut self, why: String) {
        self.message.clone_from(&why);
        self.not_kept.push(why);
    }

    /// Adds to the recording under way, if there is one; one that cannot be kept ends.
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

    /// Ends the recording under way, if there is one; what became of it. `failed`: why it could not go on.
    pub fn end_recording(&mut self, failed: Option<&BoardError>) -> Option<Kept> {
        let kept = self.closed_recording(failed)?;
        if !kept.is_whole {
            self.not_kept.push(kept.text.clone());
        }
        Some(kept)
    }

    fn closed_recording(&mut self, failed: Option<&BoardError>) -> Option<Kept> {
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
        // The board keeps the host trip it came with.
        self.armed = false;
        leave_host(&mut self.link, &self.settings)?;
        self.link.save()?;
        self.saved = Some(all_gains(&self.settings));
        watch_host(&mut self.link, &self.settings)?;
        self.message = "saved on the board; disarmed".into();
        Ok(())
    }

    /// Leaves the board without drive, and its host trip as it was.
    ///
    /// # Errors
    /// [`BoardError`], when the board is gone.
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

/// What a person can ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// The gain above.
    Up,
    /// The gain below.
    Down,
    /// Less of it.
    Less,
    /// More of it.
    More,
    /// A lower reference.
    Lower,
    /// A higher reference.
    Higher,
    /// Allow the drive.
    Arm,
    /// No drive, at once.
    Stop,
    /// A step from where it is to the reference, and back to rest.
    Step,
    /// The other loop.
    Switch,
    /// Take back the last change.
    Undo,
    /// Keep the gains on the board.
    Save,
    /// Begin a recording, or end it.
    Record,
}
