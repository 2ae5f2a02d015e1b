//! A board as the test stand of `motorbench stand`.

use crate::commands::files::{beside, free_name, with_beside};
use crate::commands::interaction::{on_interrupt, typed_lines};
use crate::commands::port::{PortArguments, SAME_COUNTS};
use crate::commands::record::ended;
use crate::commands::recording_files::table_file;
use crate::commands::{Failure, cannot_write, tell, write};
use clap::Args;
use motorbench_core::settings::{Param, Settings};
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_diagnosis::steady_state::{FEWEST_LEVELS, StudyError};
use motorbench_link::growing::GrowingFile;
use motorbench_link::port::Port;
use motorbench_link::record::by_name;
#[cfg(unix)]
use motorbench_link::virtual_control::VirtualControl;
use motorbench_link::{Link, VERSION};
use motorbench_stand::drive::{Findings, Found, HeldPosition, Operator, Plan, drive, table};
use std::fmt::Write as _;
use std::io::{Write as _, stderr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError};

/// Default levels: eighths of the largest voltage, from the level at which most motors turn.
const LEVELS: std::ops::RangeInclusive<u8> = 3..=8;
const PARTS: f64 = 8.0;

/// Ending of the table of positions.
const POSITIONS: &str = "positions.csv";
/// The files beside the table.
const BESIDE: [&str; 2] = [POSITIONS, "json"];

/// How the board is driven.
#[derive(Args)]
pub(super) struct BoardArguments {
    #[command(flatten)]
    pub(super) port: PortArguments,
    /// Voltages to measure at; default: 3/8 to 8/8 of the board's voltage_limit.
    #[arg(long, value_name = "V,V,...", value_delimiter = ',', allow_hyphen_values = true, conflicts_with = "table")]
    voltages: Vec<f64>,
    /// Measures the same voltages backwards as well.
    #[arg(long, conflicts_with = "table")]
    both_directions: bool,
    /// Torques of a brake. You are asked to set each one; then all voltages are measured.
    #[arg(long = "load-Nm", value_name = "NM,NM,...", value_delimiter = ',', conflicts_with = "table")]
    loads_nm: Vec<f64>,
    /// Number of averages at each voltage, each over 0.2 s or a whole revolution.
    #[arg(long, value_name = "COUNT", default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..), conflicts_with = "table")]
    readings: u16,
    /// Measures the winding at this many rotor positions; you are asked to hold the rotor at each.
    #[arg(long, value_name = "COUNT", default_value_t = 0, conflicts_with = "table")]
    positions: u16,
    /// Measures the winding in this many sectors of a revolution while you turn the rotor slowly, a few seconds a revolution.
    #[arg(long, value_name = "SECTORS", default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=360), conflicts_with = "table")]
    slow_turn: u16,
    /// Table to write; beside it the positions (.positions.csv), and firmware, settings and losses (.json). Default: the first
    /// free name of stand.csv, stand-2.csv, ...
    #[arg(long, value_name = "TABLE.csv", value_parser = table_file, conflicts_with = "table")]
    save: Option<PathBuf>,
}

