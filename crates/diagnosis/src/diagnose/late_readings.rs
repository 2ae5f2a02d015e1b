//! Estimates how late the readings came, where that changes during a recording. A program that takes readings out of a
//! buffer more slowly than they come falls behind, and loses some when the buffer is full. Its rows then have wrong times.
//! A model that does not know it takes the lateness for a winding or a gap.

use super::bad_stretches::MOST_LEFT_OUT;
use super::channels::excluded;
use super::command_times::LEAST_GAIN;
use super::judge::{self, motion_above_floor};
use super::lateness::{self, JUMP_NATS, at_once, errors, late_s, with_time_constant, without_lag};
use super::pwm_frequency::usual_bridge;
use super::select::{SMALL_REST, usual_model};
use crate::configuration::diagnose::late_readings::{
    ANOTHER, BEGUN, CLOSER, DEAD_BANDS, FIRST_STEP_S, FOLLOWED, LAST_STEP_S, MOST_DEAD, NOT_LATENESS, ROUNDS,
    TIME_CONSTANTS_S,
};
use crate::dataset::{Dataset, LateCourse, greatest, median};
use crate::free_run::{Prediction, free_run};
use crate::identify::{Effort, Fit, Prior, fit};
use crate::parallel;
use motorbench_model::catalogue::effect;
use motorbench_model::linear::motor_model::TimeConstants;
use motorbench_model::{Direction, Model};

/// Identifier of the friction that holds a shaft at rest.
const FRICTION: &str = "coulomb_friction";

/// The data with each reading at its own time, if a lateness that changes explains most of the rest.
pub(super) fn settled(data: Dataset, prior: &Prior) -> Dataset {
    if !data.axis.drive.is_voltage() {
        return data;
    }
    let usual = usual_model(&data, prior, &excluded(&data));
    // Readings of the motion are late with those of the current.
    let is_small = |rest: &Fit| motion_above_floor(&data, rest) < SMALL_REST;
    // Many bridges coast in the off phase of the PWM, which nothing late explains.
    if is_small(&usual) || is_small(&usual_bridge(&data, prior)) {
        return data;
    }
    // What the usual model lacks is mostly the lateness. Later, as much is expected as the best model so far has lacked.
    let expected = expected_of_others(&data, &usual);
    let begun = beginnings(&data, &usual.model, &expected, prior);
    let begun = parallel::map(begun, |from| moved(&data, &from, &expected, prior));
    let mut begun: Vec<_> = begun.into_iter().flatten().collect();
    let cost = |(retimed, found): &(Dataset, Fit)| nats(retimed, found);
    begun.sort_by(|one, other| cost(one).total_cmp(&cost(other)));
    begun.truncate(FOLLOWED);
    let ways = parallel::map(begun, |way| followed(&data, way, &expected, prior));
    let best = ways.into_iter().flatten().min_by(|one, other| cost(one).total_cmp(&cost(other)));
    best.filter(|(retimed, found)| explains(retimed, found, &data, &usual)).map_or(data, |(retimed, _)| retimed)
}

/// The data with each reading at its own time beside a model that was found in other data, if that explains most of what it
/// lacks. `at_once`: its run without a delay, `usual`: with its own.
pub(super) fn beside(data: &Dataset, at_once: &Fit, usual: &Fit, prior: &Prior) -> Option<Dataset> {
    let (late_s, course) = found_late(data, &at_once.prediction, &expected_of_others(data, usual))?;
    let retimed = data.with_late_readings(&late_s, course);
    let found = fit(&at_once.model, &retimed, prior, Effort::NONE);
    explains(&retimed, &found, data, usual).then_some(retimed)
}

/// What is expected of anything but a lateness: a share of what a model lacks in each quantity.
fn expected_of_others(data: &Dataset, found: &Fit) -> Vec<f64> {
    errors(data, &found.prediction).iter().map(|error| NOT_LATENESS * error).collect()
}

/// Models to begin with: those beside which the readings cost least, however late they are. Beside too little friction the
/// lateness takes the time in which the shaft rests, and a fit beside that lateness finds no more friction.
fn beginnings(data: &Dataset, usual: &Model, expected: &[f64], prior: &Prior) -> Vec<Model> {
    let judged = |models: Vec<Model>| -> Vec<(f64, Model)> {
        let cost = |model: Model| (lateness::nats(data, &free_run(&model, data), expected), model);
        let mut judged = parallel::map(models, cost);
        judged.sort_by(|one, other| one.0.total_cmp(&other.0));
        judged
    };
    let as_quick = |model: &Model, time_constant_s| at_once(&with_time_constant(model, time_constant_s), prior);
    let mut all = judged(TIME_CONSTANTS_S.map(|time_constant_s| as_quick(usual, time_constant_s)).to_vec());
    let time_constant_s = TimeConstants::of(&all[0].1.motor).electromechanical_s;
    let bands = DEAD_BANDS.map(|share| as_quick(&with_friction_alone(usual, data, share, prior), time_constant_s));
    all.extend(judged(bands.to_vec()));
    all.sort_by(|one, other| one.0.total_cmp(&other.0));
    all.into_iter().take(BEGUN).map(|(_, model)| model).collect()
}

