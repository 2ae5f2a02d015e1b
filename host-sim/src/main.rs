//! The `motorbench` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    host_sim::commands::main()
}
