//! Simulated benches with a hidden effect, for tests of the diagnosis.
//!
//! The simulation is written separately from the models that it tests. Every rig is stepped at 20 us or less (2.5 us
//! where the PWM is switched). The seed chooses Karnopp's or LuGre's friction. Sensors are sampled, quantised and noisy
//! as on the Uno. The diagnosis gets only [`Trial::csv`] and [`Trial::rig_toml`].

mod axis;
mod drive;
mod live;
mod rig;
mod sensors;

pub use axis::{AxisEffect, AxisKind, AxisTrial, AxisTruth, draw_axis};
pub use drive::Excitation;
pub use live::{LiveBench, Switch};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// An effect that can be hidden. Each lists its range from strength 0 to 1; below 0 each unit is a tenth of the
/// weakest. Torques are shares of the stall torque.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Effect {
    /// Constant friction that sticks, 3 to 15 %.
    /// T = `torque_Nm` sign(w). Geared and brushed motors of this size lie in the range.
    CoulombFriction,
    /// Coulomb friction and 40 to 120 % of it on top near standstill, gone over 1.5 to 5 % of full speed.
    /// T = `excess_torque_Nm` exp(-(w / `stribeck_speed_rad_per_s`)^2) sign(w); in three of ten without the square.
    StribeckFriction,
    /// Coulomb friction, 15 to 45 % of it more one way and less the other.
    /// `difference_Nm`: level forward less level backward, as brushes set off the neutral line give.
    FrictionAsymmetry,
    /// A fan that takes 4 to 25 % at full speed.
    /// T = `drag_Nm_s2` w |w|.
    QuadraticDrag,
    /// A constant torque of 3 to 15 % that keeps its sign.
    /// T = `torque_Nm`: a weight on a drum.
    LoadTorque,
    /// 4 to 15 % that come at 30 to 70 % of the recording and stay.
    /// T = `torque_Nm` from `time_s` on.
    LoadStep,
    /// Coulomb friction that falls by 25 to 55 %, within 3 to 8 s. Coulomb and viscous friction times 1 +
    /// `excess_share` exp(-t / `time_constant_s`); the truth's Coulomb level is the warm one. The time constant is 15
    /// to 40 % of the recording.
    FrictionWarmup,
    /// 3 to 12 periods a revolution of 2 to 10 %.
    /// T sin(`periods_per_rev` angle + phase).
    Cogging,
    /// One period a revolution of 2 to 12 %.
    /// T sin(angle + phase).
    GravityUnbalance,
    /// 2 to 8 degrees of play before 30 to 60 % of the inertia.
    /// `gap_rad`, `load_inertia_share` of the motor's inertia; the sensor is at the motor.
    Backlash,
    /// 30 to 60 % of the inertia behind a spring that rings at 8 to 45 Hz.
    /// `resonance_Hz` with both ends free, `load_inertia_share`; damping ratio 0.02 to 0.08; the sensor is at the motor.
    ShaftCompliance,
    /// 0.5 to 2.5 V lost while current flows.
    /// u - `drop_V` sign(i): the range spans MOSFET bridges to the Darlingtons of an L293D. Of three, one follows the
    /// mean current, as behind an amplifier. Half of those do so over a knee of 0.2 to 2 % of the greatest current.
    VoltageDrop,
    /// A supply with an inner resistance of 10 to 40 % of the winding's. u = duty (supply - `resistance_ohm` duty i)
    /// behind a capacitor. Three of ten have none (`within_pulses`), and the whole current flows while a pulse lasts: u
    /// = duty (supply - `resistance_ohm` i sign(duty)).
    SupplySag,
    /// The winding's resistance rises by 15 to 45 % in the course of the recording.
    /// Copper, 0.393 %/K: R (1 + x) with `time_constant_s` dx/dt = `rise_per_W` P - x, P the power lost in the winding.
    WindingHeating,
    /// The off phase of the PWM coasts, or the bridge does where nothing is asked for.
    /// The current is switched at 20 kHz and dies out through the diodes; the rig file still says slow decay.
    CoastDecay,
    /// The voltage comes 3 to 10 ms late.
    /// `delay_s`.
    ActuationDelay,
    /// A computer's clock commands and the board's reads, 100 to 1000 ppm slower or faster.
    /// `drift_ppm`: a command acts so many microseconds later for each second of the recording.
    ClockDrift,
    /// 40 to 150 mA more or less than flow are read.
    /// `offset_A`, of either sign: four to fifteen times the noise.
    CurrentOffset,
    /// The current is read through a filter of 3 to 15 ms.
    /// First order, `time_constant_s`; the sensor's own, or of two in five the program's, of the readings.
    CurrentLag,
    /// The current's reading ends at 70 to 40 % of its peak.
    CurrentClipping,
    /// The disc is off centre: 0.6 to 3 degrees.
    EncoderEccentricity,
    /// 5 to 20 % of the edges above 75 to 55 % of full speed are lost. Two in five lose that share of all edges while
    /// the motor is that fast. In half of these the loss comes up gradually, over a tenth to half of that speed. Where
    /// nothing but counts says how fast it is, half of them are lost at random. Where counts are recorded, of three in
    /// ten the counter stands instead, some twenty times, for `stop_s`: 3 to 50 ms.
    MissedCounts,
    /// 2 to 5 % of ripple, 11 to 31 times a revolution.
    /// Speed times 1 + ripple sin(`ripples_per_rev` angle + phase).
    TachoRipple,
    /// The speed is read through a filter of 3 to 15 ms.
    /// First order, `time_constant_s`; the tachogenerator's own, or of two in five the program's, of the readings.
    SpeedLag,
    /// The bridge gives 3 to 20 % less one way.
    /// u (1 + `backward_share`) where u < 0, or that much less than backwards where u > 0.
    BridgeAsymmetry,
    /// The winding's resistance is 15 to 60 % greater at full speed.
    /// R + `growth_ohm_s` |w|: a commutator that sparks.
    ResistanceGrowingWithSpeed,
    /// A bridge's drop, 15 to 40 % of it more one way and less the other.
    /// `difference_V`: drop of a current forwards less that of one backwards.
    DropAsymmetry,
    /// The torque constant ripples by 2 to 5 %, 8 to 26 times a revolution, in torque and back-EMF. 5 to 13 commutator
    /// segments; `amplitude_share` of the first harmonic, `ripples_per_rev`. The crests of the coils' EMF, averaged
    /// over the width of the brushes, have higher harmonics as well.
    CommutationRipple,
    /// Not in the catalogue: a shaker pulls at 4 to 9 Hz, 6 to 15 %.
    OutsideShaker,
    /// Not in the catalogue: the torque constant falls with the current, by 25 to 50 % at the peak.
    OutsideSaturation,
    /// Not in the catalogue: the supply drops out for 30 to 60 ms, some twenty times.
    OutsideDropouts,
    /// Not in the catalogue: the speed sensor's scale wanders by 5 to 15 %.
    OutsideDrift,
    /// Not in the catalogue: the speed sensor shows nothing below 8 to 20 % of full speed.
    OutsideDeadBand,
    /// Not in the catalogue: a bent spindle that binds every 5 to 9 revolutions, 5 to 15 %.
    OutsideSpindle,
    /// Not in the catalogue: something grips the shaft for 20 to 50 ms, some twenty times, with 30 to 100 %.
    OutsideGrip,
    /// Not in the catalogue: a soft spring between shaft and frame, 0.5 to 6 %.
    /// It is wound up within 20 to 60 rad of where the shaft began.
    OutsideSpring,
    /// Not in the catalogue: drag in proportion to the cube of the speed, 6 to 25 % at full speed.
    OutsideCube,
}

