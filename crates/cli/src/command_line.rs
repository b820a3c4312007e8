//! The command line of the program: its commands and its help.

use std::ffi::OsString;
use std::sync::LazyLock;

use clap::builder::StyledStr;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, FromArgMatches, Parser};
use mishandle::plan::keys;

use crate::commands::{Command, GROUPS};
use crate::flags::{self, KeyParser};
use crate::show::{escape, output};

/// Version, and the paths of MuJoCo's library and of the shipped files, for questions about an
/// installation.
static LONG_VERSION: LazyLock<String> = LazyLock::new(|| {
    let library = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let library = library.lines().find(|line| line.contains("libmujoco.so"));
    let library = library.and_then(|line| line.find('/').map(|start| &line[start..]));
    format!(
        "{}\nMuJoCo {}: {}\nshipped controllers and settings: {}",
        mishandle::build::VERSION_AND_COMMIT,
        mishandle::world::mujoco_version(),
        library.unwrap_or("linked statically"),
        mishandle::shipped::home_description()
    )
});

/// Train, evaluate and falsify robot controllers
#[derive(Debug, Parser)]
#[command(name = "mishandle", version = mishandle::build::VERSION_AND_COMMIT, long_version = LONG_VERSION.as_str())]
#[command(arg_required_else_help = true, max_term_width = 100)]
#[command(after_help = "Examples:
  mishandle list tasks
  mishandle evaluate ball-balancing --controller ppo --episodes 1000
  mishandle falsify ball-balancing --controller ppo --formula strict --trials 5

Results go to stdout, messages to stderr. Exit codes: 0 success, 1 falsified or violated, 2 error,
130 interrupted (finished work is saved).")]
pub struct CommandLine {
    #[command(subcommand)]
    pub command: Command,
}

impl CommandLine {
    /// Parses the arguments of the program. The first one is its name.
    pub fn parse_words(words: impl IntoIterator<Item = OsString>) -> Result<CommandLine, clap::Error> {
        let mut program = declaration();
        let matches = program.try_get_matches_from_mut(words)?;
        CommandLine::from_arg_matches(&matches).map_err(|error| error.format(&mut program))
    }
}

/// Returns the declaration of the program. Its help lists the commands by group, which the parser
/// cannot do for subcommands.
pub fn declaration() -> clap::Command {
    let program = CommandLine::command().mut_subcommands(|command| with_headings(with_keys(command)));
    let groups = groups(program.clone());
    let header = program.get_styles().get_header();
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{groups}\n\n{header}Options:{header:#}\n{{options}}{{after-help}}"
    );
    program.help_template(template)
}

/// Adds the keys that a command reads: to its completion, and to its long help.
fn with_keys(command: clap::Command) -> clap::Command {
    let parser = KeyParser(flags::tables(command.get_name()));
    if !command.get_arguments().any(|argument| argument.get_id() == "keys") {
        return command;
    }
    let about =
        "Set a key of the plan; repeat the flag for several. Text stands as it is, other values are TOML";
    let keys = format!("{about}. The keys:\n\n{}", parser.help());
    command.mut_arg("keys", |argument| argument.long_help(keys).value_parser(parser))
}

/// Headings of flags by their names. Other flags say what the command does.
const HEADINGS: [(&str, &[&str]); 4] = [
    ("Target", &["command", "controller", "guard", "space", "axis", "requirement", "action_noise"]),
    ("Run", &["seed", "threads", "json"]),
    ("Files", &["out", "resume", "force", "csv", "tensorboard", "junit", "markdown", "trace"]),
    ("Keys", &["keys", "plan"]),
];

/// Heading of flags that say what a command does.
const QUESTION: &str = "Question";

/// Puts the flags of a command below headings.
fn with_headings(command: clap::Command) -> clap::Command {
    let heading = |name: &str| {
        let found = HEADINGS.iter().find(|(_, names)| names.contains(&name));
        found.map_or(QUESTION, |(heading, _)| heading)
    };
    command.mut_args(|flag| {
        if flag.is_positional() || flag.get_help_heading().is_some() {
            return flag;
        }
        let heading = heading(flag.get_id().as_str());
        flag.help_heading(heading)
    })
}

/// Returns the commands of each group with their descriptions, wrapped at the width of the
/// terminal.
fn groups(mut program: clap::Command) -> String {
    // Adds the command `help`.
    program.build();
    let styles = program.get_styles();
    let header = styles.get_header();
    let literal = styles.get_literal();
    let names = GROUPS.iter().flat_map(|(_, names)| names.iter());
    let column = names.map(|name| name.len()).max().unwrap_or(0);
    let line = |name: &str| {
        let about = program.find_subcommand(name).and_then(clap::Command::get_about);
        let about = about.map(ToString::to_string).unwrap_or_default();
        let indent = column + 4;
        let text = output::wrapped(&about, output::width().saturating_sub(indent));
        format!(
            "  {literal}{name}{literal:#}{:1$}  {2}",
            "",
            column - name.len(),
            output::indented(&text, indent)
        )
    };
    let group = |(title, names): &(&str, &[&str])| {
        let lines: Vec<String> = names.iter().map(|name| line(name)).collect();
        format!("{header}{title}:{header:#}\n{}", lines.join("\n"))
    };
    GROUPS.iter().map(group).collect::<Vec<_>>().join("\n\n")
}

