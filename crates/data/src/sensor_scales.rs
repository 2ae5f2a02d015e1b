//! Whether what a board measures fits its motor, while the scales of its sensors are still those of a new board.
//!
//! Voltage, current and speed of a driven motor obey U = R i + k w + a drop. Least squares over all samples give R and k
//! in the scales of the sensors. Where these are far from the motor's, encoder and current sensor are likely not those
//! of a new board.

use crate::names::setting_name;
use crate::rig::NominalMotor;
use crate::telemetry::speed_bit_rad_per_s;
use motorbench_core::HARDWARE;
use motorbench_core::message::{Sample, State};
use motorbench_core::settings::{Param, Settings};
use motorbench_core::units::{AMPERE, VOLT};
use motorbench_text::terminal_text::short;
use nalgebra::{Matrix3, Vector3};

/// The scales of the sensors, which only the person at the rig knows.
const SCALES: [Param; 2] = [Param::CountsPerRev, Param::CurrentGain];
/// A constant that is off by more means another sensor: the scales of a common family differ by 1.85. Another temperature
/// changes less: a hot winding has 1.4 times the resistance.
const MOST_OFF: f64 = 1.6;
/// Less of the full voltage drives hardly any current.
const LEAST_DUTY: f64 = 0.1;
/// Fewer samples are not judged.
const ENOUGH_S: f64 = 1.0;
/// Samples of this time count as one: a motor does not move independently from tick to tick.
const ALIKE_S: f64 = 0.02;
/// A constant is known if its standard error is a smaller share of it.
const KNOWN: f64 = 0.1;

/// Sums over the samples so far.
#[derive(Clone, Debug)]
pub struct SensorScales {
    settings: Settings,
    /// Resistance and back-EMF constant of the motor, as far as they are known.
    of_motor: [Option<f64>; 2],
    duty: i16,
    count: f64,
    products: Matrix3<f64>,
    with_voltage: Vector3<f64>,
    voltage_squared: f64,
}

impl SensorScales {
    /// Nothing yet. What `nominal` does not say of the motor, the board's settings say.
    pub fn new(settings: &Settings, nominal: &NominalMotor) -> Self {
        let set = |param: Param| Some(f64::from(settings.get(param))).filter(|value| *value > 0.0);
        Self {
            settings: *settings,
            of_motor: [
                nominal.resistance_ohm.or_else(|| set(Param::Resistance)),
                nominal.torque_constant_nm_per_a.or_else(|| set(Param::TorqueConstant)),
            ],
            duty: 0,
            count: 0.0,
            products: Matrix3::zeros(),
            with_voltage: Vector3::zeros(),
            voltage_squared: 0.0,
        }
    }

    /// Adds what has come.
    pub fn add(&mut self, samples: &[Sample]) {
        for sample in samples {
            // A duty acts from its sample on; speed and current are means over the tick before.
            let duty = f64::from(std::mem::replace(&mut self.duty, sample.duty)) / f64::from(HARDWARE.pwm_steps);
            if !sample.state.has(State::ENABLED) || duty.abs() < LEAST_DUTY {
                continue;
            }
            let voltage = duty * f64::from(sample.supply) / f64::from(VOLT);
            let row = Vector3::new(
                f64::from(sample.current) / f64::from(AMPERE),
                f64::from(sample.speed) * speed_bit_rad_per_s(&self.settings),
                duty.signum(),
            );
            self.count += 1.0;
            self.products += row * row.transpose();
            self.with_voltage += voltage * row;
            self.voltage_squared += voltage * voltage;
        }
    }

    /// Resistance and back-EMF constant in the scales of the sensors, where the samples show them.
    fn found(&self) -> Option<[Option<f64>; 2]> {
        let rate_hz = f64::from(self.settings.get(Param::TickRate));
        if self.count < ENOUGH_S * rate_hz {
            return None;
        }
        let inverse = self.products.try_inverse()?;
        let constants = inverse * self.with_voltage;
        let rest = (self.voltage_squared - constants.dot(&self.with_voltage)).max(0.0) / self.count;
        let alike = (ALIKE_S * rate_hz).max(1.0);
        let known = |at: usize| {
            let error = (rest * inverse[(at, at)] * alike).sqrt();
            Some(constants[at]).filter(|value| *value > 0.0 && error < KNOWN * value)
        };
        Some([known(0), known(1)])
    }

