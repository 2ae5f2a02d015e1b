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
    (Channel::Speed, &["speed", "velocity", "velo", "vel", "velocidad", "vitesse", "omega", "w", "rps", "cps", "gyro"]),
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
    // What a generator gives beyond the last one is cut off by the board.
    let full = FULL_SCALES.into_iter().find(|full| most <= *full).unwrap_or(FULL_SCALES[FULL_SCALES.len() - 1]);
    if full == 1.0 { String::new() } else { format!("/{full}") }
}

/// Options for the columns that are likely channels which the recording has not yet. `taken` are the columns that are
/// channels by their names: one without a sign gets it from a column with the direction. A current does not: while the
/// motor brakes, it is against the direction. It is compared as a magnitude.
pub fn options<'a>(
    columns: impl Iterator<Item = &'a Column>,
    has: &[Channel],
    taken: impl Iterator<Item = (Channel, &'a Column)>,
) -> String {
    let columns: Vec<&Column> = columns.collect();
    let direction = columns.iter().find(|column| is_direction(column));
    let sign_of = |column: &Column, channel: Channel| {
        let direction = direction.filter(|_| is_two_way(channel) && has_no_sign(column));
        direction.map_or_else(String::new, |direction| format!("*sign({})", direction.name))
    };
    let mut options = String::new();
    let mut add = |left: String, right: &str| {
        let _ = write!(options, " --column {}", quoted(&format!("{left}={right}")));
    };
    for (channel, column) in taken {
        let sign = sign_of(column, channel);
        if !sign.is_empty() && direction.is_some_and(|direction| changes(direction)) {
            add(format!("{}{sign}", column.name), channel.column());
        }
    }
    let mut known: Vec<Channel> = has.to_vec();
    let mut likely_ones: Vec<(&Column, Channel, String)> = Vec::new();
    for column in &columns {
        let Some((channel, right)) = likely(column) else { continue };
        if !known.iter().any(|other| is_same_quantity(*other, channel)) {
            known.push(channel);
            likely_ones.push((column, channel, right));
        }
    }
    // What a program sends to the motor has many names. Beside a speed, a signal is likely this.
    let lacks = |channel: Channel| !known.iter().any(|other| is_same_quantity(*other, channel));
    if lacks(Channel::Voltage) && !lacks(Channel::Speed) {
        let signal = columns.iter().find(|column| is_signal(column));
        likely_ones.extend(signal.map(|column| (*column, Channel::Voltage, command_by_values(column))));
    }
    for (column, channel, right) in likely_ones {
        let sign = if right.ends_with(OF_CONVERTER) { String::new() } else { sign_of(column, channel) };
        add(format!("{}{sign}", column.name), &right);
    }
    options.trim_start().to_owned()
}

/// Whether a column has more than one value.
fn changes(column: &Column) -> bool {
    column.values.windows(2).any(|pair| pair[0] != pair[1])
}

/// Words in the names of what excites a motor.
const SIGNALS: [&str; 12] =
    ["input", "command", "cmd", "signal", "step", "stair", "ramp", "chirp", "sine", "wave", "pulse", "control"];

fn is_signal(column: &Column) -> bool {
    // Generators are numbered: `Step1`.
    let letters = |word: &String| word.trim_end_matches(|sign: char| sign.is_ascii_digit()).to_owned();
    words(crate::mapping::last_part(&column.name)).iter().map(letters).any(|word| SIGNALS.contains(&&*word))
}

/// Whether a quantity has the sign of the direction on a bridge that drives both ways.
fn is_two_way(channel: Channel) -> bool {
    matches!(channel, Channel::Duty | Channel::Voltage | Channel::Speed | Channel::Rpm)
}

