//! Tables of steady states of randomly drawn motors: the missing terms are named, and no others.
//!
//! The tables are computed here from the power balance, not from the equations of the study. Each fresh draw must reach
//! a bound that a correct program misses less than once in ten thousand.

use crate::fresh_seed;
use motorbench_data::recording::{Channel, Recording};
use motorbench_data::rig::Rig;
use motorbench_diagnosis::steady_state::Winding;
use motorbench_diagnosis::steady_state::{Study, study};
use motorbench_model::catalogue::ActsOn;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

const TABLES: u64 = 200;
/// Of 200 at least 193 are right on the average, in the worst of these tests. Within two intervals of 95 % lies the
/// truth of 175.
const FEWEST_RIGHT: u64 = 180;
const FEWEST_WITHIN: u64 = 150;
/// What the rig file says.
const NOMINAL_OHM: f64 = 5.84;
const NOMINAL_V_S: f64 = 0.072;

/// What is true of a motor.
#[derive(Clone, Copy, Debug)]
struct Motor {
    resistance_ohm: f64,
    constant_v_s: f64,
    drop_v: f64,
    growth_ohm_s: f64,
    dry_nm: f64,
    viscous_nm_s: f64,
}

impl Motor {
    /// As the rig file says, with friction.
    fn nominal(random: &mut ChaCha8Rng) -> Self {
        Self {
            resistance_ohm: NOMINAL_OHM,
            constant_v_s: NOMINAL_V_S,
            drop_v: 0.0,
            growth_ohm_s: 0.0,
            dry_nm: random.random_range(0.005..0.02),
            viscous_nm_s: random.random_range(2e-6..2e-5),
        }
    }

    /// Electrical power less that of the losses, which is 0 at the speed that it runs at.
    fn power_left_w(&self, u_v: f64, load_nm: f64, omega: f64) -> f64 {
        let torque_nm = self.dry_nm + load_nm + self.viscous_nm_s * omega;
        let i_a = torque_nm / self.constant_v_s;
        let resistance_ohm = self.resistance_ohm + self.growth_ohm_s * omega;
        u_v * i_a - self.drop_v * i_a - resistance_ohm * i_a.powi(2) - torque_nm * omega
    }

    /// Speed by halving, and current.
    fn runs_at(&self, u_v: f64, load_nm: f64) -> (f64, f64) {
        let (mut slow, mut fast) = (0.0, 1e4);
        for _ in 0..100 {
            let middle = 0.5 * (slow + fast);
            if self.power_left_w(u_v, load_nm, middle) > 0.0 { slow = middle } else { fast = middle }
        }
        (slow, (self.dry_nm + load_nm + self.viscous_nm_s * slow) / self.constant_v_s)
    }

    fn table(&self, loads_nm: &[f64], random: &mut ChaCha8Rng) -> Recording {
        let (current, speed) = (Normal::new(0.0, 2e-4).unwrap(), Normal::new(0.0, 0.02).unwrap());
        // All readings at a level are off by the same: the shaft was warmer, the supply a little lower.
        let drifted = Normal::new(0.0, 0.05).unwrap();
        let mut columns = [const { Vec::new() }; 4];
        for load_nm in loads_nm {
            for u_v in [4.5, 6.0, 7.5, 9.0, 10.5, 12.0] {
                let (omega, i_a) = self.runs_at(u_v, *load_nm);
                let omega = omega + drifted.sample(random);
                for _ in 0..5 {
                    let row = [u_v, i_a + current.sample(random), omega + speed.sample(random), *load_nm];
                    columns.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
                }
            }
        }
        let channels = [Channel::Voltage, Channel::Current, Channel::Speed, Channel::LoadTorque];
        let mut table = Recording::new("drawn");
        channels.into_iter().zip(columns).for_each(|(channel, column)| table.set(channel, column));
        table
    }
}

fn rig() -> Rig {
    let text = format!("[motor]\nresistance_ohm = {NOMINAL_OHM}\ntorque_constant_Nm_per_A = {NOMINAL_V_S}\n");
    Rig::parse("rig.toml", &text).unwrap()
}

