//! Programs for the chip: the firmware, and small ones in assembly for the tests of the chip itself.

use std::collections::HashMap;
use std::ffi::OsString;
use std::fmt;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::SystemTime;

use object::{Object, ObjectSegment, ObjectSymbol};

/// avr-gcc gives the address spaces of the chip one after the other: flash, data, EEPROM, fuses.
const DATA_SPACE: u64 = 0x80_0000;
const EEPROM_SPACE: u64 = 0x81_0000;
const FUSE_SPACE: u64 = 0x82_0000;
const FLASH_BYTES: usize = 32 * 1024;

/// Why a program cannot be had.
#[derive(Debug)]
pub enum ProgramError {
    /// The file cannot be read.
    Read(PathBuf, std::io::Error),
    /// The file is not an ELF file for AVR, or is broken.
    Format(PathBuf, String),
    /// The program exceeds the flash of 32 KiB.
    TooLarge(PathBuf),
    /// A tool is missing or failed; the text says which, and what it printed.
    Build(String),
}

impl fmt::Display for ProgramError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read(path, error) => write!(f, "{}: {error}", path.display()),
            Self::Format(path, what) => write!(f, "{} is no program for the ATmega328P: {what}", path.display()),
            Self::TooLarge(path) => write!(f, "{} exceeds the flash of 32 KiB", path.display()),
            Self::Build(what) => f.write_str(what),
        }
    }
}

impl std::error::Error for ProgramError {}

/// A program as an ELF file holds it.
#[derive(Clone, Debug)]
pub struct Program {
    pub(super) flash: Vec<(u32, Vec<u8>)>,
    pub(super) eeprom: Vec<(usize, Vec<u8>)>,
    symbols: HashMap<String, u64>,
}

impl Program {
    /// Reads an ELF file.
    ///
    /// # Errors
    /// If it cannot be read, is no ELF file, or does not fit into the flash.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ProgramError> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|e| ProgramError::Read(path.into(), e))?;
        let broken = |e: object::Error| ProgramError::Format(path.into(), e.to_string());
        let file = object::read::elf::ElfFile32::<object::Endianness>::parse(&*bytes).map_err(broken)?;
        let mut program = Self { flash: Vec::new(), eeprom: Vec::new(), symbols: HashMap::new() };
        for segment in file.segments() {
            let data = segment.data().map_err(broken)?;
            let address = u64::from(segment.elf_program_header().p_paddr.get(file.endian()));
            program.add(address, data, path)?;
        }
        for symbol in file.symbols().filter(|s| !s.is_undefined()) {
            if let Ok(name) = symbol.name() {
                program.symbols.insert(name.to_owned(), symbol.address());
            }
        }
        Ok(program)
    }

    /// Sorts a loaded segment into its address space; fuses and lock bits are ignored.
    fn add(&mut self, address: u64, data: &[u8], path: &Path) -> Result<(), ProgramError> {
        match address {
            _ if data.is_empty() => {}
            0..DATA_SPACE if address as usize + data.len() > FLASH_BYTES => {
                return Err(ProgramError::TooLarge(path.into()));
            }
            0..DATA_SPACE => self.flash.push((address as u32, data.to_vec())),
            EEPROM_SPACE..FUSE_SPACE => self.eeprom.push(((address - EEPROM_SPACE) as usize, data.to_vec())),
            _ => {}
        }
        Ok(())
    }

    /// Data address of a variable, by its symbol's name.
    pub fn variable(&self, name: &str) -> Option<u16> {
        let address = *self.symbols.get(name)?;
        (DATA_SPACE..EEPROM_SPACE).contains(&address).then(|| (address - DATA_SPACE) as u16)
    }

    /// Byte address of a function in the flash, by its symbol's name.
    pub fn function(&self, name: &str) -> Option<u32> {
        self.symbols.get(name).copied().filter(|&address| address < DATA_SPACE).map(|address| address as u32)
    }

    /// All symbols with their addresses as in the ELF file: data from 0x800000, EEPROM from 0x810000.
    pub fn symbols(&self) -> impl Iterator<Item = (&str, u64)> {
        self.symbols.iter().map(|(name, &address)| (name.as_str(), address))
    }

    /// Bytes of flash that it fills.
    pub fn flash_bytes(&self) -> usize {
        self.flash.iter().map(|(_, data)| data.len()).sum()
    }
}

