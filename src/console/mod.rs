//! The console: lines in, replies out, for a person at any terminal and for a program.
//!
//! A reply is any number of information lines that begin with `# `, then exactly one line that begins with `ok` or with
//! `error: `. Values are in engineering units: volts, amperes, rad/s, rad, ms. Only whole, exact command words count;
//! a line with anything but printable ASCII is refused. The console knows the hardware only as a [`Machine`].

mod line;
pub mod number;

use crate::excitation::{Kind, Sequence};
use crate::flash_text::{self, flash_texts};
use crate::message::{Mode, Request, Sample, State, Trip};
use crate::pins::PWM_STEPS;
use crate::protocol::{self, FRAME, Framer, TEXT_CHUNK};
use crate::settings::{self, BuildError, Param, Settings, Text};
use crate::storage::{self, Eeprom, Saver};
use crate::units::{AMPERE, FULL_RANGE, Rule, VOLT};
use line::{Edit, LineEditor, Words};
use ufmt::{uWrite, uwrite};

/// What the console can do to the machine: over interrupts on the Uno, over a plain control loop on the host.
pub trait Machine {
    /// Where the settings are kept.
    type Memory: Eeprom;
    /// Posts a request and returns when the tick has taken it.
    fn request(&mut self, request: Request);
    /// The latest sample.
    fn sample(&mut self) -> Sample;
    /// Builds the configuration and lets it take effect at one tick boundary.
    ///
    /// # Errors
    /// The setting that does not fit its fixed-point format; nothing has changed then.
    fn configure(&mut self, settings: &Settings) -> Result<(), BuildError>;
    /// Counters and states that are not part of a sample.
    fn counters(&mut self) -> Counters;
    /// The memory of the settings.
    fn memory(&mut self) -> &mut Self::Memory;
    /// Sends bytes; waits until all are on their way.
    fn send(&mut self, bytes: &[u8]);
    /// The host has said something valid.
    fn host_spoke(&mut self);
}

/// What `status` shows beside the sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Illegal transitions of the encoder.
    pub illegal_transitions: u16,
    /// Received bytes that were lost.
    pub overruns: u8,
    /// Samples the main loop could not take in time.
    pub dropped: u16,
    /// Why the chip was reset.
    pub reset_cause: ResetCause,
    /// A zero calibration of the current is running.
    pub zeroing: bool,
    /// The last zero calibration succeeded.
    pub zero_ok: bool,
}

/// Why the chip was reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum ResetCause {
    /// The bootloader has taken the flags with it.
    #[default]
    Unknown = 0,
    /// Power came on.
    PowerOn = 1,
    /// The reset button, or the host opened the port.
    External = 2,
    /// The supply of the board broke down.
    BrownOut = 3,
    /// The watchdog: interrupts had stopped.
    Watchdog = 4,
    /// The main loop hung; the tick switched the drive off.
    MainLoopHung = 5,
    /// The program panicked; it switched the drive off.
    Panic = 6,
}

macro_rules! commands {
    ($($variant:ident $name:literal $arguments:literal $help:literal;)*) => {
        /// The commands.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u8)]
        enum Command { $($variant),* }

        const COMMANDS: &[Command] = &[$(Command::$variant),*];
        const COMMAND_COUNT: usize = COMMANDS.len();
        flash_texts!(COMMAND_TEXT, COMMAND_TEXT_LENGTH, $($name, $arguments, $help),*);

        impl Command {
            fn from_index(index: u8) -> Option<Self> {
                $(if index == Command::$variant as u8 { return Some(Command::$variant); })*
                None
            }
        }
    };
}

commands! {
    Help "help" "" "this list";
    Status "status" "" "state, measurements, counters";
    Arm "arm" "" "allow the drive; mode is off";
    Disarm "disarm" "" "bridge off, motor coasts";
    Stop "stop" "" "mode off, motor brakes, stays armed";
    Mode "mode" "off|open|speed|position|lqr_speed|lqr_position" "who sets the voltage";
    Reference "ref" "VALUE" "V (open), rad/s (speed) or rad (position)";
    Show "show" "[NAME]" "settings with unit and range";
    Set "set" "NAME VALUE [NAME VALUE ...]" "change settings, all or none, at one tick";
    Zero "zero" "current|position" "take the present value as zero";
    Sequence "sequence" "KIND AMPLITUDE [OFFSET PERIOD_ms COUNT SEED]" "play steps ramp stairs prbs levels chirp coast identify";
    Stream "stream" "off|text|binary [DIVIDER]" "telemetry, every DIVIDERth tick";
    Record "record" "KIND AMPLITUDE [...]" "a sequence with a binary stream around it";
    Save "save" "" "settings to EEPROM";
    Load "load" "" "settings from EEPROM";
    Defaults "defaults" "" "settings as delivered";
    Clear "clear" "" "forget a trip";
    Alive "alive" "" "keep-alive, see trip_host";
    Echo "echo" "on|off" "repeat what is typed";
    Version "version" "" "firmware and protocol";
}

