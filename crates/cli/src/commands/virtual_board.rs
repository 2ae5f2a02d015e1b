//! `motorbench virtual`: a board without hardware.

#[cfg(all(feature = "chip", unix))]
mod orders;
#[cfg(all(feature = "chip", unix))]
mod surroundings;

use super::{Failure, TERMINAL};
use clap::Args;
use motorbench_link::port::USUAL_LINK;
use std::path::PathBuf;

/// Runs the firmware on the simulated chip, with a motor, behind a serial port that every program can open.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench virtual &
  motorbench record --out run.csv
  motorbench virtual --rig rig.toml --model model.toml --link /tmp/mine
  motorbench virtual --link /tmp/board12 --json > board12.json &
  motorbench virtual --eeprom board.bin \\
    --with 'effect cogging cosine_Nm=0.002 sine_Nm=0 periods_per_rev=7'

While it runs it takes lines. --with gives the same ones at the start:
  motor resistance_ohm=7              constants of the motor, as in a model file
  effect coulomb_friction torque_Nm=0.02
                                      an effect of the catalogue
  effect coulomb_friction off         without it
  model FILE.toml                     another motor with its effects
  load NM, brake NM, supply V, block on|off, turn DEGREES (and hold)
  encoder ok|unplugged|swapped|slipping|noisy|shorted
  encoder a-open|b-open|a-high|b-high|a-low|b-low
  current ok|open|high|low|frozen, adc ok|dead, uart ok|stuck, supply dip
  stop on|off (the emergency stop), reset, quit, wait S
From another terminal --tell sends them, and ends when they are done: turn when
the rotor is there, wait after so many seconds of the chip's time. The socket
beside the port takes them as well, and answers ok or error.
  motorbench virtual --tell 'brake 0.01' --tell 'wait 2'")]
pub struct Arguments {
    /// Motor and supply from a rig file; without it the test stand's motor with friction and an L293D.
    #[arg(long)]
    rig: Option<PathBuf>,
    /// A model with effects, as motorbench diagnose writes it.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Path of the port. At the usual place the other commands find it without --port.
    #[arg(long, default_value = USUAL_LINK)]
    link: PathBuf,
    /// File that keeps the board's EEPROM between runs (1024 bytes). It is created if it is missing.
    #[arg(long, value_name = "FILE")]
    eeprom: Option<PathBuf>,
    /// A line of those below, given at the start.
    #[arg(long = "with", value_name = "LINE")]
    with: Vec<String>,
    /// Sends a line to the board that runs at --link, instead of starting one.
    #[arg(long, value_name = "LINE", conflicts_with_all = ["rig", "model", "eeprom", "with", "firmware", "seconds"])]
    tell: Vec<String>,
    /// Firmware to run (an ELF file). Default: that of this program, which is built if it is missing or older than its
    /// sources.
    #[arg(long, value_name = "ELF")]
    firmware: Option<PathBuf>,
    /// How long the chip's time waits for a program that reads late, in s. On a busy computer it waits longer.
    #[arg(long, value_name = "S", default_value_t = 0.5, value_parser = seconds)]
    wait_for_reader: f64,
    /// Ends after this many seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<f64>,
    /// Prints one line of JSON when the board is ready, and one for each line from the terminal.
    #[arg(long, value_name = TERMINAL, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL, value_parser = [TERMINAL])]
    json: Option<String>,
}

fn seconds(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|seconds| (0.0..=1e6).contains(seconds)).ok_or("expected seconds, 0 to 1e6".into())
}

/// Says what is missing.
///
/// # Errors
/// Always.
#[cfg(not(all(feature = "chip", unix)))]
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments {
        rig: _,
        model: _,
        link: _,
        eeprom: _,
        with: _,
        tell: _,
        firmware: _,
        wait_for_reader: _,
        seconds: _,
        json: _,
    } = arguments;
    Err(Failure::machine(
        "this program was built without the simulated chip: run `scripts/setup chip`, then `cargo run --release -p motorbench --features chip -- virtual` (Linux, macOS)",
    ))
}

#[cfg(all(feature = "chip", unix))]
pub use with_chip::run;