fn workspace_root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("the crate lies in crates/").to_owned()
}

fn target_directory() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| workspace_root().join("target"), |d| workspace_root().join(d))
}

/// Builds the firmware with `cargo firmware`, once per process, and returns the path of its ELF file.
///
/// # Errors
/// If avr-gcc is missing, which links it, or the build fails.
pub fn firmware_elf() -> Result<PathBuf, ProgramError> {
    static BUILT: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    BUILT.get_or_init(|| build("firmware")).clone().map_err(ProgramError::Build)
}

/// What the firmware is made of, in the workspace.
const SOURCES: [&str; 8] =
    ["boards", "core", "src", "avr-specs", "Cargo.toml", "Cargo.lock", ".cargo/config.toml", "rust-toolchain.toml"];

/// The firmware for a person who runs it and does not change it. A built one is taken if it is newer than all its
/// sources. It is also taken if cargo cannot run; then `note` gets a message. `begins` is called before it is built.
///
/// # Errors
/// As [`firmware_elf`], when there is none either.
pub fn firmware_at_hand(begins: impl FnOnce(), note: impl FnOnce(&str)) -> Result<PathBuf, ProgramError> {
    let built = elf_path("firmware");
    if is_newer(&built, &workspace_root()) {
        return Ok(built);
    }
    begins();
    match firmware_elf() {
        // A mistake in sources that are there is a person's to mend.
        Err(ProgramError::Build(why)) if built.is_file() && !(can_build() && has_sources()) => {
            note(&format!("the firmware was not built anew ({}); taken is {}", first_line(&why), built.display()));
            Ok(built)
        }
        Ok(elf) => {
            // Cargo leaves a file alone that comes out the same, and it would look older than its sources for ever.
            let _ = File::options().append(true).open(&elf).and_then(|file| file.set_modified(SystemTime::now()));
            Ok(elf)
        }
        Err(why) => Err(why),
    }
}

fn has_sources() -> bool {
    workspace_root().join("Cargo.toml").is_file()
}

fn can_build() -> bool {
    ["avr-gcc".into(), cargo()].into_iter().all(|tool| Command::new(tool).arg("--version").output().is_ok())
}

fn first_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default()
}

/// Whether a file was written after everything it is made of, in `root`.
fn is_newer(built: &Path, root: &Path) -> bool {
    let modified = |path: &Path| path.metadata().and_then(|data| data.modified()).ok();
    let Some(built) = modified(built) else { return false };
    fn files(path: PathBuf, found: &mut Vec<PathBuf>) {
        match path.read_dir() {
            Ok(entries) => entries.flatten().for_each(|entry| files(entry.path(), found)),
            Err(_) => found.push(path),
        }
    }
    let mut sources = Vec::new();
    SOURCES.iter().for_each(|source| files(root.join(source), &mut sources));
    sources.iter().all(|source| modified(source).is_some_and(|modified| modified < built))
}

/// Builds another binary of the firmware's package for the chip, and returns the path of its ELF file.
///
/// # Errors
/// As [`firmware_elf`].
pub fn avr_elf(binary: &str) -> Result<PathBuf, ProgramError> {
    build(binary).map_err(ProgramError::Build)
}