flash_texts!(
    WORDS,
    WORDS_LENGTH,
    "off",
    "open",
    "speed",
    "position",
    "lqr_speed",
    "lqr_position",
    "steps",
    "ramp",
    "stairs",
    "prbs",
    "levels",
    "chirp",
    "coast",
    "identify",
    "none",
    "over-current, peak",
    "over-current, thermal",
    "stall: driven, not turning",
    "encoder silent: driven, no counts and no stall current (encoder or motor wire)",
    "runaway: speeding up against the drive (wrong feedback sign)",
    "current signal at a rail (sensor or wire)",
    "supply out of range",
    "emergency stop",
    "host silent",
    "main loop hung",
    "unknown",
    "power on",
    "external (button or port opened)",
    "brown-out",
    "watchdog: interrupts had stopped",
    "main loop hung",
    "panic",
    "is below its range",
    "would round to zero in fixed point",
    "must be a power of two",
    "must be a number",
    "is too large for fixed point (see the ranges)",
    "is not an allowed value",
    "current",
    "on",
    "text",
    "binary"
);
/// Places in the table above.
const MODES: usize = 0;
const KINDS: usize = 6;
const TRIPS: usize = 14;
const RESETS: usize = 25;
const RULES: usize = 32;
const CURRENT: usize = 38;
const ON: usize = 39;
const TEXT: usize = 40;
const BINARY: usize = 41;

macro_rules! sayings {
    ($($name:ident $text:literal;)*) => {
        /// What the console says, by name.
        #[derive(Clone, Copy)]
        #[repr(u8)]
        enum Say { $($name),* }

        flash_texts!(SAYINGS, SAYINGS_LENGTH, $($text),*);
    };
}

sayings! {
    UnknownCommand "unknown command, see help";
    LineRefused "line refused: more than 96 characters or not plain ASCII";
    Expected "expected ";
    NoSuchSetting "no such setting, see show";
    TripLatched "a trip is latched, see status; clear it first";
    NotArmed "not armed: arm first";
    EmergencyStop "emergency stop is pressed";
    DisarmFirst "disarm first";
    SaveRunning "save still running";
    NothingSaved "nothing saved that this version understands";
    ExpectedNumber "expected a number in ";
    NoReference "no reference in mode off: choose a mode";
    ZeroRefused "zero refused: a current flows, or no sensor";
    Name "motorbench ";
    Mode "mode ";
    Armed "armed ";
    Trip " trip ";
    Reference "reference ";
    Position "position ";
    Speed " rad, speed ";
    Current " rad/s, current ";
    Duty " A, duty ";
    Supply " %, supply ";
    Volt " V";
    Illegal "illegal transitions ";
    Overruns ", serial overruns ";
    Dropped ", dropped samples ";
    Reset "reset: ";
    Done "done: ";
    SamplesDropped " samples, dropped ";
    Ticks " ticks";
    PlotReference "reference:";
    PlotSpeed ",speed:";
    PlotCurrent ",current:";
    PlotDuty ",duty:";
    PlotPosition ",position:";
    Error "error: ";
    Ok "ok";
    Settings ", settings ";
    Saved "saved";
}

/// Why a command was not carried out.
enum Failure {
    /// A sentence.
    Say(Say),
    /// The command's arguments are not of its form.
    Usage(Command),
    /// A number outside the range of a setting.
    Range(Param),
    /// A number outside +- this range.
    Limit(f32),
    /// A setting the fixed-point formats cannot hold.
    Build(BuildError),
}

type Outcome = Result<(), Failure>;

/// What is streamed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stream {
    Off,
    Text,
    Binary,
}

