//! Comparison of two evaluations on the same scenarios and seeds.

use std::collections::{BTreeMap, BTreeSet};

use mishandle_evaluation::{
    Corners, DifferenceSequence, EndCounts, PairedCounts, count_end, decides_careful_success,
    decides_strict_success, decides_success, paired_mean_difference, paired_rates, paired_rates_at_any_time,
    sign_test,
};
use mishandle_results::{ComparedRun, PairedMeans, PairedRates, Sequential};
use mishandle_robots::FILE_ROLES;
use mishandle_rollout::{Episode, Seed};
use mishandle_store::{AxisRecord, ComponentRecord, RANDOM_TRIAL, RunFile, RunHeader, RunKind, Simulation};

use crate::error::MishandleError;
use crate::plan::{ComparePlan, Plan};
use crate::resolve::guard::{guard_facts, recorded_guard};
use crate::resolve::is_python;
use crate::run::{PairRule, record, unfinished};
use mishandle_text::{p_value_phrase, plural, shell_quote};

/// Two evaluations, compared pair by pair: simulation i of both has the same scenario and seed.
///
/// The rates and means cover the random simulations. The corners and the center of the initial box
/// are not a random sample, so they appear among the new and the fixed failures only. A pair whose
/// scenario the target cannot start, in A or in B, counts nowhere.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// The first run, A.
    pub first: ComparedRun,
    /// The second run, B.
    pub second: ComparedRun,
    /// Facts in which the runs differ apart from the controller, such as the build. They can cause
    /// differences, too.
    pub differences: Vec<String>,
    /// Name of the target.
    pub target: String,
    /// Kind of the target: `task`, `toy` or `python`.
    pub target_kind: String,
    /// Text of the formula for success.
    pub formula: String,
    /// Axes of the scenarios.
    pub axes: Vec<AxisRecord>,
    /// Number of pairs of random simulations that count.
    pub pairs: u64,
    /// Number of other pairs of random simulations: the target cannot start from the scenario.
    pub left_out: u64,
    /// The rule that ended both evaluations; `None` without one. The difference of the success
    /// rates and its p-value then hold at any time.
    pub sequential: Option<Sequential>,
    /// Whether results decided how many pairs there are.
    pub at_any_time: bool,
    /// Success.
    pub success: PairedRates,
    /// Strict success; `None` if the target has no such formula.
    pub strict: Option<PairedRates>,
    /// Careful success; `None` if one of the runs did not evaluate such a formula.
    pub careful: Option<PairedRates>,
    /// Robustness of the success formula, over the pairs in which both values are finite; clipped
    /// if a rule watches it.
    pub robustness: PairedMeans,
    /// Number of dangerous control steps; `None` if the target has no such formula.
    pub dangerous_steps: Option<PairedMeans>,
    /// Control step of completion, over the pairs in which both succeed and complete; `None` if the
    /// target has no such formula.
    pub completion_step: Option<PairedMeans>,
    /// Pairs in which A succeeds and B does not.
    pub new_failures: Vec<ComparedPair>,
    /// Pairs in which B succeeds and A does not.
    pub fixed_failures: Vec<ComparedPair>,
    /// All pairs that count, the new and the fixed failures among them.
    pub compared: Vec<ComparedPair>,
}

/// Level below which a p-value counts as a difference.
const SIGNIFICANT: f64 = 0.05;

