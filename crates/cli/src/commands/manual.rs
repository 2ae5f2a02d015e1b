//! `motorbench man`, `motorbench completions`: descriptions of the command line for readers, shells and programs.

use super::{EXIT_CODES, Failure, JSON_TO, Outputs, TERMINAL, command, write_json};
use clap::{Arg, Args, Command};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Prints a completion script for a shell.
#[derive(Args)]
#[command(after_help = "Example:
  motorbench completions bash > \\
    ~/.local/share/bash-completion/completions/motorbench")]
pub struct CompletionsArguments {
    /// The shell.
    shell: clap_complete::Shell,
    /// Prints shell and script as JSON instead of the script, or writes them into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// Runs `completions`.
///
/// # Errors
/// If the JSON file cannot be written.
pub fn completions(arguments: &CompletionsArguments) -> Result<(), Failure> {
    let outputs = Outputs::new([], &arguments.json)?;
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut command(), "motorbench", &mut script);
    let script = String::from_utf8_lossy(&script);
    if let Some(path) = &arguments.json {
        write_json(path, &json!({ "shell": arguments.shell.to_string(), "script": script }))?;
    }
    outputs.say(&script);
    Ok(())
}

/// Prints the manual page, of the program or of a command.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench man | man -l -
  motorbench man record | man -l -
  motorbench man --json")]
pub struct ManArguments {
    /// Command to describe; default: the program.
    #[arg(value_parser = named)]
    command: Option<Box<Command>>,
    /// Prints commands, arguments, values and defaults as JSON instead of the page, or writes them into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// The program, with the options' defaults and the whole usage of each command.
fn built() -> Command {
    let mut program = command();
    program.build();
    program
}

fn named(name: &str) -> Result<Box<Command>, &'static str> {
    built().find_subcommand(name).cloned().map(Box::new).ok_or("no such command; `motorbench --help` lists them")
}

/// Runs `man`.
///
/// # Errors
/// If a page cannot be made, or the JSON file cannot be written.
pub fn man(arguments: ManArguments) -> Result<(), Failure> {
    let outputs = Outputs::new([], &arguments.json)?;
    let of = arguments.command.map_or_else(built, |command| *command);
    if let Some(path) = &arguments.json {
        write_json(path, &described(&of))?;
    }
    outputs.say(&page(of)?);
    Ok(())
}

/// The manual page of the program or a command, which has no version of its own.
fn page(of: Command) -> Result<String, Failure> {
    let mut page = Vec::new();
    let source = concat!("motorbench ", env!("CARGO_PKG_VERSION"));
    clap_mangen::Man::new(of).source(source).render(&mut page).map_err(Failure::machine)?;
    Ok(String::from_utf8_lossy(&page).into_owned() + &exit_status())
}

/// The section of a manual page about commands or exit codes.
fn exit_status() -> String {
    let codes = EXIT_CODES.iter().map(|(code, meaning)| format!(".TP\n\\fB{code}\\fR\n{meaning}\n"));
    format!(".SH \"EXIT STATUS\"\n{}", codes.collect::<String>())
}

/// A command and its subcommands.
fn described(command: &Command) -> Value {
    let arguments = command.get_arguments().filter(|argument| !argument.is_hide_set()).map(argument);
    json!({
        "name": command.get_name(),
        "about": command.get_about().map(ToString::to_string),
        "arguments": arguments.collect::<Vec<_>>(),
        "commands": command.get_subcommands().map(described).collect::<Vec<_>>(),
    })
}

fn argument(argument: &Arg) -> Value {
    let takes_value = argument.get_action().takes_values();
    let values = argument.get_possible_values();
    let of_value = |texts: Vec<String>| takes_value.then_some(texts);
    json!({
        "long": argument.get_long().map(|long| format!("--{long}")),
        "help": argument.get_help().map(ToString::to_string),
        "required": argument.is_required_set(),
        "value": of_value(argument.get_value_names().unwrap_or_default().iter().map(ToString::to_string).collect()),
        "one_of": of_value(values.iter().map(|value| value.get_name().to_owned()).collect()),
        "default": of_value(
            argument.get_default_values().iter().map(|value| value.to_string_lossy().into_owned()).collect()
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_page_names_the_program_and_its_version() {
        let program = built();
        for of in program.get_subcommands().chain([&program]) {
            let page = page(of.clone()).unwrap_or_else(|failure| panic!("{}", failure.message));
            let title = page.lines().find(|line| line.starts_with(".TH")).expect("a title");
            assert!(title.contains(concat!("\"motorbench ", env!("CARGO_PKG_VERSION"), "\"")), "{title}");
        }
    }

    #[test]
    fn exit_codes_are_those_of_the_page() {
        let page =
            std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/reference/commands.md")).unwrap();
        let status = exit_status();
        for (code, meaning) in EXIT_CODES {
            assert!(page.contains(&format!("| {code} | {meaning} |")), "{code}");
            assert!(status.contains(&format!("{code}\\fR\n{meaning}\n")), "{status}");
        }
    }
}
