//! Which channel a column of another name likely is. It is a proposal for a command line, never taken unasked.

use crate::content::Column;
use crate::recording::Channel;
use crate::statistics::{greatest, median};
use crate::units;
use std::fmt::Write as _;

/// Words in names, and the channels that they likely mean.
const WORDS: [(Channel, &[&str]); 11] = [
    (Channel::Time, &["time", "t", "millis", "micros", "ms", "us", "zeit", "timestamp", "stamp", "tiempo"]),
    (Channel::SpeedReference, &["setpoint", "target", "reference", "ref", "sp", "soll"]),
    (Channel::Supply, &["supply", "vbat", "battery", "vbus", "vcc", "vin"]),
    (Channel::Rpm, &["rpm", "drehzahl"]),
    (Channel::Duty, &["pwm", "duty", "dutycycle", "throttle"]),
    (Channel::Current, &["current", "amps", "amp", "ma", "i", "ia", "strom", "curr", "ampere", "adc", "acs"]),
    (Channel::LoadTorque, &["torque", "load"]),
    (Channel::Speed, &["speed", "velocity", "vel", "omega", "w", "rps", "cps", "gyro"]),
    (Channel::Counts, &["counts", "count", "encoder", "enc", "ticks", "pulses"]),
    (Channel::Angle, &["angle", "theta", "position", "pos", "deg", "rotation"]),
    (Channel::Voltage, &["voltage", "volts", "volt", "u", "v", "spannung", "applied"]),
];

/// What brings the raw reading of a converter to amperes; its offset gives it a sign.
const OF_CONVERTER: &str = "*AMPERES_PER_STEP-AMPERES_AT_0";
/// Steps of PWM that programs use.
const FULL_SCALES: [f64; 5] = [1.0, 100.0, 255.0, 1023.0, 65_535.0];

/// Words of a name, in small letters: `motorSpeed_rpm` has motor, speed, rpm.
fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut before = ' ';
    let mut signs = name.chars().peekable();
    while let Some(sign) = signs.next() {
        let begins =
            sign.is_uppercase() && before.is_lowercase() && signs.peek().is_some_and(|next| next.is_lowercase());
        if !sign.is_alphanumeric() || begins {
            words.push(String::new());
        }
        if sign.is_alphanumeric() {
            words.last_mut().expect("there is one").extend(sign.to_lowercase());
        }
        before = sign;
    }
    words.retain(|word| !word.is_empty());
    words
}

/// The right side of a mapping for a column: `i_A/1000`.
fn likely(column: &Column) -> Option<(Channel, String)> {
    let bare = units::in_name(&column.name).map_or(&*column.name, |(bare, _)| bare);
    let words = words(crate::mapping::last_part(bare));
    let has = |known: &[&str]| words.iter().any(|word| known.contains(&word.as_str()));
    let channel = WORDS.into_iter().find(|(_, known)| has(known)).map(|(channel, _)| channel)?;
    let stated = (!column.unit.is_empty()).then_some(&*column.unit);
    if stated.is_some_and(|unit| units::factor(channel, unit).is_some()) {
        return Some((channel, channel.column().into()));
    }
    let factor = match channel {
        Channel::Time if has(&["millis", "ms"]) => "/1000".to_owned(),
        Channel::Time if has(&["micros", "us"]) => "/1000000".to_owned(),
        Channel::Time => seconds(column).to_owned(),
        Channel::Current if has(&["ma"]) => "/1000".to_owned(),
        // The raw reading of a converter.
        Channel::Current if has(&["adc", "acs"]) => OF_CONVERTER.to_owned(),
        Channel::Duty => share(column),
        Channel::Speed if has(&["rps"]) => "*6.283185".to_owned(),
        Channel::Speed if has(&["deg"]) => "*0.01745329".to_owned(),
        Channel::Speed if has(&["cps"]) => "*6.283185/COUNTS_PER_REV".to_owned(),
        Channel::Angle if has(&["deg"]) => "*0.01745329".to_owned(),
        _ => String::new(),
    };
    Some((channel, channel.column().to_owned() + &factor))
}

/// What brings times to seconds, by the usual step: rows are hardly a second apart.
fn seconds(column: &Column) -> &'static str {
    match median(column.values.windows(2).map(|pair| pair[1] - pair[0])) {
        step if step >= 1e6 => "/1000000000",
        step if step >= 1000.0 => "/1000000",
        step if step >= 0.5 => "/1000",
        _ => "",
    }
}

fn share(column: &Column) -> String {
    let most = greatest(&column.values);
    let full = FULL_SCALES.into_iter().find(|full| most <= *full).unwrap_or(most);
    if full == 1.0 { String::new() } else { format!("/{full}") }
}

/// Options for the columns that are likely channels which the recording has not yet.
pub fn options<'a>(columns: impl Iterator<Item = &'a Column>, has: &[Channel]) -> String {
    let columns: Vec<&Column> = columns.collect();
    let mut taken: Vec<Channel> = has.to_vec();
    let mut options = String::new();
    for column in &columns {
        let Some((channel, right)) = likely(column) else { continue };
        if taken.iter().any(|other| is_same_quantity(*other, channel)) {
            continue;
        }
        taken.push(channel);
        let sign = columns
            .iter()
            .find(|other| is_direction(other))
            .filter(|_| is_two_way(channel) && has_no_sign(column) && !right.ends_with(OF_CONVERTER));
        let sign = sign.map_or_else(String::new, |sign| format!("*sign({})", sign.name));
        let _ = write!(options, " --column {}", quoted(&format!("{}{sign}={right}", column.name)));
    }
    options.trim_start().to_owned()
}

