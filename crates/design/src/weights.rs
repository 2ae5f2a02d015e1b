//! Q and R: the weights of the linear-quadratic cost, given by hand or searched.
//!
//! The cost is the sum over all ticks of `q1 x1^2 + q2 x2^2 + ... + r u^2`, with the states of [`states`] and the
//! voltage `u`. Only ratios count: two times all weights gives the same gains.

use super::fixed_point::rounded;
use super::search::LARGEST_TURN;
use motorbench_model::linear::motor_model;
use motorbench_model::motor::MotorParameters;
use nalgebra::Complex;
use serde::Serialize;

/// Name and unit of the weighted states, in order. The integral is that of the control error.
pub fn states(position: bool) -> &'static [(&'static str, &'static str)] {
    const STATES: [(&str, &str); 4] = [("angle", "rad"), ("speed", "rad/s"), ("current", "A"), ("integral", "rad s")];
    const SPEED_STATES: [(&str, &str); 3] = [("speed", "rad/s"), ("current", "A"), ("integral", "rad")];
    if position { &STATES } else { &SPEED_STATES }
}

/// Q (diagonal) and R of a speed or a position loop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(into = "Written")]
pub struct Weights {
    position: bool,
    angle: f64,
    speed: f64,
    current: f64,
    integral: f64,
    voltage: f64,
}

/// As JSON.
#[derive(Serialize)]
struct Written {
    states: Vec<&'static str>,
    q: Vec<f64>,
    r: f64,
}

impl From<Weights> for Written {
    fn from(weights: Weights) -> Self {
        let states = states(weights.position).iter().map(|(name, _)| *name).collect();
        Self { states, q: weights.q(), r: weights.voltage }
    }
}

/// Why weights are refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BadWeight {
    /// The number of weights differs from the number of states.
    #[error("{option} has {found} numbers, a {} loop takes {}: {}", loop_name(*.position), states(*.position).len(), names(*.position))]
    Count {
        /// Which option.
        option: &'static str,
        /// Numbers given.
        found: usize,
        /// Which loop.
        position: bool,
    },
    /// The weights are for the other kind of loop.
    #[error("the weights are those of a {} loop", loop_name(*.position))]
    OtherLoop {
        /// The kind they are for.
        position: bool,
    },
    /// NaN, or infinite where a weight must not be.
    #[error("{option}: {value} for the {state} is not a finite number")]
    NotFinite {
        /// Which option.
        option: &'static str,
        /// Which state.
        state: &'static str,
        /// What it was.
        value: f64,
    },
    /// Negative.
    #[error("{option}: {value} for the {state} is negative; give 0 or more (0 leaves the {state} free)")]
    Negative {
        /// Which option.
        option: &'static str,
        /// Which state.
        state: &'static str,
        /// What it was.
        value: f64,
    },
    /// Bryson's rule with an allowed deviation of zero.
    #[error(
        "--largest: {value} {unit} as the largest {state} allows no loop: give a positive number, or inf if any {state} is acceptable"
    )]
    NoDeviation {
        /// Which state.
        state: &'static str,
        /// What it was.
        value: f64,
        /// Its unit.
        unit: &'static str,
    },
    /// The weight of the voltage is zero.
    #[error("--r = {0}: the weight of the voltage must be a positive number; a smaller one makes the loop faster")]
    FreeVoltage(f64),
    /// Bryson's rule with an invalid voltage.
    #[error("{option} = {value}: it must be {rule}")]
    LargestVoltage {
        /// Which option.
        option: &'static str,
        /// What it was.
        value: f64,
        /// What it has to be.
        rule: &'static str,
    },
    /// There is no integral action.
    #[error("the integral has no weight, so a steady error would remain: give it a weight above 0")]
    NoIntegral,
}

fn loop_name(position: bool) -> &'static str {
    if position { "position" } else { "speed" }
}

fn names(position: bool) -> String {
    states(position).iter().map(|(name, unit)| format!("{name} ({unit})")).collect::<Vec<_>>().join(", ")
}

/// A weight with all of its digits, but without rows of zeros.
fn digits(weight: f64) -> String {
    if weight == 0.0 || (1e-5..1e7).contains(&weight) { weight.to_string() } else { format!("{weight:e}") }
}

