//! Units of constants, as a type: the one place that knows how a name says its unit and how its value is scaled.

/// The unit of a constant of the motor or of an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Unit {
    /// A share, a count or a choice: no unit.
    One,
    Volt,
    Ampere,
    Ohm,
    /// Resistance over speed.
    OhmSecond,
    Henry,
    /// Relative growth of a resistance over power.
    PerWatt,
    NewtonMetre,
    /// Torque over speed.
    NewtonMetreSecond,
    /// Torque over the square of speed.
    NewtonMetreSecond2,
    /// Torque over the cube of speed.
    NewtonMetreSecond3,
    NewtonMetrePerAmpere,
    KilogramMetre2,
    Radian,
    RadianPerSecond,
    Second,
    Hertz,
    /// Speed over voltage.
    RadianPerSecondPerVolt,
    /// Voltage over speed.
    VoltSecondPerRadian,
    /// Voltage over acceleration.
    VoltSecond2PerRadian,
    PartPerMillion,
}

impl Unit {
    /// All units.
    pub const ALL: [Self; 21] = [
        Self::One,
        Self::Volt,
        Self::Ampere,
        Self::Ohm,
        Self::OhmSecond,
        Self::Henry,
        Self::PerWatt,
        Self::NewtonMetre,
        Self::NewtonMetreSecond,
        Self::NewtonMetreSecond2,
        Self::NewtonMetreSecond3,
        Self::NewtonMetrePerAmpere,
        Self::KilogramMetre2,
        Self::Radian,
        Self::RadianPerSecond,
        Self::Second,
        Self::Hertz,
        Self::RadianPerSecondPerVolt,
        Self::VoltSecondPerRadian,
        Self::VoltSecond2PerRadian,
        Self::PartPerMillion,
    ];

    /// How a name with this unit ends.
    pub const fn suffix(self) -> &'static str {
        match self {
            Self::One => "",
            Self::Volt => "_V",
            Self::Ampere => "_A",
            Self::Ohm => "_ohm",
            Self::OhmSecond => "_ohm_s",
            Self::Henry => "_H",
            Self::PerWatt => "_per_W",
            Self::NewtonMetre => "_Nm",
            Self::NewtonMetreSecond => "_Nm_s",
            Self::NewtonMetreSecond2 => "_Nm_s2",
            Self::NewtonMetreSecond3 => "_Nm_s3",
            Self::NewtonMetrePerAmpere => "_Nm_per_A",
            Self::KilogramMetre2 => "_kg_m2",
            Self::Radian => "_rad",
            Self::RadianPerSecond => "_rad_per_s",
            Self::Second => "_s",
            Self::Hertz => "_Hz",
            Self::RadianPerSecondPerVolt => "_rad_per_s_per_V",
            Self::VoltSecondPerRadian => "_V_s_per_rad",
            Self::VoltSecond2PerRadian => "_V_s2_per_rad",
            Self::PartPerMillion => "_ppm",
        }
    }

    /// Powers of voltage, current and motion in this unit, in the order of [`Quantity`]; time is exact. Torque is voltage
    /// times current over speed, by the balance of power.
    const fn powers(self) -> [i8; 3] {
        match self {
            Self::One | Self::Second | Self::Hertz | Self::PartPerMillion => [0, 0, 0],
            Self::Volt => [1, 0, 0],
            Self::Ampere => [0, 1, 0],
            Self::Ohm | Self::Henry => [1, -1, 0],
            Self::OhmSecond => [1, -1, -1],
            Self::PerWatt => [-1, -1, 0],
            Self::NewtonMetre => [1, 1, -1],
            Self::NewtonMetreSecond | Self::KilogramMetre2 => [1, 1, -2],
            Self::NewtonMetreSecond2 => [1, 1, -3],
            Self::NewtonMetreSecond3 => [1, 1, -4],
            Self::NewtonMetrePerAmpere | Self::VoltSecondPerRadian | Self::VoltSecond2PerRadian => [1, 0, -1],
            Self::RadianPerSecondPerVolt => [-1, 0, 1],
            Self::Radian | Self::RadianPerSecond => [0, 0, 1],
        }
    }

    /// Whether a name says this unit: of all the suffixes that it ends with, the longest is this one.
    pub const fn is_said_by(self, name: &str) -> bool {
        let mut index = 0;
        while index < Self::ALL.len() {
            let other = Self::ALL[index].suffix();
            if ends_with(name, other) && other.len() > self.suffix().len() {
                return false;
            }
            index += 1;
        }
        ends_with(name, self.suffix())
    }
}