impl BoardArguments {
    /// Every output file.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        with_beside(&self.save(), &BESIDE)
    }

    fn save(&self) -> PathBuf {
        self.save.clone().unwrap_or_else(|| free_name("stand", &BESIDE))
    }

    /// Drives the board, writes the readings, and evaluates the table and the held resistances.
    pub(super) fn run(
        &self,
        (rig_file, rig): (&Path, &Rig),
        evaluate: impl FnOnce(&Recording, Vec<f64>) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        // Checked before the motor turns: an incomplete rig file, a full disk or a wrong folder must not cost a test.
        if rig.motor.resistance_ohm.is_none() || rig.motor.torque_constant_nm_per_a.is_none() {
            return Err(Failure::input(format!("{}: {}", rig_file.display(), StudyError::NoNominal)));
        }
        let save = &self.save();
        let mut files = Files::new(save, !self.loads_nm.is_empty())?;
        let stopped = on_interrupt()?;
        let (mut link, port, settings) = self.port.open_to_drive()?;
        let mut person = Terminal { stopped, lines: None, brake: brake(&port) };
        same_encoder(rig, &settings)?;
        let plan = self.plan(&settings)?;
        if rig.motor.inductance_h.is_none() {
            tell(
                "without inductance_H in the rig file the current is that at the end of the PWM period, a little less than its mean",
            );
        }
        let findings = drive(&mut link, &settings, &rig.motor, &plan, &mut person, &mut |found| files.keep(found));
        if plan.positions > 0 || plan.sectors > 0 {
            let_go(&port).unwrap_or_else(|why| tell(&why));
        }
        let table = table(&save.display().to_string(), &findings.readings, files.loaded);
        // Without a table it would describe nothing, or an earlier table.
        let is_empty = findings.readings.is_empty() && findings.positions.is_empty();
        let saved = if is_empty { Ok(()) } else { write_side(save, &findings, &link, &settings) };
        drop(link);
        let held = findings.positions.iter().map(|position| position.resistance_ohm.value).collect();
        let evaluated = as_written(table).and_then(|table| evaluate(&table, held));
        ended(&findings.ended, findings.readings.len(), save)?;
        evaluated.and(saved)?;
        whole(&findings, save)
    }

    fn plan(&self, settings: &Settings) -> Result<Plan, Failure> {
        let limit_v = f64::from(settings.get(Param::VoltageLimit));
        let mut voltages_v = match &self.voltages[..] {
            [] => LEVELS.map(|part| f64::from(part) / PARTS * limit_v).collect(),
            given => given.to_vec(),
        };
        if let Some(wrong) = voltages_v.iter().find(|voltage| !(voltage.abs() <= limit_v && **voltage != 0.0)) {
            return Err(Failure::input(format!(
                "--voltages {wrong}: expected 0 to {limit_v} V, the board's voltage_limit; `motorbench connect 'set voltage_limit V'` changes it"
            )));
        }
        let mut levels_v: Vec<f64> = voltages_v.iter().map(|voltage| voltage.abs()).collect();
        levels_v.sort_by(f64::total_cmp);
        levels_v.dedup();
        let levels = levels_v.len() * self.loads_nm.len().max(1);
        if levels < FEWEST_LEVELS {
            return Err(Failure::input(StudyError::TooFew { name: "--voltages".into(), levels }));
        }
        if let Some(wrong) = self.loads_nm.iter().find(|load_nm| !(load_nm.is_finite() && **load_nm >= 0.0)) {
            return Err(Failure::input(format!("--load-Nm {wrong}: expected torques of 0 or more")));
        }
        if self.both_directions {
            voltages_v.extend(voltages_v.clone().iter().map(|voltage| -voltage));
        }
        Ok(Plan {
            voltages_v,
            loads_nm: self.loads_nm.clone(),
            readings: self.readings.into(),
            positions: self.positions.into(),
            sectors: self.slow_turn.into(),
        })
    }
}

/// The exit code tells a script that parts are missing.
fn whole(findings: &Findings, save: &Path) -> Result<(), Failure> {
    if findings.left_out.is_empty() {
        return Ok(());
    }
    Err(Failure::input(format!(
        "nobody answered, so {} are left out; {} has the rest. Run it in a terminal, or without --positions, --slow-turn and --load-Nm",
        findings.left_out.join(" and "),
        save.display()
    )))
}

fn write_side(save: &Path, findings: &Findings, link: &Link<Port>, settings: &Settings) -> Result<(), Failure> {
    let side = serde_json::json!({
        "program": format!("motorbench {VERSION}"),
        "firmware": link.firmware,
        "ended": findings.ended,
        "losses": link.losses(),
        "positions": findings.positions,
        "left_out": findings.left_out,
        "settings": by_name(settings),
    });
    let side = serde_json::to_string_pretty(&side).map_err(Failure::machine)?;
    write(&beside(save, "json"), &(side + "\n"))
}

