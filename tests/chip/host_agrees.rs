//! The control loop on the chip and the same control loop on the host: same inputs, same outputs, bit for bit.
//!
//! The firmware runs with a motor attached, and its inputs and requests are read from the chip's memory tick by tick.
//! The host's copy of the core gets them. It must produce every sample that the chip sent over its serial line.

use host_sim::plant::{DcMotor, DcMotorParameters};
use motorbench_chip::{Bench, Rig, firmware_elf};
use motorbench_core::control_loop::{ControlLoop, Inputs, LoopConfig};
use motorbench_core::encoder::Edges;
use motorbench_core::excitation::{Kind, Sequence};
use motorbench_core::message::{Mode, Request, Sample};
use motorbench_core::protocol::{Frame, StreamDecoder};
use motorbench_core::settings::{Param, Settings};
use motorbench_data::names::setting_name;
use std::collections::BTreeMap;

/// One tick as the chip saw it.
#[derive(Clone, Copy)]
struct Tick {
    inputs: Inputs,
    request: Option<Request>,
}

struct Observer {
    bench: Bench<DcMotor>,
    inputs_at: u16,
    request_at: u16,
    ticks: Vec<Tick>,
    pending: Option<Request>,
    decoder: StreamDecoder,
    /// The binary stream is on, or about to be.
    listening: bool,
    samples: BTreeMap<u32, Sample>,
}

impl Observer {
    fn start() -> Self {
        let motor = DcMotorParameters { coulomb_friction_nm: 0.02, ..DcMotorParameters::PIVT6 };
        let mut bench =
            Bench::new(firmware_elf().expect("firmware"), Rig::default(), DcMotor::new(motor)).expect("bench");
        // Until the start-up code has cleared the memory, noise stands in it; the first tick comes later.
        bench.chip_mut().run_until(10_000).expect("the chip starts");
        let at = |name| bench.program().variable(name).expect(name);
        let (inputs_at, request_at) = (at("TICK_INPUTS"), at("TICK_REQUEST"));
        let samples = BTreeMap::new();
        Self {
            inputs_at,
            request_at,
            bench,
            ticks: Vec::new(),
            pending: None,
            decoder: StreamDecoder::default(),
            listening: false,
            samples,
        }
    }

    /// Runs on, looking every 100 cycles: a request is taken when its place in memory becomes empty, which is also
    /// when the inputs have changed.
    fn run_s(&mut self, duration_s: f64) {
        let end = self.bench.cycle() + (duration_s * 16e6) as u64;
        let mut last = self.inputs();
        let mut ticked = 0;
        while self.bench.cycle() < end {
            let next = self.bench.cycle() + 100;
            self.bench.chip_mut().run_until(next).expect("the chip runs");
            if self.inputs().tick_coarse != last.tick_coarse {
                // The handler is writing them; 300 cycles later all stand there.
                self.bench.chip_mut().run_until(next + 300).expect("the chip runs");
                let inputs = self.inputs();
                let request = self.pending.take();
                self.ticks.push(Tick { inputs, request });
                last = inputs;
                ticked = next;
            }
            // As long as the tick's handler runs, the request it has taken may still stand there.
            if let Some(request) = self.request() {
                let taken = self.ticks.last().and_then(|tick| tick.request);
                if taken != Some(request) || self.bench.cycle() > ticked + 7_000 {
                    self.pending = Some(request);
                }
            }
        }
        for byte in self.bench.serial().read() {
            if !self.listening {
                continue;
            }
            if let Some(Frame::Sample(sample)) = self.decoder.push(byte) {
                self.samples.insert(sample.tick, sample);
            }
        }
    }

    fn inputs(&self) -> Inputs {
        let b: [u8; 15] = self.bench.chip().read_bytes(self.inputs_at);
        let word = |at: usize| u16::from_le_bytes([b[at], b[at + 1]]);
        Inputs {
            edges: Edges { count: b[0], step: b[1], coarse: b[2], fine: b[3], illegal: b[4] },
            tick_coarse: b[5],
            current_sum: word(6),
            tacho: word(8),
            supply: word(10),
            duty_scale: word(12),
            flags: b[14],
        }
    }

