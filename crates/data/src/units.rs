//! Units that files state, and what brings them to the unit of a channel.

use crate::recording::Channel;
use std::f64::consts::{PI, TAU};

/// Names of units as programs and instruments write them, with one name for each.
const NAMES: [(&str, &[&str]); 26] = [
    ("s", &["s", "sec", "secs", "second", "seconds", "sek"]),
    ("ms", &["ms", "msec", "millisecond", "milliseconds", "millis"]),
    ("us", &["us", "\u{b5}s", "\u{3bc}s", "usec", "microsecond", "microseconds", "micros"]),
    ("ns", &["ns", "nanosecond", "nanoseconds"]),
    ("min", &["min", "minute", "minutes"]),
    ("V", &["v", "volt", "volts"]),
    ("mV", &["mv", "millivolt", "millivolts"]),
    ("A", &["a", "amp", "amps", "ampere", "amperes"]),
    ("mA", &["ma", "milliamp", "milliamps", "milliampere"]),
    ("rpm", &["rpm", "u/min", "1/min", "rev/min", "r/min", "min-1"]),
    ("rad/s", &["rad/s", "rad/sec", "rads", "rad s-1", "radians/s"]),
    ("deg/s", &["deg/s", "\u{b0}/s", "degrees/s", "dps"]),
    ("rev/s", &["rev/s", "rps", "r/s", "rotations/s", "turns/s"]),
    ("rad", &["rad", "radian", "radians"]),
    ("deg", &["deg", "\u{b0}", "degree", "degrees"]),
    ("rev", &["rev", "revs", "rotation", "rotations", "turn", "turns"]),
    ("Nm", &["nm", "n m", "n\u{b7}m", "n*m"]),
    ("mNm", &["mnm", "mn m", "mn\u{b7}m"]),
    ("m/s", &["m/s", "m s-1"]),
    ("mm/s", &["mm/s"]),
    ("mm", &["mm", "millimetre", "millimeter"]),
    ("N", &["n", "newton", "newtons"]),
    ("%", &["%", "percent", "pct"]),
    ("counts", &["counts", "count", "ticks", "cnt"]),
    ("counts/s", &["counts/s", "cps", "ticks/s"]),
    ("", &["-", "1", "sequence", "none", "n/a", "bool", "boolean", "date", "clock"]),
];

/// The unit that a text names, possibly in brackets. An empty one is a known name of no unit.
pub fn named(text: &str) -> Option<&'static str> {
    let text = text.trim().trim_matches(['(', ')', '[', ']']).trim();
    let lower = text.to_lowercase();
    NAMES.into_iter().find(|(_, names)| names.contains(&lower.as_str())).map(|(unit, _)| unit)
}

/// The unit at the end of a name, and the name without it: `speed [rpm]`, `Time (ms)`, `CH1 in V`.
pub fn in_name(name: &str) -> Option<(&str, &'static str)> {
    if let Some((before, unit)) = name.rsplit_once(" in ").or_else(|| Some(("", name.strip_prefix("in ")?)))
        && let Some(unit) = named(unit).filter(|unit| !unit.is_empty())
    {
        return Some((before.trim(), unit));
    }
    let inside = name.strip_suffix([')', ']'])?;
    let (before, unit) = inside.rsplit_once(['(', '['])?;
    let unit = named(unit).filter(|unit| !unit.is_empty())?;
    Some((before.trim(), unit))
}

/// The unit of time that a name ends with or consists of: `time_ms`, `millis`, `t_us`.
pub fn of_time_in_name(name: &str) -> Option<&'static str> {
    let lower = name.to_lowercase();
    let is_time = |unit: &&str| matches!(*unit, "s" | "ms" | "us" | "ns");
    if let Some(unit) = named(&lower).filter(is_time).filter(|_| lower != "s") {
        return Some(unit);
    }
    let (before, last) = lower.rsplit_once(['_', ' ', '.', '-'])?;
    let first_word = before.split(['_', ' ', '.', '-']).next().unwrap_or_default();
    let says_time = ["t", "time", "timestamp", "stamp", "zeit", "elapsed", "tempo", "temps"].contains(&first_word);
    named(last).filter(is_time).filter(|_| says_time)
}

/// What a value in this unit is multiplied by for a channel; `None` if it cannot be one.
pub fn factor(channel: Channel, unit: &str) -> Option<f64> {
    let rpm = TAU / 60.0;
    match (channel, unit) {
        (_, "") => Some(1.0),
        (Channel::Time, "s") => Some(1.0),
        (Channel::Time, "ms") => Some(1e-3),
        (Channel::Time, "us") => Some(1e-6),
        (Channel::Time, "ns") => Some(1e-9),
        (Channel::Time, "min") => Some(60.0),
        (Channel::Voltage | Channel::Supply, "V") | (Channel::Current, "A") => Some(1.0),
        (Channel::Voltage | Channel::Supply, "mV") | (Channel::Current, "mA") => Some(1e-3),
        (Channel::Speed | Channel::SpeedReference, "rad/s") | (Channel::Rpm, "rpm") => Some(1.0),
        (Channel::Speed | Channel::SpeedReference, "rpm") => Some(rpm),
        (Channel::Speed | Channel::SpeedReference, "deg/s") => Some(PI / 180.0),
        (Channel::Speed | Channel::SpeedReference, "rev/s") => Some(TAU),
        (Channel::Rpm, "rad/s") => Some(1.0 / rpm),
        (Channel::Rpm, "deg/s") => Some(1.0 / 6.0),
        (Channel::Rpm, "rev/s") => Some(60.0),
        (Channel::Angle | Channel::AngleReference, "rad") | (Channel::Counts, "counts") => Some(1.0),
        (Channel::Angle | Channel::AngleReference, "deg") => Some(PI / 180.0),
        (Channel::Angle | Channel::AngleReference, "rev") => Some(TAU),
        (Channel::LoadTorque | Channel::Torque, "Nm") | (Channel::LoadForce | Channel::Force, "N") => Some(1.0),
        (Channel::LoadTorque | Channel::Torque, "mNm") => Some(1e-3),
        (Channel::Velocity, "m/s") => Some(1.0),
        (Channel::Velocity, "mm/s") | (Channel::Position, "mm") => Some(1e-3),
        (Channel::Duty, "%") => Some(0.01),
        _ => None,
    }
}

/// Whether it measures time.
pub fn is_of_time(unit: &str) -> bool {
    !unit.is_empty() && factor(Channel::Time, unit).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_known_by_many_names() {
        assert_eq!(
            ["(ms)", "Second", "[V]", "Volt", "U/min", "-"].map(named),
            [Some("ms"), Some("s"), Some("V"), Some("V"), Some("rpm"), Some("")]
        );
        assert_eq!(in_name("/motor/speed[rad/s]"), Some(("/motor/speed", "rad/s")));
        assert_eq!((in_name("Time (ms)"), in_name("f(x)")), (Some(("Time", "ms")), None));
        assert_eq!(
            (in_name("CH1 in V"), in_name("in s"), in_name("step in x")),
            (Some(("CH1", "V")), Some(("", "s")), None)
        );
        for (name, unit) in [
            ("time_ms", Some("ms")),
            ("micros", Some("us")),
            ("Time s", Some("s")),
            ("current_s", None),
            ("s", None),
            ("rpm", None),
        ] {
            assert_eq!(of_time_in_name(name), unit, "{name}");
        }
        assert_eq!(factor(Channel::Current, "mA"), Some(1e-3));
        assert_eq!(factor(Channel::Current, "V"), None);
    }
}
