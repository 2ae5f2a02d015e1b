//! An Uno with the firmware and a motor, for the tests on the simulated chip.

use host_sim::chip::{Bench, Rig, firmware_elf};
use host_sim::plant::{DcMotor, DcMotorParameters};
use motorbench_core::message::Sample;
use motorbench_core::protocol::{Frame, StreamDecoder};

/// The chip with its motor, and the samples that came over the line.
pub struct Uno {
    pub bench: Bench<DcMotor>,
    pub decoder: StreamDecoder,
    pub samples: Vec<Sample>,
    pub replies: String,
}

impl Uno {
    /// Powered on, with the zero of the current taken.
    pub fn start() -> Self {
        let elf = firmware_elf().expect("firmware");
        // The test stand's motor with the friction its no-load current of 0.3 A shows.
        let motor = DcMotorParameters { coulomb_friction_nm: 0.02, ..DcMotorParameters::PIVT6 };
        let bench = Bench::new(elf, Rig::default(), DcMotor::new(motor)).expect("bench");
        let mut uno = Self { bench, decoder: StreamDecoder::default(), samples: Vec::new(), replies: String::new() };
        // The zero of the current takes 256 ticks.
        uno.run_s(0.4);
        uno
    }

    /// Runs on and decodes what came over the line.
    pub fn run_s(&mut self, duration_s: f64) {
        self.bench.run_s(duration_s).expect("the chip runs");
        for byte in self.bench.serial().read() {
            match self.decoder.push(byte) {
                Some(Frame::Sample(sample)) => self.samples.push(sample),
                Some(Frame::Text(text, length)) => self.replies += &String::from_utf8_lossy(&text[..length]),
                None => {}
            }
        }
    }

    /// Sends an order and expects its reply.
    pub fn order(&mut self, order: &str) {
        self.replies.clear();
        self.bench.serial().write(format!("{order}\n"));
        self.run_s(0.02);
        assert_eq!(self.replies, "ok\r\n", "{order}");
    }

    /// The latest sample.
    pub fn last(&self) -> Sample {
        *self.samples.last().expect("telemetry")
    }
}
