//! The thesis experiment's set-up, of which `docs/explanation/thesis.md` tells: shared by the test and the example that prints it.

use host_sim::plant::{BridgeLosses, DcMotor, DcMotorParameters};
use motorbench_chip::{Bench, ChipBoard, Rig, firmware_elf};
use motorbench_data::rig::NominalMotor;
use motorbench_design::specification::{Specification, Speed};
use motorbench_model::motor::MotorParameters;
use motorbench_stand::thesis::{Thesis, thesis};
use std::error::Error;

/// Runs it on the simulated chip.
pub fn experiment(progress: &dyn Fn(&str)) -> Result<Thesis, Box<dyn Error>> {
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
    Ok(thesis(&mut board, NominalMotor::from(nominal), &specification, progress)?)
}
