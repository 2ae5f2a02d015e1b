//! Where in its window a mean speed stands: at the end, or in the middle.

use super::{Effort, Prior, fit, scales};
use crate::configuration::identify::speed_window::LEAST_SHARE;
use crate::dataset::Dataset;
use crate::parallel;
use motorbench_data::rig::NominalMotor;
use motorbench_model::Model;
use motorbench_model::catalogue::{USUAL, effect};

/// The data with that settled by the better fit, where neither the columns nor the rig file say it.
pub fn with_window_settled(data: Dataset, nominal: &NominalMotor) -> Dataset {
    let Some(centred) = data.with_window_centred() else { return data };
    let costs = parallel::map([&data, &centred], |data| cost(data, nominal));
    if costs[1] < LEAST_SHARE * costs[0] { centred } else { data }
}

/// Of a motor with what hardly any bench is without, and not with what comes late as well: a diagnosis that may name that
/// compares whole explanations.
fn cost(data: &Dataset, nominal: &NominalMotor) -> f64 {
    let prior = Prior::new(nominal, data);
    let scales = scales(&prior.motor, data);
    let usual = USUAL.iter().filter_map(|id| effect(id)).filter(|effect| data.axis.allows(effect.about()));
    let model = usual.fold(Model::linear(prior.motor), |model, effect| model.with_start(effect, &scales));
    fit(&model, data, &prior, Effort::TRIAL).cost
}