impl Effect {
    /// Effects of the catalogue that any recording may have.
    pub const CATALOGUE: [Self; 22] = [
        Self::CoulombFriction,
        Self::StribeckFriction,
        Self::FrictionAsymmetry,
        Self::QuadraticDrag,
        Self::LoadTorque,
        Self::LoadStep,
        Self::FrictionWarmup,
        Self::Cogging,
        Self::GravityUnbalance,
        Self::Backlash,
        Self::ShaftCompliance,
        Self::VoltageDrop,
        Self::SupplySag,
        Self::WindingHeating,
        Self::CoastDecay,
        Self::ActuationDelay,
        Self::CurrentOffset,
        Self::CurrentLag,
        Self::CurrentClipping,
        Self::EncoderEccentricity,
        Self::MissedCounts,
        Self::TachoRipple,
    ];
    /// Further effects of the catalogue, one of a tachogenerator alone: drawn only on request.
    pub const ASKED_FOR: [Self; 6] = [
        Self::SpeedLag,
        Self::BridgeAsymmetry,
        Self::ResistanceGrowingWithSpeed,
        Self::DropAsymmetry,
        Self::CommutationRipple,
        Self::ClockDrift,
    ];
    /// Effects outside the catalogue.
    pub const OUTSIDE: [Self; 9] = [
        Self::OutsideShaker,
        Self::OutsideSaturation,
        Self::OutsideDropouts,
        Self::OutsideDrift,
        Self::OutsideDeadBand,
        Self::OutsideSpindle,
        Self::OutsideGrip,
        Self::OutsideSpring,
        Self::OutsideCube,
    ];

