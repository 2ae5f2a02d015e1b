//! From residuals to innovations: the residual of a free run is the answer of the linear motor to what the model leaves out.
//! The Kalman filter of that motor with an unknown torque and an unknown voltage takes out of it what can be foreseen.
//! (Kristensen, Madsen and Jorgensen, Automatica 40 (2004).)

use super::settings::Settings;
use crate::dataset::{Dataset, Output};
use crate::motor::MotorParameters;
use nalgebra::{SMatrix, SVector};

/// Current, speed, angle, unknown torque, unknown voltage.
const STATES: usize = 5;
type State = SVector<f64, STATES>;
type Covariance = SMatrix<f64, STATES, STATES>;

/// Two gains that differ by less than this share are one.
const CONVERGED: f64 = 1e-7;
/// Where the angle of a stretch begins is unknown within this.
const ANGLE_UNKNOWN_RAD: f64 = 10.0;

/// What a channel of the residual is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Armature current.
    Current,
    /// Speed.
    Speed,
    /// Angle as counted.
    Angle,
}

impl Quantity {
    fn place(self) -> usize {
        match self {
            Self::Current => 0,
            Self::Speed => 1,
            Self::Angle => 2,
        }
    }
}

/// A measured quantity as the evidence sees it.
#[derive(Clone, Debug)]
pub struct Channel {
    /// Which.
    pub quantity: Quantity,
    /// Its readings, missing ones as NaN.
    pub values: Vec<f64>,
    /// Standard deviation of its noise by what its rows show.
    pub noise: f64,
}

/// The channels of a recording: an angle that is counted is taken as it is, since a difference of counts has the noise of
/// both ends.
pub fn channels(data: &Dataset) -> Vec<Channel> {
    let channel = |measured: &crate::dataset::Measured| {
        let is_angle = measured.output == Output::AngleDifference && data.count_rad > 0.0;
        let quantity = match measured.output {
            Output::Current => Quantity::Current,
            _ if is_angle => Quantity::Angle,
            _ => Quantity::Speed,
        };
        let values = if is_angle { angle(data) } else { measured.values.clone() };
        let noise = if is_angle { data.count_rad / 12_f64.sqrt() } else { measured.noise };
        Channel { quantity, values, noise: noise.max(f64::MIN_POSITIVE) }
    };
    data.measured.iter().map(channel).collect()
}

/// The counted angle of each stretch from its begin on.
fn angle(data: &Dataset) -> Vec<f64> {
    let mut angle_rad = vec![f64::NAN; data.len()];
    for stretch in &data.stretches {
        let begin_rad = data.angle_rad[stretch.rows.start];
        for row in stretch.rows.clone() {
            angle_rad[row] = data.angle_rad[row] - begin_rad;
        }
    }
    angle_rad
}

/// How uncertain everything is: multiples of what is usual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unknown {
    /// Of the torque that the laws always leave out.
    pub torque: f64,
    /// Of such a voltage.
    pub voltage: f64,
    /// Of the noise of the motion's sensor.
    pub motion: f64,
    /// Of the noise of the current's sensor.
    pub current: f64,
}

impl Unknown {
    /// Everything as usual.
    pub const USUAL: Self = Self { torque: 1.0, voltage: 1.0, motion: 1.0, current: 1.0 };

    /// As a list.
    pub fn list(self) -> [f64; 4] {
        [self.torque, self.voltage, self.motion, self.current]
    }

    /// From a list.
    pub fn of([torque, voltage, motion, current]: [f64; 4]) -> Self {
        Self { torque, voltage, motion, current }
    }
}

/// What a row does to the state: one update for each of its readings.
#[derive(Clone, Debug)]
struct Gain {
    /// Channel, gain and inverse standard deviation of the innovation.
    updates: Vec<(usize, State, f64)>,
}

/// The filter of one recording: gains are computed once, and applied to residuals and sensitivities alike.
pub struct Whitener {
    gains: Vec<Gain>,
    /// Which of them each row has.
    of_row: Vec<u32>,
    /// Transition of the stretch of each row, and whether a row is the last of its stretch.
    transitions: Vec<Covariance>,
    stretch_ends: Vec<usize>,
    places: Vec<usize>,
    /// Sum of the logarithms of the innovations' standard deviations.
    pub log_deviations: f64,
}

