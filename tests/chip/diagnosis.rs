//! What is hidden in a bench is found in what the firmware records of it over its serial port. The real program runs on
//! the simulated chip. Its PWM switches the bridge, its interrupts count the encoder, its converter reads the current.
//! The suite takes an effect of the angle, of the winding and of the shaft. `scripts/trials chip` takes all twelve.

use crate::common::Uno;
use hidden_effects::{Effect, LiveBench, Recipe, Switch, Truth};
use host_sim::plant::{Bridge, Inputs, Plant};
use motorbench_chip::Rig;
use motorbench_core::settings::{Param, Settings};
use motorbench_data::names::setting_name;
use motorbench_data::recording::Recording;
use motorbench_data::rig::NominalMotor;
use motorbench_data::telemetry;
use motorbench_diagnosis::diagnose::diagnose;
use motorbench_report::diagnosis_text::page;

/// The ACS712 ends at 5 A: a reversal at full speed must not reach it.
const LEAST_RESISTANCE_OHM: f64 = 6.0;

/// A bench with hidden effects as the chip's plant.
struct Hidden(LiveBench);

impl Plant for Hidden {
    fn advance(&mut self, dt_s: f64, inputs: &Inputs) {
        let switch = match inputs.bridge {
            Bridge::Forward => Switch::Forward,
            Bridge::Reverse => Switch::Reverse,
            Bridge::Brake => Switch::Short,
            Bridge::Coast => Switch::Off,
        };
        self.0.advance(dt_s, switch);
    }

    fn angle_rad(&self) -> f64 {
        self.0.angle_rad()
    }

    fn speed_rad_per_s(&self) -> f64 {
        self.0.speed_rad_per_s()
    }

    fn current_a(&self) -> f64 {
        self.0.current_a()
    }

    fn supply_v(&self) -> f64 {
        self.0.supply_v()
    }
}

/// Settings under which the identifying sequence runs into no limit.
fn settings(bench: &LiveBench) -> Settings {
    let mut settings = Settings::defaults();
    let top_speed = bench.supply_v() / 0.012;
    let of_the_bench = [
        (Param::SupplyVoltage, bench.supply_v() as f32),
        (Param::CountsPerRev, bench.counts_per_rev() as f32),
        (Param::CompFrictionWidth, 50.0),
        (Param::SpeedRange, top_speed.log2().ceil().exp2() as f32),
    ];
    for (param, value) in of_the_bench.into_iter().chain(telemetry::IDENTIFICATION_SETTINGS) {
        settings.set(param, value).expect("within its range");
    }
    settings
}

/// Plays the identifying sequence on the chip; the recording as the host makes it of the telemetry.
fn record(bench: LiveBench, settings: &Settings) -> Recording {
    let wired = Rig { supply_v: bench.supply_v(), counts_per_turn: bench.counts_per_rev(), ..Rig::default() };
    let volts = 0.8 * bench.supply_v();
    let mut uno = Uno::with(wired, Hidden(bench));
    uno.listen();
    let defaults = Settings::defaults();
    // The range of the speed last: the widths of the compensation have to suit it.
    for param in Param::ALL.iter().rev().copied().filter(|param| settings.get(*param) != defaults.get(*param)) {
        uno.order(&format!("set {} {}", setting_name(param), settings.get(param)));
    }
    uno.order("arm");
    uno.order("mode open");
    uno.samples.clear();
    uno.order(&format!("sequence identify {volts:.2} 0 500 1 7"));
    uno.run_s(20.0);
    assert_eq!(uno.decoder.damaged, 0);
    uno.order("disarm");
    let lost = uno.samples.windows(2).filter(|pair| pair[1].tick.wrapping_sub(pair[0].tick) != 1).count();
    println!("{} samples, {lost} gaps", uno.samples.len());
    let csv = telemetry::recording("chip", &uno.samples, settings).to_csv();
    Recording::parse("chip.csv", csv.as_bytes(), &[]).expect("its own format")
}