impl Comparison {
    /// Returns in a few words what the success rates say: `B succeeds less often`.
    pub fn judgment(&self) -> &'static str {
        let PairedRates { first_only, second_only, p_value, .. } = self.success;
        if !self.has_verdicts() {
            return "the success rates are unknown";
        }
        match (p_value < SIGNIFICANT, second_only > first_only) {
            (true, true) => "B succeeds more often",
            (true, false) => "B succeeds less often",
            (false, _) => "the success rates do not differ significantly",
        }
    }

    /// Returns a sentence on the success rates with the numbers behind the judgment.
    pub fn verdict(&self) -> String {
        if let Some(name) = self.untested() {
            return format!("No random simulation of {name} has a verdict, so there is nothing to compare.");
        }
        if let Some(sequential) = &self.sequential {
            return sequential.verdict.clone();
        }
        let PairedRates { first_only, second_only, p_value, .. } = self.success;
        format!(
            "B fails in {} where A succeeds, and succeeds in {} where A fails: {} ({}, {}).",
            plural(first_only, "random simulation"),
            second_only,
            self.judgment(),
            if self.at_any_time { "at any time" } else { "exact McNemar test" },
            p_value_phrase(p_value),
        )
    }

    /// Returns whether simulations of both runs have a verdict. Otherwise nothing is compared.
    pub fn has_verdicts(&self) -> bool {
        self.untested().is_none()
    }

    /// Returns the runs of which no random simulation has a verdict.
    fn untested(&self) -> Option<&'static str> {
        match [self.success.first, self.success.second].map(|rate| rate.value.is_some()) {
            [true, true] => None,
            [false, false] => Some("A or of B"),
            [false, true] => Some("A"),
            [true, false] => Some("B"),
        }
    }

    /// Returns a sentence if controller and target of both have the same hashes.
    pub fn sameness(&self) -> Option<String> {
        sameness(&self.first, &self.second)
    }

    /// Returns whether B fails anywhere where A succeeds.
    pub fn has_new_failures(&self) -> bool {
        !self.new_failures.is_empty()
    }
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

fn paired_means(pairs: &[(f64, f64)], seed: Seed, at_any_time: bool) -> PairedMeans {
    let (first, second): (Vec<f64>, Vec<f64>) = pairs.iter().copied().unzip();
    let mean = |values: &[f64]| (!values.is_empty()).then(|| mishandle_evaluation::mean(values));
    let count = |is: fn(&(f64, f64)) -> bool| pairs.iter().filter(|pair| is(pair)).count() as u64;
    let smaller = count(|(a, b)| b < a);
    let larger = count(|(a, b)| b > a);
    PairedMeans {
        first: mean(&first),
        second: mean(&second),
        difference: paired_mean_difference(&first, &second, seed),
        smaller,
        larger,
        p_value: if at_any_time {
            sign_test_at_any_time(smaller, larger)
        } else {
            sign_test(smaller, larger)
        },
    }
}

/// Returns the p-value of the sign test that holds at any time.
fn sign_test_at_any_time(smaller: u64, larger: u64) -> f64 {
    let counts = PairedCounts { first_only: smaller, second_only: larger, ..PairedCounts::default() };
    let mut sequence = DifferenceSequence::of(counts);
    sequence.look();
    sequence.p_value()
}

/// A simulation of both runs.
#[derive(Clone, Debug, PartialEq)]
pub struct ComparedPair {
    /// Number of the trial: 1 for random simulations, 2 for corners and center.
    pub trial: u32,
    /// Number of the simulation within the trial.
    pub number: u32,
    /// Random seed of both simulations.
    pub seed: u64,
    /// Scenario of both simulations: one value per axis.
    pub scenario: Vec<Option<f64>>,
    /// Robustness of A; `None` without a verdict.
    pub first_robustness: Option<f64>,
    /// Robustness of B; `None` without a verdict.
    pub second_robustness: Option<f64>,
    /// Whether A succeeds.
    pub first_succeeds: bool,
    /// Whether B succeeds.
    pub second_succeeds: bool,
}

