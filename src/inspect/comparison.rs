//! Comparison of two evaluations on the same scenarios and seeds.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;

use mishandle_evaluation::{
    Corners, DifferenceSequence, EndCounts, PairedCounts, count_end, decides_careful_success,
    decides_strict_success, decides_success, paired_mean_difference, paired_rates, paired_rates_at_any_time,
    sign_test,
};
use mishandle_results as results;
use mishandle_results::{
    Answer, Command, ComparedRun, Comparison, PairedMeans, PairedRates, Remedy, Sequential, WithoutVerdict,
    Words,
};
use mishandle_robots::FILE_ROLES;
use mishandle_rollout::{Episode, Seed};
use mishandle_stl::is_violated;
use mishandle_store::{AxisRecord, ComponentRecord, RANDOM_TRIAL, RunFile, RunHeader, RunKind, Simulation};
use mishandle_text::{p_value_phrase, path_text, plural};

use crate::error::{MishandleError, problem};
use crate::plan::{ComparePlan, Plan};
use crate::replay::replay_command;
use crate::resolve::guard::{guard_facts, recorded_guard};
use crate::resolve::is_python;
use crate::run::{
    PairRule, asks_nothing_in, needs_target, recorded_answer, recorded_axes, recorded_scenario, rows,
    unfinished,
};

/// Level below which a p-value counts as a difference.
const SIGNIFICANT: f64 = 0.05;

/// Largest numbers of new and of fixed failures that are listed.
const MAX_LISTED: usize = 10_000;

/// Returns in a few words what the success rates say: `B succeeds less often`.
pub fn judgment(success: &PairedRates) -> &'static str {
    let PairedRates { first_only, second_only, p_value, difference, .. } = success;
    match (*p_value < SIGNIFICANT, second_only > first_only) {
        _ if difference.value.is_none() => "the success rates are unknown",
        (true, true) => "B succeeds more often",
        (true, false) => "B succeeds less often",
        (false, _) => "the success rates do not differ significantly",
    }
}

/// Returns a sentence on the success rates with the numbers behind the judgment.
fn verdict(success: &PairedRates, sequential: Option<&Sequential>, at_any_time: bool) -> String {
    let untested = match [success.first, success.second].map(|rate| rate.value.is_some()) {
        [true, true] => None,
        [false, false] => Some("A or of B"),
        [false, true] => Some("A"),
        [true, false] => Some("B"),
    };
    if let Some(name) = untested {
        return format!("No random simulation of {name} has a verdict, so there is nothing to compare.");
    }
    if let Some(sequential) = sequential {
        return sequential.verdict.clone();
    }
    format!(
        "B fails in {} where A succeeds, and succeeds in {} where A fails: {} ({}, {}).",
        plural(success.first_only, "random simulation"),
        success.second_only,
        judgment(success),
        if at_any_time { "at any time" } else { "exact McNemar test" },
        p_value_phrase(success.p_value),
    )
}

/// Returns a sentence if controller and target of two runs have the same hashes. It calls them the
/// same only if the hashes cover all of them.
pub fn sameness(a: &ComparedRun, b: &ComparedRun) -> Option<String> {
    if a.controller_hash != b.controller_hash || a.target_hash != b.target_hash {
        return None;
    }
    let parts: BTreeSet<&str> = a.not_covered.iter().chain(&b.not_covered).map(String::as_str).collect();
    if parts.is_empty() {
        return Some("A and B have the same controller and target".to_string());
    }
    let parts: Vec<&str> = parts.into_iter().collect();
    Some(format!(
        "A and B have the same code and settings as far as their hashes cover them; not covered, and possibly different: {}",
        parts.join("; ")
    ))
}

/// A number of both runs, of the pairs that have it.
#[derive(Default)]
struct Columns([Vec<f64>; 2]);

impl Columns {
    fn add(&mut self, pair: &Pair, value: impl Fn(&Episode) -> Option<f64>) {
        let [first, second] = pair.episodes.each_ref().map(value);
        if let Some((first, second)) = first.zip(second) {
            self.0[0].push(first);
            self.0[1].push(second);
        }
    }

