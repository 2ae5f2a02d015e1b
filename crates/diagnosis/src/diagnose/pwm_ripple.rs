//! Finds the ripple of the PWM in currents that are read at one instant each: its exact frequency, and its phase. Rows see
//! it at another frequency, but it goes on evenly through the whole recording. Nothing else that a motor does is in step
//! with the duty and goes on so evenly.

use super::judge::VERY_STRONG_NATS;
use crate::dataset::{Dataset, Output, Pulse, Stretch};
use crate::identify::Fit;
use motorbench_model::motor::MotorParameters;
use nalgebra::Complex;
use std::f64::consts::{PI, TAU};

/// Frequencies of an Uno's timers: 16 MHz over a prescaler, and over 256 or 510 counts (ATmega328P data sheet, 15.7, 16.9
/// and 18.7).
pub(super) const TIMER_HZ: [f64; 6] = [490.196, 976.5625, 1960.784, 3921.569, 7812.5, 980.392];
/// How far a clock may be from its nominal frequency: a ceramic resonator is within half a percent, and a figure in a rig
/// file is rounded.
const CLOCK_TOLERANCE: f64 = 0.006;
/// A stated frequency may mean that of a timer this near: "1 kHz" for 976.6 Hz.
const MEANS: f64 = 0.05;
/// Readings on both sides whose mean is taken off: what the motor does changes more slowly.
const AROUND: usize = 5;
/// What else the residual has is judged from this far beside a peak, in widths of it.
const BESIDE: std::ops::Range<usize> = 3..30;
/// Frequencies lie closer than a ripple is wide by this factor, and so do the parts of the recording that are summed first.
const FINER: f64 = 8.0;

/// A ripple that goes on through the whole recording.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ripple {
    /// Its frequency.
    pub hz: f64,
    /// Where the pulse is.
    pub pulse: Pulse,
    /// Log-likelihood that it gains, less what the choice of a frequency costs.
    pub nats: f64,
    /// Angle by which the current follows the begin of the pulses' fundamental at time 0.
    angle_rad: f64,
}

impl Ripple {
    /// Share of a period that has passed at time 0, if this winding lets the current lag behind the pulses.
    pub fn phase(&self, motor: &MotorParameters) -> f64 {
        let lag_rad = (TAU * self.hz * motor.inductance_h / motor.resistance_ohm).atan();
        ((self.angle_rad + lag_rad) / TAU).rem_euclid(1.0)
    }
}

/// The strongest ripple near each frequency that the PWM may have, strongest first. `found` reads means over a period.
pub(super) fn ripples(data: &Dataset, found: &Fit) -> Vec<Ripple> {
    let Some(current) = data.measured.iter().position(|measured| measured.output == Output::Current) else {
        return Vec::new();
    };
    let residual = found.residual_of(data, current);
    let near = near(data).into_iter().flat_map(|hz| [Pulse::AtBegin, Pulse::InMiddle].map(|pulse| (hz, pulse)));
    let looked: Vec<(Ripple, usize)> =
        near.filter_map(|(hz, pulse)| Spectrum::new(data, &residual, hz, pulse)?.peak()).collect();
    let tried: usize = looked.iter().map(|(_, tried)| tried).sum();
    let priced = looked.into_iter().map(|(ripple, _)| Ripple { nats: ripple.nats - (tried as f64).ln(), ..ripple });
    let mut ripples: Vec<Ripple> = priced.filter(|ripple| ripple.nats > VERY_STRONG_NATS).collect();
    ripples.sort_by(|a, b| b.nats.total_cmp(&a.nats));
    ripples
}

/// The frequencies that the PWM may have, each to the tolerance of a clock.
fn near(data: &Dataset) -> Vec<f64> {
    let origin = &data.origin;
    if !origin.pwm_is_known {
        return TIMER_HZ.to_vec();
    }
    let off = |hz: &f64| (hz / origin.pwm_hz - 1.0).abs();
    let meant = TIMER_HZ.into_iter().filter(|hz| (CLOCK_TOLERANCE..MEANS).contains(&off(hz)));
    std::iter::once(origin.pwm_hz).chain(meant).collect()
}

/// A part of the recording, demodulated.
struct Part {
    time_s: f64,
    sum: Complex<f64>,
}

/// What the residual has in common with pulses of a frequency and of those around it.
struct Spectrum {
    hz: f64,
    pulse: Pulse,
    parts: Vec<Part>,
    /// Squares of the readings, and of the pulses as the readings see them.
    squares: f64,
    of_pulses: f64,
    readings: f64,
    length_s: f64,
}

