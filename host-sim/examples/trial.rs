//! One trial of the diagnosis.
use hidden_effects::{Effect, Recipe, draw};
use host_sim::dataset::Dataset;
use host_sim::diagnose::judge;
use host_sim::diagnose::select::select;
use host_sim::identify::Prior;
use host_sim::recording::Recording;
use host_sim::rig::Rig;
use std::time::Instant;

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let seed: u64 = args[1].parse().unwrap();
    let real = args[2] == "real";
    let effects: Vec<Effect> = args[3..]
        .iter()
        .map(|id| *Effect::CATALOGUE.iter().chain(&Effect::OUTSIDE).find(|e| e.id() == id).unwrap())
        .collect();
    let mut recipe = Recipe::of(&effects).with_random_strengths(seed);
    recipe.real_rig = real;
    let start = Instant::now();
    let trial = draw(seed, &recipe);
    println!("draw {:?}", start.elapsed());
    for (e, p) in &trial.truth.effects {
        println!("  hidden {} {:?}", e.id(), p);
    }
    println!("  {:?}", trial.truth.motor);
    let recording = Recording::parse("trial", trial.csv.as_bytes(), &[]).unwrap();
    let rig = Rig::parse("rig", &trial.rig_toml).unwrap();
    let start = Instant::now();
    let data = Dataset::new(&[recording], &rig).unwrap();
    println!("noise {:?}", data.measured.iter().map(|m| (m.output, m.noise)).collect::<Vec<_>>());
    let prior = Prior::new(&rig.motor, &data);
    println!("prepared {:?}", start.elapsed());
    let t = Instant::now();
    let p = host_sim::free_run::free_run(&host_sim::model::Model::linear(prior.motor), &data);
    println!("free run {:?} {}", t.elapsed(), p[0].len());
    let s = select(&data, &prior, &[], &|text| println!("    [{:?}] {text}", start.elapsed()));
    for o in 0..data.measured.len() {
        println!(
            "  {:?} base {:.4} last {:.4} floor {:.4} noise {:.4}",
            data.measured[o].output,
            judge::rmse(&data, &s.base.prediction, o),
            judge::rmse(&data, &s.last.prediction, o),
            host_sim::dataset::noise(&s.last.residual_of(&data, o)),
            data.measured[o].noise
        );
    }
    for step in &s.steps {
        println!(
            "  step {} {:.1} sigma share {:.3} runner-up {:?}",
            step.id,
            step.gain.sigmas,
            step.gain.share,
            step.runner_up.as_ref().map(|(id, g)| (*id, g.sigmas, g.share))
        );
    }
    for st in &s.standings {
        println!(
            "  STANDS {} {:.1} share {:.3} rival {:?} same {:?}",
            st.id,
            st.gain.sigmas,
            st.gain.share,
            st.rival.as_ref().map(|(id, g)| (*id, g.sigmas, g.share)),
            st.same
        );
    }
    println!("  {:?}", s.last.model.motor);
    for term in &s.last.model.terms {
        println!("  {:?}", term);
    }
    println!("total {:?}", start.elapsed());
}
