//! Hum of the mains in a sensor's readings: a line of one frequency, amplitude and phase throughout a recording. Nothing that
//! a motor does goes on so evenly. So it is taken out of the readings, the held-out ones as well, and told.

use super::pwm_ripple::vertex;
use crate::configuration::diagnose::mains_hum::{
    BESIDE_HZ, COHERENT, FINER, LEAST_OF_FLOOR, MAINS_HZ, MOST_OFF_HZ, OVER_OTHERS, PART_S, PARTS_ALIKE, ROWS_A_PERIOD,
};
use crate::dataset::{Dataset, Hum, Output};
use crate::identify::{Effort, Fit, Prior, fit};
use motorbench_model::Model;
use nalgebra::Complex;
use rustfft::algorithm::Radix4;
use rustfft::{Fft, FftDirection};
use std::f64::consts::{SQRT_2, TAU};

/// The same with what a linear motor leaves.
pub(super) fn settled(mut data: Dataset, prior: &Prior) -> Dataset {
    if may_hum(&data) {
        let linear = fit(&Model::linear(prior.motor), &data, prior, Effort::TRIAL);
        settle(&mut data, &linear);
    }
    data
}

/// Takes out what hum a model leaves in the readings. Returns whether there was any.
pub(super) fn settle(data: &mut Dataset, found: &Fit) -> bool {
    if !may_hum(data) {
        return false;
    }
    let lines: Vec<Vec<Line>> = (0..data.measured.len()).map(|output| lines(data, found, output)).collect();
    // What moves the motor shows in the current and in the speed.
    let is_of_the_motor = |line: &Line| {
        lines.len() > 1 && lines.iter().all(|lines| lines.iter().any(|other| other.mains_hz == line.mains_hz))
    };
    let hums = lines.iter().enumerate().flat_map(|(output, lines)| lines.iter().map(move |line| (output, line)));
    let hums: Vec<(usize, &Line)> = hums.filter(|(_, line)| !is_of_the_motor(line)).collect();
    for (output, line) in &hums {
        line.take_out(data, *output);
    }
    !hums.is_empty()
}

/// Whether a sensor is read in one recording: in another one the phase would be another.
fn may_hum(data: &Dataset) -> bool {
    data.is_one_recording() && data.measured.iter().any(|measured| is_of_a_sensor(measured.output))
}

/// Counts have no hum.
fn is_of_a_sensor(output: Output) -> bool {
    matches!(output, Output::Current | Output::Speed)
}

/// A line in the residual of a quantity.
struct Line {
    mains_hz: f64,
    hz: f64,
    /// Its amplitude, with the phase at time 0.
    amplitude: Complex<f64>,
}

fn lines(data: &Dataset, found: &Fit, output: usize) -> Vec<Line> {
    let measured = &data.measured[output];
    if !is_of_a_sensor(measured.output) {
        return Vec::new();
    }
    let residual = found.residual_of(data, output);
    let least = LEAST_OF_FLOOR * SQRT_2 * measured.least_error(measured.noise_in(&residual));
    let seen = MAINS_HZ.into_iter().filter(|hz| hz * data.interval_s * ROWS_A_PERIOD < 1.0);
    seen.filter_map(|hz| Line::of(data, &residual, hz)).filter(|line| line.amplitude.norm() > least).collect()
}

impl Line {
    /// The line near a frequency of the mains, if one stands out there and is the same in all parts of the recording.
    fn of(data: &Dataset, residual: &[f64], mains_hz: f64) -> Option<Self> {
        let parts = Parts::new(data, residual, mains_hz)?;
        let spectrum = parts.spectrum();
        let power = |bin: i32| spectrum[bin.rem_euclid(spectrum.len() as i32) as usize].norm_sqr();
        let bin_hz = 1.0 / (PART_S * spectrum.len() as f64);
        let bins = |hz: f64| (hz / bin_hz) as i32;
        let peak = (-bins(MOST_OFF_HZ)..=bins(MOST_OFF_HZ)).max_by(|a, b| power(*a).total_cmp(&power(*b)))?;
        let beside = (bins(BESIDE_HZ.start)..bins(BESIDE_HZ.end)).flat_map(|bin| [power(-bin), power(bin)]);
        let greatest = beside.fold(0.0, f64::max);
        let off_hz = (f64::from(peak) + vertex([peak - 1, peak, peak + 1].map(power))) * bin_hz;
        let all = parts.sums.len();
        let amplitude = parts.amplitude(off_hz, 0..all);
        let share = all.div_ceil(PARTS_ALIKE);
        let is_alike = |first: usize| {
            let part = parts.amplitude(off_hz, first..(first + share).min(all));
            (part - amplitude).norm() < COHERENT * amplitude.norm()
        };
        let is_line = power(peak) > OVER_OTHERS * greatest && (0..all).step_by(share).all(is_alike);
        is_line.then_some(Self { mains_hz, hz: mains_hz + off_hz, amplitude })
    }

