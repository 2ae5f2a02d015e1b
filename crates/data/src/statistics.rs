//! Statistics of a column of numbers, some of which may be missing.

/// Largest magnitude; missing values do not count.
pub fn greatest(values: &[f64]) -> f64 {
    // Eight at a time, so that the comparisons need not wait for each other.
    let mut most = [0.0_f64; 8];
    let eights = values.chunks_exact(8);
    for eight in eights.clone().chain([eights.remainder()]) {
        most.iter_mut().zip(eight).for_each(|(most, value)| *most = most.max(value.abs()));
    }
    most.into_iter().fold(0.0, f64::max)
}

/// Median without missing values; 0 for an empty column.
pub fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Wherever it stands, also in a column of no whole number of eights.
    #[test]
    fn the_greatest_is_found_beside_missing_values() {
        assert_eq!(greatest(&[]), 0.0);
        assert_eq!(greatest(&[f64::NAN]), 0.0);
        for length in 1..20 {
            for place in 0..length {
                let mut values = vec![1.0; length];
                values[(place + 1) % length] = f64::NAN;
                values[place] = -3.0;
                assert_eq!(greatest(&values), 3.0, "{place} of {length}");
            }
        }
    }
}
