//! Finds the ripple of the PWM in currents that are read at one instant each: its exact frequency, and its phase. Rows see
//! it at another frequency, but it goes on evenly through the whole recording. Nothing else that a motor does is in step
//! with the duty and goes on so evenly.

use super::judge::VERY_STRONG_NATS;
pub(super) use crate::configuration::diagnose::pwm_ripple::TIMER_HZ;
use crate::configuration::diagnose::pwm_ripple::{AROUND_S, BESIDE, CLOCK_TOLERANCE, FINER, MEANS};
use crate::dataset::{Dataset, Output, Pulse, Stretch};
use crate::identify::Fit;
use motorbench_model::motor::MotorParameters;
use nalgebra::Complex;
use rustfft::algorithm::Radix4;
use rustfft::{Fft, FftDirection};
use std::f64::consts::{PI, TAU};
use std::ops::Range;

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

/// The strongest ripple of either pulse near each frequency that the PWM may have, strongest first. `found` reads means over
/// a period.
pub(super) fn ripples(data: &Dataset, found: &Fit) -> Vec<Ripple> {
    let Some(current) = data.measured.iter().position(|measured| measured.output == Output::Current) else {
        return Vec::new();
    };
    let residual = found.residual_of(data, current);
    let readings = quick(data, |_, row| Complex::from(residual[row]));
    let of_pulse = |hz: f64, pulse: Pulse| Spectrum::new(data, &readings, hz, pulse)?.peak();
    let of_both = |hz: f64| Pulse::ALL.into_iter().filter_map(move |pulse| of_pulse(hz, pulse));
    let looked: Vec<(Ripple, usize)> = near(data).into_iter().flat_map(of_both).collect();
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

/// Where the parabola through three neighbouring powers has its vertex, in their distances from the middle one.
pub(super) fn vertex([left, middle, right]: [f64; 3]) -> f64 {
    let bend = left - 2.0 * middle + right;
    if bend < 0.0 { (0.5 * (left - right) / bend).clamp(-0.5, 0.5) } else { 0.0 }
}

/// What the residual has in common with pulses of a frequency and of those around it.
struct Spectrum {
    hz: f64,
    pulse: Pulse,
    /// The recording in parts of [`part_s`], demodulated.
    parts: Vec<Complex<f64>>,
    begin_s: f64,
    length_s: f64,
    /// Squares of the readings, and of the pulses as the readings see them.
    squares: f64,
    of_pulses: f64,
    readings: f64,
}

impl Spectrum {
    /// `None` for several recordings: each of them begins anywhere in a period.
    fn new(data: &Dataset, readings: &[Quick], hz: f64, pulse: Pulse) -> Option<Self> {
        if !data.is_one_recording() {
            return None;
        }
        let (begin_s, end_s) = (*data.time_s.first()?, *data.time_s.last()?);
        let length_s = end_s - begin_s;
        let parts = vec![Complex::default(); (length_s / part_s(hz)) as usize + 1];
        let mut spectrum = Self { hz, pulse, parts, begin_s, length_s, squares: 0.0, of_pulses: 0.0, readings: 0.0 };
        let fundamental = |rows: &Range<usize>, row: usize| {
            let duty = data.duty[row.max(rows.start + 1) - 1];
            let middle = pulse.begins_at(duty) + 0.5 * duty.abs();
            let middle_rad = TAU * (hz * data.time_s[row] - middle);
            // No pulse, no ripple.
            Complex::from_polar(duty.signum() * (PI * duty.abs()).sin(), middle_rad)
        };
        for (row, (pulse, reading)) in quick(data, fundamental).into_iter().zip(readings).enumerate() {
            let (Some(pulse), Some(reading)) = (pulse, reading) else { continue };
            let part = ((data.time_s[row] - begin_s) / part_s(hz)) as usize;
            spectrum.parts[part] += pulse.conj() * reading;
            spectrum.squares += reading.norm_sqr();
            spectrum.of_pulses += pulse.norm_sqr();
            spectrum.readings += 1.0;
        }
        Some(spectrum)
    }

    /// The strongest ripple, and the number of frequencies that were tried.
    fn peak(&self) -> Option<(Ripple, usize)> {
        let (powers, step_hz) = self.powers();
        let best = (0..powers.len()).max_by(|a, b| powers[*a].total_cmp(&powers[*b]))?;
        let beside = |index: usize| powers.get(index).map_or(powers[best], |power| *power);
        let between = vertex([beside(best.wrapping_sub(1)), powers[best], beside(best + 1)]);
        let off_hz = (best as f64 - (powers.len() / 2) as f64 + between) * step_hz;
        let sum = self.in_common(off_hz);
        // Of a ripple with two constants, cosine and sine.
        let explained =
            2.0 * sum.norm_sqr() / self.of_pulses.max(f64::MIN_POSITIVE) / self.squares.max(f64::MIN_POSITIVE);
        let in_white = -0.5 * self.readings * (-explained.min(1.0 - f64::EPSILON)).ln_1p();
        // What the model lacks is not white: its level beside the peak counts (as in a radar's detector of constant false
        // alarm rate). A power of noise alone is distributed exponentially around its mean.
        let width = 1.0 / self.length_s / step_hz;
        let in_coloured = sum.norm_sqr() / mean_beside(&powers, best, width).max(f64::MIN_POSITIVE);
        let nats = in_white.min(in_coloured);
        Some((Ripple { hz: self.hz + off_hz, pulse: self.pulse, nats, angle_rad: sum.arg() }, powers.len()))
    }

    /// The power at frequencies around the middle one, to the tolerance of a clock, and their distance.
    fn powers(&self) -> (Vec<f64>, f64) {
        let length = (FINER as usize * self.parts.len()).next_power_of_two();
        let mut sums = self.parts.clone();
        sums.resize(length, Complex::default());
        Radix4::new(length, FftDirection::Forward).process(&mut sums);
        let side = length / FINER as usize;
        // Lower frequencies are at the end.
        let around = (length - side..length).chain(0..=side);
        (around.map(|index| sums[index].norm_sqr()).collect(), 1.0 / (length as f64 * part_s(self.hz)))
    }

    fn in_common(&self, off_hz: f64) -> Complex<f64> {
        let middle_s = |part: usize| self.begin_s + (part as f64 + 0.5) * part_s(self.hz);
        let turned = |(part, sum): (usize, &Complex<f64>)| sum * Complex::cis(-TAU * off_hz * middle_s(part));
        self.parts.iter().enumerate().map(turned).sum()
    }
}

/// Time in which the frequencies around this one fall apart by a small part of a period.
fn part_s(hz: f64) -> f64 {
    1.0 / (FINER * CLOCK_TOLERANCE * hz)
}

/// Mean of a spectrum beside its peak.
fn mean_beside(powers: &[f64], peak: usize, width: f64) -> f64 {
    let is_beside = |index: &usize| BESIDE.contains(&(index.abs_diff(peak) as f64 / width));
    let beside = || (0..powers.len()).filter(is_beside).map(|index| powers[index]);
    beside().sum::<f64>() / beside().count().max(1) as f64
}

/// A value less the mean around it, unless one of them is missing.
type Quick = Option<Complex<f64>>;

/// The same of all rows, from the value of each row of a stretch.
fn quick(data: &Dataset, value: impl Fn(&Range<usize>, usize) -> Complex<f64>) -> Vec<Quick> {
    let side = ((AROUND_S / data.interval_s) as usize).max(1);
    let mut quick = vec![None; data.len()];
    for Stretch { rows, .. } in &data.stretches {
        let values: Vec<Complex<f64>> = rows.clone().map(|row| value(rows, row)).collect();
        quick[rows.clone()].copy_from_slice(&less_the_mean(&values, side));
    }
    quick
}

/// Values less the mean of so many on either side.
fn less_the_mean(values: &[Complex<f64>], side: usize) -> Vec<Quick> {
    let mut sums: Vec<(Complex<f64>, usize)> = vec![(Complex::default(), 0)];
    for value in values {
        let (sum, missing) = sums[sums.len() - 1];
        let is_missing = !(value.re.is_finite() && value.im.is_finite());
        sums.push(if is_missing { (sum, missing + 1) } else { (sum + value, missing) });
    }
    let at = |index: usize| {
        let around = index.checked_sub(side)?..(index + side + 1);
        let (before, after) = (sums[around.start], sums.get(around.end)?);
        (before.1 == after.1).then(|| values[index] - (after.0 - before.0) / around.len() as f64)
    };
    (0..values.len()).map(at).collect()
}
