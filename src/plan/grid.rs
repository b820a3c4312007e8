//! Grids of plans: a campaign file is a plan in which keys may have lists of values.

use std::collections::BTreeSet;

use mishandle_search::find_search;
use mishandle_store::RunKind;
use sha2::{Digest, Sha256};
use toml::{Table, Value};

use super::keys::keys;
use super::read::{may_be_list, table};
use super::{Plan, Settings, Values};
use crate::error::{MishandleError, invalid};

/// Table of a hardening, which is not a question of a run file.
const HARDEN: &str = "harden";

/// Largest number of runs of a campaign.
const MAX_RUNS: usize = 10_000;

/// Longest part of a name that comes from one value, in characters.
const MAX_PART: usize = 32;

/// One run of a campaign: one question about one target.
#[derive(Clone, Debug, PartialEq)]
pub struct GridRun {
    /// Name of its run file without extension: its values of the keys that have lists.
    pub name: String,
    /// Its plan, with the table of one question.
    pub plan: Plan,
}

/// Reads a campaign file: a plan in which most keys may have a list of values. Returns a run for
/// each combination of the values, the last key of the file format varying fastest.
///
/// A file with several of the tables `[evaluate]`, `[falsify]`, `[margin]`, `[metamorphic]`,
/// `[risk]` and `[harden]` gives a run of each per combination of the other values. A search gets
/// those options of `[falsify.options]` that it has.
///
/// # Errors
/// The errors of [`Plan::from_toml`]; if there is no target, no question, an option that no search
/// has, or more than 10,000 runs.
///
/// # Example
/// ```
/// let text = "target = 'ball-balancing'\ncontroller = ['ppo', 'sac']\n[falsify]\nsearch = ['random', 'nelder-mead']\n";
/// let runs = mishandle::plan::read_grid(text)?;
/// let names: Vec<&str> = runs.iter().map(|run| run.name.as_str()).collect();
/// assert_eq!(names, ["ppo_random", "ppo_nelder-mead", "sac_random", "sac_nelder-mead"]);
/// # Ok::<(), mishandle::MishandleError>(())
/// ```
pub fn read_grid(text: &str) -> Result<Vec<GridRun>, MishandleError> {
    grid(&table(text, Values::Lists)?)
}

/// As [`read_grid`], from the table of the plan.
///
/// # Errors
/// As [`read_grid`].
pub fn grid(table: &Table) -> Result<Vec<GridRun>, MishandleError> {
    let mut table = table.clone();
    Settings::take(&mut table)?;
    check_options(&table)?;
    let questions = RunKind::ALL.map(|(_, name)| name).into_iter().chain([HARDEN]);
    let kinds: Vec<&str> = questions.filter(|kind| table.contains_key(*kind)).collect();
    let mut runs = Vec::new();
    for kind in &kinds {
        let mut own = table.clone();
        own.retain(|key, _| key == *kind || !kinds.contains(&key));
        for (values, plan) in combinations(own)? {
            let parts = values.iter().map(part);
            let kind = (kinds.len() > 1 || values.is_empty()).then(|| kind.to_string());
            let name = parts.chain(kind).collect::<Vec<_>>().join("_");
            let mut plan = Plan::from_toml(&plan.to_string())?;
            keep_options_of_search(&mut plan);
            runs.push(GridRun { name, plan });
        }
    }
    let mut names = BTreeSet::new();
    if let Some(twice) = runs.iter().find(|run| !names.insert(run.name.as_str())) {
        let what = "the name of two runs of the campaign";
        let expected = "given by different values";
        return Err(invalid(what, &twice.name, expected));
    }
    if runs.is_empty() {
        return Err(MishandleError::MissingPlanTable { table: "falsify" });
    }
    if runs.iter().any(|run| run.plan.target.is_empty()) {
        let expected = "the name of a target, or a list of names";
        return Err(invalid("the target", "missing", expected));
    }
    Ok(runs)
}

/// Returns each combination of the listed values, with the table that contains only these.
fn combinations(table: Table) -> Result<Vec<(Vec<Value>, Table)>, MishandleError> {
    let mut found = vec![(Vec::new(), table)];
    for name in keys().iter().map(|key| key.name.as_str()).filter(|name| may_be_list(name)) {
        let Some(Value::Array(list)) = entry(&mut found[0].1, name).cloned() else { continue };
        if list.is_empty() {
            return Err(invalid(name, "[]", "a value, or a list of values"));
        }
        if found.len() * list.len() > MAX_RUNS {
            let value = format!("at least {}", found.len() * list.len());
            let what = "the number of runs of the campaign";
            let expected = "at most 10000";
            return Err(invalid(what, value, expected));
        }
        let with = |(values, table): &(Vec<Value>, Table), value: &Value| {
            let mut values = values.clone();
            let mut table = table.clone();
            values.push(value.clone());
            if let Some(entry) = entry(&mut table, name) {
                *entry = value.clone();
            }
            (values, table)
        };
        found = found
            .iter()
            .flat_map(|row| list.iter().map(|value| with(row, value)).collect::<Vec<_>>())
            .collect();
    }
    Ok(found)
}

