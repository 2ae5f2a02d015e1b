//! The event-exact motor under the torques of further effects, held for a PWM period.

use super::super::dc_motor::Torques;
use super::super::{BridgeLosses, DcMotor, Inputs, Motion, PeriodEnd, Plant, Pwm};
use super::followed_wave::FollowedWave;
use super::{LONGEST_STEP_S, event_exact, exact_losses, is_exact, motor_inertia_kg_m2};
use motorbench_model::catalogue::{Balance, Instant};
use motorbench_model::motor::MotorParameters;
use motorbench_model::{Model, Term};

/// The event-exact motor under further torques, which are held for a PWM period, at most for [`LONGEST_STEP_S`].
#[derive(Clone, Debug)]
pub(super) struct Held {
    pub(super) motor: DcMotor,
    pub(super) torques: FurtherTorques,
}

impl Held {
    pub(super) fn new(bridge: BridgeLosses, model: Model) -> Self {
        Self { motor: event_exact(bridge, &model), torques: FurtherTorques::of(model) }
    }

    /// Sets the resistance of the warm winding.
    #[inline(always)]
    pub(super) fn warm_up(&mut self) {
        if !self.torques.warms_up {
            return;
        }
        let (now_ohm, was_ohm) = (self.torques.resistance_ohm(), self.motor.parameters().resistance_ohm);
        if (now_ohm / was_ohm - 1.0).abs() > RESISTANCE_STEP {
            self.motor.set_resistance_ohm(now_ohm);
        }
    }
}

/// Relative change of the resistance below which it is taken as constant: a few ticks of a winding that warms up.
pub(super) const RESISTANCE_STEP: f64 = 1e-5;

/// Torques of effects, and their memory.
#[derive(Clone, Debug)]
pub(super) struct FurtherTorques {
    pub(super) motor: MotorParameters,
    /// Coulomb friction, to which they add.
    pub(super) friction_nm: f64,
    pub(super) waves: Vec<FollowedWave>,
    /// All other effects, and their states.
    pub(super) terms: Vec<(Term, Vec<f64>)>,
    /// Whether any of them has a state, and whether any acts on the resistance.
    pub(super) remembers: bool,
    pub(super) warms_up: bool,
    pub(super) inertia_kg_m2: f64,
    pub(super) time_s: f64,
    pub(super) step: Step,
}

/// Inputs of the effects' memory for the current step.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Step {
    pub(super) length_s: f64,
    /// The pulse's part of it.
    pub(super) pulse_part: f64,
    /// Current at its start.
    pub(super) start_a: f64,
}

impl FurtherTorques {
    pub(super) fn of(model: Model) -> Self {
        let others = model.terms.iter().filter(|term| !is_exact(term));
        let (waves, terms): (Vec<_>, Vec<_>) = others.partition(|term| term.effect.wave(&term.values).is_some());
        let with_state = |term: &Term| (term.clone(), vec![0.0; term.effect.states()]);
        Self {
            friction_nm: exact_losses(&model).friction_forward_nm,
            waves: waves.iter().filter_map(|term| term.effect.wave(&term.values)).map(FollowedWave::new).collect(),
            remembers: terms.iter().any(|term| term.effect.states() > 0),
            warms_up: terms.iter().any(|term| term.effect.about().is_slow_resistance),
            terms: terms.into_iter().map(with_state).collect(),
            inertia_kg_m2: motor_inertia_kg_m2(&model),
            motor: model.motor,
            time_s: 0.0,
            step: Step::default(),
        }
    }

    /// Of a step from this state on, with the angle in its middle. `pulse_a`: the current at the end of the last pulse.
    #[inline(always)]
    pub(super) fn over(
        &mut self,
        step_s: f64,
        pulse_part: f64,
        (start, pulse_a): (&Motion, f64),
        inputs: &Inputs,
    ) -> Torques {
        if self.remembers {
            self.remember(start, pulse_a);
            self.step = Step { length_s: step_s, pulse_part, start_a: start.current_a };
        }
        let step_rad = step_s * start.speed_rad_per_s;
        let angle_rad = start.angle_rad + 0.5 * step_rad;
        let waves_nm: f64 = self.waves.iter_mut().map(|wave| wave.torque_nm(angle_rad, step_rad)).sum();
        let torque_nm = waves_nm - inputs.load_torque_nm;
        if self.terms.is_empty() {
            return Torques { load_nm: -torque_nm, friction_nm: self.friction_nm };
        }
        let at = self.instant(step_s, &Motion { angle_rad, ..*start }, inputs.supply_v);
        self.of_terms(&at, torque_nm)
    }

