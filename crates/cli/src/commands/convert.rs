//! `motorbench convert`: recordings from and to other formats.

use super::{Failure, JSON_TO, Outputs, TERMINAL, is_terminal, write, write_json};
use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use motorbench_data::convert::{self, Dialect, Format};
use motorbench_data::mapping::Mapping;
use motorbench_data::recording::{Channel, Recording};
use motorbench_files::text_file;
use motorbench_text::terminal_text::quoted;
use std::path::{Path, PathBuf};

/// Converts recordings from and to CSV of other programs, PlotJuggler, WPILib SysId and WPILOG, MATLAB and NumPy.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench convert log.wpilog run.csv --map velocity=omega_rad_per_s*6.2832 \\
    --map volts=u_V
  motorbench convert scope.csv run.csv --decimal-comma --map Zeit=t_s \\
    --map Drehzahl=rpm
  motorbench convert run.csv run.mat
  motorbench convert run.csv jug.csv --to plotjuggler
  motorbench convert sysid.json run.csv

docs/reference/formats.md describes each format.")]
pub struct Arguments {
    /// File to convert; its ending gives the format.
    source: PathBuf,
    /// File to write; its ending gives the format. - for the terminal, as CSV unless --to gives another format.
    target: PathBuf,
    /// Format of the source, if its ending does not give it.
    #[arg(long, value_name = "FORMAT", value_parser = format_name())]
    from: Option<Format>,
    /// Format of the target, if its ending does not give it.
    #[arg(long, value_name = "FORMAT", value_parser = format_name())]
    to: Option<Format>,
    /// A source column and its channel, with a factor and an offset if needed: velocity=omega_rad_per_s*6.2832,
    /// adc=i_A*0.0264-13.5. docs/reference/formats.md has all forms.
    #[arg(long = "map", visible_alias = "column", value_name = "NAME=CHANNEL")]
    names: Vec<Mapping>,
    /// A channel and its name in the target: omega_rad_per_s=speed.
    #[arg(long = "rename", value_name = "CHANNEL=NAME", value_parser = renaming)]
    renamed: Vec<(Channel, String)>,
    /// Separator of a CSV source; default: the most frequent one in its header.
    #[arg(long, value_name = "CHARACTER", value_parser = delimiter)]
    delimiter: Option<u8>,
    /// The CSV source has decimal commas (1,5 for 1.5). Found automatically if semicolons separate the values.
    #[arg(long)]
    decimal_comma: bool,
    /// Separator of a CSV target.
    #[arg(long, value_name = "CHARACTER", value_parser = delimiter)]
    to_delimiter: Option<u8>,
    /// The CSV target gets decimal commas (1,5 for 1.5), with semicolons between values.
    #[arg(long)]
    to_decimal_comma: bool,
    /// Prints a summary as JSON instead of text, or writes it into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// Parses the name of a [`Format`]; the help text lists all of them.
fn format_name() -> impl TypedValueParser<Value = Format> {
    let possible = Format::ALL.map(|format| PossibleValue::new(format.name()).help(format.description()));
    PossibleValuesParser::new(possible).map(|name| {
        Format::ALL.into_iter().find(|format| format.name() == name).expect("the parser accepts only these names")
    })
}

fn renaming(text: &str) -> Result<(Channel, String), String> {
    let (column, name) = text.split_once('=').ok_or("expected CHANNEL=NAME, for instance omega_rad_per_s=speed")?;
    let channel = Channel::of_column(column).ok_or_else(|| {
        format!("no channel is called \"{column}\"; there are {}", Channel::ALL.map(Channel::column).join(", "))
    })?;
    Ok((channel, name.into()))
}

fn delimiter(text: &str) -> Result<u8, String> {
    match text.as_bytes() {
        _ if text == "tab" || text == "\\t" => Ok(b'\t'),
        [byte] if byte.is_ascii() => Ok(*byte),
        _ => Err("expected one character, or tab".into()),
    }
}

/// The names that --rename gives, as a reader of the target has to map them.
fn own_names(renamed: &[(Channel, String)]) -> Vec<Mapping> {
    let mapping = |(channel, name): &(Channel, String)| Mapping {
        name: name.clone(),
        channel: *channel,
        factor: None,
        offset: 0.0,
    };
    renamed.iter().map(mapping).collect()
}

/// The command for a target that is a recording of a motor.
fn next(target: &Path, kept: &Recording, renamed: &[(Channel, String)]) -> String {
    let has = |channels: &[Channel]| channels.iter().any(|channel| kept.get(*channel).is_some());
    let is_driven = has(&[Channel::Voltage, Channel::Duty]) && kept.time_s().is_some();
    let moves = has(&[Channel::Speed, Channel::Rpm, Channel::Angle, Channel::Counts, Channel::Current]);
    if is_terminal(target) || !(is_driven && moves) {
        return String::new();
    }
    let columns = renamed.iter().map(|(channel, name)| quoted(&format!("{name}={}", channel.column())));
    let columns: String = columns.map(|column| format!(" --column {column}")).collect();
    format!("motorbench diagnose {} --rig RIG.toml{columns}", quoted(&target.display().to_string()))
}

/// Runs it.
///
/// # Errors
/// [`Failure`] with file, place and what to do.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let format =
        |given: Option<Format>, path: &Path| given.map_or_else(|| Format::of_path(path), Ok).map_err(Failure::input);
    // The standard output has no ending.
    let target_format = arguments.to.or_else(|| is_terminal(&arguments.target).then_some(Format::Csv));
    let to = format(target_format, &arguments.target)?;
    let written = [&arguments.target].into_iter().chain(&arguments.json);
    let outputs = Outputs::with_names([&arguments.source], written, &own_names(&arguments.renamed))?;
    let name = arguments.source.display().to_string();
    let bytes = std::fs::read(&arguments.source)
        .map_err(|error| Failure::input(format!("{name}: {}", text_file::explained(&arguments.source, error))))?;
    let from = match arguments.from.unwrap_or_else(|| Format::of_content(&arguments.source, &bytes)) {
        Format::Csv => format(arguments.from, &arguments.source)?,
        by_content => by_content,
    };
    let dialect = Dialect { delimiter: arguments.delimiter, decimal_comma: arguments.decimal_comma };
    let converted = convert::read(&name, &bytes, from, &arguments.names, dialect).map_err(Failure::input)?;
    let dialect = Dialect { delimiter: arguments.to_delimiter, decimal_comma: arguments.to_decimal_comma };
    let recording = &converted.recording;
    let written = convert::write(recording, to, &arguments.renamed, dialect).map_err(Failure::input)?;
    let target = &arguments.target;
    write(target, &written)?;
    // SysId holds four tests only.
    let tests = (to == Format::Sysid)
        .then(|| convert::read(&name, &written, to, &[], Dialect::default()))
        .transpose()
        .map_err(Failure::input)?;
    let kept = tests.as_ref().map_or(recording, |tests| &tests.recording);
    let channels: Vec<&str> = kept.channels().map(Channel::column).collect();
    if let Some(path) = &arguments.json {
        let summary = serde_json::json!({
            "samples": kept.len(), "channels": channels, "ignored": recording.ignored, "cut": converted.cut,
            "notes": recording.notes
        });
        write_json(path, &summary)?;
    }
    let (count, channels) = (kept.len(), channels.join(", "));
    outputs.say(&format!("{}: {count} samples of {channels}\n", target.display()));
    if let Some(cut) = &converted.cut {
        outputs.say(&format!("{name}: {cut}\n"));
    }
    if kept.len() < recording.len() {
        let whole = recording.len();
        outputs.say(&format!("of {whole}: SysId takes the longest ramp and the longest step of each direction\n"));
    }
    for note in &recording.notes {
        outputs.say(&format!("{name}: {note}\n"));
    }
    if !recording.ignored.is_empty() {
        let ignored = recording.ignored.join(", ");
        let how = match &*recording.suggestion {
            "" => "Name them with --map NAME=CHANNEL".to_owned(),
            likely => format!("Likely: {likely}"),
        };
        outputs.say(&format!("not used, since they have no known name: {ignored}. {how}\n"));
    }
    outputs.wrote(&next(target, kept, &arguments.renamed));
    Ok(())
}
