//! The link to a scripted board: half frames, flipped bytes, a reset, an unplugged cable, another version. Tests with
//! the real firmware are in `virtual_board`.

use motorbench_cli::tune::{Key, RecordingStore, Session, StoredRecording};
use motorbench_core::message::{Mode, Sample, State, Trip};
use motorbench_core::protocol::{FRAME, Framer, SAMPLE, TEXT, TEXT_CHUNK, pack};
use motorbench_core::settings::{Param, Settings};
use motorbench_data::names::setting_name;
use motorbench_link::board::{Board, BoardError};
use motorbench_link::live::Live;
use motorbench_link::record::{Ended, Record, record};
use motorbench_link::{Line, Link, VERSION};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::VecDeque;
use std::io;
use std::net::UdpSocket;
use std::sync::{Arc, Mutex};

/// Faults of the board or the line.
#[derive(Clone, Copy, PartialEq)]
enum Fault {
    None,
    /// The cable is unplugged after so many samples.
    UnpluggedAfter(u32),
    /// The board is reset after so many samples.
    ResetAfter(u32),
    /// The drive trips after so many samples.
    TripAfter(u32),
    /// One byte in a hundred is wrong.
    Noise,
    /// One bit in three thousand is wrong, in samples and answers.
    Bits,
    /// A thousand frames are lost, and the next one comes in four pieces.
    Gap,
    /// The telemetry stops after so many samples.
    SilentAfter(u32),
    /// While the board lists its settings it sends no samples.
    BusyListing,
}

/// A board that answers `ok`, and sends samples while a sequence of 500 ticks plays.
struct Fake {
    version: &'static str,
    fault: Fault,
    binary: bool,
    framer: Framer,
    tick: u32,
    /// Ticks of the sequence still to come.
    playing: u32,
    played: u32,
    out: VecDeque<u8>,
    /// An incomplete line.
    line: String,
    obeyed: Arc<Mutex<Vec<String>>>,
    heard: Arc<Mutex<String>>,
    random: ChaCha8Rng,
}

const TICKS: u32 = 500;
const LOST: u32 = 1000;
/// Bytes that were not read yet.
const BEHIND: usize = 500;
/// Time that the board needs to list its settings.
const LISTING_TICKS: u32 = 390;

impl Fake {
    fn new(fault: Fault) -> (Self, Arc<Mutex<String>>) {
        let heard = Arc::new(Mutex::new(String::new()));
        let fake = Self {
            version: VERSION,
            fault,
            binary: false,
            framer: Framer::default(),
            tick: 1000,
            playing: 0,
            played: 0,
            out: VecDeque::new(),
            line: String::new(),
            obeyed: Arc::default(),
            heard: Arc::clone(&heard),
            random: ChaCha8Rng::seed_from_u64(1),
        };
        (fake, heard)
    }

    fn frame(&mut self, kind: u8, payload: &[u8]) {
        let mut frame = [0; FRAME];
        let length = self.framer.frame(kind, payload, &mut frame);
        for &byte in &frame[..length] {
            let flipped = match self.fault {
                Fault::Noise => kind == SAMPLE && self.random.random_bool(0.01),
                Fault::Bits => self.random.random_bool(8.0 * 0.0003),
                _ => false,
            };
            self.out.push_back(if flipped { byte ^ 0x55 } else { byte });
        }
    }

    /// A sample that is lost.
    fn lose(&mut self) {
        self.tick += 1;
        self.framer.frame(SAMPLE, pack(&Sample::default()), &mut [0; FRAME]);
    }

    fn say(&mut self, text: &str) {
        if self.binary {
            let chunks: Vec<Vec<u8>> = text.as_bytes().chunks(TEXT_CHUNK).map(<[u8]>::to_vec).collect();
            chunks.iter().for_each(|chunk| self.frame(TEXT, chunk));
        } else {
            self.out.extend(text.as_bytes());
        }
    }

