//! The current within one period of the PWM. Where that is short beside the electrical time constant it rises and falls
//! in straight lines. At the few hundred hertz of an Uno's unchanged timers it does so in exponentials.

mod cycle;
mod low_pass;

use cycle::Cycle;
use low_pass::{Piece, filtered};

/// A period of less than this share of the electrical time constant has straight lines.
const STRAIGHT: f64 = 0.2;

/// What drives the current through a period, in the direction of positive motion.
#[derive(Clone, Copy, Debug)]
pub struct Volts {
    /// Mean over the period that the bridge puts out.
    pub mean_v: f64,
    /// What motion takes of it.
    pub emf_v: f64,
    /// What the mean current loses in the resistance.
    pub lost_v: f64,
    /// What is lost in the bridge.
    pub drops: Drops,
}

/// What a current loses in the bridge, in volts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Drops {
    /// In the pulse, in the direction of the drive.
    pub pulse_v: f64,
    /// In the pulse, back into the supply.
    pub return_v: f64,
    /// In the off phase, whichever way it flows.
    pub off_v: f64,
}

impl Drops {
    fn are_none(&self) -> bool {
        self.pulse_v == 0.0 && self.return_v == 0.0 && self.off_v == 0.0
    }
}

/// What works against a current, of what a positive and a negative one lose.
#[inline]
pub fn against(current_a: f64, [positive_v, negative_v]: [f64; 2]) -> f64 {
    if current_a < 0.0 { -negative_v } else { positive_v }
}

/// A current between two others. Not `clamp`: a simulation that has left all bounds is judged by its error.
fn within(current_a: f64, least_a: f64, most_a: f64) -> f64 {
    current_a.max(least_a).min(most_a)
}

/// Which way a current flows through the bridge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    /// In the direction of the drive.
    With,
    /// Back into the supply.
    Against,
}

/// The PWM as the current sees it.
#[derive(Clone, Copy, Debug)]
pub struct Ripple {
    /// The direction of the drive; 0 without one.
    sense: f64,
    /// Where the supply drives.
    pulse: Part,
    /// The rest of the period.
    off: Part,
    /// What the current gains of a volt over a period; 0 if its ripple is left out.
    a_per_v: f64,
    /// The period over the electrical time constant; 0 for straight lines.
    decay: f64,
    /// What a whole period leaves of a current; 1 for straight lines.
    left: f64,
    /// Of a period that does not touch zero and swings by one ampere in straight lines.
    of_one_ampere: Swing,
}

/// A part of the period, and what a current becomes in it.
#[derive(Clone, Copy, Debug)]
struct Part {
    /// Of the period.
    share: f64,
    /// Of a current at its begin that is left at its end.
    left: f64,
    /// What a volt makes of no current, as a share of what it makes over a whole period without resistance.
    gained: f64,
}

impl Part {
    /// Of which so much is `left`.
    fn new(share: f64, decay: f64, left: f64) -> Self {
        Self { share, left, gained: if decay == 0.0 { share } else { (1.0 - left) / decay } }
    }

    /// Whether a current of this height is still there at its end, against what drives it towards zero.
    #[inline]
    fn is_too_short_for(&self, height_v: f64, driving_v: f64) -> bool {
        height_v * self.left >= driving_v * self.gained
    }
}

impl Ripple {
    /// Without a PWM.
    pub const NONE: Self = Self {
        sense: 0.0,
        pulse: Part { share: 0.0, left: 0.0, gained: 0.0 },
        off: Part { share: 0.0, left: 0.0, gained: 0.0 },
        a_per_v: 0.0,
        decay: 0.0,
        left: 1.0,
        of_one_ampere: Swing { pulse: 0.0, decay: 0.0, low_a: 0.0, high_a: 0.0, towards_a: 0.0 },
    };

