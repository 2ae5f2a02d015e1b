//! The `motorbench` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    motorbench_cli::commands::main()
}
