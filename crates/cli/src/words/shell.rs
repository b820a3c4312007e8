//! The words of the command line.

use mishandle::results::{Choice, Command, Key};
use mishandle_text::shell_quote;

use super::Dialect;

/// The command line: keys and flags.
pub struct Shell;

impl Dialect for Shell {
    fn key(&self, key: Key) -> String {
        if is_key(key) { format!("-k {}", key.name()) } else { format!("--{}", key.word()) }
    }

    fn setting(&self, key: Key, value: &Choice) -> String {
        match value {
            value if is_key(key) => format!("{}={}", self.key(key), word(value)),
            Choice::On => self.key(key),
            value => format!("{} {}", self.key(key), word(value)),
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

/// Returns whether `-k` sets a key. The others have a flag.
fn is_key(key: Key) -> bool {
    mishandle::plan::keys().iter().any(|known| known.name == key.name())
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
    fn every_flag_of_a_remedy_exists() {
        fn add(command: &clap::Command, flags: &mut BTreeSet<String>) {
            flags
                .extend(command.get_arguments().filter_map(|found| Some(format!("--{}", found.get_long()?))));
            command.get_subcommands().for_each(|command| add(command, flags));
        }
        let mut flags = BTreeSet::new();
        add(&command_line::declaration(), &mut flags);
        for key in Key::ALL.iter().filter(|key| !is_key(**key)) {
            assert!(flags.contains(&Shell.key(*key)), "{key:?}");
        }
    }
}
