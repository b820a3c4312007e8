//! Reads plans from TOML and reports mistakes with their line and with what is allowed.

use std::borrow::Cow;
use std::collections::BTreeSet;

use mishandle_falsification::Margin;
use mishandle_files::limits;
use mishandle_search::OptionValue;
use mishandle_store::RunKind;
use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

use super::keys::{AXES, DISTRIBUTIONS, Key, OPTIONS, RELATIONS, REQUIREMENTS, find, keys, plan_keys, reads};
use super::settings::OF_PERSONS;
use super::{FORMAT, Plan, Values};
use crate::error::{MishandleError, invalid, problem};
use crate::plan::{AxisSetting, GuardPlan};

/// Largest number of characters of a value that an error repeats.
const SHOWN: usize = 60;

/// Device of a screening that does not take place.
const NO_DEVICE: &str = "none";

/// Table of the guard, with a period.
const GUARD: &str = "guard.";

/// Keys of a relation.
const RELATION_KEYS: [&str; 2] = ["change", "holds"];

/// Allowed values of a relation.
const RELATION: &str = "a table, such as { change = { ball_x = \"+0.02\" }, holds = \"same-verdict\" }";

/// Place of the keys of a relation.
const IN_RELATION: &str = "in the table of a relation with a name, as [metamorphic.relations.NAME]";

/// Allowed values of the changes of a relation.
const CHANGES: &str = "a table of changes by axis, such as { ball_x = \"+0.02\" }";

/// Allowed values of the change of an axis.
pub(super) const CHANGE: &str = "a text in quotes: an offset such as \"+0.02\" or \"-0.02\", a factor such as \"*0.8\" or \"-20%\", \
                      a value such as \"=0.3\", or a category";

/// Allowed values of what must hold.
pub(super) const HOLDS: &str = "a text in quotes, such as \"same-verdict\" or \"not-worse:0.05\"";

/// Allowed settings of an axis.
const AXIS: &str =
    "a number, a list of two numbers, an interval such as \"[0, 1)\", or the name of a category in quotes";

/// Allowed values of a search option, whose type depends on the search.
pub(super) const OPTION: &str =
    "a number, true or false, a string, a list of numbers, or a list of lists of numbers";

/// Returns whether a key belongs into the table of a relation.
fn is_relation_key(key: &Spanned<Cow<'_, str>>) -> bool {
    RELATION_KEYS.contains(&&**key.get_ref())
}

/// Reads a plan.
pub(super) fn read(text: &str) -> Result<Plan, MishandleError> {
    let stated = parse(text, Values::One, plan_keys())?;
    let has_space = stated.get_ref().contains_key("space");
    let mut plan =
        Plan::deserialize(toml::Deserializer::from(stated)).map_err(|error| not_toml(text, &error))?;
    if !has_space && plan.kind() == RunKind::Margin {
        plan.space = Margin::SPACE.to_string();
    }
    if plan.screening.as_ref().is_some_and(|screening| screening.device == NO_DEVICE) {
        plan.screening = None;
    }
    Ok(plan)
}

/// Reads the keys of the table `[guard]` from a text of their own.
pub(super) fn read_guard(text: &str) -> Result<GuardPlan, MishandleError> {
    let stated = DeTable::parse(text).map_err(|error| not_toml(text, &error))?;
    Reader { text, values: Values::One, known: plan_keys() }.check(GUARD, stated.get_ref())?;
    GuardPlan::deserialize(toml::Deserializer::from(stated)).map_err(|error| not_toml(text, &error))
}

