//! Mistyped keys of files: finds the key that was meant, and its line.

use toml::de::{DeTable, DeValue};

/// Number of letters by which a key may differ, relative to its length. One letter is always allowed.
const LETTERS_A_SLIP: usize = 4;

/// The known key that is most similar to a mistyped one, if any is near. Upper and lower case do not matter.
pub fn nearest<'a>(typed: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let typed = typed.to_lowercase();
    let most = (typed.chars().count() / LETTERS_A_SLIP).max(1);
    let distance = |key: &str| strsim::damerau_levenshtein(&typed, &key.to_lowercase());
    let near = known.into_iter().map(|key| (distance(key), key)).filter(|(letters, _)| *letters <= most);
    near.min_by_key(|(letters, _)| *letters).map(|(_, key)| key)
}

/// Line, from one on, of a key in a TOML text. `path` gives its tables and at last the key.
pub fn line(text: &str, path: &[&str]) -> Option<usize> {
    let (last, tables) = path.split_last()?;
    let mut table = DeTable::parse(text).ok()?.into_inner();
    for name in tables {
        match table.remove(*name)?.into_inner() {
            DeValue::Table(inner) => table = inner,
            _ => return None,
        }
    }
    let (key, _) = table.get_key_value(*last)?;
    Some(text[..key.span().start].lines().count().max(1) + usize::from(text[..key.span().start].ends_with('\n')))
}

/// The reader's error with a hint: the key that was meant, or the number without its unit.
pub fn explained(error: &toml::de::Error) -> String {
    let text = error.to_string();
    let mut names = error.message().split('`').skip(1).step_by(2);
    let meant = names.next().filter(|_| error.message().starts_with("unknown ")).and_then(|key| nearest(key, names));
    let meant = meant.map(|meant| format!("did you mean `{meant}`?"));
    let advice = meant.or_else(|| number_advice(error.message())).or_else(|| point_advice(error.message(), &text));
    match advice {
        Some(advice) => format!("{}\n{advice}\n", text.trim_end()),
        None => text,
    }
}

/// Hint for a text where a number is expected.
fn number_advice(message: &str) -> Option<String> {
    let (text, expected) = message.strip_prefix("invalid type: string \"")?.split_once("\", expected ")?;
    if !["f32", "f64"].contains(&expected) && !expected.starts_with(['u', 'i']) {
        return None;
    }
    let digits = text.trim().split(char::is_whitespace).next()?.replace(',', ".");
    let example = digits.parse().ok().filter(|value: &f64| value.is_finite()).map(|_| format!(": {digits}"));
    Some(format!("write a number without its unit and without quotes{}", example.unwrap_or_default()))
}

/// Hint for a number with a decimal comma; `shown`: the line with the error.
fn point_advice(message: &str, shown: &str) -> Option<String> {
    let value = shown.lines().find_map(|line| line.rsplit_once('='))?.1.trim();
    let number = value.replacen(',', ".", 1);
    let is_one = message.starts_with("unexpected key or value") && number != value && number.parse::<f64>().is_ok();
    is_one.then(|| format!("write a decimal point: {number}"))
}

/// ` (did you mean …?)`, or nothing.
pub fn suggestion(meant: Option<&str>) -> String {
    meant.map_or_else(String::new, |meant| format!(" (did you mean {meant}?)"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_is_forgiven_and_another_word_is_not() {
        let known = ["resistance_ohm", "inductance_H", "motor"];
        for (typed, meant) in [
            ("inductance_h", Some("inductance_H")),
            ("resistence_ohms", Some("resistance_ohm")),
            ("mtoor", Some("motor")),
            ("model", None),
            ("colour", None),
            ("", None),
        ] {
            assert_eq!(nearest(typed, known), meant, "{typed}");
        }
    }

    #[test]
    fn a_decimal_comma_is_named() {
        let explained = |text: &str| explained(&toml::from_str::<toml::Table>(text).unwrap_err());
        let comma = explained("[motor]\nresistance_ohm = 5,84\n");
        assert!(comma.contains("line 2") && comma.ends_with("write a decimal point: 5.84\n"), "{comma}");
        assert!(!explained("resistance_ohm = 5 ohm\n").contains("point"));
    }

    #[test]
    fn a_key_has_its_line() {
        let text = "top = 1\n[a]\n\nb = 2\n[c.d]\ne = 3\nf.g = 4\n";
        for (path, expected) in [
            (&["top"][..], Some(1)),
            (&["a", "b"], Some(4)),
            (&["c", "d"], Some(5)),
            (&["c", "d", "e"], Some(6)),
            (&["c", "d", "f", "g"], Some(7)),
            (&["a", "x"], None),
            (&["top", "x"], None),
        ] {
            assert_eq!(line(text, path), expected, "{path:?}");
        }
    }
}