/// A model whose friction takes this share of the greatest command, with the speed of the usual one at that command.
fn with_friction_alone(usual: &Model, data: &Dataset, share: f64, prior: &Prior) -> Model {
    let most_v = greatest(&data.command);
    let of_usual_v = usual.dead_band_v(Direction::Forward, most_v).min(MOST_DEAD * most_v);
    let mut as_fast = Model::linear(usual.motor);
    as_fast.motor.torque_constant_nm_per_a *= (1.0 - share) * most_v / (most_v - of_usual_v);
    let Model { motor, .. } = at_once(&as_fast, prior);
    let friction_nm = share * most_v * motor.torque_constant_nm_per_a / motor.resistance_ohm;
    let linear = Model::linear(motor);
    effect(FRICTION).map_or_else(|| linear.clone(), |friction| linear.with(friction, vec![friction_nm]))
}

/// The lateness and the model in turn, while that brings them closer. `None` if nothing is late beside a better model.
fn followed(data: &Dataset, begun: (Dataset, Fit), expected: &[f64], prior: &Prior) -> Option<(Dataset, Fit)> {
    let mut expected = expected.to_vec();
    let mut best = begun;
    for _ in 1..ROUNDS {
        let (retimed, found) = &best;
        let lacked = errors(retimed, &found.prediction);
        expected.iter_mut().zip(lacked).for_each(|(expected, lacked)| *expected = expected.min(lacked));
        let again = moved(data, &without_lag(&found.model, prior), &expected, prior)?;
        if again.1.mean_square() >= CLOSER * found.mean_square() {
            break;
        }
        best = again;
    }
    Some(best)
}

/// Whether a lateness explains most of what is left without it, and is worth its jumps. With a jump every now and then the
/// readings come closer to any model, as to one without the torque that acts.
fn explains(retimed: &Dataset, found: &Fit, data: &Dataset, without: &Fit) -> bool {
    found.mean_square() < LEAST_GAIN * without.mean_square() && nats(retimed, found) < nats(data, without)
}

/// What readings cost beside a model, in natural units, and what the jumps cost that moved them.
fn nats(data: &Dataset, found: &Fit) -> f64 {
    let jumps = data.origin.late_readings.map_or(0, |late| late.jumps());
    let independent = data.len() as f64 * data.interval_s / judge::BLOCK_S;
    0.5 * independent * found.mean_square().ln() + JUMP_NATS * jumps as f64
}

/// The data with the lateness that brings them closest to a model, and the model fitted to them; `None` if it never jumps,
/// or in one place alone.
fn moved(data: &Dataset, model: &Model, errors: &[f64], prior: &Prior) -> Option<(Dataset, Fit)> {
    let (late_s, course) = found_late(data, &free_run(model, data), errors)?;
    Some(less_late(data, (&late_s, course), model, prior))
}

/// The lateness that brings the data closest to a prediction; `None` if it never jumps, or in one place alone.
fn found_late(data: &Dataset, prediction: &Prediction, errors: &[f64]) -> Option<(Vec<f64>, LateCourse)> {
    let (late_s, course) = late_s(data, prediction, errors);
    (course.jumps > 0 && is_throughout(&late_s)).then_some((late_s, course))
}

/// Whether more rows than those of an accident are late by another time than usual.
fn is_throughout(late_s: &[f64]) -> bool {
    let usual_s = median(late_s.iter().copied());
    let [least_s, most_s] = [f64::min, f64::max].map(|of| late_s.iter().copied().fold(usual_s, of));
    let others = late_s.iter().filter(|late_s| (*late_s - usual_s).abs() > ANOTHER * (most_s - least_s)).count();
    others as f64 > MOST_LEFT_OUT * late_s.len() as f64
}

/// The data with the lateness that was found, or with less of it everywhere, and the model fitted to them. A quick model
/// takes the motor's own slowness for a lateness, and a model with that lateness stays quick.
fn less_late(data: &Dataset, (late_s, course): (&[f64], LateCourse), model: &Model, prior: &Prior) -> (Dataset, Fit) {
    let by = |less_s: f64, model: &Model| {
        let less: Vec<f64> = late_s.iter().map(|late_s| (late_s - less_s).max(0.0)).collect();
        let retimed = data.with_late_readings(&less, course);
        let found = fit(model, &retimed, prior, Effort::AGAIN);
        (retimed, found)
    };
    let mut best = by(0.0, model);
    shortened(greatest(late_s), |less_s| {
        let other = by(less_s, &best.1.model);
        let is_better = other.1.mean_square() < best.1.mean_square();
        if is_better {
            best = other;
        }
        is_better
    });
    best
}

/// By how much a lateness of `most_s` is shortened: in steps while the next one is better, and then in smaller ones. With all
/// of it nothing is late, and another fit could only go on with the last one.
fn shortened(most_s: f64, mut is_better: impl FnMut(f64) -> bool) -> f64 {
    let (mut less_s, mut step_s) = (0.0, FIRST_STEP_S);
    while step_s > LAST_STEP_S {
        let next_s = less_s + step_s;
        if next_s < most_s && is_better(next_s) {
            less_s = next_s;
        } else {
            step_s /= 2.0;
        }
    }
    less_s
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lateness_is_shortened_by_no_more_than_all_of_it() {
        let up_to = |least_cost_s: f64| shortened(0.1, |less_s| less_s < least_cost_s);
        for least_cost_s in [0.0, 0.013, 0.07] {
            let less_s = up_to(least_cost_s);
            assert!(less_s <= least_cost_s && least_cost_s - less_s < 2.0 * LAST_STEP_S, "{least_cost_s}: {less_s}");
        }
        // Each fit goes on with the last one, and may be better whatever the lateness is.
        let less_s = up_to(f64::INFINITY);
        assert!((0.1 - 2.0 * LAST_STEP_S..0.1).contains(&less_s), "{less_s}");
    }
}
