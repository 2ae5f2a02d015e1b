//! The pages agree with the program: every command in them exists, and shown output is what the program prints.
//!
//! In a block of ` ```text `, a line that begins with `$ ` is a command. A backslash at its end continues it in the
//! next line. Its output follows; a line `...` stands for any lines. Numbers may differ in their last digits.

use crate::demonstration::{ARGUMENTS, demonstration};
use motorbench_cli::commands::{arguments, command};
use motorbench_data::recording::Channel;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
/// Tolerances of numbers, as shares.
#[derive(Clone, Copy)]
struct Tolerance {
    numbers: f64,
    /// Tolerance in a line that begins with a channel's name: errors and noise.
    errors: f64,
}

impl Tolerance {
    fn of(self, line: &str) -> f64 {
        let is_channel = line.split_whitespace().next().is_some_and(|word| Channel::of_column(word).is_some());
        if is_channel { self.errors } else { self.numbers }
    }
}

/// Other processors round differently.
const SAME: Tolerance = Tolerance { numbers: 0.01, errors: 0.01 };
/// A board records in real time, so each recording differs. Among seven of them the inductance, known to 14 %,
/// differed by up to 1 %. The error of the speed differed by 8 %, its noise by 18 %.
#[cfg(feature = "chip")]
const SAME_OF_A_BOARD: Tolerance = Tolerance { numbers: 0.02, errors: 0.3 };
/// Tolerance as a share of the largest number in the line.
const SAME_OF_LARGEST: f64 = 1e-4;

/// Commands that drive a board, or run until they are stopped.
const BOARD: [&str; 7] = ["virtual", "ports", "connect", "record", "send", "tune", "autotune"];

fn page(name: &str) -> String {
    std::fs::read_to_string(Path::new(ROOT).join(name)).unwrap()
}

fn pages() -> Vec<String> {
    let pages = |folder: &str| -> Vec<String> {
        let entries = std::fs::read_dir(Path::new(ROOT).join(folder)).unwrap();
        let names = entries.map(|entry| format!("{folder}/{}", entry.unwrap().file_name().to_string_lossy()));
        names.filter(|name| name.ends_with(".md")).collect()
    };
    let folders = ["docs", "docs/tutorials", "docs/how-to", "docs/reference", "docs/explanation"];
    folders.iter().flat_map(|folder| pages(folder)).chain(["README.md".to_string()]).collect()
}

/// A command of a page, and its output there.
struct Shown {
    line: String,
    output: Vec<String>,
}

/// The commands of a page with their output.
fn shown(page: &str) -> Vec<Shown> {
    let mut all: Vec<Shown> = Vec::new();
    // State of the parser: in a block with output; after a command, whose output follows; within a command.
    let (mut inside, mut after, mut goes_on) = (false, false, false);
    for line in page.lines() {
        if line.starts_with("```") {
            inside = line == "```text";
            (after, goes_on) = (false, false);
        } else if goes_on {
            let shown = all.last_mut().expect("a line that goes on");
            goes_on = line.ends_with('\\');
            shown.line += line.trim().trim_end_matches('\\');
        } else if let Some(command) = line.strip_prefix("$ ").filter(|_| inside) {
            (after, goes_on) = (true, command.ends_with('\\'));
            all.push(Shown { line: command.trim_end_matches('\\').into(), output: Vec::new() });
        } else if after {
            all.last_mut().expect("a command before").output.push(line.into());
        }
    }
    all
}

/// Every command line of a page: shown with its output, for a shell, or within a sentence.
fn lines(page: &str) -> Vec<String> {
    let mut all: Vec<String> = shown(page).into_iter().map(|shown| shown.line).collect();
    let (mut fence, mut goes_on) = (None, false);
    for line in page.lines() {
        if let Some(kind) = line.strip_prefix("```") {
            fence = (fence.is_none()).then(|| kind.to_owned());
        }
        let command = match fence.as_deref() {
            Some("sh") => line,
            None => line.strip_prefix("    ").unwrap_or_default(),
            _ => "",
        };
        for part in command.split("; ").map(|part| part.trim().trim_start_matches("do ")) {
            if goes_on {
                *all.last_mut().expect("a line that goes on") += part.trim_end_matches('\\');
            } else if part.starts_with("motorbench ") {
                all.push(part.trim_end_matches('\\').into());
            } else {
                continue;
            }
            goes_on = part.ends_with('\\');
        }
    }
    all.retain(|line| line.starts_with("motorbench "));
    all
}

