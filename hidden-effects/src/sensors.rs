//! The recording: the readings of the Uno's sensors at the bench.

use crate::drive::{Excitation, SpeedLoop, duties};
use crate::rig::{Bench, Lag};
use crate::{Channels, Effect, Mistake, Recipe};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::fmt::Write as _;

/// Of a digital filter, as half an angle a row.
const HIGHEST_CORNER: f64 = 1.5;
/// Step of the oversampled current reading.
pub const CURRENT_STEP_A: f64 = 0.0066;
const CURRENT_NOISE_A: f64 = 0.010;
/// Noise of the speed as a share of the top speed.
const SPEED_NOISE: f64 = 0.0015;

/// A conversion of the Uno's converter.
const CONVERSION_S: f64 = 0.104e-3;

/// Successive conversions; each row has the mean of those that ended with it.
struct Burst {
    conversions: usize,
    readings_a: VecDeque<f64>,
}

impl Burst {
    fn new(random: &mut impl Rng) -> Self {
        Self { conversions: random.random_range(4..=19), readings_a: VecDeque::new() }
    }

    fn add(&mut self, reading_a: f64) {
        self.readings_a.push_back(reading_a);
        if self.readings_a.len() > self.conversions {
            self.readings_a.pop_front();
        }
    }

    fn mean_a(&self) -> f64 {
        self.readings_a.iter().sum::<f64>() / self.readings_a.len().max(1) as f64
    }
}

/// Edges that a coarse encoder may have in a revolution.
const EDGES_PER_REV: [f64; 7] = [11.0, 16.0, 20.0, 24.0, 44.0, 64.0, 100.0];
/// Polling interval, and the step of `micros()` on an Uno.
const LOOK_S: f64 = 20e-6;
const CLOCK_S: f64 = 4e-6;
/// After this long without an edge the program reports standstill.
const AT_REST_S: f64 = 0.2;

/// A program that times the edges of an encoder.
struct EdgeTimer {
    edges_per_rev: f64,
    since_row_before: bool,
    passed: f64,
    /// Edges up to the last one, and its time.
    last: (f64, f64),
    /// The same when the last speed was taken.
    used: (f64, f64),
    speed: f64,
}

impl EdgeTimer {
    fn new(random: &mut impl Rng) -> Self {
        Self {
            edges_per_rev: EDGES_PER_REV[random.random_range(0..EDGES_PER_REV.len())],
            since_row_before: random.random_bool(0.5),
            passed: 0.0,
            last: (0.0, 0.0),
            used: (0.0, 0.0),
            speed: 0.0,
        }
    }

    /// Moves the shaft from one angle to the next.
    fn look(&mut self, from_rad: f64, to_rad: f64, now_s: f64) {
        let edges = |angle_rad: f64| angle_rad / TAU * self.edges_per_rev + 0.5;
        let (from, to) = (edges(from_rad), edges(to_rad));
        let now = to.floor();
        if now == self.passed {
            return;
        }
        let edge = now.max(self.passed);
        let share = if to == from { 1.0 } else { ((edge - from) / (to - from)).clamp(0.0, 1.0) };
        let at_s = ((now_s - (1.0 - share) * LOOK_S) / CLOCK_S).floor() * CLOCK_S;
        if !self.since_row_before {
            self.speed = self.speed_since(self.last, (now, at_s));
        }
        self.passed = now;
        self.last = (now, at_s);
    }

    fn speed_since(&self, (edges, at_s): (f64, f64), (now, now_s): (f64, f64)) -> f64 {
        (now - edges) / self.edges_per_rev * TAU / (now_s - at_s).max(CLOCK_S)
    }

    fn row(&mut self, now_s: f64) -> f64 {
        let since_s = now_s - self.last.1;
        if self.since_row_before {
            if self.last.0 != self.used.0 {
                self.speed = self.speed_since(self.used, self.last);
                self.used = self.last;
            } else {
                let most = TAU / self.edges_per_rev / since_s.max(CLOCK_S);
                self.speed = self.speed.clamp(-most, most);
            }
        }
        if since_s > AT_REST_S {
            self.speed = 0.0;
        }
        self.speed
    }
}

struct Row {
    time_s: f64,
    duty: f64,
    counts: f64,
    speed: f64,
    current_a: f64,
}

/// A low-pass in the program that records: exponential smoothing, or a Butterworth filter of the first order.
#[derive(Default)]
struct LowPass {
    filtered: f64,
    last: f64,
}

impl LowPass {
    /// The filtered value a row later.
    fn next(&mut self, value: f64, lag: Lag, interval_s: f64) -> f64 {
        let rows = lag.time_constant_s / interval_s;
        self.filtered = if lag.is_butterworth {
            // The analog corner, moved to where the bilinear transform puts it back; none is above half the rate.
            let analog = 2.0 * (0.5 / rows).min(HIGHEST_CORNER).tan();
            ((2.0 - analog) * self.filtered + analog * (value + self.last)) / (2.0 + analog)
        } else {
            let keep = (-1.0 / rows).exp();
            keep * self.filtered + (1.0 - keep) * value
        };
        self.last = value;
        self.filtered
    }
}