    /// Of a motor at rest.
    pub fn new(inductance_h: f64, resistance_ohm: f64, pwm_hz: f64) -> Self {
        let decay = resistance_ohm / (inductance_h * pwm_hz);
        let decay = if decay < STRAIGHT { 0.0 } else { decay };
        Self { a_per_v: 1.0 / (inductance_h * pwm_hz), decay, left: (-decay).exp(), ..Self::NONE }.with_duty(0.0)
    }

    /// The same with a duty from -1 to 1.
    pub fn with_duty(mut self, duty: f64) -> Self {
        self.set_duty(duty);
        self
    }

    /// With a duty from -1 to 1.
    pub fn set_duty(&mut self, duty: f64) {
        let pulse = duty.abs().min(1.0);
        self.sense = if duty == 0.0 { 0.0 } else { duty.signum() };
        let left_after = |share: f64| if self.decay == 0.0 { 1.0 } else { (-self.decay * share).exp() };
        let left = left_after(pulse);
        // What a whole period and one part of it leave tells what the other part does, if that is not nothing.
        let off = 1.0 - pulse;
        let left_by_off = if self.left > f64::MIN_POSITIVE { self.left / left } else { left_after(off) };
        self.pulse = Part::new(pulse, self.decay, left);
        self.off = Part::new(off, self.decay, left_by_off);
        self.of_one_ampere = Swing::of_one_ampere(&self.pulse, &self.off, self.decay);
    }

    /// What is lost over a period in which the current stays positive, and in which it stays negative.
    #[inline]
    pub fn mean_drops_v(&self, Drops { pulse_v, return_v, off_v }: Drops) -> [f64; 2] {
        let mean_v = |in_pulse_v: f64| off_v + self.pulse.share * (in_pulse_v - off_v);
        if self.sense < 0.0 { [mean_v(return_v), mean_v(pulse_v)] } else { [mean_v(pulse_v), mean_v(return_v)] }
    }

    /// By how much these grow with the pulse's share of the period.
    #[inline]
    pub fn drops_of_pulse_v(&self, Drops { pulse_v, return_v, off_v }: Drops) -> [f64; 2] {
        let [with_v, against_v] = [pulse_v - off_v, return_v - off_v];
        if self.sense < 0.0 { [against_v, with_v] } else { [with_v, against_v] }
    }

    /// What drops leave of a mean current: `free_a` without them, `dry_a` what they take from a current that stays positive,
    /// and from one that stays negative. One that touches zero in each period has the mean that the volts say, whatever it
    /// was before. `volts` are asked for only there; their mean and their drops are `mean_v` and `drops`.
    #[inline(always)]
    pub fn against_drops(
        &self,
        free_a: f64,
        dry_a: [f64; 2],
        (mean_v, drops): (f64, Drops),
        volts: impl FnOnce() -> Volts,
    ) -> f64 {
        // Inlined, so that a bridge without a drop costs a comparison alone, and a current far from zero little more.
        if dry_a == [0.0; 2] {
            return free_a;
        }
        let (least_a, most_a) = (free_a - dry_a[0], free_a + dry_a[1]);
        if self.pulse.share * self.a_per_v == 0.0 {
            return within(0.0, least_a, most_a);
        }
        // However it decays, it swings no wider than in straight lines.
        let [with_a, against_a] = [Way::With, Way::Against].map(|way| self.straight_swing_a(mean_v, &drops, way));
        let widest_a = with_a.max(against_a);
        if least_a >= widest_a {
            least_a
        } else if most_a <= -widest_a {
            most_a
        } else {
            self.near_zero(least_a, most_a, &volts())
        }
    }

    fn near_zero(&self, least_a: f64, most_a: f64, volts: &Volts) -> f64 {
        let (with_a, against_a) = (self.swing(volts, Way::With).low_a, self.swing(volts, Way::Against).high_a);
        // As far as the mean is above the least current, and below the greatest.
        let [above_a, below_a] = if self.sense > 0.0 { [with_a, against_a] } else { [against_a, with_a] };
        if least_a >= above_a {
            least_a
        } else if most_a <= -below_a {
            most_a
        } else {
            within(self.settled_a(volts), least_a, most_a)
        }
    }

