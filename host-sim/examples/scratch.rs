#[path = "../tests/scoring/mod.rs"]
mod scoring;
use hidden_effects::draw;
fn main() {
    let kind = std::env::args().nth(1).unwrap();
    for seed in std::env::args().skip(2) {
        let seed: u64 = seed.parse().unwrap();
        let trial = draw(seed, &scoring::recipe(&kind, seed));
        let dir = format!("/tmp/own/{kind}_{seed}");
        std::fs::create_dir_all(&dir).unwrap();
        std::fs::write(format!("{dir}/recording.csv"), &trial.csv).unwrap();
        std::fs::write(format!("{dir}/rig.toml"), &trial.rig_toml).unwrap();
        std::fs::write(format!("{dir}/truth.txt"), format!("{:#?}", trial.truth)).unwrap();
    }
}
