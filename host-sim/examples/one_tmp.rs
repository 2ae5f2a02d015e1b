//! t
#[path = "../tests/scoring/mod.rs"]
mod scoring;
use hidden_effects::draw;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let seed: u64 = a[2].parse().unwrap();
    let r = scoring::recipe(&a[1], seed);
    let trial = draw(seed, &r);
    println!("{:?}", trial.truth);
    std::fs::write("/tmp/one.csv", &trial.csv).unwrap();
    std::fs::write("/tmp/one.toml", &trial.rig_toml).unwrap();
    let d = scoring::diagnosed(&trial);
    let _ = scoring::hidden(&trial);
    let _ = scoring::named(&d.outcome, &[]);
    for s in &d.steps {
        println!(
            "  {} sig {:.1} share {:.2} rmse {:?} runner {:?}",
            s.id,
            s.gain.sigmas,
            s.gain.share,
            s.gain.rmse,
            s.runner_up.as_ref().map(|r| r.0)
        );
    }
    println!("{}", host_sim::diagnose::page::page(&d));
}