    fn means(&self, seed: Seed, at_any_time: bool) -> PairedMeans {
        let [first, second] = &self.0;
        let mean = |values: &[f64]| (!values.is_empty()).then(|| mishandle_evaluation::mean(values));
        let count = |is: fn(&(&f64, &f64)) -> bool| first.iter().zip(second).filter(is).count() as u64;
        let smaller = count(|(a, b)| b < a);
        let larger = count(|(a, b)| b > a);
        let test = if at_any_time { sign_test_at_any_time } else { sign_test };
        PairedMeans {
            first: mean(first),
            second: mean(second),
            difference: paired_mean_difference(first, second, seed),
            smaller,
            larger,
            p_value: test(smaller, larger),
        }
    }
}

/// Returns the p-value of the sign test that holds at any time.
fn sign_test_at_any_time(smaller: u64, larger: u64) -> f64 {
    let counts = PairedCounts { first_only: smaller, second_only: larger, ..PairedCounts::default() };
    let mut sequence = DifferenceSequence::of(counts);
    sequence.look();
    sequence.p_value()
}

/// Numbers of pairs by who has a property, and of simulations of both runs that decide it.
#[derive(Default)]
struct Rates {
    counts: PairedCounts,
    verdicts: [u64; 2],
}

impl Rates {
    fn add(&mut self, pair: &Pair, holds: fn(&Episode) -> bool, decides: fn(&Episode) -> bool) {
        let [first, second] = &pair.episodes;
        self.counts.add(holds(first), holds(second));
        self.verdicts[0] += u64::from(decides(first));
        self.verdicts[1] += u64::from(decides(second));
    }

    fn rates(&self, at_any_time: bool) -> PairedRates {
        let rates = if at_any_time { paired_rates_at_any_time } else { paired_rates };
        rates(self.counts, self.verdicts)
    }
}

/// Counts of the random pairs, at 16 bytes a pair for each mean.
#[derive(Default)]
struct Counted {
    pairs: u64,
    success: Rates,
    strict: Rates,
    careful: Rates,
    without_verdict: [EndCounts; 2],
    robustness: Columns,
    dangerous_steps: Columns,
    completion_steps: Columns,
}

impl Counted {
    /// Adds a pair. `bounds` are those to which a rule clips the robustness.
    fn add(&mut self, pair: &Pair, bounds: Option<[f64; 2]>) {
        self.pairs += 1;
        self.success.add(pair, Episode::is_success, decides_success);
        self.strict.add(pair, Episode::is_strict_success, decides_strict_success);
        self.careful.add(pair, Episode::is_careful_success, decides_careful_success);
        for (counts, episode) in self.without_verdict.iter_mut().zip(&pair.episodes) {
            count_end(counts, episode.end, decides_success(episode), 1);
        }
        self.robustness.add(pair, |episode| match bounds {
            Some([low, high]) => episode.robustness().map(|rho| rho.clamp(low, high)),
            None => episode.robustness().filter(|rho| rho.is_finite()),
        });
        self.dangerous_steps.add(pair, |episode| episode.verdict.dangerous_steps.map(|steps| steps as f64));
        self.completion_steps.add(pair, |episode| {
            episode.verdict.completion_step.filter(|_| episode.is_success()).map(|step| step as f64)
        });
    }
}

/// The pairs of which one simulation succeeds.
#[derive(Default)]
struct Changes {
    /// New failures and fixed ones, each with the number of further ones.
    listed: [(Vec<results::ComparedPair>, u64); 2],
    /// Number of new failures in which B violates the requirement.
    new_violations: u64,
}

impl Changes {
    fn add(&mut self, pair: &Pair, runs: [&RunFile; 2], words: Words) {
        let [a, b] = &pair.rows;
        let (listed, failing) = match pair.episodes.each_ref().map(Episode::is_success) {
            [true, false] => {
                self.new_violations += u64::from(b.robustness.is_some_and(is_violated));
                (&mut self.listed[0], runs[1])
            }
            [false, true] => (&mut self.listed[1], runs[0]),
            _ => return,
        };
        if listed.0.len() == MAX_LISTED {
            listed.1 += 1;
            return;
        }
        let RunHeader { axes, target, .. } = failing.header();
        listed.0.push(results::ComparedPair {
            trial: a.trial,
            simulation: a.number,
            seed: results::Seed(a.seed),
            scenario: recorded_scenario(axes, &a.scenario),
            first_robustness: a.robustness.map(Into::into),
            second_robustness: b.robustness.map(Into::into),
            replay: words(&replay_command(&target.kind, failing.path(), a.trial, a.number)),
        });
    }
}

