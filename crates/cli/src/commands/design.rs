//! `motorbench design`: gains for a specification or for weights.

use super::analyse::motor_of;
use super::{
    Failure, JSON_TO, Outputs, TERMINAL, open_next, provenance, read_model, read_rig, spinner, write, write_json,
};
use clap::{ArgGroup, Args};
use host_sim::scenario::refusal;
use motorbench_core::settings::Settings;
use motorbench_data::rig::Rig;
use motorbench_design::compensation::{CompensationSetting, Standstill, compensation, model_of, near_standstill};
use motorbench_design::fixed_point::SettingList;
use motorbench_design::law::ControlLaw;
use motorbench_design::own_loop::Asked;
use motorbench_design::specification::{Specification, Speed};
use motorbench_design::weights::{BadWeight, Weights};
use motorbench_design::{Bench, Design, DesignError, TrialWithEffects, design, fastest_possible, trial_with_effects};
use motorbench_model::Model;
use motorbench_model::catalogue::DryLosses;
use motorbench_model::motor::MotorParameters;
use motorbench_report::design as report;
use motorbench_text::terminal_text::{quoted, wrapped};
use std::path::PathBuf;

mod sketch;

/// Designs PID and LQR for a motor, by a specification or by weights.
#[derive(Args)]
#[command(group(ArgGroup::new("quantity").required(true)), group(ArgGroup::new("how_fast").required(true)))]
#[command(group(ArgGroup::new("motor").required(true).multiple(true)))]
#[command(group(ArgGroup::new("largest_voltage")))]
#[command(override_usage = "motorbench design --speed|--position
       --bandwidth-Hz HZ|--settling-s S
       |--q Q --r R|--largest X --largest-V V
       --rig RIG.toml [--model MODEL.toml] [OPTIONS]")]
#[command(after_help = "Examples:
  motorbench design --rig rig.toml --speed --bandwidth-Hz 10
  motorbench design --rig rig.toml --model model.toml --position --pid \\
    --settling-s 0.3 --report design.html
  motorbench design --rig rig.toml --speed --bandwidth-Hz 10 --compensate \\
    --coulomb-Nm 0.01
  motorbench design --rig rig.toml --speed --lqr --largest 10,1,0.2 \\
    --largest-V 3
  motorbench design --rig rig.toml --position --lqr --q 100,0.2,0,1000 --r 1
  motorbench design --rig rig.toml --model model.toml --speed \\
    --bandwidth-Hz 2 --sketch-ms 20")]
