//! THE list of settings: name, unit, default, range and help of everything a person can set, in SI units.
//!
//! [`Settings`] holds the values as they were given; the blocks turn them once, by their checked `build`, into the
//! fixed-point configuration the control tick works with. The console, the EEPROM, the host's design tool and the
//! documentation all read this one list.

use crate::flash_text::{self, FlashText, Table};
use crate::quantiser::Format;
use crate::units::Rule;
use avr_progmem::progmem;

/// Declares the settings: the enum that names them, and the tables behind it.
macro_rules! settings {
    ($($variant:ident $name:literal [$unit:literal] $format:ident = $default:literal in $min:literal ..= $max:literal, $help:literal;)*) => {
        /// One setting; its discriminant is its place in every table.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u8)]
        pub enum Param {
            $(#[doc = concat!("`", $name, "` in ", $unit, ": ", $help, ".")] $variant,)*
        }

        impl Default for Param {
            /// The first.
            fn default() -> Self {
                const { Self::ALL[0] }
            }
        }

        impl Param {
            /// All settings, in the order they are listed and stored.
            pub const ALL: &'static [Param] = &[$(Param::$variant),*];
            /// How many there are.
            pub const COUNT: usize = Self::ALL.len();
        }

        /// Name and unit of each.
        pub(crate) const TEXT: &str = concat!($($name, "\0", $unit, "\0"),*);

        /// What each is, in one line. The chip does not carry these: the host program shows them.
        const HELP: [&str; Param::COUNT] = [$($help),*];

        /// What a stored number means by its place: name, unit and format of each.
        pub(crate) const MEANING: &str = concat!($($name, "\0", $unit, "\0", stringify!($format), "\0"),*);

        progmem! {
            // Numbers stay in flash as well.
            static progmem NUMBERS: [[Short; 3]; Param::COUNT] =
                [$([Short::of($default), Short::of($min), Short::of($max)]),*];
            static progmem FORMATS: [Format; Param::COUNT] = [$(Format::$format),*];
        }
    };
}

/// A number of the list in 16 bits, exact: a whole number of thousandths, ones or thousands.
#[derive(Clone, Copy)]
struct Short(i16);

impl Short {
    /// Of a number that has this form, at compile time.
    const fn of(value: f64) -> Self {
        let mut unit = 0;
        while unit < 3 {
            let scaled = value * [1000.0, 1.0, 0.001][unit];
            let rounded = (scaled + if value < 0.0 { -0.5 } else { 0.5 }) as i64;
            let difference = scaled - rounded as f64;
            if rounded >= -8192 && rounded <= 8191 && difference < 1e-9 && difference > -1e-9 {
                return Self((rounded << 2) as i16 | unit as i16);
            }
            unit += 1;
        }
        panic!("this number does not fit a Short");
    }

    /// The number.
    #[inline(never)]
    fn value(self) -> f32 {
        let number = (self.0 >> 2) as f32;
        match self.0 & 3 {
            0 => number / 1000.0,
            1 => number,
            _ => number * 1000.0,
        }
    }
}

settings! {
    // The rig.
    CountsPerRev "counts_per_rev" ["counts"] Own = 2000.0 in 4.0..=65000.0, "encoder counts a turn (x4)";
    SpeedRange "speed_range" ["rad/s"] Own = 512.0 in 8.0..=4096.0, "full scale of speed, a power of two";
    PositionRange "position_range" ["rad"] Own = 32.0 in 1.0..=4096.0, "full scale of position error, a power of two";
    SpeedSensor "speed_sensor" ["0|1"] Own = 0.0 in 0.0..=1.0, "0 encoder, 1 tachogenerator";
    SpeedFilter "speed_filter" ["ms"] Own = 0.0 in 0.0..=100.0, "time constant of the speed filter";
    TachoGain "tacho_gain" ["V/krpm"] Own = 3.0 in 0.1..=100.0, "tachogenerator, before the divider by two";
    Wiring "wiring" ["0|1"] Own = 0.0 in 0.0..=1.0, "0 PWM on IN1 (brakes), 1 PWM on EN (coasts)";
    SupplyVoltage "supply" ["V"] Volt = 12.0 in 3.0..=31.0, "motor supply";
    SupplyDivider "supply_divider" ["ratio"] Own = 0.0 in 0.0..=20.0, "divider on A2, 0 not wired";
    CurrentGain "current_gain" ["mV/A"] Own = 185.0 in 20.0..=1000.0, "current sensor";
    Resistance "resistance" ["ohm"] Own = 5.84 in 0.05..=500.0, "armature, tells a held shaft from a dead encoder";
    TorqueConstant "torque_constant" ["V s/rad"] Own = 0.0 in 0.0..=1000.0, "back-EMF, tells an encoder that counts too few; 0 not known";
    WindingTime "winding_time" ["ms"] Own = 0.0 in 0.0..=1000.0, "LQR observes the current; 0 sensor";
    TickRate "tick_rate" ["Hz"] Own = 1000.0 in 1000.0..=2000.0, "control rate, 1000 or 2000";
    // Limits the controllers work within.
    VoltageLimit "voltage_limit" ["V"] Volt = 12.0 in 0.0..=31.0, "largest voltage commanded";
    SlewLimit "slew_limit" ["V/s"] Slew = 500.0 in 1.0..=30000.0, "fastest change of the voltage";
    CurrentLimit "current_limit" ["A"] Ampere = 1.0 in 0.0..=7.999, "voltage folds back above, 0 off";
    // Trips.
    TripPeak "trip_peak" ["A"] Ampere = 1.2 in 0.05..=7.999, "over-current, for 5 ms";
    TripContinuous "trip_continuous" ["A"] Ampere = 0.6 in 0.05..=7.999, "over-current, thermal";
    TripThermalTime "trip_thermal_time" ["s"] Own = 2.0 in 0.3..=60.0, "time constant of the thermal trip";
    TripStall "trip_stall" ["ms"] Ticks = 500.0 in 0.0..=10000.0, "driven and not turning, 0 off";
    TripEncoder "trip_encoder" ["ms"] Ticks = 20.0 in 0.0..=10000.0, "the voltage implies more speed than is measured, 0 off";
    TripRunaway "trip_runaway" ["ms"] Ticks = 100.0 in 0.0..=10000.0, "turning against the drive, not slowing, 0 off";
    TripSupplyLow "trip_supply_low" ["V"] Own = 5.0 in 0.0..=40.0, "lowest supply, where measured";
    TripSupplyHigh "trip_supply_high" ["V"] Own = 36.0 in 0.0..=40.0, "highest supply, where measured";
    TripHost "trip_host" ["ms"] Ticks = 0.0 in 0.0..=60000.0, "longest silence of the host, 0 off";
    EmergencyStop "emergency_stop" ["0|1|2"] Own = 1.0 in 0.0..=2.0, "contact on D4: 0 none, 1 normally open, 2 normally closed";
    // Speed PID.
    SpeedKp "speed_kp" ["V s/rad"] SpeedGain = 0.05 in -1000.0..=1000.0, "speed PID, proportional";
    SpeedKi "speed_ki" ["V/rad"] SpeedIntegral = 1.0 in -100000.0..=100000.0, "speed PID, integral";
    SpeedKd "speed_kd" ["V s2/rad"] Own = 0.0 in -100.0..=100.0, "speed PID, derivative";
    SpeedTf "speed_tf" ["ms"] Own = 5.0 in 0.0..=1000.0, "speed PID, derivative filter";
    SpeedB "speed_b" ["1"] Own = 1.0 in 0.0..=2.0, "speed PID, setpoint weight";
    SpeedKff "speed_kff" ["V s/rad"] SpeedGain = 0.0 in -1000.0..=1000.0, "speed PID, feed-forward";
    SpeedTt "speed_tt" ["ms"] Own = 50.0 in 1.0..=60000.0, "speed PID, anti-windup tracking time";
    // Position PID.
    PositionKp "position_kp" ["V/rad"] PositionGain = 5.0 in -10000.0..=10000.0, "position PID, proportional";
    PositionKi "position_ki" ["V/(rad s)"] PositionIntegral = 0.0 in -100000.0..=100000.0, "position PID, integral";
    PositionKd "position_kd" ["V s/rad"] SpeedGain = 0.1 in -1000.0..=1000.0, "position PID, derivative";
    PositionTf "position_tf" ["ms"] Own = 2.0 in 0.0..=1000.0, "position PID, derivative filter";
    PositionKff "position_kff" ["V s/rad"] SpeedGain = 0.0 in -1000.0..=1000.0, "position PID, speed feed-forward";
    PositionTt "position_tt" ["ms"] Own = 50.0 in 1.0..=60000.0, "position PID, anti-windup tracking time";
    // LQR, speed: u = kr r - kw w - kc i + ki integral(r - w).
    LqrSpeedKw "lqr_speed_kw" ["V s/rad"] SpeedGain = 0.05 in -1000.0..=1000.0, "speed LQR, speed";
    LqrSpeedKc "lqr_speed_kc" ["V/A"] CurrentGain = 0.5 in -1000.0..=1000.0, "speed LQR, current";
    LqrSpeedKi "lqr_speed_ki" ["V/rad"] SpeedIntegral = 1.5 in -100000.0..=100000.0, "speed LQR, integral";
    LqrSpeedKr "lqr_speed_kr" ["V s/rad"] SpeedGain = 0.0 in -1000.0..=1000.0, "speed LQR, reference";
    // LQR, position: u = kp (r - x) - kw w - kc i + ki integral(r - x).
    LqrPositionKp "lqr_position_kp" ["V/rad"] PositionGain = 5.0 in -10000.0..=10000.0, "position LQR, position";
    LqrPositionKw "lqr_position_kw" ["V s/rad"] SpeedGain = 0.1 in -1000.0..=1000.0, "position LQR, speed";
    LqrPositionKc "lqr_position_kc" ["V/A"] CurrentGain = 0.5 in -1000.0..=1000.0, "position LQR, current";
    LqrPositionKi "lqr_position_ki" ["V/(rad s)"] PositionIntegral = 5.0 in -100000.0..=100000.0, "position LQR, integral";
    LqrTt "lqr_tt" ["ms"] Own = 50.0 in 1.0..=60000.0, "both LQR, anti-windup tracking time";
    // Compensation, off by default.
    CompDrop "comp_drop" ["V"] Volt = 0.0 in 0.0..=8.0, "bridge drop added to the voltage";
    CompDropWidth "comp_drop_width" ["V"] Own = 0.5 in 0.01..=8.0, "voltage below which it fades out";
    CompFrictionForward "comp_friction_fwd" ["V"] Volt = 0.0 in 0.0..=8.0, "voltage that overcomes friction, forward";
    CompFrictionReverse "comp_friction_rev" ["V"] Volt = 0.0 in 0.0..=8.0, "voltage that overcomes friction, reverse";
    CompFrictionWidth "comp_friction_width" ["rad/s"] Own = 2.0 in 0.01..=1000.0, "speed below which it fades out";
    // References.
    Acceleration "acceleration" ["rad/s2"] Own = 2000.0 in 0.1..=1000000.0, "fastest change of the reference speed";
    JerkTime "jerk_time" ["ms"] Own = 0.0 in 0.0..=255.0, "S-curve: time to reach the acceleration, 0 ramp";
    CruiseSpeed "cruise_speed" ["rad/s"] Own = 100.0 in 0.001..=4096.0, "position moves, fastest speed";
}

/// The values of all settings, in SI units.
///
/// [`Default`] is all zeros, for who fills them in afterwards; see [`Settings::defaults`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// In the order of [`Param::ALL`].
    pub values: [f32; Param::COUNT],
}

