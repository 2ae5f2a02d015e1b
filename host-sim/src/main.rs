//! The `motorbench` program.
fn main() {}
