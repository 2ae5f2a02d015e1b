//! The result as a short text for a terminal.

use motorbench_diagnosis::dataset::TOLERANCE;
use motorbench_diagnosis::diagnose::determined::{AllDetermined, Determined, to_start};
use motorbench_diagnosis::diagnose::outcome::{
    Cause, Estimate, Outcome, Parameter, RunnerUp, ScaleOrigin, Unexplained, Verdict,
};
use motorbench_diagnosis::diagnose::{DATA_SHEET_TOLERANCE, Diagnosis};
use motorbench_model::catalogue::effect;
use motorbench_text::terminal_text::{rounded, short, wrapped};
use std::fmt::Write as _;

/// The page, at most 80 columns, without colour.
pub fn page(diagnosis: &Diagnosis) -> String {
    let outcome = &diagnosis.outcome;
    let mut text = String::new();
    let _ = writeln!(text, "{}\n", verdict(outcome));
    if !outcome.determined.is_empty() {
        text.push_str(&determined_lines(&outcome.determined));
        if let Some(sentence) = to_start(&outcome.determined, &diagnosis.data) {
            text.push_str(&wrapped(&sentence, "  ", "  "));
        }
        text.push('\n');
    }
    for (number, cause) in outcome.causes.iter().enumerate() {
        text.push_str(&cause_lines(number + 1, cause, outcome));
    }
    text.push_str(&errors(outcome));
    text.push_str(&parameters(outcome));
    if !outcome.advice.is_empty() {
        text.push_str("\nWhat to do\n");
        for advice in &outcome.advice {
            text.push_str(&wrapped(advice, "  - ", "    "));
        }
    }
    outcome.axis.motion.words(&text).into_owned()
}

/// The verdict in a sentence.
pub fn verdict(outcome: &Outcome) -> String {
    let names: Vec<String> = outcome.causes.iter().map(|cause| title(&cause.effect)).collect();
    let names = names.join(", ");
    match outcome.verdict {
        Verdict::Sufficient => format!(
            "The linear motor is enough: its error is the noise of the sensors, or less than {} % of the signal's range.",
            100.0 * TOLERANCE
        ),
        Verdict::Undecided => {
            "Undecided. The linear motor fits, but this recording could not have shown friction or a voltage drop."
                .into()
        }
        Verdict::Explained => {
            wrapped(&format!("The linear motor is not enough. The cause: {names}."), "", "").trim_end().into()
        }
        Verdict::PartlyExplained => wrapped(
            &format!("The linear motor is not enough. Part of the cause: {names}. Something else remains."),
            "",
            "",
        )
        .trim_end()
        .into(),
        Verdict::Unexplained => {
            "The linear motor is not enough, and no effect of the catalogue explains the rest.".into()
        }
    }
}

/// An effect's name in sentences, or the fault of a value.
pub fn title(id: &str) -> String {
    match id.strip_prefix("parameter:") {
        Some(name) => match name.strip_suffix("_scale") {
            Some(quantity) => format!("a {quantity} in another scale"),
            None => format!("a wrong value of the {}", name.replace('_', " ")),
        },
        None => effect(id).map_or(id, |effect| effect.about().title).into(),
    }
}

/// A value with its interval.
pub fn estimate(estimate: &Estimate) -> String {
    match estimate.ci95 {
        Some([low, high]) => {
            // The digits follow the width of the interval.
            let narrowness = (estimate.value / (high - low)).abs().log10();
            let digits = if narrowness.is_finite() { (narrowness.ceil() as i32 + 2).clamp(3, 6) } else { 3 };
            format!("{} [{}, {}]", rounded(estimate.value, digits), rounded(low, digits), rounded(high, digits))
        }
        None => short(estimate.value),
    }
}

/// What the data determine whatever the scale of torque and resistance; nothing if that is nothing.
pub fn determined_lines(all: &AllDetermined) -> String {
    let mut text = String::new();
    if !all.is_empty() {
        text.push_str("What the data determine, with 95 % intervals\n");
    }
    for (name, Determined { value, ci95, .. }) in all {
        let _ = writeln!(text, "  {name:28} {}", estimate(&Estimate { value: *value, ci95: Some(*ci95) }));
    }
    text
}

fn cause_lines(number: usize, cause: &Cause, outcome: &Outcome) -> String {
    let (title, confidence) = (title(&cause.effect), 100.0 * cause.confidence);
    let head = format!("{number}. {title} ({}), confidence {confidence:.0} %", cause.effect);
    let mut text = wrapped(&head, "", "   ");
    if let Some(effect) = effect(&cause.effect) {
        text.push_str(&wrapped(effect.about().law, "   ", "   "));
    }
    for (name, value) in &cause.parameters {
        let _ = writeln!(text, "   {name} = {}", estimate(value));
    }
    if let Some(sentence) = against_nominal(cause, outcome) {
        text.push_str(&wrapped(&sentence, "   ", "   "));
    }
    for (channel, gain) in &cause.gain {
        let _ = writeln!(
            text,
            "   error of {channel}: {} without it, {} with it",
            short(gain.rmse_before),
            short(gain.rmse_after)
        );
    }
    if let Some(runner_up) = &cause.runner_up {
        let runner_up = format!("next best in its place: {}, {}", runner_up.effect, rival_comparison(runner_up));
        text.push_str(&wrapped(&runner_up, "   ", "   "));
    }
    if !cause.not_separable_from.is_empty() {
        let others = cause.not_separable_from.join(", ");
        text.push_str(&wrapped(&format!("this data cannot tell it from: {others}"), "   ", "   "));
    }
    text.push('\n');
    text
}

