//! The current within one period of the PWM. It rises and falls in straight lines: a period is short beside the electrical
//! time constant.

/// What drives the current through a period, in the direction of positive motion.
#[derive(Clone, Copy, Debug)]
pub struct Volts {
    /// Mean over the period that the bridge puts out.
    pub mean_v: f64,
    /// What motion and resistance take of it.
    pub emf_v: f64,
    /// What is lost in the pulse and in the off phase, whichever way the current flows.
    pub drops_v: [f64; 2],
}

/// The PWM as the current sees it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ripple {
    /// Share of the period in which the supply drives, with the sign of the direction.
    pulse: f64,
    /// What the current gains of a volt over a period; 0 if its ripple is left out.
    a_per_v: f64,
}

impl Ripple {
    /// Of a motor at rest.
    pub fn new(inductance_h: f64, pwm_hz: f64) -> Self {
        Self { pulse: 0.0, a_per_v: 1.0 / (inductance_h * pwm_hz) }
    }

    /// The same with a duty from -1 to 1.
    #[inline]
    pub fn with_duty(self, duty: f64) -> Self {
        Self { pulse: duty.clamp(-1.0, 1.0), ..self }
    }

    /// What is lost over a period in which the current does not reverse.
    #[inline]
    pub fn mean_drop_v(self, [pulse_v, off_v]: [f64; 2]) -> f64 {
        off_v + self.pulse.abs() * (pulse_v - off_v)
    }

    /// What drops leave of a mean current: `free_a` without them, `dry_a` what they take from a current that does not
    /// reverse. One that touches zero in each period has the mean that the volts say, whatever it was before.
    #[inline]
    pub fn against_drops(self, free_a: f64, dry_a: f64, volts: impl FnOnce() -> Volts) -> f64 {
        if dry_a <= 0.0 {
            return free_a;
        }
        let (least_a, most_a) = (free_a - dry_a, free_a + dry_a);
        // Not `clamp`: a simulation that has left all bounds is judged by its error.
        let within = |settled_a: f64| settled_a.max(least_a).min(most_a);
        if self.pulse * self.a_per_v == 0.0 {
            return within(0.0);
        }
        let volts = volts();
        let widest_a = 0.5 * self.swing_a(&volts);
        if least_a >= widest_a {
            least_a
        } else if most_a <= -widest_a {
            most_a
        } else {
            within(self.settled_a(&volts))
        }
    }

    /// The current at the share `at` of a period with the mean `mean_a`.
    pub fn sampled_a(self, mean_a: f64, at: f64, volts: &Volts) -> f64 {
        let sense = self.pulse.signum();
        let swing_a = self.swing_a(volts);
        if mean_a.abs() < 0.5 * swing_a
            && let Regime::Touching(cycle) = self.regime(volts)
        {
            return mean_a + sense * self.a_per_v * (cycle.at_v(at) - cycle.mean_v());
        }
        let pulse = self.pulse.abs();
        let risen = if at < pulse { at / pulse } else { (1.0 - at) / (1.0 - pulse).max(f64::MIN_POSITIVE) };
        mean_a + sense * swing_a * (risen - 0.5)
    }

    /// From the least to the greatest current of a period in which it drives and does not touch zero.
    #[inline]
    fn swing_a(self, volts: &Volts) -> f64 {
        let pulse = self.pulse.abs();
        let [pulse_drop_v, off_drop_v] = volts.drops_v;
        let driven_v = volts.mean_v.abs() + pulse * (off_drop_v - pulse_drop_v);
        self.a_per_v * (1.0 - pulse) * driven_v.abs()
    }

    /// Mean current of a period in which it touches zero; at the bound of that beyond.
    fn settled_a(self, volts: &Volts) -> f64 {
        let sense = self.pulse.signum();
        match self.regime(volts) {
            Regime::Touching(cycle) => sense * self.a_per_v * cycle.mean_v(),
            Regime::Above => sense * 0.5 * self.swing_a(volts),
            Regime::Below => -sense * 0.5 * self.swing_a(volts),
        }
    }