/// Whether a quantity has a sign on a bridge that drives both ways.
fn is_two_way(channel: Channel) -> bool {
    matches!(channel, Channel::Duty | Channel::Voltage | Channel::Current | Channel::Speed | Channel::Rpm)
}

/// What each column likely is, the right side of a mapping; empty where nothing speaks for a channel, or another column
/// has it already.
pub fn likely_channels(columns: &[Column]) -> Vec<String> {
    let own = |column: &Column| Channel::of_column(crate::mapping::last_part(&column.name));
    let mut taken: Vec<Channel> = columns.iter().filter_map(own).collect();
    let mut of = |column: &Column| {
        if let Some(channel) = own(column) {
            return channel.column().to_owned();
        }
        let free = |(channel, _): &(Channel, String)| !taken.iter().any(|other| is_same_quantity(*other, *channel));
        let Some((channel, right)) = likely(column).filter(free) else { return String::new() };
        taken.push(channel);
        right
    };
    columns.iter().map(&mut of).collect()
}

/// Whether a column says which way the motor is driven.
fn is_direction(column: &Column) -> bool {
    words(&column.name).iter().any(|word| ["dir", "direction", "sign", "richtung", "reverse"].contains(&word.as_str()))
}

fn has_no_sign(column: &Column) -> bool {
    !column.values.iter().any(|value| *value < 0.0)
}

/// A word for a command line, in quotes if a shell would read it otherwise.
fn quoted(word: &str) -> String {
    let is_plain = |sign: char| sign.is_alphanumeric() || "_=/.,:+-*#@%".contains(sign);
    if word.chars().all(is_plain) { word.to_owned() } else { format!("'{}'", word.replace('\'', "'\\''")) }
}

/// Two ways to say one quantity, of which a recording needs one.
fn is_same_quantity(a: Channel, b: Channel) -> bool {
    let of = |channel: Channel| match channel {
        Channel::Duty => Channel::Voltage,
        Channel::Rpm => Channel::Speed,
        other => other,
    };
    of(a) == of(b)
}

/// Options for a table without names: the first column that only grows is likely the time.
pub fn by_number(columns: &[Column]) -> String {
    let grows = |column: &&Column| column.values.len() > 1 && column.values.windows(2).all(|pair| pair[1] > pair[0]);
    let time = columns.iter().find(grows);
    let mut others = [Channel::Voltage, Channel::Rpm, Channel::Current].into_iter();
    let option = |column: &Column| match time {
        Some(time) if time.name == column.name => Some(format!("--column {}=t_s{}", column.name, seconds(column))),
        _ => others.next().map(|channel| format!("--column {}={}", column.name, channel.column())),
    };
    columns.iter().filter_map(option).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn proposals_make_sense() {
        let column = |name: &str, values: &[f64]| Column::new(name, values.to_vec());
        let table = [
            column("millis", &[412.0, 422.0]),
            column("pwm", &[0.0, 200.0]),
            column("rpm", &[0.0, 90.0]),
            column("current_mA", &[0.0, 300.0]),
            column("mode", &[1.0, 2.0]),
        ];
        assert_eq!(
            options(table.iter(), &[Channel::Rpm]),
            "--column millis=t_s/1000 --column pwm=duty/255 --column current_mA=i_A/1000"
        );
        let with_direction = [column("pwm", &[0.0, 99.0]), column("dir", &[0.0, 1.0]), column("adc", &[512.0])];
        assert_eq!(
            options(with_direction.iter(), &[Channel::Time]),
            "--column 'pwm*sign(dir)=duty/100' --column adc=i_A*AMPERES_PER_STEP-AMPERES_AT_0"
        );
        let robot = [column("/Drive/LeftAppliedVolts", &[1.0]), column("/Drive/LeftVelocityRadPerSec", &[1.0])];
        assert_eq!(
            options(robot.iter(), &[Channel::Time]),
            "--column /Drive/LeftAppliedVolts=u_V --column /Drive/LeftVelocityRadPerSec=omega_rad_per_s"
        );
        let other = [
            column("t", &[0.0, 0.01]),
            column("/motor/Voltage, commanded", &[0.0, 9.0]),
            column("motorSpeed", &[0.0, 9.0]),
        ];
        assert_eq!(
            options(other.iter(), &[]),
            "--column t=t_s --column '/motor/Voltage, commanded=u_V' --column motorSpeed=omega_rad_per_s"
        );
        assert_eq!(options([column("foo", &[1.0])].iter(), &[]), "");
        let nameless = [column("1", &[412.0, 422.0]), column("2", &[0.0, 0.0]), column("3", &[0.0, 0.0])];
        assert_eq!(by_number(&nameless), "--column 1=t_s/1000 --column 2=u_V --column 3=rpm");
    }
}
