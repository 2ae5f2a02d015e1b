//! The console: lines in, replies out, for a person at any terminal and for a program.
//!
//! A reply is any number of information lines that begin with `# `, then exactly one line that begins with `ok` or with
//! `error: `. Values are in engineering units: volts, amperes, rad/s, rad, ms. Only whole, exact command words count;
//! a line with anything but printable ASCII is refused. The console knows the hardware only as a [`Machine`].
//!
//! Everything the console says stands in flash, as texts in which `%` and a letter stand for a value (see
//! `Console::field`). What a command expects is read from the text that `help` shows for it.

mod commands;
mod line;
mod machine;
pub mod number;
#[cfg(not(target_arch = "avr"))]
mod reference;
mod texts;

#[cfg(not(target_arch = "avr"))]
pub use reference::{explanation, reference};

use crate::HARDWARE;
use crate::arith::whole;
use crate::excitation::{Excess, Kind, Sequence};
use crate::flash_text::{self, FlashText, Table};
use crate::message::{Mode, Request, Sample, State, Trip, WAITING};
use crate::protocol::{self, FRAME, Framer, TEXT_CHUNK};
use crate::settings::{self, BuildError, Param, Settings};
use crate::storage::{self, Saver};
use crate::units::{AMPERE, FULL_RANGE, Rule, VOLT};
#[cfg(not(target_arch = "avr"))]
use commands::COMMAND_HELP;
pub(crate) use commands::COMMAND_TEXT;
use commands::{COMMAND_COUNT, Command};
use line::{Edit, LineEditor};
pub use machine::{Counters, Machine, ResetCause};
use number::Decimal;
pub use texts::trip_text;
pub(crate) use texts::{SAYINGS, WORDS};
use texts::{Say, Word};

/// The arguments of a command, in one byte of flash: how many at least (0..=7), and how many at most (0..=15). Bit 7 is set
/// if the first is one of a choice of words.
// It stands here and not beside the commands: there the firmware would be larger than the flash.
#[derive(Clone, Copy)]
struct Form(u8);

impl Form {
    /// As many as the line holds.
    const ANY: u8 = 15;
    const CHOOSES: u8 = 0x80;

    /// As the text says that `help` shows.
    const fn of(arguments: &str) -> Self {
        let text = arguments.as_bytes();
        let (mut least, mut most, mut optional, mut between, mut i) = (0, 0, false, true, 0);
        while i < text.len() {
            match text[i] {
                b' ' => between = true,
                b'[' => optional = true,
                b'.' => most = Self::ANY,
                _ if between => {
                    between = false;
                    most += 1;
                    least += !optional as u8;
                }
                _ => {}
            }
            i += 1;
        }
        let chooses = !text.is_empty() && text[0].is_ascii_lowercase();
        Self(if chooses { Self::CHOOSES } else { 0 } | least << 4 | if most > Self::ANY { Self::ANY } else { most })
    }

    fn chooses(self) -> bool {
        self.0 & Self::CHOOSES != 0
    }

    /// Whether so many arguments are right.
    fn takes(self, count: u8) -> bool {
        let most = self.0 & Self::ANY;
        count >= self.0 >> 4 & 7 && (count <= most || most == Self::ANY)
    }
}

avr_progmem::progmem! {
    static progmem FORMS: [Form; COMMAND_COUNT as usize] = commands::FORMS;
}

/// What is streamed, by the place of the word in the command's choice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Stream {
    #[default]
    Off,
    Text,
    Binary,
}

/// A value within a text.
enum Field {
    Text(Table, u8),
    Number(f32),
    Whole(u32),
}

