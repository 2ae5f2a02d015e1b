//! The recorded command and the recorded angle, cut into the steps of a simulation. They are the same for all models with
//! one delay, so what simulates many models cuts them once.

use super::{Course, Motion, Prediction, Steps, acts_by_angle, longest_step_s, read, run::Run};
use crate::configuration::free_run::replay::{
    HARDLY_MORE, LEAP, LONGEST_OF_SLOW_S, LONGEST_S, MOST_KEPT, NOT_ZERO, OF_LEAP,
};
use crate::dataset::{Dataset, Latch, Measured, Output, Stretch, Window};
use motorbench_model::{Model, SAME_LENGTH_S};
use std::cell::Cell;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// Simulates models on the same data.
pub struct Replay<'a> {
    /// The data.
    pub data: &'a Dataset,
    kept: Mutex<Vec<(Cutting, Arc<[Cut]>)>>,
}

impl<'a> Replay<'a> {
    /// Of all stretches.
    pub fn new(data: &'a Dataset) -> Self {
        Self { data, kept: Mutex::default() }
    }

    /// Drives the motor of the model with the recorded command.
    pub fn drive(&self, model: &Model, steps: Steps) -> Motion {
        let data = self.data;
        let mut motion = Motion::not_known(data.len());
        for (stretch, cut) in data.stretches.iter().zip(&*self.cuts(Cutting::of(model, data, steps))) {
            Run::new(model, data, stretch, cut).whole(&mut motion);
        }
        motion
    }

    /// What the sensors would have read.
    pub fn free_run(&self, model: &Model) -> Prediction {
        self.simulated(model, Steps::Fine).0
    }

    /// The same, and whether the model can be simulated. Otherwise a value that is no number is not a missing one.
    pub(crate) fn simulated(&self, model: &Model, steps: Steps) -> (Prediction, bool) {
        let motion = self.drive(model, steps);
        let is_possible = model.is_finite() && motion.is_finite(self.data);
        (read(model, self.data, motion), is_possible)
    }

    /// Steps for differences between simulations: fine ones where the coarse ones are hardly fewer. What was simulated in fine
    /// ones is then one side of the difference.
    pub(crate) fn or_fine(&self, model: &Model, steps: Steps) -> Steps {
        if steps != Steps::Coarse {
            return steps;
        }
        let cuttings = [Steps::Fine, steps].map(|steps| Cutting::of(model, self.data, steps));
        let mut counts = [0.0; 2];
        for stretch in &self.data.stretches {
            let leaps = stretch.rows.clone().skip(1).filter(|row| leaps(self.data, row - 1, *row)).count() as f64;
            let others = stretch.rows.len() as f64 - leaps;
            for (count, cutting) in counts.iter_mut().zip(&cuttings) {
                let longest_step_s = cutting.longest_step_s(stretch);
                let of = |longest_step_s: f64| steps_in(stretch.interval_s, longest_step_s);
                *count += others * of(longest_step_s) + leaps * of(OF_LEAP * longest_step_s);
            }
        }
        let [fine, coarse] = counts;
        if fine < HARDLY_MORE * coarse { Steps::Fine } else { steps }
    }

    fn cuts(&self, cutting: Cutting) -> Arc<[Cut]> {
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, cuts)) = kept().iter().find(|(known, _)| *known == cutting) {
            return Arc::clone(cuts);
        }
        let cuts: Arc<[Cut]> =
            self.data.stretches.iter().map(|stretch| Cut::new(self.data, stretch, cutting)).collect();
        let mut kept = kept();
        if kept.len() >= MOST_KEPT {
            kept.remove(0);
        }
        kept.push((cutting, Arc::clone(&cuts)));
        cuts
    }
}

/// What decides where the steps begin and end, and what acts in them.
#[derive(Clone, Copy, PartialEq)]
struct Cutting {
    steps: Steps,
    /// Longest step that the terms of the model allow.
    longest_step_s: f64,
    delay_s: f64,
    /// By how much the delay grows in each second of the recording.
    delay_growth: f64,
    /// Whether a term depends on the angle.
    by_angle: bool,
}

