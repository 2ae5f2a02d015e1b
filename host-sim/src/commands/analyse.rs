//! `motorbench analyse`: what the linear model of a motor says.

use super::Failure;
use crate::linear::motor_model::{TimeConstants, angle, current, speed};
use crate::linear::state_space::StateSpace;
use crate::linear::step_response::StepFigures;
use crate::motor::MotorParameters;
use crate::rig::Rig;
use clap::Args;
use nalgebra::Complex;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Of a terminal.
const COLUMNS: usize = 80;

/// Prints transfer functions, poles, time constants and gains of a motor.
#[derive(Args)]
#[command(after_help = "Example:
  motorbench analyse --rig rig.toml")]
pub struct Arguments {
    /// Rig or model file with the table [motor].
    #[arg(long, alias = "model", value_name = "FILE")]
    rig: PathBuf,
    /// Prints poles, zeros, gains and time constants as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let (motor, _) = motor_of(&arguments.rig)?;
    if arguments.json {
        println!("{:#}", figures(&motor));
    } else {
        print!("{}", analysis(&motor));
    }
    Ok(())
}

/// The motor of a rig or model file, and the rest of it.
pub fn motor_of(path: &Path) -> Result<(MotorParameters, Rig), Failure> {
    let name = path.display();
    let rig = Rig::read(path).map_err(Failure::input)?;
    let motor = rig.motor.parameters().map_err(|error| Failure::input(format!("{name}: {error}")))?;
    motor.check().map_err(|error| Failure::input(format!("{name}: motor.{error}")))?;
    Ok((motor, rig))
}

/// Numerator over denominator, on two lines where one is too long for a terminal.
fn equation(name: &str, function: &str) -> String {
    let line = format!("{name:14} {function}\n");
    if line.len() <= COLUMNS + 1 { line } else { line.replace(" / ", &format!("\n{:14} / ", "")) }
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
    let (speed, current, angle) = (speed(motor), current(motor), angle(motor));
    let mut text = String::new();
    for (name, function) in [("w(s)/U(s)", speed.to_string()), ("I(s)/U(s)", current.to_string())] {
        text += &equation(name, &function);
    }
    text += &(equation("theta(s)/U(s)", &angle.to_string()) + "\n");
    text += &format!("electromechanical time constant J R / k^2  {:.4} ms\n", 1e3 * constants.electromechanical_s);
    text += &format!("electromagnetic time constant L / R        {:.4} ms\n", 1e3 * constants.electromagnetic_s);
    text += &format!("poles   {} rad/s\n", list(&speed.poles()));
    text += &format!("zero    {} rad/s (current)\n", list(&current.zeros()));
    text += &format!("gains   {:.4} rad/s per V, {:.4} A per V\n", speed.dc_gain(), current.dc_gain());
    if let Some(step) = step(&speed.state_space(), speed.dc_gain(), &speed.poles()) {
        text += &format!(
            "step    rise {:.2} ms, settling {:.2} ms, overshoot {:.1} %\n",
            1e3 * step.rise_s,
            1e3 * step.settling_s,
            step.overshoot_percent
        );
    }
    text
}

/// Figures of the step response, sampled a thousand times in the slowest time constant.
fn step(system: &StateSpace, gain: f64, poles: &[Complex<f64>]) -> Option<StepFigures> {
    let slowest_s = 1.0 / poles.iter().map(|pole| -pole.re).fold(f64::INFINITY, f64::min);
    let period_s = slowest_s / 1000.0;
    StepFigures::of(system.discretise(period_s, 0.0).step_response(8000).as_slice(), period_s, gain)
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
}