    /// The current at the share `at` of a period with the mean `mean_a`.
    pub fn sampled_a(&self, mean_a: f64, at: f64, volts: &Volts) -> f64 {
        mean_a + self.course(mean_a, volts).above_mean_a(at)
    }

    /// Of a period with this mean current.
    pub fn course(&self, mean_a: f64, volts: &Volts) -> Course {
        let driven_a = self.sense * mean_a;
        let way = if driven_a < 0.0 { Way::Against } else { Way::With };
        let swing = self.swing(volts, way);
        let is_clear = match way {
            Way::With => driven_a >= swing.low_a,
            Way::Against => driven_a <= -swing.high_a,
        };
        // Without a drop it flows through zero as anywhere else.
        let is_even = is_clear || volts.drops.are_none();
        let shape = match if is_even { Regime::Above } else { self.regime(volts) } {
            Regime::Touching(cycle) => Shape::Touching { cycle, a_per_v: self.a_per_v, mean_v: cycle.mean_v() },
            Regime::Above | Regime::Below => Shape::Even(swing),
        };
        Course { sense: self.sense, shape }
    }

    /// From the least to the greatest current of a period without resistance.
    #[inline]
    fn straight_swing_a(&self, mean_v: f64, &Drops { pulse_v, return_v, off_v }: &Drops, way: Way) -> f64 {
        let pulse = self.pulse.share;
        let apart_v = match way {
            Way::With => off_v - pulse_v,
            Way::Against => return_v - off_v,
        };
        self.a_per_v * (1.0 - pulse) * (mean_v.abs() + pulse * apart_v).abs()
    }

    /// Of a period in which the PWM drives and the current does not touch zero.
    #[inline]
    fn swing(&self, volts: &Volts, way: Way) -> Swing {
        self.of_one_ampere.times(self.straight_swing_a(volts.mean_v, &volts.drops, way))
    }

    /// Mean current of a period in which it touches zero; at the bound of that beyond.
    fn settled_a(&self, volts: &Volts) -> f64 {
        let sense = self.sense;
        match self.regime(volts) {
            Regime::Touching(cycle) => sense * self.a_per_v * cycle.mean_v(),
            Regime::Above => sense * self.swing(volts, Way::With).low_a,
            Regime::Below => -sense * self.swing(volts, Way::Against).high_a,
        }
    }

    fn regime(&self, volts: &Volts) -> Regime {
        let Self { sense, pulse, off, decay, .. } = *self;
        // In exponentials the resistance takes its share of the current of each moment.
        let emf_v = sense * if decay == 0.0 { volts.emf_v + volts.lost_v } else { volts.emf_v };
        let supply_v = sense * volts.mean_v / pulse.share;
        let drops = volts.drops;
        let (rise_v, return_v) = (supply_v - drops.pulse_v - emf_v, supply_v + drops.return_v - emf_v);
        let (fall_v, reverse_v) = (emf_v + drops.off_v, emf_v - drops.off_v);
        let (from_rest_v, to_rest_v) = (rise_v * pulse.gained, reverse_v * off.gained);
        if fall_v <= 0.0 || rise_v > 0.0 && off.is_too_short_for(from_rest_v, fall_v) {
            return Regime::Above;
        }
        if return_v <= 0.0 || reverse_v > 0.0 && pulse.is_too_short_for(to_rest_v, return_v) {
            return Regime::Below;
        }
        let (low_v, high_v) = match (rise_v > 0.0, reverse_v > 0.0) {
            (false, false) => (0.0, 0.0),
            // The pulse drives and the off phase ends that, or the other way round.
            (true, false) => (0.0, from_rest_v),
            (false, true) => (to_rest_v, 0.0),
            // Either part begins with what the other one left, and comes so much less far.
            (true, true) => {
                let less_high = pulse.left * rise_v / return_v;
                let less_low = off.left * reverse_v / fall_v;
                let low_v = (to_rest_v - less_low * from_rest_v) / (1.0 - less_high * less_low);
                let low_v = low_v.max(0.0);
                (low_v, (from_rest_v - less_high * low_v).max(0.0))
            }
        };
        Regime::Touching(Cycle { pulse: pulse.share, decay, rise_v, return_v, fall_v, reverse_v, low_v, high_v })
    }
}