/// Returns the error of two runs that cannot be compared pair by pair.
pub(super) fn not_comparable(reason: impl Display) -> MishandleError {
    problem(format!("the runs cannot be compared: {reason}"))
}

/// Compares two evaluations pair by pair: simulation i of both has the same target, space, formula,
/// noise, scenario and seed. A pair whose scenario the target cannot start, in A or in B, counts
/// nowhere. A pair takes 48 bytes, a failure that is listed about 500.
///
/// # Errors
/// If a run is not an evaluation or not complete,
/// or the runs differ in anything but the controller, the build and the hash of the target; an
/// error of a run file.
pub fn compare(first: &RunFile, second: &RunFile, words: Words) -> Result<Comparison, MishandleError> {
    let a = first.header();
    let b = second.header();
    if let Some(obstacle) = obstacle(a, b) {
        return Err(not_comparable(obstacle));
    }
    for (name, run) in [("A", first), ("B", second)] {
        if let Some(missing) = unfinished(run)? {
            let is_pair = Plan::from_toml(&run.header().plan).is_ok_and(|plan| plan.compare.is_some());
            let is_python = is_python(&run.header().target.kind);
            let resume = if is_pair {
                Command::ResumeComparison { is_python }
            } else {
                Command::ResumeEvaluation { run: path_text(run.path()), is_python }
            };
            let text = format!("{name} is not complete: {missing}; complete it first");
            return Err(not_comparable(text).with(Remedy::Run(resume)));
        }
    }
    let plan = Plan::from_toml(&a.plan)?;
    let bounds = plan.compare.and_then(|compare| compare.robustness_bounds);
    let mut rule = PairRule::new(&plan);
    let has_rule = [a, b].iter().any(|header| stops_by_itself(header));
    let at_any_time = rule.is_some() || has_rule;
    let mut all = 0_u64;
    let mut counted = Counted::default();
    let mut changes = Changes::default();
    for pair in random_pairs(first, second)? {
        let pair = pair?;
        all += 1;
        if let Some(rule) = &mut rule {
            rule.add(&pair.episodes[0], &pair.episodes[1]);
        }
        if pair.counts() {
            counted.add(&pair, bounds);
            changes.add(&pair, [first, second], words);
        }
    }
    let mut differences = differences(a, b);
    if has_rule {
        differences.push(format!(
            "number of simulations: a rule of A or of B chose it; compared are the first {all} of both"
        ));
    }
    match corner_pairs(first, second)? {
        Some(corners) => {
            corners.iter().filter(|pair| pair.counts()).for_each(|pair| changes.add(pair, [first, second], words));
        }
        None => differences.push(
            "corners: A and B simulate them with other seeds or other numbers of simulations, so they are not compared".to_string(),
        ),
    }
    let has =
        |name: &str| [a, b].iter().all(|header| header.formulas.iter().any(|formula| formula.name == name));
    let means = |columns: Columns| columns.means(Seed(a.seed), at_any_time);
    let sequential = rule.as_ref().map(PairRule::result);
    let mut success = counted.success.rates(at_any_time);
    let mut robustness = means(counted.robustness);
    if let (Some(rule), Some(found)) = (&rule, &sequential) {
        let (difference, p_value) = rule.success();
        success.p_value = p_value;
        if success.difference.value.is_some() {
            success.difference = difference;
        }
        if bounds.is_some() {
            robustness.difference = found.interval;
            robustness.p_value = found.p_value.unwrap_or(1.0);
        }
    }
    let asks_nothing = asks_nothing(first, second)?;
    let [first_ends, second_ends] = counted.without_verdict;
    let Changes { listed, new_violations } = changes;
    let [(new_failures, more_new_failures), (fixed_failures, more_fixed_failures)] = listed;
    Ok(Comparison {
        target: a.target.name.clone(),
        target_kind: a.target.kind.clone(),
        formula: a.formula.clone(),
        first: compared_run(first, first_ends)?,
        second: compared_run(second, second_ends)?,
        differences,
        at_any_time,
        pairs: counted.pairs,
        left_out: all - counted.pairs,
        verdict: verdict(&success, sequential.as_ref(), at_any_time),
        asks_nothing,
        success,
        strict_success: has("strict").then(|| counted.strict.rates(at_any_time)),
        careful_success: has("careful").then(|| counted.careful.rates(at_any_time)),
        sequential,
        robustness,
        dangerous_steps: has("safe").then(|| means(counted.dangerous_steps)),
        completion_step: has("completion").then(|| means(counted.completion_steps)),
        new_failures,
        more_new_failures,
        new_violations,
        fixed_failures,
        more_fixed_failures,
        space_axes: recorded_axes(&a.axes),
    })
}