    /// What is wrong, and what to do, if both scales are still those of a new board and the samples contradict them.
    pub fn contradiction(&self) -> Option<String> {
        let new_board = Settings::defaults();
        if SCALES.iter().any(|scale| self.settings.get(*scale) != new_board.get(*scale)) {
            return None;
        }
        let is_off = |found: f64, of_motor: f64| !(1.0 / MOST_OFF..MOST_OFF).contains(&(found / of_motor));
        let [resistance, back_emf] = self.found()?;
        let [of_current, of_speed] = self.of_motor;
        let says = |(found, of_motor): (f64, f64), of_what: &str, unit: &str| {
            is_off(found, of_motor)
                .then(|| format!("{of_what} of {} {unit}, where the motor has {}", short(found), short(of_motor)))
        };
        let said =
            resistance.zip(of_current).and_then(|pair| says(pair, "voltage and current give a resistance", "ohm"));
        let said = said.or_else(|| {
            back_emf.zip(of_speed).and_then(|pair| says(pair, "voltage and speed give a back-EMF constant", "V s/rad"))
        })?;
        let [counts, gain] = SCALES.map(setting_name);
        let [of_counts, of_gain] = SCALES.map(|scale| self.settings.get(scale));
        let motor =
            if resistance.is_some() { setting_name(Param::Resistance) } else { setting_name(Param::TorqueConstant) };
        Some(format!(
            "{counts} ({of_counts}) and {gain} ({of_gain} mV/A) are still those of a new board, and the samples contradict them: {said}. `motorbench connect 'set {counts} N' 'set {gain} MV_PER_A' save` sets those of your encoder and current sensor. If they are right, set {motor} to that of your motor"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A motor under levels of both signs as a board samples it, with the scales of a new board. `counts` and `gain` are
    /// those of the sensors that are really there.
    fn board(resistance_ohm: f64, counts: f64, gain: f64) -> SensorScales {
        const K: f64 = 0.072;
        const INERTIA_KG_M2: f64 = 2.2e-5;
        let settings = Settings::defaults();
        let of_board = |param| f64::from(settings.get(param));
        let mut scales = SensorScales::new(
            &settings,
            &NominalMotor { torque_constant_nm_per_a: Some(K), ..NominalMotor::default() },
        );
        let (mut speed, mut duty) = (0.0, 0);
        for tick in 0..3000_u32 {
            let level = [300, -250, 650, -600][tick as usize / 150 % 4];
            let voltage = 12.0 * f64::from(std::mem::replace(&mut duty, level)) / f64::from(HARDWARE.pwm_steps);
            let current = (voltage - voltage.signum() - K * speed) / resistance_ohm;
            let before = speed;
            speed += 1e-3 * (K * current - 0.004 * f64::signum(speed)) / INERTIA_KG_M2;
            let read_speed = before * counts / of_board(Param::CountsPerRev) / speed_bit_rad_per_s(&settings);
            let read_current = current * gain / of_board(Param::CurrentGain) * f64::from(AMPERE);
            scales.add(&[Sample {
                tick,
                speed: read_speed as i16,
                current: read_current as i16,
                duty,
                supply: (12.0 * f64::from(VOLT)) as i16,
                state: State(State::ENABLED),
                ..Sample::default()
            }]);
        }
        scales
    }

    #[test]
    fn scales_of_a_new_board_that_the_samples_contradict_are_told() {
        assert_eq!(board(5.84, 2000.0, 185.0).contradiction(), None);
        // A warm winding is no other sensor.
        assert_eq!(board(7.5, 2000.0, 185.0).contradiction(), None);
        let of_current = board(5.84, 2000.0, 66.0).contradiction().unwrap();
        assert!(of_current.contains("a resistance of 16.4 ohm, where the motor has 5.84"), "{of_current}");
        assert!(of_current.contains("'set counts_per_rev N' 'set current_gain MV_PER_A' save"), "{of_current}");
        let of_speed = board(5.84, 500.0, 185.0).contradiction().unwrap();
        assert!(of_speed.contains("a back-EMF constant of 0.288 V s/rad, where the motor has 0.0720"), "{of_speed}");
    }

    #[test]
    fn scales_that_somebody_set_are_theirs() {
        let mut own = board(5.84, 500.0, 66.0);
        own.settings.set(Param::CountsPerRev, 1000.0).unwrap();
        assert_eq!(own.contradiction(), None);
    }
}
