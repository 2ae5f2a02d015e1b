//! An Uno with the firmware and a motor, for the tests on the simulated chip.
#![allow(dead_code, reason = "each test uses its part")]

pub mod figures;

use host_sim::plant::{DcMotor, DcMotorParameters, Plant};
use motorbench_chip::{Bench, Rig, firmware_elf};
use motorbench_core::message::Sample;
use motorbench_core::protocol::{Frame, StreamDecoder};

/// The chip with its motor, and the samples that came over the line.
pub struct Uno<P: Plant = DcMotor> {
    pub bench: Bench<P>,
    pub decoder: StreamDecoder,
    pub samples: Vec<Sample>,
    pub replies: String,
    /// Bytes since the last whole frame: all that comes while no stream is on.
    outside: Vec<u8>,
}

/// Without a frame for so many slices of 5 ms no stream is on: a sample comes every millisecond.
const SILENT_SLICES: usize = 4;

impl Uno {
    /// Powered on, nothing said yet.
    pub fn power_on() -> Self {
        // The test stand's motor with the friction its no-load current of 0.3 A shows.
        let motor = DcMotorParameters { coulomb_friction_nm: 0.02, ..DcMotorParameters::PIVT6 };
        Self::with(Rig::default(), DcMotor::new(motor))
    }

    /// Powered on, with the zero of the current taken and the binary stream on.
    pub fn start() -> Self {
        let mut uno = Self::power_on();
        uno.listen();
        uno
    }
}

impl<P: Plant> Uno<P> {
    /// Powered on in other surroundings, nothing said yet.
    pub fn with(rig: Rig, plant: P) -> Self {
        let bench = Bench::new(firmware_elf().expect("firmware"), rig, plant).expect("bench");
        Self {
            bench,
            decoder: StreamDecoder::default(),
            samples: Vec::new(),
            replies: String::new(),
            outside: Vec::new(),
        }
    }

    /// Waits for the greeting and the zero of the current, which takes 256 ticks; then everything comes in frames.
    pub fn listen(&mut self) {
        self.bench.run_s(0.4).expect("the chip runs");
        for line in ["echo off\n", "stream binary\n"] {
            self.bench.serial().read();
            self.decoder = StreamDecoder::default();
            self.bench.serial().write(line);
            self.run_s(if line.starts_with("echo") { 0.03 } else { 0.0 });
        }
        self.run_s(0.03);
        assert!(self.replies.ends_with("ok\r\n"), "{:?}", self.replies);
        self.samples.clear();
        self.decoder.damaged = 0;
    }

    /// Runs on and decodes what came over the line.
    pub fn run_s(&mut self, duration_s: f64) {
        self.bench.run_s(duration_s).expect("the chip runs");
        for byte in self.bench.serial().read() {
            self.outside.push(byte);
            let frame = self.decoder.push(byte);
            if frame.is_some() {
                self.outside.clear();
            }
            match frame {
                Some(Frame::Sample(sample)) => self.samples.push(sample),
                Some(Frame::Text(text, length)) => self.replies += &String::from_utf8_lossy(&text[..length]),
                None => {}
            }
        }
    }

    /// Whether a line outside of any frame ends an answer.
    fn is_answered_outside(&self) -> bool {
        let text = String::from_utf8_lossy(&self.outside);
        text.split_inclusive('\n').any(|line| line == "ok\r\n" || line.starts_with("error: ") && line.ends_with('\n'))
    }

    /// Sends a line; the reply, without carriage returns. Without a stream it is no frame, and not returned.
    pub fn ask(&mut self, line: &str) -> String {
        self.replies.clear();
        self.outside.clear();
        self.bench.serial().write(format!("{line}\n"));
        let before = self.samples.len();
        for slice in 0..800 {
            self.run_s(0.005);
            let is_streaming = self.samples.len() > before || !self.replies.is_empty();
            if slice >= SILENT_SLICES && !is_streaming && self.is_answered_outside() {
                break;
            }
            let last = self.replies.lines().last().unwrap_or("");
            if self.replies.ends_with('\n') && (last == "ok" || last.starts_with("error: ")) {
                break;
            }
        }
        self.replies.replace('\r', "")
    }

    /// Sends a command and expects that it is carried out.
    pub fn order(&mut self, line: &str) {
        assert_eq!(self.ask(line), "ok\n", "{line}");
    }

    /// Sends a line that must be refused.
    pub fn refused(&mut self, line: &str) {
        let reply = self.ask(line);
        assert!(reply.starts_with("error: "), "{line}: {reply}");
    }

    /// The latest sample.
    pub fn last(&self) -> Sample {
        *self.samples.last().expect("telemetry")
    }
}