/// The console's memory.
pub struct Console {
    editor: LineEditor,
    settings: Settings,
    framer: Framer,
    saver: Option<Saver>,
    stream: Stream,
    echo: bool,
    divider: u8,
    countdown: u8,
    /// A recording runs; samples sent so far, and the drop counter when it began.
    recording: bool,
    recorded: u32,
    dropped: u16,
}

impl Console {
    /// With the settings in force.
    pub fn new(settings: Settings) -> Self {
        Self {
            editor: LineEditor::default(),
            settings,
            framer: Framer::default(),
            saver: None,
            stream: Stream::Off,
            echo: true,
            divider: 1,
            countdown: 0,
            recording: false,
            recorded: 0,
            dropped: 0,
        }
    }

    /// The settings in force.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Greets after a reset: version and reset cause.
    pub fn greet(&mut self, machine: &mut impl Machine) {
        let _ = self.version(machine);
    }

    /// Takes a received byte; carries out a line that it completes.
    #[inline(never)]
    pub fn receive(&mut self, byte: u8, machine: &mut impl Machine) {
        let edit = self.editor.push(byte);
        let echo = self.echo && self.stream != Stream::Binary;
        match edit {
            Edit::Complete | Edit::Refused => {
                if echo {
                    machine.send(b"\r\n");
                }
                self.finish(edit == Edit::Refused, machine);
                self.editor.clear();
            }
            Edit::Added(byte) if echo => machine.send(&[byte]),
            Edit::Erased if echo => machine.send(b"\x08 \x08"),
            Edit::Cleared(count) if echo => (0..count).for_each(|_| machine.send(b"\x08 \x08")),
            _ => {}
        }
    }

    /// Goes on with what takes time: a save.
    #[inline(never)]
    pub fn poll(&mut self, machine: &mut impl Machine) {
        if let Some(saver) = &mut self.saver
            && saver.poll(machine.memory(), &self.settings)
        {
            self.saver = None;
            self.info(machine, |talk, _| talk.say(Say::Saved));
        }
    }

    /// Streams a sample, if that is wanted.
    #[inline(never)]
    pub fn telemetry(&mut self, sample: &Sample, machine: &mut impl Machine) {
        if self.stream == Stream::Off {
            return;
        }
        if self.recording && !sample.state.has(State::PLAYING) && self.recorded > 0 {
            return self.end_recording(machine);
        }
        if self.countdown > 1 {
            self.countdown -= 1;
            return;
        }
        self.countdown = self.divider;
        if self.stream == Stream::Text {
            return self.plot(sample, machine);
        }
        self.recorded += 1;
        let mut frame = [0; FRAME];
        let length = self.framer.frame(protocol::SAMPLE, &protocol::pack(sample), &mut frame);
        machine.send(frame.get(..length).unwrap_or(&[]));
    }

    /// A line for the Arduino Serial Plotter.
    #[inline(never)]
    fn plot(&mut self, sample: &Sample, machine: &mut impl Machine) {
        let settings = self.settings;
        let mut talk = Talk::new(machine, None);
        talk.say(Say::PlotReference);
        talk.number(reference_value(sample, &settings));
        talk.say(Say::PlotPosition);
        talk.number(position_rad(sample.counts, &settings));
        talk.say(Say::PlotSpeed);
        talk.number(speed_rad_per_s(sample.speed, &settings));
        talk.say(Say::PlotCurrent);
        talk.number(sample.current as f32 / AMPERE);
        talk.say(Say::PlotDuty);
        talk.number(duty_percent(sample.duty));
        talk.end_line();
    }

    /// The sequence is over: back to text, and the count.
    #[inline(never)]
    fn end_recording(&mut self, machine: &mut impl Machine) {
        let dropped = machine.counters().dropped.wrapping_sub(self.dropped);
        let recorded = self.recorded;
        self.info(machine, |talk, _| {
            talk.say(Say::Done);
            talk.whole(recorded);
            talk.say(Say::SamplesDropped);
            talk.whole(dropped as u32);
        });
        self.recording = false;
        self.stream = Stream::Off;
    }

    /// Carries out the line and closes the reply.
    #[inline(never)]
    fn finish(&mut self, refused: bool, machine: &mut impl Machine) {
        if !refused && Words(self.editor.line()).next().is_none() {
            return;
        }
        let editor = self.editor.clone();
        let outcome = if refused { Err(Failure::Say(Say::LineRefused)) } else { self.execute(editor.line(), machine) };
        let framer = if self.stream == Stream::Binary { Some(&mut self.framer) } else { None };
        let mut talk = Talk::new(machine, framer);
        match outcome {
            Ok(()) => talk.say(Say::Ok),
            Err(failure) => {
                talk.say(Say::Error);
                talk.failure(&failure);
            }
        }
        talk.end_line();
    }

