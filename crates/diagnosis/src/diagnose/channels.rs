//! Which effects the channels of a recording can show.

use crate::dataset::{Dataset, Output};
use motorbench_model::catalogue::{CATALOGUE, Channels};

/// Effects that do not show in these channels.
pub(super) fn excluded(data: &Dataset) -> Vec<&'static str> {
    let channels = Channels {
        axis: data.axis,
        current: data.current().is_some(),
        speed: data.motion().output == Output::Speed,
        counts: data.origin.is_counted,
        // Smooth commands that all act earlier than their rows by one share have no moments of their own.
        moments: data.has_moments() && data.origin.smooth_earlier.is_none(),
        lateness: data.origin.late_readings.is_some(),
        one_magnitude: data.has_one_magnitude(),
    };
    CATALOGUE.iter().filter(|effect| !effect.shows_in(&channels)).map(|effect| effect.about().id).collect()
}