/// What each column likely is, the right side of a mapping; empty where nothing speaks for a channel, or another column
/// has it already.
pub fn likely_channels<'a>(columns: impl Iterator<Item = &'a Column> + Clone) -> Vec<String> {
    let own = |column: &Column| Channel::of_column(crate::mapping::last_part(&column.name));
    let mut taken: Vec<Channel> = columns.clone().filter_map(own).collect();
    let mut of = |column: &Column| {
        if let Some(channel) = own(column) {
            return channel.column().to_owned();
        }
        let free = |(channel, _): &(Channel, String)| !taken.iter().any(|other| is_same_quantity(*other, *channel));
        let Some((channel, right)) = likely(column).filter(free) else { return String::new() };
        taken.push(channel);
        right
    };
    columns.map(&mut of).collect()
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

/// Options for a table without names. The first column that only grows is likely the time; then a program prints what it
/// commands, what the motor does, and the current.
pub fn by_number(columns: &[Column]) -> String {
    let grows = |column: &&Column| column.values.len() > 1 && column.values.windows(2).all(|pair| pair[1] > pair[0]);
    let time = columns.iter().find(grows);
    let mut others = [command_by_values, |_: &Column| Channel::Rpm.column().to_owned(), current_by_values].into_iter();
    let option = |column: &Column| match time {
        Some(time) if time.name == column.name => Some(format!("--column {}=t_s{}", column.name, seconds(column))),
        _ => others.next().map(|channel| format!("--column {}={}", column.name, channel(column))),
    };
    columns.iter().filter_map(option).collect::<Vec<_>>().join(" ")
}

/// More volts than a small motor gets.
const MOST_VOLTS: f64 = 60.0;
/// More amperes than a small motor takes.
const MOST_AMPERES: f64 = 50.0;

/// Steps of PWM are more than a voltage; a share is at most 1.
fn command_by_values(column: &Column) -> String {
    let most = greatest(&column.values);
    if most > MOST_VOLTS || most <= 1.0 && most > 0.0 {
        Channel::Duty.column().to_owned() + &share(column)
    } else {
        Channel::Voltage.column().to_owned()
    }
}

fn current_by_values(column: &Column) -> String {
    let milliamperes = greatest(&column.values) > MOST_AMPERES;
    Channel::Current.column().to_owned() + if milliamperes { "/1000" } else { "" }
}

/// What the output of a current sensor without a current may be: half of a supply of 5 V or of 3.3 V.
const SENSOR_MIDDLES_V: [f64; 2] = [2.5, 1.65];
/// A sensor's middle is so far off at most.
const MIDDLE_TOLERANCE_V: f64 = 0.1;
/// Scale of a common Hall sensor for 5 A.
const SENSOR_V_PER_A: f64 = 0.185;

/// Options for the probes of an oscilloscope, and what of them a person has to put in.
pub fn of_probes<'a>(probes: impl Iterator<Item = &'a Column>) -> String {
    let probes: Vec<&Column> = probes.collect();
    let middle = |probe: &&Column| {
        let first = probe.values.iter().copied().find(|value| value.is_finite())?;
        SENSOR_MIDDLES_V.into_iter().find(|volts| (first - volts).abs() < MIDDLE_TOLERANCE_V)
    };
    let (mut options, mut sensor_middle, mut has_command, mut has_speed) = (Vec::new(), None, false, false);
    for probe in probes {
        let right = match middle(&probe) {
            Some(volts) if sensor_middle.is_none() => {
                sensor_middle = Some(volts);
                format!("i_A/{SENSOR_V_PER_A}-{:.2}", volts / SENSOR_V_PER_A)
            }
            _ if !has_command => {
                has_command = true;
                "u_V".into()
            }
            _ if !has_speed => {
                has_speed = true;
                "rpm*RPM_PER_VOLT".into()
            }
            _ => continue,
        };
        options.push(format!("--column {}", quoted(&format!("{}={right}", probe.name))));
    }
    let scale = sensor_middle.map_or_else(
        || "; the voltage of a current sensor of 0.185 V/A around 2.5 V is i_A/0.185-13.51".to_owned(),
        |volts| format!(", where {SENSOR_V_PER_A} V/A around {volts} V is the current sensor's scale: put in yours"),
    );
    format!("Name them, for instance {}{scale}", options.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::iter::empty;

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
            options(table.iter(), &[Channel::Rpm], empty()),
            "--column millis=t_s/1000 --column pwm=duty/255 --column current_mA=i_A/1000"
        );
        let with_direction = [column("pwm", &[0.0, 99.0]), column("dir", &[0.0, 1.0]), column("adc", &[512.0])];
        assert_eq!(
            options(with_direction.iter(), &[Channel::Time], empty()),
            "--column 'pwm*sign(dir)=duty/100' --column adc=i_A*AMPERES_PER_STEP-AMPERES_AT_0"
        );
        let robot = [column("/Drive/LeftAppliedVolts", &[1.0]), column("/Drive/LeftVelocityRadPerSec", &[1.0])];
        assert_eq!(
            options(robot.iter(), &[Channel::Time], empty()),
            "--column /Drive/LeftAppliedVolts=u_V --column /Drive/LeftVelocityRadPerSec=omega_rad_per_s"
        );
        let structure = [
            column("RawData/Time", &[0.0, 0.001]),
            column("RawData/Input", &[0.0, 11.7]),
            column("RawData/Velo", &[0.0, 210.0]),
        ];
        assert_eq!(
            options(structure.iter(), &[], empty()),
            "--column RawData/Time=t_s --column RawData/Velo=omega_rad_per_s --column RawData/Input=u_V"
        );
        let other = [
            column("t", &[0.0, 0.01]),
            column("/motor/Voltage, commanded", &[0.0, 9.0]),
            column("motorSpeed", &[0.0, 9.0]),
        ];
        assert_eq!(
            options(other.iter(), &[], empty()),
            "--column t=t_s --column '/motor/Voltage, commanded=u_V' --column motorSpeed=omega_rad_per_s"
        );
        assert_eq!(options([column("foo", &[1.0])].iter(), &[], empty()), "");
        let nameless = [column("1", &[412.0, 422.0]), column("2", &[0.0, 0.0]), column("3", &[0.0, 0.0])];
        assert_eq!(by_number(&nameless), "--column 1=t_s/1000 --column 2=u_V --column 3=rpm");
        let of_sketch = [
            column("1", &[412.0, 422.0]),
            column("2", &[0.0, -215.0]),
            column("3", &[0.0, 812.5]),
            column("4", &[3.0, -240.0]),
        ];
        assert_eq!(by_number(&of_sketch), "--column 1=t_s/1000 --column 2=duty/255 --column 3=rpm --column 4=i_A/1000");
    }

    #[test]
    fn a_speed_without_a_sign_gets_that_of_the_direction() {
        let column = |name: &str, values: &[f64]| Column::new(name, values.to_vec());
        let unused = [column("pwm", &[0.0, 206.0]), column("dir", &[1.0, 0.0]), column("mA", &[0.0, 800.0])];
        let rpm = column("rpm", &[0.0, 900.0]);
        assert_eq!(
            options(unused.iter(), &[Channel::Time, Channel::Rpm], [(Channel::Rpm, &rpm)].into_iter()),
            "--column 'rpm*sign(dir)=rpm' --column 'pwm*sign(dir)=duty/255' --column mA=i_A/1000",
            "the current of a motor that brakes is against the direction"
        );
        let of_current = [column("mA", &[0.0, 800.0])];
        assert_eq!(options(of_current.iter(), &[], empty()), "--column mA=i_A/1000");
        let one_way = [column("pwm", &[0.0, 206.0]), column("dir", &[1.0, 1.0])];
        assert!(!options(one_way.iter(), &[Channel::Rpm], [(Channel::Rpm, &rpm)].into_iter()).contains("rpm"));
    }

    #[test]
    fn the_signal_of_a_generator_is_the_command() {
        let column = |name: &str, values: &[f64]| Column::new(name, values.to_vec());
        let simulink = [column("Motor Angular Velocity", &[0.0, 9.0]), column("Step1", &[0.0, 13_107.0])];
        assert_eq!(
            options(simulink.iter(), &[], empty()),
            "--column 'Motor Angular Velocity=omega_rad_per_s' --column Step1=duty/65535"
        );
        let volts = [column("input signal", &[0.0, 11.5]), column("Angular_Velocity", &[0.0, 9.0])];
        assert!(options(volts.iter(), &[], empty()).ends_with("--column 'input signal=u_V'"));
    }

    #[test]
    fn the_probe_at_half_of_five_volts_is_the_current_sensor() {
        let column = |name: &str, values: &[f64]| Column::new(name, values.to_vec());
        let probes = [column("CH1", &[0.02, 9.0]), column("CH2", &[2.51, 2.6]), column("CH3", &[0.0, 3.0])];
        assert_eq!(
            of_probes(probes.iter()),
            "Name them, for instance --column CH1=u_V --column CH2=i_A/0.185-13.51 --column CH3=rpm*RPM_PER_VOLT, where 0.185 V/A around 2.5 V is the current sensor's scale: put in yours"
        );
        assert!(of_probes(probes[..1].iter()).starts_with("Name them, for instance --column CH1=u_V; the voltage of"));
    }
}