impl Cutting {
    fn of(model: &Model, data: &Dataset, steps: Steps) -> Self {
        Self {
            steps,
            longest_step_s: longest_step_s(model),
            delay_s: model.delay_s() + data.origin.timing.command_delay_s.unwrap_or(0.0),
            delay_growth: model.delay_growth(),
            by_angle: acts_by_angle(model),
        }
    }

    fn longest_step_s(&self, stretch: &Stretch) -> f64 {
        let usual_step_s = (0.1 * stretch.interval_s).clamp(LONGEST_S, LONGEST_OF_SLOW_S);
        self.longest_step_s.min(match self.steps {
            Steps::Fine => usual_step_s,
            Steps::Coarse => 2.0 * usual_step_s,
            Steps::Halved => 0.5 * usual_step_s.min(stretch.interval_s),
            Steps::AtMost(step_s) => step_s.min(usual_step_s),
        })
    }
}

/// A part of a step in which one voltage acts, or one with a small change.
struct Part {
    since_s: f64,
    length_s: f64,
    command: f64,
    duty: f64,
    change: Option<Change>,
    open: bool,
}

/// A change of the command within a step.
#[derive(Clone, Copy)]
pub(super) struct Change {
    /// By how much.
    pub by: f64,
    /// The same of the duty's magnitude.
    pub by_share: f64,
    /// For how long the step goes on after it.
    pub rest_s: f64,
}

/// One step of the simulation.
pub(super) struct Piece {
    /// Its begin.
    pub time_s: f64,
    pub length_s: f64,
    /// The command, as [`Dataset::command`], and its duty: the mean, or after the change.
    pub command: f64,
    /// A change of the voltage within it.
    pub change: Option<Change>,
    pub duty: f64,
    /// The duty over the whole period of the PWM.
    pub mean_duty: f64,
    /// Whether the bridge is open.
    pub open: bool,
    /// Recorded angle in its middle, and the turn over it; 0 where no term depends on them.
    pub angle_rad: f64,
    pub turned_rad: f64,
}

/// A stretch in steps.
pub(super) struct Cut {
    /// Current and speed at its first row.
    pub begins_with: (f64, f64),
    pieces: Vec<Piece>,
    /// The first piece of each row.
    first_pieces: Vec<usize>,
}

impl Cut {
    fn new(data: &Dataset, stretch: &Stretch, cutting: Cutting) -> Self {
        let knife = Knife::new(data, stretch, cutting);
        let rows = stretch.rows.clone();
        let mut pieces = Vec::with_capacity(2 * rows.len());
        let mut first_pieces = Vec::with_capacity(rows.len());
        for index in rows.start..rows.end - 1 {
            first_pieces.push(pieces.len());
            knife.row(index, &mut pieces);
        }
        first_pieces.push(pieces.len());
        Self { begins_with: knife.begins_with, pieces, first_pieces }
    }

    /// The steps from a row of the stretch to the next one.
    pub fn row(&self, row: usize) -> &[Piece] {
        &self.pieces[self.first_pieces[row]..self.first_pieces[row + 1]]
    }
}

fn first(values: &[f64]) -> f64 {
    values.iter().take(5).copied().find(|value| value.is_finite()).unwrap_or(0.0)
}

