//! Where in its window a mean speed stands: at the end, or in the middle.

use super::{Effort, Prior, fit, scales};
use crate::configuration::identify::speed_window::LEAST_SHARE;
use crate::dataset::Dataset;
use motorbench_data::rig::NominalMotor;
use motorbench_model::Model;
use motorbench_model::catalogue::{USUAL, effect};

/// The data with that settled by the better fit, where neither the columns nor the rig file say it.
pub fn with_window_settled(data: Dataset, nominal: &NominalMotor) -> Dataset {
    let Some(centred) = data.with_window_centred() else { return data };
    let (ended, middle) = maybe_rayon::join(|| cost(&data, nominal), || cost(&centred, nominal));
    if middle < LEAST_SHARE * ended { centred } else { data }
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
