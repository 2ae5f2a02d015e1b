//! The current of a period in which it touches zero.

use super::low_pass::Piece;

/// A current that touches zero in each period; currents as the volts that make them in a period without resistance.
#[derive(Clone, Copy)]
pub(super) struct Cycle {
    /// Share of the period.
    pub pulse: f64,
    /// The period over the electrical time constant; 0 for straight lines.
    pub decay: f64,
    /// How it is driven in the pulse from zero...
    pub rise_v: f64,
    /// ... and towards zero.
    pub return_v: f64,
    /// How it is driven in the off phase towards zero...
    pub fall_v: f64,
    /// ... and from zero.
    pub reverse_v: f64,
    /// Below zero where the pulse begins.
    pub low_v: f64,
    /// Above zero where it ends.
    pub high_v: f64,
}

impl Cycle {
    /// What drives from zero, after a share of the period.
    #[inline]
    fn reached_v(&self, driving_v: f64, share: f64) -> f64 {
        if self.decay == 0.0 { driving_v * share } else { driving_v * -(-self.decay * share).exp_m1() / self.decay }
    }

    /// The share of the period that a current needs to come to zero against what drives it there.
    #[inline]
    fn until_zero(&self, height_v: f64, driving_v: f64) -> f64 {
        let straight = height_v / driving_v;
        if self.decay == 0.0 { straight } else { (self.decay * straight).ln_1p() / self.decay }
    }

    /// The shares of the period in which it comes back to zero, in the pulse and in the off phase.
    fn towards_zero(&self) -> [f64; 2] {
        let ways = [(self.low_v, self.return_v), (self.high_v, self.fall_v)];
        ways.map(|(height_v, driving_v)| if height_v > 0.0 { self.until_zero(height_v, driving_v) } else { 0.0 })
    }

    pub fn mean_v(&self) -> f64 {
        if self.decay != 0.0 {
            return self.balance_v() / self.decay;
        }
        // Triangles: half of base times height.
        let side = |height_v: f64, rates_v: [f64; 2]| match height_v > 0.0 {
            true => 0.5 * height_v * rates_v.map(|rate_v| height_v / rate_v).iter().sum::<f64>(),
            false => 0.0,
        };
        side(self.high_v, [self.rise_v, self.fall_v]) - side(self.low_v, [self.return_v, self.reverse_v])
    }

    /// Mean of what drives the current while it flows: over a period the resistance takes all of it.
    fn balance_v(&self) -> f64 {
        let Self { pulse, low_v, high_v, .. } = *self;
        let [returning, falling] = self.towards_zero();
        let rising = if high_v > 0.0 { pulse - returning } else { 0.0 };
        let reversing = if low_v > 0.0 { 1.0 - pulse - falling } else { 0.0 };
        self.return_v * returning + self.rise_v * rising - self.fall_v * falling - self.reverse_v * reversing
    }

    /// Back to zero and from it, in the pulse and in the off phase.
    pub fn pieces(&self) -> [Piece; 4] {
        let Self { pulse, low_v, high_v, .. } = *self;
        let [returned, fallen] = self.towards_zero();
        [
            Piece { length: returned, from: -low_v, drive: self.return_v },
            Piece { length: pulse - returned, from: 0.0, drive: self.rise_v.max(0.0) },
            Piece { length: fallen, from: high_v, drive: -self.fall_v },
            Piece { length: 1.0 - pulse - fallen, from: 0.0, drive: -self.reverse_v.max(0.0) },
        ]
    }

    /// At a share of the period.
    pub fn at_v(&self, at: f64) -> f64 {
        // From zero, or back to it: before, the same current seen backwards.
        let around_zero = |since_zero: f64, [towards_v, from_v]: [f64; 2]| {
            let driving_v = if since_zero < 0.0 { towards_v } else { from_v.max(0.0) };
            self.reached_v(driving_v, since_zero)
        };
        if at == 0.0 {
            // The inverse of what follows, without its logarithm.
            -self.low_v
        } else if at < self.pulse {
            around_zero(at - self.until_zero(self.low_v, self.return_v), [self.return_v, self.rise_v])
        } else {
            let since_zero = at - self.pulse - self.until_zero(self.high_v, self.fall_v);
            -around_zero(since_zero, [self.fall_v, self.reverse_v])
        }
    }
}
