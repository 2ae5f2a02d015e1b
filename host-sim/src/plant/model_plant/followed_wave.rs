//! A wave of torque along the angle, without a sine for each step.

use motorbench_model::catalogue::Wave;

/// A wave along the angle. The angle a step later is nearly known now. Its sine and cosine are computed ahead, in
/// parallel with the step; the remaining way is a small correction.
#[derive(Clone, Copy, Debug)]
pub(super) struct FollowedWave {
    pub(super) wave: Wave,
    /// An angle at which the wave was evaluated by sine and cosine: there, and a quarter of a period on.
    pub(super) anchor_rad: f64,
    pub(super) at_anchor_nm: [f64; 2],
    /// The same, where the shaft was expected to be.
    pub(super) expected_rad: f64,
    pub(super) at_expected_nm: [f64; 2],
}

impl FollowedWave {
    /// Largest phase from the anchor: what follows the series' last terms is below 2e-12 of the amplitude.
    pub(super) const REACH: f64 = 0.3;
    /// Largest phase from where the shaft was expected: what follows the square is below 2e-11 of the amplitude.
    pub(super) const NEAR: f64 = 5e-4;

    pub(super) fn new(wave: Wave) -> Self {
        let at_zero_nm = Self::by_sine_and_cosine(&wave, 0.0);
        Self { wave, anchor_rad: 0.0, at_anchor_nm: at_zero_nm, expected_rad: 0.0, at_expected_nm: at_zero_nm }
    }

    pub(super) fn by_sine_and_cosine(wave: &Wave, angle_rad: f64) -> [f64; 2] {
        let [cosine_nm, sine_nm] = wave.against_nm;
        let (sine, cosine) = (wave.periods_per_rev * angle_rad).sin_cos();
        [-(cosine_nm * cosine + sine_nm * sine), cosine_nm * sine - sine_nm * cosine]
    }

    /// At an angle; `step_rad` later it will be asked for again.
    #[inline(always)]
    pub(super) fn torque_nm(&mut self, angle_rad: f64, step_rad: f64) -> f64 {
        let mut phase = self.wave.periods_per_rev * (angle_rad - self.expected_rad);
        if phase.abs() > Self::NEAR {
            self.at_expected_nm = self.by_series(angle_rad);
            phase = 0.0;
        }
        let [here_nm, on_nm] = self.at_expected_nm;
        self.expected_rad = angle_rad + step_rad;
        self.at_expected_nm = self.by_series(self.expected_rad);
        here_nm + phase * (on_nm - phase * (0.5 * here_nm))
    }

    /// At an angle, and a quarter of a period on; by Taylor's series from the anchor.
    #[inline(always)]
    pub(super) fn by_series(&mut self, angle_rad: f64) -> [f64; 2] {
        let since = |wave: &Self| wave.wave.periods_per_rev * (angle_rad - wave.anchor_rad);
        let mut x = since(self);
        if x.abs() > Self::REACH {
            // Ahead of the shaft, so that it stays near for longer.
            self.anchor(angle_rad + 0.9 * Self::REACH.copysign(x) / self.wave.periods_per_rev);
            x = since(self);
        }
        let x2 = x * x;
        let x4 = x2 * x2;
        // Products with constants: a quotient would take as long as the rest together.
        let cosine = (1.0 - x2 * 0.5) + x4 * ((1.0 / 24.0 - x2 * (1.0 / 720.0)) + x4 * (1.0 / 40_320.0));
        let sine = (1.0 - x2 * (1.0 / 6.0)) + x4 * ((1.0 / 120.0 - x2 * (1.0 / 5_040.0)) + x4 * (1.0 / 362_880.0));
        let [here_nm, on_nm] = self.at_anchor_nm;
        let sine = x * sine;
        [here_nm * cosine + on_nm * sine, on_nm * cosine - here_nm * sine]
    }

    #[inline(never)]
    pub(super) fn anchor(&mut self, angle_rad: f64) {
        self.anchor_rad = angle_rad;
        self.at_anchor_nm = Self::by_sine_and_cosine(&self.wave, angle_rad);
    }
}