    fn tick(&mut self) {
        self.tick += 1;
        let mut state = Mode::OpenLoop as u8 | State::ARMED | State::ENABLED;
        if self.playing > 0 {
            self.playing -= 1;
            self.played += 1;
            state |= State::PLAYING;
        }
        let trip = match self.fault {
            Fault::TripAfter(after) if self.played > after => Trip::Stall,
            _ => Trip::None,
        };
        if self.fault == Fault::ResetAfter(self.played) {
            self.tick = 0;
        }
        if self.fault == Fault::Gap && self.played == 100 {
            (0..LOST).for_each(|_| self.lose());
            self.out.extend([7, 0, 7, 0, 7, 0, 7, 0]);
        }
        let sample = Sample { tick: self.tick, state: State(state), trip, ..Sample::default() };
        self.frame(SAMPLE, pack(&sample));
    }

    fn obey(&mut self, line: &str) {
        match line.trim() {
            "" => {}
            "version" => self.say(&format!("# motorbench {}, settings 118\r\nok\r\n", self.version)),
            "stream binary" => {
                self.binary = true;
                self.say("ok\r\n");
            }
            "stream off" => {
                self.binary = false;
                self.say("ok\r\n");
            }
            line if line.starts_with("sequence") => {
                self.playing = TICKS;
                self.say("ok\r\n");
            }
            "show trip_peak" => {
                let trip_peak = Settings::defaults().get(Param::TripPeak);
                self.say(&format!("# trip_peak {trip_peak} A 0.05..7.999, over-current, for 5 ms\r\nok\r\n"));
            }
            "show" => {
                let settings = Settings::defaults();
                let line = |param: &Param| format!("# {} {} unit\r\n", setting_name(*param), settings.get(*param));
                let lines: String = Param::ALL.iter().map(line).collect();
                if self.fault == Fault::BusyListing {
                    self.tick += LISTING_TICKS;
                }
                self.say(&(lines + "ok\r\n"));
            }
            // Nothing had changed, so the save ends at once.
            "save" => self.say("ok\r\n# saved\r\n"),
            "nonsense" => self.say("error: unknown command, see help\r\n"),
            _ => self.say("ok\r\n"),
        }
    }
}

impl Line for Fake {
    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if matches!(self.fault, Fault::UnpluggedAfter(after) if self.played > after) {
            return Err(io::ErrorKind::BrokenPipe.into());
        }
        let silent = matches!(self.fault, Fault::SilentAfter(after) if self.played > after);
        // A test that waits for an answer by ticks needs all samples so far.
        let is_behind = self.fault == Fault::Bits && self.out.len() > BEHIND;
        if self.binary && !silent && !is_behind {
            (0..5).for_each(|_| self.tick());
        }
        // Pieces of any length, so that frames come in halves.
        let count = buffer.len().min(self.out.len()).min(self.random.random_range(1..200));
        std::thread::sleep(std::time::Duration::from_millis(1));
        for (place, byte) in buffer.iter_mut().zip(self.out.drain(..count)) {
            *place = byte;
        }
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let text = String::from_utf8_lossy(bytes).into_owned();
        self.heard.lock().unwrap().push_str(&text);
        for character in text.chars() {
            match character {
                '\n' => {
                    let line = std::mem::take(&mut self.line);
                    self.obey(&line);
                    self.obeyed.lock().unwrap().push(line);
                }
                '\u{15}' => self.line.clear(),
                other => self.line.push(other),
            }
        }
        Ok(())
    }
}

fn recorded(fault: Fault) -> (Record, Arc<Mutex<String>>) {
    let (fake, heard) = Fake::new(fault);
    let mut link = Link::start(fake).unwrap();
    let record = record(&mut link, Settings::defaults(), "sequence steps 1", &|| false, &mut |_| Ok(()));
    (record, heard)
}

