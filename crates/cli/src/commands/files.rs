//! Checks the files of one command line. No output may replace another file of the command, and only one result may go
//! to the terminal.

use super::{Failure, folder, own_files, tell};
use motorbench_data::mapping::Mapping;
use motorbench_text::terminal_text::{fitted, quoted};
use serde_json::{Map, Value};
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

/// The name of the standard output.
pub(super) const TERMINAL: &str = "-";
/// Value of --json without a file: the standard output.
pub(super) const JSON_TO: &str = "FILE.json|-";

/// Whether a name means the standard output.
pub(super) fn is_terminal(path: &Path) -> bool {
    path == Path::new(TERMINAL)
}

/// The command line with `--json FILE.json` and `--json -` as `--json=FILE.json` and `--json=-`. Without a value the
/// option must not take the next argument, which may be a console line or an input file.
pub(super) fn with_json_joined(arguments: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let mut joined: Vec<OsString> = Vec::new();
    for argument in arguments {
        let path = Path::new(&argument);
        let is_file = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("json"));
        match joined.last_mut().filter(|last| *last == "--json" && (is_file || is_terminal(path))) {
            Some(last) => {
                last.push("=");
                last.push(argument);
            }
            None => joined.push(argument),
        }
    }
    joined
}

/// The outputs of a command.
pub(super) struct Outputs {
    /// Whether a result goes to the terminal, so that the text for a person does not.
    pub terminal_is_taken: bool,
    /// The files, as named.
    files: Vec<String>,
}

impl Outputs {
    /// Checks the input and output files of a command before it reads or writes any.
    ///
    /// # Errors
    /// [`Failure`] if one of them would be overwritten.
    pub(super) fn new<'a>(
        read: impl IntoIterator<Item = &'a PathBuf>,
        written: impl IntoIterator<Item = &'a PathBuf>,
    ) -> Result<Self, Failure> {
        Self::with_names(read, written, &[])
    }

    /// The same where the outputs call channels by these names.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(super) fn with_names<'a>(
        read: impl IntoIterator<Item = &'a PathBuf>,
        written: impl IntoIterator<Item = &'a PathBuf>,
        names: &[Mapping],
    ) -> Result<Self, Failure> {
        let (terminal, files): (Vec<&PathBuf>, Vec<&PathBuf>) = written.into_iter().partition(|path| is_terminal(path));
        if terminal.len() > 1 {
            return Err(Failure::input(
                "two results cannot both go to the standard output (-): write one of them into a file",
            ));
        }
        let read = read.into_iter().flat_map(|path| [path.clone()].into_iter().chain(files_of_measurement(path)));
        let read: Vec<PathBuf> = read.filter_map(|path| own_name(&path)).collect();
        let mut taken: Vec<PathBuf> = Vec::new();
        for &path in &files {
            if let Some(side) = side_file(path).filter(|side| !files.contains(&side)) {
                return Err(Failure::input(format!(
                    "{} is a measurement (its settings are in {}) and is not overwritten: choose another name, or remove both files",
                    path.display(),
                    side.display()
                )));
            }
            let Some(name) = own_name(path) else { continue };
            let shown = path.display();
            if read.contains(&name) {
                return Err(Failure::input(format!(
                    "{shown} is an input and would be overwritten: choose another output name"
                )));
            }
            if taken.contains(&name) {
                return Err(Failure::input(format!(
                    "two outputs have the name {shown} (files beside a table take its name): choose another name for one"
                )));
            }
            let is_of_measurement =
                || files.iter().any(|table| side_file(table).is_some_and(|side| files.contains(&&side)));
            if let Some(there) = own_files::held_in(&name)
                && !is_of_measurement()
                && !own_files::may_be_replaced(&name, &there, names)
            {
                return Err(Failure::input(own_files::not_ours(path)));
            }
            taken.push(name);
        }
        let files = files.into_iter().map(|path| quoted(&path.display().to_string())).collect();
        Ok(Self { terminal_is_taken: !terminal.is_empty(), files })
    }

    /// Says at the end which files were written, and what comes next, if anything does.
    pub(super) fn wrote(&self, next: &str) {
        say_written(&self.files, next);
    }

    /// Text for a person.
    pub(super) fn say(&self, text: &str) {
        if !self.terminal_is_taken {
            print!("{}", fitted(text));
        }
    }
}

/// Says which files were written, and what comes next: in one line, or in one each.
pub(super) fn say_written(files: &[String], next: &str) {
    if files.is_empty() {
        return;
    }
    let wrote = format!("wrote {}", files.join(", "));
    let between = if wrote.len() + next.len() < LINE { "; " } else { ";\n" };
    tell(&if next.is_empty() { wrote } else { format!("{wrote}{between}next: {next}") });
}

/// Room for both in a usual line, without what is between them.
const LINE: usize = 80 - "; next: ".len();

/// A table, and the files beside it with its name and these endings.
pub(super) fn with_beside(table: &Path, endings: &[&str]) -> Vec<PathBuf> {
    let others = endings.iter().map(|ending| beside(table, ending));
    [table.to_path_buf()].into_iter().chain(others).collect()
}

/// Default name of a measurement: the first free one of `name.csv`, `name-2.csv`, .... It replaces no file, nor one
/// beside a table with these endings.
pub(super) fn free_name(name: &str, endings: &[&str]) -> PathBuf {
    let numbered = (2..).map(|number| format!("{name}-{number}.csv"));
    let mut tables = std::iter::once(format!("{name}.csv")).chain(numbered).map(PathBuf::from);
    let is_free = |table: &PathBuf| with_beside(table, endings).iter().all(|file| !file.exists());
    tables.find(is_free).expect("numbers do not run out")
}