    /// Its identifier in the catalogue.
    pub fn id(self) -> &'static str {
        match self {
            Self::CoulombFriction => "coulomb_friction",
            Self::StribeckFriction => "stribeck_friction",
            Self::FrictionAsymmetry => "friction_asymmetry",
            Self::QuadraticDrag => "quadratic_drag",
            Self::LoadTorque => "load_torque",
            Self::LoadStep => "load_step",
            Self::FrictionWarmup => "friction_warmup",
            Self::Cogging => "cogging",
            Self::GravityUnbalance => "gravity_unbalance",
            Self::Backlash => "backlash",
            Self::ShaftCompliance => "shaft_compliance",
            Self::VoltageDrop => "voltage_drop",
            Self::SupplySag => "supply_sag",
            Self::WindingHeating => "winding_heating",
            Self::CoastDecay => "coast_decay",
            Self::ActuationDelay => "actuation_delay",
            Self::ClockDrift => "clock_drift",
            Self::CurrentOffset => "current_offset",
            Self::CurrentLag => "current_lag",
            Self::CurrentClipping => "current_clipping",
            Self::EncoderEccentricity => "encoder_eccentricity",
            Self::MissedCounts => "missed_counts",
            Self::TachoRipple => "tacho_ripple",
            Self::SpeedLag => "speed_lag",
            Self::BridgeAsymmetry => "bridge_asymmetry",
            Self::ResistanceGrowingWithSpeed => "resistance_growing_with_speed",
            Self::DropAsymmetry => "drop_asymmetry",
            Self::CommutationRipple => "commutation_ripple",
            Self::OutsideShaker => "outside_shaker",
            Self::OutsideSaturation => "outside_saturation",
            Self::OutsideDropouts => "outside_dropouts",
            Self::OutsideDrift => "outside_drift",
            Self::OutsideDeadBand => "outside_dead_band",
            Self::OutsideSpindle => "outside_spindle",
            Self::OutsideGrip => "outside_grip",
            Self::OutsideSpring => "outside_spring",
            Self::OutsideCube => "outside_cube",
        }
    }

    /// Whether its strength can vary.
    pub fn has_strength(self) -> bool {
        self != Self::CoastDecay
    }

    /// Effects that modify a friction, and therefore bring Coulomb friction with them.
    pub fn needs_coulomb(self) -> bool {
        matches!(self, Self::StribeckFriction | Self::FrictionAsymmetry | Self::FrictionWarmup)
    }
}

/// Columns of the recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// `t_s, duty, u_V, counts, omega_rad_per_s, i_A`.
    Full,
    /// `t_s, u_V, omega_rad_per_s, i_A`.
    VoltageSpeedCurrent,
    /// `t_s, duty, counts, i_A`.
    DutyCountsCurrent,
    /// `t_s, u_V, omega_rad_per_s`.
    VoltageSpeed,
    /// `t_s, u_V, omega_rad_per_s, i_A`, the speed being a difference of counts over some rows, up to its own or around it.
    VoltageMeanSpeedCurrent,
    /// `t_s, u_V, omega_rad_per_s, i_A`; the speed is timed by the edges of a coarse encoder. It is timed by the last
    /// two, and held until the next or for a fifth of a second. Or it is timed by all since the row before, and fades
    /// while none comes.
    VoltageTimedSpeedCurrent,
}

impl Channels {
    /// Whether there are counts, or a speed that is computed from them.
    fn has_counts(self) -> bool {
        self == Self::Full || self.speed_is_of_counts()
    }

    /// Whether only counts show the speed.
    fn speed_is_of_counts(self) -> bool {
        matches!(self, Self::DutyCountsCurrent | Self::VoltageMeanSpeedCurrent)
    }
}

/// A wrong scale of the recording or the rig file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mistake {
    /// Counts per revolution in the rig file, as a multiple of the true value.
    CountsPerRev(f64),
    /// Supply voltage in the rig file, as a multiple of the true value.
    SupplyVoltage(f64),
    /// Recorded current, as a multiple of the true value.
    CurrentScale(f64),
}