fn errors(outcome: &Outcome) -> String {
    let mut text = String::from("Error on held-out data (rms, free-running simulation)\n");
    // The width of the longest channel name.
    let width = outcome.fit["base"].keys().map(|channel| channel.len()).max().unwrap_or(0).max(20);
    let _ = writeln!(text, "  {:width$} {:>10} {:>10} {:>10}   fit", "", "linear", "extended", "noise");
    for (channel, base) in &outcome.fit["base"] {
        let (extended, floor) = (&outcome.fit["extended"][channel], &outcome.fit["noise_floor"][channel]);
        let _ = writeln!(
            text,
            "  {channel:width$} {:>10} {:>10} {:>10}   {:.1} % -> {:.1} %",
            short(base.rmse),
            short(extended.rmse),
            short(floor.rmse),
            base.fit_percent,
            extended.fit_percent
        );
    }
    if let Some(unexplained) = &outcome.unexplained {
        text.push_str(&wrapped(&without_a_name(unexplained), "  ", "  "));
    }
    text
}

/// The unexplained rest, in a sentence.
pub fn without_a_name(unexplained: &Unexplained) -> String {
    format!("Unexplained: {:.0} % of the remaining error; {}.", 100.0 * unexplained.share, unexplained.place())
}

fn parameters(outcome: &Outcome) -> String {
    let mut text = String::from("\nMotor\n");
    let _ = writeln!(text, "  {:28} {:>10}   found [95 % interval]", "", "nominal");
    for (name, parameter) in &outcome.parameters {
        let nominal = parameter.nominal.map_or("-".into(), short);
        let interval = interval(outcome, name)
            .map_or_else(str::to_owned, |[low, high]| format!("{} .. {}", short(low), short(high)));
        let scale = scale_words(parameter.scale).map_or(String::new(), |words| format!(", {words}"));
        let _ = writeln!(text, "  {name:28} {nominal:>10} {:>10}   {interval}{scale}", short(parameter.value));
    }
    text
}

/// Interval of a constant of the motor, or why it has none.
pub(crate) fn interval(outcome: &Outcome, name: &str) -> Result<[f64; 2], &'static str> {
    let interval = outcome.parameters.get(name).and_then(Parameter::interval).ok_or("not fitted")?;
    if outcome.undetermined().any(|other| other == name) { Err("not determined") } else { Ok(interval) }
}

/// Where the scale of a constant comes from, if not from the data.
pub fn scale_words(scale: ScaleOrigin) -> Option<&'static str> {
    match scale {
        ScaleOrigin::Measured => None,
        ScaleOrigin::Nominal => Some("scale of the rig file"),
        ScaleOrigin::Unknown => Some("scale unknown"),
    }
}

/// For a wrong value: the nominal value, and the distance beyond the tolerance of a data sheet.
pub(crate) fn against_nominal(cause: &Cause, outcome: &Outcome) -> Option<String> {
    let name = cause.parameters.keys().next()?;
    let nominal = outcome.parameters.get(&**name)?.nominal.filter(|_| cause.is_value())?;
    Some(format!(
        "nominal {}: {} standard errors beyond the {:.0} % tolerance of a data sheet",
        short(nominal),
        short(cause.evidence_sigmas),
        100.0 * DATA_SHEET_TOLERANCE
    ))
}

/// Comparison with the next best cause, in words.
pub(crate) fn rival_comparison(runner_up: &RunnerUp) -> String {
    if runner_up.worse_by_sigmas > 0.0 {
        format!("{} standard errors worse", short(runner_up.worse_by_sigmas))
    } else {
        "no worse".into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn a_wrong_value_is_told_beside_the_nominal_one() {
        let found = Parameter { nominal: Some(0.07), value: 0.112, ci95: [0.11, 0.114], scale: ScaleOrigin::Measured };
        let estimate = Estimate { value: found.value, ci95: Some(found.ci95) };
        let cause = Cause {
            effect: "parameter:torque_constant".into(),
            confidence: 0.97,
            parameters: BTreeMap::from([("torque_constant_Nm_per_A".into(), estimate)]),
            gain: BTreeMap::new(),
            not_separable_from: Vec::new(),
            evidence_sigmas: 11.0,
            runner_up: None,
        };
        let outcome = Outcome {
            axis: motorbench_model::Axis::default(),
            verdict: Verdict::Explained,
            causes: vec![cause.clone()],
            unexplained: None,
            determined: AllDetermined::new(),
            parameters: BTreeMap::from([("torque_constant_Nm_per_A", found)]),
            fit: BTreeMap::new(),
            advice: Vec::new(),
        };
        let said = against_nominal(&cause, &outcome).unwrap();
        assert!(said.starts_with("nominal 0.0700: 11.0 standard errors beyond"), "{said}");
    }
}
