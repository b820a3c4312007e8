//! The words of the command line.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::LazyLock;

use mishandle::results::{Choice, Command, Key, Recorded};
use mishandle_text::{shell_path, shell_quote};

use super::python::python_replay;
use super::{Dialect, Python};
use crate::command_line;
use crate::flags::reads_key;

/// The command line: flags, and keys of plans.
pub struct Shell;

impl Dialect for Shell {
    fn key(&self, key: Key) -> String {
        if has_flag(key) { format!("--{}", flag(key)) } else { format!("-k {}", key.name()) }
    }

    fn settings(&self, settings: &[(Key, Choice)]) -> String {
        let settings = settings.iter().map(|(key, value)| self.setting(*key, value));
        settings.collect::<Vec<_>>().join(" with ")
    }

    fn command(&self, command: &Command) -> String {
        match command {
            // Their systems are Python code.
            Command::Gymnasium { .. }
            | Command::ResumeComparison { is_python: true }
            | Command::ResumeEvaluation { is_python: true, .. }
            | Command::Replay { is_python: true, .. } => Python.command(command),
            command => format!("`{}`", shell_command(command)),
        }
    }
}

impl Shell {
    /// Returns a setting with its value.
    fn setting(&self, key: Key, value: &Choice) -> String {
        match value {
            Choice::On if has_flag(key) => self.key(key),
            value if has_flag(key) => format!("{} {}", self.key(key), word(value)),
            Choice::Of(name, value) => format!("-k {}.{}={}", key.name(), shell_quote(name), word(value)),
            value => format!("-k {}={}", key.name(), word(value)),
        }
    }
}

/// Returns a command of the shell, or a call of Python if the system is Python code.
pub fn shell_command(command: &Command) -> String {
    let text = match command {
        Command::Again { question, target, kept, changed } => {
            format!("{question} {}{}", shell_quote(target), arguments(kept.iter().chain(changed)))
        }
        Command::Compare(None) => "compare A B".to_owned(),
        Command::Compare(Some(runs)) => {
            format!("compare {}", runs.each_ref().map(|run| shell_path(run.as_ref())).join(" "))
        }
        Command::Explain(recorded) => format!("show {}", place(recorded)),
        Command::Falsify { target } => {
            format!("falsify {} -k falsify.keep-going=true", shell_quote(target))
        }
        Command::Harden { target, settings } => {
            format!("harden {}{} --out better.safetensors", shell_quote(target), arguments(settings))
        }
        Command::Import => "controller FILE --task TASK --out controller.safetensors".to_owned(),
        Command::Keep { run } => format!("regress --add {}", shell_path(run.as_ref())),
        Command::Init { model } => {
            let file = Path::new(model).with_extension("toml");
            let name = file.file_name().map(Path::new).unwrap_or(&file);
            format!("init --model {} --out {}", shell_path(model.as_ref()), shell_path(name))
        }
        Command::Monitor { log } => format!("monitor --formula FORMULA {}", shell_path(log.as_ref())),
        Command::List { what, is_long } => {
            format!("list {}{}", shell_quote(what), if *is_long { " --all" } else { "" })
        }
        Command::Regress { suite, controller, baseline } => {
            let [suite, controller] = [suite, controller].map(|text| shell_quote(text));
            let baseline = baseline.as_ref().map(|baseline| format!(" --baseline {}", shell_quote(baseline)));
            format!("regress {suite} --controller {controller}{}", baseline.unwrap_or_default())
        }
        Command::Report { run } => format!("report {} --open", shell_path(run.as_ref())),
        Command::Render(recorded) => format!("render {} --out failure.mp4", place(recorded)),
        Command::Replay { run, trial, simulation, is_python: false } => {
            format!("replay {} --trial {trial} --simulation {simulation}", shell_path(run.as_ref()))
        }
        Command::ReplayFile { file, moved } => {
            let moved = moved
                .iter()
                .map(|(key, path)| format!(" {}", Shell.setting(*key, &Choice::Text(path.clone()))));
            format!("replay {}{}", shell_path(file.as_ref()), moved.collect::<String>())
        }
        Command::Simulate { at } => {
            let values: Vec<String> = at.iter().map(|(axis, value)| format!("{axis}={value}")).collect();
            format!("simulate TARGET --at {}", shell_quote(&values.join(",")))
        }
        Command::VerifyEvidence => "evidence --verify . --allowed-signers ALLOWED_SIGNERS".to_owned(),
        Command::ResumeComparison { .. } => "compare --resume A B".to_owned(),
        Command::ResumeEvaluation { run, .. } => format!("evaluate --resume {}", shell_path(run.as_ref())),
        Command::Gymnasium { .. } => return super::python::python_call(command),
        Command::Replay { run, trial, simulation, is_python: true } => {
            return python_replay(run, *trial, *simulation);
        }
    };
    format!("mishandle {text}")
}