/// What a rig measures, each in a scale that may be wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Quantity {
    Voltage,
    Current,
    /// Angle and speed.
    Motion,
}

impl Quantity {
    /// The power of this quantity in a unit. A constant of that unit is off by this power of the factor by which the quantity
    /// is recorded off.
    pub fn power(self, unit: Unit) -> f64 {
        f64::from(unit.powers()[self as usize])
    }
}

/// [`str::ends_with`] for constants.
const fn ends_with(name: &str, suffix: &str) -> bool {
    let (name, suffix) = (name.as_bytes(), suffix.as_bytes());
    if name.len() < suffix.len() {
        return false;
    }
    let mut index = 0;
    while index < suffix.len() {
        if name[name.len() - suffix.len() + index] != suffix[index] {
            return false;
        }
        index += 1;
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_suffix_of_a_name_is_its_unit() {
        for (name, unit) in [
            ("growth_ohm_s", Unit::OhmSecond),
            ("drag_Nm_s2", Unit::NewtonMetreSecond2),
            ("stribeck_speed_rad_per_s", Unit::RadianPerSecond),
            ("time_constant_s", Unit::Second),
            ("torque_constant_Nm_per_A", Unit::NewtonMetrePerAmpere),
            ("lost_share", Unit::One),
        ] {
            let said: Vec<Unit> = Unit::ALL.into_iter().filter(|unit| unit.is_said_by(name)).collect();
            assert_eq!(said, [unit], "{name}");
        }
    }

    /// What each unit is made of says its powers as well.
    #[test]
    fn powers_follow_from_the_equations() {
        let sum = |units: &[(Unit, i8)]| {
            units.iter().fold([0; 3], |sum, (unit, times)| {
                std::array::from_fn(|index| sum[index] + times * unit.powers()[index])
            })
        };
        let speed = (Unit::RadianPerSecond, 1);
        let per_speed = (Unit::RadianPerSecond, -1);
        let equal = |unit: Unit, others: &[(Unit, i8)]| assert_eq!(unit.powers(), sum(others), "{unit:?}");
        equal(Unit::Volt, &[(Unit::Ohm, 1), (Unit::Ampere, 1)]);
        equal(Unit::Volt, &[(Unit::Henry, 1), (Unit::Ampere, 1)]);
        equal(Unit::Volt, &[(Unit::NewtonMetrePerAmpere, 1), speed]);
        equal(Unit::Volt, &[(Unit::OhmSecond, 1), (Unit::Ampere, 1), speed]);
        equal(Unit::One, &[(Unit::PerWatt, 1), (Unit::Volt, 1), (Unit::Ampere, 1)]);
        equal(Unit::NewtonMetre, &[(Unit::NewtonMetrePerAmpere, 1), (Unit::Ampere, 1)]);
        equal(Unit::NewtonMetre, &[(Unit::KilogramMetre2, 1), speed]);
        equal(Unit::NewtonMetreSecond, &[(Unit::NewtonMetre, 1), per_speed]);
        equal(Unit::NewtonMetreSecond2, &[(Unit::NewtonMetreSecond, 1), per_speed]);
        equal(Unit::NewtonMetreSecond3, &[(Unit::NewtonMetreSecond2, 1), per_speed]);
    }
}
