//! The host's end of the serial line.

use super::core::Chip;
use super::usart::{SerialErrors, TimedByte};
use super::world::World;

/// The host's end of the serial line; made by [`Chip::serial`].
pub struct Serial<'a, W: World> {
    pub(super) chip: &'a mut Chip<W>,
}

impl<W: World> Serial<'_, W> {
    /// Hands bytes to the line. They follow each other without pause while the chip runs, 20 us each at 500 kBd,
    /// whether the program fetches them or not.
    pub fn write(&mut self, bytes: impl AsRef<[u8]>) {
        self.chip.core.with_device(|board, cpu| {
            board.usart.from_host.extend(bytes.as_ref());
            board.start_sending(cpu);
        });
    }

    /// Hands over a line; the line feed is added.
    pub fn write_line(&mut self, line: &str) {
        self.write(format!("{line}\n"));
    }

    /// Bytes that the host still has to send, without the one on the line.
    pub fn unsent(&self) -> usize {
        self.chip.core.device().usart.from_host.len()
    }

    /// Takes all bytes that have arrived since the last call.
    pub fn read(&mut self) -> Vec<u8> {
        self.read_timed().into_iter().map(|timed| timed.byte).collect()
    }

    /// As [`Serial::read`], with the cycle at which each byte was complete.
    pub fn read_timed(&mut self) -> Vec<TimedByte> {
        std::mem::take(&mut self.chip.core.device_mut().usart.to_host)
    }

    /// Takes the next complete line without its line end; `None` if there is none yet. Bytes that are no UTF-8 are
    /// replaced.
    pub fn read_line(&mut self) -> Option<String> {
        let mut board = self.chip.core.device_mut();
        let received = &mut board.usart.to_host;
        let end = received.iter().position(|timed| timed.byte == b'\n')?;
        let line: Vec<u8> = received.drain(..=end).map(|timed| timed.byte).collect();
        Some(String::from_utf8_lossy(&line).trim_end_matches(['\n', '\r']).to_owned())
    }

    /// What went wrong since power-on.
    pub fn errors(&self) -> SerialErrors {
        self.chip.core.device().usart.errors
    }

    /// Speed of the host, in baud; [`BAUD`](motorbench_core::HARDWARE.baud) from the start.
    pub fn set_baud(&mut self, baud: u32) {
        self.chip.core.device_mut().usart.host_baud = baud;
    }
}