    #[inline(never)]
    fn execute(&mut self, line: &[u8], machine: &mut impl Machine) -> Outcome {
        let mut words = Words(line);
        let name = words.next().unwrap_or(&[]);
        let command = (0..COMMAND_COUNT)
            .find(|&index| same(command_text(index, 0), name))
            .and_then(|index| Command::from_index(index as u8))
            .ok_or(Failure::Say(Say::UnknownCommand))?;
        machine.host_spoke();
        let arguments = words;
        let first = words.next();
        // Commands without arguments must have none.
        if first.is_some() && command_text(command as usize, 1).next().is_none() {
            return Err(Failure::Usage(command));
        }
        match command {
            Command::Help => self.help(machine),
            Command::Status => self.status(machine),
            Command::Arm => arm(machine),
            Command::Disarm => self.order(Request::Disarm, machine),
            Command::Stop => self.order(Request::Stop, machine),
            Command::Clear => self.order(Request::ClearTrip, machine),
            Command::Mode => self.mode(first, machine),
            Command::Reference => self.reference(first, machine),
            Command::Show => self.show(first, machine),
            Command::Set => self.set(arguments, machine),
            Command::Zero => zero(first, machine),
            Command::Sequence => self.sequence(arguments, command, machine),
            Command::Record => self.record(arguments, machine),
            Command::Stream => self.stream(first, words.next(), machine),
            Command::Save => self.save(machine),
            Command::Load => self.load(machine),
            Command::Defaults => self.replace(Settings::defaults(), machine),
            Command::Alive => Ok(()),
            Command::Echo => self.echo(first),
            Command::Version => self.version(machine),
        }
    }

    #[inline(never)]
    fn order(&mut self, request: Request, machine: &mut impl Machine) -> Outcome {
        machine.request(request);
        Ok(())
    }

    /// Prints an information line.
    #[inline(never)]
    fn info<M: Machine>(&mut self, machine: &mut M, line: impl FnOnce(&mut Talk<M>, &Settings)) {
        let framer = if self.stream == Stream::Binary { Some(&mut self.framer) } else { None };
        let mut talk = Talk::new(machine, framer);
        talk.byte(b'#');
        talk.byte(b' ');
        line(&mut talk, &self.settings);
        talk.end_line();
    }

    #[inline(never)]
    fn help(&mut self, machine: &mut impl Machine) -> Outcome {
        for index in 0..COMMAND_COUNT {
            self.info(machine, |talk, _| {
                for part in 0..3 {
                    talk.text(command_text(index, part));
                    talk.byte(b' ');
                    if part == 1 {
                        talk.byte(b'-');
                        talk.byte(b' ');
                    }
                }
            });
        }
        Ok(())
    }

    #[inline(never)]
    fn version(&mut self, machine: &mut impl Machine) -> Outcome {
        let cause = machine.counters().reset_cause;
        self.info(machine, |talk, _| {
            talk.say(Say::Name);
            talk.text(flash_text::text::<VERSION_LENGTH>(|at| VERSION.load_at(at), 0));
            talk.say(Say::Settings);
            talk.whole(storage::VERSION as u32);
        });
        self.info(machine, |talk, _| {
            talk.say(Say::Reset);
            talk.word(RESETS + cause as usize);
        });
        Ok(())
    }