/// Returns why no simulation of both runs asks anything, if their formula is that of success.
fn asks_nothing(first: &RunFile, second: &RunFile) -> Result<Option<String>, MishandleError> {
    let RunHeader { formulas, formula, .. } = first.header();
    if formulas.iter().any(|found| found.name == "success" && found.text != *formula) {
        return Ok(None);
    }
    Ok(asks_nothing_in(first)?.and(asks_nothing_in(second)?))
}

/// Returns whether the results of a run decided how many simulations it has, apart from a
/// comparison.
fn stops_by_itself(header: &RunHeader) -> bool {
    let plan = Plan::from_toml(&header.plan).ok();
    plan.and_then(|plan| plan.evaluate).is_some_and(|evaluate| evaluate.until.is_some())
}

/// Iterates over the pairs of random simulations.
fn random_pairs<'a>(
    first: &'a RunFile,
    second: &'a RunFile,
) -> Result<impl Iterator<Item = Result<Pair, MishandleError>> + use<'a>, MishandleError> {
    let [a, b] = [first.last_simulation_number(RANDOM_TRIAL)?, second.last_simulation_number(RANDOM_TRIAL)?];
    // A rule can end one of them earlier. The first simulations of both are pairs.
    let has_rule = [first, second].iter().any(|run| stops_by_itself(run.header()));
    if a != b && !has_rule {
        return Err(not_comparable(format!(
            "A has {a} random simulations and B has {b}; evaluate both with the same number of episodes"
        )));
    }
    let rows = first.trial_simulations(RANDOM_TRIAL).zip(second.trial_simulations(RANDOM_TRIAL));
    Ok(rows.map(|(a, b)| pair(a?, b?)))
}

/// A simulation of both runs.
#[derive(Clone, Debug, PartialEq)]
pub struct ComparedPair {
    /// Number of the trial: 1 for random simulations, 2 for corners and center.
    pub trial: u32,
    /// Number of the simulation within the trial.
    pub number: u32,
    /// Scenario of both simulations: one value per axis.
    pub scenario: Vec<Option<f64>>,
    /// Robustness of A and of B; `None` without a verdict.
    pub robustness: [Option<f64>; 2],
    /// Whether A and whether B succeeds.
    pub succeeds: [bool; 2],
}

/// Iterates over the pairs that count in a [comparison](compare), those of the corners last.
///
/// # Errors
/// Those of [`compare`] that concern simulations.
pub fn compared_pairs<'a>(
    first: &'a RunFile,
    second: &'a RunFile,
) -> Result<impl Iterator<Item = Result<ComparedPair, MishandleError>> + use<'a>, MishandleError> {
    let corners = corner_pairs(first, second)?.unwrap_or_default();
    let pairs = random_pairs(first, second)?.chain(corners.into_iter().map(Ok));
    let counting = pairs.filter(|pair| pair.as_ref().map_or(true, Pair::counts));
    Ok(counting.map(|pair| {
        let Pair { rows: [a, b], episodes } = pair?;
        Ok(ComparedPair {
            trial: a.trial,
            number: a.number,
            robustness: [a.robustness, b.robustness],
            succeeds: episodes.each_ref().map(Episode::is_success),
            scenario: a.scenario,
        })
    }))
}

