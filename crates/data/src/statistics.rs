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
