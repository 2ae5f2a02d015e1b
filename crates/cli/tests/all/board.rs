//! A virtual board in its own process, and the program's commands that use it.
#![allow(dead_code, reason = "each test uses some of it")]

use motorbench_core::message::{State, Trip};
use motorbench_core::protocol::{Frame, StreamDecoder};
use motorbench_link::virtual_control::control_path;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

pub const MOTORBENCH: &str = env!("CARGO_BIN_EXE_motorbench");

/// A test fails if it waits for longer than this.
const NEVER: Duration = Duration::from_secs(240);

/// A virtual board in a folder of its own.
pub struct Board {
    pub process: Child,
    pub folder: PathBuf,
}

impl Board {
    pub fn new(name: &str) -> Self {
        Self::with(name, &[])
    }

    pub fn with(name: &str, arguments: &[&str]) -> Self {
        motorbench_chip::firmware_elf().expect("firmware");
        let folder = std::env::temp_dir().join(format!("motorbench-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let process = Command::new(MOTORBENCH)
            // Longer than any test: a process that is left behind ends by itself.
            .args(["virtual", "--seconds", "900", "--link"])
            .arg(folder.join("board"))
            .args(arguments)
            // Generous for a busy computer: the tests do not measure its speed.
            .args(if arguments.contains(&"--wait-for-reader") { &[][..] } else { &["--wait-for-reader", "120"] })
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let mut board = Self { process, folder };
        let begun = Instant::now();
        while !board.port().exists() {
            assert!(board.process.try_wait().unwrap().is_none(), "it has ended");
            assert!(begun.elapsed() < NEVER, "no port");
            sleep(Duration::from_millis(50));
        }
        board
    }

    pub fn port(&self) -> PathBuf {
        self.folder.join("board")
    }

    pub fn change(&mut self, order: &str) {
        writeln!(self.process.stdin.as_mut().unwrap(), "{order}").unwrap();
    }

    /// The same over its control socket; returns when it is done.
    pub fn order(&self, order: &str) {
        let socket = UnixStream::connect(control_path(&self.port())).unwrap();
        writeln!(&socket, "{order}").unwrap();
        let mut answer = String::new();
        BufReader::new(&socket).read_line(&mut answer).unwrap();
        assert_eq!(answer, "ok\n", "{order}");
    }

    pub fn command(&self, name: &str, arguments: &[&str]) -> Command {
        let mut command = Command::new(MOTORBENCH);
        command.arg(name).arg("--port").arg(self.port()).args(arguments).current_dir(&self.folder);
        // The folder in which `has_recorded` and `side_file` look; it can be changed.
        if name == "record" && !arguments.contains(&"--out") {
            command.args(["--out", "run.csv"]);
        }
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    pub fn run(&self, name: &str, arguments: &[&str]) -> Output {
        self.command(name, arguments).output().unwrap()
    }

    /// A command without a board, in the same folder.
    pub fn run_alone(&self, arguments: &[&str]) -> Output {
        Command::new(MOTORBENCH).args(arguments).current_dir(&self.folder).output().unwrap()
    }

    /// Waits until a new recording has this many samples in its file. The folder must have been empty.
    pub fn has_recorded(&self, samples: usize) {
        let path = self.folder.join("run.csv");
        until("a recording", || path.exists() && rows(&path) >= samples);
    }

    /// The drive is off: the board's status says so.
    pub fn motor_is_off(&self) {
        let status = text(&self.run("connect", &["status"]).stdout);
        assert!(status.contains("mode off armed 0"), "{status}");
    }

    /// Reads the stream that a killed program has left on, without sending anything, until the drive switches itself
    /// off.
    pub fn trips_by_itself(&self) {
        let name = self.port();
        let mut line = serialport::new(name.to_str().unwrap(), 500_000).open_native().unwrap();
        let (mut decoder, mut buffer, mut last) = (StreamDecoder::default(), [0; 256], None);
        until("a trip for want of a host", || {
            let count = line.read(&mut buffer).unwrap_or(0);
            let frames = buffer[..count].iter().filter_map(|byte| decoder.push(*byte));
            let samples =
                frames.filter_map(|frame| if let Frame::Sample(sample) = frame { Some(sample) } else { None });
            last = samples.last().or(last);
            last.is_some_and(|sample| sample.trip == Trip::HostLost && !sample.state.has(State::ARMED))
        });
    }

    pub fn side_file(&self) -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(self.folder.join("run.json")).unwrap()).unwrap()
    }
}

/// Waits for a state for as long as a busy computer may need; fails if it never comes.
pub fn until(what: &str, mut is: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !is() {
        assert!(begun.elapsed() < NEVER, "{what} did not come");
        sleep(Duration::from_millis(10));
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Rows of a table below its header; empty for a new file.
pub fn rows(path: &Path) -> usize {
    std::fs::read_to_string(path).unwrap().lines().count().saturating_sub(1)
}
