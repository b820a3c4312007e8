//! Errors and their remedies in the words of a front.

mod error;
mod python;
mod shell;

use mishandle::results::{Choice, Command, Key, Remedy};

pub use error::{remedies, with_causes};
pub use python::{Python, argument, in_plan, python_call};
pub use shell::{Shell, shell_command};

/// The language of a front.
pub trait Dialect {
    /// Returns the name of a setting.
    fn key(&self, key: Key) -> String;

    /// Returns settings with their values, all of them together.
    fn settings(&self, settings: &[(Key, Choice)]) -> String;

    /// Returns something else to ask, in quotes.
    fn command(&self, command: &Command) -> String;
}

/// Returns the text of an error with what helps, without its [`hint`].
pub fn described(text: &str, remedies: &[Remedy], dialect: &dyn Dialect) -> String {
    let mut described = text.to_owned();
    let mut last_verb = "";
    let phrases = remedies.iter().filter_map(|remedy| phrase(remedy, dialect));
    for (index, (verb, phrase, is_conditional)) in phrases.enumerate() {
        described += match (index, verb == last_verb && !is_conditional) {
            (0, _) => "; ",
            (_, true) => " or ",
            (_, false) => ", or ",
        };
        if verb != last_verb {
            described += verb;
        }
        described += &phrase;
        last_verb = verb;
    }
    described
}

/// Returns the sentence that guesses what was meant.
pub fn hint(remedies: &[Remedy]) -> Option<&str> {
    remedies.iter().find_map(|remedy| match remedy {
        Remedy::Hint(sentence) => Some(sentence.as_str()),
        _ => None,
    })
}

/// Returns the verb of a remedy, the rest of the sentence, and whether it has a condition; `None`
/// of a hint.
fn phrase(remedy: &Remedy, dialect: &dyn Dialect) -> Option<(&'static str, String, bool)> {
    Some(match remedy {
        Remedy::Set(settings) => ("pass ", dialect.settings(settings), false),
        Remedy::Unset(key) => ("leave out ", dialect.key(*key), false),
        Remedy::Another(key) => ("choose another ", dialect.key(*key), false),
        Remedy::Run(command @ Command::List { .. }) => ("see ", dialect.command(command), false),
        Remedy::Run(command) => ("run ", dialect.command(command), false),
        Remedy::Advice(words) => ("", (*words).to_owned(), false),
        Remedy::Hint(_) => return None,
        Remedy::If(condition, remedy) => {
            let (verb, phrase, _) = phrase(remedy, dialect)?;
            (verb, format!("{phrase} if {condition}"), true)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alternatives_are_one_sentence() {
        const HOW: Choice = Choice::OneOf(&["hold", "linear"]);
        let resample = || Remedy::set(Key::LOG_RESAMPLE, HOW);
        let period = || Remedy::set(Key::LOG_PERIOD, Choice::SECONDS);
        for (remedies, expected) in [
            (vec![], "no"),
            (vec![Remedy::set(Key::LOG_SORT, Choice::On)], "no; pass -k log.sort=true"),
            (
                vec![resample(), Remedy::set(Key::LOG_DENSE, HOW), period().when("its times are rounded")],
                "no; pass -k log.resample=hold|linear or -k log.dense=hold|linear, or -k log.period=SECONDS if its times are rounded",
            ),
            (
                vec![Remedy::Unset(Key::LOG_PERIOD), resample()],
                "no; leave out -k log.period, or pass -k log.resample=hold|linear",
            ),
            (
                vec![Remedy::Set(vec![(Key::LOG_RESAMPLE, HOW), (Key::LOG_PERIOD, Choice::SECONDS)])],
                "no; pass -k log.resample=hold|linear with -k log.period=SECONDS",
            ),
            (
                vec![Remedy::set(
                    Key::PARAMETER,
                    Choice::Of("p".to_owned(), Box::new(Choice::Text("x >= 1".to_owned()))),
                )],
                "no; pass --parameter p='x >= 1'",
            ),
            (
                vec![
                    Remedy::set(Key::LOG_TIME, Choice::Text("the stamp".to_owned())).when("it has the times"),
                ],
                "no; pass -k log.time='the stamp' if it has the times",
            ),
            (
                vec![Remedy::Advice("wait"), Remedy::Another(Key::OUT), Remedy::Hint("x".to_owned())],
                "no; wait, or choose another --out",
            ),
            (
                vec![
                    Remedy::Another(Key::OUT),
                    Remedy::set(Key::RESUME, Choice::On),
                    Remedy::Run(Command::Import),
                ],
                "no; choose another --out, or pass --resume, or run `mishandle controller FILE --task TASK --out \
                 controller.safetensors`",
            ),
        ] {
            assert_eq!(described("no", &remedies, &Shell), expected);
        }
    }
}