    pub(super) fn instant(&self, step_s: f64, state: &Motion, supply_v: f64) -> Instant {
        Instant {
            time_s: self.time_s,
            // No torque depends on the bridge.
            voltage_v: 0.0,
            duty: 0.0,
            mean_duty: 0.0,
            supply_v,
            // So the current is taken as it is.
            open: true,
            current_a: state.current_a,
            speed_rad_per_s: state.speed_rad_per_s,
            middle_rad_per_s: state.speed_rad_per_s,
            angle_rad: state.angle_rad,
            turned_rad: 0.0,
            step_s,
        }
    }

    /// Beside a torque.
    pub(super) fn of_terms(&mut self, at: &Instant, torque_nm: f64) -> Torques {
        let mut terms = Balance {
            torque_nm,
            dry_forward_nm: self.friction_nm,
            dry_backward_nm: self.friction_nm,
            ..Balance::default()
        };
        for (term, state) in &mut self.terms {
            term.effect.contribute(&term.values, &self.motor, at, state, &mut terms);
        }
        // Friction that differs by direction is the same in both, and a load.
        let asymmetry_nm = 0.5 * (terms.dry_forward_nm - terms.dry_backward_nm);
        // Damping in the middle of the step, of the speed that it leaves there: stable however strong it is.
        let damping_nm_s = terms.viscous_nm_s / (1.0 + 0.5 * at.step_s * terms.viscous_nm_s / self.inertia_kg_m2);
        Torques {
            load_nm: asymmetry_nm + damping_nm_s * at.speed_rad_per_s - terms.torque_nm,
            friction_nm: (0.5 * (terms.dry_forward_nm + terms.dry_backward_nm)).max(0.0),
        }
    }

    /// Ends the last step, if there is one: updates the effects' memory over it.
    pub(super) fn remember(&mut self, end: &Motion, pulse_a: f64) {
        if self.step.length_s <= 0.0 {
            return;
        }
        let Step { length_s, pulse_part, start_a } = std::mem::take(&mut self.step);
        let mut at = self.instant(length_s, end, 0.0);
        // Linear from the start to the end of the pulse and on to the end of the period; the square of the current
        // heats.
        let line = |from: f64, to: f64| (from * from + from * to + to * to) * (1.0 / 3.0);
        let square = pulse_part * line(start_a, pulse_a) + (1.0 - pulse_part) * line(pulse_a, end.current_a);
        at.current_a = square.sqrt().copysign(end.current_a);
        for (term, state) in &mut self.terms {
            term.effect.advance(&term.values, &self.motor, &at, state);
        }
    }

    /// Of the winding.
    pub(super) fn resistance_ohm(&mut self) -> f64 {
        let mut terms = Balance::default();
        let at = self.instant(LONGEST_STEP_S, &Motion::default(), 0.0);
        for (term, state) in self.terms.iter_mut().filter(|(term, _)| term.effect.about().is_slow_resistance) {
            term.effect.contribute(&term.values, &self.motor, &at, state, &mut terms);
        }
        self.motor.resistance_ohm + terms.resistance_ohm
    }
}

impl Plant for Held {
    fn advance(&mut self, dt_s: f64, inputs: &Inputs) {
        if dt_s <= 0.0 {
            return;
        }
        let steps = (dt_s / LONGEST_STEP_S - 1e-9).ceil().max(1.0);
        let step_s = dt_s / steps;
        for _ in 0..steps as usize {
            self.warm_up();
            let start_a = self.motor.current_a();
            let torques = self.torques.over(step_s, 0.0, (self.motor.motion(), start_a), inputs);
            self.motor.advance_under(step_s, inputs, torques);
            self.torques.remember(self.motor.motion(), start_a);
            self.torques.time_s += step_s;
        }
    }

    fn advance_pwm(&mut self, pwm: &Pwm, inputs: &Inputs, ends: &mut [PeriodEnd]) {
        self.warm_up();
        let from_s = self.torques.time_s;
        let torques = &mut self.torques;
        let pulse_part = pwm.pulse_s / pwm.period_s;
        let mut period = 0.0;
        let pulse_a = self.motor.advance_pwm_under(pwm, inputs, ends, |state, pulse_a| {
            torques.time_s = from_s + period * pwm.period_s;
            period += 1.0;
            torques.over(pwm.period_s, pulse_part, (state, pulse_a), inputs)
        });
        self.torques.remember(self.motor.motion(), pulse_a);
        self.torques.time_s = from_s + ends.len() as f64 * pwm.period_s;
    }

    fn angle_rad(&self) -> f64 {
        self.motor.angle_rad()
    }

    fn speed_rad_per_s(&self) -> f64 {
        self.motor.speed_rad_per_s()
    }

    fn current_a(&self) -> f64 {
        self.motor.current_a()
    }

    fn supply_v(&self) -> f64 {
        self.motor.supply_v()
    }
}
