//! Which files motorbench wrote. No output of any command replaces another one.
//!
//! Text carries a mark. A table has none, since other programs read it: it is known by its columns.

use motorbench_data::convert::{self, Dialect, Format};
use motorbench_data::mapping::Mapping;
use motorbench_data::recording::Channel;
use serde_json::{Map, Value};
use std::fs;
use std::path::Path;

/// First line of a TOML file and of console lines that motorbench wrote.
pub(super) const WRITTEN: &str = "# Written by motorbench, which writes over it.\n";
/// The same for pages and plots, before their last line.
const IN_PAGES: &str = "<!-- Written by motorbench, which writes over it. -->\n";
/// The same in JSON.
const IN_JSON: &str = ",\n  \"written_by\": \"motorbench\"\n}\n";
/// The same in a PNG: a text chunk with its length and its check sum.
const IN_PNG: &[u8] = b"\0\0\0\x13tEXtSoftware\0motorbench";
/// What ends a PNG: an empty chunk.
const END_OF_PNG: &[u8] = b"\0\0\0\0IEND\xae\x42\x60\x82";

/// What a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Table,
    Json,
    Page,
    Plot,
    Picture,
    Toml,
    Lines,
    Other,
}

impl Kind {
    /// By its first letters.
    fn of(contents: &[u8]) -> Self {
        let text = contents.trim_ascii_start();
        let begins =
            |with: &str| text.get(..with.len()).is_some_and(|begin| begin.eq_ignore_ascii_case(with.as_bytes()));
        let lines = contents.strip_prefix(WRITTEN.as_bytes()).unwrap_or(text);
        match text {
            [b'{', ..] | [b'[', b']' | b'{' | b'\n' | b'0'..=b'9', ..] => Self::Json,
            _ if begins("<!doctype html") || begins("<html") => Self::Page,
            _ if begins("<svg") || begins("<?xml") => Self::Plot,
            _ if contents.starts_with(b"\x89PNG") => Self::Picture,
            _ if lines.starts_with(b"set ") => Self::Lines,
            _ if begins(WRITTEN.trim_end()) || begins("[") => Self::Toml,
            _ if contents.contains(&b'\n') && is_text(contents) && names(contents).is_some() => Self::Table,
            _ => Self::Other,
        }
    }

    /// Endings of its files, the usual one first.
    fn endings(self) -> &'static [&'static str] {
        match self {
            Self::Table => &["csv", "tsv", "txt"],
            Self::Json => &["json"],
            Self::Page => &["html", "htm"],
            Self::Plot => &["svg"],
            Self::Picture => &["png"],
            Self::Toml => &["toml"],
            Self::Lines => &["txt"],
            Self::Other => &[],
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Table => "a table",
            Self::Json => "JSON",
            Self::Page => "a page",
            Self::Plot | Self::Picture => "a plot",
            Self::Toml => "TOML",
            Self::Lines => "console lines",
            Self::Other => "a file of another program",
        }
    }
}

/// Every kind with an ending.
const KINDS: [Kind; 7] = [Kind::Table, Kind::Json, Kind::Page, Kind::Plot, Kind::Picture, Kind::Toml, Kind::Lines];

fn is_text(contents: &[u8]) -> bool {
    contents.iter().take(4096).all(|byte| *byte >= b' ' || byte.is_ascii_whitespace())
}

/// The names of a table's columns.
fn names(contents: &[u8]) -> Option<Vec<&str>> {
    let line = std::str::from_utf8(contents.split(|byte| *byte == b'\n').next()?).ok()?.trim_end();
    let names: Vec<&str> = line.split([',', ';', '\t']).collect();
    let is_name = |name: &&str| {
        name.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
            && name.chars().all(|sign| sign.is_alphanumeric() || "_-/".contains(sign))
    };
    names.iter().all(is_name).then_some(names)
}

/// Whether motorbench has written what is there, as far as that can be known. `own` maps the names that this command
/// gives to channels.
pub(super) fn may_be_replaced(path: &Path, there: &[u8], own: &[Mapping]) -> bool {
    let contains = |mark: &[u8]| there.windows(mark.len()).any(|part| part == mark);
    match Kind::of(there) {
        _ if there.trim_ascii().is_empty() => true,
        Kind::Toml | Kind::Lines => there.starts_with(WRITTEN.as_bytes()),
        Kind::Json => {
            // The side file of a measurement.
            let is_side = contains(b"\"firmware\"") && contains(b"\"settings\"");
            is_side || there.ends_with(IN_JSON.as_bytes()) || is_own_list(there)
        }
        Kind::Page | Kind::Plot => contains(IN_PAGES.as_bytes()),
        Kind::Picture => contains(IN_PNG),
        Kind::Table => {
            names(there).is_some_and(|names| is_recording(&names, own) && is_as_written(there) || names == BODE)
        }
        Kind::Other => is_converted(path, there, own),
    }
}