/// Speed at the start of a stretch. A mean over a window that begins there gives the speed of its middle. Two
/// successive means are extrapolated back to the start, but not through a standstill: a shaft that begins to move
/// within the second one stood before.
fn first_speed(motion: &Measured, stretch: &Stretch) -> f64 {
    let values = &motion.values[stretch.rows.clone()];
    if matches!(motion.output, Output::Speed | Output::TimedSpeed) {
        return first(values);
    }
    // A program's own mean begins at zero only where the shaft stands.
    if values.first().is_some_and(|first| first.abs() < NOT_ZERO * motion.noise) {
        return 0.0;
    }
    let Window { span, ahead } = stretch.window;
    let mean = |windows: usize| values.get(windows * span - ahead).copied();
    match (mean(1), mean(2)) {
        (Some(one), Some(two)) if one.is_finite() && two.is_finite() => {
            let first = 1.5 * one - 0.5 * two;
            if first * one > 0.0 { first } else { 0.0 }
        }
        _ => 0.0,
    }
}

/// Whether the voltage jumps from the command of one sample to that of another: the current may turn round.
fn leaps(data: &Dataset, from: usize, to: usize) -> bool {
    (data.command[to] - data.command[from]).abs() > LEAP * data.supply_v[from]
}

/// Number of steps of a row.
fn steps_in(interval_s: f64, longest_step_s: f64) -> f64 {
    (interval_s / longest_step_s - 1e-6).ceil().max(1.0)
}

/// Cuts a stretch.
struct Knife<'a> {
    data: &'a Dataset,
    range: Range<usize>,
    delay_s: f64,
    delay_growth: f64,
    longest_step_s: f64,
    begins_with: (f64, f64),
    /// Whether a command may begin to act within a step.
    acts_within: bool,
    /// Whether a command may wait for the next period of the PWM.
    may_wait: bool,
    /// Whether neither current nor motion shows that the first command acted before its row.
    from_rest: bool,
    by_angle: bool,
    /// The sample that was found last.
    recent: Cell<usize>,
}

impl<'a> Knife<'a> {
    fn new(data: &'a Dataset, stretch: &Stretch, cutting: Cutting) -> Self {
        let range = stretch.rows.clone();
        let current_a = data.current().map_or(0.0, |measured| first(&measured.values[range.clone()]));
        let motion = data.motion();
        let speed_rad_per_s = first_speed(motion, stretch);
        let may_be_zero = |value: f64, measured: &Measured| value.abs() < NOT_ZERO * measured.noise;
        let still = may_be_zero(speed_rad_per_s, motion);
        let Cutting { delay_s, delay_growth, .. } = cutting;
        let may_wait = data.may_wait() && data.origin.latch != Latch::AtOnce;
        Self {
            data,
            range,
            delay_s,
            delay_growth,
            longest_step_s: cutting.longest_step_s(stretch),
            begins_with: if still { (0.0, 0.0) } else { (current_a, speed_rad_per_s) },
            from_rest: still && data.current().is_none_or(|measured| may_be_zero(current_a, measured)),
            acts_within: delay_s > 0.0 || delay_growth != 0.0 || data.has_moments() || may_wait,
            may_wait,
            by_angle: cutting.by_angle,
            recent: Cell::new(stretch.rows.start),
        }
    }

    /// The steps from row `index` to the next one.
    fn row(&self, index: usize, pieces: &mut Vec<Piece>) {
        let data = self.data;
        if data.is_switched() {
            self.switched_row(index, pieces);
            return;
        }
        let interval_s = data.time_s[index + 1] - data.time_s[index];
        let acting = |since_s: f64| self.acting_at(index, self.taken_s(index, since_s));
        let (first, last) = (acting(0.0), acting(interval_s));
        let longest_step_s =
            self.longest_step_s * if leaps(data, self.acting_before(index), last) { OF_LEAP } else { 1.0 };
        let steps = steps_in(interval_s, longest_step_s);
        let step_s = interval_s / steps;
        let course = self.course(index);
        let mut before = first;
        for step in 0..steps as usize {
            let since_s = step as f64 * step_s;
            // Mostly one command acts from the one sample to the next.
            let after = if first == last { first } else { acting(since_s + step_s) };
            for part in self.parts(index, (since_s, step_s), (before, after)).into_iter().flatten() {
                let Part { since_s, length_s, command, duty, change, open } = part;
                let middle = (since_s + 0.5 * length_s) / interval_s;
                let [angle_rad, turned_rad] = Course::around(course.as_ref(), middle, 0.5 * length_s / interval_s);
                let time_s = data.time_s[index] + since_s;
                let mean_duty = duty;
                pieces.push(Piece { time_s, length_s, command, change, duty, mean_duty, open, angle_rad, turned_rad });
            }
            before = after;
        }
    }