pub struct Arguments {
    /// Rig file: supply, encoder or tachogenerator, and the motor unless --model gives it.
    #[arg(long, group = "motor", value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    /// Model file with the table [motor]. Without a rig file, supply and encoder are taken from it as well.
    #[arg(long, group = "motor", value_name = "MODEL.toml")]
    model: Option<PathBuf>,
    /// Control the speed.
    #[arg(long, group = "quantity")]
    speed: bool,
    /// Control the position.
    #[arg(long, group = "quantity")]
    position: bool,
    /// Only the PID.
    #[arg(long, conflicts_with = "lqr")]
    pid: bool,
    /// Only the LQR.
    #[arg(long)]
    lqr: bool,
    /// Smallest bandwidth from reference to output.
    #[arg(long = "bandwidth-Hz", group = "how_fast", value_name = "HZ", allow_negative_numbers = true)]
    bandwidth_hz: Option<f64>,
    /// Longest time to settle within 2 % after a step.
    #[arg(long = "settling-s", group = "how_fast", value_name = "S", allow_negative_numbers = true)]
    settling_s: Option<f64>,
    /// LQ weights (diagonal of Q). Order for a speed loop: speed, current, integral; for a position loop: angle, speed,
    /// current, integral. Units: 1/(rad/s)^2, 1/A^2 and so on. Use them instead of a bandwidth. The PID's gains
    /// minimise the same cost.
    #[arg(
        long,
        group = "how_fast",
        requires = "r",
        value_name = "Q1,Q2,...",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    q: Vec<f64>,
    /// LQ weight of the voltage (R), in 1/V^2; with --q.
    #[arg(long, requires = "q", value_name = "R", allow_negative_numbers = true)]
    r: Option<f64>,
    /// Weights by Bryson's rule: the largest acceptable deviation of each state, in the order of --q. Units of a speed
    /// loop: rad/s, A, rad; of a position loop: rad, rad/s, A, rad s. inf gives a state no weight.
    #[arg(
        long,
        group = "how_fast",
        requires = "largest_voltage",
        value_name = "X1,X2,...",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    largest: Vec<f64>,
    /// Largest acceptable voltage for these deviations; with --largest.
    #[arg(
        long = "largest-V",
        group = "largest_voltage",
        requires = "largest",
        value_name = "V",
        allow_negative_numbers = true
    )]
    largest_v: Option<f64>,
    /// The same as a share of the supply.
    #[arg(long, group = "largest_voltage", requires = "largest", value_name = "DUTY", allow_negative_numbers = true)]
    largest_duty: Option<f64>,
    /// Largest overshoot after a step.
    #[arg(long = "overshoot-percent", default_value_t = 10.0, value_name = "PERCENT", allow_negative_numbers = true)]
    overshoot_percent: f64,
    /// Current limit.
    #[arg(long = "current-limit-A", default_value_t = 1.0, value_name = "A", allow_negative_numbers = true)]
    current_limit_a: f64,
    /// The rig has no current sensor, as with current_sensor.present = false in its file: the LQR uses the firmware's observer.
    /// The result compares it with a sensor.
    #[arg(long)]
    no_current_sensor: bool,
    /// Compensates voltage drop and friction of the model's effects. Without a model it uses bridge.drop_V of the rig
    /// file and --coulomb-Nm.
    #[arg(long)]
    compensate: bool,
    /// Coulomb friction to compensate, the same in both directions.
    #[arg(
        long = "coulomb-Nm",
        default_value_t = 0.0,
        value_name = "NM",
        requires = "compensate",
        conflicts_with = "model",
        allow_negative_numbers = true,
        value_parser = friction
    )]
    coulomb_nm: f64,
    /// Gains for a sketch of your own instead of the firmware: the Arduino PID library, QuickPID, or plain code. Its sample
    /// time in milliseconds, 10 to 100. Speed in rpm or position in degrees, output -255 to 255.
    #[arg(long = "sketch-ms", value_name = "MS", requires = "bandwidth_hz", conflicts_with_all = ["console", "report"])]
    sketch_ms: Option<f64>,
    /// Prints the designs as JSON instead of text, or writes them into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
    /// Writes console lines for `motorbench send`.
    #[arg(long, value_name = "FILE.txt")]
    console: Option<PathBuf>,
    /// Writes a page with step responses, margins and roots.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
}

fn friction(text: &str) -> Result<f64, String> {
    let is_one = |torque: &f64| torque.is_finite() && *torque >= 0.0;
    text.parse()
        .ok()
        .filter(is_one)
        .ok_or("expected 0 or more, the magnitude of the friction in both directions".into())
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let files = [&arguments.json, &arguments.console, &arguments.report].into_iter().flatten();
    let outputs = Outputs::new(arguments.rig.iter().chain(&arguments.model), files)?;
    let (motor, bench, rig, model) = arguments.problem()?;
    if let Some((sample_ms, bandwidth_hz)) = arguments.sketch_ms.zip(arguments.bandwidth_hz) {
        let losses = arguments.losses(&rig);
        let model = model.unwrap_or_else(|| model_of(&losses, &motor));
        let overshoot_percent = arguments.overshoot_percent;
        let asked = Asked { bandwidth_hz, overshoot_percent, sample_s: 1e-3 * sample_ms };
        return for_a_sketch(arguments, &outputs, &model, &bench, &asked);
    }
    let compensation = arguments.compensation(&motor, &rig, model.as_ref())?;
    let extended = model.filter(|model| !model.terms.is_empty());
    let Offered { designs, refused, trials } = offers(arguments, &motor, &bench, &compensation, extended.as_ref())?;
    let mut settings = SettingList::default();
    designs.iter().for_each(|design| settings.merge(&design.settings));
    let settings = compensation.added_to(&settings).map_err(Failure::input)?;
    let standstill = compensation.near_standstill(&designs, &settings.all)?;
    let commands = settings.commands();
    outputs.say(&page(&designs, &refused, &trials, &standstill, &commands));
    if arguments.compensate && compensation.model.is_none() {
        outputs.say(&format!("\n{}", wrapped(NOTHING_TO_COMPENSATE, "", "  ")));
    }
    if let Some(path) = &arguments.json {
        let result = serde_json::json!({
            "motor": motor, "designs": designs, "refused": refused, "with_effects": trials.iter().map(written).collect::<Vec<_>>(),
            "near_standstill": standstill, "commands": commands
        });
        write_json(path, &result)?;
    }
    if let Some(path) = &arguments.console {
        write(path, &(commands.join("\n") + "\n"))?;
    }
    if let Some(path) = &arguments.report {
        let from = provenance::with(provenance::of_files([]), "Rig file", arguments.rig.as_deref());
        let from = provenance::with(from, "Model", arguments.model.as_deref());
        write(path, &report::html(&motor, &designs, &trials, &standstill, &commands, from))?;
    }
    let next =
        arguments.console.as_ref().map(|lines| format!("motorbench send {}", quoted(&lines.display().to_string())));
    outputs.wrote(&next.unwrap_or_else(|| open_next(arguments.report.as_deref())));
    Ok(())
}

