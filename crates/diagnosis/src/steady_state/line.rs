//! Fits that are linear in few constants, with their uncertainty.

use crate::configuration::steady_state::line::{MOST_SIGMAS, SAME_COLUMNS};
use crate::diagnose::outcome::Estimate;
use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// Standard errors of the points of a line, one a point.
#[derive(Clone, Debug)]
pub enum Errors {
    /// From the scatter of readings: a point may be off by more, since warming or drift is the same in all its
    /// readings.
    AtLeast(Vec<f64>),
    /// Only their ratios are known.
    InProportion(Vec<f64>),
}

impl Errors {
    /// One for each level.
    pub fn each(&self) -> &[f64] {
        let (Self::AtLeast(each) | Self::InProportion(each)) = self;
        each
    }

    /// With those of points of another kind.
    pub fn and(mut self, others: impl IntoIterator<Item = f64>) -> Self {
        let (Self::AtLeast(each) | Self::InProportion(each)) = &mut self;
        each.extend(others);
        self
    }
}

/// Factor for the stated errors, and the degrees of freedom behind it.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    scale: f64,
    dof: usize,
}

/// Constants of a fit by weighted least squares.
pub struct Line {
    /// The target of the fit, one value for each level.
    pub values: DVector<f64>,
    covariance: DMatrix<f64>,
    chi2: f64,
    dof: usize,
    least_scale: f64,
}

impl Line {
    /// `None` if the columns cannot be told apart. `columns`: each as long as `target`.
    pub fn new(columns: &[&[f64]], target: &[f64], errors: &Errors) -> Option<Self> {
        let rows: Vec<usize> = (0..target.len()).collect();
        let (values, covariance) = solve(columns, target, errors.each(), &rows)?;
        let off = |row: usize| (target[row] - predicted(columns, &values, row)) / errors.each()[row];
        Some(Self {
            chi2: rows.iter().map(|row| off(*row).powi(2)).sum(),
            dof: target.len().checked_sub(columns.len())?,
            least_scale: f64::from(matches!(errors, Errors::AtLeast(_))),
            values,
            covariance,
        })
    }

    /// Near 1 if the line passes the points as closely as their errors say.
    pub fn chi2_per_dof(&self) -> f64 {
        self.chi2 / self.dof as f64
    }

    /// Residual of each point of the fitted columns.
    pub fn left(&self, columns: &[&[f64]], target: &[f64]) -> Vec<f64> {
        (0..target.len()).map(|row| target[row] - predicted(columns, &self.values, row)).collect()
    }

    /// With the errors that the points show: they lie off by more than stated.
    pub fn noise(&self) -> Noise {
        Noise { scale: self.chi2_per_dof().sqrt().max(self.least_scale), dof: self.dof }
    }

    /// The interval of Student's distribution around a constant; `None` without degrees of freedom.
    pub fn estimate(&self, index: usize) -> Estimate {
        let (value, Noise { scale, dof }) = (self.values[index], self.noise());
        let quantile = StudentsT::new(0.0, 1.0, dof as f64).ok().map(|student| student.inverse_cdf(0.975));
        let half = quantile.map(|quantile| quantile * scale * self.covariance[(index, index)].sqrt());
        Estimate { value, ci95: half.map(|half| [value - half, value + half]) }
    }

    /// Distance of a constant from zero, as the equivalent number of standard errors of a normal distribution: few
    /// points need more.
    pub fn sigmas(&self, index: usize, noise: Noise) -> f64 {
        let error = noise.scale * self.covariance[(index, index)].sqrt();
        let Ok(student) = StudentsT::new(0.0, 1.0, noise.dof as f64) else { return 0.0 };
        let by_chance = student.sf((self.values[index] / error).abs());
        if by_chance > 0.0 { Normal::standard().inverse_cdf(by_chance).abs().min(MOST_SIGMAS) } else { MOST_SIGMAS }
    }
}

/// Deviation of each point from a line through all others.
pub fn left_out(columns: &[&[f64]], target: &[f64], errors: &Errors) -> Option<Vec<f64>> {
    let off = |out: usize| {
        let rows: Vec<usize> = (0..target.len()).filter(|row| *row != out).collect();
        let (values, _) = solve(columns, target, errors.each(), &rows)?;
        Some(target[out] - predicted(columns, &values, out))
    };
    (0..target.len()).map(off).collect()
}

/// Root of the mean square.
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value.powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}

fn predicted(columns: &[&[f64]], values: &DVector<f64>, row: usize) -> f64 {
    columns.iter().zip(values).map(|(column, value)| column[row] * value).sum()
}

/// Values and their covariance, by singular values: a current that hardly changes is nearly a constant.
fn solve(columns: &[&[f64]], target: &[f64], errors: &[f64], rows: &[usize]) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let size = columns.len();
    if size == 0 {
        return Some((DVector::zeros(0), DMatrix::zeros(0, 0)));
    }
    if rows.len() < size {
        return None;
    }
    let length = |column: &[f64]| rows.iter().map(|row| (column[*row] / errors[*row]).powi(2)).sum::<f64>().sqrt();
    let lengths: Vec<f64> = columns.iter().map(|column| length(column)).collect();
    if lengths.contains(&0.0) {
        return None;
    }
    let weighted =
        DMatrix::from_fn(rows.len(), size, |row, of| columns[of][rows[row]] / errors[rows[row]] / lengths[of]);
    let right = DVector::from_fn(rows.len(), |row, _| target[rows[row]] / errors[rows[row]]);
    let svd = weighted.svd(true, true);
    let (u, v) = (svd.u?, svd.v_t?.transpose());
    if svd.singular_values.min() < SAME_COLUMNS * svd.singular_values.max() {
        return None;
    }
    let inverse = svd.singular_values.map(f64::recip);
    let values = &v * (u.transpose() * right).component_mul(&inverse);
    let covariance = &v * DMatrix::from_diagonal(&inverse.component_mul(&inverse)) * v.transpose();
    let values = DVector::from_fn(size, |of, _| values[of] / lengths[of]);
    let covariance = DMatrix::from_fn(size, size, |a, b| covariance[(a, b)] / lengths[a] / lengths[b]);
    Some((values, covariance))
}