    #[inline(never)]
    fn status(&mut self, machine: &mut impl Machine) -> Outcome {
        let sample = machine.sample();
        let counters = machine.counters();
        self.info(machine, |talk, _| {
            talk.say(Say::Mode);
            talk.word(MODES + sample.state.mode() as usize);
            talk.byte(b' ');
            talk.say(Say::Armed);
            talk.whole(sample.state.has(State::ARMED) as u32);
            talk.say(Say::Trip);
            talk.whole(sample.trip as u32);
            talk.byte(b' ');
            talk.word(TRIPS + sample.trip as usize);
        });
        self.info(machine, |talk, settings| {
            talk.say(Say::Reference);
            talk.number(reference_value(&sample, settings));
            talk.byte(b' ');
            talk.say(Say::Position);
            talk.number(position_rad(sample.counts, settings));
            talk.say(Say::Speed);
            talk.number(speed_rad_per_s(sample.speed, settings));
            talk.say(Say::Current);
            talk.number(sample.current as f32 / AMPERE);
            talk.say(Say::Duty);
            talk.number(duty_percent(sample.duty));
            talk.say(Say::Supply);
            talk.number(sample.supply as f32 / VOLT);
            talk.say(Say::Volt);
        });
        self.info(machine, |talk, _| {
            talk.say(Say::Illegal);
            talk.whole(counters.illegal_transitions as u32);
            talk.say(Say::Overruns);
            talk.whole(counters.overruns as u32);
            talk.say(Say::Dropped);
            talk.whole(counters.dropped as u32);
            talk.byte(b',');
            talk.byte(b' ');
            talk.say(Say::Reset);
            talk.word(RESETS + counters.reset_cause as usize);
        });
        Ok(())
    }

    #[inline(never)]
    fn mode(&mut self, word: Option<&[u8]>, machine: &mut impl Machine) -> Outcome {
        let number = word.and_then(|word| (0..6u8).find(|&mode| same(word_text(MODES + mode as usize), word)));
        let mode = number.and_then(Mode::from_number).ok_or(Failure::Usage(Command::Mode))?;
        if mode != Mode::Off && !machine.sample().state.has(State::ARMED) {
            return Err(Failure::Say(Say::NotArmed));
        }
        self.order(Request::Mode(mode), machine)
    }

    #[inline(never)]
    fn reference(&mut self, word: Option<&[u8]>, machine: &mut impl Machine) -> Outcome {
        let value = word.and_then(number::parse).ok_or(Failure::Usage(Command::Reference))?;
        let bits = self.in_bits(value, machine.sample().state.mode())?;
        self.order(Request::Reference(bits), machine)
    }

    /// A value in the unit of the mode, as the tick takes it.
    #[inline(never)]
    fn in_bits(&self, value: f32, mode: Mode) -> Result<i32, Failure> {
        let (unit, limit) = if mode == Mode::OpenLoop {
            (VOLT, 32767.0)
        } else if mode.is_speed() {
            (FULL_RANGE / self.settings.get(Param::SpeedRange), 32767.0)
        } else if mode.is_position() {
            (self.settings.get(Param::CountsPerRev) / core::f32::consts::TAU, 1e9)
        } else {
            return Err(Failure::Say(Say::NoReference));
        };
        let bits = value * unit;
        if bits > limit || bits < -limit {
            return Err(Failure::Limit(limit / unit));
        }
        Ok((if bits < 0.0 { bits - 0.5 } else { bits + 0.5 }) as i32)
    }

    #[inline(never)]
    fn show(&mut self, word: Option<&[u8]>, machine: &mut impl Machine) -> Outcome {
        let only = match word {
            Some(word) => Some(find_setting(word)?),
            None => None,
        };
        for index in 0..Param::COUNT {
            let Some(param) = Param::from_index(index) else { continue };
            if only.is_none_or(|only| only == param) {
                self.info(machine, |talk, settings| {
                    talk.text(settings::text(param, Text::Name));
                    talk.byte(b' ');
                    talk.number(settings.get(param));
                    talk.byte(b' ');
                    talk.range(param);
                    talk.byte(b',');
                    talk.byte(b' ');
                    talk.text(settings::text(param, Text::Help));
                });
            }
        }
        Ok(())
    }

    #[inline(never)]
    fn set(&mut self, mut words: Words, machine: &mut impl Machine) -> Outcome {
        let mut settings = self.settings;
        let mut any = false;
        while let Some(name) = words.next() {
            let param = find_setting(name)?;
            let value = words.next().and_then(number::parse).ok_or(Failure::Range(param))?;
            settings.set(param, value).map_err(|_| Failure::Range(param))?;
            any = true;
        }
        if any { self.replace(settings, machine) } else { Err(Failure::Usage(Command::Set)) }
    }

    /// Takes new settings as a whole, or not at all.
    #[inline(never)]
    fn replace(&mut self, settings: Settings, machine: &mut impl Machine) -> Outcome {
        if self.saver.is_some() {
            return Err(Failure::Say(Say::SaveRunning));
        }
        let rig = [Param::CountsPerRev, Param::SpeedRange, Param::SpeedSensor, Param::Wiring, Param::TickRate];
        let rig_changes = rig.iter().any(|&param| settings.get(param) != self.settings.get(param));
        if rig_changes && machine.sample().state.has(State::ARMED) {
            return Err(Failure::Say(Say::DisarmFirst));
        }
        machine.configure(&settings).map_err(Failure::Build)?;
        self.settings = settings;
        Ok(())
    }