/// Returns the entry of a key with its table, such as `falsify.search`.
fn entry<'t>(table: &'t mut Table, name: &str) -> Option<&'t mut Value> {
    match name.split_once('.') {
        Some((within, key)) => table.get_mut(within)?.as_table_mut()?.get_mut(key),
        None => table.get_mut(name),
    }
}

/// Returns the part of a name for one value: its text, if it is short and has only characters of
/// names; otherwise these characters and the start of a hash, so that different values have
/// different names.
fn part(value: &Value) -> String {
    let text = value.as_str().map_or_else(|| value.to_string(), String::from);
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-.+".contains(c);
    if !text.is_empty() && text.len() <= MAX_PART && text.chars().all(is_plain) && !text.starts_with('.') {
        return text;
    }
    let kept: String = text.chars().map(|c| if is_plain(c) { c } else { '-' }).collect();
    let words: Vec<&str> = kept.split('-').filter(|word| !word.is_empty()).collect();
    let start: String = words.join("-").trim_start_matches('.').chars().take(MAX_PART).collect();
    let hash = Sha256::digest(text.as_bytes());
    format!("{start}-{:02x}{:02x}{:02x}", hash[0], hash[1], hash[2])
}

/// Checks that at least one search of the campaign has each option.
fn check_options(table: &Table) -> Result<(), MishandleError> {
    let falsify = table.get("falsify").and_then(Value::as_table);
    let Some(searches) = falsify.and_then(|falsify| falsify.get("search")).and_then(Value::as_array) else {
        return Ok(());
    };
    let known: BTreeSet<String> = searches
        .iter()
        .filter_map(|search| find_search(search.as_str()?).ok())
        .flat_map(|entry| (entry.options)())
        .map(|option| option.name.to_string())
        .collect();
    let options = falsify.and_then(|falsify| falsify.get("options")).and_then(Value::as_table);
    let unknown =
        options.into_iter().flat_map(Table::keys).find(|name| !known.contains(&name.replace('_', "-")));
    match unknown {
        Some(name) => Err(MishandleError::UnknownName {
            kind: "option of the listed searches",
            name: name.clone(),
            known: known.into_iter().collect(),
        }),
        None => Ok(()),
    }
}