/// Drives the bench and records it.
pub fn record(mut bench: Bench, recipe: &Recipe, random: &mut impl Rng) -> String {
    let count = (recipe.duration_s * recipe.rate_hz) as usize;
    let mut duty = duties(recipe.excitation, count, recipe.rate_hz, random);
    let mut speed_loop =
        (recipe.excitation == Excitation::ClosedLoop).then(|| SpeedLoop::new(count, recipe.rate_hz, random));
    let interval_s = 1.0 / recipe.rate_hz;
    let tacho = recipe.effects.iter().any(|(effect, _)| *effect == Effect::TachoRipple);
    bench.hidden.ripple_phase = random.random_range(0.0..TAU);
    let drift_hz = random.random_range(0.05..0.15);
    let mut burst = recipe.burst.then(|| Burst::new(random));
    let mut edge_timer = (recipe.channels == Channels::VoltageTimedSpeedCurrent).then(|| EdgeTimer::new(random));
    let (mut low_passed_current, mut low_passed_speed) = (LowPass::default(), LowPass::default());
    let (mut lost_rad, mut shown_rad) = (0.0, bench.seen_rad());
    let mut edges = Edges { per_rad: bench.counts_per_rev / TAU, last: 0.0 };
    let mut rows = Vec::with_capacity(count);
    let speed_noise = SPEED_NOISE * bench.top_speed * if tacho { 2.0 } else { 1.0 };
    for index in 0..count {
        let hidden = &bench.hidden;
        let uncounted = bench.uncounted();
        let passed_rad = bench.seen_rad() - std::mem::replace(&mut shown_rad, bench.seen_rad());
        lost_rad += match hidden.lost_at_random {
            // All of them, to the last.
            _ if bench.counter_stands() => passed_rad,
            true => edges.lost(bench.angle, uncounted / bench.speed, random) * TAU / bench.counts_per_rev,
            false => uncounted * interval_s,
        };
        let turn = bench.angle + hidden.eccentricity_phase;
        let seen_rad = shown_rad - lost_rad;
        let mut seen_speed = bench.shown_rad_per_s() * (1.0 + hidden.eccentricity_rad * turn.cos()) - uncounted;
        seen_speed *= 1.0 + hidden.drift * (TAU * drift_hz * bench.time_s).sin();
        if seen_speed.abs() < hidden.dead_band {
            seen_speed = 0.0;
        }
        let mut seen_a = burst.as_ref().map_or(bench.reading_a(), Burst::mean_a);
        if hidden.current_lag.in_program {
            seen_a = low_passed_current.next(seen_a, hidden.current_lag, interval_s);
        }
        let noise = |random: &mut _| -> f64 { StandardNormal.sample(random) };
        let mut speed = seen_speed + speed_noise * noise(random);
        if hidden.speed_lag.in_program {
            speed = low_passed_speed.next(speed, hidden.speed_lag, interval_s);
        }
        if let Some(speed_loop) = &mut speed_loop {
            duty[index] = speed_loop.duty(index, speed / bench.top_speed);
        }
        let speed = edge_timer.as_mut().map_or(speed, |timer| timer.row(bench.time_s));
        rows.push(Row {
            time_s: index as f64 * interval_s,
            duty: duty[index],
            counts: (seen_rad / TAU * bench.counts_per_rev).floor(),
            speed,
            current_a: seen_a + hidden.offset_a + CURRENT_NOISE_A * noise(random),
        });
        pass(&mut bench, &duty, index, interval_s, (burst.as_mut(), edge_timer.as_mut()));
    }
    csv(&as_written(rows, duty, &bench, recipe, random), &bench, recipe.channels)
}

/// The rows that a program writes of what was read.
fn as_written(
    mut rows: Vec<Row>,
    mut duty: Vec<f64>,
    bench: &Bench,
    recipe: &Recipe,
    random: &mut impl Rng,
) -> Vec<Row> {
    if recipe.written_after {
        duty.rotate_right(1);
        duty[0] = 0.0;
        rows.iter_mut().zip(&duty).for_each(|(row, acted)| row.duty = *acted);
    }
    if recipe.channels == Channels::VoltageMeanSpeedCurrent {
        average_speed(&mut rows, bench.counts_per_rev, recipe.rate_hz, random);
    }
    clip(&mut rows, bench.hidden.clip_share);
    if recipe.one_row_of > 1 {
        let first = random.random_range(0..recipe.one_row_of);
        rows = rows.into_iter().skip(first).step_by(recipe.one_row_of).collect();
        let start_s = rows.first().map_or(0.0, |row| row.time_s);
        rows.iter_mut().for_each(|row| row.time_s -= start_s);
    }
    if let Some(Mistake::CurrentScale(factor)) = recipe.mistake {
        rows.iter_mut().for_each(|row| row.current_a *= factor);
    }
    rows
}

/// Edges of the encoder that come one by one.
struct Edges {
    per_rad: f64,
    last: f64,
}

