//! A model with any effects, step by step.

use super::super::{Bridge, BridgeLosses, Inputs, Plant};
use super::{LONGEST_STEP_S, motor_inertia_kg_m2};
use motorbench_model::catalogue::{Balance, Instant};
use motorbench_model::{Input, Late, LinearSteps, Model};

/// Time constant of the capacitor at the bridge: some tenths of an ohm and some millifarads.
pub(super) const CAPACITOR_S: f64 = 1e-3;

#[derive(Clone, Debug)]
pub(super) struct Stepwise {
    pub(super) model: Model,
    pub(super) bridge: BridgeLosses,
    pub(super) steps: LinearSteps,
    pub(super) states: Vec<Vec<f64>>,
    pub(super) time_s: f64,
    pub(super) angle_rad: f64,
    pub(super) speed_rad_per_s: f64,
    pub(super) current_a: f64,
    pub(super) supply_v: f64,
    pub(super) mean_duty: f64,
}

impl Stepwise {
    pub(super) fn new(bridge: BridgeLosses, model: Model) -> Self {
        Self {
            steps: LinearSteps::new(&model.motor, motor_inertia_kg_m2(&model)),
            states: model.terms.iter().map(|term| vec![0.0; term.effect.states()]).collect(),
            model,
            bridge,
            time_s: 0.0,
            angle_rad: 0.0,
            speed_rad_per_s: 0.0,
            current_a: 0.0,
            supply_v: 0.0,
            mean_duty: 0.0,
        }
    }

    pub(super) fn step(&mut self, step_s: f64, inputs: &Inputs) {
        let mut terms = Balance { torque_nm: -inputs.load_torque_nm, ..Balance::default() };
        let (duty, drop_v) = match inputs.bridge {
            Bridge::Forward => (1.0, self.bridge.drive_v),
            Bridge::Reverse => (-1.0, self.bridge.drive_v),
            Bridge::Brake => (0.0, self.bridge.brake_v),
            // The current flows on against the supply, through two diodes, until it is nothing.
            Bridge::Coast => (0.0, inputs.supply_v + 2.0 * self.bridge.diode_v),
        };
        terms.dry_drop_v = drop_v;
        self.mean_duty += (duty - self.mean_duty) * step_s / (CAPACITOR_S + step_s);
        let mut at = Instant {
            time_s: self.time_s,
            voltage_v: duty * inputs.supply_v,
            duty,
            mean_duty: self.mean_duty,
            supply_v: inputs.supply_v,
            open: false,
            current_a: self.current_a,
            speed_rad_per_s: self.speed_rad_per_s,
            middle_rad_per_s: self.speed_rad_per_s,
            angle_rad: self.angle_rad,
            turned_rad: 0.0,
            step_s,
        };
        for (term, state) in self.model.terms.iter().zip(&mut self.states) {
            term.effect.contribute(&term.values, &self.model.motor, &at, state, &mut terms);
        }
        let before = self.speed_rad_per_s;
        let linear = self.steps.of_length(step_s);
        let reached = linear.take(self.current_a, before, Input::Voltage(at.voltage_v), Late::default(), &terms);
        (self.current_a, self.speed_rad_per_s) = (reached.current_a, reached.speed_rad_per_s);
        if inputs.blocked {
            self.speed_rad_per_s = 0.0;
        }
        self.angle_rad += 0.5 * (before + self.speed_rad_per_s) * step_s;
        self.time_s += step_s;
        at.current_a = self.current_a;
        at.speed_rad_per_s = self.speed_rad_per_s;
        for (term, state) in self.model.terms.iter().zip(&mut self.states) {
            term.effect.advance(&term.values, &self.model.motor, &at, state);
        }
    }
}

impl Plant for Stepwise {
    fn advance(&mut self, dt_s: f64, inputs: &Inputs) {
        self.supply_v = inputs.supply_v;
        if dt_s <= 0.0 {
            return;
        }
        let steps = (dt_s / LONGEST_STEP_S - 1e-9).ceil().max(1.0);
        for _ in 0..steps as usize {
            self.step(dt_s / steps, inputs);
        }
    }

    fn angle_rad(&self) -> f64 {
        self.angle_rad
    }

    fn speed_rad_per_s(&self) -> f64 {
        self.speed_rad_per_s
    }

    fn current_a(&self) -> f64 {
        self.current_a
    }

    fn supply_v(&self) -> f64 {
        self.supply_v
    }
}