/// The console's memory. All of it begins as zero, which the chip does in a loop.
pub struct Console {
    editor: LineEditor,
    settings: Settings,
    framer: Framer,
    saver: Saver,
    stream: Stream,
    /// What is typed is not repeated.
    quiet: bool,
    divider: u8,
    countdown: u8,
    /// There are saved settings that could not be loaded, and nobody has said what shall be in force.
    not_loaded: bool,
    /// A recording runs; samples sent so far, and the drop counter when it began.
    recording: bool,
    recorded: u32,
    dropped: u16,
    /// Text on its way into a frame.
    chunk: [u8; TEXT_CHUNK],
    chunk_length: u8,
    // What the fields of a text speak of.
    /// The command.
    command: u8,
    /// The setting.
    param: Param,
    /// The rule it breaks.
    rule: Rule,
    /// The sample and the counters.
    sample: Sample,
    counters: Counters,
    /// A number of ticks or samples.
    count: u32,
    /// The largest number allowed.
    limit: f32,
}

impl Default for Console {
    #[inline(always)]
    fn default() -> Self {
        // SAFETY: all zeros are valid: numbers, flags, and enums whose first variant has the number zero.
        unsafe { core::mem::zeroed() }
    }
}

impl Console {
    /// Puts settings in force: the saved ones if they are whole and fit, else the defaults.
    ///
    /// # Errors
    /// The default that does not fit; a test of the core holds that all do.
    #[inline(never)]
    pub fn start(&mut self, machine: &mut impl Machine) -> Result<(), BuildError> {
        if storage::load(machine.memory(), &mut self.settings) && machine.configure(&self.settings).is_ok() {
            return Ok(());
        }
        self.not_loaded = storage::holds_something(machine.memory());
        self.settings.set_defaults();
        machine.configure(&self.settings)
    }

    /// The settings in force.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Greets after a reset: version, reset cause, and whether the saved settings are not those in force.
    pub fn greet(&mut self, machine: &mut impl Machine) {
        self.look(machine);
        self.info(Say::Version, machine);
        self.info(Say::ResetCause, machine);
        self.warn(machine);
    }

    /// Says that saved settings were not loaded, until that is answered.
    fn warn(&mut self, machine: &mut impl Machine) {
        if self.not_loaded {
            self.info(Say::NotLoaded, machine);
        }
    }

    /// Takes a received byte; carries out a line that it completes.
    #[inline(never)]
    pub fn receive(&mut self, byte: u8, machine: &mut impl Machine) {
        let edit = self.editor.push(byte);
        let echo = !self.quiet && self.stream != Stream::Binary;
        let mut erased = 0;
        match edit {
            Edit::Complete | Edit::Refused => {
                if echo {
                    self.end_line(machine);
                }
                self.finish(edit == Edit::Refused, machine);
                self.editor.clear();
            }
            Edit::Added(byte) if echo => machine.send(byte),
            Edit::Erased => erased = 1,
            Edit::Cleared(count) => erased = count,
            _ => {}
        }
        while echo && erased > 0 {
            machine.send(8);
            machine.send(b' ');
            machine.send(8);
            erased -= 1;
        }
    }

    /// Goes on with what takes time: a save.
    pub fn poll(&mut self, machine: &mut impl Machine) {
        if self.saver.poll(machine.memory(), &self.settings) {
            self.info(Say::Saved, machine);
        }
    }

    /// Whether nobody wants samples.
    #[inline(always)]
    pub fn is_silent(&self) -> bool {
        self.stream == Stream::Off
    }

    /// Streams a sample, if that is wanted.
    #[inline(never)]
    pub fn telemetry(&mut self, sample: &Sample, machine: &mut impl Machine) {
        if self.stream == Stream::Off {
            return;
        }
        if self.recording {
            if sample.state.has(State::PLAYING) {
                self.countdown = 0;
            } else if self.countdown <= 1 {
                return self.end_recording(machine);
            }
        }
        if self.countdown > 1 {
            self.countdown -= 1;
            return;
        }
        self.countdown = self.divider;
        if self.stream == Stream::Text {
            self.sample = *sample;
            self.print(Say::Plot, machine);
            return self.end_line(machine);
        }
        self.recorded += 1;
        send_frame(&mut self.framer, protocol::SAMPLE, protocol::pack(sample), machine);
    }