impl Weights {
    /// Weights as given: `q` in the order of [`states`] in 1 / (unit of the state)^2, `r` in 1/V^2.
    ///
    /// # Errors
    /// [`BadWeight`]: the first rule that is broken.
    pub fn new(position: bool, q: &[f64], r: f64) -> Result<Self, BadWeight> {
        Self::of("--q", position, q, r)
    }

    /// Bryson's rule: the weight of each state is the inverse square of its largest acceptable deviation (infinite:
    /// weight 0). The same holds for the voltage.
    ///
    /// # Errors
    /// [`BadWeight`]: the first rule that is broken.
    pub fn bryson(position: bool, largest: &[f64], largest_v: f64) -> Result<Self, BadWeight> {
        for (&value, &(state, unit)) in largest.iter().zip(states(position)) {
            if value <= 0.0 {
                return Err(BadWeight::NoDeviation { state, value, unit });
            }
        }
        if !(largest_v > 0.0 && largest_v.is_finite()) {
            let rule = "a positive number of volts";
            return Err(BadWeight::LargestVoltage { option: "--largest-V", value: largest_v, rule });
        }
        let q: Vec<f64> = largest.iter().map(|value| rounded(value.powi(-2))).collect();
        Self::of("--largest", position, &q, rounded(largest_v.powi(-2)))
    }

    fn of(option: &'static str, position: bool, q: &[f64], r: f64) -> Result<Self, BadWeight> {
        let names = states(position);
        if q.len() != names.len() {
            return Err(BadWeight::Count { option, found: q.len(), position });
        }
        for (&value, &(state, _)) in q.iter().zip(names) {
            if !value.is_finite() {
                return Err(BadWeight::NotFinite { option, state, value });
            }
            if value < 0.0 {
                return Err(BadWeight::Negative { option, state, value });
            }
        }
        if !(r > 0.0 && r.is_finite()) {
            return Err(BadWeight::FreeVoltage(r));
        }
        let [speed, current, integral] = q[q.len() - 3..] else {
            return Err(BadWeight::Count { option, found: q.len(), position });
        };
        if integral == 0.0 {
            return Err(BadWeight::NoIntegral);
        }
        let angle = if position { q[0] } else { 0.0 };
        Ok(Self { position, angle, speed, current, integral, voltage: r })
    }

    /// Weights of a search, relative to the voltage, rounded to the digits that a person reads.
    pub(super) fn found(position: bool, angle: f64, speed: f64, integral: f64) -> Self {
        let (angle, speed, integral) = (rounded(angle), rounded(speed), rounded(integral));
        Self { position, angle, speed, current: 0.0, integral, voltage: 1.0 }
    }

    /// Whether they are for a position loop.
    pub fn is_position(&self) -> bool {
        self.position
    }

    /// The diagonal of Q in the order of [`states`].
    pub fn q(&self) -> Vec<f64> {
        let all = [self.angle, self.speed, self.current, self.integral];
        all[usize::from(!self.position)..].to_vec()
    }

    /// Weight on the square of the voltage.
    pub fn r(&self) -> f64 {
        self.voltage
    }

    /// Ratio of the largest weight to the smallest, with that of the voltage. A weight of 0 does not count.
    pub(super) fn span(&self) -> f64 {
        let weighed = self.q().into_iter().filter(|weight| *weight > 0.0);
        let [least, most] =
            weighed.fold([self.voltage; 2], |[least, most], weight| [least.min(weight), most.max(weight)]);
        most / least
    }

    /// Weights on angle, speed, current and integral, relative to that on the voltage.
    pub(super) fn relative(&self) -> [f64; 4] {
        [self.angle, self.speed, self.current, self.integral].map(|weight| weight / self.voltage)
    }

    /// As options of the command.
    pub fn options(&self) -> String {
        let q: Vec<String> = self.q().into_iter().map(digits).collect();
        format!("--q {} --r {}", q.join(","), digits(self.voltage))
    }

    /// Approximate crossover frequency of the weights: the highest at which the weight on a state equals a volt, as the
    /// search sets them. It depends only on weights and motor, so the same weights always give the same gains.
    pub fn crossover_rad_per_s(&self, motor: &MotorParameters, period_s: f64) -> f64 {
        let [angle, speed, _, integral] = self.relative();
        let output = if self.position { motor_model::angle(motor) } else { motor_model::speed(motor) };
        let (of_output, of_rate) = if self.position { (angle, speed) } else { (speed / MOST_DAMPING.powi(2), 0.0) };
        // Weight on the state `s^power` times the output.
        let terms = [(2, integral), (0, of_output), (-2, of_rate / MOST_DAMPING.powi(2))];
        let highest = LARGEST_TURN / period_s;
        let asks = |s: f64| {
            let gain = output.at(Complex::new(0.0, s)).norm_sqr();
            terms.iter().any(|(power, weight)| weight * gain > s.powi(*power))
        };
        let (mut low, mut high) = ((LOWEST * highest).ln(), highest.ln());
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            *(if asks(middle.exp()) { &mut low } else { &mut high }) = middle;
        }
        (0.5 * (low + high)).exp()
    }
}

