//! The classic thesis on a DC motor as one experiment. It identifies the motor on the board, designs PID and LQR from
//! the model found, runs both in the firmware, and compares simulation and measurement.

use host_sim::figures::{Figures, step_figures};
use host_sim::scenario::reference::{Course, Reference};
use host_sim::scenario::{Noise, Scenario, ScenarioError};
use host_sim::trial::Point;
use motorbench_core::message::{Sample, State, Trip};
use motorbench_core::settings::{Param, Settings};
use motorbench_data::recording::{Channel, Recording};
use motorbench_data::rig::NominalMotor;
use motorbench_data::telemetry::{self, IDENTIFICATION_SETTINGS};
use motorbench_design::compensation::{OutOfRange, compensation};
use motorbench_design::fixed_point::SettingList;
use motorbench_design::law::ControlLaw;
use motorbench_design::specification::Specification;
use motorbench_design::{Bench, Design, DesignError, design};
use motorbench_diagnosis::dataset::DatasetError;
use motorbench_diagnosis::diagnose::{Diagnosis, diagnose};
use motorbench_link::board::{Board, BoardError, samples_of, untripped, watch_host};
use motorbench_report::panels::{Panel, panels};
use std::fmt::Write as _;

/// The `identify` sequence: amplitude in volts, a hold in milliseconds, and its number of holds.
const AMPLITUDE_V: f64 = 10.0;
const HOLD_MS: u16 = 500;
const HOLDS: f64 = 40.0;
/// Time on a reference before the next.
const STRETCH_S: f64 = 0.8;
/// Time before the first reference in the simulation.
const BEFORE_S: f64 = 0.05;
/// References relative to the no-load speed: forward, back and slowly.
const REFERENCES: [f64; 3] = [0.4, -0.4, 0.1];