    /// The sequence is over: the count, and back to text.
    fn end_recording(&mut self, machine: &mut impl Machine) {
        self.look(machine);
        self.count = self.recorded;
        self.info(Say::Done, machine);
        self.recording = false;
        self.stream = Stream::Off;
    }

    /// Carries out the line and closes the reply.
    fn finish(&mut self, refused: bool, machine: &mut impl Machine) {
        if !refused && self.editor.next_word().is_empty() {
            return;
        }
        self.editor.rewind();
        let outcome = if refused { Say::LineRefused } else { self.execute(machine) };
        if outcome != Say::Ok {
            self.print(Say::Error, machine);
        }
        self.print(outcome, machine);
        self.end_line(machine);
    }

    /// Carries out the line. What is not a command with arguments of its form has no effect.
    #[inline(never)]
    fn execute(&mut self, machine: &mut impl Machine) -> Say {
        let Some(command) = self.find_command() else { return Say::UnknownCommand };
        self.command = command as u8;
        machine.host_spoke();
        let form = FORMS.load_at(command as usize);
        if !self.fits(form) {
            return Say::Usage;
        }
        let mut choice = 0;
        if form.chooses() {
            let mut arguments = FlashText::of(Table::Commands, command as u8 * COMMAND_TEXTS + ARGUMENTS);
            let Some(chosen) = arguments.choice(self.editor.next_word()) else { return Say::Usage };
            choice = chosen;
        }
        self.look(machine);
        match command {
            Command::Help => self.help(machine),
            Command::Status => self.status(machine),
            Command::Arm => return self.arm(machine),
            Command::Disarm => machine.request(Request::Disarm),
            Command::Stop => machine.request(Request::Stop),
            Command::Clear => machine.request(Request::ClearTrip),
            Command::Mode => return self.mode(choice, machine),
            Command::Reference => return self.reference(machine),
            Command::Show => return self.show(machine),
            Command::Zero => return self.zero(choice, machine),
            Command::Sequence | Command::Record => return self.sequence(choice, machine),
            Command::Stream => return self.stream(choice),
            Command::Save => return self.save(machine),
            Command::Set | Command::Load | Command::Defaults => return self.change(command, machine),
            Command::Echo => self.quiet = choice == 0,
            Command::Version => self.greet(machine),
            Command::Alive => {}
        }
        Say::Ok
    }

    /// Notes how the machine stands.
    #[inline(never)]
    fn look(&mut self, machine: &mut impl Machine) {
        machine.look(&mut self.sample, &mut self.counters);
    }

    /// The command the line begins with.
    fn find_command(&mut self) -> Option<Command> {
        let index = flash_text::find(Table::Commands, COMMAND_COUNT, self.editor.next_word())?;
        // SAFETY: the discriminants are 0..COMMAND_COUNT.
        Some(unsafe { core::mem::transmute::<u8, Command>(index) })
    }

    /// Whether the line has as many arguments as the command takes.
    fn fits(&mut self, form: Form) -> bool {
        let mut count = 0;
        while !self.editor.next_word().is_empty() {
            count += 1;
        }
        self.editor.rewind();
        self.editor.next_word();
        form.takes(count)
    }

    fn help(&mut self, machine: &mut impl Machine) {
        for index in 0..COMMAND_COUNT {
            self.command = index;
            self.info(Say::Command, machine);
        }
    }

    fn status(&mut self, machine: &mut impl Machine) {
        self.info(Say::State, machine);
        self.info(Say::Measured, machine);
        self.info(Say::Counted, machine);
        if self.sample.trip != Trip::None {
            self.info(Say::TripLatched, machine);
        }
        self.warn(machine);
    }

    /// Arms, or says why not.
    fn arm(&mut self, machine: &mut impl Machine) -> Say {
        if self.not_loaded {
            return Say::NotLoaded;
        }
        machine.request(Request::Arm);
        self.look(machine);
        if self.armed() { Say::Ok } else { Say::TripLatched }
    }

    fn armed(&self) -> bool {
        self.sample.state.has(State::ARMED)
    }