fn build(binary: &str) -> Result<PathBuf, String> {
    run(Command::new("avr-gcc").arg("--version"))?;
    let mut cargo = Command::new(cargo());
    cargo.args(["firmware", "--bin", binary]).current_dir(workspace_root());
    // What cargo sets for the calling test would make the firmware's dependencies build anew. Flags for the host would
    // replace those of the AVR target.
    for (name, _) in std::env::vars_os() {
        let name = name.to_string_lossy();
        let for_tests = name.starts_with("CARGO_") && !["CARGO_HOME", "CARGO_TARGET_DIR"].contains(&name.as_ref());
        let flags = name.contains("RUSTFLAGS") || name.starts_with("RUSTC");
        if for_tests && !name.starts_with("CARGO_NET") && !name.starts_with("CARGO_HTTP") || flags {
            cargo.env_remove(name.as_ref());
        }
    }
    run(&mut cargo)?;
    Ok(elf_path(binary))
}

fn cargo() -> OsString {
    std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

fn elf_path(binary: &str) -> PathBuf {
    target_directory().join("avr-atmega328p/firmware").join(binary).with_extension("elf")
}

/// Assembles a program for the chip and returns the path of its ELF file, in the target directory.
///
/// # Errors
/// If avr-gcc is missing or finds a mistake.
pub fn assemble(source: impl AsRef<Path>) -> Result<PathBuf, ProgramError> {
    let source = source.as_ref();
    let directory = target_directory().join("chip-programs");
    std::fs::create_dir_all(&directory).map_err(|e| ProgramError::Read(directory.clone(), e))?;
    let name = source.file_stem().unwrap_or_default().to_string_lossy();
    let elf = directory.join(format!("{name}.elf"));
    // Tests run side by side: each writes a file of its own and moves it into place.
    let unfinished = directory.join(format!("{name}.{}.{:?}", std::process::id(), std::thread::current().id()));
    let mut gcc = Command::new("avr-gcc");
    gcc.args(["-mmcu=atmega328p", "-nostartfiles", "-nostdlib", "-o"]).arg(&unfinished).arg(source);
    run(&mut gcc).map_err(ProgramError::Build)?;
    std::fs::rename(&unfinished, &elf).map_err(|e| ProgramError::Read(unfinished, e))?;
    Ok(elf)
}

/// Runs a tool; the error says what to install or what it printed.
fn run(command: &mut Command) -> Result<(), String> {
    let tool = command.get_program().to_string_lossy().into_owned();
    let output = command.output().map_err(|e| match tool.as_str() {
        "avr-gcc" => format!("{tool}: {e}; install gcc-avr, binutils-avr and avr-libc"),
        _ => format!("{tool}: {e}"),
    })?;
    match output.status.success() {
        true => Ok(()),
        false => Err(format!("{tool} failed:\n{}", String::from_utf8_lossy(&output.stderr))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, File};
    use std::time::{Duration, SystemTime};

    #[test]
    fn what_was_built_is_newer_than_all_its_sources_or_is_not_taken() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        let built = root.join("firmware.elf");
        assert!(!is_newer(&built, root), "there is none");
        let at = |path: &Path, age_s| {
            let file = File::options().append(true).create(true).open(path).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(age_s)).unwrap();
        };
        for inner in [".cargo", "avr-specs", "boards", "core", "src/deep"] {
            fs::create_dir_all(root.join(inner)).unwrap();
        }
        let others = [
            "boards/board.rs",
            "core/Cargo.toml",
            "Cargo.toml",
            "Cargo.lock",
            ".cargo/config.toml",
            "rust-toolchain.toml",
            "avr-specs/avr.json",
        ];
        others.iter().for_each(|source| at(&root.join(source), 100));
        let source = root.join("src/deep/part.rs");
        at(&source, 100);
        at(&built, 50);
        assert!(is_newer(&built, root));
        at(&source, 20);
        assert!(!is_newer(&built, root), "changed since");
        fs::remove_dir_all(root.join("src")).unwrap();
        assert!(!is_newer(&built, root), "the sources are gone");
    }
}