/// Returns settings, each after a space.
fn arguments<'a>(settings: impl IntoIterator<Item = &'a (Key, Choice)>) -> String {
    settings.into_iter().map(|(key, value)| format!(" {}", Shell.setting(*key, value))).collect()
}

/// Returns the arguments of a recorded simulation.
fn place(recorded: &Recorded) -> String {
    let Recorded { run, trial, simulation, controller } = recorded;
    let moved = controller
        .as_ref()
        .map(|path| format!(" {}", Shell.setting(Key::MOVED_CONTROLLER, &Choice::Text(path.clone()))));
    format!(
        "{} --trial {trial} --simulation {simulation}{}",
        shell_path(run.as_ref()),
        moved.unwrap_or_default()
    )
}

fn word(value: &Choice) -> String {
    match value {
        Choice::On => "true".to_owned(),
        Choice::OneOf(words) => words.join("|"),
        Choice::Text(text) => shell_quote(text),
        Choice::Number(number) => number.to_string(),
        Choice::Shape(shape) => (*shape).to_owned(),
        Choice::Range([low, high]) => format!("{low}:{high}"),
        Choice::Of(name, value) => format!("{}={}", shell_quote(name), word(value)),
    }
}

/// Returns the flag of a key, without its dashes.
fn flag(key: Key) -> &'static str {
    if key == Key::AXES { "axis" } else { key.word() }
}

/// Returns whether a command that reads the key has a flag for it. What no command reads as a key
/// is a flag anyway.
fn has_flag(key: Key) -> bool {
    let has_key = |command: &str| reads_key(command, key.name());
    let is_key = FLAGS.iter().any(|(command, _)| has_key(command));
    let is_flag = |(command, name): &(String, String)| name == flag(key) && (!is_key || has_key(command));
    // `--controller` and `--target` name the subject of a question, not a moved file.
    !key.name().starts_with("engine.") && FLAGS.iter().any(is_flag)
}

/// The flags of each command.
static FLAGS: LazyLock<BTreeSet<(String, String)>> = LazyLock::new(|| {
    fn add(flags: &mut BTreeSet<(String, String)>, name: &str, command: &clap::Command) {
        let long = command.get_arguments().filter_map(clap::Arg::get_long);
        flags.extend(long.map(|long| (name.to_owned(), long.to_owned())));
        command.get_subcommands().for_each(|command| add(flags, name, command));
    }
    let mut flags = BTreeSet::new();
    let program = command_line::declaration();
    program.get_subcommands().for_each(|command| add(&mut flags, command.get_name(), command));
    flags
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_of_a_remedy_is_a_flag_or_a_key_of_a_plan() {
        for key in Key::ALL {
            let is_key = || mishandle::plan::keys().iter().any(|known| known.name == key.name());
            assert!(has_flag(*key) || is_key(), "{key:?}");
        }
    }

    #[test]
    fn a_setting_without_a_flag_is_a_key_of_the_plan() {
        for (key, value, expected) in [
            (Key::ANY_BUILD, Choice::On, "-k engine.any-build=true"),
            (Key::MOVED_CONTROLLER, Choice::FILE, "-k engine.controller=FILE"),
            (Key::MOVED_TARGET, Choice::Text("a b.toml".to_owned()), "-k engine.target='a b.toml'"),
            (Key::CONTROLLER, Choice::FILE, "--controller FILE"),
            (Key::AXES, Choice::Of("x".to_owned(), Box::new(Choice::Range([0.0, 0.5]))), "--axis x=0:0.5"),
        ] {
            assert_eq!(Shell.setting(key, &value), expected);
        }
    }
}