/// The keys of what `ports` and `settings` list, in their alphabetical order.
const LISTED: [&[&str]; 2] =
    [&["board", "port", "simulated", "what"], &["default", "help", "least", "most", "name", "unit"]];

/// Whether it is such a list, which cannot carry a mark.
fn is_own_list(there: &[u8]) -> bool {
    let list = serde_json::from_slice::<Vec<Map<String, Value>>>(there);
    let is_of = |keys: &[&str], list: &[Map<String, Value>]| list.iter().all(|one| keys.iter().eq(one.keys()));
    list.is_ok_and(|list| LISTED.iter().any(|keys| is_of(keys, &list)))
}

/// Whether a file of another program has this project's channels only, as `convert` writes them.
fn is_converted(path: &Path, there: &[u8], own: &[Mapping]) -> bool {
    let format = Format::of_content(path, there);
    let is_whole = |names: &[Mapping]| {
        convert::read("", there, format, names, Dialect::default()).is_ok_and(|read| read.recording.ignored.is_empty())
    };
    format != Format::Csv && (is_whole(&[]) || is_whole(own))
}

/// Columns of the frequency responses of `analyse`.
const BODE: [&str; 7] = [
    "omega_rad_per_s",
    "speed_rad_per_s_per_V",
    "speed_phase_deg",
    "current_A_per_V",
    "current_phase_deg",
    "angle_rad_per_V",
    "angle_phase_deg",
];

/// Whether all columns are channels; PlotJuggler calls its time otherwise.
fn is_recording(names: &[&str], own: &[Mapping]) -> bool {
    let is_own = |name: &str| own.iter().any(|mapping| mapping.name == name);
    names.iter().all(|name| *name == "__time" || Channel::of_column(name).is_some() || is_own(name))
}

/// Whether motorbench wrote the numbers: with no digit more than they need, or with the seven of a step response. The
/// table of a sketch may have the same names, but it has numbers such as 0.500.
fn is_as_written(there: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(there) else { return false };
    let header = text.lines().next().unwrap_or_default();
    let between = [';', '\t', ','].into_iter().find(|sign| header.contains(*sign)).unwrap_or(',');
    let is_short = |cell: &str| {
        let number = if between == ',' { cell.to_owned() } else { cell.replace(',', ".") };
        let is_ours = |value: f64| value.to_string() == number || format!("{value:.6e}") == number;
        number.is_empty() || number == "nan" || number.parse().is_ok_and(is_ours)
    };
    text.lines().skip(1).flat_map(|line| line.split(between)).all(is_short)
}

/// Why contents cannot go into a file: its ending is that of another kind.
pub(super) fn wrong_ending(path: &Path, contents: &[u8]) -> Option<String> {
    let (kind, name) = (Kind::of(contents), path.display());
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_lowercase();
    let is_of_another = KINDS.iter().any(|other| other.endings().contains(&ending.as_str()));
    let usual = kind.endings().first().filter(|_| is_of_another && !kind.endings().contains(&ending.as_str()))?;
    Some(format!("{name} would hold {}: give it a name that ends in .{usual}", kind.name()))
}

/// What a file holds. A device is none: it may be read without end.
pub(super) fn held_in(path: &Path) -> Option<Vec<u8>> {
    path.is_file().then(|| fs::read(path).ok()).flatten()
}

/// Why contents cannot replace what is there, if that is of another kind: a table has the ending of console lines too.
pub(super) fn other_kind(path: &Path, there: &[u8], contents: &[u8]) -> Option<String> {
    let (kind, of_contents) = (Kind::of(there), Kind::of(contents));
    let is_other = kind != of_contents && !there.trim_ascii().is_empty();
    is_other.then(|| {
        let (name, kind) = (path.display(), kind.name());
        format!("{name} holds {kind} and would hold {}: choose another name, or remove it", of_contents.name())
    })
}

/// The message about a file that motorbench did not write.
pub(super) fn not_ours(path: &Path) -> String {
    format!(
        "{} was not written by motorbench and is not overwritten: choose another name, or remove it",
        path.display()
    )
}