/// The words of a line as a shell splits them, up to its own operators.
fn words(line: &str) -> Vec<String> {
    // The variable of a loop.
    let line = line.replace("$team", "1");
    let words = shlex::split(&line).unwrap_or_else(|| panic!("quotes: {line}"));
    words.into_iter().take_while(|word| !["&", "|", ">", "<", "&&"].contains(&word.as_str())).collect()
}

#[test]
fn every_command_in_the_pages_is_one() {
    let mut count = 0;
    for name in pages() {
        for line in lines(&page(&name)) {
            count += 1;
            if let Err(error) = command().try_get_matches_from(arguments(words(&line).into_iter().map(Into::into))) {
                assert!(!error.use_stderr(), "{name}: {line}\n{error}");
            }
        }
    }
    assert!(count > 60, "only {count} commands found");
}

/// The same words, and numbers that differ only by rounding.
fn same(expected: &str, found: &str, tolerance: Tolerance) -> bool {
    let share = tolerance.of(expected);
    let split = |text: &str| -> Vec<String> {
        let numeric = |c: char| c.is_ascii_digit() || c == '.' || c == '-' || c == '+' || c == 'e';
        text.split_whitespace()
            .flat_map(|word| {
                let core = word.trim_matches(|c: char| !numeric(c)).to_owned();
                let is_number = core.parse::<f64>().is_ok();
                if is_number { vec![word.replacen(&core, "#", 1), core] } else { vec![word.to_owned()] }
            })
            .collect()
    };
    let (expected, found) = (split(expected), split(found));
    let largest = expected.iter().filter_map(|word| word.parse::<f64>().ok()).fold(0.0, |a: f64, b| a.max(b.abs()));
    expected.len() == found.len()
        && expected.iter().zip(&found).all(|(a, b)| match (a.parse::<f64>(), b.parse::<f64>()) {
            (Ok(x), Ok(y)) => (x - y).abs() <= (share * x.abs().max(y.abs())).max(SAME_OF_LARGEST * largest),
            _ => a == b,
        })
}

/// A step from two lines: its number of lines in the page and in the output, and whether it is a difference.
type Move = (usize, usize, usize);

/// Possible steps, in order of preference.
fn moves(expected: Option<&String>, found: Option<&&str>, tolerance: Tolerance) -> Vec<Move> {
    match (expected, found) {
        (None, None) => vec![],
        (Some(line), found) if line.trim() == "..." => {
            [(1, 0, 0)].into_iter().chain(found.map(|_| (0, 1, 0))).collect()
        }
        (Some(line), Some(found)) => vec![(1, 1, usize::from(!same(line, found, tolerance))), (1, 0, 1), (0, 1, 1)],
        (Some(_), None) => vec![(1, 0, 1)],
        (None, Some(_)) => vec![(0, 1, 1)],
    }
}

/// The smallest difference of the page (`-`) and the output (`+`), with `...` for any lines.
fn differences(expected: &[String], output: &[&str], tolerance: Tolerance) -> Vec<String> {
    // Number of differences from each pair of lines to the end.
    let mut from = vec![vec![0; output.len() + 1]; expected.len() + 1];
    for row in (0..=expected.len()).rev() {
        for column in (0..=output.len()).rev() {
            let ways = moves(expected.get(row), output.get(column), tolerance).into_iter();
            from[row][column] =
                ways.map(|(down, right, cost)| cost + from[row + down][column + right]).min().unwrap_or(0);
        }
    }
    let (mut row, mut column, mut lines) = (0, 0, Vec::new());
    while let Some((down, right, cost)) = moves(expected.get(row), output.get(column), tolerance)
        .into_iter()
        .find(|(down, right, cost)| from[row][column] == cost + from[row + down][column + right])
    {
        if cost > 0 {
            lines.extend(expected[row..row + down].iter().map(|line| format!("- {line}")));
            lines.extend(output[column..column + right].iter().map(|line| format!("+ {line}")));
        }
        (row, column) = (row + down, column + right);
    }
    lines
}

#[test]
fn every_line_that_differs_is_found() {
    let page = ["a 1.000", "b", "...", "c", "d 5"].map(String::from);
    assert!(differences(&page, &["a 1.001", "b", "x", "y", "c", "d 5"], SAME).is_empty());
    // Errors of a channel may differ more than a constant.
    let loose = Tolerance { numbers: 0.01, errors: 0.2 };
    assert!(same("  i_A  0.100  95.0 %", "  i_A  0.115  96.0 %", loose) && !same("  i_A  0.1", "  i_A  0.13", loose));
    assert!(!same("  inertia_kg_m2  0.100", "  inertia_kg_m2  0.115", loose));
    let wrong = differences(&page, &["a 2", "b", "y", "d 7", "more"], SAME);
    assert_eq!(wrong, ["- a 1.000", "+ a 2", "- c", "+ d 7", "- d 5", "+ more"].map(String::from));
}

