//! How two runs of any question differ: facts, results and verdicts.

use std::collections::{BTreeMap, BTreeSet};

use mishandle_results::{
    Answer, ChangedVerdict, DifferingFact, DifferingResult, DifferingRun, DifferingSimulations, Estimate,
    Quantity, RunDifference, Seed,
};
use mishandle_store::{RANDOM_TRIAL, RunFile, RunHeader, RunKind, Simulation, StoreError};

use crate::error::MishandleError;
use crate::inspect::run_facts;
use crate::plan::{Plan, key_values};
use crate::run::{answer_of_run, recorded_axes, recorded_scenario, stops_by_itself};

/// Largest number of changed verdicts that are listed.
const LISTED: usize = 100;

/// Returns how two runs differ. They may be of different questions.
///
/// # Errors
/// If a run cannot be read.
pub fn run_difference(first: &RunFile, second: &RunFile) -> Result<RunDifference, MishandleError> {
    let a = differing_run(first)?;
    let b = differing_run(second)?;
    let facts = differing(facts(first.header()), facts(second.header()));
    let mut notes = Vec::new();
    let mut found = |name: &str, run: &RunFile| match answer_of_run(run, None) {
        Ok(answer) => results_of(answer),
        Err(error) => {
            notes.push(format!("the answer of {name} is missing: {error}"));
            Vec::new()
        }
    };
    let results = side_by_side(found("A", first), found("B", second));
    if first.header().kind != second.header().kind {
        let [a, b] = [first, second].map(|run| run.header().kind.name());
        notes.push(format!("the runs are of different questions: A is of `{a}`, B of `{b}`"));
    }
    for (name, run) in [("A", first), ("B", second)] {
        if Plan::from_toml(&run.header().plan).is_ok_and(|plan| stops_by_itself(&plan)) {
            notes.push(format!("the intervals of {name} hold at any time, because a rule ended it"));
        }
    }
    let simulations = simulations(first, second)?;
    // Two runs without records have nothing in common but their facts.
    let has_records = a.facts.simulations > 0 || facts.is_empty();
    Ok(RunDifference {
        same_records: a.digest == b.digest && has_records,
        first: a,
        second: b,
        facts,
        results,
        notes,
        simulations,
        space_axes: recorded_axes(&first.header().axes),
    })
}

fn differing_run(run: &RunFile) -> Result<DifferingRun, MishandleError> {
    Ok(DifferingRun {
        run: run.path().to_string_lossy().into_owned(),
        digest: format!("{:032x}", run.content_digest()?),
        facts: run_facts(run)?,
    })
}

/// Name of a result, its estimate, and what its values are.
type Found = (String, Estimate, Quantity);

/// Returns all facts of a header by name.
fn facts(header: &RunHeader) -> BTreeMap<String, String> {
    let build = &header.build;
    let single = [
        ("question", header.kind.name().to_string()),
        ("target", format!("{} ({})", header.target.name, header.target.kind)),
        ("hash of the target", header.target.hash.clone()),
        ("space", header.space.clone()),
        ("formula", header.formula.clone()),
        ("control period", format!("{} s", header.control_dt)),
        ("control steps of an episode", header.episode_steps.to_string()),
        ("program version", build.program_version.clone()),
        ("program commit", build.git_commit.clone()),
        ("program target", build.target.clone()),
        ("program compiler", build.rustc.clone()),
        ("program instruction set", build.architecture.clone()),
    ];
    let mut facts: BTreeMap<String, String> =
        single.into_iter().map(|(name, fact)| (name.to_string(), fact)).collect();
    for part in &header.components {
        facts.insert(part.role.clone(), part.name.clone());
        facts.insert(format!("hash of the {}", part.role), part.hash.clone());
    }
    for (name, version) in &header.versions {
        facts.insert(format!("version of {name}"), version.clone());
    }
    for formula in &header.formulas {
        facts.insert(format!("formula {}", formula.name), formula.text.clone());
    }
    for axis in &header.axes {
        let nominal = axis.nominal.map_or("random".to_string(), |nominal| nominal.to_string());
        let range = format!("{} to {} {}, nominal {nominal}", axis.low, axis.high, axis.unit);
        facts.insert(format!("axis {}", axis.name), format!("{}, {}, {range}", axis.kind, axis.values));
    }
    match header.plan.parse::<toml::Table>() {
        Ok(plan) => {
            facts.extend(key_values(&plan).into_iter().map(|(key, value)| (format!("plan {key}"), value)));
        }
        Err(_) => {
            facts.insert("plan".to_string(), header.plan.clone());
        }
    }
    facts
}

fn differing(mut a: BTreeMap<String, String>, mut b: BTreeMap<String, String>) -> Vec<DifferingFact> {
    let names: BTreeSet<String> = a.keys().chain(b.keys()).cloned().collect();
    let facts = names.into_iter().map(|name| {
        let first = a.remove(&name);
        let second = b.remove(&name);
        DifferingFact { name, first, second }
    });
    facts.filter(|fact| fact.first != fact.second).collect()
}