/// The most damping of a shape of the search. A larger weight on the damping means a faster loop.
pub(super) const MOST_DAMPING: f64 = 2.5;
/// Lowest crossover relative to the highest, and number of bisections on a logarithmic scale, for eight digits.
const LOWEST: f64 = 1e-6;
const BISECTIONS: usize = 30;

#[cfg(test)]
mod tests {
    use super::*;

    /// A weight by hand and by Bryson's rule, and both as options.
    #[test]
    fn the_rule_of_bryson_is_the_inverse_square() {
        let bryson = Weights::bryson(false, &[5.0, f64::INFINITY, 0.2], 4.0).unwrap();
        assert_eq!(bryson, Weights::new(false, &[0.04, 0.0, 25.0], 0.0625).unwrap());
        assert_eq!(bryson.options(), "--q 0.04,0,25 --r 0.0625");
        let json = serde_json::to_value(bryson).unwrap();
        assert_eq!(json["states"], serde_json::json!(["speed", "current", "integral"]));
        assert_eq!((&json["q"], &json["r"]), (&serde_json::json!([0.04, 0.0, 25.0]), &serde_json::json!(0.0625)));
    }

    /// Options use the shortest form of a number.
    #[test]
    fn weights_of_any_size_are_written_to_be_read() {
        let q = [1e30, 0.0, 2.5e-9];
        let weights = Weights::new(false, &q, 123.45).unwrap();
        assert_eq!(weights.options(), "--q 1e30,0,2.5e-9 --r 123.45");
        assert_eq!(q.map(|weight| digits(weight).parse::<f64>().unwrap()), q);
        assert!((weights.span() / 4e38 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn nonsense_is_refused_each_with_its_own_message() {
        let q = |position, q: &[f64], r| Weights::new(position, q, r).unwrap_err().to_string();
        let bryson = |largest: &[f64], v| Weights::bryson(false, largest, v).unwrap_err().to_string();
        let nan = f64::NAN;
        for (message, expected) in [
            (
                q(false, &[1.0, 2.0], 1.0),
                "--q has 2 numbers, a speed loop takes 3: speed (rad/s), current (A), integral",
            ),
            (q(true, &[1.0, 2.0, 3.0], 1.0), "--q has 3 numbers, a position loop takes 4: angle (rad), speed"),
            (q(false, &[-1.0, 0.0, 1.0], 1.0), "--q: -1 for the speed is negative"),
            (q(false, &[1.0, nan, 1.0], 1.0), "--q: NaN for the current is not a finite number"),
            (q(false, &[1.0, 0.0, f64::INFINITY], 1.0), "--q: inf for the integral is not a finite number"),
            (q(false, &[1.0, 0.0, 1.0], 0.0), "--r = 0: the weight of the voltage must be a positive"),
            (q(false, &[1.0, 0.0, 1.0], -2.0), "--r = -2: the weight of the voltage must be a positive"),
            (q(false, &[1.0, 0.0, 1.0], nan), "--r = NaN: the weight of the voltage must be a positive"),
            (q(false, &[1.0, 0.0, 0.0], 1.0), "the integral has no weight"),
            (bryson(&[1.0, 0.0, 1.0], 1.0), "--largest: 0 A as the largest current allows no"),
            (bryson(&[-1.0, 1.0, 1.0], 1.0), "--largest: -1 rad/s as the largest speed allows no"),
            (bryson(&[nan, 1.0, 1.0], 1.0), "--largest: NaN for the speed is not a finite"),
            (bryson(&[1.0, 1.0], 1.0), "--largest has 2 numbers"),
            (bryson(&[1.0, 1.0, 1.0], 0.0), "--largest-V = 0: it must be a positive number of volts"),
            (bryson(&[1.0, 1.0, f64::INFINITY], 1.0), "the integral has no weight"),
        ] {
            assert!(message.starts_with(expected), "{message}");
        }
    }
}
