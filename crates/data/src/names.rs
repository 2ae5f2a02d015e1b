//! Names of the core's settings and trips, as text on the host.

use motorbench_core::console::trip_text;
use motorbench_core::message::Trip;
use motorbench_core::settings::{Param, Text, text};

/// The name of a setting on the console.
pub fn setting_name(param: Param) -> String {
    text(param, Text::Name).map(char::from).collect()
}

/// The name of a trip in the board's `status`.
pub fn trip_words(trip: Trip) -> String {
    trip_text(trip).map(char::from).collect()
}
