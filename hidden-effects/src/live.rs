//! A bench for a program that switches its bridge itself, instead of a recording.

use crate::rig::Bench;
use crate::{ChaCha8Rng, Recipe, SeedableRng, Truth, draw_motor, wrong};

const LONGEST_STEP_S: f64 = 10e-6;

/// Connection of the motor by the bridge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// The supply.
    Forward,
    /// The supply with opposite sign.
    Reverse,
    /// A short circuit of the motor.
    Short,
    /// Open: the current decays through the diodes, against the supply.
    Off,
}

/// A bench with hidden effects of the motor, the load and the bridge. Sensors with their effects and a delayed command
/// are not part of it.
#[derive(Clone, Debug)]
pub struct LiveBench {
    bench: Bench,
}

impl LiveBench {
    /// Draws a bench whose winding has at least `least_resistance_ohm`, and hides the effects of the recipe in it. The
    /// same arguments give the same bench.
    pub fn draw(seed: u64, recipe: &Recipe, least_resistance_ohm: f64) -> (Self, Truth) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let motor = loop {
            let motor = draw_motor(&mut random);
            if motor.resistance_ohm >= least_resistance_ohm {
                break motor;
            }
        };
        let (bench, effects) = Bench::draw(motor, recipe, &mut random);
        let nominal = wrong(motor, &mut random);
        (Self { bench }, Truth { effects, motor, nominal, mistake: None, drop_shows: true, bridge_resists: false })
    }

    /// Lets time pass under one state of the bridge.
    pub fn advance(&mut self, dt_s: f64, switch: Switch) {
        let steps = (dt_s / LONGEST_STEP_S).ceil();
        for _ in 0..steps as usize {
            self.bench.switched_step(switch, dt_s / steps);
        }
    }

    /// Supply voltage.
    pub fn supply_v(&self) -> f64 {
        self.bench.supply_v
    }

    /// Angle of the shaft.
    pub fn angle_rad(&self) -> f64 {
        self.bench.angle
    }

    /// Speed of the shaft.
    pub fn speed_rad_per_s(&self) -> f64 {
        self.bench.speed
    }

    /// Current of the armature.
    pub fn current_a(&self) -> f64 {
        self.bench.current_a
    }

    /// Lines of the encoder, times four.
    pub fn counts_per_rev(&self) -> f64 {
        self.bench.counts_per_rev
    }
}
