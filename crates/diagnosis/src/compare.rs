//! Two recordings of one course, brought to common times: how late the second is, and how far they are apart.

use crate::configuration::compare::{FEWEST, JUDGED, LARGEST_DELAY, ROUNDING, SHIFTS};
use crate::dataset::median;
use motorbench_data::recording::{Channel, Recording};
use serde::Serialize;

/// Channels that tell the delay, best first: what a loop was asked for is the same in both, whatever they made of it.
const TELLING: [Channel; 9] = [
    Channel::SpeedReference,
    Channel::AngleReference,
    Channel::Speed,
    Channel::Rpm,
    Channel::Angle,
    Channel::Counts,
    Channel::Current,
    Channel::Voltage,
    Channel::Duty,
];

/// One channel of both.
#[derive(Clone, Debug, Serialize)]
pub struct Difference {
    /// Column name, with its unit.
    pub channel: &'static str,
    /// Root mean square of the difference.
    pub rms: f64,
    /// 100 (1 - |a - b| / |a - mean a|); none of a first that is constant but for how it was rounded.
    pub fit_percent: Option<f64>,
    /// Values of the first.
    #[serde(skip)]
    pub first: Vec<f64>,
    /// Values of the second at the same times, its delay taken off.
    #[serde(skip)]
    pub second: Vec<f64>,
}

impl Difference {
    /// Title of its axis.
    pub fn title(&self) -> &'static str {
        Channel::of_column(self.channel).map_or(self.channel, Channel::title)
    }

    /// Title of the axis of [`Self::second_less_first`], which stands below the quantity itself.
    pub fn title_of_difference(&self, [first, second]: [&str; 2]) -> String {
        match self.title().rsplit_once(", ") {
            Some((_, unit)) => format!("{second} - {first}, {unit}"),
            None => format!("{second} - {first}"),
        }
    }

    /// The second less the first.
    pub fn second_less_first(&self) -> Vec<f64> {
        self.second.iter().zip(&self.first).map(|(second, first)| second - first).collect()
    }

    /// Whether the two differ anywhere: a reference mostly does not.
    pub fn differs(&self) -> bool {
        self.rms > 0.0
    }
}

/// Two recordings beside each other.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// By how much the second is later than the first.
    pub delay_s: f64,
    /// Length that both have.
    pub duration_s: f64,
    /// Time between the samples of the first.
    #[serde(skip)]
    pub interval_s: f64,
    /// Channels that both have.
    pub channels: Vec<Difference>,
}

/// Why two recordings cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CompareError {
    /// A table of steady states.
    #[error("{0}: no column t_s: two recordings over time are compared")]
    NoTime(String),
    /// Nothing in common.
    #[error("{0} and {1} have no channel in common besides t_s")]
    NothingShared(String, String),
    /// Too little in common.
    #[error("{0} and {1} have less than {least} samples at the same time", least = FEWEST)]
    NoOverlap(String, String),
}

/// Brings both to the times of the first. `delay_s`: how much later the second is, found where it is not given.
///
/// # Errors
/// [`CompareError`].
pub fn compare(first: &Recording, second: &Recording, delay_s: Option<f64>) -> Result<Comparison, CompareError> {
    let time_of = |recording: &Recording| -> Result<Vec<f64>, CompareError> {
        let time_s = recording.time_s().ok_or_else(|| CompareError::NoTime(recording.name.clone()))?;
        Ok(time_s.iter().map(|t_s| t_s - time_s[0]).collect())
    };
    let (a_s, b_s) = (time_of(first)?, time_of(second)?);
    let shared: Vec<Channel> =
        first.channels().filter(|channel| *channel != Channel::Time && second.get(*channel).is_some()).collect();
    let names = || (first.name.clone(), second.name.clone());
    let varies = |recording: &Recording, channel: Channel| {
        recording.get(channel).is_some_and(|values| values.iter().any(|value| *value != values[0]))
    };
    let tells = |channel: &Channel| shared.contains(channel) && varies(first, *channel) && varies(second, *channel);
    let Some(telling) = TELLING.into_iter().find(tells).or(shared.first().copied()) else {
        let (a, b) = names();
        return Err(CompareError::NothingShared(a, b));
    };
    let values = |recording: &Recording, channel| recording.get(channel).expect("both have it").to_vec();
    let delay_s = delay_s.unwrap_or_else(|| {
        let (a, b) = (values(first, telling), values(second, telling));
        found_delay_s((&a_s, &a), (&b_s, &b), has_origin(telling))
    });
    let common: Vec<usize> =
        (0..a_s.len()).filter(|index| (b_s[0]..=b_s[b_s.len() - 1]).contains(&(a_s[*index] + delay_s))).collect();
    if common.len() < FEWEST {
        let (a, b) = names();
        return Err(CompareError::NoOverlap(a, b));
    }
    // Without a reference for it, where an angle is zero says nothing.
    let anywhere = !shared.contains(&Channel::AngleReference);
    let channels = shared.into_iter().map(|channel| {
        let (a, b) = (values(first, channel), values(second, channel));
        let mut first: Vec<f64> = common.iter().map(|index| a[*index]).collect();
        let mut second: Vec<f64> = common.iter().map(|index| at(&b_s, &b, a_s[*index] + delay_s)).collect();
        if anywhere && has_origin(channel) {
            from_start(&mut first);
            from_start(&mut second);
        }
        let (rms, fit_percent) = distance(&first, &second);
        Difference { channel: channel.column(), rms, fit_percent, first, second }
    });
    Ok(Comparison {
        delay_s,
        duration_s: a_s[common[common.len() - 1]] - a_s[common[0]],
        interval_s: median(a_s.windows(2).map(|pair| pair[1] - pair[0])),
        channels: channels.collect(),
    })
}

