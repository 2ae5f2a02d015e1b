//! What a file holds before its names mean anything: columns of numbers, or series with times of their own.

use std::sync::Arc;

/// Values with their name in the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Column {
    /// Name in the file, unique in it.
    pub name: String,
    /// Unit that the file states; empty without one.
    pub unit: String,
    /// Values, missing ones as NaN.
    pub values: Vec<f64>,
    /// Rows with something that is no number, and what stands there. Their values are NaN.
    pub unreadable: Vec<(usize, String)>,
    /// Rows with nothing in the cell.
    pub blank: Vec<usize>,
    /// The moment from which its times count, if its cells are dates or times of day.
    pub since: Option<String>,
}

impl Column {
    /// A column of numbers only.
    pub fn new(name: impl Into<String>, values: Vec<f64>) -> Self {
        Self { name: name.into(), values, ..Self::default() }
    }

    /// Whether most of its cells are no numbers.
    pub fn is_text(&self) -> bool {
        2 * self.unreadable.len() > self.values.len()
    }
}

/// One quantity at the times when it was logged. Several quantities may share their times.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name in the file.
    pub name: String,
    /// Times of its samples.
    pub time_s: Arc<Vec<f64>>,
    /// Its samples.
    pub values: Arc<Vec<f64>>,
}

impl Series {
    /// A series of these samples.
    pub fn new(name: impl Into<String>, time_s: Vec<f64>, values: Vec<f64>) -> Self {
        Self { name: name.into(), time_s: Arc::new(time_s), values: Arc::new(values) }
    }

    /// Adds a sample.
    pub fn push(&mut self, t_s: f64, value: f64) {
        Arc::make_mut(&mut self.time_s).push(t_s);
        Arc::make_mut(&mut self.values).push(value);
    }

    /// So many of its samples at most, evenly over the whole, as a column.
    pub fn glance(&self, most: usize) -> Column {
        let step = self.values.len().div_ceil(most).max(1);
        Column::new(&*self.name, self.values.iter().step_by(step).copied().collect())
    }
}

/// A line that could not be read.
#[derive(Clone, Debug, PartialEq)]
pub struct Broken {
    /// Its number in the file, from 1.
    pub line: u64,
    /// What is wrong with it.
    pub what: String,
}

/// The content of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Content {
    /// Columns of equal length.
    pub columns: Vec<Column>,
    /// Series with times of their own, instead of columns.
    pub series: Vec<Series>,
    /// Line of each row in a text file; empty for other files.
    pub lines: Vec<u64>,
    /// Lines that are no rows.
    pub broken: Vec<Broken>,
    /// Line of the names; `None`: there are none, and the columns are called by their numbers.
    pub header: Option<u64>,
    /// Whether the file should have had a header line.
    pub is_text: bool,
    /// Message about a file that ends too early.
    pub cut: Option<String>,
    /// Names of what the file holds besides numbers.
    pub ignored: Vec<String>,
    /// What a person should know of how it was read.
    pub notes: Vec<String>,
}

impl Content {
    /// Columns with nothing to say about them.
    pub fn of(columns: Vec<Column>) -> Self {
        Self { columns, ..Self::default() }
    }

    /// Makes names unique: the second column `rpm` becomes `rpm#2`, and the first `rpm#1`.
    #[must_use]
    pub fn with_unique_names(mut self) -> Self {
        let names: Vec<String> = self.columns.iter().map(|column| column.name.clone()).collect();
        for (index, column) in self.columns.iter_mut().enumerate() {
            if names.iter().filter(|name| **name == names[index]).count() > 1 {
                let number = names[..=index].iter().filter(|name| **name == names[index]).count();
                column.name = format!("{}#{number}", names[index]);
            }
        }
        self
    }
}