    /// The parts of a step after sample `index`: where the bridge opens or closes, or the voltage jumps, another part begins. A
    /// mean voltage over the whole step would reverse the current too early, and the drop with it. `before` and `after`: the
    /// samples whose commands act at its begin and at its end.
    fn parts(
        &self,
        index: usize,
        (since_s, length_s): (f64, f64),
        (before, after): (usize, usize),
    ) -> [Option<Part>; 2] {
        let data = self.data;
        let part = |since_s: f64, length_s: f64, row: usize, change: Option<Change>| {
            let (command, duty, open) = (data.command[row], data.duty[row], data.open[row]);
            Some(Part { since_s, length_s, command, duty, change, open })
        };
        // Before a start from rest no command acted.
        let has_begun = before > self.range.start || !self.from_rest;
        if has_begun && after == before {
            return [part(since_s, length_s, after, None), None];
        }
        let reverses = |row: usize| data.duty[row] * data.duty[before] < 0.0;
        let switches =
            |row: &usize| data.open[*row] != data.open[before] || leaps(data, before, *row) || reverses(*row);
        let acts_s = |row: usize| self.acts_s(index, row) - data.time_s[index] - since_s;
        let is_within = |first_s: &f64| (SAME_LENGTH_S..length_s - SAME_LENGTH_S).contains(first_s);
        let is_next = after == before + 1 || data.waits_in_phase();
        if has_begun && is_next && data.axis.drive.is_voltage() {
            let first_s = acts_s(after);
            let rest_s = length_s - first_s;
            if is_within(&first_s) && switches(&after) {
                return [part(since_s, first_s, before, None), part(since_s + first_s, rest_s, after, None)];
            } else if is_within(&first_s) {
                let by = data.command[after] - data.command[before];
                let by_share = data.duty[after].abs() - data.duty[before].abs();
                return [part(since_s, length_s, after, Some(Change { by, by_share, rest_s })), None];
            }
        }
        let mean = |since_s: f64, length_s: f64| {
            if data.waits_in_phase() {
                return self.waiting_part(index, since_s, length_s);
            }
            let (command, duty) = self.command(index, self.taken_s(index, since_s), length_s);
            let acting = self.acting_at(index, self.taken_s(index, since_s + 0.5 * length_s));
            Some(Part { since_s, length_s, command, duty, change: None, open: data.open[acting] })
        };
        let jumps = if has_begun { (before + 1..=after).find(switches) } else { Some(before) };
        match jumps.map(acts_s).filter(is_within) {
            Some(first_s) => [mean(since_s, first_s), mean(since_s + first_s, length_s - first_s)],
            None => [mean(since_s, length_s), None],
        }
    }

    /// A part of a step in which the command of one sample acts, or none before a start from rest.
    fn waiting_part(&self, index: usize, since_s: f64, length_s: f64) -> Option<Part> {
        let data = self.data;
        let middle_s = since_s + 0.5 * length_s;
        let row = self.acting_at(index, self.taken_s(index, middle_s));
        let has_begun = !self.from_rest || self.acts_s(index, row) < data.time_s[index] + middle_s;
        let (command, duty) = if has_begun { (data.command[row], data.duty[row]) } else { (0.0, 0.0) };
        Some(Part { since_s, length_s, command, duty, change: None, open: data.open[row] })
    }

    /// The recorded angle after a sample, where a term depends on it.
    fn course(&self, index: usize) -> Option<Course> {
        self.by_angle.then(|| Course::new(self.data, self.range.clone(), index))
    }

