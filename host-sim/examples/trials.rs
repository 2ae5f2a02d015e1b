//! Many trials of the diagnosis: `trials KIND COUNT [FIRST_SEED]`, KIND: clean, single, real, pairs, triples, outside.
use hidden_effects::{Effect, Recipe, draw, random_effects};
use host_sim::dataset::Dataset;
use host_sim::diagnose::judge;
use host_sim::diagnose::select::select;
use host_sim::identify::Prior;
use host_sim::recording::Recording;
use host_sim::rig::Rig;

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let kind = args[1].as_str();
    let count: u64 = args[2].parse().unwrap();
    let first: u64 = args.get(3).map_or(1, |s| s.parse().unwrap());
    let mut right = 0;
    let mut extra_only = 0;
    let start = std::time::Instant::now();
    for seed in first..first + count {
        let n = seed as usize;
        let (effects, real): (Vec<Effect>, bool) = match kind {
            "clean" => (vec![], false),
            "single" => (vec![Effect::CATALOGUE[n % 22]], false),
            "real" => (random_effects(seed, 1, true), true),
            "realclean" => (vec![], true),
            "pairs" => (random_effects(seed, 2, false), false),
            "triples" => (random_effects(seed, 3, false), false),
            "outside" => (vec![Effect::OUTSIDE[n % 6]], false),
            "outreal" => (vec![Effect::OUTSIDE[n % 6]], true),
            id => (vec![*Effect::CATALOGUE.iter().chain(&Effect::OUTSIDE).find(|e| e.id() == id).unwrap()], false),
        };
        let mut recipe = Recipe::of(&effects).with_random_strengths(seed);
        recipe.real_rig = real;
        let trial = draw(seed, &recipe);
        let recording = Recording::parse("trial", trial.csv.as_bytes(), &[]).unwrap();
        let rig = Rig::parse("rig", &trial.rig_toml).unwrap();
        let data = match Dataset::new(&[recording], &rig) {
            Ok(d) => d,
            Err(e) => {
                println!("{seed} {e}");
                continue;
            }
        };
        let prior = Prior::new(&rig.motor, &data);
        let s = select(&data, &prior, &[], &|_| ());
        let mut truth: Vec<_> =
            trial.truth.effects.iter().map(|(e, _)| e.id()).filter(|id| !id.starts_with("outside")).collect();
        let mut named: Vec<_> = s.last.model.terms.iter().map(|t| t.id()).collect();
        truth.sort();
        named.sort();
        let ratio: Vec<f64> = (0..data.measured.len())
            .map(|o| {
                judge::rmse(&data, &s.last.prediction, o) / host_sim::dataset::noise(&s.last.residual_of(&data, o))
            })
            .collect();
        // What cannot be told apart from the truth counts as the truth.
        let aliased: Vec<_> = s
            .standings
            .iter()
            .map(|st| {
                if truth.contains(&st.id) {
                    st.id
                } else {
                    st.same.iter().copied().find(|o| truth.contains(o) && !named.contains(o)).unwrap_or(st.id)
                }
            })
            .collect();
        let mut named = aliased;
        named.sort();
        named.dedup();
        if truth == named {
            right += 1
        } else if truth.iter().all(|t| named.contains(t)) {
            extra_only += 1
        }
        if truth != named || kind.starts_with("out") || ratio.iter().any(|r| *r > 1.15) {
            let extra: Vec<_> = named.iter().filter(|n| !truth.contains(n)).collect();
            let missing: Vec<_> = truth.iter().filter(|n| !named.contains(n)).collect();
            println!(
                "{seed} {} truth {truth:?} extra {extra:?} missing {missing:?} ratio {ratio:.2?}",
                effects.iter().map(|e| e.id()).collect::<Vec<_>>().join("+")
            );
            for st in &s.standings {
                println!(
                    "        {} {:.1}s {:.3} same {:?} rival {:?}",
                    st.id,
                    st.gain.sigmas,
                    st.gain.share,
                    st.same,
                    st.rival.as_ref().map(|(i, g)| (*i, g.share as f32, g.sigmas as f32))
                );
            }
        }
    }
    println!(
        "{kind}: {right} of {count} exactly right, {extra_only} with extra only; {:?} a trial",
        start.elapsed() / count as u32
    );
}