/// Why the experiment ended early.
#[derive(Debug, thiserror::Error)]
pub enum ThesisError {
    /// On the board.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The recording cannot be used.
    #[error(transparent)]
    Recording(#[from] DatasetError),
    /// No design for the model that was found.
    #[error(transparent)]
    Design(#[from] DesignError),
    /// The losses found exceed the core's compensation.
    #[error(transparent)]
    Compensation(#[from] OutOfRange),
    /// The simulation of the loop.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
}

/// Agreement of a simulated quantity with the measured one.
#[derive(Clone, Copy, Debug)]
pub struct Agreement {
    /// Root mean square of the difference, in rad/s or A.
    pub rms: f64,
    /// 100 (1 - |measured - simulated| / |measured - its mean|).
    pub fit_percent: f64,
}

/// One law: simulated with the model found, and measured on the board.
pub struct Loop {
    /// The law, with its gains.
    pub design: Design,
    /// What the firmware did, from the first reference on.
    pub measured: Recording,
    /// The core with the model.
    pub simulated: Recording,
    /// Of the speed.
    pub speed: Agreement,
    /// Of the current.
    pub current: Agreement,
    /// Of each reference: measured, simulated.
    pub figures: Vec<[Figures; 2]>,
}

/// The result of the experiment.
pub struct Thesis {
    /// The motor's constants, and what the linear motor lacks.
    pub diagnosis: Diagnosis,
    /// PID, LQR.
    pub loops: Vec<Loop>,
}

/// Runs the experiment. `nominal`: values of the data sheet; `progress` is called with each step.
///
/// # Errors
/// [`ThesisError`].
pub fn thesis(
    board: &mut impl Board,
    nominal: NominalMotor,
    specification: &Specification,
    progress: &dyn Fn(&str),
) -> Result<Thesis, ThesisError> {
    progress("identify sequence on the board");
    let (recording, settings) = identify(board)?;
    progress("diagnosis");
    let diagnosis = diagnose(&[recording], &telemetry::rig(&settings, nominal), &|_| ())?;
    let mut loops = Vec::new();
    for law in [ControlLaw::SpeedPid, ControlLaw::SpeedLqr] {
        progress(law.title());
        loops.push(closed_loop(board, &diagnosis, law, specification)?);
    }
    Ok(Thesis { diagnosis, loops })
}

/// Plays the sequence; returns the recording and its settings.
fn identify(board: &mut impl Board) -> Result<(Recording, Settings), ThesisError> {
    let mut list = SettingList::default();
    for (param, value) in IDENTIFICATION_SETTINGS {
        list.set(param, value.into())?;
    }
    prepare(board, &list)?;
    for line in ["arm", "mode open"] {
        board.command(line)?;
    }
    board.samples(0.1)?;
    board.command(&format!("sequence identify {AMPLITUDE_V} 0 {HOLD_MS}"))?;
    let rate_hz = f64::from(list.all.get(Param::TickRate));
    let samples = untripped(samples_of(board, HOLDS * 1e-3 * f64::from(HOLD_MS), rate_hz)?)?;
    board.command("disarm")?;
    // Trailing samples belong to no part of the sequence.
    let playing: Vec<Sample> = samples.into_iter().filter(|sample| sample.state.has(State::PLAYING)).collect();
    Ok((telemetry::recording("identify", &playing, &list.all), list.all))
}

/// Disarmed, with these settings and no others.
fn prepare(board: &mut impl Board, list: &SettingList) -> Result<(), BoardError> {
    board.command("disarm")?;
    board.command("defaults")?;
    list.commands().iter().try_for_each(|line| board.command(line))?;
    watch_host(board, &list.all)
}

/// Designs one law, runs it on the board and in simulation.
fn closed_loop(
    board: &mut impl Board,
    diagnosis: &Diagnosis,
    law: ControlLaw,
    specification: &Specification,
) -> Result<Loop, ThesisError> {
    let model = &diagnosis.model;
    let design = design(&model.motor, &Bench::default(), law, specification)?;
    let mut list = design.settings.clone();
    let motor = &model.motor;
    for setting in compensation(&model.dry_losses(), motor.resistance_ohm, motor.torque_constant_nm_per_a)? {
        list.set(setting.param, setting.value)?;
    }
    let rate_hz = f64::from(list.all.get(Param::TickRate));
    let no_load = f64::from(list.all.get(Param::SupplyVoltage)) / motor.torque_constant_nm_per_a;
    let references = REFERENCES.map(|part| (part * no_load).round());
    let (measured, ticks) = on_board(board, &list, law, &references)?;
    let steps: Vec<(f64, f64)> =
        ticks.iter().zip(&references).map(|(&tick, &value)| (f64::from(tick) / rate_hz, value)).collect();
    let simulated = in_simulation(diagnosis, &list, law, &steps)?;
    let of = |samples: &[Sample]| telemetry::recording(law.title(), samples, &list.all);
    let (measured, simulated) = (of(&measured), of(&simulated));
    let pairs = figures(&measured, &steps).into_iter().zip(figures(&simulated, &steps));
    Ok(Loop {
        figures: pairs.map(|(measured, simulated)| [measured, simulated]).collect(),
        speed: agreement(&measured, &simulated, Channel::Speed),
        current: agreement(&measured, &simulated, Channel::Current),
        design,
        measured,
        simulated,
    })
}

/// The samples from the tick at which the first reference took effect, and the ticks of all references relative to it.
fn on_board(
    board: &mut impl Board,
    list: &SettingList,
    law: ControlLaw,
    references: &[f64],
) -> Result<(Vec<Sample>, Vec<u32>), ThesisError> {
    prepare(board, list)?;
    board.command("arm")?;
    board.command(if law == ControlLaw::SpeedPid { "mode speed" } else { "mode lqr_speed" })?;
    board.samples(0.1)?;
    let (mut samples, mut starts) = (Vec::new(), Vec::new());
    for reference in references {
        let first = samples.len();
        board.command(&format!("ref {reference}"))?;
        while samples.len() < first + (STRETCH_S * f64::from(list.all.get(Param::TickRate))) as usize {
            board.stay_alive()?;
            samples.extend(untripped(board.samples(0.01)?)?);
        }
        // The console takes some ticks. The telemetry shows the first one.
        let asked: &[Sample] = &samples[first..];
        let moved = asked.iter().position(|sample| sample.reference != asked[0].reference).unwrap_or(0);
        starts.push(asked[moved].tick);
    }
    board.command("disarm")?;
    let since_first = |tick: u32| tick.wrapping_sub(starts[0]);
    samples.retain(|sample| since_first(sample.tick) < u32::MAX / 2);
    Ok((samples, starts.iter().map(|tick| since_first(*tick)).collect()))
}

/// The same on the host's core with the model. The references come after these times; the samples begin with the first.
fn in_simulation(
    diagnosis: &Diagnosis,
    list: &SettingList,
    law: ControlLaw,
    steps: &[(f64, f64)],
) -> Result<Vec<Sample>, ThesisError> {
    let last_s = steps.last().map_or(0.0, |(after_s, _)| *after_s);
    let scenario = Scenario {
        duration_s: BEFORE_S + last_s + STRETCH_S,
        mode: law.mode(),
        model: diagnosis.model.clone(),
        model_file: None,
        settings: list.all,
        references: steps
            .iter()
            .map(|&(after_s, value)| Reference { time_s: BEFORE_S + after_s, course: Course::Step { value } })
            .collect(),
        loads: Vec::new(),
        faults: Vec::new(),
        noise: Noise::default(),
        expected_trip: Trip::None,
    };
    let mut samples = scenario.run()?.samples;
    samples.drain(..(BEFORE_S * f64::from(list.all.get(Param::TickRate))).round() as usize);
    Ok(samples)
}

fn agreement(measured: &Recording, simulated: &Recording, channel: Channel) -> Agreement {
    let of = |recording: &Recording| recording.get(channel).map(<[f64]>::to_vec).unwrap_or_default();
    let (measured, simulated) = (of(measured), of(simulated));
    let length = measured.len().min(simulated.len());
    let mean = measured[..length].iter().sum::<f64>() / length as f64;
    let squares = |of: &dyn Fn(usize) -> f64| (0..length).map(|index| of(index).powi(2)).sum::<f64>();
    let error = squares(&|index| measured[index] - simulated[index]);
    Agreement {
        rms: (error / length as f64).sqrt(),
        fit_percent: 100.0 * (1.0 - (error / squares(&|index| measured[index] - mean)).sqrt()),
    }
}

/// Figures from a recording alone: on a board only the firmware's telemetry is available.
fn figures(recording: &Recording, steps: &[(f64, f64)]) -> Vec<Figures> {
    let column = |channel| recording.get(channel).unwrap_or_default();
    let (speed, current, volts) = (column(Channel::Speed), column(Channel::Current), column(Channel::Voltage));
    let (time_s, followed) = (column(Channel::Time), column(Channel::SpeedReference));
    let point = |index: usize| Point {
        t_s: time_s[index],
        reference: followed[index],
        u_v: volts[index],
        measured_rad_per_s: speed[index],
        omega_rad_per_s: speed[index],
        theta_rad: 0.0,
        i_a: current[index],
        limited: false,
    };
    let points: Vec<Point> = (0..recording.len()).map(point).collect();
    // Half a tick later, so that rounding does not decide.
    let at = |after_s: f64| points.partition_point(|point| point.t_s + 0.5e-3 < after_s);
    let ends = steps.iter().skip(1).map(|(after_s, _)| at(*after_s)).chain([points.len()]);
    let stretches = steps.iter().zip(ends).map(|(&(after_s, to), end)| (at(after_s)..end, to));
    stretches.map(|(range, to)| step_figures(&points[range], |point| point.measured_rad_per_s, to)).collect()
}

impl Thesis {
    /// The tables, as Markdown.
    pub fn tables(&self) -> String {
        let mut text = String::from("| loop | speed, rms | fit | current, rms | fit |\n|---|---|---|---|---|\n");
        for done in &self.loops {
            let (law, speed, current) = (done.design.law.title(), done.speed, done.current);
            let _ = writeln!(
                text,
                "| {law} | {:.2} rad/s | {:.1} % | {:.3} A | {:.1} % |",
                speed.rms, speed.fit_percent, current.rms, current.fit_percent
            );
        }
        text += "\n| loop | reference, rad/s | | rise, s | settling, s | overshoot, % | steady error, rad/s | IAE, rad | \
                 effort, V | peak, A |\n|---|---|---|---|---|---|---|---|---|---|\n";
        for done in &self.loops {
            for (row, figures) in done.figures.iter().flatten().enumerate() {
                let source = if row % 2 == 0 { "measured" } else { "simulated" };
                let law = if row == 0 { done.design.law.title() } else { "" };
                let _ = writeln!(text, "| {law} | {:.0} | {source} | {} |", figures.to, cells(figures));
            }
        }
        text
    }

    /// Speed, current and voltage of one loop, measured and simulated.
    pub fn picture(done: &Loop) -> String {
        let panel = |title: &str, channel| {
            let of = |recording: &Recording| recording.get(channel).map(<[f64]>::to_vec).unwrap_or_default();
            Panel::new(title).line("measured", of(&done.measured)).line("simulated", of(&done.simulated))
        };
        let speed = panel("speed, rad/s", Channel::Speed);
        let reference = done.measured.get(Channel::SpeedReference).map(<[f64]>::to_vec).unwrap_or_default();
        let all = [
            speed.line("reference", reference),
            panel("current, A", Channel::Current),
            panel("voltage, V", Channel::Voltage),
        ];
        panels(1.0 / f64::from(done.design.settings.all.get(Param::TickRate)), &all)
    }

    /// The settings of the board, as its console reads them.
    pub fn gains(&self) -> String {
        let gains = self.loops.iter().flat_map(|done| &done.design.gains);
        gains.map(|gain| format!("{} = {} {}\n", gain.name, gain.value, gain.unit)).collect()
    }
}

fn cells(figures: &Figures) -> String {
    let number = |value: Option<f64>, digits: usize| value.map_or("-".into(), |value| format!("{value:.digits$}"));
    [
        number(figures.rise_s, 3),
        number(figures.settling_s, 3),
        number(figures.overshoot_percent, 1),
        number(figures.steady_error, 3),
        number(Some(figures.iae), 2),
        number(Some(figures.effort_v), 2),
        number(Some(figures.peak_a), 3),
    ]
    .join(" | ")
}