/// An answer belongs to one line, and unasked lines of the board are no answer.
#[test]
fn no_answer_is_missed() {
    let mut link = Link::start(Fake::new(Fault::None).0).unwrap();
    link.save().unwrap();
    assert_eq!(link.ask("version").unwrap().len(), 1);
    let refused = |link: &mut Link<Fake>, line: &str| match link.ask(line) {
        Err(BoardError::Refused { reply, .. }) => reply,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(&mut link, "nonsense"), "error: unknown command, see help");
    for two in ["nonsense\nversion", "nonsense\rversion"] {
        assert!(refused(&mut link, two).starts_with("error: more than one line"));
    }
}

#[test]
fn a_whole_sequence_is_recorded_and_the_drive_disarmed() {
    let (record, heard) = recorded(Fault::None);
    assert_eq!(record.ended, Ended::Complete);
    assert_eq!((record.samples.len(), record.missing_ticks()), (TICKS as usize, 0));
    assert_eq!(record.losses, motorbench_link::Losses::default());
    assert!(heard.lock().unwrap().contains("disarm"));
}

#[test]
fn an_unplugged_cable_ends_the_recording_and_keeps_it() {
    let (record, _) = recorded(Fault::UnpluggedAfter(200));
    assert!(matches!(&record.ended, Ended::Failed(why) if why.contains("connection is gone")), "{:?}", record.ended);
    // All samples that the program had read, except the frame in which the cable was unplugged.
    assert!(record.samples.len() > 100, "{}", record.samples.len());
}

#[test]
fn a_reset_is_seen_by_its_ticks() {
    let (record, _) = recorded(Fault::ResetAfter(200));
    assert!(matches!(&record.ended, Ended::Failed(why) if why.contains("reset")), "{:?}", record.ended);
    assert!(record.samples.len() > 100, "{}", record.samples.len());
}

#[test]
fn a_trip_ends_the_recording_and_is_in_it() {
    let (record, heard) = recorded(Fault::TripAfter(200));
    assert_eq!(record.ended, Ended::Tripped(Trip::Stall));
    assert_eq!(record.samples.last().unwrap().trip, Trip::Stall);
    assert!(heard.lock().unwrap().contains("disarm"));
}

/// Every frame that a flipped byte destroys is counted, and its tick is missing.
#[test]
fn flipped_bytes_are_counted() {
    let (record, _) = recorded(Fault::Noise);
    assert_eq!(record.ended, Ended::Complete);
    assert!(record.losses.damaged_frames > 50, "{:?}", record.losses);
    assert!(record.losses.damaged_frames <= record.losses.lost_frames, "{:?}", record.losses);
    assert!(record.missing_ticks() > 50);
    assert!(record.samples.windows(2).all(|pair| pair[1].tick > pair[0].tick));
}

/// Each settings list loses hardly one line in ten, but no list comes complete. Answers are lost as well.
#[test]
fn a_line_that_damages_some_frames_is_no_reason_to_give_up() {
    for seed in 0..8 {
        let (mut fake, heard) = Fake::new(Fault::Bits);
        fake.random = ChaCha8Rng::seed_from_u64(seed);
        let mut link = Link::start(fake).unwrap();
        assert_eq!(link.settings().unwrap().values, Settings::defaults().values);
        assert_eq!(link.shows("trip_peak").unwrap(), Some(Settings::defaults().get(Param::TripPeak)));
        let record = record(&mut link, Settings::defaults(), "sequence steps 1", &|| false, &mut |_| Ok(()));
        assert_eq!(record.ended, Ended::Complete);
        assert!(
            record.losses.lost_frames >= record.missing_ticks() && record.missing_ticks() > 0,
            "{:?}",
            record.losses
        );
        let heard = heard.lock().unwrap();
        assert_eq!(heard.matches("sequence").count(), 1, "it is not begun anew");
        assert!(heard.contains("disarm"));
    }
}

/// Frame numbers start again after 256.
#[test]
fn a_thousand_lost_frames_are_a_thousand() {
    let (record, _) = recorded(Fault::Gap);
    assert_eq!((record.losses.lost_frames, record.missing_ticks()), (LOST, LOST));
    assert_eq!(record.losses.damaged_frames, 4);
}

