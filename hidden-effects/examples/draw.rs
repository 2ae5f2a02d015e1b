//! Writes one trial: `draw SEED DIRECTORY [EFFECT…]`.

use hidden_effects::{Effect, Recipe, draw};
use std::path::Path;

fn main() -> std::io::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let seed = arguments.next().and_then(|text| text.parse().ok()).expect("a seed");
    let directory = arguments.next().expect("a directory");
    let known = || Effect::CATALOGUE.into_iter().chain(Effect::OUTSIDE);
    let effects: Vec<Effect> =
        arguments.map(|id| known().find(|effect| effect.id() == id).expect("an effect's identifier")).collect();
    let trial = draw(seed, &Recipe::of(&effects).on_real_rig());
    let directory = Path::new(&directory);
    std::fs::create_dir_all(directory)?;
    std::fs::write(directory.join("recording.csv"), &trial.csv)?;
    std::fs::write(directory.join("rig.toml"), &trial.rig_toml)?;
    std::fs::write(directory.join("truth.txt"), format!("{:#?}\n", trial.truth))
}
