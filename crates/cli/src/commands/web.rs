//! `motorbench web`: the page in a browser, served on this machine, and a bridge to the port of a board.

mod bridge;
mod http;

use super::interaction::on_interrupt;
use super::port::PortArguments;
use super::{Failure, JSON_TO, TERMINAL, tell};
use clap::Args;
use http::{Request, respond};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha20Rng;
use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher, Hasher};
use std::io;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// The files of the page; none if the program was built without it.
static SITE: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/site.rs"));
/// What to do then.
const NO_SITE: &str =
    "this program was built without the page: run `scripts/web program`, then the program that it names";
/// How often it is looked whether the user ends it.
const LOOK: Duration = Duration::from_millis(100);

/// Opens the page in a browser: recordings, a board, a virtual board. This program serves it, on this machine only.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench web
  motorbench web --no-open --listen 8080
  motorbench web --port /dev/ttyACM0

A browser without Web Serial (Firefox, Safari) reaches the board through this
program. The address has a token, and other machines cannot connect. Ctrl-C
ends it; a motor then stops by itself within half a second.")]
pub struct Arguments {
    #[command(flatten)]
    port: PortArguments,
    /// TCP port to serve at; default: a free one.
    #[arg(long, value_name = "NUMBER", default_value_t = 0, hide_default_value = true)]
    listen: u16,
    /// Prints the address and opens no browser.
    #[arg(long)]
    no_open: bool,
    /// Prints the address as JSON instead of text.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL, value_parser = [TERMINAL])]
    json: Option<String>,
}

/// Serves until the user ends it.
///
/// # Errors
/// [`Failure`] if the page is not in this program, or the port is taken.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    if SITE.is_empty() {
        return Err(Failure::machine(NO_SITE));
    }
    let stopped = on_interrupt()?;
    let listen = arguments.listen;
    let taken = |error| Failure::machine(format!("127.0.0.1:{listen}: {error}; choose another --listen"));
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, listen)).map_err(taken)?;
    listener.set_nonblocking(true).map_err(Failure::machine)?;
    let port = listener.local_addr().map_err(Failure::machine)?.port();
    let server = Arc::new(Server {
        port,
        token: token(),
        board: arguments.port.name().map(str::to_owned),
        in_use: Mutex::new(()),
        stopped,
    });
    let address = format!("http://127.0.0.1:{port}/?token={}", server.token);
    match arguments.json {
        Some(_) => println!("{}", serde_json::json!({ "address": address })),
        None => println!("{address}\nCtrl-C ends it."),
    }
    if !arguments.no_open && !opened(&address) {
        tell("no browser could be opened: open the address in one");
    }
    while !server.stopped.load(Ordering::Relaxed) {
        match listener.accept() {
            Ok((stream, _)) => {
                let server = Arc::clone(&server);
                thread::spawn(move || server.answer(stream));
            }
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => thread::sleep(LOOK),
            Err(error) => return Err(Failure::machine(error)),
        }
    }
    // The bridge disarms the drive before it ends.
    drop(server.in_use.lock());
    Ok(())
}

/// What every connection needs.
struct Server {
    port: u16,
    token: String,
    board: Option<String>,
    /// Held by the bridge that has the board.
    in_use: Mutex<()>,
    stopped: Arc<AtomicBool>,
}

impl Server {
    fn answer(&self, stream: TcpStream) {
        // A browser that goes away is no failure of this program.
        let _ = self.try_answer(stream);
    }

    fn try_answer(&self, mut stream: TcpStream) -> io::Result<()> {
        stream.set_nonblocking(false)?;
        let Some(request) = Request::read(&mut stream)? else {
            return respond(&mut stream, 400, "text/plain", b"bad request");
        };
        // Another page must not reach this one under a name of its own.
        if !request.is_for(self.port) {
            return respond(&mut stream, 403, "text/plain", b"this machine only");
        }
        if request.path == "/port" {
            if request.token() != Some(&self.token) || !request.comes_from(self.port) {
                return respond(
                    &mut stream,
                    403,
                    "text/plain",
                    b"wrong token: open the address that motorbench web prints",
                );
            }
            return bridge::serve(stream, &request, self.board.as_deref(), &self.in_use, &self.stopped);
        }
        let name = if request.path == "/" { "index.html" } else { request.path.trim_start_matches('/') };
        match SITE.iter().find(|(file, _)| *file == name) {
            Some((file, bytes)) => respond(&mut stream, 200, http::kind(file), bytes),
            None => respond(&mut stream, 404, "text/plain", b"not found"),
        }
    }
}

/// A number that no other page can guess.
fn token() -> String {
    let mut seed = [0; 32];
    for part in seed.chunks_mut(8) {
        // The keys of a hash map are drawn by the operating system.
        let mut hasher = RandomState::new().build_hasher();
        hasher.write_u128(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos()));
        part.copy_from_slice(&hasher.finish().to_le_bytes());
    }
    let mut random = ChaCha20Rng::from_seed(seed);
    format!("{:016x}{:016x}", random.next_u64(), random.next_u64())
}

/// Opens the browser that the user prefers.
fn opened(address: &str) -> bool {
    let (program, before): (&str, &[&str]) = match std::env::consts::OS {
        "macos" => ("open", &[]),
        "windows" => ("rundll32", &["url.dll,FileProtocolHandler"]),
        _ => ("xdg-open", &[]),
    };
    let mut command = Command::new(program);
    command.args(before).arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.spawn().is_ok()
}