    /// The request that waits in the chip's memory; its layout is that of a `repr(u8)` enum.
    fn request(&self) -> Option<Request> {
        let b: [u8; 16] = self.bench.chip().read_bytes(self.request_at);
        let word = |at: usize| u16::from_le_bytes([b[at], b[at + 1]]);
        Some(match b[0] {
            0 => Request::Arm,
            1 => Request::Disarm,
            2 => Request::Stop,
            3 => Request::Mode(Mode::from_number(b[1])?),
            4 => Request::Reference(i32::from_le_bytes([b[1], b[2], b[3], b[4]])),
            5 => {
                let kind = Kind::from_number(b[1])?;
                let period = word(6).into();
                let sequence = Sequence::new(kind, word(2) as i16, word(4) as i16, period, word(8), word(10));
                Request::Play(sequence.expect("the chip plays it"))
            }
            6 => Request::ClearTrip,
            7 => Request::ZeroCurrent,
            8 => Request::ZeroPosition,
            // `None` takes the next free number.
            _ => return None,
        })
    }

    fn order(&mut self, order: &str) {
        self.bench.serial().write(format!("{order}\n"));
        self.run_s(0.02);
    }
}

/// Orders one after the other, on the chip with these settings and then on the host.
fn agree(changed: &[(Param, f32)], runs: &[[&str; 3]]) -> Observer {
    let mut chip = Observer::start();
    chip.run_s(0.4);
    chip.order("echo off");
    let mut settings = Settings::defaults();
    for &(param, value) in changed {
        settings.set(param, value).expect("within its range");
        chip.order(&format!("set {} {value}", setting_name(param)));
    }
    chip.listening = true;
    chip.order("stream binary");
    chip.order("arm");
    for order in runs.iter().flatten() {
        chip.order(order);
        chip.run_s(0.4);
    }
    chip.order("mode open");
    chip.order("sequence coast 4 0 500 4");
    chip.run_s(1.0);

    let config = LoopConfig::build(&settings).expect("they fit");
    // The lines as the chip found them at its start: the motor has not moved since.
    let first = chip.ticks[0].inputs.edges;
    let mut host = ControlLoop::new(config, Edges { count: first.count, ..Edges::default() });
    let mut compared = 0;
    for tick in &chip.ticks {
        let drive = host.tick(tick.request, &tick.inputs);
        let sample = host.sample();
        assert_eq!(drive.duty, sample.duty);
        if let Some(sent) = chip.samples.get(&sample.tick) {
            assert_eq!(sent, sample, "tick {}, {:?}, {:?}", sample.tick, tick.inputs, tick.request);
            compared += 1;
        }
    }
    println!("{compared} ticks agree bit for bit");
    let driven = chip.samples.values().filter(|sample| sample.duty != 0).count();
    assert!(compared > 1400 * runs.len() && driven > 1000 * runs.len(), "{compared}, {driven}");
    assert_eq!((chip.decoder.lost, chip.decoder.damaged), (0, 0));
    chip
}

/// Every controller, from rest, through reversal and with a load; sequences with coasting and braking.
#[test]
fn bit_for_bit() {
    agree(
        &[],
        &[
            ["mode speed", "ref 60", "ref -60"],
            ["mode lqr_speed", "ref 60", "ref -60"],
            ["mode position", "ref 6.3", "ref -1.5"],
            ["mode lqr_position", "ref 6.3", "ref -1.5"],
            ["mode open", "ref 5", "ref -5"],
        ],
    );
}

/// The LQRs by the observed current, which is not the measured one: other voltages come out.
#[test]
fn bit_for_bit_with_the_current_observed() {
    let observed = [(Param::TorqueConstant, 0.072), (Param::WindingTime, 1.5), (Param::LqrSpeedKc, 2.0)];
    let runs = [["mode lqr_speed", "ref 60", "ref -60"], ["mode lqr_position", "ref 6.3", "ref -1.5"]];
    let duties = |chip: &Observer| chip.samples.values().map(|sample| sample.duty).collect::<Vec<_>>();
    let [with, without] = [&observed[..], &observed[2..]].map(|changed| duties(&agree(changed, &runs)));
    assert_ne!(with, without);
}