/// Returns the results of an answer.
fn results_of(answer: Answer) -> Vec<Found> {
    match answer {
        Answer::Evaluation(found) => {
            let metrics = &found.metrics;
            let control = found.control.as_ref();
            let all = [
                ("success rate", Some(metrics.success_rate)),
                ("strict success rate", metrics.strict_success_rate),
                ("careful success rate", metrics.careful_success_rate),
                ("dangerous behavior rate", metrics.dangerous_behavior_rate),
                ("episodes with any danger", metrics.dangerous_episode_rate),
                ("control steps until completion", metrics.task_completion_time),
                ("success rate of the control", control.map(|control| control.success_rate)),
                ("difference to the control", control.map(|control| control.difference)),
            ];
            let quantity = |name: &str| match name {
                "control steps until completion" => Quantity::Number,
                "difference to the control" => Quantity::Difference,
                _ => Quantity::Share,
            };
            all.into_iter()
                .filter_map(|(name, found)| Some((name.to_string(), found?, quantity(name))))
                .collect()
        }
        Answer::Falsification(found) => {
            vec![("falsified trials".to_string(), found.falsification_rate, Quantity::Share)]
        }
        Answer::Risk(found) => {
            let value = found.probability.as_ref().and_then(|estimate| estimate.value);
            let estimate = Estimate { value, ..found.without_assumption() };
            vec![("probability of a failure".to_string(), estimate, Quantity::Share)]
        }
        Answer::Margin(found) => {
            let value = found.no_violation_up_to;
            let estimate = Estimate { value, n: found.simulations, ..Estimate::default() };
            vec![("amplitude without a violation".to_string(), estimate, Quantity::Number)]
        }
        Answer::Metamorphic(found) => {
            let relations = found.relations.iter();
            let name = |relation: &str| format!("broken pairs of {relation}");
            relations.map(|relation| (name(&relation.name), relation.broken_rate, Quantity::Share)).collect()
        }
        Answer::Hardening(_) => Vec::new(),
    }
}

fn side_by_side(a: Vec<Found>, b: Vec<Found>) -> Vec<DifferingResult> {
    let mut results: Vec<DifferingResult> = a
        .into_iter()
        .map(|(name, found, quantity)| DifferingResult { name, quantity, first: Some(found), second: None })
        .collect();
    for (name, found, quantity) in b {
        match results.iter_mut().find(|known| known.name == name) {
            Some(known) => known.second = Some(found),
            None => results.push(DifferingResult { name, quantity, first: None, second: Some(found) }),
        }
    }
    results
}

/// Returns the simulations of a run, those of a control arm at the end.
fn with_control(run: &RunFile) -> impl Iterator<Item = Result<Simulation, StoreError>> + '_ {
    let control = (run.header().kind == RunKind::Evaluate).then(|| run.derived_simulations(RANDOM_TRIAL));
    run.simulations().chain(control.into_iter().flatten())
}

/// Compares the simulations at the same places, in one pass over both files.
fn simulations(first: &RunFile, second: &RunFile) -> Result<DifferingSimulations, MishandleError> {
    let place = |simulation: &Simulation| (simulation.trial, simulation.number);
    let mut left = with_control(first);
    let mut right = with_control(second);
    let mut a = left.next().transpose()?;
    let mut b = right.next().transpose()?;
    let mut found = DifferingSimulations::default();
    loop {
        match (&a, &b) {
            (None, None) => return Ok(found),
            (Some(x), Some(y)) if place(x) == place(y) => {
                add_pair(&mut found, first.header(), x, y);
                (a, b) = (left.next().transpose()?, right.next().transpose()?);
            }
            (Some(x), y) if y.as_ref().is_none_or(|y| place(x) < place(y)) => {
                found.first_only += 1;
                a = left.next().transpose()?;
            }
            _ => {
                found.second_only += 1;
                b = right.next().transpose()?;
            }
        }
    }
}

fn add_pair(found: &mut DifferingSimulations, header: &RunHeader, a: &Simulation, b: &Simulation) {
    let bits = |values: &[Option<f64>]| -> Vec<Option<u64>> {
        values.iter().map(|value| value.map(f64::to_bits)).collect()
    };
    if a.seed != b.seed || bits(&a.scenario) != bits(&b.scenario) {
        found.other_scenarios += 1;
        return;
    }
    found.shared += 1;
    let record = |row: &Simulation| {
        let robustness = bits(&[row.robustness, row.robustness_low, row.robustness_high, row.stop_threshold]);
        (robustness, row.end, row.steps, bits(&row.verdicts), row.trace_digest, row.reason.clone())
    };
    found.same += u64::from(record(a) == record(b));
    let first = verdict(a);
    let second = verdict(b);
    if first == second {
        return;
    }
    found.changed += 1;
    if found.changes.len() < LISTED {
        found.changes.push(ChangedVerdict {
            trial: a.trial,
            simulation: a.number,
            seed: Seed(a.seed),
            scenario: recorded_scenario(&header.axes, &a.scenario),
            first: first.to_string(),
            second: second.to_string(),
            first_robustness: a.robustness.map(Into::into),
            second_robustness: b.robustness.map(Into::into),
        });
    }
}

fn verdict(simulation: &Simulation) -> &'static str {
    match simulation.robustness {
        Some(_) if simulation.is_violated() => "fails",
        Some(_) => "passes",
        None => simulation.end.name(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facts_of_tables_have_the_names_of_the_tables() {
        let plan = |text: &str| {
            let values = key_values(&text.parse().expect("the text is TOML"));
            values.into_iter().map(|(key, value)| (format!("plan {key}"), value)).collect()
        };
        let a = plan("seed = 1\nspace = \"all\"\n[evaluate]\nepisodes = 10\n[axes.x]\nlow = 1\n");
        let b = plan("seed = 1\n[evaluate]\nepisodes = 20\n[axes.x]\nlow = 1\n");
        let found = differing(a, b);
        let facts: Vec<_> = found
            .iter()
            .map(|fact| (fact.name.as_str(), fact.first.as_deref(), fact.second.as_deref()))
            .collect();
        let expected =
            [("plan evaluate.episodes", Some("10"), Some("20")), ("plan space", Some("\"all\""), None)];
        assert_eq!(facts, expected);
    }
}
