//! Fits a model together with numbers of the recording that the rig file leaves open, as where its PWM began. Found in turn,
//! such numbers and the constants that they resemble would come to their end in many small steps, or stop before it.

use super::sensitivities::Sensitivities;
use super::{Effort, Fit, Prior, dot, fit};
use crate::configuration::identify::recording_items::{DIFFERENCE, LEAST_GAIN, LONGEST, STEPS, TRIES};
use crate::dataset::Dataset;
use crate::parallel;
use motorbench_model::Model;
use nalgebra::{DMatrix, DVector};

/// A number of the recording: the data with it moved by so many of its units.
pub type Item = fn(&Dataset, f64) -> Dataset;

/// The data and a model with which its cost is least, from the present ones: Gauss and Newton's method with the damping of
/// Marquardt. `found` is a fit of these data.
pub fn fit_with_items(data: &Dataset, prior: &Prior, found: Fit, items: &[Item]) -> (Dataset, Fit) {
    let mut best = (data.clone(), found);
    for _ in 0..STEPS {
        let before = best.1.cost;
        let Some(better) = stepped(&best, prior, items) else { break };
        best = better;
        if before - best.1.cost < LEAST_GAIN * before {
            break;
        }
    }
    best
}

/// After one step; `None` if none is better.
fn stepped((data, found): &(Dataset, Fit), prior: &Prior, items: &[Item]) -> Option<(Dataset, Fit)> {
    let (normal, gradient) = normal_equations(data, prior, found, items);
    let mut damping = 0.0;
    for _ in 0..TRIES {
        let mut damped = normal.clone();
        (0..damped.nrows()).for_each(|index| damped[(index, index)] *= 1.0 + damping);
        damping = (damping * 10.0).max(1e-3);
        let Some(step) = damped.cholesky().map(|cholesky| cholesky.solve(&gradient)) else { continue };
        let there = moved(data, prior, found, items, &step);
        if there.1.cost < found.cost {
            return Some(there);
        }
    }
    None
}

/// The data and the model after a step in the unknowns of the model, and in the items behind them.
fn moved(data: &Dataset, prior: &Prior, found: &Fit, items: &[Item], step: &DVector<f64>) -> (Dataset, Fit) {
    let of_model = found.unknowns.len();
    let mut model: Model = found.model.clone();
    for (unknown, step) in found.unknowns.iter().zip(step.iter()) {
        unknown.set(&mut model, unknown.get(&found.model) - step.clamp(-1.0, 1.0));
    }
    let mut other = data.clone();
    for (item, step) in items.iter().zip(step.iter().skip(of_model)) {
        other = item(&other, -step.clamp(-LONGEST, LONGEST));
    }
    let found = fit(&model, &other, prior, Effort::NONE);
    (other, found)
}

/// Half the second derivatives of the cost, approximately, and half its gradient.
fn normal_equations(data: &Dataset, prior: &Prior, found: &Fit, items: &[Item]) -> (DMatrix<f64>, DVector<f64>) {
    let residual_at = |item: &Item, by: f64| fit(&found.model, &item(data, by), prior, Effort::NONE).residual;
    let of_item = |item: &Item| {
        let [mut there, back] = [DIFFERENCE, -DIFFERENCE].map(|by| residual_at(item, by));
        there.iter_mut().zip(&back).for_each(|(there, back)| *there = (*there - back) / (2.0 * DIFFERENCE));
        there
    };
    let columns: Vec<Vec<f64>> = parallel::map(items, of_item);
    let (sensitivities, _) = found.sensitivities(data);
    let Sensitivities { columns: of_model, normal } = sensitivities;
    let (known, size) = (of_model.len(), of_model.len() + columns.len());
    let column = |index: usize| if index < known { &of_model[index] } else { &columns[index - known] };
    let joint = DMatrix::from_fn(size, size, |row, other| match row.max(other) < known {
        true => normal[(row, other)],
        false => dot(column(row), column(other)),
    });
    let of_the_model = sensitivities.gradient(&found.model, &found.residual, &found.unknowns);
    let gradient = DVector::from_fn(size, |index, _| match index < known {
        true => of_the_model[index],
        false => dot(column(index), &found.residual),
    });
    (joint, gradient)
}