impl Mistake {
    /// Draws a usual mistake: half or a quarter of the edges counted, another supply, milliamperes, another type of
    /// ACS712.
    pub fn draw(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x05ca_1e00);
        let mut one_of = |factors: &[f64]| factors[random.random_range(0..factors.len())];
        match seed % 3 {
            0 => Self::CountsPerRev(one_of(&[2.0, 4.0])),
            1 => Self::SupplyVoltage(one_of(&[0.5, 2.0, 2.4])),
            _ => Self::CurrentScale(one_of(&[1000.0, 1.85, 1.0 / 1.85, 2.8, 1.0 / 2.8])),
        }
    }

    /// The name it has in a diagnosis.
    pub fn id(self) -> &'static str {
        match self {
            Self::CountsPerRev(_) => "parameter:counts_per_rev",
            Self::SupplyVoltage(_) => "parameter:supply_voltage",
            Self::CurrentScale(_) => "parameter:current_scale",
        }
    }
}

/// Specification of a trial.
#[derive(Clone, Debug)]
pub struct Recipe {
    /// Hidden effects, each with its strength from 0 to 1, or below.
    pub effects: Vec<(Effect, f64)>,
    /// The rig has Coulomb friction and a bridge drop besides.
    pub real_rig: bool,
    /// Columns.
    pub channels: Channels,
    /// The excitation of the motor.
    pub excitation: Excitation,
    /// Length.
    pub duration_s: f64,
    /// Samples a second.
    pub rate_hz: f64,
    /// One row is written for this many steps; the commands of the others are not recorded.
    pub one_row_of: usize,
    /// Each row has the command that acted before it was read, not the one that acts from then on.
    pub written_after: bool,
    /// The PWM has the frequency of one of the Uno's timers, and the rig file does not give it.
    pub timer_of_the_uno: bool,
    /// A bridge that drops a voltage is one of bipolar transistors: it drops more of a greater current, and another voltage in
    /// the off phase.
    pub darlingtons: bool,
    /// The current of a row is the mean of four to nineteen conversions that ended with it.
    pub burst: bool,
    /// A wrong scale in the rig file or the recording.
    pub mistake: Option<Mistake>,
}

impl Recipe {
    /// 20 s of the identifying sequence at 1 kHz, every column, with these effects at medium strength.
    pub fn of(effects: &[Effect]) -> Self {
        Self {
            effects: effects.iter().map(|effect| (*effect, 0.5)).collect(),
            real_rig: false,
            channels: Channels::Full,
            excitation: Excitation::Identify,
            duration_s: 20.0,
            rate_hz: 1000.0,
            one_row_of: 1,
            written_after: false,
            timer_of_the_uno: false,
            darlingtons: false,
            burst: false,
            mistake: None,
        }
    }

    /// The same on a rig that also has Coulomb friction and a bridge drop.
    pub fn on_real_rig(mut self) -> Self {
        self.real_rig = true;
        self
    }

    /// Strengths drawn anew, the same for the same seed.
    pub fn with_random_strengths(mut self, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x5eed_0f57);
        for (_, strength) in &mut self.effects {
            *strength = random.random_range(0.0..1.0);
        }
        self
    }
}

/// Sets of effects that are equivalent or hide each other: never drawn together.
const EXCLUSIVE: [&[Effect]; 5] = [
    &[Effect::LoadTorque, Effect::FrictionAsymmetry],
    &[Effect::Backlash, Effect::ShaftCompliance],
    &[Effect::CurrentClipping, Effect::CurrentLag],
    &[Effect::CoastDecay, Effect::SupplySag],
    &[Effect::TachoRipple, Effect::EncoderEccentricity, Effect::MissedCounts],
];

/// `count` different effects of the catalogue that can be told apart; with `real_rig` without those that the rig has
/// anyway.
pub fn random_effects(seed: u64, count: usize, real_rig: bool) -> Vec<Effect> {
    let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x00e_ffec7);
    let mut chosen: Vec<Effect> = Vec::new();
    while chosen.len() < count {
        let effect = Effect::CATALOGUE[random.random_range(0..Effect::CATALOGUE.len())];
        let of_the_rig = real_rig && matches!(effect, Effect::CoulombFriction | Effect::VoltageDrop);
        let clash = EXCLUSIVE.iter().any(|set| set.contains(&effect) && chosen.iter().any(|other| set.contains(other)));
        if !chosen.contains(&effect) && !of_the_rig && !clash {
            chosen.push(effect);
        }
    }
    chosen
}

/// Constants of a linear motor, in SI units.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct Motor {
    pub resistance_ohm: f64,
    pub inductance_h: f64,
    pub torque_constant_nm_per_a: f64,
    pub inertia_kg_m2: f64,
    pub viscous_friction_nm_s: f64,
}