impl Whitener {
    /// Of a motor, with so much unknown.
    pub fn new(
        data: &Dataset,
        channels: &[Channel],
        motor: &MotorParameters,
        unknown: Unknown,
        set: &Settings,
    ) -> Self {
        let typical = Typical::of(data, motor);
        let torque_nm = unknown.torque * set.laws_leave_out * typical.torque_nm;
        let voltage_v = unknown.voltage * set.laws_leave_out * typical.voltage_v;
        let noise: Vec<f64> = channels
            .iter()
            .map(|channel| {
                channel.noise
                    * match channel.quantity {
                        Quantity::Current => unknown.current,
                        Quantity::Speed | Quantity::Angle => unknown.motion,
                    }
            })
            .collect();
        let places: Vec<usize> = channels.iter().map(|channel| channel.quantity.place()).collect();
        let mut filter = Self {
            gains: Vec::new(),
            of_row: vec![0; data.len()],
            transitions: Vec::new(),
            stretch_ends: Vec::new(),
            places,
            log_deviations: 0.0,
        };
        let mut left_out = Covariance::zeros();
        left_out[(3, 3)] = torque_nm * torque_nm;
        left_out[(4, 4)] = voltage_v * voltage_v;
        for stretch in &data.stretches {
            let transition = (rates(motor, set.correlation_s, data.is_held(stretch)) * stretch.interval_s).exp();
            let forgotten = 1.0 - (-2.0 * stretch.interval_s / set.correlation_s).exp();
            let mut begin = left_out;
            for (channel, noise) in channels.iter().zip(&noise) {
                if channel.quantity != Quantity::Angle {
                    begin[(channel.quantity.place(), channel.quantity.place())] = noise * noise;
                }
            }
            begin[(2, 2)] = ANGLE_UNKNOWN_RAD * ANGLE_UNKNOWN_RAD;
            filter.add_stretch(channels, &noise, stretch.rows.clone(), (begin, transition, left_out * forgotten));
        }
        filter
    }

    fn add_stretch(
        &mut self,
        channels: &[Channel],
        noise: &[f64],
        rows: std::ops::Range<usize>,
        (begin, transition, driven): (Covariance, Covariance, Covariance),
    ) {
        let mut covariance = begin;
        let mut settled: Option<(u32, u32)> = None;
        let has = |row: usize, channel: usize| channels[channel].values[row].is_finite();
        let pattern = |row: usize| (0..channels.len()).map(|channel| u32::from(has(row, channel)) << channel).sum();
        for row in rows.clone() {
            let seen: u32 = pattern(row);
            if let Some((gain, of)) = settled.filter(|(_, of)| *of == seen) {
                self.of_row[row] = gain;
                self.log_deviations -=
                    self.gains[gain as usize].updates.iter().map(|update| update.2.ln()).sum::<f64>();
                settled = Some((gain, of));
                continue;
            }
            let mut updates = Vec::with_capacity(channels.len());
            for channel in (0..channels.len()).filter(|channel| has(row, *channel)) {
                let place = self.places[channel];
                let column: State = covariance.column(place).into();
                let variance = column[place] + noise[channel] * noise[channel];
                let gain = column / variance;
                covariance -= gain * column.transpose();
                let inverse = 1.0 / variance.sqrt();
                self.log_deviations -= inverse.ln();
                updates.push((channel, gain, inverse));
            }
            let is_settled =
                row > rows.start + 10 && self.gains.last().is_some_and(|last| is_same(&last.updates, &updates));
            self.gains.push(Gain { updates });
            self.of_row[row] = self.gains.len() as u32 - 1;
            settled = is_settled.then_some((self.of_row[row], seen));
            covariance = transition * covariance * transition.transpose() + driven;
            covariance = 0.5 * (covariance + covariance.transpose());
        }
        self.transitions.push(transition);
        self.stretch_ends.push(rows.end);
    }

    /// Innovations of what each channel has, in units of their standard deviations; zero where nothing was measured.
    pub fn innovations(&self, residual: &[Vec<f64>]) -> Vec<f64> {
        let rows = self.of_row.len();
        let mut innovations = vec![0.0; rows * residual.len()];
        let mut stretch = 0;
        let mut state = State::zeros();
        for row in 0..rows {
            while stretch < self.stretch_ends.len() && row >= self.stretch_ends[stretch] {
                stretch += 1;
                state = State::zeros();
            }
            if stretch == self.stretch_ends.len() {
                break;
            }
            for (channel, gain, inverse) in &self.gains[self.of_row[row] as usize].updates {
                let value = residual[*channel][row];
                if value.is_finite() {
                    let surprise = value - state[self.places[*channel]];
                    innovations[channel * rows + row] = surprise * inverse;
                    state += gain * surprise;
                }
            }
            state = self.transitions[stretch] * state;
        }
        innovations
    }
}

fn is_same(one: &[(usize, State, f64)], other: &[(usize, State, f64)]) -> bool {
    one.len() == other.len()
        && one.iter().zip(other).all(|((channel, gain, inverse), (channel2, gain2, inverse2))| {
            channel == channel2
                && (inverse / inverse2 - 1.0).abs() < CONVERGED
                && (gain - gain2).norm() < CONVERGED * gain.norm()
        })
}

