//! The plots of a diagnosis.

use crate::plot::{AFTER, BEFORE, HEIGHT, LOW, MEASURED, Mark, OTHERS, Plot, capital, quantity};
use crate::web_page::text;
use maud::{Markup, html};
use motorbench_diagnosis::dataset::Dataset;
use motorbench_diagnosis::diagnose::missing::Dependence;
use motorbench_diagnosis::diagnose::outcome::Parameter;
use motorbench_diagnosis::diagnose::{Diagnosis, residuals};
use motorbench_diagnosis::evidence::Evidence;
use motorbench_diagnosis::identify::NOMINAL_SPREAD;
use motorbench_model::catalogue::ActsOn;
use motorbench_text::terminal_text::short;

/// Group of the plots over the time of the recording.
const OVER_TIME: &str = "time";
/// Noise of a sensor that a residual is compared with, in standard deviations.
const NOISE_BAND: f64 = 2.0;

/// Time on a plot: several recordings are shown one after the other.
fn time_s(data: &Dataset, index: usize) -> f64 {
    index as f64 * data.interval_s
}

fn points(data: &Dataset, values: &[f64]) -> Vec<[f64; 2]> {
    values.iter().enumerate().map(|(index, value)| [time_s(data, index), *value]).collect()
}

/// Marks the held-out data.
fn with_held_out(mut plot: Plot, data: &Dataset) -> Plot {
    let mut start = 0;
    while start < data.len() {
        let kept = data.held_out[start];
        let end = (start..data.len()).find(|index| data.held_out[*index] != kept).unwrap_or(data.len());
        if kept {
            plot = plot.band(time_s(data, start), time_s(data, end));
        }
        start = end;
    }
    plot
}

/// Measured and simulated, before and after, and below it what each leaves.
pub fn traces(diagnosis: &Diagnosis, output: usize) -> Markup {
    let data = &diagnosis.data;
    let measured = &data.measured[output];
    let title = measured.output.title();
    let over_time =
        |title: &str, height| with_held_out(Plot::new("time, s", title).high(height).in_group(OVER_TIME), data);
    let both = over_time(title, HEIGHT)
        .with("measured", MEASURED, Mark::Broad, points(data, &measured.values))
        .line("linear motor", BEFORE, points(data, &diagnosis.base[output]))
        .line("extended model", AFTER, points(data, &diagnosis.extended[output]));
    let [before, after] = [&diagnosis.base, &diagnosis.extended].map(|run| residuals(data, run).swap_remove(output));
    let noise = NOISE_BAND * diagnosis.outcome.fit["noise_floor"][measured.output.channel()].rmse;
    let left = over_time(&format!("left, {}", measured.output.unit()), LOW)
        .level_band(-noise, noise)
        .line("linear motor leaves", BEFORE, points(data, &before))
        .line("extended model leaves", AFTER, points(data, &after));
    let caption = format!("{}: measured, and simulated before and after", capital(quantity(title)));
    html! {
        (both.figure(&html! { b { (caption) } }))
        (left.figure(&html! { "Measured less simulated; the dark band is the noise of the sensor" }))
    }
}

/// The evidence of a cause.
pub fn proof(evidence: &Evidence) -> Markup {
    let axis = |(name, unit): (&str, &str)| if unit.is_empty() { name.to_string() } else { format!("{name}, {unit}") };
    let bins = evidence.bins.iter().map(|bin| [bin.at, bin.lack]).collect();
    let deviations = evidence.bins.iter().map(|bin| bin.deviation).collect();
    let plot = Plot::new(&axis(evidence.coordinate), &axis(evidence.quantity))
        .line("fitted law", AFTER, evidence.law.clone())
        .dots("measured, all other causes taken out", MEASURED, bins, deviations);
    let caption = format!("{} over {}", capital(evidence.quantity.0), evidence.coordinate.0);
    plot.figure(&html! { b { (caption) } })
}

/// A quantity over one that it may depend on; `what`: its name and unit.
pub fn curve(what: &str, dependence: &Dependence) -> Markup {
    let points = dependence.curve.iter().map(|(x, y)| [*x, *y]).collect();
    let axis = format!("{}, {}", dependence.on, dependence.unit);
    let plot = Plot::new(axis.trim_end_matches(", "), what).dots("measured", MEASURED, points, Vec::new());
    let (quantity, on, percent) = (quantity(what), dependence.on, 100.0 * dependence.share);
    plot.figure(&text(format!("{quantity} over {on}: a curve explains {percent:.0} % of it")))
}

/// A quantity over all of the data.
pub fn quantity_over_time(data: &Dataset, what: &str, values: &[f64]) -> Markup {
    let plot = Plot::new("time, s", what).high(LOW).in_group(OVER_TIME).line("it", MEASURED, points(data, values));
    plot.figure(&text(format!("{} over time", quantity(what))))
}

/// Name and unit of the quantity that a model lacks.
pub fn missing(acts_on: ActsOn) -> &'static str {
    match acts_on {
        ActsOn::Torque => "missing torque, Nm",
        ActsOn::Voltage => "missing voltage, V",
        ActsOn::CurrentSensor => "missing current, A",
        ActsOn::AngleSensor => "missing speed, rad/s",
    }
}

/// A value on a scale from half to twice the nominal one, as a row of a table: a picture that needs no plot.
pub fn found_over_nominal(parameter: &Parameter) -> Option<Markup> {
    const WIDTH: f64 = 260.0;
    let nominal = parameter.nominal.filter(|nominal| *nominal > 0.0)?;
    let ratios = [parameter.ci95[0], parameter.value, parameter.ci95[1]].map(|value| value / nominal);
    let tolerance = [-NOMINAL_SPREAD, NOMINAL_SPREAD].map(f64::exp);
    let ends = ratios.into_iter().chain(tolerance).map(|ratio| ratio.max(1e-3).ln().abs());
    let most = 1.15 * ends.fold(2f64.ln(), f64::max);
    let place = |ratio: f64| 0.5 * WIDTH * (1.0 + ratio.max(1e-3).ln() / most);
    let [low, value, high] = ratios.map(place);
    let [from, to] = tolerance.map(place);
    let colour = format!("rgb({},{},{})", OTHERS[0].0, OTHERS[0].1, OTHERS[0].2);
    Some(html! {
        svg class="ratio" role="img" aria-label=(format!("{} of the nominal value", short(ratios[1])))
            width=(WIDTH) height="22" viewBox=(format!("0 0 {WIDTH} 22")) {
            rect x=(from) y="2" width=(to - from) height="18" fill="#e9ebee" {}
            line x1=(place(1.0)) x2=(place(1.0)) y1="1" y2="21" stroke="#8a9099" {}
            line x1=(low) x2=(high) y1="11" y2="11" stroke=(colour) stroke-width="3" {}
            circle cx=(value) cy="11" r="5" fill=(colour) {}
        }
    })
}
