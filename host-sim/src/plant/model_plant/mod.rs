//! The extended model as a plant: runs a loop with the model of a diagnosis.

mod followed_wave;
mod held;
mod stepwise;

use super::{BridgeLosses, DcMotor, DcMotorParameters, Inputs, Motion, PeriodEnd, Plant, Pwm};
use held::Held;
use motorbench_model::catalogue::{ActsOn, DryLosses, Effect};
use motorbench_model::{Model, Term};
use stepwise::Stepwise;

/// Longest step; shorter ones are taken as they come.
const LONGEST_STEP_S: f64 = 50e-6;
/// A motor with the effects of a model, at rest at first. Coulomb friction and the bridge's drop are solved event by
/// event ([`DcMotor`]), also under other torques and in a winding that warms up (`Held`). All other effects are solved
/// step by step. Effects of sensors and of timing are not part of it.
#[derive(Clone, Debug)]
pub struct ModelPlant(Solver);

#[derive(Clone, Debug)]
enum Solver {
    Exact(DcMotor),
    Held(Held),
    Stepwise(Stepwise),
}

impl ModelPlant {
    /// At rest, behind a bridge with the losses of the model.
    pub fn new(model: Model) -> Self {
        Self::behind(BridgeLosses::DIODES, model)
    }

    /// At rest, behind a bridge with losses of its own.
    pub fn behind(bridge: BridgeLosses, mut model: Model) -> Self {
        model.terms.retain(|term| Self::simulates(term.effect));
        model.terms.sort_by_key(Term::turn);
        let held = |term: &Term| {
            let about = term.effect.about();
            about.acts_on == [ActsOn::Torque] || about.is_slow_resistance
        };
        Self(if model.terms.iter().all(is_exact) {
            Solver::Exact(event_exact(bridge, &model))
        } else if model.terms.iter().all(|term| is_exact(term) || held(term)) {
            Solver::Held(Held::new(bridge, model))
        } else {
            Solver::Stepwise(Stepwise::new(bridge, model))
        })
    }

    /// Whether an effect is part of it.
    pub fn simulates(effect: &dyn Effect) -> bool {
        effect.acts_on_motor() && !effect.is_of_switching()
    }

    /// Changes the motor while it turns: angle, speed and current stay, the memory of the effects is cleared.
    pub fn replace(&mut self, bridge: BridgeLosses, model: Model) {
        let motion = Motion {
            angle_rad: self.angle_rad(),
            speed_rad_per_s: self.speed_rad_per_s(),
            current_a: self.current_a(),
        };
        *self = Self::behind(bridge, model);
        match &mut self.0 {
            Solver::Exact(motor) => motor.set_motion(motion),
            Solver::Held(held) => held.motor.set_motion(motion),
            Solver::Stepwise(motor) => {
                motor.angle_rad = motion.angle_rad;
                motor.speed_rad_per_s = motion.speed_rad_per_s;
                motor.current_a = motion.current_a;
            }
        }
    }
}

/// Of the motor's own shaft.
fn motor_inertia_kg_m2(model: &Model) -> f64 {
    model.motor.inertia_kg_m2 * model.motor_share()
}

/// Whether the event-exact motor contains an effect.
fn is_exact(term: &Term) -> bool {
    term.effect.is_dry_losses_alone(&term.values)
}

/// The parameters of those.
fn exact_losses(model: &Model) -> DryLosses {
    model.terms.iter().filter(|term| is_exact(term)).map(Term::dry_losses).sum()
}

/// The motor of a model, without effects that it does not contain.
fn event_exact(bridge: BridgeLosses, model: &Model) -> DcMotor {
    let losses = exact_losses(model);
    let drop_v = losses.bridge_drop_v;
    DcMotor::new(DcMotorParameters {
        resistance_ohm: model.motor.resistance_ohm,
        inductance_h: model.motor.inductance_h,
        torque_constant_nm_per_a: model.motor.torque_constant_nm_per_a,
        inertia_kg_m2: motor_inertia_kg_m2(model),
        viscous_friction_nms_per_rad: model.motor.viscous_friction_nm_s,
        coulomb_friction_nm: losses.friction_forward_nm,
        // The drop is there whatever the bridge does; a coasting current flows through two diodes besides.
        bridge: BridgeLosses {
            drive_v: bridge.drive_v + drop_v,
            brake_v: bridge.brake_v + drop_v,
            diode_v: bridge.diode_v + 0.5 * drop_v,
        },
    })
}