    fn mode(&mut self, choice: u8, machine: &mut impl Machine) -> Say {
        let mode = Mode::from_number(choice).unwrap_or(Mode::Off);
        if mode != Mode::Off && !self.armed() {
            return Say::NotArmed;
        }
        machine.request(Request::Mode(mode));
        Say::Ok
    }

    fn reference(&mut self, machine: &mut impl Machine) -> Say {
        let limit = if self.sample.state.mode().is_position() { 1e9 } else { 32767.0 };
        match self.quantity(limit) {
            Ok(bits) => machine.request(Request::Reference(bits)),
            Err(say) => return say,
        }
        Say::Ok
    }

    /// The next word as a value in the unit of the mode, in bits of at most `limit`.
    #[inline(never)]
    fn quantity(&mut self, limit: f32) -> Result<i32, Say> {
        let Some(value) = number::parse(self.editor.next_word()) else { return Err(Say::Usage) };
        let mode = self.sample.state.mode();
        if mode == Mode::Off {
            return Err(Say::NoReference);
        }
        let bits_per_unit = bits_per_unit(mode, &self.settings);
        let bits = value * bits_per_unit;
        if bits.abs() > limit {
            self.limit = limit / bits_per_unit;
            return Err(Say::Limit);
        }
        Ok(whole(bits + 0.5f32.copysign(bits)))
    }

    fn show(&mut self, machine: &mut impl Machine) -> Say {
        let word = self.editor.next_word();
        if !word.is_empty() {
            let Some(param) = settings::find(word) else { return Say::NoSuchSetting };
            self.param = param;
            self.info(Say::Setting, machine);
            return Say::Ok;
        }
        for index in 0..Param::COUNT {
            let Some(param) = Param::from_index(index) else { continue };
            self.param = param;
            self.info(Say::Setting, machine);
        }
        Say::Ok
    }

    /// Other settings: those of the line, the saved ones, or those as built. Only here is a second copy of them.
    #[inline(never)]
    fn change(&mut self, command: Command, machine: &mut impl Machine) -> Say {
        let mut settings = self.settings;
        match command {
            Command::Defaults => settings.set_defaults(),
            Command::Load => {
                if !storage::load(machine.memory(), &mut settings) {
                    return Say::NothingSaved;
                }
            }
            _ => loop {
                let word = self.editor.next_word();
                if word.is_empty() {
                    break;
                }
                let Some(param) = settings::find(word) else { return Say::NoSuchSetting };
                self.param = param;
                let value = number::parse(self.editor.next_word());
                if !value.is_some_and(|value| settings.set(param, value).is_ok()) {
                    return Say::Range;
                }
            },
        }
        self.replace(&settings, machine)
    }

    /// Takes new settings as a whole, or not at all.
    #[inline(never)]
    fn replace(&mut self, settings: &Settings, machine: &mut impl Machine) -> Say {
        if self.saver.is_busy() {
            return Say::SaveRunning;
        }
        let rig = [
            Param::CountsPerRev,
            Param::SpeedRange,
            Param::SpeedSensor,
            Param::Wiring,
            Param::TickRate,
            Param::EmergencyStop,
        ];
        let rig_changes = rig.iter().any(|&param| settings.get(param) != self.settings.get(param));
        if rig_changes && self.armed() {
            return Say::DisarmFirst;
        }
        if let Err(BuildError { param, rule }) = machine.configure(settings) {
            (self.param, self.rule) = (param, rule);
            return Say::Build;
        }
        self.settings = *settings;
        self.not_loaded = false;
        Say::Ok
    }

    /// Zero of current or position.
    fn zero(&mut self, choice: u8, machine: &mut impl Machine) -> Say {
        if self.armed() {
            return Say::DisarmFirst;
        }
        if choice != 0 {
            machine.request(Request::ZeroPosition);
            return Say::Ok;
        }
        machine.request(Request::ZeroCurrent);
        self.look(machine);
        while self.counters.zeroing {
            self.look(machine);
        }
        if self.counters.zero_ok { Say::Ok } else { Say::ZeroRefused }
    }