/// Copies the files of a folder.
fn copied(from: &Path, to: &Path) {
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
    }
}

/// Output of a page's command, standard output first, and its exit code.
type Said = (String, Option<i32>);

/// Runs a page's commands one after another, by `runs`, in a folder. Returns their number, and each whose output
/// differs from the page. `runs` skips a command by returning `None`.
fn run(
    name: &str,
    folder: &Path,
    tolerance: Tolerance,
    mut runs: impl FnMut(&[String]) -> Option<Said>,
) -> (usize, Vec<String>) {
    let mut wrong = Vec::new();
    let mut count = 0;
    for Shown { line, mut output } in shown(&page(name)) {
        let words = words(&line);
        if words.first().is_none_or(|word| word != "motorbench") {
            continue;
        }
        let Some((said, code)) = runs(&words) else { continue };
        count += 1;
        while output.last().is_some_and(|line| line.is_empty()) {
            output.pop();
        }
        let found: Vec<&str> = if line.contains(" > ") { Vec::new() } else { said.lines().collect() };
        if line.contains(" > ") {
            std::fs::write(folder.join(line.rsplit(" > ").next().unwrap().trim()), &said).unwrap();
        }
        let differences = differences(&output, &found, tolerance);
        if !differences.is_empty() {
            wrong.push(format!("{name}\n$ {line}\n{}\n(exit code {code:?})\n", differences.join("\n")));
        }
    }
    (count, wrong)
}

/// Output in the README is also in the tutorial, where its command is run.
#[test]
fn what_the_readme_shows_is_in_the_tutorial() {
    let tutorial = shown(&page("docs/tutorials/ten-minutes.md"));
    let readme = shown(&page("README.md"));
    assert!(readme.len() > 3, "the README shows {} commands", readme.len());
    for Shown { line, output } in readme {
        let run = tutorial.iter().find(|run| run.line == line).unwrap_or_else(|| panic!("not in the tutorial: {line}"));
        let mut rest = run.output.iter();
        for shown in output.iter().filter(|shown| !shown.is_empty()) {
            assert!(rest.any(|line| line == shown), "$ {line}\nthe tutorial does not show, in this order: {shown}");
        }
    }
}

fn needs_board(words: &[String]) -> bool {
    BOARD.contains(&&*words[1]) || words.iter().any(|word| word == "--port")
}