/// Reads a plan and settings as a table whose keys and types are checked.
///
/// # Errors
/// As for [`Plan::from_toml`].
pub fn table(text: &str, values: Values) -> Result<toml::Table, MishandleError> {
    let stated = parse(text, values, keys())?;
    let table =
        toml::Table::deserialize(toml::Deserializer::from(stated)).map_err(|error| not_toml(text, &error))?;
    let has = |key: &str| {
        key.split_once('.')
            .is_some_and(|(within, key)| table.get(within).is_some_and(|within| within.get(key).is_some()))
    };
    if let Some(key) = OF_PERSONS.into_iter().find(|key| has(key)) {
        let expected = "typed by a person, because it weakens checks or starts a program".to_string();
        return Err(MishandleError::KeyValue {
            line: None,
            key: key.to_string(),
            found: "in a file".to_string(),
            expected,
        });
    }
    Ok(table)
}

/// Returns whether a key of a plan may have a list of values in a campaign.
pub(super) fn may_be_list(name: &str) -> bool {
    // The other values are tables or lists already.
    let others = ["format", "screening.device", AXES, REQUIREMENTS, OPTIONS, DISTRIBUTIONS, RELATIONS];
    !others.contains(&name)
        && plan_keys().iter().any(|key| key.name == name)
        && !["harden.searches", "harden.allow", "compare.robustness-bounds"].contains(&name)
}

fn not_toml(text: &str, error: &toml::de::Error) -> MishandleError {
    let line = line_at(text, error.span().map_or(0, |span| span.start));
    let found = shortened(text.lines().nth(line - 1).unwrap_or_default());
    MishandleError::PlanSyntax { line, found, message: error.message().replace('\n', ", ") }
}

/// Parses a plan and checks its keys and the types of their values.
fn parse<'t>(
    text: &'t str,
    values: Values,
    known: &'static [Key],
) -> Result<Spanned<DeTable<'t>>, MishandleError> {
    // Also for the plan in a run file.
    if text.len() as u64 > limits::PLAN {
        let what = "the size of the plan in bytes";
        let expected = "at most 131072";
        return Err(invalid(what, text.len(), expected));
    }
    let stated = DeTable::parse(text).map_err(|error| not_toml(text, &error))?;
    let reader = Reader { text, values, known };
    // Checked first: another format can have unknown keys, and the format is the more useful error.
    if let Some((key, value)) = stated.get_ref().get_key_value("format") {
        match u32::deserialize(ValueDeserializer::from(value.clone())) {
            Ok(found) if found > FORMAT => return Err(other_format(found, "use a newer Mishandle")),
            Ok(FORMAT) => {}
            Ok(found @ 1..) => {
                return Err(other_format(found, "write it again with the keys of docs/reference/plans.md"));
            }
            _ => {
                return Err(reader.wrong("format", key, value, find("format").map_or("", |key| key.allowed)));
            }
        }
    }
    reader.check("", stated.get_ref())?;
    Ok(stated)
}

fn other_format(found: u32, way_out: &str) -> MishandleError {
    problem(format!("the plan has format {found}, this program reads format {FORMAT}: {way_out}"))
}

struct Reader<'t> {
    text: &'t str,
    values: Values,
    /// The keys that the text may have.
    known: &'static [Key],
}