/// The value that the file will contain, so that a later evaluation gives the same digits.
fn as_written(table: Recording) -> Result<Recording, Failure> {
    if table.is_empty() {
        return Ok(table);
    }
    Recording::parse(&table.name, table.to_csv().as_bytes(), &[]).map_err(Failure::input)
}

/// Speeds come from the board's counts, so the rig file must have the same number.
fn same_encoder(rig: &Rig, settings: &Settings) -> Result<(), Failure> {
    let board = f64::from(settings.get(Param::CountsPerRev));
    match rig.encoder.counts_per_rev {
        Some(rig) if (rig / board - 1.0).abs() > SAME_COUNTS => Err(Failure::input(format!(
            "the rig file has {rig} counts a revolution, the board {board}. Correct the rig file, or `motorbench connect 'set counts_per_rev {rig}' save`"
        ))),
        _ => Ok(()),
    }
}

/// Table and positions, which grow during the measurement. If the program ends early, all earlier readings are kept.
struct Files {
    table: GrowingFile,
    positions: GrowingFile,
    /// The table has a column for the load.
    loaded: bool,
}

impl Files {
    fn new(save: &Path, loaded: bool) -> Result<Self, Failure> {
        let new = |path: &Path| GrowingFile::new(path).map_err(|error| cannot_write(path, &error));
        Ok(Self { table: new(save)?, positions: new(&beside(save, POSITIONS))?, loaded })
    }

    fn keep(&mut self, found: Found) -> Result<(), String> {
        let (file, header, rows) = match found {
            Found::Readings(readings) => {
                let new = table("", readings, self.loaded);
                (&mut self.table, new.csv_header(), new.csv_rows(0))
            }
            Found::Positions(new) => (&mut self.positions, "angle_deg,resistance_ohm,drop_V\n".into(), rows(new)),
        };
        let lines = if file.is_empty() { header + &rows } else { rows };
        file.add(&lines).map_err(|error| cannot_write(file.path(), &error).message)
    }
}

fn rows(positions: &[HeldPosition]) -> String {
    let mut text = String::new();
    for position in positions {
        let _ = writeln!(text, "{:.1},{},{}", position.angle_deg, position.resistance_ohm.value, position.drop_V);
    }
    text
}

/// Sets a brake automatically.
type Brake = Box<dyn FnMut(f64) -> Result<(), String>>;

/// The brake of a virtual board.
#[cfg(unix)]
fn brake(port: &str) -> Option<Brake> {
    let mut control = VirtualControl::of(Path::new(port))?;
    Some(Box::new(move |torque_nm| control.order(&format!("brake {torque_nm}"))))
}

#[cfg(not(unix))]
fn brake(_port: &str) -> Option<Brake> {
    None
}

/// A hand that turned the rotor of a virtual board holds it: the next command needs it free.
#[cfg(unix)]
fn let_go(port: &str) -> Result<(), String> {
    VirtualControl::of(Path::new(port)).map_or(Ok(()), |mut board| board.order("block off"))
}

#[cfg(not(unix))]
fn let_go(_port: &str) -> Result<(), String> {
    Ok(())
}

/// The operator at this terminal.
struct Terminal {
    stopped: Arc<AtomicBool>,
    /// Typed lines, after the first question.
    lines: Option<Receiver<String>>,
    brake: Option<Brake>,
}

impl Operator for Terminal {
    fn stops(&mut self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }

    fn hears(&mut self, line: &str) {
        // A closed terminal must not cost the table.
        let _ = writeln!(stderr(), "{line}");
    }

    fn is_asked(&mut self, request: &str) {
        self.hears(request);
        self.lines.get_or_insert_with(typed_lines);
    }

    fn answers(&mut self) -> Option<bool> {
        match self.lines.as_ref()?.try_recv() {
            Ok(_) => Some(true),
            Err(TryRecvError::Empty) => None,
            // There is no operator.
            Err(TryRecvError::Disconnected) => Some(false),
        }
    }

    fn brakes(&mut self, torque_nm: f64) -> Result<bool, String> {
        self.brake.as_mut().map_or(Ok(false), |brake| brake(torque_nm).map(|()| true))
    }
}