#[test]
fn a_telemetry_that_stops_is_an_error_and_not_a_wait() {
    let (record, _) = recorded(Fault::SilentAfter(200));
    assert!(matches!(&record.ended, Ended::Failed(why) if why.contains("telemetry stopped")), "{:?}", record.ended);
}

#[test]
fn the_user_stops_a_recording() {
    let (fake, heard) = Fake::new(Fault::None);
    let mut link = Link::start(fake).unwrap();
    let record = record(&mut link, Settings::defaults(), "sequence steps 1", &|| true, &mut |_| Ok(()));
    assert_eq!(record.ended, Ended::Interrupted);
    let heard = heard.lock().unwrap();
    assert!(heard.find("stop").unwrap() < heard.rfind("disarm").unwrap());
}

#[test]
fn what_a_program_that_died_has_typed_is_forgotten() {
    let (mut fake, _) = Fake::new(Fault::None);
    fake.line = "set trip_peak 7".into();
    let obeyed = Arc::clone(&fake.obeyed);
    drop(Link::start(fake).unwrap());
    let obeyed = obeyed.lock().unwrap();
    assert_eq!(obeyed[..4], ["", "stream off", "echo off", "version"]);
    assert!(obeyed.iter().all(|line| !line.contains("trip_peak")), "{obeyed:?}");
}

#[test]
fn a_firmware_of_another_version_is_refused() {
    let (mut fake, _) = Fake::new(Fault::None);
    fake.version = "0.0.1";
    let Err(BoardError::Failed(why)) = Link::start(fake) else { panic!("it was taken") };
    assert!(why.contains("0.0.1") && why.contains(VERSION) && why.contains("flash"), "{why}");
}

#[test]
fn a_refusal_says_what_the_board_said() {
    let (fake, _) = Fake::new(Fault::None);
    let mut link = Link::start(fake).unwrap();
    let Err(BoardError::Refused { line, reply }) = link.command("nonsense") else { panic!("it was taken") };
    assert_eq!((line.as_str(), reply.as_str()), ("nonsense", "error: unknown command, see help"));
}

#[test]
fn dropping_the_link_disarms() {
    let (fake, heard) = Fake::new(Fault::None);
    drop(Link::start(fake).unwrap());
    assert!(heard.lock().unwrap().ends_with("disarm\nstream off\necho on\n"));
}

/// A plotter gets the same samples as the tuning console, at the times of the board's ticks, without gaps.
#[test]
fn tuning_is_sent_to_a_plotter() {
    let plotter = UdpSocket::bind("127.0.0.1:0").unwrap();
    plotter.set_read_timeout(Some(std::time::Duration::from_secs(5))).unwrap();
    let live = Live::new(plotter.local_addr().ok(), None).unwrap();
    let (fake, _) = Fake::new(Fault::None);
    let mut session = Session::new(Link::start(fake).unwrap(), 30.0, Some(live), Box::new(Shared::default())).unwrap();
    session.poll().unwrap();
    let (mut buffer, mut ticks) = ([0; 1024], Vec::new());
    while ticks.len() < 20 {
        let length = plotter.recv(&mut buffer).unwrap();
        let object: serde_json::Value = serde_json::from_slice(&buffer[..length]).unwrap();
        ticks.push((object["timestamp"].as_f64().unwrap() * 1000.0).round() as u32);
    }
    assert!(ticks[0] > 1000 && ticks.windows(2).all(|pair| pair[1] == pair[0] + 1), "{ticks:?}");
}

/// Recordings of a session.
#[derive(Clone, Default)]
struct Shared {
    /// Samples that were stored during the recordings.
    grown: Arc<Mutex<Vec<Sample>>>,
    ended: Arc<Mutex<Vec<(Record, Settings)>>>,
    /// There is no room for any sample.
    full: bool,
}