    /// Plays a sequence, in a recording with the binary stream around it.
    fn sequence(&mut self, choice: u8, machine: &mut impl Machine) -> Say {
        let kind = Kind::from_number(choice).unwrap_or_default();
        let amplitude = match self.quantity(32767.0) {
            Ok(bits) => bits as i16,
            Err(say) => return say,
        };
        // The offset and what follows it may be left out.
        let offset = if self.editor.at_end() { Ok(0) } else { self.quantity(32767.0) };
        let offset = match offset {
            Ok(bits) => bits as i16,
            Err(say) => return say,
        };
        let (Some(period_ms), Some(count), Some(seed)) = (self.number(500), self.number(1), self.number(1)) else {
            return Say::Usage;
        };
        let sequence = match Sequence::new(kind, amplitude, offset, self.settings.ticks(period_ms), count, seed) {
            Ok(sequence) => sequence,
            Err(Excess::Period(ticks)) => {
                self.limit = self.settings.whole_ms(ticks) as f32;
                return Say::PeriodLimit;
            }
            Err(Excess::Count(most)) => {
                self.limit = most as f32;
                return Say::CountLimit;
            }
        };
        machine.request(Request::Play(sequence));
        if self.command == Command::Record as u8 {
            // As many samples may be from before the sequence.
            (self.stream, self.divider, self.countdown) = (Stream::Binary, 1, WAITING + 1);
            (self.recording, self.recorded, self.dropped) = (true, 0, self.counters.dropped);
        }
        Say::Ok
    }

    /// The next word as a whole number; the usual one where there is no word.
    #[inline(never)]
    fn number(&mut self, usual: u16) -> Option<u16> {
        let word = self.editor.next_word();
        if word.is_empty() { Some(usual) } else { number::parse_u16(word) }
    }

    fn stream(&mut self, choice: u8) -> Say {
        let (stream, usual) = match choice {
            0 => (Stream::Off, 1),
            1 => (Stream::Text, 20),
            _ => (Stream::Binary, 1),
        };
        let Some(divider @ 1..=255) = self.number(usual) else { return Say::Usage };
        self.divider = divider as u8;
        (self.stream, self.countdown, self.recording) = (stream, 0, false);
        Say::Ok
    }

    fn save(&mut self, machine: &mut impl Machine) -> Say {
        if self.saver.is_busy() {
            return Say::SaveRunning;
        }
        self.saver.start(machine.memory());
        self.not_loaded = false;
        Say::Ok
    }

    /// Prints an information line.
    #[inline(never)]
    fn info(&mut self, say: Say, machine: &mut impl Machine) {
        machine.listen();
        self.put(b'#', machine);
        self.put(b' ', machine);
        self.print(say, machine);
        self.end_line(machine);
    }

    /// Prints a text with its fields.
    #[inline(never)]
    fn print(&mut self, say: Say, machine: &mut impl Machine) {
        let mut text = FlashText::of(Table::Sayings, say as u8);
        while let Some(byte) = text.next() {
            if byte != b'%' {
                self.put(byte, machine);
                continue;
            }
            let mut decimal = Decimal::default();
            match self.field(text.next().unwrap_or(0)) {
                Field::Text(table, index) => {
                    FlashText::of(table, index).for_each(|byte| self.put(byte, machine));
                }
                Field::Number(value) => decimal.write(value),
                Field::Whole(number) => decimal.write_whole(number),
            }
            decimal.as_bytes().iter().for_each(|&byte| self.put(byte, machine));
        }
    }

