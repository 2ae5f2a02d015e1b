//! An axis behind a drive that imposes its current or its force, with effects hidden in its friction and its load.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use std::f64::consts::TAU;
use std::fmt::Write as _;

/// What is imposed on what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisKind {
    /// A motor that turns, behind a current loop; the current is measured.
    RotaryCurrent,
    /// A slide, behind a drive that takes a force.
    LinearForce,
}

/// What is hidden. Shares are those of the greatest torque or force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisEffect {
    /// Dry friction of 4 to 8 %.
    Friction,
    /// Of the dry friction 20 to 40 % more one way than the other; comes with friction.
    Asymmetry,
    /// A constant load of 3 to 6 %.
    Load,
    /// 5 to 9 periods a turn of 3 to 6 %.
    Cogging,
}

/// The true constants, in SI units of the axis.
#[derive(Clone, Copy, Debug, Default)]
pub struct AxisTruth {
    /// Torque or force over the command.
    pub per_command: f64,
    /// Inertia or mass.
    pub inertia: f64,
    /// Viscous friction.
    pub viscous: f64,
    /// Mean dry friction.
    pub dry: f64,
    /// Dry friction forward less that backward.
    pub difference: f64,
    /// Load against positive motion.
    pub load: f64,
    /// Amplitude and periods of the wave.
    pub wave: (f64, f64),
}

/// A recording and what is hidden in it.
#[derive(Clone, Debug)]
pub struct AxisTrial {
    /// The recording.
    pub csv: String,
    /// The rig file.
    pub rig_toml: String,
    /// What is true of it.
    pub truth: AxisTruth,
}

const STEP_S: f64 = 25e-6;
const STEPS_IN_A_ROW: usize = 40;
const LENGTH_S: f64 = 12.0;
const ROW_S: f64 = 1e-3;
/// From rest to the greatest speed.
const RAMP_S: f64 = 0.2;

/// A trial by its seed.
pub fn draw_axis(seed: u64, kind: AxisKind, hidden: &[AxisEffect]) -> AxisTrial {
    let random = &mut ChaCha8Rng::seed_from_u64(seed);
    let mut about = |value: f64| value * random.random_range(0.8..1.25);
    // Greatest command, speed and step of the encoder.
    let (most, fastest, count, mut truth) = match kind {
        AxisKind::RotaryCurrent => (
            5.0,
            120.0,
            TAU / 8192.0,
            AxisTruth { per_command: about(0.05), inertia: about(2e-4), viscous: about(2e-4), ..AxisTruth::default() },
        ),
        AxisKind::LinearForce => (
            150.0,
            0.4,
            2e-6,
            AxisTruth { per_command: 1.0, inertia: about(20.0), viscous: about(60.0), ..AxisTruth::default() },
        ),
    };
    let greatest = truth.per_command * most;
    for effect in hidden {
        match effect {
            AxisEffect::Friction => truth.dry = greatest * random.random_range(0.04..0.08),
            AxisEffect::Asymmetry => truth.difference = truth.dry * random.random_range(0.2..0.4),
            AxisEffect::Load => truth.load = greatest * random.random_range(0.03..0.06),
            AxisEffect::Cogging => {
                truth.wave = (greatest * random.random_range(0.03..0.06), f64::from(random.random_range(5..=9)));
            }
        }
    }
    let csv = record(kind, &truth, (most, fastest, count), random);
    let rig_toml = match kind {
        AxisKind::RotaryCurrent => format!("[motor]\ntorque_constant_Nm_per_A = {}\n", truth.per_command),
        AxisKind::LinearForce => "[axis]\nmotion = \"linear\"\n".into(),
    };
    AxisTrial { csv, rig_toml, truth }
}

/// A speed loop whose reference goes to another level every half second along a ramp, as motion controllers have it.
fn record(kind: AxisKind, truth: &AxisTruth, (most, fastest, count): (f64, f64, f64), random: &mut impl Rng) -> String {
    let mut shaft = Shaft { truth: *truth, speed: 0.0, angle: 0.0 };
    let (mut csv, noise) = match kind {
        AxisKind::RotaryCurrent => (String::from("t_s,i_A,theta_rad\n"), Normal::new(0.0, 2e-3 * most)),
        AxisKind::LinearForce => (String::from("t_s,force_N,x_m\n"), Normal::new(0.0, 0.0)),
    };
    let noise = noise.expect("a deviation that is a number");
    // The loop of a current drive is much faster than its log; a force is asked for once a row.
    let steps_in_a_tick = if kind == AxisKind::RotaryCurrent { 5 } else { STEPS_IN_A_ROW };
    let gain = 1.6 * most / fastest;
    let (mut level, mut reference, mut sum, mut command) = (0.0, 0.0_f64, 0.0, 0.0);
    let rows = (LENGTH_S / ROW_S) as usize;
    for row in 0..rows {
        if row % 500 == 0 {
            let is_rest = row == 0 || random.random_range(0.0..1.0) < 0.15;
            level = if is_rest { 0.0 } else { fastest * random.random_range(-1.0..1.0) };
        }
        for step in 0..STEPS_IN_A_ROW {
            if step % steps_in_a_tick == 0 {
                let tick_s = steps_in_a_tick as f64 * STEP_S;
                let most_by = fastest * tick_s / RAMP_S;
                reference += (level - reference).clamp(-most_by, most_by);
                let error = reference - shaft.speed;
                sum = f64::clamp(sum + 8.0 * gain * error * tick_s, -most, most);
                command = f64::clamp(gain * error + sum, -most, most);
            }
            if step == 0 {
                let read = command + noise.sample(random);
                let _ =
                    writeln!(csv, "{:.3},{read:.5},{:.7}", row as f64 * ROW_S, (shaft.angle / count).floor() * count);
            }
            shaft.advance(command);
        }
    }
    csv
}

/// The moving part.
struct Shaft {
    truth: AxisTruth,
    speed: f64,
    angle: f64,
}

impl Shaft {
    /// Karnopp's friction: at rest it takes what comes up to its level.
    fn advance(&mut self, command: f64) {
        let AxisTruth { per_command, inertia, viscous, dry, difference, load, wave: (amplitude, periods) } = self.truth;
        let [forward, backward] = [dry + 0.5 * difference, dry - 0.5 * difference];
        let driving = per_command * command - load - viscous * self.speed - amplitude * (periods * self.angle).sin();
        let friction = match self.speed {
            speed if speed > 0.0 => forward,
            speed if speed < 0.0 => -backward,
            _ => driving.clamp(-backward, forward),
        };
        let next = self.speed + STEP_S * (driving - friction) / inertia;
        let next = if next * self.speed < 0.0 { 0.0 } else { next };
        self.angle += 0.5 * STEP_S * (self.speed + next);
        self.speed = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_at_rest_stays_there_below_its_friction() {
        let truth = AxisTruth { per_command: 1.0, inertia: 1.0, dry: 2.0, ..AxisTruth::default() };
        let mut shaft = Shaft { truth, speed: 0.0, angle: 0.0 };
        (0..1000).for_each(|_| shaft.advance(1.9));
        assert_eq!(shaft.angle, 0.0);
        (0..40_000).for_each(|_| shaft.advance(3.0));
        assert!((shaft.speed - 1.0).abs() < 1e-3, "a newton too many moves a kilogram: {}", shaft.speed);
    }
}