/// Compares two evaluations with the same target, space, formula, noise, scenarios and seeds.
///
/// # Errors
/// [`NotComparable`](MishandleError::NotComparable) if a run is not an evaluation or not complete,
/// or the runs differ in anything but the controller, the build and the hash of the target; an
/// error of a run file.
pub fn compare(first: &RunFile, second: &RunFile) -> Result<Comparison, MishandleError> {
    let a = first.header();
    let b = second.header();
    if let Some(problem) = problem(a, b) {
        return Err(MishandleError::NotComparable { problem });
    }
    for (name, run) in [("A", first), ("B", second)] {
        if let Some(missing) = unfinished(run)? {
            let path = run.path().to_string_lossy();
            let is_pair = Plan::from_toml(&run.header().plan).is_ok_and(|plan| plan.compare.is_some());
            let is_python = is_python(&run.header().target.kind);
            let command = match (is_python, is_pair) {
                (true, true) => "the same call of `mishandle.compare` in Python".to_string(),
                (true, false) => {
                    "the same call of `mishandle.evaluate` in Python with `resume=True`".to_string()
                }
                (false, true) => "mishandle compare --resume A B".to_string(),
                (false, false) => format!("mishandle evaluate --resume {}", shell_quote(&path)),
            };
            let problem = format!("{name} is not complete: {missing}; complete it with: {command}");
            return Err(MishandleError::NotComparable { problem });
        }
    }
    let seed = Seed(a.seed);
    let mut pairs = Vec::new();
    for (row_a, row_b) in random_rows(first, second)? {
        pairs.push(pair(row_a, row_b)?);
    }
    let mut differences = differences(a, b);
    let rule = pair_rule(a, &pairs)?;
    let has_rule = [a, b].iter().any(|header| stops_by_itself(header));
    if has_rule {
        differences.push(format!(
            "number of simulations: a rule of A or of B chose it; compared are the first {} of both",
            pairs.len()
        ));
    }
    let at_any_time = rule.is_some() || has_rule;
    match corner_pairs(first, second)? {
        Some(corners) => pairs.extend(corners),
        None => differences.push(
            "corners: A and B simulate them with other seeds or other numbers of simulations, so they are not compared".to_string(),
        ),
    }
    let is_random = |pair: &&Pair| pair.rows[0].trial != Corners::TRIAL;
    let planned = pairs.iter().filter(is_random).count();
    pairs.retain(|pair| pair.episodes.iter().all(|episode| episode.end.counts_in_rates()));
    let random: Vec<&Pair> = pairs.iter().filter(is_random).collect();
    let without_verdict = |index: usize| {
        let mut counts = EndCounts::default();
        random.iter().for_each(|pair| count_end(&mut counts, &pair.episodes[index]));
        counts
    };
    let has =
        |name: &str| [a, b].iter().all(|header| header.formulas.iter().any(|formula| formula.name == name));
    let rates = |holds: fn(&Episode) -> bool, decides: fn(&Episode) -> bool| {
        let mut counts = PairedCounts::default();
        let mut verdicts = [0; 2];
        for pair in &random {
            let [first, second] = &pair.episodes;
            counts.add(holds(first), holds(second));
            verdicts[0] += u64::from(decides(first));
            verdicts[1] += u64::from(decides(second));
        }
        if at_any_time { paired_rates_at_any_time(counts, verdicts) } else { paired_rates(counts, verdicts) }
    };
    let means = |value: &dyn Fn(&Episode) -> Option<f64>| {
        let values: Vec<(f64, f64)> =
            random.iter().filter_map(|pair| value(&pair.episodes[0]).zip(value(&pair.episodes[1]))).collect();
        paired_means(&values, seed, at_any_time)
    };
    let clipped =
        rule.as_ref().map(PairRule::result).and_then(|found| Some((found.robustness_bounds?, found)));
    let compared: Vec<ComparedPair> = pairs.iter().map(Pair::compared).collect();
    let failures = |succeeds: [bool; 2]| {
        let is_it = |pair: &&ComparedPair| [pair.first_succeeds, pair.second_succeeds] == succeeds;
        compared.iter().filter(is_it).cloned().collect()
    };
    Ok(Comparison {
        first: compared_run(first, without_verdict(0)),
        second: compared_run(second, without_verdict(1)),
        differences,
        target: a.target.name.clone(),
        target_kind: a.target.kind.clone(),
        formula: a.formula.clone(),
        axes: a.axes.clone(),
        pairs: random.len() as u64,
        left_out: (planned - random.len()) as u64,
        success: match &rule {
            Some(rule) => {
                let (difference, p_value) = rule.success();
                let found = rates(Episode::is_success, decides_success);
                let has_value = found.difference.value.is_some();
                let difference = if has_value { difference } else { found.difference };
                PairedRates { difference, p_value, ..found }
            }
            None => rates(Episode::is_success, decides_success),
        },
        sequential: rule.as_ref().map(PairRule::result),
        strict: has("strict").then(|| rates(Episode::is_strict_success, decides_strict_success)),
        careful: has("careful").then(|| rates(Episode::is_careful_success, decides_careful_success)),
        at_any_time,
        robustness: match clipped {
            Some(([low, high], found)) => PairedMeans {
                difference: found.interval,
                p_value: found.p_value.unwrap_or(1.0),
                ..means(&|episode| episode.robustness().map(|rho| rho.clamp(low.0, high.0)))
            },
            None => means(&|episode| episode.robustness().filter(|rho| rho.is_finite())),
        },
        dangerous_steps: has("safe")
            .then(|| means(&|episode| episode.verdict.dangerous_steps.map(|steps| steps as f64))),
        completion_step: has("completion").then(|| {
            means(&|episode| {
                episode.verdict.completion_step.filter(|_| episode.is_success()).map(|step| step as f64)
            })
        }),
        new_failures: failures([true, false]),
        fixed_failures: failures([false, true]),
        compared,
    })
}

