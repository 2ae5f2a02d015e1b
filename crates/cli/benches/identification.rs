//! Time of an identification of 20 s at 1 kHz, recorded by the core with a motor with Coulomb friction and a bridge
//! drop. `benches/peers/compare.py` compares the fits with SciPy's least squares on a compiled model.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use motorbench_data::rig::NominalMotor;
use motorbench_data::telemetry;
use motorbench_diagnosis::dataset::Dataset;
use motorbench_diagnosis::diagnose::diagnose;
use motorbench_diagnosis::identify::{Effort, Prior, fit};
use motorbench_model::Model;
use motorbench_model::catalogue::effect;
use motorbench_report::diagnosis_page::report;
use motorbench_report::web_page::Provenance;
use std::path::Path;

fn identification(criterion: &mut Criterion) {
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/peers/steps.toml");
    let scenario = motorbench_files::scenario(&scenario, None).expect("the scenario of the benchmark");
    let recording = scenario.run().expect("runs").recording;
    // Start of the fits: every constant is off by a tenth.
    let mut nominal = scenario.model.motor;
    nominal.resistance_ohm *= 1.1;
    nominal.inductance_h *= 0.9;
    nominal.torque_constant_nm_per_a *= 1.1;
    nominal.inertia_kg_m2 *= 0.9;
    nominal.viscous_friction_nm_s *= 1.1;
    let rig = telemetry::rig_of_core(&scenario.settings, NominalMotor::from(nominal));
    let data = Dataset::new(std::slice::from_ref(&recording), &rig).expect("a recording that can be used");
    let prior = Prior::new(&rig.motor, &data);
    let linear = Model::linear(nominal);
    let extended = linear
        .with(effect("coulomb_friction").expect("an effect of the catalogue"), vec![0.004])
        .with(effect("voltage_drop").expect("an effect of the catalogue"), vec![1.0]);

    // The timed result must be right. The inductance is the least certain: its time constant is two samples.
    let found = fit(&extended, &data, &prior, Effort::FULL).model.motor.named();
    for ((name, found), (_, truth)) in found.iter().zip(scenario.model.motor.named()).take(4) {
        println!("{name}: {:+.2} % off", 100.0 * (found / truth - 1.0));
        assert!((found / truth - 1.0).abs() < 0.1);
    }

    let mut group = criterion.benchmark_group("identification");
    group.sample_size(10);
    group.bench_function("linear_fit", |b| b.iter(|| fit(&linear, &data, &prior, Effort::FULL)));
    group.bench_function("extended_fit", |b| b.iter(|| fit(&extended, &data, &prior, Effort::FULL)));
    group.bench_function("diagnosis", |b| {
        b.iter(|| diagnose(std::slice::from_ref(&recording), &rig, &|_| ()).map(|diagnosis| diagnosis.outcome))
    });
    group.bench_function("diagnosis_with_report", |b| {
        b.iter(|| {
            let diagnosis = diagnose(std::slice::from_ref(&recording), &rig, &|_| ())?;
            Ok::<_, motorbench_diagnosis::dataset::DatasetError>(report(
                &diagnosis,
                Provenance { files: vec![recording.name.clone()], ..Provenance::default() },
            ))
        })
    });
    // The time should be proportional to the length. Each recording has its own noise.
    let mut noisy = scenario;
    noisy.noise.current_a = 0.01;
    for times in [1, 2, 4] {
        let several: Vec<_> = (0..times)
            .map(|seed| {
                noisy.noise.seed = seed;
                noisy.run().expect("runs").recording
            })
            .collect();
        group.bench_function(BenchmarkId::new("diagnosis_of_recordings", times), |b| {
            b.iter(|| diagnose(&several, &rig, &|_| ()).map(|diagnosis| diagnosis.outcome))
        });
    }
    group.finish();
}

criterion_group!(benches, identification);
criterion_main!(benches);
