//! A recording compared with what a model predicts of it.

use super::{Arguments, Said, agreement_in, finish};
use crate::commands::{Failure, in_units_of, parsed_model, read_recording, rig_for};
use maud::{Markup, PreEscaped, html};
use motorbench_data::recording::Channel;
use motorbench_diagnosis::compare::distance;
use motorbench_diagnosis::dataset::{Dataset, Measured};
use motorbench_diagnosis::diagnose::prediction::{Predicted, delay_s};
use motorbench_diagnosis::diagnose::{judge, residuals};
use motorbench_diagnosis::free_run::position;
use motorbench_model::Model;
use motorbench_report::panels::Panel;
use motorbench_report::web_page::{code, number, table as page_table, text as cell};
use motorbench_text::terminal_text::{short, wrapped};
use serde_json::{Value, json};
use std::path::Path;

/// A free run of the model over the recording, compared with all measured quantities.
pub(super) fn with_model(arguments: &Arguments, recording: &Path, model: &Path) -> Result<(), Failure> {
    let rig = rig_for(arguments.rig.as_deref(), Some(recording))?;
    let recording = read_recording(recording, &arguments.columns)?;
    let data = Dataset::new(&[recording], &rig).map_err(Failure::input)?;
    let (axis, model) = parsed_model(model, Model::parse_with_axis)?;
    if axis != data.axis {
        return Err(Failure::input(format!(
            "{}: the recording has {}, and the model {}. Compare it with a recording of its own kind",
            arguments.second.display(),
            data.axis.words(),
            axis.words()
        )));
    }
    if let Some(delay_s) = arguments.delay.filter(|delay_s| *delay_s < 0.0) {
        return Err(Failure::input(format!(
            "--delay {delay_s}: a command acts after it is given, so beside a model the delay is 0 or more"
        )));
    }
    let predicted = Predicted::of(data, &model, &rig, arguments.delay);
    let is_found = arguments.delay.is_none() && predicted.data.origin.late_readings.is_none();
    let delay_note = is_found.then(|| delay_note(delay_s(&predicted.model), delay_s(&model))).flatten();
    let notes: Vec<String> = delay_note.into_iter().chain(predicted.data.notes()).collect();
    let quantities = quantities(&predicted);
    let axis = predicted.data.axis;
    let words = |text: &str| axis.motion.words(text).into_owned();
    let of_channels: Vec<Value> = quantities.iter().map(Quantity::json).collect();
    let measured = quantities.iter().filter(|one| !one.is_place);
    let fits: Vec<_> = measured.filter_map(|one| Some((one.title, one.fit_percent?))).collect();
    let figures = page_table(&["channel", "rms error", "fit"], quantities.iter().map(Quantity::cells)).into_string();
    let mut text = String::from("Free-running simulation of the model against the whole recording\n");
    quantities.iter().for_each(|one| text += &one.line());
    notes.iter().for_each(|note| text += &wrapped(note, "", ""));
    finish(
        arguments,
        &in_units_of(axis, &json!({ "delay_s": delay_s(&predicted.model), "channels": of_channels, "notes": notes }))?,
        Said {
            verdict: &words(&format!("recording and model {}", agreement_in(&fits))),
            text: &words(&text),
            figures: html! {
                p { "The model runs freely over the whole recording." }
                (PreEscaped(words(&figures)))
                @for note in &notes { p { (words(note)) } }
            },
        },
        &(predicted.data.interval_s, quantities.into_iter().flat_map(|one| one.panels).collect()),
    )
}

/// A quantity of a recording beside what a model predicts of it.
struct Quantity {
    channel: &'static str,
    title: &'static str,
    unit: &'static str,
    rms: f64,
    /// `None` where what is measured is constant.
    fit_percent: Option<f64>,
    /// The place of a free run, which is far off after a long one.
    is_place: bool,
    panels: Vec<Panel>,
}

impl Quantity {
    fn json(&self) -> Value {
        json!({ "channel": self.channel, "rms": self.rms, "fit_percent": self.fit_percent })
    }

    fn error(&self) -> String {
        format!("{:>10} {}", short(self.rms), self.unit)
    }

    fn fit(&self) -> Option<String> {
        self.fit_percent.filter(|_| !self.is_place).map(|fit| format!("{fit:.1} %"))
    }

    /// A line of the text.
    fn line(&self) -> String {
        let fit = self.fit().map_or("of the free run".into(), |fit| format!("fit {fit}"));
        format!("  {:<18} {} rms, {fit}\n", self.channel, self.error())
    }

    /// A row of the page's table.
    fn cells(&self) -> [Markup; 3] {
        let fit = self.fit().map_or(cell("of the free run"), number);
        [code([self.channel]), number(self.error().trim_start()), fit]
    }
}

fn quantities(Predicted { data, model, prediction }: &Predicted) -> Vec<Quantity> {
    let left = residuals(data, prediction);
    let compared = |(output, measured): (usize, &Measured)| {
        let (title, unit) = (measured.output.title(), measured.output.unit());
        let both =
            Panel::new(title).line("measured", measured.values.clone()).line("model", prediction[output].clone());
        let apart =
            Panel::new(&format!("measured - model, {unit}")).difference().line("difference", left[output].clone());
        Quantity {
            channel: measured.output.channel(),
            title,
            unit,
            rms: judge::rmse(data, prediction, output),
            fit_percent: Some(judge::fit_percent(data, prediction, output)),
            is_place: false,
            panels: vec![both, apart],
        }
    };
    let of_place = (!data.axis.drive.is_voltage()).then(|| {
        let simulated = position(model, data);
        let (title, channel) = (Channel::Angle.title(), Channel::Angle.column());
        let (rms, fit_percent) = distance(&data.angle_rad, &simulated);
        let panel = Panel::new(title).line("measured", data.angle_rad.clone()).line("model", simulated);
        Quantity { channel, title, unit: "rad", rms, fit_percent, is_place: true, panels: vec![panel] }
    });
    data.measured.iter().enumerate().map(compared).chain(of_place).collect()
}

/// Where the recording has another delay than the model.
fn delay_note(of_recording_s: f64, of_model_s: f64) -> Option<String> {
    let [recording_ms, model_ms] = [of_recording_s, of_model_s].map(|delay_s| short(1e3 * delay_s));
    (recording_ms != model_ms).then(|| {
        format!(
            "The commands of this recording act {recording_ms} ms late, and those of the model {model_ms} ms. That belongs to the program and its link, so the recording's was taken. --delay {} compares with the model's.",
            short(of_model_s)
        )
    })
}