/// Whether a channel counts from where a shaft stood, or a loop was closed, which another recording has elsewhere.
fn has_origin(channel: Channel) -> bool {
    matches!(channel, Channel::Counts | Channel::Angle | Channel::AngleReference)
}

/// Takes off the first value that is there.
fn from_start(values: &mut [f64]) {
    let start = values.iter().copied().find(|value| value.is_finite()).unwrap_or_default();
    values.iter_mut().for_each(|value| *value -= start);
}

/// Root mean square of the difference, and fit in percent, where neither is missing.
pub fn distance(first: &[f64], second: &[f64]) -> (f64, Option<f64>) {
    let pairs = || first.iter().zip(second).filter(|(a, b)| a.is_finite() && b.is_finite());
    let count = pairs().count().max(1) as f64;
    let mean = pairs().map(|(a, _)| a).sum::<f64>() / count;
    let rms = (pairs().map(|(a, b)| (a - b).powi(2)).sum::<f64>() / count).sqrt();
    let spread = (pairs().map(|(a, _)| (a - mean).powi(2)).sum::<f64>() / count).sqrt();
    let largest = pairs().map(|(a, _)| a.abs()).fold(0.0, f64::max);
    (rms, (spread > ROUNDING * largest).then(|| 100.0 * (1.0 - rms / spread)))
}

/// Value at a time, straight between samples; outside it is missing.
fn at(time_s: &[f64], values: &[f64], t_s: f64) -> f64 {
    let next = time_s.partition_point(|sample_s| *sample_s < t_s);
    match (next.checked_sub(1), next) {
        (None, 0) if time_s[0] == t_s => values[0],
        (Some(before), after) if after < time_s.len() => {
            let part = (t_s - time_s[before]) / (time_s[after] - time_s[before]);
            values[before] + part * (values[after] - values[before])
        }
        _ => f64::NAN,
    }
}