/// A command without a board and without an operator.
fn run_alone(words: &[String], folder: &Path) -> Said {
    if words[1..] == ARGUMENTS {
        demonstration().copy_recording(folder);
        let Output { status, stdout, .. } = &demonstration().output;
        return (String::from_utf8_lossy(stdout).into_owned(), status.code());
    }
    let done = Command::new(env!("CARGO_BIN_EXE_motorbench")).args(&words[1..]).current_dir(folder).output().unwrap();
    let [out, err] = [&done.stdout, &done.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
    (out + &err, done.status.code())
}

/// Runs the commands of a page that need no board, in a folder with the page's files.
fn comes_out(name: &str) {
    let (_, folders) = RUN.iter().find(|(page, _)| *page == name).expect("a page that is run");
    let folder = TempDir::new().unwrap();
    folders.iter().for_each(|from| copied(&PathBuf::from(ROOT).join(from), folder.path()));
    let alone = |words: &[String]| (!needs_board(words)).then(|| run_alone(words, folder.path()));
    let (count, differs) = run(name, folder.path(), SAME, alone);
    assert!(count > 0, "{name} shows no command that needs no board");
    assert!(differs.is_empty(), "- in the page, + what comes out\n{}", differs.join("\n"));
}

/// A test for each page, so that they run in parallel.
macro_rules! pages_that_are_run {
    ($($(#[$condition:meta])* $test:ident: $page:literal, $folders:expr;)*) => {
        /// Pages whose commands without a board are run, with the files that are copied into their folder.
        const RUN: &[(&str, &[&str])] = &[$($(#[$condition])* ($page, &$folders)),*];

        $(
            $(#[$condition])*
            #[test]
            fn $test() {
                comes_out($page);
            }
        )*
    };
}

pages_that_are_run! {
    what_the_page_of_a_wrong_model_shows_comes_out: "docs/how-to/wrong-model.md", ["examples/recording"];
    what_the_page_of_the_loop_shows_comes_out: "docs/how-to/loop.md", ["examples/recording"];
    what_the_page_of_physics_shows_comes_out: "docs/explanation/physics.md", ["examples/recording"];
    what_the_tutorial_shows_comes_out: "docs/tutorials/ten-minutes.md", ["examples/recording"];
    what_the_page_of_the_stand_shows_comes_out: "docs/how-to/stand.md", ["examples/pivt6"];
    // Recorded by the simulated chip. The core on this computer gives another noise.
    #[cfg(feature = "chip")]
    what_the_page_for_a_class_shows_comes_out: "docs/tutorials/class.md", [];
}

/// The board of the pages, with the actions at the shaft that a page describes.
#[cfg(feature = "chip")]
mod with_a_board {
    use super::{BOARD, RUN, SAME_OF_A_BOARD, Said, needs_board, run, run_alone};
    use crate::board::{Board, MOTORBENCH};
    use crate::motor::PIVT6_TOML;
    use std::io::{BufRead, BufReader, Read, Write};
    use std::path::Path;
    use std::process::{Command, Stdio};

    /// The folder of the board.
    const PORT: &str = "/tmp/motorbench";

    #[test]
    fn what_the_page_of_a_board_shows_comes_out() {
        comes_out_on_a_board("docs/how-to/board.md", "");
    }

    #[test]
    fn what_the_page_of_the_stand_shows_of_a_board_comes_out() {
        comes_out_on_a_board("docs/how-to/stand.md", PIVT6_TOML);
    }

    /// Runs a page's commands on a board of its own. `motor`: the nominal motor in `rig.toml`.
    fn comes_out_on_a_board(name: &str, motor: &str) {
        let stem = Path::new(name).file_stem().unwrap();
        let board = Board::new(&format!("page-{}", stem.display()));
        std::fs::write(board.folder.join("rig.toml"), motor).unwrap();
        let elsewhere = RUN.iter().any(|(page, _)| *page == name);
        let runs = |words: &[String]| (needs_board(words) || !elsewhere).then(|| on(&board, words));
        let (count, differs) = run(name, &board.folder, SAME_OF_A_BOARD, runs);
        assert!(count > 1, "{name} shows {count} commands");
        assert!(differs.is_empty(), "- in the page, + what comes out\n{}", differs.join("\n"));
    }

    /// Runs a page's command on this board instead of the page's, also a command that uses the only board on USB.
    fn on(board: &Board, words: &[String]) -> Said {
        let port = board.port().display().to_string();
        let mut words: Vec<String> = words.iter().map(|word| word.replace(PORT, &port)).collect();
        match &*words[1] {
            // Another board, which ends at once.
            "virtual" => words.extend(["--seconds", "0.1", "--link", &format!("{port}2")].map(str::to_owned)),
            name if BOARD.contains(&name) && !words.contains(&port) => {
                words.splice(2..2, ["--port".into(), port.clone()]);
            }
            "stand" if words.contains(&port) => return canonical(by_hand(board, &words), &port),
            _ => {}
        }
        canonical(run_alone(&words, &board.folder), &port)
    }

    /// Replaces names that differ on every computer, and angles that depend on the operator.
    fn canonical((said, code): Said, port: &str) -> Said {
        let lines = said.lines().map(|line| match (line.split_once(" (/dev/"), line.split_once(" deg: ")) {
            (Some((before, after)), _) => {
                format!("{before} (/dev/pts/0){}\n", after.split_once(')').unwrap_or_default().1)
            }
            (_, Some((_, held))) => format!(" 193.7 deg: {held}\n"),
            // Beside the usual place the next command names the port.
            _ if line.starts_with("next") => {
                let places = [format!(" --port {port}2"), format!(" --port {port}")];
                places.iter().fold(format!("{line}\n"), |line, place| line.replace(place, ""))
            }
            _ => format!("{line}\n"),
        });
        (lines.collect::<String>().replace(&format!("{port}2"), PORT).replace(port, PORT), code)
    }

    /// Turns and holds the rotor when asked, and releases it at the end.
    fn by_hand(board: &Board, words: &[String]) -> Said {
        let mut stand = Command::new(MOTORBENCH);
        stand.args(&words[1..]).current_dir(&board.folder);
        let mut stand = stand.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let (mut fingers, mut said) = (stand.stdin.take().unwrap(), String::new());
        for line in BufReader::new(stand.stderr.take().unwrap()).lines().map_while(Result::ok) {
            said += &format!("{line}\n");
            if line.contains("hold it, press Enter") {
                board.order("turn 25");
                writeln!(fingers).unwrap();
            }
        }
        board.order("block off");
        let mut page = String::new();
        stand.stdout.take().unwrap().read_to_string(&mut page).unwrap();
        (said + &page, stand.wait().unwrap().code())
    }
}