    /// The same with every edge of the PWM. A command waits for the next period where the compare registers of the timer
    /// are double buffered (ATmega328P data sheet, 15.7 and 16.9).
    fn switched_row(&self, index: usize, pieces: &mut Vec<Piece>) {
        let data = self.data;
        let (mut from_s, to_s) = (data.time_s[index], data.time_s[index + 1]);
        let interval_s = to_s - from_s;
        let course = self.course(index);
        while from_s < to_s - SAME_LENGTH_S {
            let [begun_s, next_s] = data.origin.period_around_s(from_s + SAME_LENGTH_S);
            let at_once = data.origin.latch == Latch::AtOnce;
            let (row, mean_duty) = self.taken_at(index, if at_once { from_s } else { begun_s });
            let changes_s = if at_once { self.changes_s(index, row) } else { f64::INFINITY };
            let pulse_s = begun_s + data.origin.pulse.begins_at(mean_duty) * (next_s - begun_s);
            let pulse_ends_s = pulse_s + mean_duty.abs() * (next_s - begun_s);
            let ends_s = [pulse_s, pulse_ends_s, next_s].into_iter().find(|edge_s| from_s < edge_s - SAME_LENGTH_S);
            let ends_s = ends_s.unwrap_or(next_s);
            let is_pulse = from_s >= pulse_s - SAME_LENGTH_S && ends_s <= pulse_ends_s + SAME_LENGTH_S;
            let length_s = (ends_s.min(to_s).min(changes_s) - from_s).min(self.longest_step_s);
            let middle = (from_s + 0.5 * length_s - data.time_s[index]) / interval_s;
            let [angle_rad, turned_rad] = Course::around(course.as_ref(), middle, 0.5 * length_s / interval_s);
            pieces.push(Piece {
                time_s: from_s,
                length_s,
                command: if is_pulse { data.command[row] / mean_duty.abs() } else { 0.0 },
                change: None,
                duty: if is_pulse { mean_duty.signum() } else { 0.0 },
                mean_duty,
                open: data.open[row],
                angle_rad,
                turned_rad,
            });
            from_s += length_s;
        }
    }

    /// The sample whose command a period around sample `index` takes, and its duty.
    fn taken_at(&self, index: usize, begun_s: f64) -> (usize, f64) {
        let data = self.data;
        let at_s = begun_s - self.delay_at(index) + SAME_LENGTH_S;
        match self.acting_until(self.last_acting(index, at_s), at_s) {
            Some(row) => (row, data.duty[row]),
            // Before a start from rest no command acted.
            None => (self.range.start, if self.from_rest { 0.0 } else { data.duty[self.range.start] }),
        }
    }

    /// When the command after that of `row` acts, as the delay is around sample `index`.
    fn changes_s(&self, index: usize, row: usize) -> f64 {
        if row + 1 < self.range.end { self.acts_s(index, row + 1) } else { f64::INFINITY }
    }

    /// The sample whose command acts until sample `index`.
    fn acting_before(&self, index: usize) -> usize {
        match self.acts_within {
            true => self.acting_at(index, self.taken_s(index, -SAME_LENGTH_S) - SAME_LENGTH_S),
            false => index.max(self.range.start + 1) - 1,
        }
    }

    /// By how much a command comes late around a row.
    fn delay_at(&self, index: usize) -> f64 {
        self.delay_s + self.delay_growth * self.data.time_s[index]
    }

    /// When the command of a row acts, as the delay is around sample `index`.
    fn acts_s(&self, index: usize, row: usize) -> f64 {
        let comes_s = self.data.acts_from_s(row) + self.delay_at(index);
        if self.may_wait { comes_s + self.data.wait_s(comes_s) } else { comes_s }
    }

    /// After sample `index`, until when a command was sent that may act `since_s` after it.
    fn taken_s(&self, index: usize, since_s: f64) -> f64 {
        let data = self.data;
        let waited_s = if self.may_wait { data.waited_s(data.time_s[index] + since_s) } else { 0.0 };
        since_s - waited_s - self.delay_at(index)
    }

