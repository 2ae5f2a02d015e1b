//! `motorbench settings`: the settings of the firmware, without a board.

use super::{Failure, JSON_TO, Outputs, TERMINAL, write_json};
use clap::Args;
use motorbench_core::settings::{Param, Settings, Text, help, text};
use motorbench_data::names::setting_name;
use motorbench_text::keys;
use motorbench_text::terminal_text::wrapped;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Prints the settings of the firmware: name, default, unit, range and meaning.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench settings
  motorbench settings speed_
  motorbench settings counts_per_rev

Of a board: motorbench connect show")]
pub struct Arguments {
    /// Name of a setting, or how names begin; default: all.
    #[arg(value_name = "NAME")]
    name: Option<String>,
    /// Prints the settings as JSON instead of text, or writes them into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// Runs it.
///
/// # Errors
/// [`Failure`] if there is no such setting, or the JSON file cannot be written.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let outputs = Outputs::new([], &arguments.json)?;
    let asked = arguments.name.as_deref().unwrap_or_default();
    let named = Param::ALL.iter().copied().filter(|param| setting_name(*param).starts_with(asked));
    let params: Vec<Param> = named.collect();
    if params.is_empty() {
        let names: Vec<String> = Param::ALL.iter().map(|param| setting_name(*param)).collect();
        let meant = keys::suggestion(keys::nearest(asked, names.iter().map(String::as_str)));
        return Err(Failure::input(format!("no setting begins with {asked}{meant}; motorbench settings lists all")));
    }
    if let Some(path) = &arguments.json {
        write_json(path, &Value::from_iter(params.iter().map(|param| described(*param))))?;
    }
    outputs.say(&params.into_iter().map(lines).collect::<String>());
    Ok(())
}

fn unit(param: Param) -> String {
    text(param, Text::Unit).map(char::from).collect()
}

/// A setting on two lines.
fn lines(param: Param) -> String {
    let (default, (least, most)) = (Settings::defaults().get(param), param.range());
    // A share has no unit to read, and a choice shows its range.
    let unit = Some(unit(param)).filter(|unit| unit.starts_with(char::is_alphabetic));
    let unit = unit.map_or_else(String::new, |unit| format!(" {unit}"));
    let head = format!("{} = {default}{unit}, {least} to {most}", setting_name(param));
    wrapped(&head, "", "    ") + &wrapped(help(param), "    ", "    ")
}

fn described(param: Param) -> Value {
    let (least, most) = param.range();
    json!({
        "name": setting_name(param), "unit": unit(param), "default": Settings::defaults().get(param), "least": least,
        "most": most, "help": help(param),
    })
}