    /// What `%` and this letter stand for.
    #[inline(never)]
    fn field(&self, letter: u8) -> Field {
        let (param, sample, settings) = (self.param, &self.sample, &self.settings);
        let (bits, per_unit) = match letter {
            b'0'..=b'1' => return Field::Text(Table::Commands, self.command * COMMAND_TEXTS + (letter - b'0')),
            b'3'..=b'4' => {
                return Field::Text(Table::Settings, param as u8 * settings::TEXTS + (letter - b'3'));
            }
            b'b' => return Field::Text(Table::Words, Word::Rules as u8 + self.rule as u8),
            b't' => return Field::Text(Table::Words, Word::Trips as u8 + sample.trip as u8),
            b'R' => return Field::Text(Table::Words, Word::ResetCauses as u8 + self.counters.reset_cause as u8),
            b'V' => return Field::Text(Table::Words, Word::Version as u8),
            b'm' => return Field::Text(Table::Words, Word::Modes as u8 + sample.state.mode() as u8),
            b'T' => (sample.trip as i32, WHOLE),
            b'a' => (self.armed() as i32, WHOLE),
            b'S' => (storage::VERSION as i32, WHOLE),
            b'k' => (self.count as i32, WHOLE),
            b'i' => (self.counters.illegal_transitions as i32, WHOLE),
            b'o' => (self.counters.overruns as i32, WHOLE),
            b'u' => (self.counters.unsent as i32, WHOLE),
            b'f' => (self.counters.stack_free as i32, WHOLE),
            b'A' => ((self.counters.since_trip >> settings.is_fast() as u8) as i32 / 1000, WHOLE),
            b'D' => (self.counters.dropped as i32, WHOLE),
            b'K' => (self.counters.dropped.wrapping_sub(self.dropped) as i32, WHOLE),
            b'x' => return Field::Number(settings.get(param)),
            b'l' => return Field::Number(param.range().0),
            b'h' => return Field::Number(param.range().1),
            b'L' => return Field::Number(self.limit),
            b'r' => (sample.reference, bits_per_unit(sample.state.mode(), settings)),
            b'p' => (sample.counts, bits_per_unit(Mode::PositionPid, settings)),
            b's' => (sample.speed as i32, bits_per_unit(Mode::SpeedPid, settings)),
            b'c' => (sample.current as i32, AMPERE),
            b'd' => (sample.duty as i32, HARDWARE.pwm_steps as f32 / 100.0),
            _ => (sample.supply as i32, VOLT),
        };
        if per_unit == WHOLE { Field::Whole(bits as u32) } else { Field::Number(bits as f32 / per_unit) }
    }

    #[inline(never)]
    fn end_line(&mut self, machine: &mut impl Machine) {
        self.put(b'\r', machine);
        self.put(b'\n', machine);
    }

    /// Sends a character as it is, or in a frame while the binary stream is on.
    #[inline(never)]
    fn put(&mut self, byte: u8, machine: &mut impl Machine) {
        if self.stream != Stream::Binary {
            return machine.send(byte);
        }
        if let Some(place) = self.chunk.get_mut(self.chunk_length as usize) {
            *place = byte;
            self.chunk_length += 1;
        }
        if byte == b'\n' || self.chunk_length as usize == TEXT_CHUNK {
            let length = core::mem::take(&mut self.chunk_length);
            let text = self.chunk.get(..length as usize).unwrap_or(&[]);
            send_frame(&mut self.framer, protocol::TEXT, text, machine);
        }
    }
}

/// Sends one frame.
#[inline(never)]
fn send_frame(framer: &mut Framer, kind: u8, payload: &[u8], machine: &mut impl Machine) {
    let mut frame = [0; FRAME];
    let length = framer.frame(kind, payload, &mut frame);
    frame.iter().take(length).for_each(|&byte| machine.send(byte));
}

/// In place of the bits per unit of what is printed as it is, to the last digit.
const WHOLE: f32 = 0.0;

/// Texts of each command, and the place of the second.
const COMMAND_TEXTS: u8 = 2;
const ARGUMENTS: u8 = 1;

/// Bits or counts of one unit of the mode's reference: of a volt where it is neither a speed nor a position.
#[inline(never)]
fn bits_per_unit(mode: Mode, settings: &Settings) -> f32 {
    if mode.is_speed() {
        FULL_RANGE / settings.get(Param::SpeedRange)
    } else if mode.is_position() {
        settings.get(Param::CountsPerRev) * (1.0 / core::f32::consts::TAU)
    } else {
        VOLT
    }
}
