//! Texts and numbers for a terminal.

use std::sync::atomic::{AtomicUsize, Ordering};

/// Width of a terminal that all output fits.
pub const COLUMNS: usize = 80;
/// Narrowest width that texts are broken to.
const LEAST_COLUMNS: usize = 30;
/// Width that the lines of this run are broken to.
static WIDTH: AtomicUsize = AtomicUsize::new(COLUMNS);

/// Sets the width of a terminal that is narrower than [`COLUMNS`], once, before anything is printed.
pub fn set_columns(columns: usize) {
    WIDTH.store(columns.clamp(LEAST_COLUMNS, COLUMNS), Ordering::Relaxed);
}

fn width() -> usize {
    WIDTH.load(Ordering::Relaxed)
}

/// A number with three significant digits.
pub fn short(value: f64) -> String {
    rounded(value, 3)
}

/// A number with so many significant digits.
pub fn rounded(value: f64, digits: i32) -> String {
    if value == 0.0 {
        return "0".into();
    }
    if !value.is_finite() {
        return format!("{value}");
    }
    let magnitude = value.abs().log10().floor() as i32;
    if (-3..5).contains(&magnitude) {
        format!("{value:.*}", (digits - 1 - magnitude).max(0) as usize)
    } else {
        format!("{value:.*e}", digits as usize - 1)
    }
}

/// A number with so many digits after the point. A number that rounds to zero has no sign.
pub fn fixed(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.bytes().all(|byte| matches!(byte, b'0' | b'.')) => zero.into(),
        _ => text,
    }
}

/// A sign and the space before it. No line ends between them.
const HELD_PERCENT: &str = "\u{a0}%";

/// Breaks a text into lines of the terminal's width, [`COLUMNS`] at most. The first begins after `first`, the others after `other`. The last line
/// gets its line end.
pub fn wrapped(text: &str, first: &str, other: &str) -> String {
    wrapped_to(width(), text, first, other)
}

/// The same for so many columns.
pub fn wrapped_to(columns: usize, text: &str, first: &str, other: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    let options = textwrap::Options::new(columns)
        .initial_indent(first)
        .subsequent_indent(other)
        .break_words(false)
        .word_splitter(textwrap::WordSplitter::NoHyphenation);
    // A number stays with its sign.
    let text = words.join(" ").replace(" %", HELD_PERCENT);
    textwrap::fill(&text, options).replace(HELD_PERCENT, " %") + "\n"
}

/// A name quoted for a shell, for a command that the user shall copy.
pub fn quoted(name: &str) -> String {
    // A file name cannot contain a zero, which cannot be quoted.
    shlex::try_quote(name).map_or_else(|_| name.into(), Into::into)
}

/// Breaks the lines of a text that are longer than the terminal is wide, [`COLUMNS`] at most. All others stay unchanged.
pub fn narrow(text: &str) -> String {
    broken(text, width())
}

/// The text for a terminal that is narrower than [`COLUMNS`]: a row of a table first loses spaces between its columns. For
/// any other terminal it stays unchanged.
pub fn fitted(text: &str) -> String {
    fitted_to(text, width())
}

fn fitted_to(text: &str, columns: usize) -> String {
    if columns >= COLUMNS {
        return text.into();
    }
    let closer = |line: &str| match line.chars().count() > columns {
        true => with_less_space(line, line.chars().count() - columns),
        false => line.into(),
    };
    broken(&text.split('\n').map(closer).collect::<Vec<String>>().join("\n"), columns)
}

/// A line with so many spaces less, from the widest gaps between its words; one space stays in each.
fn with_less_space(line: &str, spaces: usize) -> String {
    let begin = line.len() - line.trim_start().len();
    let mut words: Vec<String> = line[begin..].split(' ').map(String::from).collect();
    for _ in 0..spaces {
        // An empty word stands between two spaces.
        let runs = (0..words.len()).filter(|index| words[*index].is_empty());
        let run_of = |index: usize| words[index..].iter().take_while(|word| word.is_empty()).count();
        let Some(widest) = runs.max_by_key(|index| run_of(*index)) else { break };
        words.remove(widest);
    }
    line[..begin].to_owned() + &words.join(" ")
}

fn broken(text: &str, columns: usize) -> String {
    let line = |line: &str| match line.chars().count() > columns {
        true => {
            let indent = &line[..line.len() - line.trim_start().len()];
            wrapped_to(columns, line, indent, indent).trim_end().to_owned()
        }
        false => line.into(),
    };
    text.split('\n').map(line).collect::<Vec<String>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_nothing_has_no_sign() {
        assert_eq!([-0.004, 0.004, -0.005_1, -12.0].map(|value| fixed(value, 2)), ["0.00", "0.00", "-0.01", "-12.00"]);
        assert_eq!(fixed(-0.4, 0), "0");
        assert_eq!([-0.0, -1e-3].map(short), ["0", "-0.00100"]);
    }

    #[test]
    fn a_name_is_one_word_of_a_shell() {
        for name in ["run.csv", "/dev/ttyACM0", "\u{fc} r\u{fc}n.csv", "it's $HOME.csv", "a;b&c.csv"] {
            assert_eq!(shlex::split(&quoted(name)), Some(vec![name.to_string()]));
        }
        assert_eq!(quoted("../runs/run-2.csv"), "../runs/run-2.csv");
    }

    #[test]
    fn only_long_lines_are_broken() {
        let drawn = "  |   ^^^\n";
        let text = format!("{drawn}  {}\n", "words ".repeat(20).trim_end());
        let broken = narrow(&text);
        assert!(broken.starts_with(drawn) && broken.ends_with("words\n"), "{broken}");
        assert!(broken.lines().skip(1).all(|line| line.starts_with("  words") && line.len() <= COLUMNS), "{broken}");
        assert_eq!((broken.lines().count(), broken.matches("words").count()), (3, 20));
    }

    /// A table keeps its rows as long as the spaces between its columns suffice.
    #[test]
    fn everything_fits_a_terminal_of_sixty_columns() {
        let row = "  omega_rad_per_s            1.34       0.0613     0.0600   98.1 % -> 99.9 %";
        let text = format!("{row}\n  - {}\n  |  ^^\n", "words ".repeat(20).trim_end());
        let fit = fitted_to(&text, 60);
        assert!(fit.lines().all(|line| line.chars().count() <= 60), "{fit}");
        let first = fit.lines().next().unwrap();
        assert_eq!(first.split_whitespace().collect::<Vec<_>>(), row.split_whitespace().collect::<Vec<_>>());
        assert!(fit.ends_with("  |  ^^\n") && fit.matches("words").count() == 20);
        assert_eq!(fitted_to(&text, COLUMNS), text, "for eighty columns the commands format themselves");
    }

    #[test]
    fn a_line_does_not_end_before_a_percent_sign() {
        let text = format!("{} 99 % and more", "a".repeat(77));
        assert_eq!(wrapped(&text, "", ""), format!("{}\n99 % and more\n", "a".repeat(77)));
    }
}