    fn regime(self, volts: &Volts) -> Regime {
        let (sense, pulse) = (self.pulse.signum(), self.pulse.abs());
        let off = 1.0 - pulse;
        let emf_v = sense * volts.emf_v;
        let supply_v = sense * volts.mean_v / pulse;
        let [pulse_drop_v, off_drop_v] = volts.drops_v;
        let cycle = Cycle {
            pulse,
            rise_v: supply_v - pulse_drop_v - emf_v,
            return_v: supply_v + pulse_drop_v - emf_v,
            fall_v: emf_v + off_drop_v,
            reverse_v: emf_v - off_drop_v,
            low_v: 0.0,
            high_v: 0.0,
        };
        let Cycle { rise_v, return_v, fall_v, reverse_v, .. } = cycle;
        if fall_v <= 0.0 || rise_v * pulse >= fall_v * off {
            return Regime::Above;
        }
        if return_v <= 0.0 || reverse_v > 0.0 && return_v * pulse <= reverse_v * off {
            return Regime::Below;
        }
        let (low_v, high_v) = match (rise_v > 0.0, reverse_v > 0.0) {
            (false, false) => (0.0, 0.0),
            // The pulse drives and the off phase ends that, or the other way round.
            (true, false) => (0.0, rise_v * pulse),
            (false, true) => (reverse_v * off, 0.0),
            (true, true) => {
                let high_v = (return_v * pulse / reverse_v - off) / (return_v / (rise_v * reverse_v) - 1.0 / fall_v);
                (return_v * (pulse - high_v / rise_v), high_v)
            }
        };
        Regime::Touching(Cycle { low_v, high_v, ..cycle })
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

/// A current that touches zero in each period; currents as the volts that make them in a period.
struct Cycle {
    /// Share of the period.
    pulse: f64,
    /// How it rises in the pulse from zero...
    rise_v: f64,
    /// ... and towards zero.
    return_v: f64,
    /// How it falls in the off phase towards zero...
    fall_v: f64,
    /// ... and from zero.
    reverse_v: f64,
    /// Below zero where the pulse begins.
    low_v: f64,
    /// Above zero where it ends.
    high_v: f64,
}

impl Cycle {
    fn mean_v(&self) -> f64 {
        // Triangles: half of base times height.
        let side = |height_v: f64, rates_v: [f64; 2]| match height_v > 0.0 {
            true => 0.5 * height_v * rates_v.map(|rate_v| height_v / rate_v).iter().sum::<f64>(),
            false => 0.0,
        };
        side(self.high_v, [self.rise_v, self.fall_v]) - side(self.low_v, [self.return_v, self.reverse_v])
    }

    /// At a share of the period.
    fn at_v(&self, at: f64) -> f64 {
        if at < self.pulse {
            let since_zero = at - self.low_v / self.return_v;
            since_zero * if since_zero < 0.0 { self.return_v } else { self.rise_v.max(0.0) }
        } else {
            let since_zero = at - self.pulse - self.high_v / self.fall_v;
            -since_zero * if since_zero < 0.0 { self.fall_v } else { self.reverse_v.max(0.0) }
        }
    }
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
    fn switched_a(duty: f64, volts: &Volts) -> Option<Vec<f64>> {
        let step_a_per_v = 1.0 / (PWM_HZ * INDUCTANCE_H * STEPS as f64);
        let (mut current_a, mut last) = (0.0, vec![f64::NAN; STEPS]);
        for _ in 0..300 {
            let period: Vec<f64> = (0..STEPS)
                .map(|step| {
                    // The pulse ends within a step; a whole one more or less would be seen in a short pulse.
                    let on = (duty.abs() * STEPS as f64 - step as f64).clamp(0.0, 1.0);
                    let source_v = on * duty.signum() * SUPPLY_V;
                    let [pulse_drop_v, off_drop_v] = volts.drops_v;
                    let drop_v = off_drop_v + on * (pulse_drop_v - off_drop_v);
                    let free_a: f64 = current_a + step_a_per_v * (source_v - volts.emf_v);
                    current_a = free_a.signum() * (free_a.abs() - step_a_per_v * drop_v).max(0.0);
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

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]
        /// Wherever the switched current comes to rest, mean and moments are those computed; without resistance it drifts
        /// for ever where it does not touch zero. The off phase brakes or coasts.
        #[test]
        fn the_switched_current(
            duty in prop_oneof![-0.95f64..-0.02, 0.02f64..0.95],
            emf_v in -9.0f64..9.0,
            drop_v in 0.05f64..3.0,
            coasts: bool,
        ) {
            let off_drop_v = if coasts { SUPPLY_V + 2.0 } else { drop_v };
            let volts = Volts { mean_v: duty * SUPPLY_V, emf_v, drops_v: [drop_v, off_drop_v] };
            let ripple = Ripple::new(INDUCTANCE_H, PWM_HZ).with_duty(duty);
            let (found_a, swing_a) = (ripple.settled_a(&volts), ripple.swing_a(&volts));
            match switched_a(duty, &volts) {
                None => prop_assert!(found_a.abs() > 0.49 * swing_a, "{found_a} A of {swing_a} A"),
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
