//! Each hidden effect against a formula by hand, and the form of what is handed out.
//!
//! Most tests drive a staircase, which draws nothing. Two trials of one seed then have the same motor and the same
//! duty; they differ by what is hidden alone. Balances are checked at the ends of its stairs, where nothing
//! accelerates.

mod recorded;

use hidden_effects::{Channels, Effect, Excitation, Recipe, Trial, draw};
use recorded::{
    Columns, STAIRS, STANDSTILL, Steady, columns, constant, lost_nm, lost_v, mean, moving_stairs, recorded, rig_value,
    rms, rows, stall_nm, steady,
};
use std::cell::Cell;
use std::f64::consts::TAU;
use std::ops::Range;

const SEEDS: Range<u64> = 1..4;
/// The torque balance at every stair that moves, to half a percent of the stall torque.
fn assert_torque(effects: &[Effect], expected_nm: impl Fn(&Trial, Steady) -> f64) {
    for seed in SEEDS {
        let (trial, columns) = recorded(seed, effects);
        for at in moving_stairs(&columns) {
            let (lost, expected) = (lost_nm(&trial, at), expected_nm(&trial, at));
            assert!((lost - expected).abs() < 0.005 * stall_nm(&trial), "seed {seed}, {at:?}: {lost} for {expected}");
        }
    }
}

