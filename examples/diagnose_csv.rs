//! From a recording to a named cause: `cargo run --release --example diagnose_csv -- RECORDING.csv RIG.toml`

use motorbench_diagnosis::diagnose::diagnose;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let names: Vec<String> = std::env::args().skip(1).collect();
    let [recording, rig] = &names[..] else { return Err("expected RECORDING.csv RIG.toml".into()) };
    let recording = motorbench_files::recording(recording.as_ref(), &[])?;
    let found = diagnose(&[recording], &motorbench_files::rig(rig.as_ref())?, &|_| ())?;
    for cause in &found.outcome.causes {
        println!("{} ({:.0} %): {:?}", cause.effect, 100.0 * cause.confidence, cause.parameters);
    }
    Ok(())
}