impl Reader<'_> {
    /// Checks the keys of a table and the types of their values; `within` is the name of the table
    /// with a period at its end.
    fn check(&self, within: &str, table: &DeTable<'_>) -> Result<(), MishandleError> {
        for (key, value) in table {
            let name = format!("{within}{}", key.get_ref());
            let as_table = format!("{name}.");
            let known = self.known.iter().find(|known| known.name == name);
            match (known, value.get_ref()) {
                (Some(known), DeValue::Table(options)) if known.name == OPTIONS => {
                    self.check_options(options)?;
                }
                (Some(known), DeValue::Table(axes)) if known.name == AXES => {
                    for (key, value) in axes {
                        if !reads::<AxisSetting>(value) {
                            let name = format!("{AXES}.{}", key.get_ref());
                            return Err(self.wrong(&name, key, value, AXIS));
                        }
                    }
                }
                (Some(known), DeValue::Table(relations)) if known.name == RELATIONS => {
                    self.check_relations(relations)?;
                }
                (Some(known), _) if (known.reads)(value) => {}
                (Some(known), DeValue::Array(items))
                    if self.values == Values::Lists && may_be_list(&known.name) =>
                {
                    self.check_list(&name, key, value, items, known)?;
                }
                (Some(known), _) => return Err(self.wrong(&name, key, value, known.allowed)),
                (None, _) if within == "metamorphic." && is_relation_key(key) => {
                    return Err(self.wrong(&name, key, value, IN_RELATION));
                }
                (None, _) if !self.known.iter().any(|known| known.name.starts_with(&as_table)) => {
                    let known = self.known.iter().map(|key| key.name.as_str()).collect();
                    return Err(MishandleError::UnknownKey { line: Some(self.line(key)), key: name, known });
                }
                (None, DeValue::Table(table)) => self.check(&as_table, table)?,
                (None, _) => {
                    return Err(self.wrong(&name, key, value, &format!("a table, as [{name}]")));
                }
            }
        }
        Ok(())
    }

    /// Checks a list of values: each of the right type, none twice.
    fn check_list(
        &self,
        name: &str,
        key: &Spanned<impl Sized>,
        list: &Spanned<DeValue<'_>>,
        items: &[Spanned<DeValue<'_>>],
        known: &Key,
    ) -> Result<(), MishandleError> {
        if items.is_empty() {
            return Err(self.wrong(name, key, list, &format!("{}, or a list of such values", known.allowed)));
        }
        for (index, item) in items.iter().enumerate() {
            if !(known.reads)(item) {
                return Err(self.wrong(name, key, item, known.allowed));
            }
            let text = |item: &Spanned<DeValue<'_>>| &self.text[item.span()];
            if items[..index].iter().any(|earlier| text(earlier) == text(item)) {
                return Err(self.wrong(name, key, item, "in the list once"));
            }
        }
        Ok(())
    }

    fn check_relations(&self, relations: &DeTable<'_>) -> Result<(), MishandleError> {
        for (key, value) in relations {
            let name = format!("{RELATIONS}.{}", key.get_ref());
            let relation = match value.get_ref() {
                // A relation may have the name `change`.
                DeValue::Table(relation) if !is_relation_key(key) || relation.keys().any(is_relation_key) => {
                    relation
                }
                _ if is_relation_key(key) => return Err(self.wrong(&name, key, value, IN_RELATION)),
                _ => return Err(self.wrong(&name, key, value, RELATION)),
            };
            self.check_relation(&name, relation)?;
        }
        Ok(())
    }

    /// Checks the relation with this name, the names of its tables included.
    fn check_relation(&self, relation: &str, table: &DeTable<'_>) -> Result<(), MishandleError> {
        for (key, value) in table {
            let name = format!("{relation}.{}", key.get_ref());
            match (&**key.get_ref(), value.get_ref()) {
                ("change", DeValue::Table(changes)) => {
                    if let Some((axis, value)) = changes.iter().find(|(_, value)| !reads::<String>(value)) {
                        let name = format!("{name}.{}", axis.get_ref());
                        return Err(self.wrong(&name, axis, value, CHANGE));
                    }
                }
                ("change", _) => return Err(self.wrong(&name, key, value, CHANGES)),
                ("holds", _) if reads::<String>(value) => {}
                ("holds", _) => return Err(self.wrong(&name, key, value, HOLDS)),
                (unknown, _) => {
                    let line = Some(self.line(key));
                    let known = RELATION_KEYS.into();
                    return Err(MishandleError::UnknownKey { line, key: unknown.to_string(), known });
                }
            }
        }
        Ok(())
    }

    fn check_options(&self, options: &DeTable<'_>) -> Result<(), MishandleError> {
        let mut earlier = BTreeSet::new();
        for (key, value) in options {
            let name = format!("{OPTIONS}.{}", key.get_ref());
            // `max_iterations` and `max-iterations` are the same option.
            if !earlier.insert(key.get_ref().replace('_', "-")) {
                return Err(self.wrong(&name, key, value, "left out: the option is set twice"));
            }
            if !reads::<OptionValue>(value) {
                return Err(self.wrong(&name, key, value, OPTION));
            }
        }
        Ok(())
    }

    fn wrong(
        &self,
        name: &str,
        key: &Spanned<impl Sized>,
        value: &Spanned<DeValue<'_>>,
        expected: &str,
    ) -> MishandleError {
        let found = match value.get_ref() {
            // The entries of one table may be spread over the text, so it has no single span.
            DeValue::Table(_) => "a table".to_string(),
            _ => shortened(&self.text[value.span()]),
        };
        MishandleError::KeyValue {
            line: Some(self.line(key)),
            key: name.to_string(),
            found,
            expected: expected.to_string(),
        }
    }

    fn line(&self, key: &Spanned<impl Sized>) -> usize {
        line_at(self.text, key.span().start)
    }
}