/// Returns the pairs of the corners and the center; `None` if the runs simulate them differently,
/// such as once without noise and with several seeds under noise.
fn corner_pairs(first: &RunFile, second: &RunFile) -> Result<Option<Vec<Pair>>, MishandleError> {
    let rows = |run: &RunFile| run.trial_simulations(Corners::TRIAL).collect::<Result<Vec<_>, _>>();
    let a = rows(first)?;
    let b = rows(second)?;
    if a.len() != b.len() {
        return Ok(None);
    }
    Ok(a.into_iter().zip(b).map(|(a, b)| pair(a, b).ok()).collect())
}

/// A row of both runs.
struct Pair {
    rows: [Simulation; 2],
    episodes: [Episode; 2],
}

impl Pair {
    /// Returns whether the target can start from the scenario, in A and in B.
    fn counts(&self) -> bool {
        self.episodes.iter().all(|episode| episode.end.counts_in_rates())
    }
}

fn pair(a: Simulation, b: Simulation) -> Result<Pair, MishandleError> {
    let bits = |row: &Simulation| -> Vec<Option<u64>> {
        row.scenario.iter().map(|value| value.map(f64::to_bits)).collect()
    };
    let different = |what: String| {
        not_comparable(format!("{what}; evaluate both with the same seed, space and number of episodes"))
    };
    let place = |row: &Simulation| format!("simulation {} of trial {}", row.number, row.trial);
    if (a.trial, a.number) != (b.trial, b.number) {
        return Err(different(format!("A has {} where B has {}", place(&a), place(&b))));
    }
    if a.seed != b.seed {
        return Err(different(format!("{} has the seed {} in A and {} in B", place(&a), a.seed, b.seed)));
    }
    if bits(&a) != bits(&b) {
        return Err(different(format!("{} has different scenarios in A and B", place(&a))));
    }
    let episodes = [rows::recorded_episode(&a), rows::recorded_episode(&b)];
    Ok(Pair { rows: [a, b], episodes })
}

/// Returns the reason why two runs cannot be compared; `None` if they can.
fn obstacle(a: &RunHeader, b: &RunHeader) -> Option<String> {
    let is_other = |(_, header): &&(&str, &RunHeader)| header.kind != RunKind::Evaluate;
    if let Some((name, header)) = [("A", a), ("B", b)].iter().find(is_other) {
        return Some(format!("{name} is a run of `{}`; compare runs of `evaluate`", header.kind.name()));
    }
    let settings = |header: &RunHeader| -> Vec<(&'static str, String)> {
        let plan = Plan::from_toml(&header.plan).ok();
        let compare = plan.as_ref().and_then(|plan| plan.compare);
        let axis = |axis: &AxisRecord| format!("{} ({}) {} to {}", axis.name, axis.kind, axis.low, axis.high);
        let axes: Vec<String> = header.axes.iter().map(axis).collect();
        let formulas = header.formulas.iter().map(|formula| format!("{} {}", formula.name, formula.text));
        let formulas: Vec<String> = formulas.collect();
        let rule = |rule: ComparePlan| {
            let margin = rule.margin.map_or(String::new(), |margin| format!(" with the margin {margin}"));
            let bounds =
                rule.robustness_bounds.map_or(String::new(), |[low, high]| format!(" in {low}:{high}"));
            let measure = if bounds.is_empty() { "success" } else { "robustness" };
            format!("{} of the {measure}{bounds}{margin}", rule.until)
        };
        vec![
            ("target", header.target.name.clone()),
            ("rule of a comparison", compare.map_or("none".to_string(), rule)),
            ("formula", header.formula.clone()),
            ("space", header.space.clone()),
            ("seed", header.seed.to_string()),
            ("axes", axes.join(", ")),
            ("formulas", formulas.join(", ")),
            ("control steps of an episode", header.episode_steps.to_string()),
            ("control period", header.control_dt.to_string()),
        ]
    };
    let differs = settings(a).into_iter().zip(settings(b)).find(|((_, a), (_, b))| a != b);
    differs.map(|((what, a), (_, b))| format!("{what}: A has {a}, B has {b}"))
}

