//! A serial line: a port, or something that behaves like one.

use std::io::{self, ErrorKind, Read, Write};
use std::time::{Duration, Instant};

/// A line of the console is sent within this time, or the port accepts nothing.
const SEND_TIMEOUT: Duration = Duration::from_secs(2);
/// Pause between reads in which the port had nothing: another program may be reading it.
const EMPTY_READ_PAUSE: Duration = Duration::from_millis(1);

/// A serial line. A read that times out is no error: it returns 0 bytes.
pub trait Line: Send {
    /// Reads the bytes that have come, waiting a few milliseconds at most.
    ///
    /// # Errors
    /// When the line is gone.
    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<usize>;

    /// Writes everything.
    ///
    /// # Errors
    /// When the line is gone.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;
}

impl<T: Read + Write + Send + ?Sized> Line for Box<T> {
    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.read(buffer) {
            // A pseudo-terminal whose other end is closed, and a USB port that was unplugged.
            Ok(0) => Err(ErrorKind::BrokenPipe.into()),
            Err(error) if is_pause(&error) => {
                if error.kind() == ErrorKind::WouldBlock {
                    std::thread::sleep(EMPTY_READ_PAUSE);
                }
                Ok(0)
            }
            other => other,
        }
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let (begun, mut rest) = (Instant::now(), bytes);
        while !rest.is_empty() {
            match self.write(rest) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(count) => rest = &rest[count..],
                Err(error) if is_pause(&error) && begun.elapsed() < SEND_TIMEOUT => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

/// Whether a port is only temporarily unable to work.
fn is_pause(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::WouldBlock)
}
