//! Draws a bench from a recipe: its constants, its friction, and the strength of each hidden effect.

use super::{Bench, COPPER_PER_K, Commutation, Darlingtons, Friction, Hidden, Lag};
use crate::{Effect, Excitation, Motor, Recipe, log_uniform};
use rand::{Rng, RngExt};
use std::f64::consts::TAU;

const PWM_PERIOD_S: f64 = 50e-6;
/// Of the Uno's timers, prescaled by eight: phase correct and fast.
const UNO_PERIODS_S: [f64; 2] = [255e-6, 128e-6];
/// Share of soft supplies without a capacitor.
const WITHOUT_CAPACITOR_SHARE: f64 = 0.3;
/// Share of falling frictions that fall exponentially.
const TUSTIN_SHARE: f64 = 0.3;

/// Effects that are sized as a share of the Coulomb level come after it.
fn put_coulomb_before_its_dependants(effects: &mut [(Effect, f64)]) {
    let coulomb = effects.iter().position(|(effect, _)| *effect == Effect::CoulombFriction);
    let dependant = effects.iter().position(|(effect, _)| effect.needs_coulomb());
    if let (Some(coulomb), Some(dependant)) = (coulomb, dependant)
        && dependant < coulomb
    {
        effects[dependant..=coulomb].rotate_right(1);
    }
}