/// Lists the facts that can cause differences although they do not prevent a comparison.
fn differences(a: &RunHeader, b: &RunHeader) -> Vec<String> {
    let settings = |header: &RunHeader| -> BTreeMap<String, String> {
        let mut facts = vec![
            ("program version", header.build.program_version.clone()),
            ("commit", header.build.git_commit.clone()),
            ("build target", header.build.target.clone()),
            ("compiler", header.build.rustc.clone()),
            ("instruction set", header.build.architecture.clone()),
        ];
        if let Ok(plan) = Plan::from_toml(&header.plan) {
            let guard = plan.guard.as_ref().map(|guard| guard_facts(guard).sentence());
            facts.push(("guard", guard.unwrap_or_else(|| "none".to_string())));
            facts.push(("task preset", plan.preset));
            facts.push(("action noise", plan.action_noise.to_string()));
            facts.push(("observation noise", plan.observation_noise.to_string()));
            facts.push(("sampled actions", plan.stochastic.to_string()));
        }
        // The hash of a target with a controller covers the controller.
        if header.components.iter().all(ComponentRecord::is_not_covered) {
            facts.push(("hash of the target", header.target.hash.clone()));
        }
        let facts = facts.into_iter().map(|(name, fact)| (name.to_string(), fact));
        // A controller may differ, but not the robot.
        let parts = header.components.iter().filter(|part| FILE_ROLES.contains(&part.role.as_str()));
        let parts = parts.map(|part| (format!("hash of the {}", part.role), part.hash.clone()));
        let versions =
            header.versions.iter().map(|(name, version)| (format!("version of {name}"), version.clone()));
        facts.chain(parts).chain(versions).filter(|(_, fact)| !fact.is_empty()).collect()
    };
    let a_facts = settings(a);
    let b_facts = settings(b);
    let names: BTreeSet<&String> = a_facts.keys().chain(b_facts.keys()).collect();
    let fact = |facts: &BTreeMap<String, String>, name: &String| {
        facts.get(name).map_or("no record of it", String::as_str).to_string()
    };
    let differs = names.into_iter().filter(|name| a_facts.get(*name) != b_facts.get(*name));
    let mut found: Vec<String> = differs
        .map(|name| format!("{name}: A has {}, B has {}", fact(&a_facts, name), fact(&b_facts, name)))
        .collect();
    if !a_facts.contains_key("task preset") && !b_facts.contains_key("task preset") {
        found.push(
            "preset and noise: the plans of A and B cannot be read, so they are not compared".to_string(),
        );
    }
    found
}

fn compared_run(run: &RunFile, ends: EndCounts) -> Result<ComparedRun, MishandleError> {
    let header = run.header();
    let max_share = Plan::from_toml(&header.plan)?.max_without_verdict;
    let controller = header.components.iter().find(|component| !component.is_not_covered());
    let not_covered = header.components.iter().filter(|component| component.is_not_covered());
    Ok(ComparedRun {
        run: run.path().to_string_lossy().into_owned(),
        controller: controller.map(|controller| controller.name.clone()),
        controller_hash: controller.map(|controller| controller.hash.clone()),
        guard: recorded_guard(header),
        target_hash: header.target.hash.clone(),
        not_covered: not_covered.map(|component| component.name.clone()).collect(),
        commit: header.build.git_commit.clone(),
        nominal: nominal(run),
        without_verdict: WithoutVerdict::new(ends, max_share),
    })
}

/// Returns the success rate of the control arm of an evaluation; `None` without one.
fn nominal(run: &RunFile) -> Option<results::Estimate> {
    let plan = Plan::from_toml(&run.header().plan).ok()?;
    if needs_target(run.header()) || !plan.evaluate?.control {
        return None;
    }
    match recorded_answer(run, None) {
        Ok(Answer::Evaluation(found)) => found.control.map(|control| control.success_rate),
        _ => None,
    }
}
