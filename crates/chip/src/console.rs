//! The simulated chip as a [`Board`]: its console and telemetry over the serial line.

use super::bench::Bench;
use host_sim::plant::Plant;
use motorbench_core::HARDWARE;
use motorbench_core::message::Sample;
use motorbench_core::protocol::{Frame, StreamDecoder};
use motorbench_link::board::{Board, BoardError, KEEP_ALIVE};

/// Until the greeting is out and the zero of the current is taken, 256 ticks.
const START_S: f64 = 0.4;
/// How closely an answer is waited for, and how long.
const POLL_S: f64 = 0.5e-3;
const ANSWER_S: f64 = 4.0;

/// A bench whose firmware is spoken to over its serial line.
pub struct ChipBoard<P: Plant> {
    /// The chip and its motor.
    pub bench: Bench<P>,
    decoder: StreamDecoder,
    samples: Vec<Sample>,
    reply: String,
    /// The cycle at which it was last kept alive.
    kept_alive: u64,
}

impl<P: Plant> ChipBoard<P> {
    /// Waits for the start of the firmware and switches the binary stream on.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn start(mut bench: Bench<P>) -> Result<Self, BoardError> {
        bench.run_s(START_S).map_err(|crash| BoardError::Failed(crash.to_string()))?;
        bench.serial().write("echo off\n");
        bench.run_s(0.03).map_err(|crash| BoardError::Failed(crash.to_string()))?;
        bench.serial().read();
        let (decoder, kept_alive) = (StreamDecoder::default(), bench.cycle());
        let mut board = Self { bench, decoder, samples: Vec::new(), reply: String::new(), kept_alive };
        board.command("stream binary")?;
        board.samples.clear();
        Ok(board)
    }

    fn run(&mut self, duration_s: f64) -> Result<(), BoardError> {
        self.bench.run_s(duration_s).map_err(|crash| BoardError::Failed(crash.to_string()))?;
        for byte in self.bench.serial().read() {
            match self.decoder.push(byte) {
                Some(Frame::Sample(sample)) => self.samples.push(sample),
                Some(Frame::Text(text, length)) => self.reply += &String::from_utf8_lossy(&text[..length]),
                None => {}
            }
        }
        Ok(())
    }
}

impl<P: Plant> Board for ChipBoard<P> {
    fn command(&mut self, line: &str) -> Result<(), BoardError> {
        self.reply.clear();
        self.bench.serial().write_line(line);
        for _ in 0..(ANSWER_S / POLL_S) as u32 {
            self.run(POLL_S)?;
            match self.reply.lines().last().filter(|_| self.reply.ends_with('\n')) {
                Some("ok") => return Ok(()),
                Some(reply) if reply.starts_with("error: ") => {
                    return Err(BoardError::Refused { line: line.into(), reply: reply.into() });
                }
                _ => {}
            }
        }
        Err(BoardError::Silent { line: line.into() })
    }

    fn samples(&mut self, duration_s: f64) -> Result<Vec<Sample>, BoardError> {
        self.run(duration_s)?;
        Ok(std::mem::take(&mut self.samples))
    }

    fn stay_alive(&mut self) -> Result<(), BoardError> {
        let silent_s = (self.bench.cycle() - self.kept_alive) as f64 / f64::from(HARDWARE.clock_hz);
        if silent_s < KEEP_ALIVE.as_secs_f64() {
            return Ok(());
        }
        self.kept_alive = self.bench.cycle();
        self.command("alive")
    }
}