/// Constants by the catalogue's names.
type Constants = Vec<(&'static str, f64)>;
type Found = Vec<(Effect, Constants)>;

/// How strong an effect is, with the draws that many effects need.
struct Size {
    strength: f64,
    stall_nm: f64,
    sign: f64,
    phase: f64,
}

impl Size {
    /// A value for the strength: 0 gives the weakest, 1 the strongest, and each unit below 0 a tenth of the weakest.
    fn between(&self, weakest: f64, strongest: f64) -> f64 {
        match self.strength < 0.0 {
            true => weakest * 10_f64.powf(self.strength),
            false => weakest + (strongest - weakest) * self.strength,
        }
    }
}

impl Bench {
    /// Draws the bench of a recipe.
    pub fn draw(motor: Motor, recipe: &Recipe, random: &mut impl Rng) -> (Self, Found) {
        let supply_v = random.random_range(10.0..13.0);
        let k = motor.torque_constant_nm_per_a;
        let top_speed = supply_v / k;
        // As many lines as 60,000 edges a second allow.
        let counts_per_rev = [200.0, 256.0, 400.0, 512.0, 1024.0, 2048.0]
            .into_iter()
            .rfind(|counts| counts * top_speed / TAU < 60_000.0)
            .unwrap_or(64.0);
        let friction = if random.random_bool(0.5) { Friction::Karnopp } else { Friction::LuGre };
        let mut bench = Self {
            motor,
            hidden: Hidden { clip_share: f64::INFINITY, lost_above: f64::INFINITY, ..Hidden::default() },
            supply_v,
            counts_per_rev,
            top_speed,
            friction,
            pwm_period_s: match recipe.timer_of_the_uno {
                true => UNO_PERIODS_S[random.random_range(0..UNO_PERIODS_S.len())],
                false => PWM_PERIOD_S,
            },
            time_s: 0.0,
            current_a: 0.0,
            smooth_a: 0.0,
            lagged_a: 0.0,
            lagged_rad_per_s: 0.0,
            summed_as: 0.0,
            summed_s: 0.0,
            drawn_a: 0.0,
            speed: 0.0,
            angle: 0.0,
            bristle: 0.0,
            load_speed: 0.0,
            twist: 0.0,
            heat_k: 0.0,
            moments_seed: random.random_range(0.0..1000.0),
        };
        let mut effects = recipe.effects.clone();
        let has = |effects: &[(Effect, f64)], effect| effects.iter().any(|(other, _)| *other == effect);
        let needs_coulomb = effects.iter().any(|(effect, _)| effect.needs_coulomb());
        for (effect, wanted) in
            [(Effect::CoulombFriction, recipe.real_rig || needs_coulomb), (Effect::VoltageDrop, recipe.real_rig)]
        {
            if wanted && !has(&effects, effect) {
                effects.insert(0, (effect, random.random_range(0.2..0.8)));
            }
        }
        put_coulomb_before_its_dependants(&mut effects);
        let mut found = Vec::new();
        for (effect, strength) in effects {
            found.push((effect, bench.hide(effect, strength, recipe, random)));
        }
        bench.settle_coulomb(&mut found);
        (bench, found)
    }

    /// The Coulomb level that counts is the warm one, which a warm-up lowers after it was drawn.
    fn settle_coulomb(&self, found: &mut Found) {
        for (_, constants) in found.iter_mut().filter(|(effect, _)| *effect == Effect::CoulombFriction) {
            *constants = vec![("torque_Nm", self.hidden.coulomb_nm)];
        }
    }

    /// Hides one effect; returns its constants by the catalogue's names, where a number can be compared.
    fn hide(&mut self, effect: Effect, strength: f64, recipe: &Recipe, random: &mut impl Rng) -> Constants {
        let size = Size {
            strength,
            stall_nm: self.motor.torque_constant_nm_per_a * self.supply_v / self.motor.resistance_ohm,
            sign: if random.random_bool(0.5) { 1.0 } else { -1.0 },
            phase: random.random_range(0.0..TAU),
        };
        self.hide_friction(effect, &size, recipe, random)
            .or_else(|| self.hide_load(effect, &size, recipe, random))
            .or_else(|| self.hide_in_bridge(effect, &size, recipe, random))
            .or_else(|| self.hide_in_winding(effect, &size, recipe, random))
            .or_else(|| self.hide_in_readings(effect, &size, recipe, random))
            .or_else(|| self.hide_outside(effect, &size, random))
            .expect("each effect belongs to one of these")
    }

    /// Friction of bearings and brushes, and drag.
    fn hide_friction(
        &mut self,
        effect: Effect,
        size: &Size,
        recipe: &Recipe,
        random: &mut impl Rng,
    ) -> Option<Constants> {
        let hidden = &mut self.hidden;
        Some(match effect {
            Effect::CoulombFriction => {
                hidden.coulomb_nm = size.between(0.03, 0.15) * size.stall_nm;
                vec![("torque_Nm", hidden.coulomb_nm)]
            }
            Effect::StribeckFriction => {
                hidden.excess_nm = size.between(0.4, 1.2) * hidden.coulomb_nm;
                hidden.stribeck_speed = random.random_range(0.015..0.05) * self.top_speed;
                hidden.stribeck_power = if size.phase < TUSTIN_SHARE * TAU { 1 } else { 2 };
                vec![
                    ("excess_torque_Nm", hidden.excess_nm),
                    ("stribeck_speed_rad_per_s", hidden.stribeck_speed),
                    ("exponential", f64::from(u8::from(hidden.stribeck_power == 1))),
                ]
            }
            Effect::FrictionAsymmetry => {
                hidden.asymmetry_nm = size.sign * size.between(0.15, 0.45) * hidden.coulomb_nm;
                vec![("difference_Nm", 2.0 * hidden.asymmetry_nm)]
            }
            Effect::FrictionWarmup => {
                let fall = size.between(0.25, 0.55);
                hidden.warmup_share = fall / (1.0 - fall);
                hidden.warmup_s = random.random_range(0.15..0.4) * recipe.duration_s;
                // The level that is left in the end.
                hidden.coulomb_nm *= 1.0 - fall;
                vec![("excess_share", hidden.warmup_share), ("time_constant_s", hidden.warmup_s)]
            }
            Effect::QuadraticDrag => {
                hidden.drag = size.between(0.04, 0.25) * size.stall_nm / self.top_speed.powi(2);
                vec![("drag_Nm_s2", hidden.drag)]
            }
            _ => return None,
        })
    }

    /// What pulls at the shaft, over time or over the angle, and what hangs behind it.
    fn hide_load(&mut self, effect: Effect, size: &Size, recipe: &Recipe, random: &mut impl Rng) -> Option<Constants> {
        let hidden = &mut self.hidden;
        Some(match effect {
            Effect::LoadTorque => {
                hidden.load_nm = size.sign * size.between(0.03, 0.15) * size.stall_nm;
                vec![("torque_Nm", hidden.load_nm)]
            }
            Effect::LoadStep => {
                hidden.step_nm = size.sign * size.between(0.04, 0.15) * size.stall_nm;
                hidden.step_s = random.random_range(0.3..0.7) * recipe.duration_s;
                vec![("torque_Nm", hidden.step_nm), ("time_s", hidden.step_s)]
            }
            Effect::Cogging => {
                hidden.cogging_nm = size.between(0.02, 0.10) * size.stall_nm;
                hidden.cogging_periods = f64::from(random.random_range(3_u8..=12));
                hidden.cogging_phase = size.phase;
                vec![("periods_per_rev", hidden.cogging_periods)]
            }
            Effect::GravityUnbalance => {
                hidden.gravity_nm = size.between(0.02, 0.12) * size.stall_nm;
                hidden.gravity_phase = size.phase;
                Vec::new()
            }
            Effect::Backlash => {
                hidden.gap_rad = size.between(2.0, 8.0).to_radians();
                hidden.load_share = random.random_range(0.3..0.6);
                hidden.contact_hz = log_uniform(random, 60.0, 600.0);
                hidden.contact_damping = random.random_range(0.2..0.6);
                vec![("gap_rad", hidden.gap_rad), ("load_inertia_share", hidden.load_share)]
            }
            Effect::ShaftCompliance => {
                hidden.load_share = size.between(0.3, 0.6);
                hidden.spring_hz = log_uniform(random, 8.0, 45.0);
                hidden.spring_damping = random.random_range(0.02..0.08);
                vec![("resonance_Hz", hidden.spring_hz), ("load_inertia_share", hidden.load_share)]
            }
            _ => return None,
        })
    }

    /// What the voltage meets on its way to the winding.
    fn hide_in_bridge(
        &mut self,
        effect: Effect,
        size: &Size,
        recipe: &Recipe,
        random: &mut impl Rng,
    ) -> Option<Constants> {
        let hidden = &mut self.hidden;
        Some(match effect {
            Effect::VoltageDrop if recipe.darlingtons => {
                let bridge = Darlingtons::draw(random);
                (hidden.darlingtons, hidden.drop_v) = (Some(bridge), bridge.in_pulse.foot_v);
                Vec::new()
            }
            Effect::VoltageDrop => {
                hidden.drop_v = size.between(0.5, 2.5);
                hidden.drop_averaged = random.random_bool(0.3);
                let knee_share = if random.random_bool(0.5) { 0.0 } else { random.random_range(0.002..0.02) };
                hidden.drop_knee_a = knee_share * self.supply_v / self.motor.resistance_ohm;
                vec![("drop_V", hidden.drop_v)]
            }
            Effect::SupplySag => {
                hidden.sag_ohm = size.between(0.1, 0.4) * self.motor.resistance_ohm;
                hidden.sags_in_pulses = size.phase < WITHOUT_CAPACITOR_SHARE * TAU;
                vec![("resistance_ohm", hidden.sag_ohm), ("within_pulses", f64::from(hidden.sags_in_pulses))]
            }
            Effect::CoastDecay => {
                hidden.coasts = true;
                // A loop's sketch has no duty of zero.
                hidden.coasts_at_zero_duty = recipe.excitation == Excitation::Identify && random.random_bool(0.4);
                Vec::new()
            }
            Effect::ActuationDelay => {
                hidden.delay_s = size.between(0.003, 0.010);
                vec![("delay_s", hidden.delay_s)]
            }
            Effect::ClockDrift => {
                let drift_ppm = size.sign * size.between(100.0, 1000.0);
                hidden.delay_growth = 1e-6 * drift_ppm;
                vec![("drift_ppm", drift_ppm)]
            }
            Effect::BridgeAsymmetry => {
                let less = size.between(0.03, 0.2);
                hidden.weaker_backward = size.sign * less;
                vec![("backward_share", if size.sign > 0.0 { -less } else { 1.0 / (1.0 - less) - 1.0 })]
            }
            Effect::DropAsymmetry => {
                hidden.drop_asymmetry = size.sign * size.between(0.15, 0.4);
                vec![("difference_V", 2.0 * hidden.drop_asymmetry * hidden.drop_v)]
            }
            _ => return None,
        })
    }

    /// What the winding does.
    fn hide_in_winding(
        &mut self,
        effect: Effect,
        size: &Size,
        recipe: &Recipe,
        random: &mut impl Rng,
    ) -> Option<Constants> {
        let hidden = &mut self.hidden;
        Some(match effect {
            Effect::WindingHeating => {
                // Mean dissipation of the sequences is about a twelfth of that at standstill.
                let power_w = self.supply_v.powi(2) / self.motor.resistance_ohm / 12.0;
                hidden.heating_k_per_w = size.between(0.15, 0.45) / COPPER_PER_K / power_w;
                hidden.heating_s = random.random_range(0.25..0.8) * recipe.duration_s;
                vec![("rise_per_W", hidden.heating_k_per_w * COPPER_PER_K), ("time_constant_s", hidden.heating_s)]
            }
            Effect::ResistanceGrowingWithSpeed => {
                hidden.growth_ohm_s = size.between(0.15, 0.6) * self.motor.resistance_ohm / self.top_speed;
                vec![("growth_ohm_s", hidden.growth_ohm_s)]
            }
            Effect::CommutationRipple => {
                hidden.commutation = Commutation::draw(size.between(0.02, 0.05), size.phase, random);
                vec![
                    ("amplitude_share", hidden.commutation.depth),
                    ("ripples_per_rev", hidden.commutation.ripples_per_rev),
                ]
            }
            _ => return None,
        })
    }

    /// What the sensors make of current and speed.
    fn hide_in_readings(
        &mut self,
        effect: Effect,
        size: &Size,
        recipe: &Recipe,
        random: &mut impl Rng,
    ) -> Option<Constants> {
        let hidden = &mut self.hidden;
        Some(match effect {
            Effect::CurrentOffset => {
                hidden.offset_a = size.sign * size.between(0.04, 0.15);
                vec![("offset_A", hidden.offset_a)]
            }
            Effect::CurrentLag => {
                hidden.current_lag = Lag::draw(size.between(0.003, 0.015), random);
                vec![("time_constant_s", hidden.current_lag.time_constant_s)]
            }
            Effect::SpeedLag => {
                hidden.speed_lag = Lag::draw(size.between(0.003, 0.015), random);
                vec![("time_constant_s", hidden.speed_lag.time_constant_s)]
            }
            Effect::CurrentClipping => {
                hidden.clip_share = 1.0 - size.between(0.3, 0.6);
                Vec::new()
            }
            Effect::EncoderEccentricity => {
                hidden.eccentricity_rad = size.between(0.6, 3.0).to_radians();
                hidden.eccentricity_phase = size.phase;
                Vec::new()
            }
            Effect::MissedCounts => {
                hidden.lost_share = size.between(0.05, 0.20);
                hidden.lost_above = random.random_range(0.55..0.75);
                hidden.lost_of_all = random.random_bool(0.4);
                let is_gradual = hidden.lost_of_all && random.random_bool(0.5);
                hidden.lost_onset = if is_gradual { random.random_range(0.1..0.5) } else { 0.0 };
                hidden.counter_stop_s = size.between(0.02, 0.05) * 10_f64.powf(random.random_range(-0.8..0.0));
                // A speed timed from edge to edge does not show it.
                hidden.counter_stops = recipe.channels.has_counts() && random.random_bool(0.3);
                let by_chance = recipe.channels.speed_is_of_counts() && random.random_bool(0.5);
                hidden.lost_at_random = by_chance && !hidden.counter_stops;
                if hidden.counter_stops { vec![("stop_s", hidden.counter_stop_s)] } else { Vec::new() }
            }
            Effect::TachoRipple => {
                hidden.ripple = size.between(0.02, 0.05);
                hidden.ripples = f64::from(random.random_range(11_u8..=31));
                vec![("ripples_per_rev", hidden.ripples)]
            }
            _ => return None,
        })
    }

    /// What the catalogue does not know.
    fn hide_outside(&mut self, effect: Effect, size: &Size, random: &mut impl Rng) -> Option<Constants> {
        let hidden = &mut self.hidden;
        Some(match effect {
            Effect::OutsideCube => {
                hidden.cube = size.between(0.06, 0.25) * size.stall_nm / self.top_speed.powi(3);
                Vec::new()
            }
            Effect::OutsideShaker => {
                hidden.shaker_nm = size.between(0.06, 0.15) * size.stall_nm;
                hidden.shaker_hz = random.random_range(4.0..9.0);
                Vec::new()
            }
            Effect::OutsideSaturation => {
                hidden.saturation = size.between(0.25, 0.5);
                Vec::new()
            }
            Effect::OutsideDropouts => {
                hidden.dropouts = true;
                hidden.dropout_s = size.between(0.03, 0.06);
                Vec::new()
            }
            Effect::OutsideDrift => {
                hidden.drift = size.between(0.05, 0.15);
                Vec::new()
            }
            Effect::OutsideDeadBand => {
                hidden.dead_band = size.between(0.08, 0.2) * self.top_speed;
                Vec::new()
            }
            Effect::OutsideSpindle => {
                hidden.spindle_nm = size.between(0.05, 0.15) * size.stall_nm;
                hidden.spindle_revolutions = random.random_range(5.0..9.0);
                Vec::new()
            }
            Effect::OutsideSpring => {
                hidden.spring_nm = size.between(0.005, 0.06) * size.stall_nm;
                hidden.spring_rad = random.random_range(20.0..60.0);
                Vec::new()
            }
            Effect::OutsideGrip => {
                hidden.grip_nm = size.between(0.3, 1.0) * size.stall_nm;
                hidden.grip_s = random.random_range(0.02..0.05);
                Vec::new()
            }
            _ => return None,
        })
    }
}
