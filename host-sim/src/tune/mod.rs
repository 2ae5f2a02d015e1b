//! The tuning console: a board's speed loop under the fingers, in a terminal.
//!
//! [`Session`] is the board, the traces and what was changed; it knows nothing of a terminal. [`screen`] draws it.

pub mod screen;

use crate::board::{Board, BoardError};
use crate::design::trial::Point;
use crate::figures::{Figures, step_figures};
use crate::link::record::{Ended, Record};
use crate::link::{Line, Link, Losses, name};
use crate::live::Live;
use motorbench_core::message::{Sample, State, Trip};
use motorbench_core::pins::PWM_STEPS;
use motorbench_core::settings::{Param, Settings};
use motorbench_core::units::{AMPERE, FULL_RANGE, VOLT};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// The traces show this long.
pub const SHOWN_S: f64 = 5.0;
/// A step test lasts this long.
const STEP_S: f64 = 1.0;
/// The drive stops by itself when the program is silent for longer, whatever became of it.
const LOST_AFTER_MS: f32 = 500.0;
const KEEP_ALIVE: Duration = Duration::from_millis(100);
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

/// A change that can be taken back.
struct Change {
    param: Param,
    before: f32,
}

/// A recording under way.
struct Recorded {
    samples: Vec<Sample>,
    /// What had been lost on the line before.
    losses: Losses,
    /// The gains it began with.
    settings: Settings,
}

/// Where recordings go.
pub trait Keeper {
    /// Keeps what has come of the recording under way, so that a program that dies costs none of it.
    ///
    /// # Errors
    /// Why it cannot, with what to do; the recording then ends.
    fn grow(&mut self, samples: &[Sample], settings: &Settings) -> Result<(), String>;

    /// Ends one, made with the gains of `before` at first; what to tell the person.
    fn keep(&mut self, record: &Record, before: &Settings, firmware: &str) -> String;
}

