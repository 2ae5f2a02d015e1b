//! `motorbench analyse`: properties of the linear model of a motor.

use super::{Failure, JSON_TO, Outputs, TERMINAL, write, write_json};
use clap::Args;
use motorbench_data::rig::Rig;
use motorbench_design::fixed_point::rounded;
use motorbench_model::linear::frequency_response::{bode, log_spaced};
use motorbench_model::linear::motor_model::{TimeConstants, angle, current, speed};
use motorbench_model::linear::state_space::StateSpace;
use motorbench_model::linear::step_response::StepFigures;
use motorbench_model::linear::transfer_function::TransferFunction;
use motorbench_model::motor::MotorParameters;
use motorbench_text::terminal_text::{COLUMNS, wrapped};
use nalgebra::Complex;
use serde_json::{Value, json};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// Prints transfer functions, poles, time constants and gains of a motor.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench analyse --rig rig.toml --period-ms 1 --delay-ms 0.2
  motorbench analyse --rig model.toml --bode bode.csv --step step.csv")]
pub struct Arguments {
    /// Rig or model file with the table [motor].
    #[arg(long, alias = "model", value_name = "FILE")]
    rig: PathBuf,
    /// Prints poles, zeros, gains and time constants as JSON instead of text, or writes them into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
    /// Also prints the sampled forms for this period, with the voltage held between samples.
    #[arg(long = "period-ms", value_name = "MS", allow_negative_numbers = true)]
    period_ms: Option<f64>,
    /// Delay from a sample to its voltage; needs --period-ms.
    #[arg(
        long = "delay-ms",
        value_name = "MS",
        requires = "period_ms",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    delay_ms: f64,
    /// Writes the frequency responses from voltage to speed, current and angle.
    #[arg(long, value_name = "FILE.csv")]
    bode: Option<PathBuf>,
    /// Writes the responses to a step of one volt.
    #[arg(long, value_name = "FILE.csv")]
    step: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let outputs = Outputs::new([&arguments.rig], arguments.written().iter())?;
    let (motor, _) = motor_of(&arguments.rig)?;
    let sampled = arguments.sampled(&motor)?;
    if let Some(path) = &arguments.json {
        let mut figures = figures(&motor);
        if let Some(sampled) = &sampled {
            let coefficients = |form: &TransferFunction| json!([form.numerator, form.denominator]);
            figures["sampled"] = sampled.iter().map(|(name, form)| (name.to_string(), coefficients(form))).collect();
        }
        write_json(path, &figures)?;
    }
    let forms = sampled.iter().flatten().map(|(name, form)| equation(name, &form.text("z")));
    let gap = if sampled.is_some() { "\n" } else { "" };
    outputs.say(&(analysis(&motor) + gap + &forms.collect::<String>()));
    if let Some(path) = &arguments.bode {
        write(path, &bode_csv(&motor))?;
    }
    if let Some(path) = &arguments.step {
        write(path, &step_csv(&motor))?;
    }
    outputs.wrote("");
    Ok(())
}

