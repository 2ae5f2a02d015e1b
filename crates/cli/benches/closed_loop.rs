//! Time of a closed-loop second: the core at 1 kHz, the motor under a 20 kHz PWM, encoder and current sensor as on the
//! chip. `benches/peers/compare.py` runs the same with SciPy and Numba.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use host_sim::plant::{ModelPlant, Plant};
use host_sim::scenario::Scenario;
use host_sim::trial::Trial;
use motorbench_core::message::Trip;
use motorbench_model::Model;
use motorbench_model::catalogue::effect;
use std::path::Path;

/// Run-up, and reversal.
fn second(scenario: &Scenario, plant: ModelPlant) -> f64 {
    let mut trial = Trial::new(plant, scenario.settings).expect("settings of a scenario");
    trial.enter(scenario.mode);
    for value in [60.0, -60.0] {
        trial.tick(Some(trial.reference(value)));
        (1..500).for_each(|_| {
            trial.tick(None);
        });
    }
    assert_eq!(trial.sample().trip, Trip::None);
    trial.plant.speed_rad_per_s()
}

fn closed_loop(criterion: &mut Criterion) {
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/peers/second.toml");
    let scenario = motorbench_files::scenario(&scenario, None).expect("the scenario of the benchmark");
    let with = |model: &Model, id, values| model.with(effect(id).expect("an effect of the catalogue"), values);
    let linear = scenario.model.clone();
    let friction = with(&with(&linear, "coulomb_friction", vec![0.006]), "voltage_drop", vec![2.5]);
    let cogging = with(&friction, "cogging", vec![2e-3, 0.0, 14.0]);
    let heating = with(&friction, "winding_heating", vec![0.05, 40.0]);
    let sag = with(&friction, "supply_sag", vec![0.6]);
    let backlash = with(&friction, "backlash", vec![0.05, 0.4, 300.0, 0.4]);
    let mut group = criterion.benchmark_group("closed_loop_second");
    for (name, model) in [
        ("linear", linear),
        ("friction_and_drop", friction),
        ("friction_drop_and_cogging", cogging),
        ("friction_drop_and_heating", heating),
        ("friction_drop_and_backlash", backlash),
        ("friction_drop_and_sag", sag),
    ] {
        let plant = ModelPlant::new(model);
        group.bench_function(name, |b| {
            b.iter_batched(|| plant.clone(), |plant| second(&scenario, plant), BatchSize::SmallInput)
        });
    }
    group.finish();
}

criterion_group!(benches, closed_loop);
criterion_main!(benches);
