//! Compares a motor with an earlier test. Two straight lines over speed go through both tests: the voltage that nominal
//! resistance and back-EMF leave, and the torque.

use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_diagnosis::diagnose::outcome::Estimate;
use motorbench_diagnosis::identify::Z95;
use motorbench_diagnosis::steady_state::{Level, Line, StudyError, errors, levels, nominal, rows};
use serde::Serialize;

/// A difference is a change from this many standard errors on.
const CHANGED_SIGMAS: f64 = 3.0;
/// Relative increase of copper's resistance per kelvin.
const COPPER_PER_K: f64 = 0.0039;
/// Largest plausible difference of the winding temperature between two tests.
const GREATEST_WARMTH_K: f64 = 100.0;
const UNCHANGED: &str = "unchanged within the errors";

/// A property of the motor against an earlier test.
#[derive(Clone, Debug, Serialize)]
pub struct Condition {
    /// Brushes or winding, magnets, bearings.
    pub part: &'static str,
    /// What is compared, with its unit.
    pub quantity: &'static str,
    /// In the earlier test.
    pub before: Estimate,
    /// Now.
    pub now: Estimate,
    /// Difference in standard errors.
    pub sigmas: f64,
    /// Its meaning.
    pub verdict: String,
    /// For a changed voltage: temperature rise of a winding that would explain it.
    #[serde(rename = "winding_warmer_K")]
    pub winding_warmer_k: Option<f64>,
}

/// The quantities that both tests are compared by.
struct Lines {
    lost_v: Estimate,
    emf: Estimate,
    dry_nm: Estimate,
    viscous: Estimate,
    /// Current at standstill, where that voltage is lost.
    standstill_a: f64,
}

impl Lines {
    fn of(test: &[Level], k: f64) -> Option<Self> {
        let speed: Vec<f64> = test.iter().map(|level| level.omega_rad_per_s).collect();
        let constant = vec![1.0; speed.len()];
        let columns: [&[f64]; 2] = [&constant, &speed];
        let line = |of: &dyn Fn(&Level) -> f64, error: &dyn Fn(&Level) -> f64| {
            Line::new(&columns, &test.iter().map(of).collect::<Vec<_>>(), &errors(test, error))
        };
        let voltage = line(&|level| level.missing_V, &|level| level.voltage_error)?;
        let torque = line(&|level| level.torque_Nm - level.load_Nm, &|level| k * level.current_error)?;
        let current = line(&|level| level.i_A, &|level| level.current_error)?;
        let Estimate { value, ci95 } = voltage.estimate(1);
        Some(Self {
            lost_v: voltage.estimate(0),
            emf: Estimate { value: k + value, ci95: ci95.map(|ci95| ci95.map(|end| k + end)) },
            dry_nm: torque.estimate(0),
            viscous: torque.estimate(1),
            standstill_a: current.estimate(0).value,
        })
    }
}

/// The motor now against an earlier test.
pub(super) fn condition(earlier: &Recording, now: &[Level], rig: &Rig) -> Result<Vec<Condition>, StudyError> {
    let (r, k) = nominal(rig)?;
    let earlier = levels(&earlier.name, &rows(earlier, k)?, r, k)?;
    let (Some(before), Some(now)) = (Lines::of(&earlier, k), Lines::of(now, k)) else { return Ok(Vec::new()) };
    let dry = Condition::new("bearings", "dry friction, Nm", before.dry_nm, now.dry_nm);
    let warmer_k = (now.lost_v.value - before.lost_v.value) / (COPPER_PER_K * r * now.standstill_a);
    Ok(vec![
        Condition::new("brushes", "voltage lost at standstill, V", before.lost_v, now.lost_v)
            .by_warmth(warmer_k, dry.sigmas > CHANGED_SIGMAS),
        Condition::new("magnets", "back-EMF constant, V s/rad", before.emf, now.emf).judged(
            "the back-EMF constant has grown: check the speed's scale",
            "the back-EMF constant has fallen: magnets weakened or hot",
        ),
        dry.judged("more dry friction: bearings or brush pressure", "less dry friction: run in"),
        Condition::new("bearings", "viscous friction, Nm s", before.viscous, now.viscous)
            .judged("more viscous friction: grease or cold", "less viscous friction: run in or warm"),
    ])
}

impl Condition {
    fn new(part: &'static str, quantity: &'static str, before: Estimate, now: Estimate) -> Self {
        // Both intervals have the width of Student's distribution, nearly two standard errors a side.
        let half = |estimate: &Estimate| estimate.ci95.map_or(0.0, |ci95| 0.5 * (ci95[1] - ci95[0]));
        let sigmas = Z95 * (now.value - before.value) / half(&before).hypot(half(&now)).max(f64::MIN_POSITIVE);
        Self { part, quantity, before, now, sigmas, verdict: UNCHANGED.into(), winding_warmer_k: None }
    }

    fn is_changed(&self) -> bool {
        self.sigmas.abs() > CHANGED_SIGMAS
    }

    fn judged(mut self, more: &str, less: &str) -> Self {
        if self.is_changed() {
            self.verdict = if self.sigmas > 0.0 { more } else { less }.into();
        }
        self
    }

    /// For the voltage: a table without loads cannot tell the loss of the brushes from that of a warmer winding. More
    /// friction of the brushes indicates the brushes.
    fn by_warmth(mut self, warmer_k: f64, rubs_more: bool) -> Self {
        if !self.is_changed() {
            return self;
        }
        self.winding_warmer_k = Some(warmer_k);
        let (more_or_less, kelvin) = (if warmer_k > 0.0 { "warmer" } else { "cooler" }, warmer_k.abs());
        let alone = format!("a winding would be {kelvin:.0} K {more_or_less} for that alone");
        if kelvin < GREATEST_WARMTH_K && !rubs_more {
            let quantity = if warmer_k > 0.0 { "more" } else { "less" };
            self.part = "winding";
            self.verdict = format!(
                "{quantity} voltage is lost, as by a winding {kelvin:.0} K {more_or_less}. Compare tests at the same temperature"
            );
            return self;
        }
        self.judged(
            &format!("more voltage is lost: brushes or commutator worn or dirty; {alone}"),
            &format!("less voltage is lost: run in; {alone}"),
        )
    }
}
