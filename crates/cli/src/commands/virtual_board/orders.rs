//! Orders to a virtual board: lines from the terminal, and from the socket beside its port.

use super::Failure;
use motorbench_link::virtual_control::control_path;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::getpgrp;
use rustix::stdio::stdin;
use rustix::termios::tcgetpgrp;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::mpsc::Sender;
use std::time::Duration;

/// How often it is looked whether this program has the terminal.
const LOOK_AT_TERMINAL: Duration = Duration::from_millis(200);

/// A line that changes the bench.
pub(super) struct Order {
    pub line: String,
    /// Who wants an answer; else it is the terminal.
    from: Option<UnixStream>,
}

impl Order {
    pub fn answer(self, done: Result<(), String>, json: bool) {
        match (self.from, done) {
            // Who does not wait for the answer does not want it.
            (Some(mut from), Ok(())) => drop(writeln!(from, "ok")),
            (Some(mut from), Err(why)) => drop(writeln!(from, "error: {why}")),
            (None, done) if json => println!("{}", serde_json::json!({ "line": self.line, "error": done.err() })),
            (None, Ok(())) => {}
            (None, Err(why)) => println!("{why}"),
        }
    }
}

/// The socket beside the port, see [`motorbench_link::virtual_control`]; gone when this is dropped.
pub(super) struct Control(pub PathBuf);

impl Control {
    pub fn new(port: &Path, orders: Sender<Order>) -> Result<Self, Failure> {
        let path = control_path(port);
        // Of a virtual board that was killed: one that runs was found before.
        let _ = std::fs::remove_file(&path);
        let listener = UnixListener::bind(&path)
            .map_err(|error| Failure::machine(format!("{}: {error}; choose another --link", path.display())))?;
        std::thread::spawn(move || {
            for stream in listener.incoming().map_while(Result::ok) {
                let orders = orders.clone();
                std::thread::spawn(move || {
                    for line in BufReader::new(&stream).lines().map_while(Result::ok) {
                        let order = Order { line, from: stream.try_clone().ok() };
                        if orders.send(order).is_err() {
                            return;
                        }
                    }
                });
            }
        });
        Ok(Self(path))
    }
}

impl Drop for Control {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// Standard input while this program has the terminal. The system stops a program that reads from it in the background
/// (`&`), and the board with it.
struct Foreground;

impl Foreground {
    /// An input that is no terminal, or another program's, can be read at any time.
    fn has_terminal() -> bool {
        !tcgetpgrp(stdin()).is_ok_and(|group| group != getpgrp())
    }

    /// Whether a read would come back at once: with a line, or with the end of the input.
    fn has_come() -> std::io::Result<bool> {
        let within = Timespec { tv_sec: 0, tv_nsec: LOOK_AT_TERMINAL.subsec_nanos().into() };
        Ok(poll(&mut [PollFd::new(&stdin(), PollFlags::IN)], Some(&within))? > 0)
    }
}

impl Read for Foreground {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        loop {
            if !Self::has_terminal() {
                std::thread::sleep(LOOK_AT_TERMINAL);
            } else if Self::has_come()? && Self::has_terminal() {
                return Ok(rustix::io::read(stdin(), buffer)?);
            }
        }
    }
}

/// Lines from the terminal, as they come.
pub(super) fn from_terminal(orders: Sender<Order>) {
    std::thread::spawn(move || {
        for line in BufReader::new(Foreground).lines().map_while(Result::ok) {
            if orders.send(Order { line, from: None }).is_err() {
                return;
            }
        }
    });
}