impl Spectrum {
    fn new(data: &Dataset, residual: &[f64], hz: f64, pulse: Pulse) -> Option<Self> {
        let part_s = 1.0 / (FINER * CLOCK_TOLERANCE * hz);
        let (first, last) = (data.stretches.first()?.rows.start, data.stretches.last()?.rows.end - 1);
        let length_s = data.time_s[last] - data.time_s[first];
        let mut spectrum = Self { hz, pulse, parts: Vec::new(), squares: 0.0, of_pulses: 0.0, readings: 0.0, length_s };
        for Stretch { rows, .. } in &data.stretches {
            let fundamental = |row: usize| {
                let duty = data.duty[row.max(rows.start + 1) - 1];
                let middle = pulse.begins_at(duty) + 0.5 * duty.abs();
                let middle_rad = TAU * (hz * data.time_s[row] - middle);
                // No pulse, no ripple.
                Complex::from_polar(duty.signum() * (PI * duty.abs()).sin(), middle_rad)
            };
            let pulses = quick(rows.clone().map(fundamental).collect());
            let readings = quick(rows.clone().map(|row| Complex::from(residual[row])).collect());
            for ((row, pulse), reading) in rows.clone().zip(pulses).zip(readings) {
                let (Some(pulse), Some(reading)) = (pulse, reading) else { continue };
                let time_s = data.time_s[row];
                if spectrum.parts.last().is_none_or(|part| time_s > part.time_s + 0.5 * part_s) {
                    spectrum.parts.push(Part { time_s: time_s + 0.5 * part_s, sum: Complex::default() });
                }
                let part = spectrum.parts.last_mut()?;
                part.sum += pulse.conj() * reading;
                spectrum.squares += reading.norm_sqr();
                spectrum.of_pulses += pulse.norm_sqr();
                spectrum.readings += 1.0;
            }
        }
        Some(spectrum)
    }

    /// The strongest ripple, and the number of frequencies that were tried.
    fn peak(&self) -> Option<(Ripple, usize)> {
        let step_hz = 1.0 / (FINER * self.length_s);
        let steps = (CLOCK_TOLERANCE * self.hz / step_hz).ceil() as i32;
        let in_common = |step: i32| self.in_common(f64::from(step) * step_hz).norm_sqr();
        let looked: Vec<f64> = (-steps..=steps).map(in_common).collect();
        let best = (0..looked.len()).max_by(|a, b| looked[*a].total_cmp(&looked[*b]))?;
        let beside = |index: usize| looked.get(index).map_or(looked[best], |norm| *norm);
        let (left, right) = (beside(best.wrapping_sub(1)), beside(best + 1));
        let bend = left - 2.0 * looked[best] + right;
        let between = if bend < 0.0 { (0.5 * (left - right) / bend).clamp(-0.5, 0.5) } else { 0.0 };
        let off_hz = (best as f64 - f64::from(steps) + between) * step_hz;
        let sum = self.in_common(off_hz);
        // Of a ripple with two constants, cosine and sine.
        let explained =
            2.0 * sum.norm_sqr() / self.of_pulses.max(f64::MIN_POSITIVE) / self.squares.max(f64::MIN_POSITIVE);
        let in_white = -0.5 * self.readings * (-explained.min(1.0 - f64::EPSILON)).ln_1p();
        // What the model lacks is not white: its level beside the peak counts (as in a radar's detector of constant false
        // alarm rate). A power of noise alone is distributed exponentially around its mean.
        let in_coloured = sum.norm_sqr() / mean_beside(&looked, best).max(f64::MIN_POSITIVE);
        let nats = in_white.min(in_coloured);
        Some((Ripple { hz: self.hz + off_hz, pulse: self.pulse, nats, angle_rad: sum.arg() }, looked.len()))
    }

    fn in_common(&self, off_hz: f64) -> Complex<f64> {
        self.parts.iter().map(|Part { time_s, sum }| sum * Complex::cis(-TAU * off_hz * time_s)).sum()
    }
}

/// Mean of a spectrum beside its peak.
fn mean_beside(looked: &[f64], peak: usize) -> f64 {
    let steps = |widths: usize| (FINER * widths as f64) as usize;
    let is_beside = |index: &usize| (steps(BESIDE.start)..steps(BESIDE.end)).contains(&index.abs_diff(peak));
    let beside = || (0..looked.len()).filter(is_beside).map(|index| looked[index]);
    beside().sum::<f64>() / beside().count().max(1) as f64
}

/// Values less the mean around each; `None` where one of them is missing.
fn quick(values: Vec<Complex<f64>>) -> Vec<Option<Complex<f64>>> {
    let mut sums: Vec<(Complex<f64>, usize)> = vec![(Complex::default(), 0)];
    for value in &values {
        let (sum, missing) = sums[sums.len() - 1];
        let is_missing = !(value.re.is_finite() && value.im.is_finite());
        sums.push(if is_missing { (sum, missing + 1) } else { (sum + value, missing) });
    }
    let at = |index: usize| {
        let around = index.checked_sub(AROUND)?..(index + AROUND + 1);
        let (before, after) = (sums[around.start], sums.get(around.end)?);
        (before.1 == after.1).then(|| values[index] - (after.0 - before.0) / around.len() as f64)
    };
    (0..values.len()).map(at).collect()
}