/// The current through a period, as against its mean.
pub struct Course {
    /// The direction of the drive.
    sense: f64,
    shape: Shape,
}

enum Shape {
    Even(Swing),
    Touching { cycle: Cycle, a_per_v: f64, mean_v: f64 },
}

impl Course {
    /// At a share of the period.
    pub fn above_mean_a(&self, at: f64) -> f64 {
        self.sense
            * match &self.shape {
                Shape::Even(swing) => swing.at_a(at),
                Shape::Touching { cycle, a_per_v, mean_v } => a_per_v * (cycle.at_v(at) - mean_v),
            }
    }

    /// Behind a low-pass of the first order, which remembers so many periods.
    pub fn filtered_above_mean_a(&self, at: f64, memory: f64) -> f64 {
        self.sense
            * match &self.shape {
                Shape::Even(swing) => filtered(&swing.pieces(), swing.decay, at, memory),
                Shape::Touching { cycle, a_per_v, mean_v } => {
                    a_per_v * (filtered(&cycle.pieces(), cycle.decay, at, memory) - mean_v)
                }
            }
    }
}

/// The same of a current that does not touch zero.
#[derive(Clone, Copy, Debug)]
struct Swing {
    /// Share of the period.
    pulse: f64,
    decay: f64,
    /// How far below the mean it is where the pulse begins...
    low_a: f64,
    /// ... and above where it ends.
    high_a: f64,
    /// Above the mean, where a pulse without an end would lead; not of straight lines.
    towards_a: f64,
}

impl Swing {
    fn of_one_ampere(pulse: &Part, off: &Part, decay: f64) -> Self {
        if decay == 0.0 || pulse.share * off.share == 0.0 {
            return Self { pulse: pulse.share, decay: 0.0, low_a: 0.5, high_a: 0.5, towards_a: 0.0 };
        }
        // What a pulse without an end and an off phase without one lead to are so far apart.
        let step_a = 1.0 / (pulse.share * off.share * decay);
        let risen = decay * pulse.gained / (1.0 - pulse.left * off.left);
        Self {
            pulse: pulse.share,
            decay,
            low_a: step_a * (pulse.share - risen * off.left),
            high_a: step_a * (risen - pulse.share),
            towards_a: step_a * off.share,
        }
    }

    #[inline]
    fn times(&self, factor: f64) -> Self {
        let Self { low_a, high_a, towards_a, .. } = *self;
        Self { low_a: factor * low_a, high_a: factor * high_a, towards_a: factor * towards_a, ..*self }
    }

    /// Pulse and off phase.
    fn pieces(&self) -> [Piece; 2] {
        let Self { pulse, decay, low_a, high_a, towards_a } = *self;
        let off = 1.0 - pulse;
        let [rise_a, fall_a] = match decay == 0.0 {
            true => [pulse, off].map(|share| (low_a + high_a) / share.max(f64::MIN_POSITIVE)),
            false => [towards_a * decay, towards_a * decay * pulse / off.max(f64::MIN_POSITIVE)],
        };
        [Piece { length: pulse, from: -low_a, drive: rise_a }, Piece { length: off, from: high_a, drive: -fall_a }]
    }

