//! Errors in the words of Python.

use std::error::Error;
use std::iter::successors;

use mishandle::results::{Choice, Command, Key};
use mishandle_cli::words::{Dialect, Shell, described, remedies, with_causes};

/// Python: arguments of functions.
struct Python;

impl Dialect for Python {
    fn key(&self, key: Key) -> String {
        key.word().replace('-', "_")
    }

    fn setting(&self, key: Key, value: &Choice) -> String {
        match value {
            // Parameters of patterns are arguments of their own.
            Choice::Of(name, value) if key == Key::PARAMETER => format!("{name}={}", literal(value)),
            value => format!("{}={}", self.key(key), literal(value)),
        }
    }

    fn command(&self, command: Command) -> String {
        match command {
            Command::Import => format!("{} in a shell", Shell.command(command)),
        }
    }
}

fn literal(value: &Choice) -> String {
    match value {
        Choice::On => "True".to_owned(),
        Choice::OneOf(words) => words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join("|"),
        Choice::Text(text) => quoted(text),
        Choice::Shape(shape) => (*shape).to_owned(),
        Choice::Of(name, value) => format!("{{{}: {}}}", quoted(name), literal(value)),
    }
}

/// Returns a text as Python writes it.
pub fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

/// Returns the text of an error with its causes, the outermost first, and what helps.
pub fn worded(error: &(dyn Error + 'static)) -> String {
    let causes = || successors(Some(error), |error| (*error).source());
    described(&with_causes(causes()), &remedies(causes()), &Python)
}
