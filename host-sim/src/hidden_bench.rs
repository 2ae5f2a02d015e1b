//! A bench with friction, a bridge's drop, and one more effect that is hidden. It is drawn from a seed, or from a code
//! that a class shares.

use motorbench_model::Model;
use motorbench_model::catalogue::{Effect, Scales, effect};
use motorbench_model::motor::MotorParameters;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Effects of motor and load that a bench may hide, besides friction and the bridge's drop.
pub const HIDDEN: [&str; 8] = [
    "stribeck_friction",
    "quadratic_drag",
    "cogging",
    "gravity_unbalance",
    "supply_sag",
    "winding_heating",
    "load_step",
    "shaft_compliance",
];
/// Supply of the bench.
pub const SUPPLY_V: f64 = 12.0;
/// Duration of a recording of it: the sequence `identify` with steps of 500 ms.
pub const RECORDED_S: f64 = 20.0;

/// Digits of a class code: those that are not taken for one another.
const DIGITS: &[u8; 32] = b"0123456789ABCDEFGHJKMNPQRSTVWXYZ";
/// Number of digits before the one that checks them.
const CODE_DIGITS: usize = 5;
/// So many codes there are.
const CODES: u32 = 1 << (5 * CODE_DIGITS);

/// A code that hides the same bench on every page of a class. It is the number of a draw: nothing of the effect can be
/// read from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClassCode(u32);

/// Why a text is no class code.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no class code: it has six letters and digits. Copy it again from the teacher's page")]
pub struct NoClassCode(String);

impl ClassCode {
    /// The code of this number; larger numbers begin anew.
    pub fn of(number: u32) -> Self {
        Self(number % CODES)
    }

    /// The digit that finds a mistyped one: every weight is odd, so no other digit gives the same sum. Neighbours weigh
    /// differently, so that it finds most exchanged ones as well.
    fn check(self) -> u8 {
        let digit = |place: usize| self.0 >> (5 * place) & 31;
        let weighted = (0..CODE_DIGITS).map(|place| digit(place) * (2 * place as u32 + 3));
        DIGITS[(weighted.sum::<u32>() & 31) as usize]
    }

    /// The bench of this code, and what a data sheet says of its motor.
    pub fn bench(self) -> (Model, MotorParameters) {
        let mut random = ChaCha8Rng::seed_from_u64(u64::from(self.0) ^ 0x006d_6f74_6f72);
        let truth = draw(&mut random);
        let nominal = data_sheet(&truth.motor, &mut random);
        (truth, nominal)
    }
}

impl std::fmt::Display for ClassCode {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for place in (0..CODE_DIGITS).rev() {
            write!(formatter, "{}", DIGITS[(self.0 >> (5 * place) & 31) as usize] as char)?;
        }
        write!(formatter, "{}", self.check() as char)
    }
}

impl std::str::FromStr for ClassCode {
    type Err = NoClassCode;

    fn from_str(text: &str) -> Result<Self, NoClassCode> {
        let no_code = || NoClassCode(text.trim().into());
        let read = |sign: char| match sign.to_ascii_uppercase() {
            'O' => '0',
            'I' | 'L' => '1',
            other => other,
        };
        let signs: Vec<char> = text.chars().filter(|sign| !sign.is_whitespace() && *sign != '-').map(read).collect();
        if signs.len() != CODE_DIGITS + 1 {
            return Err(no_code());
        }
        let value = |sign: &char| DIGITS.iter().position(|digit| char::from(*digit) == *sign);
        let number = signs[..CODE_DIGITS].iter().try_fold(0, |number, sign| Some(number << 5 | value(sign)? as u32));
        let code = Self(number.ok_or_else(no_code)?);
        if char::from(code.check()) == signs[CODE_DIGITS] { Ok(code) } else { Err(no_code()) }
    }
}

