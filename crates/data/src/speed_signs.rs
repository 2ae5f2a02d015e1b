//! The sign of a speed that was recorded without one, beside a direction of the command.
//!
//! A shaft does not turn back at once: after the direction has changed, it slows down, stops, and only then turns the
//! other way. So the speed keeps its sign until its magnitude has come to zero.

/// The speed with its sign. `direction`: 1 or -1, by the command.
pub fn signed(magnitude: &[f64], direction: &[f64]) -> Vec<f64> {
    let mut sign = direction.iter().copied().find(|sign| sign.is_finite()).unwrap_or(1.0);
    let mut speed: Vec<f64> = Vec::with_capacity(magnitude.len());
    // Where the shaft turns back, if that is already known.
    let mut turns_at = None;
    for row in 0..magnitude.len() {
        let rests = magnitude[row] == 0.0 || row > 0 && magnitude[row - 1] == 0.0;
        let wanted = if direction[row].is_finite() { direction[row] } else { sign };
        if turns_at == Some(row) || wanted != sign && rests {
            (sign, turns_at) = (wanted, None);
        } else if wanted != sign && turns_at.is_none() && comes_to_zero(magnitude, row) {
            match turning_row(magnitude, row) {
                now if now == row => sign = wanted,
                later => turns_at = Some(later),
            }
        }
        speed.push(if magnitude[row] == 0.0 { 0.0 } else { sign * magnitude[row].abs() });
    }
    speed
}

/// Whether the speed would have passed zero at a row if it went on as before.
fn comes_to_zero(magnitude: &[f64], row: usize) -> bool {
    row >= 2 && 2.0 * magnitude[row - 1] < magnitude[row - 2]
}

/// The row from which on the speed has the other sign, this one or the next: the way with the smaller bends.
fn turning_row(magnitude: &[f64], row: usize) -> usize {
    let bends = |turns: usize| {
        let end = (row + 3).min(magnitude.len());
        let speed: Vec<f64> =
            (row - 2..end).map(|at| if at < turns { magnitude[at] } else { -magnitude[at] }).collect();
        speed.windows(3).map(|three| (three[0] - 2.0 * three[1] + three[2]).powi(2)).sum::<f64>()
    };
    if bends(row + 1) < bends(row) { row + 1 } else { row }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A lag of five rows after steps of both signs, and a stop.
    #[test]
    fn a_speed_keeps_its_sign_until_it_has_come_to_zero() {
        let levels = [0.0, 900.0, -300.0, 500.0, 0.0, -700.0, -100.0, 40.0];
        let mut speed = vec![0.0];
        for row in 1..320 {
            let free: f64 = levels[row / 40];
            let next: f64 = speed[row - 1] + 0.2 * (free - speed[row - 1]);
            speed.push(if free == 0.0 && next.abs() < 3.0 { 0.0 } else { next });
        }
        let magnitude: Vec<f64> = speed.iter().map(|speed: &f64| speed.abs()).collect();
        let direction: Vec<f64> = (0..320).map(|row| if levels[row / 40] < 0.0 { -1.0 } else { 1.0 }).collect();
        for (row, (found, speed)) in signed(&magnitude, &direction).iter().zip(&speed).enumerate() {
            assert!((found - speed).abs() < 1e-9, "row {row}: {found}, {speed}");
        }
    }
}
