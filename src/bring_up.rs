//! A handful of orders and the binary telemetry: what fits beside the control loop until the full console does.
//!
//! The console ([`crate::console`]) and the control loop together exceed the Uno's flash today. This speaks to the same
//! [`Machine`], one order a line, each a letter and, where it needs one, a number. The reply is `ok` or `error`, as a
//! text frame; telemetry is every tick, as sample frames.
//!
//! | order | meaning |
//! |---|---|
//! | `a`, `d`, `s`, `c` | arm, disarm, stop, clear a trip |
//! | `m0`..`m5` | mode: off, open loop, speed PID, position PID, speed LQR, position LQR |
//! | `r1234` | reference in bits of its unit ([`crate::message::Request::Reference`]) |
//! | `p0`..`p7` | play the sequence of that number at an eighth of the range, 500 ms |
//! | `t0`, `t1` | telemetry off, on |

use crate::console::Machine;
use crate::excitation::{Kind, Sequence};
use crate::message::{Mode, Request, Sample};
use crate::protocol::{self, FRAME, Framer};

/// The line under way, and the frames' numbers.
#[derive(Default)]
pub struct Talk {
    framer: Framer,
    order: u8,
    value: i32,
    negative: bool,
    bad: bool,
    telemetry: bool,
}

impl Talk {
    /// Sends a sample, when telemetry is on.
    pub fn telemetry(&mut self, sample: &Sample, machine: &mut impl Machine) {
        if self.telemetry {
            self.send(protocol::SAMPLE, &protocol::pack(sample), machine);
        }
    }

    #[inline(never)]
    fn send(&mut self, kind: u8, payload: &[u8], machine: &mut impl Machine) {
        let mut frame = [0; FRAME];
        let length = self.framer.frame(kind, payload, &mut frame);
        machine.send(frame.get(..length).unwrap_or(&[]));
    }

    /// Takes a received byte.
    pub fn receive(&mut self, byte: u8, machine: &mut impl Machine) {
        match byte {
            b'\n' => {
                let request = if self.bad { None } else { self.request() };
                let understood = request.is_some() || self.order == b't' && !self.bad;
                if let Some(request) = request {
                    machine.host_spoke();
                    machine.request(request);
                }
                self.send(protocol::TEXT, if understood { b"ok\r\n" } else { b"error\r\n" }, machine);
                (self.order, self.value, self.negative, self.bad) = (0, 0, false, false);
            }
            b'a'..=b'z' if self.order == 0 => self.order = byte,
            b'-' if self.order != 0 => self.negative = true,
            b'0'..=b'9' if self.order != 0 && self.value < 100_000_000 => {
                self.value = self.value * 10 + (byte - b'0') as i32;
            }
            b'\r' => {}
            _ => self.bad = true,
        }
    }

    /// The request of the line; telemetry is switched on the way.
    fn request(&mut self) -> Option<Request> {
        let value = if self.negative { -self.value } else { self.value };
        Some(match self.order {
            b'a' => Request::Arm,
            b'd' => Request::Disarm,
            b's' => Request::Stop,
            b'c' => Request::ClearTrip,
            b'm' => Request::Mode(Mode::from_number(u8::try_from(value).ok()?)?),
            b'r' => Request::Reference(value),
            b'p' => {
                let kind = Kind::from_number(u8::try_from(value).ok()?)?;
                Request::Play(Sequence::new(kind, 4096, 0, 500, 4, 1))
            }
            b't' => {
                self.telemetry = value != 0;
                return None;
            }
            _ => return None,
        })
    }
}