/// Gains for a sketch in place of the firmware.
fn for_a_sketch(
    arguments: &Arguments,
    outputs: &Outputs,
    model: &Model,
    bench: &Bench,
    asked: &Asked,
) -> Result<(), Failure> {
    let found = sketch::Found::new(model, bench, asked, arguments.position).map_err(Failure::input)?;
    if let Some(path) = &arguments.json {
        write_json(path, &found.json())?;
    }
    outputs.say(&found.page(asked));
    outputs.wrote("");
    Ok(())
}

/// The designs for the laws that were asked for, at least one.
struct Offered {
    designs: Vec<Design>,
    refused: Vec<Refused>,
    trials: Vec<TrialWithEffects>,
}

/// Designs each law, and tries it on the motor with its effects. If all are refused, the error says what can be met.
fn offers(
    arguments: &Arguments,
    motor: &MotorParameters,
    bench: &Bench,
    compensation: &Compensation,
    extended: Option<&Model>,
) -> Result<Offered, Failure> {
    let specification = arguments.specification(bench)?;
    let busy = spinner();
    let mut offered = Offered { designs: Vec::new(), refused: Vec::new(), trials: Vec::new() };
    for law in arguments.laws() {
        busy.set_message(format!("{}: weights, margins, 30 % off in everything, on the core", law.title()));
        let tried = design(motor, bench, law, &specification).and_then(|design| {
            let settings = compensation.added_to(&design.settings)?;
            let trial = extended.map(|model| trial_with_effects(model, &design, &settings.all)).transpose()?;
            Ok((design, trial))
        });
        match tried {
            Ok((design, trial)) => {
                offered.designs.push(design);
                offered.trials.extend(trial);
            }
            Err(error) => offered.refused.push(Refused { law, why: error.to_string() }),
        }
    }
    if offered.designs.is_empty() {
        busy.set_message("what can be met");
        let mut whys: Vec<String> = offered.refused.into_iter().map(|refused| refused.why).collect();
        whys.dedup();
        whys.extend(arguments.laws().into_iter().filter_map(|law| met(law, motor, bench, &specification)));
        busy.finish_and_clear();
        return Err(Failure::input(whys.join("\n")));
    }
    busy.finish_and_clear();
    Ok(offered)
}

/// What a law can meet instead of a specification.
fn met(law: ControlLaw, motor: &MotorParameters, bench: &Bench, refused: &Specification) -> Option<String> {
    let option = match fastest_possible(motor, bench, law, refused)?.speed {
        Speed::BandwidthHz(hz) => format!("--bandwidth-Hz {hz}"),
        Speed::SettlingS(settling_s) => format!("--settling-s {settling_s}"),
        Speed::Weights(_) => return None,
    };
    Some(format!("The {} can meet {option}", law.title()))
}

const NOTHING_TO_COMPENSATE: &str = "nothing to compensate: the model has no [effects.coulomb_friction] and no [effects.voltage_drop]. Without a model give bridge.drop_V in the rig file, or --coulomb-Nm";

/// The compensation of the core.
struct Compensation {
    settings: Vec<CompensationSetting>,
    /// The plant for a trial of the compensation: the whole model, or a motor with these losses alone.
    model: Option<Model>,
}

impl Compensation {
    fn added_to(&self, settings: &SettingList) -> Result<SettingList, DesignError> {
        let mut settings = settings.clone();
        for setting in &self.settings {
            settings.set(setting.param, setting.value)?;
        }
        Ok(settings)
    }

    /// Improvement by the compensation for each design.
    fn near_standstill(&self, designs: &[Design], settings: &Settings) -> Result<Vec<Standstill>, Failure> {
        let Some(model) = &self.model else { return Ok(Vec::new()) };
        let found =
            designs.iter().map(|design| near_standstill(model, settings, design.law, design.tachogenerator.as_ref()));
        found.collect::<Result<_, _>>().map_err(|error| Failure::input(refusal(settings, error)))
    }
}