    /// The sample whose command acts at this time after sample `index`.
    fn acting_at(&self, index: usize, offset_s: f64) -> usize {
        let data = self.data;
        if !self.acts_within {
            return index;
        }
        let at_s = data.time_s[index] + offset_s;
        self.acting_until(self.last_acting(index, at_s), at_s).unwrap_or(self.range.start)
    }

    /// The last sample up to `last` whose command acts at this time.
    fn acting_until(&self, last: usize, at_s: f64) -> Option<usize> {
        let data = self.data;
        if data.has_moments() {
            return (self.range.start..=last).rev().find(|row| data.acts_from_s(*row) <= at_s);
        }
        // Mostly the one that was found last, or one beside it.
        let (first, mut row) = (self.range.start, self.recent.get().min(last));
        while row < last && data.time_s[row + 1] <= at_s {
            row += 1;
        }
        while row > first && data.time_s[row] > at_s {
            row -= 1;
        }
        self.recent.set(row);
        (data.time_s[row] <= at_s).then_some(row)
    }

    /// The last sample, from `index` on, whose command acts before `end_s`.
    fn last_acting(&self, index: usize, end_s: f64) -> usize {
        let may_act_early = self.data.has_moments() || self.delay_growth < 0.0;
        let later = (index + 1..self.range.end).take_while(|row| may_act_early && self.data.acts_from_s(*row) < end_s);
        later.last().unwrap_or(index)
    }