    /// At a share of the period.
    fn at_a(&self, at: f64) -> f64 {
        let Self { pulse, decay, low_a, high_a, towards_a } = *self;
        let off = (1.0 - pulse).max(f64::MIN_POSITIVE);
        if decay == 0.0 {
            let risen = if at < pulse { at / pulse } else { (1.0 - at) / off };
            return (low_a + high_a) * risen - low_a;
        }
        if at < pulse {
            towards_a - (towards_a + low_a) * (-decay * at).exp()
        } else {
            // The mean of where both lead is the mean.
            let towards_a = towards_a * pulse / off;
            (high_a + towards_a) * (-decay * (at - pulse)).exp() - towards_a
        }
    }
}

/// How a current settles.
enum Regime {
    /// In the direction of the drive throughout.
    Above,
    /// Against it throughout.
    Below,
    /// At zero for a moment or a part of each period.
    Touching(Cycle),
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SUPPLY_V: f64 = 9.0;
    const INDUCTANCE_H: f64 = 2e-3;
    const PWM_HZ: f64 = 20e3;
    const STEPS: usize = 2000;

    /// The current over a period after many, switched in small steps; `None` while it still drifts.
    fn switched_a(duty: f64, decay: f64, volts: &Volts) -> Option<Vec<f64>> {
        let step_a_per_v = 1.0 / (PWM_HZ * INDUCTANCE_H * STEPS as f64);
        let (mut current_a, mut last) = (0.0, vec![f64::NAN; STEPS]);
        for _ in 0..300 {
            let period: Vec<f64> = (0..STEPS)
                .map(|step| {
                    // The pulse ends within a step; a whole one more or less would be seen in a short pulse.
                    let on = (duty.abs() * STEPS as f64 - step as f64).clamp(0.0, 1.0);
                    let source_v = on * duty.signum() * SUPPLY_V;
                    let Drops { pulse_v, return_v, off_v } = volts.drops;
                    let free_a: f64 =
                        current_a * (1.0 - 0.5 * decay / STEPS as f64) + step_a_per_v * (source_v - volts.emf_v);
                    let in_pulse_v = if free_a * duty < 0.0 { return_v } else { pulse_v };
                    let drop_v = off_v + on * (in_pulse_v - off_v);
                    let left_a = free_a.signum() * (free_a.abs() - step_a_per_v * drop_v).max(0.0);
                    // The middle of the step stands for its loss.
                    current_a = left_a / (1.0 + 0.5 * decay / STEPS as f64);
                    current_a
                })
                .collect();
            if (period[0] - last[0]).abs() < 1e-7 {
                return Some(period);
            }
            last = period;
        }
        None
    }

    fn is_of_one_sign(period: &[f64]) -> bool {
        period.iter().all(|current_a| *current_a > 0.0) || period.iter().all(|current_a| *current_a < 0.0)
    }