fn keep_options_of_search(plan: &mut Plan) {
    let Some(falsify) = &mut plan.falsify else { return };
    // An unknown search is reported when the plan is resolved.
    let Ok(entry) = find_search(&falsify.search) else { return };
    let specs = (entry.options)();
    let given = std::mem::take(&mut falsify.options);
    for (name, value) in given.iter().filter(|(name, _)| specs.iter().any(|spec| spec.name == *name)) {
        falsify.options.set(name, value.clone());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(text: &str) -> Vec<String> {
        read_grid(text).unwrap().into_iter().map(|run| run.name).collect()
    }

    fn error(text: &str) -> String {
        read_grid(text).unwrap_err().to_string()
    }

    #[test]
    fn hardenings_have_lists_of_numbers_and_keep_their_lists_of_names() {
        let text = "target = 'ball-balancing'\ncontroller = ['ppo', 'sac']\n[evaluate]\n[harden]\nrounds = [1, 2]\n\
                    searches = ['random', 'cma-es']\nallow = ['strict', 'careful']\n";
        let runs = read_grid(text).unwrap();
        let names: Vec<&str> = runs.iter().map(|run| run.name.as_str()).collect();
        let hardened = ["ppo_1_harden", "ppo_2_harden", "sac_1_harden", "sac_2_harden"];
        assert_eq!(names, [["ppo_evaluate", "sac_evaluate"].as_slice(), &hardened].concat());
        assert!(runs[0].plan.harden.is_none() && runs[2].plan.evaluate.is_none());
        let table = runs[3].plan.harden.as_ref().unwrap();
        assert_eq!((table.rounds, table.searches.len(), table.allow.len()), (2, 2, 2));
        assert!(
            error("target = 'a'\n[harden]\nsearches = ['random', ['cma-es']]\n").contains("harden.searches")
        );
    }

    #[test]
    fn a_margin_has_its_own_default_space() {
        let text = "target = 'ball-balancing'\ncontroller = 'ppo'\n[evaluate]\nepisodes = 10\n[margin]\nbudget = 60\n";
        let spaces = |text: &str| -> Vec<String> {
            read_grid(text).unwrap().into_iter().map(|run| run.plan.space).collect()
        };
        // Without a name, it is the first space of the target.
        assert_eq!(spaces(text), ["", "disturbance"]);
        assert_eq!(spaces(&format!("space = 'delay'\n{text}")), ["delay", "delay"]);
    }

    #[test]
    fn a_campaign_has_a_run_for_each_combination_and_the_plans_contain_the_values() {
        let text = "target = ['toy/needle', 'toy/sphere']\nseed = [1, 2]\n[falsify]\nsearch = ['random', 'nelder-mead']\n\
                    trials = 3\n";
        let runs = read_grid(text).unwrap();
        assert_eq!(runs.len(), 8);
        assert_eq!(runs[1].name.split_once("_1_").unwrap().1, "nelder-mead");
        for run in &runs {
            let falsify = run.plan.falsify.as_ref().unwrap();
            assert_eq!(falsify.trials, 3);
            assert!(run.name.ends_with(&format!("_{}_{}", run.plan.seed, falsify.search)), "{}", run.name);
        }
        let distinct: BTreeSet<&str> = runs.iter().map(|run| run.name.as_str()).collect();
        assert_eq!(distinct.len(), 8);
    }

    #[test]
    fn both_tables_give_an_evaluation_and_a_falsification_of_each_controller() {
        let text =
            "target = 'ball-balancing'\ncontroller = ['ppo', 'sac']\n[evaluate]\nepisodes = 5\n[falsify]\n";
        assert_eq!(names(text), ["ppo_evaluate", "sac_evaluate", "ppo_falsify", "sac_falsify"]);
        let runs = read_grid(text).unwrap();
        assert!(runs[0].plan.evaluate.is_some() && runs[0].plan.falsify.is_none());
        assert!(runs[2].plan.evaluate.is_none() && runs[2].plan.falsify.is_some());
        assert_eq!(names("target = 'ball-balancing'\n[falsify]\n"), ["falsify"]);
    }

    #[test]
    fn names_of_paths_and_formulas_are_file_names_and_differ() {
        let text = "target = 'ball-balancing'\ncontroller = ['../a b.safetensors', '..', '/etc/x']\n[falsify]\n\
                    formula = ['always(x <= 1)', 'always(x < 1)']\n";
        let found = names(text);
        assert_eq!(found.iter().collect::<BTreeSet<_>>().len(), 6);
        assert!(found.iter().all(|name| !name.contains('/') && !name.starts_with('.')), "{found:?}");
    }

    #[test]
    fn each_search_gets_its_own_options() {
        let text = "target = 'toy/needle'\n[falsify]\nsearch = ['random', 'nelder-mead']\n[falsify.options]\nxatol = 1e-6\n";
        let runs = read_grid(text).unwrap();
        let options = |run: &GridRun| run.plan.falsify.as_ref().unwrap().options.iter().count();
        assert_eq!(runs.iter().map(options).collect::<Vec<_>>(), [0, 1]);
        let unknown = text.replace("xatol", "xtol");
        assert!(
            error(&unknown).contains("there is no option of the listed searches `xtol`"),
            "{}",
            error(&unknown)
        );
    }

    #[test]
    fn mistakes_are_errors_with_their_line() {
        let value = "the key `controller` is 1; it must be a string, such as \"ppo\"";
        assert!(error("target = 'a'\ncontroller = ['ppo', 1]\n[falsify]\n").contains(value));
        assert!(error("target = []\n[falsify]\n").contains("line 1 of the plan: the key `target` is []"));
        assert!(error("target = ['a', 'b', 'a']\n[falsify]\n").contains("it must be in the list once"));
        assert!(
            error("target = 'a'\nseed = ['1', 1]\n[falsify]\n")
                .contains("the name of two runs of the campaign is 1")
        );
        assert!(error("format = [1, 2]\ntarget = 'a'\n[falsify]\n").contains("`format`"));
        assert!(error("controller = ['a']\n[falsify]\n").contains("the name of a target"));
        assert!(error("target = 'a'\n").contains("[falsify]"));
        let many = (0..200).map(|i| i.to_string()).collect::<Vec<_>>().join(",");
        let text = format!("target = 'a'\nseed = [{many}]\n[falsify]\nbudget = [{many}]\n");
        assert!(
            error(&text).contains("must be at most 10000") || error(&text).contains("at least"),
            "{}",
            error(&text)
        );
    }

    #[test]
    fn a_plan_is_a_campaign_of_one_run() {
        let text = "target = 'toy/needle'\nseed = 7\n[falsify]\ntrials = 2\n";
        let [run] = &read_grid(text).unwrap()[..] else { panic!("one run") };
        assert_eq!(run.plan, Plan::from_toml(text).unwrap());
    }
}
