//! A simulated [`Board`] for tests.

use crate::board::{Board, BoardError};
use motorbench_core::message::{Sample, Trip};
use motorbench_core::settings::{Param, Settings};
use motorbench_core::units::FULL_RANGE;
use std::time::Duration;

/// A board that accepts every line, reaches every speed at once, and sends a given number of samples. Then its
/// telemetry stops.
pub struct FakeBoard {
    /// All lines, in order.
    pub heard: Vec<String>,
    /// A latched trip, which makes the board refuse to arm.
    pub trip: Trip,
    /// One sample of this many comes over the line.
    pub every: u32,
    /// A setting, and its greatest value; a greater one is refused.
    pub most: Option<(&'static str, f64)>,
    tick: u32,
    left: u32,
    speed: i16,
    silent_s: f64,
}

impl FakeBoard {
    /// A board that sends this many samples.
    pub fn that_sends(samples: u32) -> Self {
        Self {
            heard: Vec::new(),
            trip: Trip::None,
            every: 1,
            most: None,
            tick: 0,
            left: samples,
            speed: 0,
            silent_s: 0.0,
        }
    }
}

impl Board for FakeBoard {
    fn command(&mut self, line: &str) -> Result<(), BoardError> {
        let settings = Settings::defaults();
        let in_speed =
            self.heard.iter().rev().find(|line| line.starts_with("mode ")).is_some_and(|line| line == "mode speed");
        if let (true, Some(speed)) = (in_speed, line.strip_prefix("ref ")) {
            self.speed = (speed.parse::<f32>().unwrap() / settings.get(Param::SpeedRange) * FULL_RANGE) as i16;
        }
        self.heard.push(line.into());
        let value = |name: &str| line.split_once(&format!(" {name} "))?.1.split(' ').next()?.parse::<f64>().ok();
        if self.most.is_some_and(|(name, most)| value(name).is_some_and(|value| value > most)) {
            return Err(BoardError::Refused { line: line.into(), reply: "error: too large for fixed point".into() });
        }
        match self.trip {
            Trip::None => Ok(()),
            _ if line != "arm" => Ok(()),
            _ => Err(BoardError::Refused {
                line: line.into(),
                reply: "error: trip 8 emergency stop, 0 s ago; clear it".into(),
            }),
        }
    }

    fn samples(&mut self, duration_s: f64) -> Result<Vec<Sample>, BoardError> {
        let ticks = (1e3 * duration_s).round() as u32;
        let sent = ticks.min(self.left);
        self.left -= sent;
        if sent < ticks {
            std::thread::sleep(Duration::from_secs_f64(duration_s));
            self.silent_s += duration_s;
            assert!(self.silent_s < 5.0, "nobody ends the wait");
        }
        let ticks = self.tick + 1..=self.tick + sent;
        self.tick += sent;
        let sample = |tick| Sample { tick, speed: self.speed, trip: self.trip, ..Sample::default() };
        Ok(ticks.filter(|tick| tick % self.every == 0).map(sample).collect())
    }

    fn stay_alive(&mut self) -> Result<(), BoardError> {
        Ok(())
    }
}