    proptest! {
        /// Against the differential equation of the low-pass over many periods of that course.
        #[test]
        fn the_filtered_ripple(
            duty in prop_oneof![-0.95f64..-0.05, 0.05f64..0.95],
            mean_a in -1.5f64..1.5,
            drop_v in prop_oneof![Just(0.0), 0.5f64..3.0],
            emf_v in -5.0f64..5.0,
            memory in 0.02f64..0.5,
            decay in prop_oneof![Just(0.0), STRAIGHT..5.0],
        ) {
            let drops = Drops { pulse_v: drop_v, return_v: drop_v, off_v: drop_v };
            let volts = Volts { mean_v: duty * SUPPLY_V, emf_v, lost_v: 0.0, drops };
            let ripple = Ripple::new(INDUCTANCE_H, decay * INDUCTANCE_H * PWM_HZ, PWM_HZ).with_duty(duty);
            let course = ripple.course(mean_a, &volts);
            let period: Vec<f64> = (0..STEPS).map(|step| course.above_mean_a((step as f64 + 0.5) / STEPS as f64)).collect();
            let widest_a = period.iter().fold(0.0_f64, |widest, above| widest.max(above.abs()));
            let left = (-1.0 / (STEPS as f64 * memory)).exp();
            let mut filtered_a = 0.0;
            for round in 0..20 {
                for (step, now_a) in period.iter().enumerate() {
                    filtered_a = now_a + left * (filtered_a - now_a);
                    if round == 19 && step % (STEPS / 20) == 0 {
                        let found_a = course.filtered_above_mean_a((step + 1) as f64 / STEPS as f64, memory);
                        prop_assert!((found_a - filtered_a).abs() < 0.005 * widest_a, "{step}: {found_a} A, {filtered_a} A of {widest_a} A");
                    }
                }
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]
        /// Wherever the switched current settles, its mean and moments are those computed. Without resistance a current
        /// that does not touch zero drifts for ever; with it, it settles there as well. The off phase brakes or coasts.
        #[test]
        fn the_switched_current(
            duty in prop_oneof![-0.95f64..-0.02, 0.02f64..0.95],
            emf_v in -9.0f64..9.0,
            drop_v in 0.05f64..3.0,
            return_v in 0.05f64..3.0,
            coasts: bool,
            decay in prop_oneof![Just(0.0), STRAIGHT..5.0],
        ) {
            let off_drop_v = if coasts { SUPPLY_V + 2.0 } else { drop_v };
            let drops = Drops { pulse_v: drop_v, return_v, off_v: off_drop_v };
            let volts = Volts { mean_v: duty * SUPPLY_V, emf_v, lost_v: 0.0, drops };
            let ripple = Ripple::new(INDUCTANCE_H, decay * INDUCTANCE_H * PWM_HZ, PWM_HZ).with_duty(duty);
            let found_a = ripple.settled_a(&volts);
            let swing = ripple.swing(&volts, if duty * found_a < 0.0 { Way::Against } else { Way::With });
            let swing_a = swing.low_a + swing.high_a;
            match switched_a(duty, decay, &volts) {
                None => prop_assert!(found_a.abs() > 0.49 * swing_a, "{found_a} A of {swing_a} A"),
                Some(period) if period.iter().all(|current_a| *current_a != 0.0) && is_of_one_sign(&period) => {
                    // It stays on one side: at the bound, and the course around the mean is the swing's.
                    let mean_a = period.iter().sum::<f64>() / STEPS as f64;
                    let bound_a = if duty * mean_a > 0.0 { swing.low_a } else { swing.high_a };
                    prop_assert!(mean_a.abs() > bound_a - 1e-2 * swing_a, "{mean_a} A, {bound_a} A");
                    // Whether a current that hardly touches zero does so is decided by the steps.
                    let nearest_a = period.iter().fold(f64::INFINITY, |nearest, current_a| nearest.min(current_a.abs()));
                    let tolerated = if nearest_a > 1e-2 * swing_a { 1e-6 } else { 5e-3 };
                    prop_assert!((found_a.abs() - bound_a).abs() < tolerated * swing_a, "{found_a} A, {bound_a} A");
                    if mean_a * duty > 0.0 {
                        for step in [STEPS / 30, STEPS / 4, STEPS / 2, 3 * STEPS / 4] {
                            let found_a = ripple.sampled_a(mean_a, (step + 1) as f64 / STEPS as f64, &volts);
                            prop_assert!((found_a - period[step]).abs() < 1e-2 * swing_a, "{step}: {found_a} A, {} A", period[step]);
                        }
                    }
                }
                Some(period) => {
                    let mean_a = period.iter().sum::<f64>() / STEPS as f64;
                    prop_assert!((found_a - mean_a).abs() < 5e-3 * swing_a, "{found_a} A, {mean_a} A of {swing_a} A");
                    for step in [STEPS / 30, STEPS / 4, STEPS / 2, 3 * STEPS / 4] {
                        // What the step left is the current at its end.
                        let found_a = ripple.sampled_a(found_a, (step + 1) as f64 / STEPS as f64, &volts);
                        prop_assert!((found_a - period[step]).abs() < 1e-2 * swing_a, "{step}: {found_a} A, {} A", period[step]);
                    }
                }
            }
        }
    }
}
