//! A current between two rows of a recording: it settles with the winding's time constant while what it settles to goes on
//! evenly. Beside the straight line between the two rows that encloses an area, which the simulation knows.

/// A winding that settles slower than in an interval over this bends the current to a parabola.
const LEAST_BENT: f64 = 0.01;
/// Two time constants as close as this are one.
const SAME: f64 = 1e-6;

/// What a current does between two rows beside the straight line.
#[derive(Clone, Copy, Debug)]
pub struct Bulge {
    /// By how much its mean is above that of the line.
    mean_a: f64,
    /// Time from row to row, in time constants of the winding.
    constants: f64,
}

impl Bulge {
    /// A current that follows the line.
    pub const NONE: Self = Self { mean_a: 0.0, constants: 0.0 };

    /// Between rows `interval_s` apart, in a winding with the time constant `winding_s`.
    pub fn new(mean_a: f64, interval_s: f64, winding_s: f64) -> Self {
        Self { mean_a, constants: interval_s / winding_s }
    }

    /// Of something that settles much slower than from row to row.
    pub fn parabola(mean: f64) -> Self {
        Self { mean_a: mean, constants: 0.0 }
    }

    fn is_parabola(self) -> bool {
        self.constants < LEAST_BENT
    }

    /// The area between curve and line from a place (0 to 1) to the end, on a scale of its own. The curve is
    /// `exp(-constants s) - 1 + s (1 - exp(-constants))`.
    fn area_after(self, place: f64) -> f64 {
        let left = (-self.constants).exp();
        let settling = ((-self.constants * place).exp() - left) / self.constants;
        settling - (1.0 - place) + 0.5 * (1.0 - place * place) * (1.0 - left)
    }

    /// What the last `share` of the interval has of it, over the whole interval.
    pub fn in_the_last(self, share: f64) -> f64 {
        let of_area = if share >= 1.0 {
            1.0
        } else if self.is_parabola() {
            (3.0 - 2.0 * share) * share * share
        } else {
            self.area_after(1.0 - share) / self.area_after(0.0)
        };
        self.mean_a * of_area
    }

    /// What it leaves in a first-order low-pass, of whose time constants the interval lasts `steps`.
    pub fn in_a_low_pass(self, steps: f64) -> f64 {
        let kept = (-steps).exp();
        if self.is_parabola() {
            return self.mean_a * 6.0 * (steps - 2.0 + (steps + 2.0) * kept) / (steps * steps);
        }
        let left = (-self.constants).exp();
        let apart = steps - self.constants;
        let settling = if apart.abs() < SAME { kept } else { (left - kept) / apart };
        let even = 1.0 - kept;
        let of_area = steps * settling - even + (1.0 - left) * (1.0 - even / steps);
        self.mean_a * of_area / self.area_after(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Against the differential equations of winding and low-pass in small steps.
        #[test]
        fn shares_are_those_of_a_winding(constants in 0.001_f64..20.0, steps in 0.01_f64..20.0, share in 0.0_f64..1.0) {
            let parts = 20_000;
            let part = 1.0 / f64::from(parts);
            // From 1, to what settles at 0.
            let curve = |place: f64| (-constants * place).exp();
            let beside = |place: f64| curve(place) - 1.0 + place * (1.0 - curve(1.0));
            let (mut area, mut in_the_last, mut filtered) = (0.0, 0.0, 0.0);
            for index in 0..parts {
                let place = (f64::from(index) + 0.5) * part;
                area += part * beside(place);
                in_the_last += if place > 1.0 - share { part * beside(place) } else { 0.0 };
                filtered += part * steps * (beside(place) - filtered) / (1.0 + 0.5 * part * steps);
            }
            let bulge = Bulge::new(1.0, constants, 1.0);
            prop_assert!((bulge.in_the_last(share) - in_the_last / area).abs() < 3e-3);
            let (found, simulated) = (bulge.in_a_low_pass(steps), filtered / area);
            prop_assert!((found - simulated).abs() < 3e-3 * (1.0 + simulated.abs()), "{found} {simulated}");
        }
    }

    #[test]
    fn a_low_pass_as_slow_as_the_winding_is_none_apart() {
        let bulge = Bulge::new(1.0, 2.0, 1.0);
        assert!((bulge.in_a_low_pass(2.0) - bulge.in_a_low_pass(2.0 + 1e-4)).abs() < 1e-4);
    }
}