impl Default for Settings {
    fn default() -> Self {
        Self { values: [0.0; Param::COUNT] }
    }
}

impl Settings {
    /// The defaults: the test stand of the two studies, without anything that depends on a fitted model.
    pub fn defaults() -> Self {
        let mut settings = Self::default();
        settings.set_defaults();
        settings
    }

    /// Takes the defaults, in place: the chip's stack has no room for another copy.
    #[inline(never)]
    pub fn set_defaults(&mut self) {
        for (value, index) in self.values.iter_mut().zip(0..) {
            *value = NUMBERS.load_at(index)[0].value();
        }
    }

    /// The value of one setting, in its unit.
    #[inline]
    pub fn get(&self, param: Param) -> f32 {
        self.values[param as usize]
    }

    /// Whether the tick is the fast one of 2 kHz.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn is_fast(&self) -> bool {
        self.get(Param::TickRate) == 2000.0
    }

    /// How many ticks so many milliseconds are.
    pub fn ticks(&self, ms: u16) -> u32 {
        (ms as u32) << self.is_fast() as u8
    }

    /// How many whole milliseconds so many ticks are.
    pub fn whole_ms(&self, ticks: u16) -> u16 {
        ticks >> self.is_fast() as u8
    }

    /// Sets one value.
    ///
    /// # Errors
    /// [`Rule::NotFinite`], or [`Rule::TooLarge`]/[`Rule::TooSmall`] outside the range of [`Param::range`]; the value then stays as it was.
    pub fn set(&mut self, param: Param, value: f32) -> Result<(), Rule> {
        let (min, max) = param.range();
        if value.is_nan() {
            Err(Rule::NotFinite)
        } else if value > max {
            Err(Rule::TooLarge)
        } else if value < min {
            Err(Rule::TooSmall)
        } else {
            self.values[param as usize] = value;
            Ok(())
        }
    }
}