    /// Means of command and duty, each held until the next acts, over `length_s` from `offset_s` after sample `index`.
    fn command(&self, index: usize, offset_s: f64, length_s: f64) -> (f64, f64) {
        let data = self.data;
        let from_s = data.time_s[index] + offset_s;
        let mut end_s = from_s + length_s;
        let mut sample = self.last_acting(index, end_s);
        if sample == index && (offset_s >= 0.0 || index == self.range.start && !self.from_rest) {
            return (data.command[index], data.duty[index]);
        }
        let (mut command, mut duty) = (0.0, 0.0);
        // Those after it act later.
        sample = self.acting_until(sample, end_s).unwrap_or(self.range.start);
        loop {
            let acts_before = sample == self.range.start && !self.from_rest;
            let start_s = if acts_before { f64::NEG_INFINITY } else { data.acts_from_s(sample) };
            let since_s = start_s.max(from_s);
            if since_s < end_s {
                command += data.command[sample] * (end_s - since_s);
                duty += data.duty[sample] * (end_s - since_s);
                end_s = since_s;
            }
            // Before a start from rest no command acted.
            if since_s <= from_s || sample == self.range.start {
                return (command / length_s, duty / length_s);
            }
            sample -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::Prior;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use proptest::prelude::*;
    use std::f64::consts::TAU;
    use std::fmt::Write as _;

    /// A recording that begins with a step, before the delay has passed.
    #[test]
    fn what_begins_to_move_within_the_second_window_stood_before() {
        let mut text = String::from("t_s,duty,counts\n");
        for row in 0..200 {
            let since_s = f64::max(0.0, f64::from(row) * 1e-3 - 4e-3);
            let _ = writeln!(text, "{},0.8,{}", f64::from(row) * 1e-3, (2e6 * since_s * since_s).floor());
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        let rig = "[supply]\nvoltage_V = 12\n[encoder]\ncounts_per_rev = 2000\n";
        let data = Dataset::new(&[recording], &Rig::parse("rig.toml", rig).unwrap()).unwrap();
        assert_eq!(first_speed(data.motion(), &data.stretches[0]), 0.0);
    }

    /// A mean of no command and the first one would start the motor too early, with another duty.
    #[test]
    fn a_first_command_that_is_late_is_cut_where_it_begins() {
        let rows: String = (0..200).map(|row| format!("{},0.8,{}\n", f64::from(row) * 1e-3, row * row)).collect();
        let recording = Recording::parse("run.csv", format!("t_s,duty,counts\n{rows}").as_bytes(), &[]).unwrap();
        let rig =
            "[supply]\nvoltage_V = 12\n[encoder]\ncounts_per_rev = 2000\n[recording]\ncommand_delay_s = 0.00037\n";
        let rig = Rig::parse("rig.toml", rig).unwrap();
        let data = Dataset::new(&[recording], &rig).unwrap();
        let cutting = Cutting::of(&Model::linear(Prior::new(&rig.motor, &data).motor), &data, Steps::Fine);
        let cut = Cut::new(&data, &data.stretches[0], cutting);
        let late_s: f64 = cut.row(0).iter().filter(|piece| piece.duty == 0.0).map(|piece| piece.length_s).sum();
        assert!((late_s - 0.00037).abs() < 1e-9, "{late_s}");
        assert!(cut.row(0).iter().all(|piece| [0.0, 0.8].contains(&piece.duty)));
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]
        /// No duty makes the current jump, whenever in a period of the PWM it is taken.
        #[test]
        fn the_current_is_continuous(
            phase in 0.0_f64..1.0,
            at_once: bool,
            duties in proptest::collection::vec(-1.0_f64..1.0, 8),
        ) {
            let (interval_s, pwm_hz) = (1e-5, 3921.57);
            let mut text = String::from("t_s,duty,omega_rad_per_s,i_A\n");
            for row in 0..800_usize {
                let _ = writeln!(text, "{:.5},{},{row},0.{}", row as f64 * interval_s, duties[row / 100], row % 7);
            }
            let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
            let rig = format!("[supply]\nvoltage_V = 12\n[bridge]\npwm_Hz = {pwm_hz}\n[motor]\ninductance_H = 0.005\n");
            let rig = Rig::parse("rig.toml", &rig).unwrap();
            let latch = if at_once { Latch::AtOnce } else { Latch::WithPeriod };
            let data = Dataset::new(&[recording], &rig).unwrap().with_pwm_phase(Some(phase)).with_latch(latch);
            let model = Model::linear(Prior::new(&rig.motor, &data).motor);
            let current_a = Replay::new(&data).drive(&model, Steps::Fine).current_a;
            // The supply, what motion induces and what the resistance takes.
            let most_a = 2.0 * 12.0 / 5e-3 * interval_s;
            for pair in current_a.windows(2) {
                prop_assert!((pair[1] - pair[0]).abs() < most_a, "{pair:?}");
            }
        }
    }

    proptest! {
        /// A stretch that begins in motion starts at that speed, and one from rest at zero.
        #[test]
        fn a_stretch_begins_as_fast_as_its_counts_say(speed in -300.0_f64..300.0, from_rest: bool) {
            let mut text = String::from("t_s,u_V,counts\n");
            let acceleration = if from_rest { 20.0 * speed } else { 0.0 };
            let start = if from_rest { 0.0 } else { speed };
            for row in 0..200 {
                let time_s = f64::from(row) * 1e-3;
                let counts = (start * time_s + 0.5 * acceleration * time_s * time_s) * 2000.0 / TAU;
                let _ = writeln!(text, "{time_s},{},{}", if row < 50 { 12 } else { 0 }, counts.floor());
            }
            prop_assume!(speed.abs() > 20.0);
            let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
            let rig = "[supply]\nvoltage_V = 12\n[encoder]\ncounts_per_rev = 2000\n";
            let data = Dataset::new(&[recording], &Rig::parse("rig.toml", rig).unwrap()).unwrap();
            let first = first_speed(data.motion(), &data.stretches[0]);
            // One count over the window in the worst case.
            prop_assert!((first - start).abs() < 2.0 * TAU / 2000.0 / 5e-3, "{first} {start}");
        }
    }
}