#[cfg(all(feature = "chip", unix))]
mod with_chip {
    use super::super::port::option;
    use super::super::{cannot_write, firmware, read_rig, write_whole};
    use super::orders::{Control, from_terminal};
    use super::surroundings::{ORDERS, Surroundings, USUAL_SUPPLY_V, Until, model_file};
    use super::{Arguments, Failure};
    use host_sim::plant::ModelPlant;
    use motorbench_chip::{Bench, EEPROM_BYTES, Rig as Circuit, Tachogenerator};
    use motorbench_data::rig::Rig;
    use motorbench_link::port::USUAL_LINK;
    use motorbench_link::virtual_control::{Starting, VirtualControl};
    use motorbench_text::terminal_text::fitted;
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    use rustix::fs::OFlags;
    use rustix::io::{ioctl_fionbio, ioctl_fionread};
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
    use std::borrow::Cow;
    use std::fs::File;
    use std::io::{ErrorKind, Read, Write};
    use std::os::unix::fs::OpenOptionsExt;
    use std::path::{Path, PathBuf};
    use std::sync::mpsc::channel;
    use std::time::{Duration, Instant};

    /// What a person does where no firmware can be built.
    const GIVE_ONE: &str = "give --firmware ELF: the file that `cargo firmware` makes where cargo and the sources are, target/avr-atmega328p/firmware/firmware.elf";
    /// The line that ends it.
    const QUIT: &str = "quit";
    /// The chip runs this long between two looks at the line.
    const SLICE_S: f64 = 2e-3;
    /// Behind by more than this the clock is set anew: the computer was busy.
    const LATEST: Duration = Duration::from_millis(200);
    /// The chip waits for a program that may have left so many bytes in the line, 40 ms of telemetry. A busy computer's
    /// delays are not the board's.
    const UNREAD: usize = 1024;
    /// How often it is looked meanwhile.
    const LOOK_AGAIN: Duration = Duration::from_millis(1);
    const COUNTS_PER_REV: f64 = 2000.0;
    /// The firmware says what it is within so much of its time; another one may say nothing.
    const GREETS_WITHIN_S: f64 = 0.5;
    /// The EEPROM is kept when nothing was written to it for so many slices.
    const EEPROM_QUIET_SLICES: u32 = 50;

    /// Runs it until it is told to end.
    ///
    /// # Errors
    /// [`Failure`] with what is missing or wrong.
    pub fn run(arguments: &Arguments) -> Result<(), Failure> {
        if !arguments.tell.is_empty() {
            return tell(arguments);
        }
        let rig = arguments.rig.as_deref().map(read_rig).transpose()?;
        let mut surroundings =
            Surroundings::new(arguments.model.as_deref(), arguments.rig.as_deref().zip(rig.as_ref()))?;
        let starting = Starting::at(&arguments.link);
        let elf = match &arguments.firmware {
            Some(path) => path.clone(),
            None => {
                firmware().map_err(|error| Failure::machine(format!("{}; {GIVE_ONE}", error.to_string().trim_end())))?
            }
        };
        let mut bench = Bench::new(elf, circuit(rig.as_ref()), surroundings.plant()).map_err(Failure::input)?;
        for order in &arguments.with {
            if order.trim() == QUIT {
                return Err(Failure::command_line(
                    "--with quit: that is for a board that runs; --seconds 1 ends this one",
                ));
            }
            // A file that a line names is none of the line.
            let failure = if model_file(order).is_some() { Failure::input } else { Failure::command_line };
            surroundings.obey(&mut bench, order).map_err(|why| failure(format!("--with {why}")))?;
        }
        let mut eeprom = arguments.eeprom.clone().map(Eeprom).map(|eeprom| eeprom.load(&mut bench)).transpose()?;
        let ended = serve(arguments, &mut bench, surroundings, &mut eeprom, starting);
        if let Some(eeprom) = &mut eeprom {
            eeprom.keep(&bench)?;
        }
        ended
    }