    #[inline(never)]
    fn sequence(&mut self, mut words: Words, command: Command, machine: &mut impl Machine) -> Outcome {
        let usage = || Failure::Usage(command);
        let word = words.next().ok_or_else(usage)?;
        let kind = (0..Kind::COUNT).find(|&kind| same(word_text(KINDS + kind as usize), word));
        let kind = kind.and_then(Kind::from_number).ok_or_else(usage)?;
        let mode = machine.sample().state.mode();
        let amplitude = words.next().and_then(number::parse).ok_or_else(usage)?;
        let offset = words.next().map_or(Some(0.0), number::parse).ok_or_else(usage)?;
        let period_ms = words.next().map_or(Some(500), number::parse_u16).ok_or_else(usage)?;
        let count = words.next().map_or(Some(1), number::parse_u16).ok_or_else(usage)?;
        let seed = words.next().map_or(Some(1), number::parse_u16).ok_or_else(usage)?;
        let short = |value: f32| {
            let bits = self.in_bits(value, mode)?;
            i16::try_from(bits).map_err(|_| Failure::Limit(value * 32767.0 / bits as f32))
        };
        let (amplitude, offset) = (short(amplitude)?, short(offset)?);
        let ticks = if self.settings.get(Param::TickRate) > 1500.0 { period_ms.saturating_mul(2) } else { period_ms };
        let sequence = Sequence::new(kind, amplitude, offset, ticks, count, seed);
        self.info(machine, |talk, _| {
            talk.whole(sequence.duration_ticks());
            talk.say(Say::Ticks);
        });
        self.order(Request::Play(sequence), machine)
    }

    #[inline(never)]
    fn record(&mut self, words: Words, machine: &mut impl Machine) -> Outcome {
        if machine.sample().state.mode() == Mode::Off {
            return Err(Failure::Say(Say::NoReference));
        }
        self.sequence(words, Command::Record, machine)?;
        (self.stream, self.divider, self.countdown) = (Stream::Binary, 1, 0);
        (self.recording, self.recorded, self.dropped) = (true, 0, machine.counters().dropped);
        Ok(())
    }

    #[inline(never)]
    fn stream(&mut self, word: Option<&[u8]>, divider: Option<&[u8]>, _: &mut impl Machine) -> Outcome {
        let usage = || Failure::Usage(Command::Stream);
        let word = word.ok_or_else(usage)?;
        let (stream, usual) = if same(word_text(MODES), word) {
            (Stream::Off, 1)
        } else if same(word_text(TEXT), word) {
            (Stream::Text, 20)
        } else if same(word_text(BINARY), word) {
            (Stream::Binary, 1)
        } else {
            return Err(usage());
        };
        let divider = divider.map_or(Some(usual), number::parse_u16).ok_or_else(usage)?;
        self.divider = u8::try_from(divider).ok().filter(|&divider| divider > 0).ok_or_else(usage)?;
        (self.stream, self.countdown, self.recording) = (stream, 0, false);
        Ok(())
    }

    #[inline(never)]
    fn save(&mut self, machine: &mut impl Machine) -> Outcome {
        if self.saver.is_some() {
            return Err(Failure::Say(Say::SaveRunning));
        }
        self.saver = Some(Saver::start(machine.memory()));
        Ok(())
    }

    #[inline(never)]
    fn load(&mut self, machine: &mut impl Machine) -> Outcome {
        let settings = storage::load(machine.memory()).ok_or(Failure::Say(Say::NothingSaved))?;
        self.replace(settings, machine)
    }

    #[inline(never)]
    fn echo(&mut self, word: Option<&[u8]>) -> Outcome {
        let word = word.unwrap_or(&[]);
        self.echo = same(word_text(ON), word);
        if self.echo || same(word_text(MODES), word) { Ok(()) } else { Err(Failure::Usage(Command::Echo)) }
    }
}

flash_texts!(VERSION, VERSION_LENGTH, env!("CARGO_PKG_VERSION"));

