//! Compares the model with the true constants.
use hidden_effects::{Effect, Recipe, draw};
use host_sim::catalogue::effect;
use host_sim::dataset::Dataset;
use host_sim::free_run::free_run;
use host_sim::model::Model;
use host_sim::motor::MotorParameters;
use host_sim::recording::Recording;
use host_sim::rig::Rig;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let seed: u64 = args[1].parse().unwrap();
    let e = *Effect::CATALOGUE.iter().find(|e| e.id() == args[2]).unwrap();
    let trial = draw(seed, &Recipe::of(&[e]).with_random_strengths(seed));
    let recording = Recording::parse("trial", trial.csv.as_bytes(), &[]).unwrap();
    let rig = Rig::parse("rig", &trial.rig_toml).unwrap();
    let data = Dataset::new(&[recording], &rig).unwrap();
    let m = trial.truth.motor;
    let motor = MotorParameters {
        resistance_ohm: m.resistance_ohm,
        inductance_h: m.inductance_h,
        torque_constant_nm_per_a: m.torque_constant_nm_per_a,
        inertia_kg_m2: m.inertia_kg_m2,
        viscous_friction_nm_s: m.viscous_friction_nm_s,
    };
    let mut model = Model::linear(motor);
    for (e, values) in &trial.truth.effects {
        let effect = effect(e.id()).unwrap();
        let values = effect
            .about()
            .parameters
            .iter()
            .map(|p| values.iter().find(|(n, _)| *n == p.name).map_or(1.0, |v| v.1))
            .collect();
        model = model.with(effect, values);
    }
    println!("{model:?}");
    let p = free_run(&model, &data);
    let step: usize = args[3].parse().unwrap();
    let (from, to): (usize, usize) = (args[4].parse().unwrap(), args[5].parse().unwrap());
    for k in (from..to).step_by(step) {
        println!(
            "{:.3} duty {:.3} i {:.4} {:.4}  w {:.2} {:.2}",
            data.time_s[k], data.duty[k], data.measured[0].values[k], p[0][k], data.measured[1].values[k], p[1][k]
        );
    }
}