impl Arguments {
    fn compensation(&self, motor: &MotorParameters, rig: &Rig, model: Option<&Model>) -> Result<Compensation, Failure> {
        if !self.compensate {
            return Ok(Compensation { settings: Vec::new(), model: None });
        }
        let losses = model.map_or_else(|| self.losses(rig), Model::dry_losses);
        let settings = compensation(&losses, motor.resistance_ohm, motor.torque_constant_nm_per_a);
        // The settings are always sent: the board may have others from another motor.
        let model =
            (losses != DryLosses::default()).then(|| model.cloned().unwrap_or_else(|| model_of(&losses, motor)));
        Ok(Compensation { settings: settings.map_err(Failure::input)?, model })
    }

    fn laws(&self) -> Vec<ControlLaw> {
        let (pid, lqr) = if self.position {
            (ControlLaw::PositionPid, ControlLaw::PositionLqr)
        } else {
            (ControlLaw::SpeedPid, ControlLaw::SpeedLqr)
        };
        [(pid, !self.lqr), (lqr, !self.pid)].into_iter().filter(|(_, wanted)| *wanted).map(|(law, _)| law).collect()
    }

    /// Losses from rig file and command line.
    fn losses(&self, rig: &Rig) -> DryLosses {
        DryLosses {
            friction_forward_nm: self.coulomb_nm,
            friction_reverse_nm: self.coulomb_nm,
            bridge_drop_v: rig.bridge.drop_v.unwrap_or(0.0),
        }
    }

    fn specification(&self, bench: &Bench) -> Result<Specification, Failure> {
        let speed = match (self.bandwidth_hz, self.settling_s) {
            (Some(hz), _) => Speed::BandwidthHz(hz),
            (None, Some(settling_s)) => Speed::SettlingS(settling_s),
            (None, None) => Speed::Weights(self.weights(bench).map_err(Failure::input)?),
        };
        Ok(Specification { speed, overshoot_percent: self.overshoot_percent, current_limit_a: self.current_limit_a })
    }

    fn weights(&self, bench: &Bench) -> Result<Weights, BadWeight> {
        if let Some(r) = self.r {
            return Weights::new(self.position, &self.q, r);
        }
        let largest_v = match self.largest_duty {
            Some(duty) if duty > 0.0 && duty <= 1.0 => duty * bench.supply_v,
            Some(value) => {
                let rule = "above 0 and at most 1, the whole supply";
                return Err(BadWeight::LargestVoltage { option: "--largest-duty", value, rule });
            }
            None => self.largest_v.unwrap_or(f64::NAN),
        };
        Weights::bryson(self.position, &self.largest, largest_v)
    }

    /// The motor comes from the model or the rig, the rig around it from the rig file or the model. The model is
    /// returned if one is given.
    fn problem(&self) -> Result<(MotorParameters, Bench, Rig, Option<Model>), Failure> {
        let (motor_file, surroundings) = match (&self.model, &self.rig) {
            (Some(model), Some(rig)) => (model, rig),
            (Some(one), None) | (None, Some(one)) => (one, one),
            (None, None) => return Err(Failure::input("give --rig or --model")),
        };
        let (motor, _) = motor_of(motor_file)?;
        let rig = read_rig(surroundings)?;
        let model = self.model.as_deref().map(read_model).transpose()?;
        let refused = |why| Failure::input(format!("{}: {why}", surroundings.display()));
        let bench = Bench::of_rig(&rig, model.as_ref()).map_err(refused)?;
        let bench = Bench { current_measured: !self.no_current_sensor && bench.current_measured, ..bench };
        Ok((motor, bench, rig, model))
    }
}

/// A law that is refused while another one is offered.
#[derive(serde::Serialize)]
struct Refused {
    law: ControlLaw,
    why: String,
}

fn written((law, figures, _): &TrialWithEffects) -> serde_json::Value {
    serde_json::json!({ "law": law, "trial": figures })
}

/// The text of half a page.
fn page(
    designs: &[Design],
    refused: &[Refused],
    trials: &[TrialWithEffects],
    standstill: &[Standstill],
    commands: &[String],
) -> String {
    let mut text: String = designs.iter().map(report::summary).collect();
    text.extend(refused.iter().map(|Refused { why, .. }| wrapped(&format!("not offered: {why}"), "", "  ")));
    text += &report::beyond_linear(trials, standstill);
    text += "\npaste into the console, then `save`:\n";
    for command in commands {
        text += &format!("  {command}\n");
    }
    text
}

#[cfg(test)]
mod tests;