/// A transfer function of a motor, with its poles, zeros and gain.
type Named = (&'static str, TransferFunction);

impl Arguments {
    /// Its input and output.
    fn written(&self) -> Vec<PathBuf> {
        [&self.bode, &self.step, &self.json].into_iter().flatten().cloned().collect()
    }

    /// The forms in `z`, if requested.
    fn sampled(&self, motor: &MotorParameters) -> Result<Option<[Named; 3]>, Failure> {
        let Some(period_ms) = self.period_ms else { return Ok(None) };
        if !PERIOD_MS.contains(&period_ms) {
            let (least, most) = (PERIOD_MS.start(), PERIOD_MS.end());
            return Err(Failure::input(format!(
                "--period-ms = {period_ms:?}: expected {least} to {most} milliseconds"
            )));
        }
        let delay_ms = self.delay_ms;
        if !(0.0..=MOST_PERIODS_LATE * period_ms).contains(&delay_ms) {
            return Err(Failure::input(format!("--delay-ms = {delay_ms}: expected 0 to {MOST_PERIODS_LATE} periods")));
        }
        let form = |of: TransferFunction| {
            TransferFunction::sampled(&of.state_space().discretise(1e-3 * period_ms, 1e-3 * delay_ms), 0)
        };
        let [speed, current, angle] = responses(motor).map(form);
        Ok(Some([("w(z)/U(z)", speed), ("I(z)/U(z)", current), ("theta(z)/U(z)", angle)]))
    }
}

/// Sampling periods of loops, with a wide margin. Beyond them the digits of a number do not suffice.
const PERIOD_MS: RangeInclusive<f64> = 1e-3..=1e4;
/// Longest delay for which the form in `z` is useful.
const MOST_PERIODS_LATE: f64 = 10.0;
/// Points of a frequency response, and its range beyond the poles.
const FREQUENCIES: usize = 301;
const BEYOND_POLES: f64 = 100.0;
/// Points of a step response, and its length in the slowest time constant.
const STEP_POINTS: usize = 1001;
const STEP_LENGTH: f64 = 6.0;

/// Speed, current and angle over the voltage.
fn responses(motor: &MotorParameters) -> [TransferFunction; 3] {
    [speed(motor), current(motor), angle(motor)]
}

/// Magnitudes and phases of speed, current and angle over the voltage.
fn bode_csv(motor: &MotorParameters) -> String {
    let responses = responses(motor);
    let magnitudes = responses[0].poles().iter().map(|pole| pole.norm()).collect::<Vec<_>>();
    let slowest = magnitudes.iter().copied().fold(f64::INFINITY, f64::min) / BEYOND_POLES;
    let fastest = magnitudes.iter().copied().fold(0.0, f64::max) * BEYOND_POLES;
    let courses = responses
        .map(|response| bode(|w| response.at(Complex::new(0.0, w)), log_spaced(slowest, fastest, FREQUENCIES)));
    let mut text = String::from(
        "omega_rad_per_s,speed_rad_per_s_per_V,speed_phase_deg,current_A_per_V,current_phase_deg,angle_rad_per_V,angle_phase_deg\n",
    );
    for at in 0..FREQUENCIES {
        text += &format!("{:.6e}", courses[0][at].omega_rad_per_s);
        for course in &courses {
            text += &format!(",{:.6e},{:.4}", course[at].magnitude, course[at].phase_rad.to_degrees());
        }
        text.push('\n');
    }
    text
}

/// Speed, current and angle after a step of one volt.
fn step_csv(motor: &MotorParameters) -> String {
    let responses = responses(motor);
    let period_s = STEP_LENGTH * slowest_s(&responses[0].poles()) / (STEP_POINTS - 1) as f64;
    let courses = responses.map(|response| response.state_space().discretise(period_s, 0.0).step_response(STEP_POINTS));
    let mut text = String::from("t_s,omega_rad_per_s,i_A,theta_rad\n");
    let [speed, current, angle] = &courses;
    for (at, ((speed, current), angle)) in speed.iter().zip(current).zip(angle).enumerate() {
        text += &format!("{:.6e},{speed:.6e},{current:.6e},{angle:.6e}\n", at as f64 * period_s);
    }
    text
}

/// The motor of a rig or model file, and the other content of the file.
pub fn motor_of(path: &Path) -> Result<(MotorParameters, Rig), Failure> {
    let name = path.display();
    let rig = motorbench_files::rig(path).map_err(Failure::input)?;
    let motor = rig.motor.parameters().map_err(|error| Failure::input(format!("{name}: {error}")))?;
    motor.check().map_err(|error| Failure::input(format!("{name}: motor.{error}")))?;
    Ok((motor, rig))
}

/// Numerator over denominator. They get lines of their own if one is too long for a terminal.
fn equation(name: &str, function: &str) -> String {
    let line = format!("{name:14} {function}\n");
    let Some((numerator, denominator)) = function.split_once(" / ").filter(|_| line.len() > COLUMNS + 1) else {
        return line;
    };
    // A sign, its number and its power stay together.
    let glued = |polynomial: &str| {
        let signs = polynomial.replace("+ ", "+_").replace("- ", "-_");
        signs.replace(" s", "_s").replace(" z", "_z")
    };
    let other = format!("{:18}", "");
    let lines = wrapped(&glued(numerator), &format!("{name:14} "), &other)
        + &wrapped(&glued(denominator), &format!("{:14} /_", ""), &other);
    lines.replace('_', " ")
}

/// Poles and zeros as pairs of real and imaginary part.
fn figures(motor: &MotorParameters) -> Value {
    let constants = TimeConstants::of(motor);
    let (speed, current) = (speed(motor), current(motor));
    let pairs = |values: &[Complex<f64>]| values.iter().map(|value| [value.re, value.im]).collect::<Vec<_>>();
    json!({
        "motor": motor,
        "electromechanical_time_constant_s": constants.electromechanical_s,
        "electromagnetic_time_constant_s": constants.electromagnetic_s,
        "poles_rad_per_s": pairs(&speed.poles()),
        "current_zeros_rad_per_s": pairs(&current.zeros()),
        "speed_gain_rad_per_s_per_V": speed.dc_gain(),
        "current_gain_A_per_V": current.dc_gain(),
        "step": step(&speed.state_space(), speed.dc_gain(), &speed.poles()),
    })
}

fn analysis(motor: &MotorParameters) -> String {
    let constants = TimeConstants::of(motor);
    let [speed, current, angle] = responses(motor);
    let mut text = String::new();
    for (name, function) in [("w(s)/U(s)", &speed), ("I(s)/U(s)", &current), ("theta(s)/U(s)", &angle)] {
        text += &equation(name, &function.to_string());
    }
    text.push('\n');
    text += &format!("electromechanical time constant J R / k^2  {:.4} ms\n", 1e3 * constants.electromechanical_s);
    text += &format!("electromagnetic time constant L / R        {:.4} ms\n", 1e3 * constants.electromagnetic_s);
    text += &format!("poles   {} rad/s\n", list(&speed.poles()));
    text += &format!("zero    {} rad/s (current)\n", list(&current.zeros()));
    text += &format!("gains   {} rad/s per V, {} A per V\n", rounded(speed.dc_gain()), rounded(current.dc_gain()));
    if let Some(step) = step(&speed.state_space(), speed.dc_gain(), &speed.poles()) {
        text += &format!(
            "step    rise {:.2} ms, settling {:.2} ms, overshoot {:.1} %\n",
            1e3 * step.rise_s,
            1e3 * step.settling_s,
            step.overshoot_percent
        );
    } else {
        text += "step    cannot be simulated until it settles: the poles are too far apart\n";
    }
    text
}

/// Figures of the step response, sampled a thousand times in the slowest time constant.
fn step(system: &StateSpace, gain: f64, poles: &[Complex<f64>]) -> Option<StepFigures> {
    let period_s = slowest_s(poles) / 1000.0;
    StepFigures::of(system.discretise(period_s, 0.0).step_response(8000).as_slice(), period_s, gain)
}

/// The slowest time constant.
fn slowest_s(poles: &[Complex<f64>]) -> f64 {
    1.0 / poles.iter().map(|pole| -pole.re).fold(f64::INFINITY, f64::min)
}

fn list(values: &[Complex<f64>]) -> String {
    let print = |value: &Complex<f64>| match value.im {
        0.0 => format!("{:.3}", value.re),
        imaginary => format!("{:.3}{imaginary:+.3}i", value.re),
    };
    values.iter().map(print).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_motor() {
        let text = analysis(&MotorParameters::PIVT6);
        for expected in ["25.0000 ms", "2.0000 ms", "-44.094, -456.131", "rise 50.", "settling 91.0", "s^2"] {
            assert!(text.contains(expected), "{expected}\n{text}");
        }
        let figures = figures(&MotorParameters::PIVT6);
        let slow = figures["poles_rad_per_s"][0][0].as_f64().unwrap();
        let fast = figures["poles_rad_per_s"][1][0].as_f64().unwrap();
        assert!((slow.max(fast) + 44.094).abs() < 1e-3 && (slow.min(fast) + 456.131).abs() < 1e-3, "{figures}");
        assert!((figures["electromechanical_time_constant_s"].as_f64().unwrap() - 0.025).abs() < 1e-6);
    }

    /// Files for other programs: headers with units, and the values of the transfer functions.
    #[test]
    fn responses_as_files() {
        let motor = MotorParameters::PIVT6;
        let rows = |text: &str| {
            let numbers = |line: &str| line.split(',').map(|word| word.parse().unwrap()).collect::<Vec<f64>>();
            text.lines().skip(1).map(numbers).collect::<Vec<_>>()
        };
        let bode = rows(&bode_csv(&motor));
        assert_eq!((bode.len(), bode[0].len()), (FREQUENCIES, 7));
        // Far below both poles the gain of the speed is constant. Far above it falls by 40 dB a decade, and its phase
        // ends at -180 degrees.
        assert!((bode[0][1] / speed(&motor).dc_gain() - 1.0).abs() < 1e-3 && bode[0][2].abs() < 1.0, "{:?}", bode[0]);
        let last = bode.last().unwrap();
        assert!((last[2] + 180.0).abs() < 1.0 && (last[4] + 90.0).abs() < 1.0 && (last[6] + 270.0).abs() < 1.0);
        let step = rows(&step_csv(&motor));
        assert_eq!((step.len(), step[0].len()), (STEP_POINTS, 4));
        let end = step.last().unwrap();
        assert!((end[1] / speed(&motor).dc_gain() - 1.0).abs() < 5e-3, "{end:?}");
        // The angle is the area under the speed.
        let area: f64 = step.windows(2).map(|pair| 0.5 * (pair[0][1] + pair[1][1]) * (pair[1][0] - pair[0][0])).sum();
        assert!((area / end[3] - 1.0).abs() < 1e-4, "{area} {end:?}");
    }

    /// With fast sampling the printed digits still give the gain. No line is wider than a terminal.
    #[test]
    fn printed_forms_have_the_gain_of_the_motor() {
        let motor = MotorParameters::PIVT6;
        for (period_ms, delay_ms) in [(1e-3, 0.0), (0.1, 0.02), (1.0, 9.7)] {
            let [speed_z, current_z, angle_z] = asked(period_ms, delay_ms).sampled(&motor).unwrap().unwrap();
            for (name, form) in [&speed_z, &current_z, &angle_z] {
                let text = equation(name, &form.text("z"));
                assert!(text.lines().all(|line| line.len() <= COLUMNS) && !text.contains("+ -"), "{text}");
            }
            let text = equation(speed_z.0, &speed_z.1.text("z"));
            let (above, below) = text[14..].split_once('/').unwrap();
            let ratio = at_one(above) / at_one(below);
            assert!((ratio / speed(&motor).dc_gain() - 1.0).abs() < 2e-3, "{ratio} {text}");
        }
    }

    /// Sum of the coefficients of a printed polynomial.
    fn at_one(polynomial: &str) -> f64 {
        let bare = polynomial.replace(['(', ')', '\n'], " ").replace("+ ", "+").replace("- ", "-");
        let numbers = bare.split_whitespace().filter_map(|word| match word.trim_start_matches(['+', '-']) {
            power if power.starts_with('z') => None,
            _ => word.parse::<f64>().ok(),
        });
        numbers.sum()
    }

    fn asked(period_ms: f64, delay_ms: f64) -> Arguments {
        Arguments { rig: PathBuf::new(), json: None, period_ms: Some(period_ms), delay_ms, bode: None, step: None }
    }

    #[test]
    fn sampled_forms_and_their_refusals() {
        let motor = MotorParameters::PIVT6;
        let forms = asked(1.0, 0.2).sampled(&motor).unwrap().unwrap();
        let at_one = forms[0].1.at(Complex::new(1.0, 0.0)).re;
        assert!((at_one / speed(&motor).dc_gain() - 1.0).abs() < 1e-9, "{at_one}");
        for (arguments, expected) in [
            (asked(0.0, 0.0), "--period-ms = 0.0: expected 0.001 to 10000 milliseconds"),
            (asked(f64::NAN, 0.0), "--period-ms = NaN"),
            (asked(1e-9, 0.0), "--period-ms = 1e-9: expected"),
            (asked(1.0, -0.1), "--delay-ms = -0.1: expected 0 to 10 periods"),
            (asked(1.0, 20.0), "--delay-ms = 20"),
        ] {
            let message = arguments.sampled(&motor).unwrap_err().message;
            assert!(message.starts_with(expected), "{message}");
        }
    }
}
