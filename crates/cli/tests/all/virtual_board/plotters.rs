//! What plotters get while a board is recorded.

use super::STEPS;
use crate::board::{Board, text, until};
use motorbench_data::recording::Channel;
use std::io::{Read, Write};
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// A plotter that takes what is sent to it until a recording is over.
struct Plotter {
    place: SocketAddr,
    over: Arc<AtomicBool>,
    /// What came, and how many packets the system has thrown away because the plotter was behind.
    heard: JoinHandle<(Vec<String>, usize)>,
}

impl Plotter {
    fn new() -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
        let (place, over) = (socket.local_addr().unwrap(), Arc::new(AtomicBool::new(false)));
        let ends = Arc::clone(&over);
        let heard = std::thread::spawn(move || {
            let (mut buffer, mut packets) = ([0; 1024], Vec::new());
            loop {
                let was_over = ends.load(Ordering::Relaxed);
                match socket.recv(&mut buffer) {
                    Ok(length) => packets.push(text(&buffer[..length])),
                    Err(_) if was_over => return (packets, dropped(place.port())),
                    Err(_) => {}
                }
            }
        });
        Self { place, over, heard }
    }

    /// What it got of so many packets.
    fn got(self, sent: usize) -> Vec<String> {
        self.over.store(true, Ordering::Relaxed);
        let (packets, dropped) = self.heard.join().unwrap();
        assert!(!packets.is_empty() && packets.len() <= sent, "{} of {sent}", packets.len());
        if cfg!(target_os = "linux") {
            assert_eq!(packets.len() + dropped, sent, "{dropped} were dropped by the system");
        }
        packets
    }
}

/// Packets that found the buffer of a UDP port full.
fn dropped(port: u16) -> usize {
    let table = std::fs::read_to_string("/proc/net/udp").unwrap_or_default();
    let end = format!(":{port:04X}");
    let own = table.lines().find(|line| line.split_whitespace().nth(1).is_some_and(|local| local.ends_with(&end)));
    own.and_then(|line| line.split_whitespace().last()?.parse().ok()).unwrap_or(0)
}

/// What a plotter gets is the recording, at the board's times.
#[test]
fn plotters_get_the_recording_while_it_is_made() {
    let board = Board::new("live");
    let (plotjuggler, teleplot) = (Plotter::new(), Plotter::new());
    let to = [format!("--live=plotjuggler={}", plotjuggler.place), format!("--live=teleplot={}", teleplot.place)];
    let done = board.run("record", &[&STEPS[..], &[&to[0], &to[1]]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let recording = motorbench_files::recording(&board.folder.join("run.csv"), &[]).unwrap();
    let (time_s, current_a) = (recording.time_s().unwrap(), recording.get(Channel::Current).unwrap());

    let sent: Vec<(f64, f64)> = plotjuggler
        .got(time_s.len())
        .iter()
        .map(|packet| {
            let object: serde_json::Value = serde_json::from_str(packet).unwrap();
            (object["timestamp"].as_f64().unwrap(), object["i_A"].as_f64().unwrap())
        })
        .collect();
    // The recording begins at zero, the board's clock at its start.
    let begun_s = sent[0].0;
    for (at_s, value) in &sent {
        let row = (1000.0 * (at_s - begun_s)).round() as usize;
        assert!((at_s - begun_s - time_s[row]).abs() < 1e-9 && (value - current_a[row]).abs() < 1e-6, "{at_s} {value}");
    }
    let packets = teleplot.got(time_s.len());
    let field = |packet: &String| {
        let line = packet.lines().find(|line| line.starts_with("i_A:")).unwrap().to_owned();
        let words: Vec<f64> =
            line.trim_end_matches("§A").split(':').skip(1).map(|word| word.parse().unwrap()).collect();
        (1e-3 * words[0], words[1])
    };
    for (at_s, value) in packets.iter().map(field) {
        let row = (1000.0 * (at_s - begun_s)).round() as usize;
        assert!((value - current_a[row]).abs() < 1e-6, "{at_s} {value}");
    }
}

/// What the Arduino IDE's Serial Plotter draws: `name:value` pairs without spaces, lines that end with `\r\n`.
#[test]
fn a_serial_plotter_gets_lines() {
    let board = Board::new("plotter");
    let mut line = serialport::new(board.port().to_str().unwrap(), 500_000).open_native().unwrap();
    line.write_all(b"stream text 50\n").unwrap();
    let (mut heard, mut buffer) = (String::new(), [0; 256]);
    until("ten lines for the plotter", || {
        let count = line.read(&mut buffer).unwrap_or(0);
        heard += &text(&buffer[..count]);
        heard.matches("reference:").count() > 10
    });
    line.write_all(b"stream off\n").unwrap();
    let lines: Vec<&str> = heard.split_inclusive('\n').filter(|line| line.starts_with("reference:")).collect();
    for line in &lines[..10] {
        let pairs = line.strip_suffix("\r\n").expect("the end of a line").split(',');
        let names: Vec<&str> = pairs
            .map(|pair| pair.split_once(':').filter(|(_, value)| value.parse::<f64>().is_ok()).expect("name:value").0)
            .collect();
        assert_eq!(names, ["reference", "position", "speed", "current", "duty"], "{line}");
    }
}