/// Returns a line for each group, for somebody who seeks a command.
fn group_lines() -> String {
    let line = |(title, names): &(&str, &[&str])| format!("{title}: {}", names.join(", "));
    GROUPS.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// Returns a tip for each key of the command whose name ends as an unknown flag.
fn key_lines(error: &clap::Error, arguments: &[OsString]) -> Vec<StyledStr> {
    let Some(ContextValue::String(flag)) = error.get(ContextKind::InvalidArg) else { return Vec::new() };
    let Some(word) = flag.strip_prefix("--") else { return Vec::new() };
    let command = arguments.get(1).map(|name| name.to_string_lossy()).unwrap_or_default();
    let is_same = |key: &str| key.rsplit_once('.').map_or(key, |(_, name)| name) == word;
    let named = keys().iter().filter(|key| is_same(&key.name) && flags::reads_key(&command, &key.name));
    named.map(|key| format!("{flag} is a key: -k {}=VALUE", key.name).into()).collect()
}

/// Prints help, or an error in the arguments of the program.
pub fn usage(error: &clap::Error, arguments: &[OsString]) {
    // The parser colors its errors, which quote arguments, so the arguments are escaped instead of
    // the error.
    let escaped = arguments.iter().map(|argument| escape::name(&argument.to_string_lossy()));
    match CommandLine::parse_words(escaped.map(OsString::from)) {
        // Help goes to stdout, which can be a closed pipe.
        Err(mut escaped) => {
            let keys = key_lines(&escaped, arguments);
            // The parser knows no keys, so its tip is another flag, or to pass the flag as a value.
            if !keys.is_empty() {
                escaped.remove(ContextKind::SuggestedArg);
                escaped.remove(ContextKind::Usage);
                escaped.insert(ContextKind::Suggested, ContextValue::StyledStrs(keys));
            }
            drop(escaped.print());
            if escaped.kind() == ErrorKind::InvalidSubcommand {
                output::message(&format!("The commands:\n{}", group_lines()));
            }
        }
        // An argument was not UTF-8.
        Ok(_) => output::message(error.render().to_string().trim_end()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Width at which clap wraps help.
    const WIDTH: usize = 100;

    fn check(command: &clap::Command) {
        let text = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        for line in text.lines() {
            assert!(line.chars().count() <= WIDTH, "help of {} wraps the line: {line}", command.get_name());
        }
        command.get_subcommands().for_each(check);
    }

    #[test]
    fn no_help_text_with_line_breaks_of_its_own_is_wrapped_again() {
        check(&declaration());
    }

    #[test]
    fn each_command_stands_in_one_group_in_the_order_of_the_help() {
        let mut program = CommandLine::command();
        program.build();
        let shown = program.get_subcommands().filter(|command| !command.is_hide_set());
        let commands: Vec<&str> = shown.map(clap::Command::get_name).filter(|name| *name != "help").collect();
        let grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        assert_eq!(grouped, commands);
    }

    #[test]
    fn the_help_lists_each_command_below_its_group() {
        let help = declaration().render_help().to_string();
        let mut rest = help.as_str();
        for (title, names) in GROUPS {
            for line in std::iter::once(format!("\n{title}:\n"))
                .chain(names.iter().map(|name| format!("\n  {name} ")))
            {
                rest = &rest[rest.find(&line).expect(&line) + line.len() - 1..];
            }
        }
        assert!(rest.contains("\nOptions:\n") && rest.contains("\nExamples:\n"), "{help}");
    }

    #[test]
    fn each_flag_stands_below_a_heading() {
        for command in declaration().get_subcommands() {
            for flag in command.get_arguments().filter(|flag| !flag.is_positional()) {
                assert!(flag.get_help_heading().is_some(), "{}: {}", command.get_name(), flag.get_id());
            }
        }
        let named = HEADINGS.iter().flat_map(|(_, names)| names.iter());
        for name in named {
            let has = |command: &clap::Command| command.get_arguments().any(|flag| flag.get_id() == name);
            assert!(declaration().get_subcommands().any(has), "no command has the flag {name}");
        }
    }

    /// Returns the number that `xtask/ratchet.txt` states for `name`.
    fn stated(name: &str) -> usize {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../xtask/ratchet.txt");
        let text = std::fs::read_to_string(path).unwrap();
        let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
        line.expect(name).parse().unwrap()
    }

    fn add_flags(command: &clap::Command, flags: &mut std::collections::BTreeSet<String>) {
        flags.extend(command.get_arguments().filter_map(|flag| flag.get_long()).map(str::to_string));
        command.get_subcommands().for_each(|command| add_flags(command, flags));
    }

    fn count_commands(command: &clap::Command) -> usize {
        let shown = || command.get_subcommands().filter(|command| !command.is_hide_set());
        if shown().next().is_none() { 1 } else { shown().map(count_commands).sum() }
    }

    /// A new command or flag raises a number in `xtask/ratchet.txt`, and its commit says why.
    #[test]
    fn commands_and_flags_are_as_many_as_the_ratchet_says() {
        let program = CommandLine::command();
        let mut flags = std::collections::BTreeSet::new();
        add_flags(&program, &mut flags);
        assert_eq!(count_commands(&program), stated("commands"));
        assert_eq!(flags.len(), stated("flags"), "{flags:?}");
    }

    #[test]
    fn a_command_has_at_most_16_flags() {
        for command in CommandLine::command().get_subcommands() {
            let mut flags = std::collections::BTreeSet::new();
            add_flags(command, &mut flags);
            flags.retain(|flag| !["help", "json", "verbose"].contains(&flag.as_str()));
            assert!(flags.len() <= 16, "{}: {flags:?}", command.get_name());
        }
    }
}
