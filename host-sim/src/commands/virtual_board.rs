//! `motorbench virtual`: a board without hardware.

use super::Failure;
use clap::Args;
use std::path::PathBuf;

/// Runs the firmware on the simulated chip, with a motor, behind a serial port that every program can open.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench virtual &
  motorbench record --port /tmp/motorbench --out run.csv
  motorbench virtual --rig rig.toml --model model.toml --link /tmp/mine

While it runs it takes lines: load NM, supply V, block on|off, turn DEGREES (and hold), encoder ok|unplugged|swapped,
current ok|open|high|low, stop on|off (the emergency stop), reset, quit.")]
pub struct Arguments {
    /// Motor and supply from a rig file; without it the test stand's motor with friction and an L293D.
    #[arg(long)]
    rig: Option<PathBuf>,
    /// A model with effects, as motorbench diagnose writes it.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Where the port is to be found.
    #[arg(long, default_value = "/tmp/motorbench")]
    link: PathBuf,
    /// Firmware to run, as ELF file; without it this program's own is built.
    #[arg(long, value_name = "ELF")]
    firmware: Option<PathBuf>,
    /// Ends after so many seconds.
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
}

/// Says what is missing.
///
/// # Errors
/// Always.
#[cfg(not(all(feature = "chip", unix)))]
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { rig: _, model: _, link: _, firmware: _, seconds: _ } = arguments;
    Err(Failure::machine(
        "this program was built without the simulated chip: run `scripts/setup chip`, then `cargo run --release -p host-sim --features chip -- virtual` (Linux, macOS)",
    ))
}

#[cfg(all(feature = "chip", unix))]
pub use with_chip::run;

#[cfg(all(feature = "chip", unix))]
mod with_chip {
    use super::{Arguments, Failure};
    use crate::chip::{Bench, EncoderFault, ResetCause, Rig as Circuit, SensorFault, firmware_elf};
    use crate::model::Model;
    use crate::plant::{BridgeLosses, DcMotor, DcMotorParameters, ModelPlant, Plant};
    use crate::rig::Rig;
    use serialport::{SerialPort, TTYPort};
    use std::io::{BufRead, Read, Write};
    use std::path::{Path, PathBuf};
    use std::sync::mpsc::{Receiver, channel};
    use std::time::{Duration, Instant};

    /// The chip runs this long between two looks at the line.
    const SLICE_S: f64 = 2e-3;
    /// Behind by more than this the clock is set anew: the computer was busy.
    const LATEST: Duration = Duration::from_millis(200);
    const COUNTS_PER_REV: f64 = 2000.0;
    /// By how much a hand that turns the rotor pushes harder in each slice.
    const PUSH_NM: f64 = 1e-3;

    /// Runs it until it is told to end.
    ///
    /// # Errors
    /// [`Failure`] with what is missing or wrong.
    pub fn run(arguments: &Arguments) -> Result<(), Failure> {
        let rig = arguments.rig.as_ref().map(|path| Rig::read(path).map_err(Failure::input)).transpose()?;
        let circuit = circuit(rig.as_ref());
        let elf = match &arguments.firmware {
            Some(path) => path.clone(),
            None => firmware_elf().map_err(Failure::machine)?,
        };
        match model(arguments, rig.as_ref())? {
            Some(model) => serve(arguments, Bench::new(elf, circuit, ModelPlant::new(model)).map_err(Failure::input)?),
            None => {
                let motor = DcMotorParameters {
                    coulomb_friction_nm: 0.012,
                    bridge: BridgeLosses::L293D,
                    ..DcMotorParameters::PIVT6
                };
                serve(arguments, Bench::new(elf, circuit, DcMotor::new(motor)).map_err(Failure::input)?)
            }
        }
    }

    fn circuit(rig: Option<&Rig>) -> Circuit {
        let given = |value: Option<Option<f64>>, usual| value.flatten().unwrap_or(usual);
        Circuit {
            supply_v: given(rig.map(|rig| rig.supply.voltage_v), 12.0),
            counts_per_turn: given(rig.map(|rig| rig.encoder.counts_per_rev), COUNTS_PER_REV),
            ..Circuit::default()
        }
    }

