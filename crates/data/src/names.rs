//! Names of the core's settings and trips, as texts on the host.

use motorbench_core::console::trip_text;
use motorbench_core::message::Trip;
use motorbench_core::settings::{Param, Text, text};

/// The name of a setting, as the console has it.
pub fn setting_name(param: Param) -> String {
    text(param, Text::Name).map(char::from).collect()
}

/// A trip in the words of the board's own `status`.
pub fn trip_words(trip: Trip) -> String {
    trip_text(trip).map(char::from).collect()
}
