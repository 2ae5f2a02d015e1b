//! Why the core refuses a set of settings, and the largest value that it would accept.

use motorbench_core::control_loop::LoopConfig;
use motorbench_core::settings::{BuildError, Param, Settings};
use motorbench_core::units::Rule;
use motorbench_data::names::setting_name;

/// Halvings that locate the limit of the core's formats, to more digits than a setting has.
const HALVINGS: u32 = 40;

/// The setting, its value, the fault, and a possible value.
pub fn refusal(settings: &Settings, error: BuildError) -> String {
    let (param, value) = (error.param, settings.get(error.param));
    let why = match error.rule {
        Rule::TooLarge | Rule::TooSmall | Rule::RoundsToZero => bound(settings, param).map_or_else(
            || "it goes with no value of it beside the other settings".into(),
            |(takes, limit)| format!("beside the other settings it takes {takes} {limit}"),
        ),
        Rule::NotPowerOfTwo => "it takes powers of two".into(),
        Rule::NotAllowed | Rule::NotFinite => "it does not take this value".into(),
    };
    format!("{} = {value}: the core's numbers cannot hold that; {why}", setting_name(param))
}

/// Between the default, if the core accepts that, and the refused value.
fn bound(settings: &Settings, param: Param) -> Option<(&'static str, String)> {
    let takes = |value: f64| {
        let mut tried = *settings;
        tried.set(param, value as f32).is_ok() && LoopConfig::build(&tried).is_ok()
    };
    let refused = f64::from(settings.get(param));
    let (mut good, mut bad) = (f64::from(Settings::defaults().get(param)), refused);
    if !takes(good) {
        return None;
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (good + bad);
        *if takes(middle) { &mut good } else { &mut bad } = middle;
    }
    let (word, rounded) = if good < refused { ("at most", inside(good)) } else { ("at least", -inside(-good)) };
    Some((word, rounded.to_string()))
}

/// The next lower number with four digits.
fn inside(value: f64) -> f64 {
    let unit = 10_f64.powi(value.abs().max(1e-9).log10().floor() as i32 - 3);
    // Of two equal ways to write it the shorter one.
    format!("{:.4e}", (value / unit).floor() * unit).parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bound_that_is_named_is_taken_and_a_little_more_is_not() {
        let mut settings = Settings::defaults();
        settings.set(Param::SpeedKp, 1000.0).unwrap();
        let error = LoopConfig::build(&settings).err().unwrap();
        let text = refusal(&settings, error);
        let most: f32 = text.rsplit(' ').next().unwrap().parse().unwrap();
        assert!(text.starts_with("speed_kp = 1000: ") && text.contains("at most"), "{text}");
        for (value, taken) in [(most, true), (1.01 * most, false)] {
            settings.set(Param::SpeedKp, value).unwrap();
            assert_eq!(LoopConfig::build(&settings).is_ok(), taken, "{value}");
        }
    }
}