/// The shift with the least mean square difference, of what has an origin but for a constant one: first on a grid, then by
/// halves of its step.
fn found_delay_s(first: (&[f64], &[f64]), second: (&[f64], &[f64]), has_origin: bool) -> f64 {
    let (time_s, values) = first;
    let every = (time_s.len() / JUDGED).max(1);
    let range_s = LARGEST_DELAY * time_s[time_s.len() - 1];
    let cost = |delay_s: f64| {
        let apart: Vec<f64> = (0..time_s.len())
            .step_by(every)
            .map(|index| values[index] - at(second.0, second.1, time_s[index] + delay_s))
            .filter(|apart| apart.is_finite())
            .collect();
        // A short overlap may agree by chance.
        if 2 * apart.len() * every < time_s.len() {
            return f64::INFINITY;
        }
        let mean = |of: &dyn Fn(f64) -> f64| apart.iter().map(|apart| of(*apart)).sum::<f64>() / apart.len() as f64;
        let origin = if has_origin { mean(&|apart| apart) } else { 0.0 };
        mean(&|apart| (apart - origin).powi(2))
    };
    let mut step_s = range_s / SHIFTS as f64;
    let mut best_s = 0.0;
    let mut least = cost(0.0);
    for shift in -(SHIFTS as i32)..=SHIFTS as i32 {
        let delay_s = f64::from(shift) * step_s;
        let here = cost(delay_s);
        if here < least {
            (best_s, least) = (delay_s, here);
        }
    }
    let interval_s = median(time_s.windows(2).map(|pair| pair[1] - pair[0]));
    while step_s > 0.01 * interval_s {
        step_s *= 0.5;
        for delay_s in [best_s - step_s, best_s + step_s] {
            let here = cost(delay_s);
            if here < least {
                (best_s, least) = (delay_s, here);
            }
        }
    }
    best_s
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recording(name: &str, interval_s: f64, late_s: f64, scale: f64) -> Recording {
        let mut recording = Recording::new(name);
        let time_s: Vec<f64> = (0..(4.0 / interval_s) as usize).map(|index| index as f64 * interval_s).collect();
        let course = |t_s: f64| if t_s < 1.0 { 0.0 } else { 50.0 * (1.0 - (-(t_s - 1.0) / 0.1).exp()) };
        recording.set(Channel::Speed, time_s.iter().map(|t_s| scale * course(t_s - late_s)).collect());
        recording.set(Channel::Time, time_s);
        recording
    }

    #[test]
    fn a_delay_is_found_across_rates_and_taken_off() {
        let compared = compare(&recording("a", 1e-3, 0.0, 1.0), &recording("b", 1.3e-3, 0.137, 1.0), None).unwrap();
        assert!((compared.delay_s - 0.137).abs() < 2e-4, "{}", compared.delay_s);
        assert!(compared.channels[0].fit_percent > Some(99.0), "{:?}", compared.channels[0].fit_percent);
        let scaled = compare(&recording("a", 1e-3, 0.0, 1.0), &recording("b", 1e-3, 0.0, 0.9), Some(0.0)).unwrap();
        // A tenth of the root mean square of the course itself.
        let values = &scaled.channels[0].first;
        let rms = (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt();
        assert!((scaled.channels[0].rms - 0.1 * rms).abs() < 1e-9);
    }

    /// One motor follows later than the other, both were asked at the same time.
    #[test]
    fn a_slower_loop_is_no_delay() {
        let asked = |name: &str, late_s: f64| {
            let mut of_motor = recording(name, 1e-3, late_s, 1.0);
            let time_s = of_motor.time_s().unwrap().to_vec();
            of_motor.set(Channel::SpeedReference, time_s.iter().map(|t_s| f64::from(*t_s > 1.0)).collect());
            of_motor
        };
        let compared = compare(&asked("a", 0.0), &asked("b", 0.02), None).unwrap();
        assert!(compared.delay_s.abs() < 1e-4, "{}", compared.delay_s);
    }

    #[test]
    fn an_angle_is_compared_from_its_start_unless_it_was_asked_for() {
        let with = |name: &str, start: f64, reference: bool| {
            let mut recording = recording(name, 1e-3, 0.0, 1.0);
            let angle: Vec<f64> = recording.get(Channel::Speed).unwrap().iter().map(|speed| start + speed).collect();
            if reference {
                recording.set(Channel::AngleReference, angle.clone());
            }
            recording.set(Channel::Angle, angle);
            recording
        };
        let fit = |reference: bool| {
            let both = compare(&with("a", 0.0, reference), &with("b", 20.0, reference), Some(0.0)).unwrap();
            both.channels.iter().find(|channel| channel.channel == "theta_rad").unwrap().fit_percent
        };
        assert!(fit(false) > Some(99.9) && fit(true) < Some(50.0), "{:?} {:?}", fit(false), fit(true));
    }

    /// Where the shaft stood when a position loop was closed says nothing of when that was.
    #[test]
    fn a_shaft_that_stood_elsewhere_is_no_delay() {
        let from = |name: &str, start: f64| {
            let mut recording = recording(name, 1e-3, 0.0, 1.0);
            let time_s = recording.time_s().unwrap();
            let asked = time_s.iter().map(|t_s| start + f64::from(*t_s > 1.0) - 2.0 * f64::from(*t_s > 2.0)).collect();
            recording.set(Channel::AngleReference, asked);
            recording
        };
        let compared = compare(&from("a", 0.0), &from("b", 1.2), None).unwrap();
        assert!(compared.delay_s.abs() < 1e-4, "{}", compared.delay_s);
    }

    #[test]
    fn a_constant_channel_has_no_fit() {
        let third = [1.0 / 3.0, 1.0 / 3.0 + 1e-12, 1.0 / 3.0, 1.0 / 3.0];
        let written = [0.333_333_333; 4];
        assert_eq!([distance(&third, &written).1, distance(&[0.0; 4], &[0.0; 4]).1], [None, None]);
        assert!(distance(&[1.0, 1.0 + 1e-6], &[1.0, 1.0 + 1e-6]).1 > Some(99.9));
    }

    #[test]
    fn errors_name_both() {
        let mut other = Recording::new("b");
        other.set(Channel::Time, vec![0.0, 1.0]);
        let message = compare(&recording("a", 1e-3, 0.0, 1.0), &other, None).unwrap_err().to_string();
        assert_eq!(message, "a and b have no channel in common besides t_s");
    }
}