    fn model(arguments: &Arguments, rig: Option<&Rig>) -> Result<Option<Model>, Failure> {
        let Some(path) = &arguments.model else {
            return rig.map(|rig| rig.motor.parameters().map(Model::linear).map_err(Failure::input)).transpose();
        };
        let failure = |error: &dyn std::fmt::Display| Failure::input(format!("{}: {error}", path.display()));
        let text = std::fs::read_to_string(path).map_err(|error| failure(&error))?;
        Model::parse(&text).map(Some).map_err(|error| failure(&error))
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

    /// What hands do at the shaft.
    #[derive(Default)]
    struct Hands {
        load_nm: f64,
        /// Angle to which the rotor is turned, to be held there, and with which torque by now.
        turning: Option<(f64, f64)>,
    }

    impl Hands {
        /// Pushes harder until the rotor is there.
        fn push<P: Plant>(&mut self, bench: &mut Bench<P>) {
            let Some((until_rad, torque_nm)) = &mut self.turning else { return };
            let there = bench.now().angle_rad >= *until_rad;
            *torque_nm += PUSH_NM;
            bench.set_load_torque_nm(if there { self.load_nm } else { self.load_nm - *torque_nm });
            if there {
                bench.block_rotor(true);
                self.turning = None;
            }
        }
    }

    fn serve<P: Plant>(arguments: &Arguments, mut bench: Bench<P>) -> Result<(), Failure> {
        let (mut board, port) = TTYPort::pair().map_err(Failure::machine)?;
        board.set_timeout(Duration::from_millis(1)).map_err(Failure::machine)?;
        let name = port.name().ok_or_else(|| Failure::machine("the pseudo-terminal has no name"))?;
        // Kept open so that the line outlives its users, but not as a port, which would be this program's alone.
        let _open = std::fs::File::options().read(true).write(true).open(&name).map_err(Failure::machine)?;
        drop(port);
        let named = NamedPort::new(&arguments.link, &name)?;
        println!(
            "virtual board at {} ({name}); lines change it: load, supply, block, turn, encoder, current, stop, reset, quit",
            named.0.display()
        );
        let (orders, mut hands) = (orders(), Hands::default());
        let (begun, ended) = (Instant::now(), super::super::board::on_interrupt()?);
        let mut clock = (Instant::now(), 0.0);
        while !ended.load(std::sync::atomic::Ordering::Relaxed)
            && arguments.seconds.is_none_or(|limit_s| begun.elapsed().as_secs_f64() < limit_s)
        {
            for order in orders.try_iter() {
                if order.trim() == "quit" {
                    return Ok(());
                }
                if let Err(why) = obey(&mut bench, &mut hands, &order) {
                    println!("{why}");
                }
            }
            exchange(&mut bench, &mut board)?;
            hands.push(&mut bench);
            bench.run_s(SLICE_S).map_err(Failure::machine)?;
            clock.1 += SLICE_S;
            keep_time(&mut clock);
        }
        Ok(())
    }

    /// Bytes both ways. What nobody fetches is lost, as on the wire.
    fn exchange<P: Plant>(bench: &mut Bench<P>, board: &mut TTYPort) -> Result<(), Failure> {
        let mut buffer = [0; 512];
        let waiting = board.bytes_to_read().map_err(Failure::machine)?;
        if waiting > 0 {
            let count = board.read(&mut buffer).unwrap_or(0);
            bench.serial().write(&buffer[..count]);
        }
        let _ = board.write_all(&bench.serial().read());
        Ok(())
    }

    /// Waits until the clock on the wall has come as far as the chip's.
    fn keep_time((start, simulated_s): &mut (Instant, f64)) {
        let due = *start + Duration::from_secs_f64(*simulated_s);
        let now = Instant::now();
        if due > now {
            std::thread::sleep(due - now);
        } else if now - due > LATEST {
            (*start, *simulated_s) = (now, 0.0);
        }
    }

    /// Lines from the terminal, as they come.
    fn orders() -> Receiver<String> {
        let (sender, receiver) = channel();
        std::thread::spawn(move || {
            for line in std::io::stdin().lock().lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    return;
                }
            }
        });
        receiver
    }

    /// Changes the surroundings of the chip.
    fn obey<P: Plant>(bench: &mut Bench<P>, hands: &mut Hands, order: &str) -> Result<(), String> {
        let words: Vec<&str> = order.split_whitespace().collect();
        let number = |text: &str| {
            text.parse::<f64>().ok().filter(|value| value.is_finite()).ok_or(format!("{text}: expected a number"))
        };
        match words[..] {
            [] => {}
            ["load", torque_nm] => {
                hands.load_nm = number(torque_nm)?;
                bench.set_load_torque_nm(hands.load_nm);
            }
            ["turn", degrees] => {
                bench.block_rotor(false);
                hands.turning = Some((bench.now().angle_rad + number(degrees)?.max(0.0).to_radians(), 0.0));
            }
            ["supply", supply_v] => bench.set_supply_v(number(supply_v)?.clamp(0.0, 40.0)),
            ["block", on @ ("on" | "off")] => bench.block_rotor(on == "on"),
            ["stop", on @ ("on" | "off")] => bench.press_emergency_stop(on == "on"),
            ["encoder", "ok"] => bench.set_encoder_fault(None),
            ["encoder", "unplugged"] => bench.set_encoder_fault(Some(EncoderFault::Unplugged)),
            ["encoder", "swapped"] => bench.set_encoder_fault(Some(EncoderFault::Swapped)),
            ["current", "ok"] => bench.set_current_sensor_fault(None),
            ["current", "open"] => bench.set_current_sensor_fault(Some(SensorFault::Open)),
            ["current", "high"] => bench.set_current_sensor_fault(Some(SensorFault::PinnedV(5.0))),
            ["current", "low"] => bench.set_current_sensor_fault(Some(SensorFault::PinnedV(0.0))),
            ["reset"] => bench.reset(ResetCause::External),
            _ => {
                return Err(format!(
                    "{order}: expected load NM, supply V, block on|off, turn DEGREES, encoder ok|unplugged|swapped, current ok|open|high|low, stop on|off, reset or quit"
                ));
            }
        }
        Ok(())
    }
}