impl Edges {
    /// Lost edges up to an angle, each lost with a probability; forwards less backwards.
    fn lost(&mut self, angle_rad: f64, probability: f64, random: &mut impl Rng) -> f64 {
        let now = (angle_rad * self.per_rad).floor();
        let passed = now - std::mem::replace(&mut self.last, now);
        // At standstill the quotient of two speeds is undefined.
        let probability = if probability.is_finite() { probability.clamp(0.0, 1.0) } else { 0.0 };
        let lost = (0..passed.abs() as usize).filter(|_| random.random_bool(probability)).count();
        passed.signum() * lost as f64
    }
}

/// The program between two rows.
type Between<'a> = (Option<&'a mut Burst>, Option<&'a mut EdgeTimer>);

/// One sampling interval, the command late by the hidden delay, or early by the clock that gave it.
fn pass(bench: &mut Bench, duty: &[f64], index: usize, interval_s: f64, (mut burst, mut timer): Between) {
    let now_s = index as f64 * interval_s;
    let late = (bench.hidden.delay_s + bench.hidden.delay_growth * now_s) / interval_s;
    let whole = late.floor() as isize;
    let part = late - late.floor();
    let at = |back: isize| index.checked_add_signed(-back).map_or(0.0, |index| duty[index.min(duty.len() - 1)]);
    if part > 0.01 {
        run(bench, at(whole + 1), part * interval_s, (burst.as_deref_mut(), timer.as_deref_mut()));
    }
    if part < 0.99 {
        run(bench, at(whole), (1.0 - part) * interval_s, (burst, timer));
    }
}

/// Advances the bench under one duty, and runs the program.
fn run(bench: &mut Bench, duty: f64, duration_s: f64, between: Between) {
    match between {
        (Some(burst), _) => converting(bench, duty, duration_s, burst),
        (_, Some(timer)) => looking(bench, duty, duration_s, timer),
        _ => bench.run(duty, duration_s),
    }
}

fn converting(bench: &mut Bench, duty: f64, duration_s: f64, burst: &mut Burst) {
    let conversions = (duration_s / CONVERSION_S).round().max(1.0);
    for _ in 0..conversions as usize {
        bench.run(duty, duration_s / conversions);
        burst.add(bench.reading_a());
    }
}

fn looking(bench: &mut Bench, duty: f64, duration_s: f64, timer: &mut EdgeTimer) {
    let looks = (duration_s / LOOK_S).round().max(1.0);
    for _ in 0..looks as usize {
        let from_rad = bench.seen_rad();
        bench.run(duty, duration_s / looks);
        timer.look(from_rad, bench.seen_rad(), bench.time_s);
    }
}

/// Replaces the speeds by differences of counts over four to ten rows, up to the row itself or as far ahead as back.
fn average_speed(rows: &mut [Row], counts_per_rev: f64, rate_hz: f64, random: &mut impl Rng) {
    let half = random.random_range(2..=5);
    let (back, ahead) = if random.random_bool(0.5) { (2 * half, 0) } else { (half, half) };
    let counts: Vec<f64> = rows.iter().map(|row| row.counts).collect();
    let last = rows.len() - 1;
    for (index, row) in rows.iter_mut().enumerate() {
        let (from, to) = (index.saturating_sub(back), (index + ahead).min(last));
        row.speed = (counts[to] - counts[from]) / counts_per_rev * TAU * rate_hz / (to - from).max(1) as f64;
    }
}

fn clip(rows: &mut [Row], share: f64) {
    let peak_a = rows.iter().fold(0.0, |most: f64, row| most.max(row.current_a.abs()));
    let limit_a = share * peak_a;
    for row in rows {
        row.current_a = row.current_a.clamp(-limit_a, limit_a);
        row.current_a = (row.current_a / CURRENT_STEP_A).round() * CURRENT_STEP_A;
    }
}

fn csv(rows: &[Row], bench: &Bench, channels: Channels) -> String {
    let mut text = String::from(match channels {
        Channels::Full => "t_s,duty,u_V,counts,omega_rad_per_s,i_A\n",
        Channels::VoltageSpeedCurrent | Channels::VoltageMeanSpeedCurrent | Channels::VoltageTimedSpeedCurrent => {
            "t_s,u_V,omega_rad_per_s,i_A\n"
        }
        Channels::DutyCountsCurrent => "t_s,duty,counts,i_A\n",
        Channels::VoltageSpeed => "t_s,u_V,omega_rad_per_s\n",
    });
    for row in rows {
        let Row { time_s, duty, counts, speed, current_a } = row;
        let volts = duty * bench.supply_v;
        let _ = match channels {
            Channels::Full => writeln!(text, "{time_s:.4},{duty:.5},{volts:.4},{counts},{speed:.4},{current_a:.4}"),
            Channels::VoltageSpeedCurrent | Channels::VoltageMeanSpeedCurrent | Channels::VoltageTimedSpeedCurrent => {
                writeln!(text, "{time_s:.4},{volts:.4},{speed:.4},{current_a:.4}")
            }
            Channels::DutyCountsCurrent => writeln!(text, "{time_s:.4},{duty:.5},{counts},{current_a:.4}"),
            Channels::VoltageSpeed => writeln!(text, "{time_s:.4},{volts:.4},{speed:.4}"),
        };
    }
    text
}
