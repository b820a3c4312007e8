//! The words of the Python package.

use mishandle::results::{Choice, Command, Key};

use super::{Dialect, Shell};

/// Python: arguments of functions, of which `plan` has the tables of a plan.
pub struct Python;

/// Keys of tables that are arguments of their own.
const ARGUMENTS: [Key; 5] = [Key::BUDGET, Key::FORMULA, Key::PARAMETER, Key::RATE, Key::TRAINER];

/// Tables whose keys are names that the user chose.
const NAMED: [&str; 6] =
    ["axes", "requirements", "falsify.options", "formula.resolution", "log.topics", "risk.distributions"];

impl Dialect for Python {
    fn key(&self, key: Key) -> String {
        match key {
            Key::CONTROLLER => "policy".to_owned(),
            key if is_in_plan(key) => in_plan(key.name()),
            key => key.word().replace('-', "_"),
        }
    }

    fn settings(&self, settings: &[(Key, Choice)]) -> String {
        let (mut planned, arguments): (Vec<_>, Vec<_>) =
            settings.iter().partition(|(key, _)| is_in_plan(*key));
        let argument = |(key, value): &(Key, Choice)| match value {
            // Parameters of patterns are arguments of their own.
            Choice::Of(name, value) if *key == Key::PARAMETER => format!("{name}={}", literal(value)),
            value => format!("{}={}", self.key(*key), literal(value)),
        };
        let mut texts: Vec<String> = arguments.into_iter().map(argument).collect();
        let table = |(key, _): &&(Key, Choice)| key.name().split('.').next().unwrap_or_default();
        planned.sort_by_key(table);
        let tables = planned.chunk_by(|a, b| table(a) == table(b)).map(|settings| {
            let entry = |(key, value): &&(Key, Choice)| {
                format!("{}: {}", quoted(&key.word().replace('-', "_")), literal(value))
            };
            let entries: Vec<String> = settings.iter().map(entry).collect();
            format!("{}: {{{}}}", quoted(table(&settings[0])), entries.join(", "))
        });
        let tables: Vec<String> = tables.collect();
        if !tables.is_empty() {
            texts.push(format!("plan={{{}}}", tables.join(", ")));
        }
        texts.join(" with ")
    }

    fn command(&self, command: &Command) -> String {
        match command {
            Command::Again { question, changed, .. } if changed.is_empty() => {
                format!("`mishandle.{question}` with the same system")
            }
            Command::Again { question, changed, .. } => {
                format!("`mishandle.{question}` with the same system and {}", self.settings(changed))
            }
            Command::Gymnasium { environment, policy } => {
                let environment = environment.as_deref().map_or("ID".to_owned(), quoted);
                let load = |file: &String| format!("stable_baselines3.PPO.load({})", quoted(file));
                let policy = policy.as_ref().map_or("my_policy".to_owned(), load);
                format!("`mishandle.falsify(gymnasium.make({environment}), policy={policy})`")
            }
            Command::Compare(_) => "`mishandle.compare(A, B)`".to_owned(),
            Command::Falsify { target } => {
                let plan = "{\"falsify\": {\"keep_going\": True}}";
                format!("`mishandle.falsify({}, plan={plan})`", quoted(target))
            }
            Command::Harden { target, settings } => {
                let settings = settings.iter().map(|setting| self.settings(std::slice::from_ref(setting)));
                let settings: String = settings.map(|setting| format!(", {setting}")).collect();
                format!("`mishandle.harden({}{settings}, out=\"better.safetensors\")`", quoted(target))
            }
            Command::Keep { .. } => "`result.export(\"regressions\")`".to_owned(),
            Command::Report { .. } => "`result.report(\"report.html\")`".to_owned(),
            Command::ResumeComparison { .. } => {
                "the same call of `mishandle.compare_versions` with `resume=True`".to_owned()
            }
            Command::ResumeEvaluation { .. } => {
                "the same call of `mishandle.evaluate` with `resume=True`".to_owned()
            }
            Command::Replay { run, trial, simulation, .. } => {
                format!("`{}`", python_replay(run, *trial, *simulation))
            }
            Command::Simulate { at } => {
                let number = |value: &str| value.parse::<f64>().is_ok();
                let text = |value: &str| if number(value) { value.to_owned() } else { quoted(value) };
                let values: Vec<String> =
                    at.iter().map(|(axis, value)| format!("{}: {}", quoted(axis), text(value))).collect();
                format!("`mishandle.simulate` with `at={{{}}}`", values.join(", "))
            }
            command => format!("{} in a shell", Shell.command(command)),
        }
    }
}

