//! Whether a recording could have shown friction and drop. Only then does a linear motor that fits say that there is
//! none.

use crate::dataset::Dataset;
use crate::identify::{Fit, LEAST_PROMISE, scales};
use motorbench_model::catalogue::{Effect, USUAL, effect};

/// The usual effects that the search would not have tried in this recording, had they been there at a strength that
/// matters: 3 % of the stall torque, 5 % of the voltage. `found`: fitted to the data.
pub(super) fn not_shown(data: &Dataset, found: &Fit) -> Vec<&'static dyn Effect> {
    let scales = scales(&found.model.motor, data);
    let usual = USUAL.into_iter().filter_map(effect).filter(|effect| data.axis.allows(effect.about()));
    usual
        .filter(|effect| found.would_gain(data, *effect, effect.starts(&scales).swap_remove(0)) < LEAST_PROMISE)
        .collect()
}

/// What to record instead.
pub(super) fn advice(not_shown: &dyn Effect) -> String {
    let about = not_shown.about();
    format!(
        "This recording would not show {} ({}) of a usual strength. Record the sequence `identify`, or: {}.",
        about.title, about.id, about.experiment
    )
}