impl ModelPlant {
    fn plant(&self) -> &dyn Plant {
        match &self.0 {
            Solver::Exact(motor) => motor,
            Solver::Held(motor) => motor,
            Solver::Stepwise(motor) => motor,
        }
    }

    fn plant_mut(&mut self) -> &mut dyn Plant {
        match &mut self.0 {
            Solver::Exact(motor) => motor,
            Solver::Held(motor) => motor,
            Solver::Stepwise(motor) => motor,
        }
    }
}

impl Plant for ModelPlant {
    fn advance(&mut self, dt_s: f64, inputs: &Inputs) {
        self.plant_mut().advance(dt_s, inputs);
    }

    fn advance_pwm(&mut self, pwm: &Pwm, inputs: &Inputs, ends: &mut [PeriodEnd]) {
        self.plant_mut().advance_pwm(pwm, inputs, ends);
    }

    fn angle_rad(&self) -> f64 {
        self.plant().angle_rad()
    }

    fn speed_rad_per_s(&self) -> f64 {
        self.plant().speed_rad_per_s()
    }

    fn current_a(&self) -> f64 {
        self.plant().current_a()
    }

    fn supply_v(&self) -> f64 {
        self.plant().supply_v()
    }
}

#[cfg(test)]
mod tests {
    use super::followed_wave::FollowedWave;
    use super::*;
    use crate::plant::Bridge;
    use motorbench_model::catalogue::{Wave, effect};
    use motorbench_model::motor::MotorParameters;

    /// Friction and bridge drop of the catalogue against the plant that finds every event exactly.
    #[test]
    fn agrees_with_the_event_exact_motor() {
        let model = Model::linear(MotorParameters::PIVT6)
            .with(effect("coulomb_friction").unwrap(), vec![0.01])
            .with(effect("voltage_drop").unwrap(), vec![2.0]);
        let bridge = BridgeLosses { drive_v: 0.3, brake_v: 0.2, ..BridgeLosses::DIODES };
        let (mut exact, mut plant) = (event_exact(bridge, &model), Stepwise::new(bridge, model));
        for period in 0..20_000 {
            let duty = [0.6, -0.4, 0.25, 0.0][period / 5_000];
            let on_s = 50e-6 * f64::abs(duty);
            let on = if duty < 0.0 { Bridge::Reverse } else { Bridge::Forward };
            for (bridge, dt_s) in [(on, on_s), (Bridge::Brake, 50e-6 - on_s)] {
                let inputs = Inputs { bridge, ..Inputs::default() };
                exact.advance(dt_s, &inputs);
                plant.advance(dt_s, &inputs);
            }
            assert!((exact.speed_rad_per_s() - plant.speed_rad_per_s).abs() < 0.05, "period {period}");
            assert!((exact.current_a() - plant.current_a).abs() < 0.01, "period {period}");
        }
    }

    /// A supply behind a capacitor gives the mean of what pulses draw, and at half duty loses half as much in each of them.
    #[test]
    fn a_capacitor_halves_the_sag_at_half_duty() {
        let (source_ohm, duty) = (2.0, 0.5);
        for within_pulses in [0.0, 1.0] {
            let values = vec![source_ohm, within_pulses];
            let model = Model::linear(MotorParameters::PIVT6).with(effect("supply_sag").unwrap(), values);
            let mut plant = ModelPlant::new(model);
            let pulse = Inputs { bridge: Bridge::Forward, blocked: true, ..Inputs::default() };
            let rest = Inputs { bridge: Bridge::Brake, ..pulse };
            let mut mean_a = 0.0;
            for period in 0..2000 {
                plant.advance(duty * 50e-6, &pulse);
                plant.advance((1.0 - duty) * 50e-6, &rest);
                mean_a += if period >= 1000 { plant.current_a() / 1000.0 } else { 0.0 };
            }
            let in_series_ohm = source_ohm * duty * if within_pulses > 0.0 { 1.0 } else { duty };
            let expected_a = duty * pulse.supply_v / (MotorParameters::PIVT6.resistance_ohm + in_series_ohm);
            // At the end of a period the current is below its mean by half its swing.
            assert!((mean_a / expected_a - 1.0).abs() < 0.02, "{within_pulses}: {mean_a} {expected_a}");
        }
    }

