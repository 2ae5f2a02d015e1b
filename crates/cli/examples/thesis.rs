//! The thesis experiment on the simulated chip, `docs/explanation/thesis.md`:
//!
//! `cargo run --release -p motorbench --features chip --example thesis -- DIRECTORY`
//!
//! It prints the constants, the gains and the tables, and writes `thesis_pid.svg` and `thesis_lqr.svg` into the
//! directory.

#[path = "../../../tests/thesis/mod.rs"]
mod set_up;

use motorbench_report::diagnosis_text::page;
use motorbench_stand::thesis::Thesis;
use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let directory = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| ".".into()));
    let found = set_up::experiment(&|step| eprintln!("{step} …"))?;
    println!("{}\n{}\n{}", page(&found.diagnosis), found.gains(), found.tables());
    for (done, name) in found.loops.iter().zip(["thesis_pid.svg", "thesis_lqr.svg"]) {
        std::fs::write(directory.join(name), Thesis::picture(done))?;
    }
    Ok(())
}