/// Arms, or says why not.
#[inline(never)]
fn arm(machine: &mut impl Machine) -> Outcome {
    if machine.sample().trip != Trip::None {
        return Err(Failure::Say(Say::TripLatched));
    }
    machine.request(Request::Arm);
    match machine.sample().trip {
        Trip::None => Ok(()),
        Trip::EmergencyStop => Err(Failure::Say(Say::EmergencyStop)),
        _ => Err(Failure::Say(Say::TripLatched)),
    }
}

/// Zero of position or current.
#[inline(never)]
fn zero(word: Option<&[u8]>, machine: &mut impl Machine) -> Outcome {
    let word = word.unwrap_or(&[]);
    let position = same(word_text(MODES + Mode::PositionPid as usize), word);
    if !position && !same(word_text(CURRENT), word) {
        return Err(Failure::Usage(Command::Zero));
    }
    if machine.sample().state.has(State::ARMED) {
        return Err(Failure::Say(Say::DisarmFirst));
    }
    if position {
        machine.request(Request::ZeroPosition);
        return Ok(());
    }
    machine.request(Request::ZeroCurrent);
    while machine.counters().zeroing {
        machine.sample();
    }
    if machine.counters().zero_ok { Ok(()) } else { Err(Failure::Say(Say::ZeroRefused)) }
}

#[inline(never)]
fn find_setting(word: &[u8]) -> Result<Param, Failure> {
    (0..Param::COUNT)
        .filter_map(Param::from_index)
        .find(|&param| same(settings::text(param, Text::Name), word))
        .ok_or(Failure::Say(Say::NoSuchSetting))
}

fn same(text: impl Iterator<Item = u8>, word: &[u8]) -> bool {
    text.eq(word.iter().copied())
}

fn word_text(index: usize) -> impl Iterator<Item = u8> {
    flash_text::text::<WORDS_LENGTH>(|at| WORDS.load_at(at), index)
}

/// Name, arguments (1) or help (2) of a command.
fn command_text(index: usize, part: usize) -> impl Iterator<Item = u8> {
    flash_text::text::<COMMAND_TEXT_LENGTH>(|at| COMMAND_TEXT.load_at(at), index * 3 + part)
}

/// A sample's reference in the unit of its mode.
pub fn reference_value(sample: &Sample, settings: &Settings) -> f32 {
    let mode = sample.state.mode();
    if mode.is_position() {
        position_rad(sample.reference, settings)
    } else if mode.is_speed() {
        sample.reference as f32 * settings.get(Param::SpeedRange) / FULL_RANGE
    } else {
        sample.reference as f32 / VOLT
    }
}

/// Counts in rad.
pub fn position_rad(counts: i32, settings: &Settings) -> f32 {
    counts as f32 * core::f32::consts::TAU / settings.get(Param::CountsPerRev)
}

/// Bits of speed in rad/s.
pub fn speed_rad_per_s(speed: i16, settings: &Settings) -> f32 {
    speed as f32 * settings.get(Param::SpeedRange) / FULL_RANGE
}

/// PWM steps in percent.
pub fn duty_percent(duty: i16) -> f32 {
    duty as f32 * (100.0 / PWM_STEPS as f32)
}

/// Commands and settings as one text, for the host.
#[cfg(not(target_arch = "avr"))]
pub fn reference() -> impl core::fmt::Display {
    Reference
}

#[cfg(not(target_arch = "avr"))]
struct Reference;

#[cfg(not(target_arch = "avr"))]
impl core::fmt::Display for Reference {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        use core::fmt::Write;
        fn put(f: &mut core::fmt::Formatter<'_>, text: impl Iterator<Item = u8>) -> core::fmt::Result {
            text.map(char::from).try_for_each(|character| f.write_char(character))
        }
        writeln!(f, "| command | arguments | what it does |\n|---|---|---|")?;
        for index in 0..COMMAND_COUNT {
            for part in 0..3 {
                write!(f, "| ")?;
                put(f, command_text(index, part).map(|byte| if byte == b'|' { b'/' } else { byte }))?;
                write!(f, " ")?;
            }
            writeln!(f, "|")?;
        }
        writeln!(f, "\n| setting | unit | default | range | what it is |\n|---|---|---|---|---|")?;
        let defaults = Settings::defaults();
        for &param in Param::ALL {
            let (min, max) = param.range();
            write!(f, "| ")?;
            put(f, settings::text(param, Text::Name))?;
            write!(f, " | ")?;
            put(f, settings::text(param, Text::Unit).map(|byte| if byte == b'|' { b'/' } else { byte }))?;
            write!(f, " | {} | {min}..{max} | ", defaults.get(param))?;
            put(f, settings::text(param, Text::Help))?;
            writeln!(f, " |")?;
        }
        Ok(())
    }
}