    /// Has the board that runs do some lines.
    fn tell(arguments: &Arguments) -> Result<(), Failure> {
        let mut board = VirtualControl::of(&arguments.link).map(VirtualControl::patient).ok_or_else(|| {
            Failure::machine(format!(
                "{}: no virtual board runs there: start one with `motorbench virtual &`, or name its --link",
                arguments.link.display()
            ))
        })?;
        for line in &arguments.tell {
            board.order(&from_here(line)).map_err(Failure::input)?;
            if arguments.json.is_some() {
                println!("{}", serde_json::json!({ "line": line, "error": null }));
            }
        }
        Ok(())
    }

    /// A line for a board that runs in another folder.
    fn from_here(line: &str) -> Cow<'_, str> {
        match model_file(line) {
            Some(file) => {
                let file = std::path::absolute(file).unwrap_or_else(|_| file.into());
                format!("model {}", file.display()).into()
            }
            None => line.into(),
        }
    }

    fn circuit(rig: Option<&Rig>) -> Circuit {
        let given = |value: Option<Option<f64>>, usual| value.flatten().unwrap_or(usual);
        Circuit {
            supply_v: given(rig.map(|rig| rig.supply.voltage_v), USUAL_SUPPLY_V),
            counts_per_turn: given(rig.map(|rig| rig.encoder.counts_per_rev), COUNTS_PER_REV),
            tachogenerator: tachogenerator(rig),
            ..Circuit::default()
        }
    }

    fn tachogenerator(rig: Option<&Rig>) -> Tachogenerator {
        let given = rig.map(|rig| rig.tachogenerator).unwrap_or_default();
        let usual = Tachogenerator::default();
        Tachogenerator {
            v_per_1000_rpm: given.gain_v_per_krpm.unwrap_or(usual.v_per_1000_rpm),
            ripple: given.ripple.unwrap_or(usual.ripple),
            ripples_per_turn: given.ripples_per_rev.unwrap_or(usual.ripples_per_turn),
            ..usual
        }
    }

    /// A file that holds the EEPROM's content.
    struct Eeprom(PathBuf);

    impl Eeprom {
        /// Puts the file's content into the chip, which has not begun; a chip without file is as from the factory.
        fn load(self, bench: &mut Bench<ModelPlant>) -> Result<KeptEeprom, Failure> {
            let name = self.0.display();
            match self.image() {
                Ok(image) if image.len() == EEPROM_BYTES => bench.chip_mut().set_eeprom(&image),
                Ok(image) => {
                    let bytes = match image.len() {
                        bytes if bytes > EEPROM_BYTES => format!("more than {EEPROM_BYTES}"),
                        bytes => bytes.to_string(),
                    };
                    return Err(Failure::input(format!(
                        "{name} has {bytes} bytes, an EEPROM {EEPROM_BYTES}: is it another file?"
                    )));
                }
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                Err(error) => return Err(Failure::machine(format!("{name}: {error}"))),
            }
            Ok(KeptEeprom { path: self.0, written: 0, kept: 0, quiet: 0 })
        }

        /// The file's bytes, one too many at most: a device may have no end.
        fn image(&self) -> std::io::Result<Vec<u8>> {
            let mut image = Vec::new();
            File::open(&self.0)?.take(EEPROM_BYTES as u64 + 1).read_to_end(&mut image)?;
            Ok(image)
        }
    }

    /// Watches for writes and keeps what they leave.
    struct KeptEeprom {
        path: PathBuf,
        written: u64,
        kept: u64,
        quiet: u32,
    }

    impl KeptEeprom {
        /// After each slice: keeps the content when a save is over.
        fn watch(&mut self, bench: &Bench<ModelPlant>) -> Result<(), Failure> {
            let written = bench.chip().eeprom_writes().0;
            self.quiet = if written == self.written { self.quiet + 1 } else { 0 };
            self.written = written;
            if self.quiet == EEPROM_QUIET_SLICES { self.keep(bench) } else { Ok(()) }
        }

        /// Writes the file whole or not at all, if anything has changed.
        fn keep(&mut self, bench: &Bench<ModelPlant>) -> Result<(), Failure> {
            let written = bench.chip().eeprom_writes().0;
            if written == self.kept {
                return Ok(());
            }
            // What finds no room is not tried again when the board ends.
            self.kept = written;
            write_whole(&self.path, &bench.chip().eeprom()).map_err(|error| {
                let Failure { message, code } = cannot_write(&self.path, &error);
                Failure { message: format!("{message}; what was saved on the board is lost, it has ended"), code }
            })?;
            Ok(())
        }
    }

    /// Of two virtual boards at one place the second one does not start.
    fn refuse_where_one_runs(path: &Path) -> Result<(), Failure> {
        if VirtualControl::of(path).is_some() {
            return Err(Failure::machine(format!(
                "{}: a virtual board runs there: end it with `quit`, or choose another --link",
                path.display()
            )));
        }
        Ok(())
    }

    /// A name that stays the same for the port that the system numbers; gone when this is dropped.
    struct NamedPort(PathBuf);

    impl NamedPort {
        fn new(path: &Path, port: &str) -> Result<Self, Failure> {
            let failure = |error| Failure::machine(format!("{}: {error}; choose another --link", path.display()));
            if std::fs::symlink_metadata(path).is_ok_and(|found| found.is_symlink()) {
                std::fs::remove_file(path).map_err(failure)?;
            }
            std::os::unix::fs::symlink(port, path).map_err(failure)?;
            Ok(Self(path.into()))
        }
    }

    impl Drop for NamedPort {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(&self.0);
        }
    }

    /// What comes next, for a board at this place.
    fn next(link: &Path) -> String {
        let port = if link == Path::new(USUAL_LINK) { String::new() } else { option(&link.display().to_string()) };
        format!("next, in another terminal: motorbench record{port}")
    }

    fn serve(
        arguments: &Arguments,
        bench: &mut Bench<ModelPlant>,
        mut surroundings: Surroundings,
        eeprom: &mut Option<KeptEeprom>,
        starting: Option<Starting>,
    ) -> Result<(), Failure> {
        let (mut line, name) = SerialLine::new().map_err(Failure::machine)?;
        refuse_where_one_runs(&arguments.link)?;
        let (sender, orders) = channel();
        // Before the port: who sees that sends orders.
        let control = Control::new(&arguments.link, sender.clone())?;
        let named = NamedPort::new(&arguments.link, &name)?;
        from_terminal(sender);
        let greeting = bench.run_until_line(GREETS_WITHIN_S).map_err(Failure::machine)?;
        drop(starting);
        // It has been read here; who opens the port shall find it as well.
        greeting.iter().for_each(|said| line.send(format!("{said}\r\n").as_bytes()));
        if arguments.json.is_some() {
            println!("{}", ready(&named, &name, &control, greeting.as_deref(), &surroundings));
        } else {
            let at = named.0.display();
            let next = next(&named.0);
            print!("{}", fitted(&format!("virtual board at {at} ({name}); lines change it:\n{ORDERS}\n{next}\n")));
        }
        let (begun, ended) = (Instant::now(), super::super::interaction::on_interrupt()?);
        let mut clock = Clock::new(Duration::from_secs_f64(arguments.wait_for_reader));
        let mut under_way = Vec::new();
        while !ended.load(std::sync::atomic::Ordering::Relaxed)
            && arguments.seconds.is_none_or(|limit_s| begun.elapsed().as_secs_f64() < limit_s)
        {
            for order in orders.try_iter() {
                if order.line.trim() == QUIT {
                    order.answer(Ok(()), arguments.json.is_some());
                    return Ok(());
                }
                match surroundings.obey(bench, &order.line) {
                    Ok(Until::Now) => order.answer(Ok(()), arguments.json.is_some()),
                    Ok(later) => under_way.push((order, later)),
                    Err(why) => order.answer(Err(why), arguments.json.is_some()),
                }
            }
            line.exchange(bench).map_err(Failure::machine)?;
            if clock.waits(line.unread) {
                continue;
            }
            surroundings.go_on(bench);
            let done = under_way.extract_if(.., |(_, until)| surroundings.is_over(bench, *until));
            done.for_each(|(order, _)| order.answer(Ok(()), arguments.json.is_some()));
            bench.run_s(SLICE_S).map_err(Failure::machine)?;
            if let Some(eeprom) = eeprom {
                eeprom.watch(bench)?;
            }
            clock.keep_time(SLICE_S);
        }
        Ok(())
    }

    /// What a program that starts boards wants to know of one. `greeting`: the firmware's first line.
    fn ready(
        named: &NamedPort,
        device: &str,
        control: &Control,
        greeting: Option<&str>,
        surroundings: &Surroundings,
    ) -> serde_json::Value {
        let model = surroundings.model();
        serde_json::json!({
            "port": named.0.to_string_lossy(),
            "device": device,
            "control": control.0.to_string_lossy(),
            "firmware": greeting.map(|line| line.trim_start_matches("# ")),
            "motor": model.motor,
            "effects": model.effects(),
            "bridge": surroundings.bridge(),
        })
    }

    /// The pseudo-terminal that is the board's serial line.
    ///
    /// A thread of the operating system carries what one side has written to the other. A busy computer lets that
    /// thread wait. Only a read or a poll of a side that seems empty carries it at once. So no word of a program to the
    /// board is overlooked, and the bytes that the program has not read are known.
    struct SerialLine {
        board: File,
        /// The program's side. Kept open so that the line outlives its users.
        far: File,
        /// Bytes sent since the far side was seen empty: no more than these have not been read.
        unread: usize,
    }

    impl SerialLine {
        /// With the name of the far side.
        fn new() -> std::io::Result<(Self, String)> {
            let board = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
            grantpt(&board)?;
            unlockpt(&board)?;
            ioctl_fionbio(&board, true)?;
            let name = ptsname(&board, Vec::new())?.to_string_lossy().into_owned();
            let far = File::options().read(true).write(true).custom_flags(OFlags::NOCTTY.bits() as i32).open(&name)?;
            let mut settings = tcgetattr(&far)?;
            settings.make_raw();
            tcsetattr(&far, OptionalActions::Now, &settings)?;
            Ok((Self { board: board.into(), far, unread: 0 }, name))
        }

        /// Bytes both ways.
        fn exchange(&mut self, bench: &mut Bench<ModelPlant>) -> std::io::Result<()> {
            let mut buffer = [0; 512];
            loop {
                match self.board.read(&mut buffer) {
                    Ok(count) => bench.serial().write(&buffer[..count]),
                    Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                    Err(error) => return Err(error),
                }
            }
            if self.far_is_empty()? {
                self.unread = 0;
            }
            self.send(&bench.serial().read());
            Ok(())
        }

        fn far_is_empty(&self) -> std::io::Result<bool> {
            poll(&mut [PollFd::new(&self.far, PollFlags::IN)], Some(&Timespec::default()))?;
            Ok(ioctl_fionread(&self.far)? == 0)
        }

        /// What the line cannot keep is lost, as on the wire.
        fn send(&mut self, bytes: &[u8]) {
            let _ = self.board.write_all(bytes);
            self.unread += bytes.len();
        }
    }

    /// Keeps the chip's time to that on the wall.
    struct Clock {
        /// Who takes nothing for longer does not read; time goes on, and what the line cannot keep is lost.
        waits_at_most: Duration,
        start: Instant,
        simulated_s: f64,
        /// Since when the line's reader is behind.
        behind: Option<Instant>,
    }

    impl Clock {
        fn new(waits_at_most: Duration) -> Self {
            Self { waits_at_most, start: Instant::now(), simulated_s: 0.0, behind: None }
        }

        /// Holds the time for a reader who has left so much in the line, if it is worth it.
        fn waits(&mut self, unread: usize) -> bool {
            if unread < UNREAD {
                self.behind = None;
                return false;
            }
            let waits = self.behind.get_or_insert_with(Instant::now).elapsed() < self.waits_at_most;
            if waits {
                std::thread::sleep(LOOK_AGAIN);
                (self.start, self.simulated_s) = (Instant::now(), 0.0);
            }
            waits
        }

        /// After a slice: waits until the clock on the wall has come as far as the chip's.
        fn keep_time(&mut self, slice_s: f64) {
            self.simulated_s += slice_s;
            let due = self.start + Duration::from_secs_f64(self.simulated_s);
            let now = Instant::now();
            if due > now {
                std::thread::sleep(due - now);
            } else if now - due > LATEST {
                (self.start, self.simulated_s) = (now, 0.0);
            }
        }
    }
}
