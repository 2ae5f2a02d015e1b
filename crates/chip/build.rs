//! Says in one line what the simulated chip needs, instead of leaving that to the errors of its build.

use std::path::Path;
use std::process::{Command, Stdio};
use std::{env, fs};

const PACKAGES: &str =
    "build-essential pkg-config libclang-dev libelf-dev zlib1g-dev libzstd-dev gcc-avr binutils-avr avr-libc";
const COMMAND: &str = "cargo test --features motorbench-chip/chip";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=PATH");
    let (to_build, to_run) = (missing_to_build(), missing_to_run());
    let missing = [to_build.as_slice(), to_run.as_slice()].concat().join(", ");
    if missing.is_empty() {
        return;
    }
    let chip = env::var_os("CARGO_FEATURE_CHIP").is_some();
    match (chip, to_build.is_empty()) {
        (true, false) => println!("cargo::error=the simulated chip lacks {missing}; install {PACKAGES}"),
        (true, true) => println!("cargo::warning=no program for the chip can be built without {missing}; install it"),
        (false, _) => println!(
            "cargo::warning=tests on the simulated chip are left out (no {missing}); install {PACKAGES}, then run {COMMAND}"
        ),
    }
}

/// Tools and libraries without which the simulator does not compile.
fn missing_to_build() -> Vec<&'static str> {
    let libraries = ["libelf", "zlib", "libzstd"].into_iter().filter(|name| !runs("pkg-config", &["--exists", name]));
    let tools = ["cc", "make"].into_iter().filter(|tool| !runs(tool, &["--version"]));
    let clang = (!has_libclang()).then_some("libclang");
    tools.chain(clang).chain(libraries).collect()
}

/// What the tests need to make programs for the chip.
fn missing_to_run() -> Vec<&'static str> {
    ["avr-gcc"].into_iter().filter(|tool| !runs(tool, &["--version"])).collect()
}

/// bindgen loads libclang at run time and has no tool of its own that could be asked.
fn has_libclang() -> bool {
    let named = env::var_os("LIBCLANG_PATH").is_some();
    let installed = fs::read_dir("/usr/lib").into_iter().flatten().flatten().map(|entry| entry.path());
    named || installed.flat_map(|path| [path.join("lib"), path]).any(|path| holds_libclang(&path))
}

fn holds_libclang(directory: &Path) -> bool {
    let mut files = fs::read_dir(directory).into_iter().flatten().flatten();
    files.any(|file| file.file_name().to_string_lossy().starts_with("libclang"))
}

fn runs(tool: &str, arguments: &[&str]) -> bool {
    let status = Command::new(tool).args(arguments).stdout(Stdio::null()).stderr(Stdio::null()).status();
    status.is_ok_and(|status| status.success())
}
