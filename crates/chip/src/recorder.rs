//! Recording of the truth.

use host_sim::plant::Bridge;

/// The true state at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Processor cycles since power-on.
    pub cycle: u64,
    /// The same in seconds.
    pub t_s: f64,
    /// What the bridge does.
    pub bridge: Bridge,
    /// Duty of the PWM in force, 0 to 1; 0 if OC1A is disconnected.
    pub duty: f64,
    /// Angle of the motor's shaft.
    pub angle_rad: f64,
    /// Its speed.
    pub speed_rad_per_s: f64,
    /// Armature current.
    pub current_a: f64,
    /// Supply voltage at the bridge.
    pub supply_v: f64,
    /// Count of a perfect counter at the encoder, before its faults.
    pub encoder_count: i64,
    /// Levels that the world gives to port D: D2 and D3 encoder, D4 emergency stop (low: pressed).
    pub port_d_inputs: u8,
}

/// Rows at equal distances.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Distance of the rows, in cycles; 0 while nothing is recorded.
    pub interval_cycles: u64,
    /// The rows.
    pub rows: Vec<Row>,
    pub(super) next_at: u64,
}

impl Recording {
    pub(super) fn new(now: u64, interval_cycles: u64) -> Self {
        Self { interval_cycles, rows: Vec::new(), next_at: now }
    }

    /// The cycle of the next row, if it is not after `cycle`.
    pub(super) fn due(&self, cycle: u64) -> Option<u64> {
        (self.interval_cycles > 0 && self.next_at <= cycle).then_some(self.next_at)
    }

    pub(super) fn push(&mut self, row: Row) {
        self.rows.push(row);
        self.next_at += self.interval_cycles;
    }
}
