//! The bridge: bytes of a serial port as binary messages of a WebSocket, orders of the page as text.

use super::http::Request;
use motorbench_link::Line;
use motorbench_link::port::{Port, only_board, open_line, reset, set_speed};
use serde::Deserialize;
use std::io::{self, Cursor, Read, Write};
use std::net::TcpStream;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tungstenite::{Error, Message, WebSocket, accept};

/// What the page may wait for while nothing comes from the port.
const WAIT: Duration = Duration::from_millis(2);
/// Switches the drive off, also in the middle of another line.
const LEAVE: &[u8] = b"\ndisarm\n";

/// What the page asks of the port.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Order {
    baud: Option<u32>,
    #[serde(default)]
    reset: bool,
}

/// A stream whose first bytes have been read already.
struct Unread {
    head: Cursor<Vec<u8>>,
    stream: TcpStream,
}

impl Read for Unread {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.head.read(buffer)? {
            0 => self.stream.read(buffer),
            count => Ok(count),
        }
    }
}

impl Write for Unread {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

type Page = WebSocket<Unread>;

/// Connects the page with the port until one of them goes.
pub(super) fn serve(
    stream: TcpStream,
    request: &Request,
    board: Option<&str>,
    in_use: &Mutex<()>,
    stopped: &AtomicBool,
) -> io::Result<()> {
    let waiting = stream.try_clone()?;
    let unread = Unread { head: Cursor::new(request.head.clone()), stream };
    let mut page = accept(unread).map_err(io::Error::other)?;
    let Ok(_held) = in_use.try_lock() else {
        return refuse(&mut page, "another page has the board: use that one, or close it");
    };
    let opened = board.map_or_else(only_board, |name| Ok(name.to_owned()));
    let opened = opened.and_then(|name| Ok((open_line(&name).map_err(|error| error.to_string())?, name)));
    let (mut port, name) = match opened {
        Ok(opened) => opened,
        Err(why) => return refuse(&mut page, &why),
    };
    waiting.set_read_timeout(Some(WAIT))?;
    say(&mut page, &serde_json::json!({ "open": name }))?;
    let ended = pass_on(&mut page, &mut port, stopped);
    // Nobody else can stop the motor now. Without this line its own `trip_host` does.
    let _ = port.send(LEAVE);
    ended
}

fn say(page: &mut Page, what: &serde_json::Value) -> io::Result<()> {
    page.send(Message::text(what.to_string())).map_err(io::Error::other)
}

fn refuse(page: &mut Page, why: &str) -> io::Result<()> {
    say(page, &serde_json::json!({ "error": why }))
}

fn pass_on(page: &mut Page, port: &mut Port, stopped: &AtomicBool) -> io::Result<()> {
    let mut buffer = [0; 4096];
    while !stopped.load(Ordering::Relaxed) {
        let count = port.receive(&mut buffer)?;
        if count > 0 {
            page.send(Message::binary(buffer[..count].to_vec())).map_err(io::Error::other)?;
        }
        match page.read() {
            Ok(Message::Binary(bytes)) => port.send(&bytes)?,
            Ok(Message::Text(text)) => carry_out(port, &text)?,
            Ok(Message::Close(_)) => return Ok(()),
            Ok(_) => {}
            Err(Error::Io(error)) if is_pause(&error) => {}
            Err(error) => return Err(io::Error::other(error)),
        }
    }
    Ok(())
}

fn is_pause(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted)
}

fn carry_out(port: &mut Port, text: &str) -> io::Result<()> {
    let order: Order = serde_json::from_str(text).map_err(io::Error::other)?;
    if let Some(baud) = order.baud {
        set_speed(port, baud)?;
    }
    if order.reset {
        // A virtual board has no such line.
        let _ = reset(port);
    }
    Ok(())
}