/// The truth of a trial.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Every effect that is present, with the constants that can be compared, by the catalogue's names.
    pub effects: Vec<(Effect, Vec<(&'static str, f64)>)>,
    /// The true motor.
    pub motor: Motor,
    /// The motor of the rig file.
    pub nominal: Motor,
    /// The wrong scale, if there is one.
    pub mistake: Option<Mistake>,
    /// Whether a drop differs from a motor with other constants: behind two levels of one magnitude it does not.
    pub drop_shows: bool,
    /// Whether the bridge has a part of the resistance: that of the winding alone does not show.
    pub bridge_resists: bool,
}

/// A recording with its truth.
#[derive(Clone, Debug)]
pub struct Trial {
    /// The recording.
    pub csv: String,
    /// The rig file, with the known values.
    pub rig_toml: String,
    /// The truth.
    pub truth: Truth,
}

/// Draws a bench, hides the effects in it and records it. The same seed and recipe give the same trial.
pub fn draw(seed: u64, recipe: &Recipe) -> Trial {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let motor = draw_motor(&mut random);
    let (bench, effects) = rig::Bench::draw(motor, recipe, &mut random);
    let nominal = wrong(motor, &mut random);
    let rig_toml = rig_toml(&bench, &nominal, recipe);
    let csv = sensors::record(bench, recipe, &mut random);
    let drop_shows = recipe.excitation != Excitation::Prbs;
    let bridge_resists = recipe.darlingtons;
    Trial {
        csv,
        rig_toml,
        truth: Truth { effects, motor, nominal, mistake: recipe.mistake, drop_shows, bridge_resists },
    }
}

fn log_uniform(random: &mut impl Rng, from: f64, to: f64) -> f64 {
    random.random_range(from.ln()..to.ln()).exp()
}

fn draw_motor(random: &mut impl Rng) -> Motor {
    let resistance_ohm = log_uniform(random, 1.5, 12.0);
    let torque_constant_nm_per_a = log_uniform(random, 0.012, 0.08);
    let electrical_s = log_uniform(random, 0.4e-3, 3e-3);
    let mechanical_s = log_uniform(random, 0.015, 0.12);
    let stiffness = torque_constant_nm_per_a.powi(2) / resistance_ohm;
    Motor {
        resistance_ohm,
        inductance_h: electrical_s * resistance_ohm,
        torque_constant_nm_per_a,
        inertia_kg_m2: mechanical_s * stiffness,
        viscous_friction_nm_s: random.random_range(0.01..0.05) * stiffness,
    }
}

/// Data sheet values: each off by up to 20 %.
fn wrong(motor: Motor, random: &mut impl Rng) -> Motor {
    let mut off = |value: f64| value * random.random_range(0.8..1.2);
    Motor {
        resistance_ohm: off(motor.resistance_ohm),
        inductance_h: off(motor.inductance_h),
        torque_constant_nm_per_a: off(motor.torque_constant_nm_per_a),
        inertia_kg_m2: off(motor.inertia_kg_m2),
        viscous_friction_nm_s: off(motor.viscous_friction_nm_s),
    }
}

fn rig_toml(bench: &rig::Bench, nominal: &Motor, recipe: &Recipe) -> String {
    let by_tachogenerator = [Effect::TachoRipple, Effect::SpeedLag];
    let has_tachogenerator = recipe.effects.iter().any(|(effect, _)| by_tachogenerator.contains(effect));
    let tacho = if has_tachogenerator { "[tachogenerator]\n" } else { "" };
    let (supply, counts) = match recipe.mistake {
        Some(Mistake::SupplyVoltage(factor)) => (factor, 1.0),
        Some(Mistake::CountsPerRev(factor)) => (1.0, factor),
        _ => (1.0, 1.0),
    };
    let pwm = if recipe.timer_of_the_uno { "" } else { "pwm_Hz = 20000.0\n" };
    let encoder = match recipe.channels {
        // The number of slots is not in the rig file.
        Channels::VoltageTimedSpeedCurrent => String::new(),
        _ => format!("[encoder]\ncounts_per_rev = {}\n", bench.counts_per_rev * counts),
    };
    format!(
        "[supply]\nvoltage_V = {}\n[bridge]\ndecay = \"slow\"\n{pwm}{encoder}\
         [current_sensor]\nresolution_A = {}\n{tacho}[motor]\nresistance_ohm = {}\ninductance_H = {}\n\
         torque_constant_Nm_per_A = {}\ninertia_kg_m2 = {}\nviscous_friction_Nm_s = {}\n",
        bench.supply_v * supply,
        sensors::CURRENT_STEP_A,
        nominal.resistance_ohm,
        nominal.inductance_h,
        nominal.torque_constant_nm_per_a,
        nominal.inertia_kg_m2,
        nominal.viscous_friction_nm_s
    )
}
