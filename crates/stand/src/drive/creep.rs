//! Measures the winding while the rotor turns slowly. A hand or a brake holds it back to a few seconds a revolution
//! while a current flows. Each current is held for a whole revolution.
//!
//! In each sector the voltage without the back-EMF lies on a line over the current. Its slope is the resistance there.
//! This averages the commutation within a sector, which a held rotor does not.

use super::window::Window;
use super::{Driver, Findings, Operator, Reading};
use motorbench_core::message::Sample;
use motorbench_core::settings::Param;
use motorbench_link::board::Board;
use motorbench_link::record::Ended;

/// Currents as shares of the largest, each for one revolution.
const SHARES: [f64; 4] = [0.55, 0.7, 0.85, 1.0];
/// The voltage rises until the current flows. One step is this share of the voltage for the largest current.
const STEP: f64 = 0.05;
const STEP_WINDOW_S: f64 = 0.1;
/// If the revolution takes longer than this, the rotor is not being turned.
const TURN_PATIENCE_S: f64 = 60.0;
/// With a back-EMF of a larger share of the voltage the rotor turns too fast.
const MOST_EMF: f64 = 0.3;
/// Shorter stretches within a sector, at its edges, do not count.
const FEWEST_SAMPLES: usize = 20;

impl<B: Board, P: Operator> Driver<'_, B, P> {
    /// One position for each sector; `None` if the operator refuses, or if the rotor turns too fast.
    pub(super) fn creep(&mut self, sectors: usize, findings: &mut Findings) -> Result<(), Ended> {
        if !self.is_done("hold the rotor back so that one revolution takes a few seconds; press Enter")? {
            self.leaves_out("the slow turns", findings);
            return Ok(());
        }
        // A motor that hardly turns is expected here.
        self.set(Param::TripStall, 0.0)?;
        self.arm()?;
        let turned = self.turns(sectors)?;
        self.board.command("disarm")?;
        self.set(Param::TripStall, self.settings.get(Param::TripStall))?;
        let rev = self.settings.get(Param::CountsPerRev) as usize;
        let middle = |sector: usize| ((2 * sector + 1) * rev / (2 * sectors)) as i32;
        let fitted = turned.iter().enumerate().filter_map(|(sector, windows)| self.fitted(windows, middle(sector)));
        let positions: Vec<_> = fitted.collect();
        self.person.hears(&format!("{} of {sectors} sectors measured; let go", positions.len()));
        self.keep_positions(positions, findings)
    }

    /// Averages in each sector, over all currents.
    fn turns(&mut self, sectors: usize) -> Result<Vec<Vec<Window>>, Ended> {
        let mut windows: Vec<Vec<Window>> = (0..sectors).map(|_| Vec::new()).collect();
        let most_a = self.held_current_a();
        let resistance = self.motor.resistance_ohm.unwrap_or(f64::from(self.settings.get(Param::Resistance)));
        let limit_v = f64::from(self.settings.get(Param::VoltageLimit));
        let mut voltage_v = 0.0;
        for share in SHARES {
            loop {
                voltage_v += STEP * most_a * resistance;
                if voltage_v > limit_v {
                    self.person.hears("too little current flows for more: hold the rotor back more firmly");
                    return Ok(windows);
                }
                self.board.command(&format!("ref {voltage_v:.3}"))?;
                self.window(STEP_WINDOW_S, STEP_WINDOW_S)?;
                if self.window(STEP_WINDOW_S, STEP_WINDOW_S)?.reading.i_A >= share * most_a {
                    break;
                }
            }
            if !self.turn(voltage_v, &mut windows)? {
                return Ok(windows);
            }
        }
        Ok(windows)
    }

    /// A whole revolution at a voltage; false if it is not completed.
    fn turn(&mut self, voltage_v: f64, windows: &mut [Vec<Window>]) -> Result<bool, Ended> {
        let rev = self.settings.get(Param::CountsPerRev) as i32;
        let rate_hz = f64::from(self.settings.get(Param::TickRate));
        let sector = |sample: &Sample| (sample.counts.rem_euclid(rev) as usize * windows.len()) / rev as usize;
        let (mut stretch, mut done): (Vec<Sample>, Vec<(usize, Window)>) = (Vec::new(), Vec::new());
        let mut samples = std::mem::take(&mut self.waiting);
        let mut begun: Option<Sample> = None;
        loop {
            for sample in samples.drain(..) {
                let first = *begun.get_or_insert(sample);
                if stretch.first().is_some_and(|start| sector(start) != sector(&sample)) {
                    if stretch.len() >= FEWEST_SAMPLES {
                        done.push((sector(&stretch[0]), self.averaged(&stretch)));
                    }
                    stretch.clear();
                }
                stretch.push(sample);
                let lasted_s = f64::from(sample.tick.wrapping_sub(first.tick)) / rate_hz;
                if sample.counts.wrapping_sub(first.counts).abs() > rev {
                    return Ok(self.crept(voltage_v, lasted_s, done, windows));
                }
                if lasted_s > TURN_PATIENCE_S {
                    self.person
                        .hears(&format!("{voltage_v:6.2} V: no revolution in {TURN_PATIENCE_S} s: turn it by hand"));
                    return Ok(false);
                }
            }
            samples = self.slice()?;
        }
    }

    /// ResultSink a revolution that was slow enough, without the back-EMF.
    fn crept(
        &mut self,
        voltage_v: f64,
        lasted_s: f64,
        done: Vec<(usize, Window)>,
        windows: &mut [Vec<Window>],
    ) -> bool {
        let k = self.motor.torque_constant_nm_per_a.unwrap_or(0.0);
        if done.iter().any(|(_, window)| (k * window.reading.omega_rad_per_s).abs() > MOST_EMF * voltage_v) {
            self.person.hears(&format!("{voltage_v:6.2} V: a revolution in {lasted_s:.1} s is too fast: hold it back"));
            return false;
        }
        self.person.hears(&format!("{voltage_v:6.2} V: a revolution in {lasted_s:.1} s"));
        for (sector, window) in done {
            let Reading { u_V, omega_rad_per_s, .. } = window.reading;
            let reading = Reading { u_V: u_V - k * omega_rad_per_s, ..window.reading };
            windows[sector].push(Window { reading, ..window });
        }
        true
    }
}