/// In how many of the tables exactly these are named beside friction, and in how many the truth lies within their
/// intervals.
fn named(
    seed: u64,
    loads_nm: &[f64],
    winding: Option<&Winding>,
    draw: impl Fn(&mut Motor, &mut ChaCha8Rng) -> Vec<(&'static str, f64)>,
) -> (u64, u64) {
    let (mut right, mut within) = (0, 0);
    for table in 0..TABLES {
        let mut random = ChaCha8Rng::seed_from_u64(seed.wrapping_add(table));
        let mut motor = Motor::nominal(&mut random);
        let truth = draw(&mut motor, &mut random);
        let Study { outcome, .. } = study(&motor.table(loads_nm, &mut random), &rig(), winding).unwrap();
        let (friction, causes) = outcome.causes.split_last().expect("every motor has friction");
        if friction.effect == "coulomb_friction"
            && causes.iter().map(|cause| &*cause.effect).eq(truth.iter().map(|(effect, _)| *effect))
        {
            right += 1;
            let holds = causes.iter().zip(&truth).all(|(cause, (_, value))| {
                let [low, high] = cause.parameters.values().next().unwrap().ci95.unwrap();
                (low..=high).contains(value)
            });
            within += u64::from(holds);
        } else {
            let causes: Vec<&str> = outcome.causes.iter().map(|cause| &*cause.effect).collect();
            println!("{causes:?} in place of {truth:?}");
        }
    }
    println!("{right} of {TABLES}, {within} within");
    (right, within)
}

#[test]
fn the_nominal_motor_lacks_nothing_but_friction() {
    let (right, _) = named(fresh_seed(), &[0.0], None, |_, _| Vec::new());
    assert!(right >= FEWEST_RIGHT, "{right}");
}

#[test]
fn a_drop_and_a_constant_are_found_without_load() {
    let (right, within) = named(fresh_seed(), &[0.0], None, |motor, random| {
        motor.drop_v = random.random_range(1.0..3.0);
        motor.constant_v_s *= random.random_range(1.03..1.2);
        vec![("voltage_drop", motor.drop_v), ("parameter:torque_constant", motor.constant_v_s)]
    });
    assert!(right >= FEWEST_RIGHT && within >= FEWEST_WITHIN, "{right}, {within}");
}

#[test]
fn a_resistance_is_found_where_loads_or_a_held_winding_tell_it_from_a_drop() {
    let high = |motor: &mut Motor, random: &mut ChaCha8Rng| {
        motor.resistance_ohm = NOMINAL_OHM * random.random_range(1.1..1.5);
        vec![("parameter:resistance", motor.resistance_ohm)]
    };
    let (right, within) = named(fresh_seed(), &[0.0, 0.01, 0.02], None, high);
    assert!(right >= FEWEST_RIGHT && within >= FEWEST_WITHIN, "{right}, {within}");
    let winding = Winding::of(vec![14.8, 15.1, 15.2, 14.9]);
    let (right, _) = named(fresh_seed(), &[0.0], winding.as_ref(), |motor, _| {
        motor.resistance_ohm = 15.0;
        vec![("parameter:resistance", 15.0)]
    });
    assert!(right >= FEWEST_RIGHT, "{right}");
}

/// A rest that no term explains has no name. Its place and its dependence are reported, and a drop smaller than a third
/// of it is not named.
#[test]
fn what_remains_of_a_table_is_located() {
    let rest = |lost_v: fn(f64) -> f64, drag_nm_s2: f64, loads_nm: &[f64]| {
        let mut text = String::from("u_V,i_A,omega_rad_per_s,load_Nm\n");
        for u_v in [4.0, 6.0, 8.0, 10.0, 12.0] {
            for load_nm in loads_nm {
                let omega_at = |i_a: f64| (u_v - lost_v(u_v) - NOMINAL_OHM * i_a) / NOMINAL_V_S;
                let current_a = |omega: f64| (0.006 + load_nm + drag_nm_s2 * omega * omega) / NOMINAL_V_S;
                let i_a = (0..100).fold(0.0, |i_a, _| 0.5 * i_a + 0.5 * current_a(omega_at(i_a)));
                for scatter in [-1.0, 1.0] {
                    text += &format!("{u_v},{},{},{load_nm}\n", i_a + 1e-4 * scatter, omega_at(i_a) + 0.02 * scatter);
                }
            }
        }
        let table = Recording::parse("table.csv", text.as_bytes(), &[]).unwrap();
        let outcome = study(&table, &rig(), None).unwrap().outcome;
        let rest = outcome.unexplained.map(|rest| (rest.acts_on, rest.depends_on, rest.share > 0.9));
        (rest, outcome.causes.into_iter().map(|cause| cause.effect).collect::<Vec<_>>())
    };
    let (loads_nm, friction) = ([0.0, 0.005, 0.01], ["coulomb_friction".to_string()]);
    let bent: fn(f64) -> f64 = |u_v| 0.03 * (u_v - 8.0).powi(2);
    assert_eq!(rest(bent, 0.0, &loads_nm), (Some((ActsOn::Voltage, "voltage".into(), true)), friction.to_vec()));
    let (drag, named) = rest(|_| 0.0, 1e-6, &loads_nm);
    assert_eq!(drag, Some((ActsOn::Torque, "speed".into(), true)));
    assert_eq!(named, [""; 0], "the drag is most of what a dry friction explains");
    // Without a load voltage and speed go together.
    let (drag, _) = rest(|_| 0.0, 1e-6, &[0.0]);
    assert!(drag.is_some_and(|(acts_on, on, _)| acts_on == ActsOn::Torque && on.contains(" or ")));
    assert_eq!(rest(|_| 1.5, 0.0, &loads_nm), (None, ["voltage_drop".to_string(), friction[0].clone()].to_vec()));
}

/// Under loads it is told from everything else; without, the constant is named and it stands beside that.
#[test]
fn a_resistance_that_grows_with_the_speed_is_named_where_only_it_explains_the_table() {
    let growing = |motor: &mut Motor, random: &mut ChaCha8Rng| {
        motor.drop_v = random.random_range(1.0..3.0);
        motor.growth_ohm_s = random.random_range(0.02..0.06);
        vec![("voltage_drop", motor.drop_v), ("resistance_growing_with_speed", motor.growth_ohm_s)]
    };
    let (right, within) = named(fresh_seed(), &[0.0, 0.01, 0.02], None, growing);
    assert!(right >= FEWEST_RIGHT && within >= FEWEST_WITHIN, "{right}, {within}");
}