    fn take_out(&self, data: &mut Dataset, output: usize) {
        let Dataset { time_s, measured, .. } = data;
        for (value, time_s) in measured[output].values.iter_mut().zip(time_s.iter()) {
            *value -= (self.amplitude * Complex::from_polar(1.0, TAU * self.hz * time_s)).re;
        }
        let (of, hums) = (measured[output].output, &mut data.origin.hums);
        // What is left of one beside a better model is no other.
        if !hums.iter().any(|known| known.of == of && (known.hz - self.hz).abs() < MOST_OFF_HZ) {
            hums.push(Hum { of, hz: self.hz, amplitude: self.amplitude.norm() });
        }
    }
}

/// A residual in short parts, demodulated with a frequency of the mains: sums and numbers of rows.
struct Parts {
    sums: Vec<(Complex<f64>, usize)>,
    begin_s: f64,
}

impl Parts {
    /// `None` for a recording that consists of gaps.
    fn new(data: &Dataset, residual: &[f64], mains_hz: f64) -> Option<Self> {
        let (begin_s, end_s) = (*data.time_s.first()?, *data.time_s.last()?);
        let count = ((end_s - begin_s) / PART_S) as usize + 1;
        if count > data.len() {
            return None;
        }
        let mut sums = vec![(Complex::default(), 0); count];
        for (time_s, left) in data.time_s.iter().zip(residual).filter(|(_, left)| left.is_finite()) {
            let (sum, rows) = &mut sums[((time_s - begin_s) / PART_S) as usize];
            *sum += left * Complex::from_polar(1.0, -TAU * mains_hz * time_s);
            *rows += 1;
        }
        Some(Self { sums, begin_s })
    }

    /// Sums over all parts at frequencies around that of the mains, the lower ones at the end.
    fn spectrum(&self) -> Vec<Complex<f64>> {
        let mut sums: Vec<Complex<f64>> = self.sums.iter().map(|(sum, _)| *sum).collect();
        sums.resize((FINER * sums.len()).next_power_of_two(), Complex::default());
        Radix4::new(sums.len(), FftDirection::Forward).process(&mut sums);
        sums
    }

    /// Of a line that is off the frequency of the mains by so much, in some of the parts.
    fn amplitude(&self, off_hz: f64, parts: std::ops::Range<usize>) -> Complex<f64> {
        let middle_s = |part: usize| self.begin_s + (part as f64 + 0.5) * PART_S;
        let turned = |part: usize| self.sums[part].0 * Complex::from_polar(1.0, -TAU * off_hz * middle_s(part));
        let rows: usize = parts.clone().map(|part| self.sums[part].1).sum();
        parts.map(turned).sum::<Complex<f64>>() * (2.0 / rows.max(1) as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use std::fmt::Write as _;

    const ROWS: usize = 20_000;

    fn rows_of_a_millisecond() -> Dataset {
        let mut text = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        for row in 0..ROWS {
            let _ = writeln!(text, "{:.3},{},{},0.{}", row as f64 * 1e-3, 2 + row / 250 % 3, 40 + row % 2, row % 7);
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        Dataset::new(&[recording], &Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap()).unwrap()
    }

    #[test]
    fn a_line_counts_where_it_goes_on_evenly_and_stands_alone() {
        let data = rows_of_a_millisecond();
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let noise: Vec<f64> = (0..ROWS).map(|_| random.random_range(-1.0..1.0)).collect();
        let line = |left: &dyn Fn(f64) -> f64| {
            let residual = noise.iter().enumerate().map(|(row, noise)| noise + left(row as f64 * 1e-3));
            Line::of(&data, &residual.collect::<Vec<_>>(), 50.0)
        };
        let wave = |time_s: f64| 0.8 * (TAU * 50.13 * time_s + 1.0).cos();
        let found = line(&wave).unwrap();
        assert!((found.hz - 50.13).abs() < 0.01, "{} Hz", found.hz);
        assert!((found.amplitude.norm() / 0.8 - 1.0).abs() < 0.05, "{}", found.amplitude);
        assert!((found.amplitude.arg() - 1.0).abs() < 0.1, "{}", found.amplitude);
        let others: [(&str, &dyn Fn(f64) -> f64); 4] = [
            ("none", &|_| 0.0),
            ("in half of the recording", &|time_s| if time_s < 10.0 { 2.0 * wave(time_s) } else { 0.0 }),
            ("a harmonic of what comes each second", &|time_s| if time_s.fract() < 0.004 { 20.0 } else { 0.0 }),
            ("a frequency that passes by", &|time_s| 3.0 * (TAU * (40.0 + 0.5 * time_s) * time_s).cos()),
        ];
        for (what, left) in others {
            assert!(line(left).is_none(), "{what}");
        }
    }
}