impl Param {
    /// The setting at `index` of the list.
    pub fn from_index(index: usize) -> Option<Self> {
        // SAFETY: the discriminants are 0..COUNT.
        (index < Self::COUNT).then(|| unsafe { core::mem::transmute::<u8, Self>(index as u8) })
    }

    /// How it becomes bits.
    pub fn format(self) -> Format {
        FORMATS.load_at(self as usize)
    }

    /// Smallest and largest value accepted.
    pub fn range(self) -> (f32, f32) {
        let [_, min, max] = NUMBERS.load_at(self as usize);
        (min.value(), max.value())
    }
}

/// What a setting's texts say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Text {
    /// The name on the console.
    Name = 0,
    /// The unit.
    Unit = 1,
}

/// Texts of each setting.
pub(crate) const TEXTS: u8 = 2;

/// One line of help, which the host program has and the chip has not.
pub fn help(param: Param) -> &'static str {
    HELP[param as usize]
}

/// The characters of one text of one setting, read from flash.
pub fn text(param: Param, which: Text) -> FlashText {
    FlashText::of(Table::Settings, param as u8 * TEXTS + which as u8)
}

/// The setting of this name.
pub fn find(name: &[u8]) -> Option<Param> {
    flash_text::find(Table::Settings, Param::COUNT as u8, name).and_then(|index| Param::from_index(index as usize))
}

