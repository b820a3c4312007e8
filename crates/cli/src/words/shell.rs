//! The words of the command line.

use mishandle::plan::keys;
use mishandle::results::{Choice, Command, Key};
use mishandle_text::shell_quote;

use super::Dialect;

/// The command line: keys of plans, and flags of settings that no plan has.
pub struct Shell;

impl Dialect for Shell {
    fn key(&self, key: Key) -> String {
        if is_planned(key) { format!("-k {}", key.name()) } else { format!("--{}", key.word()) }
    }

    fn setting(&self, key: Key, value: &Choice) -> String {
        let before = self.key(key);
        match value {
            Choice::On if !is_planned(key) => before,
            Choice::Of(name, value) if is_planned(key) => {
                format!("{before}.{}={}", shell_quote(name), word(value))
            }
            value if is_planned(key) => format!("{before}={}", word(value)),
            value => format!("{before} {}", word(value)),
        }
    }

    fn command(&self, command: Command) -> String {
        match command {
            Command::Import => {
                "`mishandle controller FILE --task TASK --out controller.safetensors`".to_owned()
            }
        }
    }
}

/// Returns whether a plan has the setting.
fn is_planned(key: Key) -> bool {
    keys().iter().any(|known| known.name == key.name())
}

fn word(value: &Choice) -> String {
    match value {
        Choice::On => "true".to_owned(),
        Choice::OneOf(words) => words.join("|"),
        Choice::Text(text) => shell_quote(text),
        Choice::Shape(shape) => (*shape).to_owned(),
        Choice::Of(name, value) => format!("{}={}", shell_quote(name), word(value)),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::command_line;

    #[test]
    fn every_flag_of_a_remedy_exists_and_every_other_setting_is_a_key() {
        fn add(command: &clap::Command, flags: &mut BTreeSet<String>) {
            flags
                .extend(command.get_arguments().filter_map(|found| Some(format!("--{}", found.get_long()?))));
            command.get_subcommands().for_each(|command| add(command, flags));
        }
        let mut flags = BTreeSet::new();
        add(&command_line::declaration(), &mut flags);
        for key in Key::ALL {
            assert!(is_planned(*key) || flags.contains(&Shell.key(*key)), "{key:?}");
        }
    }
}
