//! The thesis experiment on the simulated chip, `docs/thesis.md`:
//!
//! `cargo run --release -p host-sim --features chip --example thesis -- DIRECTORY`
//!
//! prints what was found, the gains and the tables, and writes `thesis_pid.svg` and `thesis_lqr.svg` into the directory.

use host_sim::chip::{Bench, ChipBoard, Rig, firmware_elf};
use host_sim::design::specification::{Specification, Speed};
use host_sim::diagnose::page::page;
use host_sim::motor::MotorParameters;
use host_sim::plant::{BridgeLosses, DcMotor, DcMotorParameters};
use host_sim::rig::NominalMotor;
use host_sim::thesis::{Thesis, thesis};
use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let directory = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| ".".into()));
    // What nobody but the simulated motor knows: friction, and what the L293D loses.
    let motor =
        DcMotorParameters { coulomb_friction_nm: 0.012, bridge: BridgeLosses::L293D, ..DcMotorParameters::PIVT6 };
    let bench = Bench::new(firmware_elf()?, Rig::default(), DcMotor::new(motor))?;
    let mut board = ChipBoard::start(bench)?;
    // The data sheet, a tenth off.
    let sheet = MotorParameters::PIVT6;
    let nominal = MotorParameters {
        resistance_ohm: 1.1 * sheet.resistance_ohm,
        inertia_kg_m2: 0.9 * sheet.inertia_kg_m2,
        ..sheet
    };
    let specification =
        Specification { speed: Speed::BandwidthHz(10.0), overshoot_percent: 10.0, current_limit_a: 1.0 };
    let found = thesis(&mut board, NominalMotor::from(nominal), &specification, &|step| eprintln!("{step} …"))?;
    println!("{}\n{}\n{}", page(&found.diagnosis), found.gains(), found.tables());
    for (done, name) in found.loops.iter().zip(["thesis_pid.svg", "thesis_lqr.svg"]) {
        std::fs::write(directory.join(name), Thesis::picture(done))?;
    }
    Ok(())
}