/// Writes text as it is, or in frames while the binary stream is on.
struct Talk<'a, M: Machine> {
    machine: &'a mut M,
    framer: Option<&'a mut Framer>,
    chunk: [u8; TEXT_CHUNK],
    length: u8,
}

impl<'a, M: Machine> Talk<'a, M> {
    fn new(machine: &'a mut M, framer: Option<&'a mut Framer>) -> Self {
        Self { machine, framer, chunk: [0; TEXT_CHUNK], length: 0 }
    }

    #[inline(never)]
    fn byte(&mut self, byte: u8) {
        if let Some(place) = self.chunk.get_mut(self.length as usize) {
            *place = byte;
            self.length += 1;
        }
        if self.length as usize == TEXT_CHUNK {
            self.flush();
        }
    }

    #[inline(never)]
    fn flush(&mut self) {
        let text = self.chunk.get(..self.length as usize).unwrap_or(&[]);
        match &mut self.framer {
            None => self.machine.send(text),
            Some(framer) => {
                let mut frame = [0; FRAME];
                let length = framer.frame(protocol::TEXT, text, &mut frame);
                self.machine.send(frame.get(..length).unwrap_or(&[]));
            }
        }
        self.length = 0;
    }

    #[inline(never)]
    fn end_line(&mut self) {
        self.byte(b'\r');
        self.byte(b'\n');
        if self.length > 0 {
            self.flush();
        }
    }

    fn text(&mut self, text: impl Iterator<Item = u8>) {
        text.for_each(|byte| self.byte(byte));
    }

    #[inline(never)]
    fn say(&mut self, what: Say) {
        self.text(flash_text::text::<SAYINGS_LENGTH>(|at| SAYINGS.load_at(at), what as usize));
    }

    #[inline(never)]
    fn word(&mut self, index: usize) {
        self.text(word_text(index));
    }

    #[inline(never)]
    fn number(&mut self, value: f32) {
        let _ = number::write(self, value);
    }

    #[inline(never)]
    fn whole(&mut self, value: u32) {
        let _ = uwrite!(self, "{}", value);
    }

    /// `[unit] min..max`.
    #[inline(never)]
    fn range(&mut self, param: Param) {
        let (min, max) = param.range();
        self.text(settings::text(param, Text::Unit));
        self.byte(b' ');
        self.number(min);
        self.byte(b'.');
        self.byte(b'.');
        self.number(max);
    }

    /// What was expected.
    #[inline(never)]
    fn failure(&mut self, failure: &Failure) {
        match failure {
            Failure::Say(what) => self.say(*what),
            Failure::Usage(command) => {
                self.say(Say::Expected);
                self.text(command_text(*command as usize, 0));
                self.byte(b' ');
                self.text(command_text(*command as usize, 1));
            }
            Failure::Range(param) => {
                self.text(settings::text(*param, Text::Name));
                self.byte(b' ');
                self.say(Say::ExpectedNumber);
                self.range(*param);
            }
            Failure::Limit(limit) => {
                self.say(Say::ExpectedNumber);
                self.number(-limit);
                self.byte(b'.');
                self.byte(b'.');
                self.number(*limit);
            }
            Failure::Build(error) => self.build_error(error),
        }
    }

    #[inline(never)]
    fn build_error(&mut self, error: &BuildError) {
        self.text(settings::text(error.param, Text::Name));
        self.byte(b' ');
        self.word(RULES + rule_place(error.rule));
    }
}

/// The sentence of a rule, by its place in the table.
fn rule_place(rule: Rule) -> usize {
    match rule {
        Rule::TooSmall => 0,
        Rule::RoundsToZero => 1,
        Rule::NotPowerOfTwo => 2,
        Rule::NotFinite => 3,
        Rule::TooLarge => 4,
        Rule::NotAllowed => 5,
    }
}

impl<M: Machine> uWrite for Talk<'_, M> {
    type Error = core::convert::Infallible;

    fn write_str(&mut self, text: &str) -> Result<(), Self::Error> {
        text.bytes().for_each(|byte| self.byte(byte));
        Ok(())
    }
}