fn rates(motor: &MotorParameters, correlation_s: f64, is_held: bool) -> Covariance {
    let (l, k, j) = (motor.inductance_h, motor.torque_constant_nm_per_a, motor.inertia_kg_m2);
    let mut rates = Covariance::zeros();
    rates[(0, 0)] = -motor.resistance_ohm / l;
    rates[(0, 1)] = -k / l;
    rates[(0, 4)] = 1.0 / l;
    if !is_held {
        rates[(1, 0)] = k / j;
        rates[(1, 1)] = -motor.viscous_friction_nm_s / j;
        rates[(1, 3)] = 1.0 / j;
    }
    rates[(2, 1)] = 1.0;
    rates[(3, 3)] = -1.0 / correlation_s;
    rates[(4, 4)] = -1.0 / correlation_s;
    rates
}

/// Sizes of torque and voltage in a recording.
pub struct Typical {
    /// Torque at standstill and the usual voltage.
    pub torque_nm: f64,
    /// Root mean square of the voltage.
    pub voltage_v: f64,
}

impl Typical {
    /// Of a recording of this motor.
    pub fn of(data: &Dataset, motor: &MotorParameters) -> Self {
        let squares: f64 = data.voltage_v.iter().map(|volts| volts * volts).sum();
        let voltage_v = (squares / data.len().max(1) as f64).sqrt();
        Self { torque_nm: motor.torque_constant_nm_per_a * voltage_v / motor.resistance_ohm, voltage_v }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Recording;
    use crate::rig::Rig;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use std::fmt::Write as _;

    const INTERVAL_S: f64 = 1e-3;
    const NOISE: [f64; 2] = [0.02, 0.3];

    fn recorded(rows: usize) -> Dataset {
        let mut text = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        for row in 0..rows {
            let volts = if row / 20 % 2 == 0 { 12 } else { -3 };
            let _ = writeln!(text, "{:.3},{volts},{},{}", row as f64 * INTERVAL_S, 100 + row % 2, row % 2);
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        Dataset::new(&[recording], &Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap()).unwrap()
    }

    /// What the filter's own assumptions make comes out as independent numbers of unit variance.
    #[test]
    fn innovations_of_an_unknown_torque_are_white() {
        let data = recorded(8000);
        let (set, motor) = (Settings::USUAL, MotorParameters::PIVT6);
        let mut channels = channels(&data);
        channels.iter_mut().zip(NOISE).for_each(|(channel, noise)| channel.noise = noise);
        let unknown = Unknown { torque: 30.0, ..Unknown::USUAL };
        let filter = Whitener::new(&data, &channels, &motor, unknown, &set);
        let typical = Typical::of(&data, &motor);
        let deviations =
            [unknown.torque * set.laws_leave_out * typical.torque_nm, set.laws_leave_out * typical.voltage_v];
        let transition = (rates(&motor, set.correlation_s, false) * INTERVAL_S).exp();
        let driven = (1.0 - (-2.0 * INTERVAL_S / set.correlation_s).exp()).sqrt();
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let mut state = State::zeros();
        let mut residual = vec![Vec::new(); 2];
        for _ in 0..data.len() {
            for (channel, values) in residual.iter_mut().enumerate() {
                values.push(state[filter.places[channel]] + NOISE[channel] * normal());
            }
            state = transition * state;
            state[3] += deviations[0] * driven * normal();
            state[4] += deviations[1] * driven * normal();
        }
        let innovations = filter.innovations(&residual);
        for channel in 0..2 {
            let own = &innovations[channel * data.len() + 500..(channel + 1) * data.len()];
            let mean_product = |lag: usize| {
                let pairs = own.iter().zip(&own[lag..]);
                pairs.map(|(a, b)| a * b).sum::<f64>() / (own.len() - lag) as f64
            };
            assert!((mean_product(0) - 1.0).abs() < 0.1, "channel {channel}: variance {}", mean_product(0));
            for lag in [1, 5, 50] {
                assert!(mean_product(lag).abs() < 0.06, "channel {channel}, lag {lag}: {}", mean_product(lag));
            }
        }
        let mut expected = vec![vec![0.0; data.len()]; 2];
        expected[0][100] = 1.0;
        let one = filter.innovations(&expected);
        let twice: Vec<Vec<f64>> =
            expected.iter().map(|values| values.iter().map(|value| 2.0 * value).collect()).collect();
        let two = filter.innovations(&twice);
        assert!(one.iter().zip(&two).all(|(one, two)| (2.0 * one - two).abs() < 1e-9), "the filter is linear");
    }
}
