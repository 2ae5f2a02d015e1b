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

/// What to check after a trip, with the settings that limit it.
pub fn trip_cause(trip: Trip) -> &'static str {
    match trip {
        Trip::None => "nothing is wrong",
        Trip::OverCurrentPeak => {
            "the current exceeded `trip_peak`: reduce the amplitude or `slew_limit`, or raise `trip_peak`; check that the shaft is free"
        }
        Trip::OverCurrentThermal => "check that the shaft is free; raise `trip_continuous` if the motor tolerates more",
        Trip::Stall => "check that the shaft is free and the load not too large; `trip_stall` 0 switches this trip off",
        Trip::EncoderSilent => {
            "the motor turns but the encoder shows no motion: check its cable, supply and coupling, then the current sensor; `trip_encoder` 0 switches this trip off"
        }
        Trip::Runaway => "the feedback has the wrong sign: swap the encoder's A and B",
        Trip::SensorRange => "a current is measured while the drive is off: check the current sensor and its wires",
        Trip::SupplyRange => "check the supply of the motor; its limits are `trip_supply_low` and `trip_supply_high`",
        Trip::EmergencyStop => "release the emergency stop",
        Trip::HostLost => "the program was silent for longer than `trip_host`",
        Trip::MainLoopHung | Trip::StackOverflow => "this is a fault of the firmware: please report it",
        Trip::EncoderTooFew => {
            "the encoder showed less speed than the voltage implies for longer than `trip_encoder`. Check that the coupling does not slip, and that `torque_constant`, `resistance` and `counts_per_rev` belong to this motor; set `torque_constant` 0 if it is not known"
        }
        Trip::EncoderLines => "a wire of the encoder is open, shorted or noisy: check its cable and plug",
        Trip::ConverterSilent => {
            "the chip's analogue inputs give no values: check AREF and A0 to A2, then replace the board"
        }
    }
}

/// The setting that limits a trip, if there is one.
pub fn trip_limit(trip: Trip) -> Option<&'static str> {
    trip_cause(trip).split('`').nth(1)
}