/// A setting that cannot be turned into the fixed-point configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BuildError {
    /// Which setting.
    pub param: Param,
    /// The rule it breaks.
    pub rule: Rule,
}

impl Rule {
    /// This rule, broken by `param`.
    pub fn of(self, param: Param) -> BuildError {
        BuildError { param, rule: self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantiser::Quantiser;

    #[test]
    fn every_setting_has_a_name_a_unit_a_help_and_a_default_within_its_range() {
        let defaults = Settings::defaults();
        for (i, &param) in Param::ALL.iter().enumerate() {
            assert_eq!(param as usize, i);
            assert!(!help(param).is_empty(), "{param:?}");
            for which in [Text::Name, Text::Unit] {
                assert!(text(param, which).count() > 0, "{param:?} {which:?}");
            }
            let (min, max) = param.range();
            let value = defaults.get(param);
            assert!(min <= value && value <= max, "{param:?}: {value} outside {min}..={max}");
        }
        let name: Vec<u8> = text(Param::SpeedKp, Text::Name).collect();
        assert_eq!(name, b"speed_kp");
    }

    /// Where the range alone decides, both its ends fit the format.
    #[test]
    fn a_value_within_its_range_fits() {
        for &param in Param::ALL {
            if ![Format::Volt, Format::Ampere, Format::Slew, Format::Ticks].contains(&param.format()) {
                continue;
            }
            for end in [param.range().0, param.range().1] {
                let mut settings = Settings::defaults();
                settings.set(param, end).unwrap();
                let built = Quantiser::build(&settings, |q| q.bits(param));
                assert!(built.is_ok(), "{param:?} = {end}: {built:?}");
            }
        }
    }

    #[test]
    fn a_refused_value_leaves_the_old_one() {
        let mut settings = Settings::defaults();
        assert_eq!(settings.set(Param::SpeedB, 3.0), Err(Rule::TooLarge));
        assert_eq!(settings.set(Param::SpeedB, -1.0), Err(Rule::TooSmall));
        assert_eq!(settings.set(Param::SpeedB, f32::NAN), Err(Rule::NotFinite));
        assert_eq!(settings, Settings::defaults());
    }
}