    /// From one solver to the other and back: nothing jumps, and the new constants act.
    #[test]
    fn becomes_another_motor_while_it_turns() {
        let free = Model::linear(MotorParameters::PIVT6);
        let cogging = free.with(effect("cogging").unwrap(), vec![1e-4, 0.0, 7.0]);
        let heavy = free.with(effect("coulomb_friction").unwrap(), vec![0.02]);
        let mut plant = ModelPlant::new(free);
        let inputs = Inputs { bridge: Bridge::Forward, ..Inputs::default() };
        let run = |plant: &mut ModelPlant| (0..20_000).for_each(|_| plant.advance(50e-6, &inputs));
        run(&mut plant);
        let free_rad_per_s = plant.speed_rad_per_s();
        for model in [cogging, heavy] {
            let before = (plant.angle_rad(), plant.speed_rad_per_s(), plant.current_a());
            plant.replace(BridgeLosses::DIODES, model);
            assert_eq!(before, (plant.angle_rad(), plant.speed_rad_per_s(), plant.current_a()));
            run(&mut plant);
        }
        // Friction takes R c / k^2 of the speed.
        let expected = free_rad_per_s - 5.84 * 0.02 / (0.072 * 0.072 + 5.84 * 5e-6);
        assert!((plant.speed_rad_per_s() - expected).abs() < 0.01, "{} {expected}", plant.speed_rad_per_s());
    }

    /// A wave that is followed against sine and cosine: slow and fast, both directions, as expected and not, many turns.
    #[test]
    fn a_wave_that_is_followed_is_the_wave() {
        let wave = Wave { against_nm: [2e-3, -1e-3], periods_per_rev: 14.0 };
        for (step_rad, unexpected_rad) in [(1e-5, 0.0), (0.004, 1e-5), (-0.009, -3e-5), (0.002, 1e-3), (0.3, 0.0)] {
            let mut followed = FollowedWave::new(wave);
            for step in 0..20_000 {
                let angle_rad = f64::from(step) * step_rad;
                let (found, expected) =
                    (followed.torque_nm(angle_rad, step_rad + unexpected_rad), wave.torque_nm(angle_rad));
                assert!((found - expected).abs() < 1e-13, "{angle_rad}: {found} {expected}");
            }
        }
    }

    /// Effects with a memory beside the exact solution against the same stepped by terms, a hundred times as finely.
    #[test]
    fn memory_beside_events_agrees_with_fine_steps() {
        let friction = Model::linear(MotorParameters::PIVT6).with(effect("coulomb_friction").unwrap(), vec![0.006]);
        let friction = friction.with(effect("voltage_drop").unwrap(), vec![1.8]);
        for (id, values, bound_rad_per_s, bound_a) in [
            ("winding_heating", vec![0.2, 0.3], 0.03, 3e-4),
            ("shaft_compliance", vec![40.0, 0.4, 0.05], 0.03, 3e-4),
            ("backlash", vec![0.02, 0.4, 300.0, 0.4], 0.12, 3e-4),
        ] {
            let model = friction.with(effect(id).unwrap(), values);
            let mut plant = ModelPlant::new(model.clone());
            assert!(matches!(plant.0, Solver::Held(_)), "{id}");
            let mut fine = Stepwise::new(BridgeLosses::DIODES, model);
            let mut largest = [0.0_f64; 2];
            for tick in 0..400 {
                let duty = 0.7 * (f64::from(tick) * 0.02).sin();
                let pwm = Pwm {
                    pulse: if duty < 0.0 { Bridge::Reverse } else { Bridge::Forward },
                    rest: Bridge::Brake,
                    pulse_s: 50e-6 * duty.abs(),
                    period_s: 50e-6,
                    sampled_s: 48e-6,
                };
                plant.advance_pwm(&pwm, &Inputs::default(), &mut [PeriodEnd::default(); 20]);
                for _ in 0..20 {
                    for (bridge, dt_s) in pwm.parts(0.0, pwm.period_s) {
                        let inputs = Inputs { bridge, ..Inputs::default() };
                        (0..50).for_each(|_| fine.advance(dt_s / 50.0, &inputs));
                    }
                }
                largest[0] = largest[0].max((plant.speed_rad_per_s() - fine.speed_rad_per_s).abs());
                largest[1] = largest[1].max((plant.current_a() - fine.current_a).abs());
            }
            println!("{id}: {:.1e} rad/s, {:.1e} A from steps of 0.5 us", largest[0], largest[1]);
            assert!(largest[0] < bound_rad_per_s && largest[1] < bound_a, "{id}: {largest:?}");
        }
    }
}