/// A bench with friction, a bridge drop, and one more effect.
pub fn draw(random: &mut ChaCha8Rng) -> Model {
    let pivt6 = MotorParameters::PIVT6;
    let mut about = |value: f64| value * random.random_range(0.85..1.15);
    let motor = MotorParameters {
        resistance_ohm: about(pivt6.resistance_ohm),
        inductance_h: about(pivt6.inductance_h),
        torque_constant_nm_per_a: about(pivt6.torque_constant_nm_per_a),
        inertia_kg_m2: about(2.0 * pivt6.inertia_kg_m2),
        viscous_friction_nm_s: about(pivt6.viscous_friction_nm_s),
    };
    let scales = Scales {
        drive: motorbench_model::Drive::Voltage,
        motor,
        voltage_v: SUPPLY_V,
        speed_rad_per_s: SUPPLY_V / motor.torque_constant_nm_per_a,
        supply_v: SUPPLY_V,
        current_a: SUPPLY_V / motor.resistance_ohm,
        duration_s: RECORDED_S,
        interval_s: 1e-3,
        pwm_hz: 20_000.0,
    };
    let known = |id: &str| effect(id).expect("an effect of the catalogue");
    let hidden = known(HIDDEN[random.random_range(0..HIDDEN.len())]);
    Model::linear(motor)
        .with(known("coulomb_friction"), vec![random.random_range(0.03..0.06) * scales.stall_torque_nm()])
        .with(known("voltage_drop"), vec![random.random_range(1.0..2.2)])
        .with(hidden, values(hidden, &scales, random))
}

/// One of the effect's usual values, scaled by a random factor of at most three.
fn values(effect: &dyn Effect, scales: &Scales, random: &mut ChaCha8Rng) -> Vec<f64> {
    let mut starts = effect.starts(scales);
    let mut values = starts.swap_remove(random.random_range(0..starts.len()));
    let factor = random.random_range(1.0..3.0);
    for value in values.iter_mut().take(effect.about().linear_in) {
        *value *= factor;
    }
    values
}

/// Values of a data sheet: off by up to 15 %.
pub fn data_sheet(motor: &MotorParameters, random: &mut ChaCha8Rng) -> MotorParameters {
    let mut off = |value: f64| value * random.random_range(0.85..1.15);
    MotorParameters {
        resistance_ohm: off(motor.resistance_ohm),
        inductance_h: off(motor.inductance_h),
        torque_constant_nm_per_a: off(motor.torque_constant_nm_per_a),
        inertia_kg_m2: off(motor.inertia_kg_m2),
        viscous_friction_nm_s: off(motor.viscous_friction_nm_s),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_hidden_can_be_hidden() {
        for id in HIDDEN {
            let hidden = effect(id).expect("of the catalogue");
            assert!(hidden.acts_on_motor(), "{id} is not the motor's");
        }
    }

    #[test]
    fn a_code_hides_the_same_bench_for_everybody() {
        for number in [0, 1, 31, 32, 12_345_678, CODES - 1] {
            let code = ClassCode::of(number);
            let text = code.to_string();
            assert_eq!(text.parse(), Ok(code), "{text}");
            assert_eq!(text.to_lowercase().parse(), Ok(code));
            let of_text = text.parse::<ClassCode>().unwrap().bench();
            assert_eq!((of_text.0.to_toml(), of_text.1), (code.bench().0.to_toml(), code.bench().1));
        }
    }

    #[test]
    fn a_mistyped_code_is_refused() {
        let code = ClassCode::of(12_345_678).to_string();
        for place in 0..code.len() {
            for digit in DIGITS.iter().map(|digit| char::from(*digit)) {
                let mut mistyped: Vec<char> = code.chars().collect();
                mistyped[place] = digit;
                let mistyped: String = mistyped.into_iter().collect();
                assert_eq!(mistyped.parse::<ClassCode>().is_ok(), mistyped == code, "{mistyped}");
            }
        }
        for none in ["", "ABC", "ABCDEFG", "ABCDE!"] {
            assert!(none.parse::<ClassCode>().is_err(), "{none}");
        }
    }

    /// Neighbouring codes hide different effects: who knows one knows nothing of the next.
    #[test]
    fn codes_hide_every_effect() {
        let mut hidden: Vec<&str> =
            (0..100).map(|number| ClassCode::of(number).bench().0.terms.last().expect("one").id()).collect();
        assert!(hidden.windows(2).filter(|pair| pair[0] == pair[1]).count() < 30);
        hidden.sort_unstable();
        hidden.dedup();
        assert_eq!(hidden.len(), HIDDEN.len());
    }
}