/// The contents with the mark of their kind.
pub(super) fn marked(contents: &[u8]) -> Vec<u8> {
    let mut marked = contents.to_vec();
    match Kind::of(contents) {
        Kind::Lines => marked = [WRITTEN.as_bytes(), contents].concat(),
        Kind::Json => {
            if let Some(before) = contents.strip_suffix(b"\n}\n").or_else(|| contents.strip_suffix(b"\n}")) {
                marked = [before, IN_JSON.as_bytes()].concat();
            }
        }
        Kind::Page | Kind::Plot => {
            let end = marked.trim_ascii_end().len();
            let closes = |tag: &[u8]| marked[..end].windows(tag.len()).rposition(|part| part == tag);
            let place = closes(b"</body>").or_else(|| closes(b"</svg>")).unwrap_or(end);
            marked.splice(place..place, IN_PAGES.bytes());
        }
        Kind::Picture => {
            if let Some(before) = contents.strip_suffix(END_OF_PNG) {
                let check = crc(&IN_PNG[4..]).to_be_bytes();
                marked = [before, IN_PNG, &check, END_OF_PNG].concat();
            }
        }
        _ => {}
    }
    marked
}

/// The check sum of a PNG's chunk.
fn crc(bytes: &[u8]) -> u32 {
    let byte = |sum: u32, byte: &u8| {
        (0..8).fold(sum ^ u32::from(*byte), |sum, _| if sum & 1 == 1 { sum >> 1 ^ 0xedb8_8320 } else { sum >> 1 })
    };
    !bytes.iter().fold(!0, byte)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_motorbench_wrote_is_known() {
        let toml = [WRITTEN.as_bytes(), b"[motor]\n"].concat();
        let png = [b"\x89PNG\r\n\x1a\n".as_slice(), END_OF_PNG].concat();
        let page = b"<!DOCTYPE html>\n<p>";
        for written in [&b"{\n  \"a\": 1\n}\n"[..], page, b"<svg></svg>", &png, &toml, b"set speed_kp 1\n"] {
            assert!(may_be_replaced(Path::new("x"), &marked(written), &[]), "{}", String::from_utf8_lossy(written));
        }
        // Check sums of the standard: of a chunk of nothing but its name.
        assert_eq!(crc(b"IEND"), 0xae42_6082);
        for by_hand in [
            &b"{\n  \"a\": 1\n}\n"[..],
            b"<!DOCTYPE html>",
            b"<svg></svg>",
            &png,
            b"[motor]\n",
            b"set speed_kp 1\n",
            b"notes: buy bearings",
            b"\x93NUMPY",
        ] {
            assert!(!may_be_replaced(Path::new("x"), by_hand, &[]), "{}", String::from_utf8_lossy(by_hand));
        }
        assert!(may_be_replaced(Path::new("x.json"), b"", &[]));
    }

    #[test]
    fn a_kind_has_its_endings_and_a_table_its_columns() {
        let refused = |name: &str, contents: &[u8]| wrong_ending(Path::new(name), contents);
        let table = b"t_s,u_V\n0,1\n";
        assert!(refused("rig.toml", table).is_some_and(|why| why.ends_with("a name that ends in .csv")));
        assert!(refused("run.csv", b"{\n  \"a\": 1\n}\n").is_some_and(|why| why.contains("would hold JSON")));
        assert_eq!((refused("run.csv", table), refused("run.out", table)), (None, None));
        let bode = BODE.join(",") + "\n1,2,3,4,5,6,7\n";
        for (there, is_ours) in [
            (&b"t_s,rpm\n0,1\n0.001,-2.5\n0.002,\n"[..], true),
            (b"t_s,rpm\n0.000000e0,1.361287e-4\n", true),
            (b"t_s;rpm\n0;1\n0,001;-2,5\n", true),
            (b"t_s,rpm\n0.000,1.0\n", false),
            (b"when,what\n1,2\n", false),
            (bode.as_bytes(), true),
        ] {
            assert_eq!(may_be_replaced(Path::new("run.csv"), there, &[]), is_ours);
        }
    }

    /// A list of ports cannot carry a mark, nor can a table whose channels this command calls otherwise.
    #[test]
    fn what_has_no_mark_is_known_by_its_names() {
        let ports = br#"[{ "port": "COM3", "what": "Arduino Uno", "board": true, "simulated": false }]"#;
        let other = br#"[{ "port": 3, "what": "notes" }]"#;
        let settings = br#"[{ "default": 1, "help": "", "least": 0, "most": 2, "name": "speed_b", "unit": "1" }]"#;
        assert!(may_be_replaced(Path::new("settings.json"), settings, &[]));
        assert!(may_be_replaced(Path::new("ports.json"), ports, &[]));
        assert!(!may_be_replaced(Path::new("ports.json"), other, &[]));
        let (table, own) = (b"t_s,speed\n0,1\n", ["speed=omega_rad_per_s".parse().unwrap()]);
        assert!(!may_be_replaced(Path::new("run.csv"), table, &[]));
        assert!(may_be_replaced(Path::new("run.csv"), table, &own));
    }
}