/// Returns a value on one line, and only the start of a long one.
pub(super) fn shortened(value: &str) -> String {
    let line = value.replace('\n', " ");
    match line.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}...", &line[..end]),
        None => line,
    }
}

/// Returns the line of a byte offset, counted from 1.
fn line_at(text: &str, offset: usize) -> usize {
    1 + text.as_bytes()[..offset.min(text.len())].iter().filter(|byte| **byte == b'\n').count()
}

#[cfg(test)]
mod tests {
    use mishandle_results::Remedy;

    use super::*;

    #[track_caller]
    fn check(text: &str, message: &str) {
        let error = Plan::from_toml(text).unwrap_err().to_string();
        assert_eq!(error, message, "{text}");
    }

    #[test]
    fn a_plan_of_a_run_file_is_read_within_the_limit_of_plan_files() {
        let text = format!("target = \"toy/needle\"\n#{}", "#".repeat(limits::PLAN as usize));
        assert!(read(&text).unwrap_err().to_string().contains("at most 131072"));
        assert!(read(&text[..limits::PLAN as usize]).is_ok());
    }

    #[test]
    fn a_value_of_the_wrong_type_is_an_error_with_its_line_and_what_is_allowed() {
        for (line, found, key, expected) in [
            ("target = 1", "1", "target", "a string, such as \"ball-balancing\""),
            ("stochastic = \"yes\"", "\"yes\"", "stochastic", "true or false"),
            ("action-noise = \"x\"", "\"x\"", "action-noise", "a number from 0 to 10"),
            ("evaluate = 5", "5", "evaluate", "a table, as [evaluate]"),
            ("space = { a = 1 }", "a table", "space", "a string, such as \"starts\""),
            ("format = -1", "-1", "format", "2"),
            ("format = 0", "0", "format", "2"),
            ("[evaluate]\nepisodes = \"x\"", "\"x\"", "evaluate.episodes", "an integer from 1 to 1000000000"),
            ("[evaluate]\nepisodes = -1", "-1", "evaluate.episodes", "an integer from 1 to 1000000000"),
            ("[evaluate]\nbox = \"all\"", "\"all\"", "evaluate.box", "\"whole\" or \"reachable\""),
            ("[falsify]\noptions = 1", "1", "falsify.options", "a table, as [falsify.options]"),
            ("[falsify.options]\nxatol = 1979-05-27", "1979-05-27", "falsify.options.xatol", OPTION),
        ] {
            let number = 1 + line.lines().count();
            let message =
                format!("line {number} of the plan: the key `{key}` is {found}; it must be {expected}");
            check(&format!("# A comment.\n{line}\n"), &message);
        }
        let seeds = "an integer from 0 to 18446744073709551615; above 2^63 - 1 as a string";
        for seed in ["\"abc\"", "-1", "1.5", "99999999999999999999", "\"99999999999999999999\"", "true"] {
            let message = format!("line 1 of the plan: the key `seed` is {seed}; it must be {seeds}");
            check(&format!("seed = {seed}"), &message);
        }
    }