impl RecordingStore for Shared {
    fn begin(&mut self, _: &Settings, _firmware: &str) -> Result<(), String> {
        Ok(())
    }

    fn grow(&mut self, samples: &[Sample], _: &Settings) -> Result<(), String> {
        self.grown.lock().unwrap().extend(samples);
        if self.full { Err("the disk is full".into()) } else { Ok(()) }
    }

    fn keep(&mut self, record: &Record, before: &Settings, _firmware: &str) -> StoredRecording {
        self.ended.lock().unwrap().push((record.clone(), *before));
        StoredRecording { text: "kept".into(), file: Some("kept.csv".into()), is_whole: true }
    }
}

/// The recording has every tick, whatever is typed meanwhile, and the gains before and after. If the board is gone, it
/// ends without losses.
#[test]
fn a_recording_out_of_the_tuning_console() {
    let (kept, (fake, _)) = (Shared::default(), Fake::new(Fault::None));
    let mut session = Session::new(Link::start(fake).unwrap(), 30.0, None, Box::new(kept.clone())).unwrap();
    let mut press = |key| {
        session.poll().unwrap();
        session.press(key).unwrap();
    };
    [Key::Record, Key::Arm, Key::More, Key::Record, Key::Stop].into_iter().for_each(&mut press);
    session.press(Key::Record).unwrap();
    session.poll().unwrap();
    let gone = BoardError::Failed("the cable".into());
    assert_eq!(session.end_recording(Some(&gone)).map(|kept| kept.text).as_deref(), Some("kept"));
    assert!(session.end_recording(None).is_none(), "it is kept once");
    let grown = kept.grown.lock().unwrap();
    let kept = kept.ended.lock().unwrap();
    let [(first, before), (second, _)] = &kept[..] else { panic!("two recordings") };
    assert!(first.samples.len() > 20 && first.samples.windows(2).all(|pair| pair[1].tick == pair[0].tick + 1));
    assert_eq!((first.missing_ticks(), &first.ended), (0, &Ended::Complete));
    assert!(first.settings.get(Param::SpeedKp) > before.get(Param::SpeedKp));
    assert_eq!(second.ended, Ended::Failed("the cable".into()));
    assert_eq!(*grown, [&first.samples[..], &second.samples].concat(), "kept as it came");
}

/// Pressed as soon as the console is ready.
#[test]
fn a_recording_out_of_the_tuning_console_begins_when_it_is_asked_for() {
    let (kept, (fake, _)) = (Shared::default(), Fake::new(Fault::BusyListing));
    let mut session = Session::new(Link::start(fake).unwrap(), 30.0, None, Box::new(kept.clone())).unwrap();
    [Key::Record, Key::Arm, Key::Stop, Key::Record].into_iter().for_each(|key| session.press(key).unwrap());
    let kept = kept.ended.lock().unwrap();
    let [(record, _)] = &kept[..] else { panic!("{} recordings", kept.len()) };
    assert!(!record.samples.is_empty());
    assert_eq!(record.missing_ticks(), 0);
}

#[test]
fn a_full_disk_ends_the_recording_of_the_tuning_console_and_not_the_session() {
    let (kept, (fake, _)) = (Shared { full: true, ..Shared::default() }, Fake::new(Fault::None));
    let mut session = Session::new(Link::start(fake).unwrap(), 30.0, None, Box::new(kept.clone())).unwrap();
    session.press(Key::Record).unwrap();
    (0..3).for_each(|_| session.poll().unwrap());
    let kept = kept.ended.lock().unwrap();
    let [(record, _)] = &kept[..] else { panic!("{} recordings", kept.len()) };
    assert_eq!(record.ended, Ended::Failed("the disk is full".into()));
    assert!(session.end_recording(None).is_none(), "it has ended");
    session.press(Key::More).unwrap();
    assert_eq!(
        session.account(Ended::Complete).ended,
        Ended::Failed("the disk is full; kept".into()),
        "it is not forgotten"
    );
}