/// One hidden effect on a rig with Coulomb friction and a bridge drop, through the firmware: what was named.
fn assert_found(seed: u64, effect: Effect) {
    let recipe = Recipe::of(&[effect]).on_real_rig().with_random_strengths(seed);
    let (bench, truth) = LiveBench::draw(seed, &recipe, LEAST_RESISTANCE_OHM);
    let settings = settings(&bench);
    let recording = record(bench, &settings);
    let rig = telemetry::rig(&settings, nominal(&truth));
    let diagnosis = diagnose(&[recording], &rig, &|_| ()).expect("a usable recording");
    println!("{}", page(&diagnosis));
    let causes = diagnosis.outcome.causes.iter().filter(|cause| !cause.effect.starts_with("parameter:"));
    let mut found: Vec<_> = causes.map(|cause| cause.effect.as_str()).collect();
    let mut hidden: Vec<_> = truth.effects.iter().map(|(effect, _)| effect.id()).collect();
    found.sort_unstable();
    hidden.sort_unstable();
    assert_eq!(found, hidden, "seed {seed}, {truth:?}");
    for (effect, name, within) in [("coulomb_friction", "torque_Nm", 0.06), ("voltage_drop", "drop_V", 0.06)] {
        let cause = diagnosis.outcome.causes.iter().find(|cause| cause.effect == effect).expect("it was named");
        let hidden = truth.effects.iter().find(|(hidden, _)| hidden.id() == effect).expect("the rig has it");
        let (found, truth) = (cause.parameters[name].value, hidden.1[0].1);
        assert!((found / truth - 1.0).abs() < within, "seed {seed}, {effect}: {found} instead of {truth}");
    }
}

fn nominal(truth: &Truth) -> NominalMotor {
    let motor = truth.nominal;
    NominalMotor {
        resistance_ohm: Some(motor.resistance_ohm),
        inductance_h: Some(motor.inductance_h),
        torque_constant_nm_per_a: Some(motor.torque_constant_nm_per_a),
        inertia_kg_m2: Some(motor.inertia_kg_m2),
        viscous_friction_nm_s: Some(motor.viscous_friction_nm_s),
    }
}

#[test]
fn a_torque_that_depends_on_the_angle() {
    assert_found(1, Effect::Cogging);
}

#[test]
#[ignore = "`scripts/trials chip`"]
fn a_drag() {
    assert_found(2, Effect::QuadraticDrag);
}

#[test]
#[ignore = "`scripts/trials chip`"]
fn a_load_that_comes() {
    assert_found(3, Effect::LoadStep);
}

#[test]
#[ignore = "`scripts/trials chip`"]
fn a_soft_supply() {
    assert_found(4, Effect::SupplySag);
}

#[test]
fn a_winding_that_heats() {
    assert_found(5, Effect::WindingHeating);
}

#[test]
#[ignore = "`scripts/trials chip`"]
fn friction_that_warms_up() {
    assert_found(6, Effect::FrictionWarmup);
}

#[test]
#[ignore = "`scripts/trials chip`"]
fn a_sticking_friction() {
    assert_found(7, Effect::StribeckFriction);
}

#[test]
#[ignore = "`scripts/trials chip`"]
fn an_unbalance() {
    assert_found(8, Effect::GravityUnbalance);
}

#[test]
#[ignore = "`scripts/trials chip`"]
fn a_soft_shaft() {
    assert_found(9, Effect::ShaftCompliance);
}

#[test]
#[ignore = "`scripts/trials chip`"]
fn a_weight() {
    assert_found(10, Effect::LoadTorque);
}

#[test]
fn backlash() {
    assert_found(11, Effect::Backlash);
}

#[test]
#[ignore = "`scripts/trials chip`"]
fn asymmetry() {
    assert_found(12, Effect::FrictionAsymmetry);
}