    #[test]
    fn a_mistake_in_a_relation_is_an_error_with_its_key_and_what_is_allowed() {
        for (lines, key, found, expected) in [
            ("relations.r = 'same-verdict'", "relations.r", "'same-verdict'", RELATION),
            ("relations.r.change.x = 0.02", "relations.r.change.x", "0.02", CHANGE),
            ("relations.r = { change = { x = ['+1'] } }", "relations.r.change.x", "['+1']", CHANGE),
            ("relations.r.change = '+0.02'", "relations.r.change", "'+0.02'", CHANGES),
            ("relations.r.holds = 0.05", "relations.r.holds", "0.05", HOLDS),
            ("relations.change = { x = '+1' }", "relations.change", "a table", IN_RELATION),
            ("relations.holds = 'not-worse'", "relations.holds", "'not-worse'", IN_RELATION),
            ("change = { x = '+1' }", "change", "a table", IN_RELATION),
            ("holds = 'not-worse'", "holds", "'not-worse'", IN_RELATION),
        ] {
            let message =
                format!("line 2 of the plan: the key `metamorphic.{key}` is {found}; it must be {expected}");
            check(&format!("[metamorphic]\n{lines}\n"), &message);
        }
        let named = "target = 'a'\n[metamorphic.relations.change]\nchange = { x = '+1' }\n";
        assert!(Plan::from_toml(named).unwrap().metamorphic.unwrap().relations.contains_key("change"));
    }

    #[test]
    fn an_unknown_key_is_an_error_that_names_the_known_and_the_nearest_key() {
        for (text, key, known, hint) in [
            (
                "[evaluate]\nepisods = 1",
                "evaluate.episods",
                "episodes, until, rate, box, corners, control, batch",
                "did you mean `evaluate.episodes`?",
            ),
            (
                "\nepisodes = 1",
                "episodes",
                "format, target",
                "did you mean `evaluate.episodes` or `harden.episodes`?",
            ),
            (
                "\nbatch = 1",
                "batch",
                "seed, careful, max-without-verdict, requirements, guard, evaluate, compare, falsify",
                "did you mean `evaluate.batch` or `falsify.batch` or `metamorphic.batch` or `risk.batch`?",
            ),
            (
                "\naction_noise = 1",
                "action_noise",
                "action-noise, observation-noise",
                "did you mean `action-noise`?",
            ),
            ("\n[evalute]\n", "evalute", "evaluate, compare, falsify", "did you mean `evaluate`?"),
        ] {
            let error = Plan::from_toml(text).unwrap_err();
            let message = error.to_string();
            assert!(
                message
                    .starts_with(&format!("line 2 of the plan: there is no key `{key}`; known keys are: ")),
                "{message}"
            );
            assert!(message.contains(known), "{message}");
            assert_eq!(error.remedies(), [Remedy::Hint(hint.to_string())], "{text}");
        }
    }

    #[test]
    fn text_that_is_not_toml_is_an_error_with_its_line() {
        check(
            "seed = 1\ntarget : toy",
            "line 2 of the plan, `target : toy`, is not valid TOML: key with no value, expected `=`",
        );
    }

    #[test]
    fn a_long_value_is_repeated_only_in_part() {
        let long = "ä".repeat(50_000);
        let error = Plan::from_toml(&format!("seed = \"{long}\"")).unwrap_err().to_string();
        assert!(error.contains("is \"ääää") && error.chars().count() < 300, "{error}");
    }

    #[test]
    fn the_messages_name_the_ranges_that_are_checked() {
        for (name, range) in [
            ("evaluate.episodes", Plan::EPISODES),
            ("evaluate.batch", Plan::BATCH),
            ("falsify.trials", Plan::TRIALS),
            ("falsify.budget", Plan::BUDGET),
            ("falsify.batch", Plan::BATCH),
        ] {
            let key = find(name).unwrap();
            assert_eq!(
                key.allowed,
                format!("an integer from {} to {}", range.start(), range.end()),
                "{name}"
            );
        }
        assert_eq!(mishandle_rollout::Noise::MAX_STD, 10.0);
    }
}