/// The voltage balance at every stair that moves, to half a percent of the supply.
fn assert_voltage(seeds: Range<u64>, effects: &[Effect], expected_v: impl Fn(&Trial, Steady) -> f64) {
    for seed in seeds {
        let (trial, columns) = recorded(seed, effects);
        for at in moving_stairs(&columns) {
            let (lost, expected) = (lost_v(&trial, at), expected_v(&trial, at));
            let bound = 0.005 * rig_value(&trial, "voltage_V");
            assert!((lost - expected).abs() < bound, "seed {seed}, {at:?}: {lost} for {expected}");
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_trial() {
    for excitation in [Excitation::Identify, Excitation::ClosedLoop] {
        let recipe = Recipe { excitation, duration_s: 2.0, ..Recipe::of(&[Effect::Cogging]).on_real_rig() };
        let (first, second, other) = (draw(3, &recipe), draw(3, &recipe), draw(4, &recipe));
        assert_eq!((&first.csv, &first.rig_toml), (&second.csv, &second.rig_toml));
        assert_ne!(first.csv, other.csv);
    }
}

#[test]
fn every_channel_set_has_its_columns_and_numbers_in_each() {
    let sets = [
        (Channels::Full, "t_s,duty,u_V,counts,omega_rad_per_s,i_A"),
        (Channels::VoltageSpeedCurrent, "t_s,u_V,omega_rad_per_s,i_A"),
        (Channels::DutyCountsCurrent, "t_s,duty,counts,i_A"),
        (Channels::VoltageSpeed, "t_s,u_V,omega_rad_per_s"),
    ];
    for (channels, header) in sets {
        let trial = draw(1, &Recipe { channels, duration_s: 1.0, ..Recipe::of(&[]) });
        assert_eq!(trial.csv.lines().next(), Some(header));
        let rows = rows(&trial.csv);
        assert_eq!(rows.len(), 1000);
        assert_eq!(rows[0][0], 0.0);
        let width = header.split(',').count();
        assert!(rows.iter().all(|row| row.len() == width && row.iter().all(|value| value.is_finite())));
    }
}

#[test]
fn every_effect_is_listed_and_brings_the_friction_it_stands_on() {
    for effect in Effect::CATALOGUE.into_iter().chain(Effect::OUTSIDE) {
        let recipe = Recipe { duration_s: 1.0, ..Recipe::of(&[effect]) };
        let listed = |recipe: &Recipe| -> Vec<Effect> {
            draw(1, recipe).truth.effects.into_iter().map(|(effect, _)| effect).collect()
        };
        let alone = listed(&recipe);
        assert!(alone.contains(&effect));
        assert_eq!(alone.len(), 1 + usize::from(effect.needs_coulomb()), "{}", effect.id());
        let real = listed(&recipe.on_real_rig());
        assert!(real.contains(&Effect::CoulombFriction) && real.contains(&Effect::VoltageDrop), "{}", effect.id());
    }
}

#[test]
fn nominal_values_are_those_of_the_rig_file_and_at_most_a_fifth_off() {
    for seed in SEEDS {
        let trial = draw(seed, &Recipe { duration_s: 0.1, ..Recipe::of(&[]) });
        let (motor, nominal) = (trial.truth.motor, trial.truth.nominal);
        let pairs = [
            ("resistance_ohm", motor.resistance_ohm, nominal.resistance_ohm),
            ("inductance_H", motor.inductance_h, nominal.inductance_h),
            ("torque_constant_Nm_per_A", motor.torque_constant_nm_per_a, nominal.torque_constant_nm_per_a),
            ("inertia_kg_m2", motor.inertia_kg_m2, nominal.inertia_kg_m2),
            ("viscous_friction_Nm_s", motor.viscous_friction_nm_s, nominal.viscous_friction_nm_s),
        ];
        for (key, truth, stated) in pairs {
            assert_eq!(rig_value(&trial, key), stated);
            assert!((stated / truth - 1.0).abs() <= 0.2, "seed {seed}, {key}");
        }
    }
}

#[test]
fn a_clean_bench_keeps_both_balances() {
    assert_torque(&[], |_, _| 0.0);
    assert_voltage(SEEDS, &[], |_, _| 0.0);
}

#[test]
fn a_clean_motor_approaches_its_speed_with_the_mechanical_time_constant() {
    for seed in SEEDS {
        let (trial, columns) = recorded(seed, &[]);
        let motor = trial.truth.motor;
        let damping = motor.torque_constant_nm_per_a.powi(2) / motor.resistance_ohm + motor.viscous_friction_nm_s;
        let electrical_s = motor.inductance_h / motor.resistance_ohm;
        let end = steady(&columns, 0).speed_rad_per_s;
        // The area above the step response is the sum of the time constants, near enough.
        let length = columns.time_s.len() / STAIRS;
        let area_s = columns.speed_rad_per_s[..length].iter().map(|speed| 1e-3 * (1.0 - speed / end)).sum::<f64>();
        let expected_s = motor.inertia_kg_m2 / damping + electrical_s;
        assert!((area_s / expected_s - 1.0).abs() < 0.08, "seed {seed}: {area_s} s for {expected_s} s");
    }
}

#[test]
fn coulomb_friction_takes_its_level_against_the_motion() {
    let effect = Effect::CoulombFriction;
    assert_torque(&[effect], |trial, at| constant(trial, effect, "torque_Nm") * at.speed_rad_per_s.signum());
}

#[test]
fn coulomb_friction_holds_the_shaft_still() {
    for seed in SEEDS {
        let (trial, columns) = recorded(seed, &[Effect::CoulombFriction]);
        for stair in STANDSTILL {
            let at = steady(&columns, stair);
            assert!(at.speed_rad_per_s.abs() < 1e-3 * rig_value(&trial, "voltage_V") / 0.012);
            let last = (stair + 1) * columns.counts.len() / STAIRS - 1;
            assert!((columns.counts[last] - columns.counts[last - 400]).abs() <= 1.0, "seed {seed} creeps");
        }
    }
}

/// A current that comes in pulses has its mean torque all the same: a shaft that it does not move is held by friction.
#[test]
fn coulomb_friction_holds_no_more_than_its_level_where_the_current_is_pulsed() {
    let effects = [Effect::CoulombFriction, Effect::VoltageDrop, Effect::CoastDecay];
    let mut rests = 0;
    for seed in 1..9 {
        let trial = draw(seed, &Recipe::of(&effects));
        let columns = columns(&trial);
        let level_nm = constant(&trial, Effect::CoulombFriction, "torque_Nm");
        for at in (0..columns.counts.len() - 60).step_by(20) {
            let stretch = at..at + 60;
            let still = columns.counts[stretch.clone()].iter().all(|count| *count == columns.counts[at]);
            let steady = columns.duty[stretch.clone()].iter().all(|duty| *duty == columns.duty[at]);
            if still && steady && columns.duty[at] != 0.0 {
                // From when the current has risen; a step of the sensor and its noise are averaged away.
                let held_nm =
                    trial.truth.motor.torque_constant_nm_per_a * mean(&columns.current_a[at + 30..at + 60]).abs();
                rests += 1;
                assert!(held_nm < 1.03 * level_nm, "seed {seed}, row {at}: {held_nm} held by {level_nm}");
            }
        }
    }
    assert!(rests > 100, "{rests}");
}

#[test]
fn stribeck_friction_is_gone_at_speed_and_listed_above_zero_in_either_order() {
    let (stribeck, coulomb) = (Effect::StribeckFriction, Effect::CoulombFriction);
    for effects in [[stribeck, coulomb], [coulomb, stribeck]] {
        assert_torque(&effects, |trial, at| {
            assert!(constant(trial, stribeck, "excess_torque_Nm") > 0.0);
            constant(trial, coulomb, "torque_Nm") * at.speed_rad_per_s.signum()
        });
    }
}

#[test]
fn friction_asymmetry_differs_between_the_directions() {
    let effect = Effect::FrictionAsymmetry;
    assert_torque(&[effect], |trial, at| {
        let half = 0.5 * constant(trial, effect, "difference_Nm");
        constant(trial, Effect::CoulombFriction, "torque_Nm") * at.speed_rad_per_s.signum() + half
    });
}

#[test]
fn quadratic_drag_grows_with_the_square() {
    let effect = Effect::QuadraticDrag;
    assert_torque(&[effect], |trial, at| {
        constant(trial, effect, "drag_Nm_s2") * at.speed_rad_per_s * at.speed_rad_per_s.abs()
    });
}

#[test]
fn load_torque_keeps_its_sign() {
    let effect = Effect::LoadTorque;
    assert_torque(&[effect], |trial, _| constant(trial, effect, "torque_Nm"));
}

#[test]
fn load_step_comes_at_its_time() {
    let effect = Effect::LoadStep;
    for seed in SEEDS {
        let (trial, columns) = recorded(seed, &[effect]);
        let since_s = constant(&trial, effect, "time_s");
        // Not where the step falls into the stair's end or has only just come.
        for at in moving_stairs(&columns).into_iter().filter(|at| (at.time_s - since_s).abs() > 1.0) {
            let expected = if at.time_s > since_s { constant(&trial, effect, "torque_Nm") } else { 0.0 };
            assert!((lost_nm(&trial, at) - expected).abs() < 0.005 * stall_nm(&trial), "seed {seed}, {at:?}");
        }
    }
}

#[test]
fn friction_warmup_leaves_the_listed_level_in_the_end() {
    let effect = Effect::FrictionWarmup;
    assert_torque(&[effect], |trial, at| {
        let excess =
            constant(trial, effect, "excess_share") * (-at.time_s / constant(trial, effect, "time_constant_s")).exp();
        let dry = constant(trial, Effect::CoulombFriction, "torque_Nm") * at.speed_rad_per_s.signum();
        dry * (1.0 + excess) + trial.truth.motor.viscous_friction_nm_s * at.speed_rad_per_s * excess
    });
}

#[test]
fn voltage_drop_works_against_the_current() {
    let effect = Effect::VoltageDrop;
    // Coulomb friction, so that the current is far enough from zero to have a sign.
    assert_voltage(SEEDS, &[effect, Effect::CoulombFriction], |trial, at| {
        constant(trial, effect, "drop_V") * at.current_a.signum()
    });
}

#[test]
fn supply_sag_sees_the_duty_twice_behind_a_capacitor_and_once_without() {
    let effect = Effect::SupplySag;
    let seen = Cell::new([false; 2]);
    assert_voltage(1..9, &[effect, Effect::CoulombFriction], |trial, at| {
        let within_pulses = constant(trial, effect, "within_pulses") > 0.0;
        let mut laws = seen.get();
        laws[usize::from(within_pulses)] = true;
        seen.set(laws);
        let times = if within_pulses { 1 } else { 2 };
        constant(trial, effect, "resistance_ohm") * at.duty.abs().powi(times) * at.current_a
    });
    assert_eq!(seen.get(), [true; 2], "both laws are drawn");
}

#[test]
fn winding_heating_never_lowers_the_resistance() {
    for seed in SEEDS {
        // A load makes the current that makes the heat.
        let (trial, columns) = recorded(seed, &[Effect::WindingHeating, Effect::LoadTorque]);
        let motor = trial.truth.motor;
        let shares: Vec<f64> = moving_stairs(&columns)
            .into_iter()
            .map(|at| lost_v(&trial, at) / (motor.resistance_ohm * at.current_a))
            .collect();
        assert!(shares.iter().all(|share| (-0.02..1.0).contains(share)), "seed {seed}: {shares:?}");
        assert!(shares.iter().any(|share| *share > 0.005), "seed {seed}: {shares:?}");
    }
}

#[test]
fn coasting_off_phase_runs_faster_at_low_duty_than_braking_one() {
    for seed in SEEDS {
        let (_, slow) = recorded(seed, &[Effect::CoulombFriction]);
        let (_, coast) = recorded(seed, &[Effect::CoulombFriction, Effect::CoastDecay]);
        let (slow, coast) = (steady(&slow, 0).speed_rad_per_s, steady(&coast, 0).speed_rad_per_s);
        assert!(slow > 0.0 && (coast / slow - 1.0).abs() > 0.02, "seed {seed}: {coast} for {slow}");
    }
}

/// Speed with the effect less speed of the same bench without, as a share of the latter, while it moves.
fn relative_speed_error(seed: u64, effect: Effect) -> (Columns, Vec<f64>) {
    let (_, clean) = recorded(seed, &[]);
    let (_, seen) = recorded(seed, &[effect]);
    let length = clean.time_s.len() / STAIRS;
    let top = steady(&clean, 2).speed_rad_per_s;
    let error = (0..STAIRS)
        .filter(|stair| !STANDSTILL.contains(stair))
        .flat_map(|stair| stair * length + length / 2..(stair + 1) * length)
        .filter(|index| clean.speed_rad_per_s[*index].abs() > 0.5 * top)
        .map(|index| seen.speed_rad_per_s[index] / clean.speed_rad_per_s[index] - 1.0)
        .collect();
    (seen, error)
}

#[test]
fn tacho_ripple_and_eccentricity_are_a_share_of_the_speed() {
    // Middling strength: 3.5 % of ripple; 1.8 degrees off centre.
    for (effect, amplitude) in [(Effect::TachoRipple, 0.035), (Effect::EncoderEccentricity, 1.8_f64.to_radians())] {
        for seed in SEEDS {
            let (_, error) = relative_speed_error(seed, effect);
            let share = rms(error.into_iter()) * 2.0_f64.sqrt();
            assert!((share / amplitude - 1.0).abs() < 0.35, "{} seed {seed}: {share} for {amplitude}", effect.id());
        }
    }
}

#[test]
fn missed_counts_are_missed_at_high_speed_or_while_the_counter_stands_and_counts_agree_with_the_speed() {
    let mut standing = 0;
    for seed in 1..12 {
        let (_, clean) = recorded(seed, &[]);
        let (trial, seen) = recorded(seed, &[Effect::MissedCounts]);
        let (_, constants) = &trial.truth.effects[0];
        match constants.first() {
            Some((_, stop_s)) => {
                standing += 1;
                counter_stands(seed, &seen, &clean, *stop_s);
            }
            None => missed_at_high_speed(seed, &seen, &clean),
        }
        let (from, to) = (seen.time_s.len() / STAIRS, seen.time_s.len() - 1);
        let counted_rad = (seen.counts[to] - seen.counts[from]) / rig_value(&trial, "counts_per_rev") * TAU;
        let of_speed_rad = mean(&seen.speed_rad_per_s[from..to]) * (seen.time_s[to] - seen.time_s[from]);
        let way_rad = rms(seen.speed_rad_per_s.iter().copied()) * (seen.time_s[to] - seen.time_s[from]);
        assert!((counted_rad - of_speed_rad).abs() < 0.01 * way_rad, "seed {seed}: {counted_rad} {of_speed_rad}");
    }
    assert!((1..11).contains(&standing), "both are drawn: {standing}");
}

fn missed_at_high_speed(seed: u64, seen: &Columns, clean: &Columns) {
    let (low, high) = (0, 2);
    let ratio = |stair| steady(seen, stair).speed_rad_per_s / steady(clean, stair).speed_rad_per_s;
    assert!((ratio(low) - 1.0).abs() < 0.01, "seed {seed}: {}", ratio(low));
    assert!(ratio(high) < 0.99, "seed {seed}: {}", ratio(high));
}

/// Once a second, at any speed; in between nothing is lost.
fn counter_stands(seed: u64, seen: &Columns, clean: &Columns, stop_s: f64) {
    let slow = 0.3 * rms(clean.speed_rad_per_s.iter().copied());
    let moving = |row: &usize| clean.speed_rad_per_s[*row].abs() > slow;
    let ratio = |row: usize| seen.speed_rad_per_s[row] / clean.speed_rad_per_s[row];
    let rows: Vec<usize> = (0..seen.time_s.len()).filter(moving).collect();
    let stands: Vec<usize> = rows.iter().copied().filter(|row| ratio(*row).abs() < 0.3).collect();
    let together = stands.windows(2).filter(|pair| pair[1] == pair[0] + 1);
    for pair in together {
        assert_eq!(seen.counts[pair[0]], seen.counts[pair[1]], "seed {seed}: counted in row {}", pair[1]);
    }
    let share = stands.len() as f64 / rows.len() as f64;
    assert!(share > 0.3 * stop_s && share < 1.5 * stop_s, "seed {seed}: {share} of a second, {stop_s}");
    let lost = rows.iter().filter(|row| (0.3..0.9).contains(&ratio(**row))).count();
    assert!((lost as f64) < 0.01 * rows.len() as f64, "seed {seed}: {lost} of {} in between", rows.len());
}

/// RMS by which the current of a trial leaves what is expected from that of the clean one, in amperes.
fn current_rms(seed: u64, effect: Effect, expected: impl Fn(&Trial, &[f64]) -> Vec<f64>) -> f64 {
    let (_, clean) = recorded(seed, &[]);
    let (trial, seen) = recorded(seed, &[effect]);
    let expected = expected(&trial, &clean.current_a);
    rms(seen.current_a.iter().zip(&expected).map(|(seen, expected)| seen - expected))
}

/// Two readings with noise differ by 0.25 % of the speed reached, in the worst of a thousand windows by 0.43 %.
const MOST_SPEED_NOISE: f64 = 0.005;
/// Noise of two readings of the current, and a little.
const TWO_NOISES_A: f64 = 0.030;

#[test]
fn current_offset_is_added() {
    let effect = Effect::CurrentOffset;
    for seed in SEEDS {
        let error = current_rms(seed, effect, |trial, clean| {
            clean.iter().map(|current| current + constant(trial, effect, "offset_A")).collect()
        });
        assert!(error < TWO_NOISES_A, "seed {seed}: {error} A");
    }
}

#[test]
fn current_lag_is_a_first_order_filter() {
    let effect = Effect::CurrentLag;
    for seed in SEEDS {
        let error = current_rms(seed, effect, |trial, clean| {
            let keep = (-1e-3 / constant(trial, effect, "time_constant_s")).exp();
            let filter = |state: &mut f64, current: &f64| {
                *state = keep * *state + (1.0 - keep) * current;
                Some(*state)
            };
            clean.iter().scan(0.0, filter).collect()
        });
        assert!(error < TWO_NOISES_A, "seed {seed}: {error} A");
    }
}

#[test]
fn actuation_delay_shifts_the_response() {
    let effect = Effect::ActuationDelay;
    for seed in SEEDS {
        let error = current_rms(seed, effect, |trial, clean| {
            // Between samples by interpolation.
            let late = constant(trial, effect, "delay_s") / 1e-3;
            let (whole, part) = (late.floor() as usize, late.fract());
            let at = |index: usize, back: usize| index.checked_sub(back).map_or(0.0, |index| clean[index]);
            (0..clean.len()).map(|index| (1.0 - part) * at(index, whole) + part * at(index, whole + 1)).collect()
        });
        assert!(error < TWO_NOISES_A, "seed {seed}: {error} A");
    }
}

/// One way the response comes later and later, the other way earlier and earlier.
#[test]
fn clock_drift_stretches_the_response() {
    let effect = Effect::ClockDrift;
    for seed in SEEDS {
        let error = current_rms(seed, effect, |trial, clean| {
            let growth = 1e-6 * constant(trial, effect, "drift_ppm");
            let at = |row: f64| {
                let (whole, part) = (row.max(0.0).floor() as usize, row.max(0.0).fract());
                let value = |index: usize| clean[index.min(clean.len() - 1)];
                (1.0 - part) * value(whole) + part * value(whole + 1)
            };
            (0..clean.len()).map(|row| at(row as f64 * (1.0 - growth))).collect()
        });
        assert!(error < TWO_NOISES_A, "seed {seed}: {error} A");
    }
}

#[test]
fn current_clipping_saturates_both_ways() {
    for seed in SEEDS {
        let (_, clean) = recorded(seed, &[]);
        let (_, seen) = recorded(seed, &[Effect::CurrentClipping]);
        let peak = |values: &[f64]| values.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        let share = peak(&seen.current_a) / peak(&clean.current_a);
        assert!((0.4..0.7).contains(&share), "seed {seed}: {share}");
    }
}

/// Greatest RMS, over a window of 20 ms, of the speed with the effect less that without, as a share of the top speed.
fn greatest_speed_difference(seed: u64, effect: Effect) -> f64 {
    let (_, clean) = recorded(seed, &[]);
    let (_, seen) = recorded(seed, &[effect]);
    let top = steady(&clean, 2).speed_rad_per_s;
    let difference: Vec<f64> = clean.speed_rad_per_s.iter().zip(&seen.speed_rad_per_s).map(|(a, b)| a - b).collect();
    difference.chunks(20).map(|window| rms(window.iter().copied()) / top).fold(0.0, f64::max)
}

fn assert_shows_in_the_speed(effects: &[Effect]) {
    for effect in effects {
        for seed in SEEDS {
            let difference = greatest_speed_difference(seed, *effect);
            assert!(difference > MOST_SPEED_NOISE, "{} seed {seed}: {difference}", effect.id());
        }
    }
}

#[test]
fn torques_of_the_angle_and_hidden_inertias_show_in_the_speed() {
    assert_shows_in_the_speed(&[Effect::Cogging, Effect::GravityUnbalance, Effect::Backlash, Effect::ShaftCompliance]);
}

#[test]
fn a_load_behind_a_spring_or_a_gap_leaves_the_steady_state_alone() {
    assert_torque(&[Effect::ShaftCompliance], |_, _| 0.0);
    assert_torque(&[Effect::Backlash], |_, _| 0.0);
}

/// Along a stair the shaft turns evenly. The EMF's ripple then drives a current through resistance and inductance.
#[test]
fn commutation_ripple_shows_in_the_current() {
    for seed in SEEDS {
        let (trial, columns) = recorded(seed, &[Effect::CommutationRipple]);
        let ripples = constant(&trial, Effect::CommutationRipple, "ripples_per_rev");
        let depth = constant(&trial, Effect::CommutationRipple, "amplitude_share");
        let motor = trial.truth.motor;
        let counts_per_rev = rig_value(&trial, "counts_per_rev");
        let length = columns.time_s.len() / STAIRS;
        let slowest =
            moving_stairs(&columns).into_iter().map(|at| at.speed_rad_per_s.abs()).fold(f64::INFINITY, f64::min);
        let stair = (0..STAIRS).find(|stair| steady(&columns, *stair).speed_rad_per_s.abs() == slowest).unwrap();
        let rows = stair * length + length / 2..(stair + 1) * length;
        let current_a = mean(&columns.current_a[rows.clone()]);
        let (mut cosine, mut sine) = (0.0, 0.0);
        for row in rows.clone() {
            let phase = ripples * TAU * (columns.counts[row] + 0.5) / counts_per_rev;
            cosine += 2.0 * phase.cos() * (columns.current_a[row] - current_a) / rows.len() as f64;
            sine += 2.0 * phase.sin() * (columns.current_a[row] - current_a) / rows.len() as f64;
        }
        let reactance_ohm = ripples * slowest * motor.inductance_h;
        let expected_a = depth * motor.torque_constant_nm_per_a * slowest / motor.resistance_ohm.hypot(reactance_ohm);
        let found_a = cosine.hypot(sine);
        assert!((found_a / expected_a - 1.0).abs() < 0.15, "seed {seed}: {found_a} for {expected_a}");
    }
}

#[test]
fn what_is_outside_the_catalogue_shows_in_the_speed() {
    assert_shows_in_the_speed(&Effect::OUTSIDE);
}

#[test]
fn the_speed_loop_reverses_stands_still_and_stays_within_its_duty() {
    for seed in SEEDS {
        let recipe = Recipe { excitation: Excitation::ClosedLoop, ..Recipe::of(&[]).on_real_rig() };
        let trial = draw(seed, &recipe);
        let columns = columns(&trial);
        let top = rig_value(&trial, "voltage_V") / trial.truth.motor.torque_constant_nm_per_a;
        let share = |holds: &dyn Fn(f64) -> bool| {
            let count = columns.speed_rad_per_s.iter().filter(|speed| holds(**speed / top)).count();
            count as f64 / columns.speed_rad_per_s.len() as f64
        };
        assert!(share(&|speed| speed > 0.1) > 0.1 && share(&|speed| speed < -0.1) > 0.1, "seed {seed}");
        assert!(share(&|speed| speed.abs() < 0.02) > 0.02, "seed {seed}");
        assert!(columns.duty.iter().all(|duty| duty.abs() <= 0.95), "seed {seed}");
    }
}