/// The board and what the person does with it.
pub struct Session<L: Line> {
    link: Link<L>,
    settings: Settings,
    live: Option<Live>,
    keeper: Box<dyn Keeper>,
    recording: Option<Recorded>,
    /// What the board's own `trip_host` was.
    trip_host: f32,
    loop_index: usize,
    selected: usize,
    armed: bool,
    reference: f64,
    traces: VecDeque<Sample>,
    changes: Vec<Change>,
    step: Option<Vec<Sample>>,
    /// Figures of the last step test of each loop, and of the one before.
    figures: [[Option<Figures>; 2]; 2],
    spoke: Instant,
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
        let trip_host = settings.get(Param::TripHost);
        link.command(&format!("set {} {LOST_AFTER_MS}", name(Param::TripHost)))?;
        Ok(Self {
            link,
            settings,
            live,
            keeper,
            recording: None,
            trip_host,
            loop_index: 0,
            selected: 0,
            armed: false,
            reference,
            traces: VecDeque::new(),
            changes: Vec::new(),
            step: None,
            figures: [[None; 2]; 2],
            spoke: Instant::now(),
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
        if self.spoke.elapsed() > KEEP_ALIVE {
            self.link.keep_alive()?;
            self.spoke = Instant::now();
        }
        let came = self.link.samples(0.02)?;
        if let Some(trip) = came.iter().map(|sample| sample.trip).find(|trip| *trip != Trip::None)
            && self.armed
        {
            self.armed = false;
            self.step = None;
            self.message = format!("the drive tripped: {trip:?}. a clears it and arms again");
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
        Ok(())
    }

    /// Does what a key asks; a refusal of the board becomes the message.
    ///
    /// # Errors
    /// [`BoardError`], when the board is gone.
    pub fn press(&mut self, key: Key) -> Result<(), BoardError> {
        let done = match key {
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
        };
        match done {
            Err(BoardError::Refused { reply, .. }) => {
                self.message = reply;
                Ok(())
            }
            other => other,
        }
    }

    fn select(&mut self, by: isize) -> Result<(), BoardError> {
        let count = self.tuned().gains.len() as isize;
        self.selected = (self.selected as isize + by).rem_euclid(count) as usize;
        Ok(())
    }

    fn scale(&mut self, factor: f32) -> Result<(), BoardError> {
        let param = self.tuned().gains[self.selected];
        let before = self.settings.get(param);
        let value = if before == 0.0 { FIRST * param.range().1 } else { before * factor };
        self.set(param, value)?;
        self.changes.push(Change { param, before });
        Ok(())
    }

    fn set(&mut self, param: Param, value: f32) -> Result<(), BoardError> {
        self.link.command(&format!("set {} {value}", name(param)))?;
        self.settings.values[param as usize] = value;
        self.message = format!("{} {value}", name(param));
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
        if self.armed {
            self.link.command(&format!("ref {reference}"))?;
        }
        Ok(())
    }

    fn arm(&mut self) -> Result<(), BoardError> {
        self.link.command("clear")?;
        self.link.command("arm")?;
        self.link.command(&format!("mode {}", self.tuned().mode))?;
        self.armed = true;
        self.message = "armed; space stops".into();
        Ok(())
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
            self.link.command(&format!("mode {}", self.tuned().mode))?;
        }
        self.message = format!("{} is tuned", self.tuned().mode);
        Ok(())
    }

    fn begin_step(&mut self) -> Result<(), BoardError> {
        if !self.armed {
            self.message = "a arms first".into();
            return Ok(());
        }
        self.link.samples(0.0)?;
        self.step = Some(Vec::new());
        self.message = "step test".into();
        self.link.command(&format!("ref {}", self.reference))
    }

    fn finish_step(&mut self) -> Result<(), BoardError> {
        let samples = self.step.take().unwrap_or_default();
        let points: Vec<Point> = samples.iter().map(|sample| self.point(sample)).collect();
        let figures = step_figures(&points, |point| point.measured_rad_per_s, self.reference);
        let own = &mut self.figures[self.loop_index];
        *own = [Some(figures), own[0]];
        self.message = "step test done".into();
        self.link.command("ref 0")
    }

    fn record(&mut self) -> Result<(), BoardError> {
        self.message = match self.end_recording(None) {
            Some(kept) => kept,
            None => {
                let begun = Recorded { samples: Vec::new(), losses: self.link.losses(), settings: self.settings };
                self.recording = Some(begun);
                "recording; r ends it".into()
            }
        };
        Ok(())
    }

    /// Adds to the recording under way, if there is one; one that cannot be kept ends.
    fn keep(&mut self, came: &[Sample]) {
        let Some(recording) = &mut self.recording else { return };
        match self.keeper.grow(came, &self.settings) {
            Ok(()) => recording.samples.extend(came),
            Err(why) => {
                self.end_recording(Some(&BoardError::Failed(why.clone())));
                self.message = why;
            }
        }
    }

    /// Ends the recording under way, if there is one; what became of it. `failed`: why it could not go on.
    pub fn end_recording(&mut self, failed: Option<&BoardError>) -> Option<String> {
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
        Some(self.keeper.keep(&record, &settings, &self.link.firmware))
    }

    fn save(&mut self) -> Result<(), BoardError> {
        // The board keeps the host trip it came with.
        self.link.command("disarm")?;
        self.armed = false;
        self.link.command(&format!("set {} {}", name(Param::TripHost), self.trip_host))?;
        self.link.save()?;
        self.link.command(&format!("set {} {LOST_AFTER_MS}", name(Param::TripHost)))?;
        self.message = "saved on the board; disarmed".into();
        Ok(())
    }

    /// Leaves the board without drive, and its host trip as it was.
    ///
    /// # Errors
    /// [`BoardError`], when the board is gone.
    pub fn leave(mut self) -> Result<(), BoardError> {
        self.link.command("disarm")?;
        self.link.command(&format!("set {} {}", name(Param::TripHost), self.trip_host))
    }

    fn point(&self, sample: &Sample) -> Point {
        let unit = f64::from(self.settings.get(Param::SpeedRange)) / f64::from(FULL_RANGE);
        let moves = sample.state.mode().is_speed();
        let supply_v = f64::from(sample.supply) / f64::from(VOLT);
        let speed = f64::from(sample.speed) * unit;
        let duty = f64::from(sample.duty) / f64::from(PWM_STEPS);
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