/// Returns whether the results of a run decided how many simulations it has, apart from a
/// comparison.
fn stops_by_itself(header: &RunHeader) -> bool {
    let plan = Plan::from_toml(&header.plan).ok();
    plan.and_then(|plan| plan.evaluate).is_some_and(|evaluate| evaluate.until.is_some())
}

/// Returns the rule that ended both runs, after all their pairs; `None` without one.
fn pair_rule(header: &RunHeader, pairs: &[Pair]) -> Result<Option<PairRule>, MishandleError> {
    let mut rule = PairRule::new(&Plan::from_toml(&header.plan)?);
    if let Some(rule) = &mut rule {
        pairs.iter().for_each(|Pair { episodes: [a, b], .. }| rule.add(a, b));
    }
    Ok(rule)
}

/// Returns the random simulations of both runs side by side.
fn random_rows(
    first: &RunFile,
    second: &RunFile,
) -> Result<impl Iterator<Item = (Simulation, Simulation)>, MishandleError> {
    let rows = |run: &RunFile| run.trial_simulations(RANDOM_TRIAL).collect::<Result<Vec<_>, _>>();
    let a = rows(first)?;
    let b = rows(second)?;
    // A rule can end one of them earlier. The first simulations of both are pairs.
    let has_rule = [first, second].iter().any(|run| stops_by_itself(run.header()));
    if a.len() != b.len() && !has_rule {
        let problem = format!(
            "A has {} random simulations and B has {}; evaluate both with the same --episodes",
            a.len(),
            b.len()
        );
        return Err(MishandleError::NotComparable { problem });
    }
    Ok(a.into_iter().zip(b))
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
    fn compared(&self) -> ComparedPair {
        let [a, b] = &self.rows;
        ComparedPair {
            trial: a.trial,
            number: a.number,
            seed: a.seed,
            scenario: a.scenario.clone(),
            first_robustness: a.robustness,
            second_robustness: b.robustness,
            first_succeeds: self.episodes[0].is_success(),
            second_succeeds: self.episodes[1].is_success(),
        }
    }
}

fn pair(a: Simulation, b: Simulation) -> Result<Pair, MishandleError> {
    let bits = |row: &Simulation| -> Vec<Option<u64>> {
        row.scenario.iter().map(|value| value.map(f64::to_bits)).collect()
    };
    let different = |what: String| MishandleError::NotComparable {
        problem: format!("{what}; evaluate both with the same seed, space and number of episodes"),
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
    let episodes = [record::recorded_episode(&a), record::recorded_episode(&b)];
    Ok(Pair { rows: [a, b], episodes })
}

/// Returns the reason why two runs cannot be compared; `None` if they can.
fn problem(a: &RunHeader, b: &RunHeader) -> Option<String> {
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

fn compared_run(run: &RunFile, without_verdict: EndCounts) -> ComparedRun {
    let header = run.header();
    let controller = header.components.iter().find(|component| !component.is_not_covered());
    let not_covered = header.components.iter().filter(|component| component.is_not_covered());
    ComparedRun {
        run: run.path().to_string_lossy().into_owned(),
        controller: controller.map(|controller| controller.name.clone()),
        controller_hash: controller.map(|controller| controller.hash.clone()),
        guard: recorded_guard(header),
        target_hash: header.target.hash.clone(),
        not_covered: not_covered.map(|component| component.name.clone()).collect(),
        commit: header.build.git_commit.clone(),
        without_verdict,
    }
}