/// A file with a table's name and another ending.
pub(super) fn beside(table: &Path, ending: &str) -> PathBuf {
    table.with_extension(ending)
}

/// Files that belong to an input table: its rig file, and the side file of its measurement.
fn files_of_measurement(table: &Path) -> impl Iterator<Item = PathBuf> {
    let rig = is_table(table).then(|| beside(table, "rig.toml"));
    let side = side_file(table);
    let scenario = side.is_some().then(|| beside(table, "scenario.toml"));
    [rig, scenario, side].into_iter().flatten().filter(|path| path.exists())
}

fn is_table(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv"))
}

/// The side file of a measured table, if it exists. A measurement cannot be repeated; other files of that name are
/// results.
pub(super) fn side_file(table: &Path) -> Option<PathBuf> {
    let path = (is_table(table) && table.exists()).then(|| beside(table, "json"))?;
    let side: Map<String, Value> = serde_json::from_slice(&fs::read(&path).ok()?).ok()?;
    ["firmware", "settings"].iter().all(|key| side.contains_key(*key)).then_some(path)
}

/// The resolved path of a file, even if it does not exist yet. `None` for a device, in which nothing can be lost.
fn own_name(path: &Path) -> Option<PathBuf> {
    match path.canonicalize() {
        Ok(name) => Some(name).filter(|name| name.is_file()),
        Err(_) => Some(folder(path).canonicalize().ok()?.join(path.file_name()?)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tempfile::TempDir;

    #[test]
    fn nothing_is_written_over_anything_else() {
        let directory = TempDir::new().unwrap();
        let at = |name: &str| directory.path().join(name);
        fs::create_dir(at("folder")).unwrap();
        fs::write(at("run.csv"), "").unwrap();
        let refusal = |read: &str, written: &[&str]| {
            let written: Vec<PathBuf> = written.iter().map(|name| at(name)).collect();
            Outputs::new([&at(read)], &written).err().map(|failure| failure.message)
        };
        assert_eq!(refusal("run.csv", &["a.json", "b.html"]), None);
        for same in ["run.csv", "folder/../run.csv"] {
            assert!(
                refusal("run.csv", &[same])
                    .is_some_and(|why| why.contains("run.csv is an input and would be overwritten"))
            );
        }
        // Neither exists yet.
        let twice = refusal("run.csv", &["folder/a.html", "folder/../folder/a.html"]);
        assert!(twice.is_some_and(|why| why.contains("two outputs have the name") && why.contains("a.html")));
    }

    #[test]
    fn what_was_noted_of_a_table_is_kept_with_it() {
        let directory = TempDir::new().unwrap();
        let [table, side] = ["run.csv", "run.json"].map(|name| directory.path().join(name));
        fs::write(&table, "").unwrap();
        let is_refused = || Outputs::new([&table], [&side]).is_err();
        assert!(!is_refused(), "there is none");
        fs::write(&side, r#"{"figures": []}"#).unwrap();
        assert!(is_refused(), "a file of another program");
        fs::write(&side, r#"{"firmware": "motorbench", "settings": {}, "samples": 1}"#).unwrap();
        assert!(is_refused());
        let written = with_beside(&table, &["rig.toml", "json"]);
        let twice = Outputs::new([], written.iter().chain([&side])).err().map(|failure| failure.message);
        assert!(twice.is_some_and(|why| why.contains("two outputs have the name") && why.contains("run.json")));
        // A measurement may be replaced as a whole by another measurement, but not by a result.
        assert!(Outputs::new([], &written).is_ok());
        let other = directory.path().join("other.csv");
        let lost = Outputs::new([&other], [&table]).err().map(|failure| failure.message);
        assert!(lost.is_some_and(|why| why.contains("run.csv is a measurement") && why.contains("run.json")));
        for (ending, is_kept) in [("rig.toml", true), ("scenario.toml", true), ("model.toml", false)] {
            fs::write(beside(&table, ending), "").unwrap();
            assert_eq!(Outputs::new([&table], [&beside(&table, ending)]).is_err(), is_kept, "{ending}");
        }
    }

    #[test]
    fn what_json_goes_to_is_told_from_what_follows_it() {
        let joined = |line: &str| {
            let joined = with_json_joined(line.split(' ').map(OsString::from));
            joined.iter().map(|argument| argument.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(joined("connect --json - status"), "connect --json=- status");
        assert_eq!(joined("stand t.csv --json a.json --map m.svg"), "stand t.csv --json=a.json --map m.svg");
        for whole in ["connect --json status", "convert --json a.csv b.csv", "send - --json", "convert a.json b.csv"] {
            assert_eq!(joined(whole), whole);
        }
    }

    #[test]
    fn devices_hold_nothing_and_the_terminal_one_thing() {
        let [terminal, null] = ["-", "/dev/null"].map(PathBuf::from);
        assert!(Outputs::new([&null], [&terminal, &null, &null]).is_ok_and(|outputs| outputs.terminal_is_taken));
        assert!(Outputs::new([], [&null]).is_ok_and(|outputs| !outputs.terminal_is_taken));
        let mixed = Outputs::new([], [&terminal, &terminal]).err().unwrap();
        assert!(mixed.message.contains("cannot both go to the standard output"), "{}", mixed.message);
    }
}