fn is_in_plan(key: Key) -> bool {
    key.name().contains('.') && !ARGUMENTS.contains(&key)
}

/// Returns what to ask next as a line of its own, without quotes.
pub fn python_call(command: &Command) -> String {
    Python.command(command).replace('`', "")
}

/// Returns a key as it stands in the argument `plan`, such as `plan["falsify"]["batch"]`.
pub fn in_plan(key: &str) -> String {
    let parts: String = key_parts(key).iter().map(|part| format!("[{}]", quoted(part))).collect();
    format!("plan{parts}")
}

/// Returns the name of the argument that sets a key.
pub fn argument(key: &str) -> String {
    match &key_parts(key)[..] {
        [table, name] if NAMED.contains(&table.as_str()) => format!("{table}[{}]", quoted(name)),
        parts => parts.last().cloned().unwrap_or_default(),
    }
}

/// Returns the parts of a key in Python.
fn key_parts(key: &str) -> Vec<String> {
    let named = NAMED.iter().find_map(|table| Some((*table, key.strip_prefix(table)?.strip_prefix('.')?)));
    let (table, name) = named.map_or((key, None), |(table, name)| (table, Some(name.to_string())));
    table.split('.').map(|part| part.replace('-', "_")).chain(name).collect()
}

/// Returns the call that replays a simulation of a system that is Python code.
pub fn python_replay(run: &str, trial: u32, number: u32) -> String {
    format!("mishandle.replay({}, system, formula, space, trial={trial}, number={number})", quoted(run))
}

fn literal(value: &Choice) -> String {
    match value {
        Choice::On => "True".to_owned(),
        Choice::OneOf(words) => quoted(&words.join("|")),
        Choice::Text(text) => quoted(text),
        Choice::Number(number) => number.to_string(),
        Choice::Shape(shape) => (*shape).to_owned(),
        Choice::Range([low, high]) => format!("({low}, {high})"),
        Choice::Of(name, value) => format!("{{{}: {}}}", quoted(name), literal(value)),
    }
}

/// Returns a text as Python writes it.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => quoted.push_str(&format!("\\U{:08x}", u32::from(c))),
            c => quoted.push(c),
        }
    }
    quoted + "\""
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_of_a_table_stands_in_the_plan() {
        const HOW: Choice = Choice::OneOf(&["hold", "linear"]);
        let step = || Choice::Of("p".to_owned(), Box::new(Choice::Shape("STEP")));
        for (settings, expected) in [
            (vec![(Key::RESUME, Choice::On)], "resume=True"),
            (vec![(Key::RATE, Choice::Shape("0.95"))], "rate=0.95"),
            (vec![(Key::PARAMETER, step())], "p=STEP"),
            (vec![(Key::RESOLUTION, step())], r#"plan={"formula": {"resolution": {"p": STEP}}}"#),
            (vec![(Key::ANY_BUILD, Choice::On)], r#"plan={"engine": {"any_build": True}}"#),
            (
                vec![(Key::LOG_RESAMPLE, HOW), (Key::LOG_PERIOD, Choice::SECONDS)],
                r#"plan={"log": {"resample": "hold|linear", "period": SECONDS}}"#,
            ),
            (
                vec![(Key::LOG_SORT, Choice::On), (Key::OUT, Choice::FILE), (Key::ANY_BUILD, Choice::On)],
                r#"out=FILE with plan={"engine": {"any_build": True}, "log": {"sort": True}}"#,
            ),
        ] {
            assert_eq!(Python.settings(&settings), expected);
        }
        assert_eq!(Python.key(Key::LOG_TIME_UNIT), r#"plan["log"]["time_unit"]"#);
        assert_eq!(Python.key(Key::ACTION_NOISE), "action_noise");
    }

    #[test]
    fn python_restores_the_quoted_text() {
        for text in ["a.sqlite", "two words", "it's \"b\"", "a\nb\u{1b}", "C:\\x\\n", "größe", "{0}"] {
            let script = format!("import sys; sys.stdout.write({})", quoted(text));
            let output =
                std::process::Command::new("python3").args(["-X", "utf8", "-c", &script]).output().unwrap();
            assert_eq!(String::from_utf8(output.stdout).unwrap(), text, "{script}");
        }
    }
}
