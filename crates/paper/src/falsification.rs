//! The table of falsification: falsified trials and simulations to the first violation.

use mishandle::Plan;
use mishandle::evaluation::{
    Estimate, Lifetime, SurvivalCurve, fisher_test, holm, log_rank, vargha_delaney, wilson,
};
use mishandle::shipped::Generation;
use mishandle::store::TrialStatus;
use mishandle_report::{SurvivalLine, survival_figure};
use mishandle_text::{p_value_text as p_text, plural};

use crate::notes::{self, Notes};
use crate::page::{Block, Page, Table, code, inline};
use crate::pages::{
    NOTHING, SIGNIFICANT, columns, differences, is_of_paper, on_the_paper, percent_with_interval, provenance,
    sentences, target_cell, with_interval,
};
use crate::performance::failing_corners;
use crate::published::{
    PAPER_BUDGET, PAPER_TRIALS, PaperFalsification, paper_falsification, paper_performance,
};
use crate::results::{Results, RunResults};
use crate::side_by_side::{Column, SideBySide, algorithm};

/// Returns the page; `None` without falsifications.
pub(crate) fn page(results: &Results, notes: &Notes) -> Option<Page> {
    let runs = results.campaigns.iter().flat_map(|campaign| &campaign.runs);
    let runs: Vec<Falsified<'_>> = runs.filter_map(|run| Falsified::new(run, notes)).collect();
    let untrained: Vec<&Plan> = results.untrained().filter(|plan| plan.falsify.is_some()).collect();
    if runs.is_empty() {
        return None;
    }
    let mut blocks = vec![Block::Paragraph(
        "Our falsification of our controllers beside the paper's falsification of its controllers. The controllers differ, so equal \
         values are not expected: the fewer scenarios a controller fails in, the more simulations a search needs."
            .to_string(),
    )];
    let rows = side_by_side(runs.iter(), untrained.iter().copied());
    blocks.extend(rows.protocols());
    blocks.extend(provenance(results, runs.iter().map(|falsified| falsified.run)));
    blocks.extend(summary(&runs, rows.generations()).map(Block::Paragraph));
    blocks.extend(summary_of_generations(&rows).map(Block::Paragraph));
    blocks.push(Block::List(vec![
        "falsified: trials with a violation, of all ended trials, with the Wilson interval (95 %) of the rate in percent.".to_string(),
        "mean over successes: mean number of simulations of the falsified trials, including the violating one. The paper prints this \
         mean. It says nothing about the trials without a violation, so a search that finds little can have a small one. The paper's \
         code does not count the violating simulation, so its values are smaller by one; they stand here as printed."
            .to_string(),
        "restricted mean: mean of min(simulations to the first violation, budget), with its interval from Greenwood's variance. A \
         trial without a violation is censored at the budget, also if its search ended earlier by its own criterion, because it \
         finds nothing after that. Without a violation there is no interval."
            .to_string(),
        "ended early: trials whose search ended by its own criterion before the budget was spent.".to_string(),
        "p: two-sided p-value of Fisher's exact test that both rates of falsified trials, ours and the paper's, are equal. Rows that \
         the paper may not have measured have none, and neither have controllers of another protocol than the paper's."
            .to_string(),
        "Wall-clock times are left out: the paper's are of another simulator on another machine, so only simulations can be compared."
            .to_string(),
    ]));
    let mut presets: Vec<&str> = Vec::new();
    for falsified in &runs {
        if !presets.contains(&falsified.run.plan.preset.as_str()) {
            presets.push(&falsified.run.plan.preset);
        }
    }
    for preset in presets {
        let of_preset: Vec<&Falsified<'_>> =
            runs.iter().filter(|falsified| falsified.run.plan.preset == preset).collect();
        let untrained = untrained.iter().copied().filter(|plan| plan.preset == preset);
        let rows = side_by_side(of_preset.iter().copied(), untrained);
        blocks.extend(section(results, notes, preset, &of_preset, &rows));
    }
    blocks.extend(differences(notes, "falsification"));
    blocks.extend(on_the_paper(notes, "falsification"));
    Some(Page { title: "Falsification: our controllers beside the paper's".to_string(), blocks })
}

/// Sorts falsifications into rows.
fn side_by_side<'a>(
    runs: impl Iterator<Item = &'a Falsified<'a>>,
    untrained: impl Iterator<Item = &'a Plan>,
) -> SideBySide<&'a Falsified<'a>> {
    SideBySide::new(runs.map(|falsified| (&falsified.run.plan, falsified)), untrained)
}

fn section(
    results: &Results,
    notes: &Notes,
    preset: &str,
    runs: &[&Falsified<'_>],
    rows: &SideBySide<&Falsified<'_>>,
) -> Vec<Block> {
    let falsified = [
        Column::Row("task", |row| target_cell(&row.plan)),
        Column::Row("controller", |row| code(&row.plan.controller)),
        Column::Row("search", |row| code(search(&row.plan))),
        Column::Row("falsified, paper", |row| {
            published(&row.plan)
                .map_or(NOTHING.to_string(), |paper| format!("{} of {PAPER_TRIALS}", paper.falsified))
        }),
        Column::Each("falsified", |run: &&Falsified<'_>| run.falsified_cell()),
        Column::Row("p", |row| {
            row.of_paper().and_then(|run| run.p_value()).map_or(NOTHING.to_string(), p_text)
        }),
        Column::Each("rate %", |run| percent_with_interval(&run.rate(), 0)),
    ];
    let [task, controller, of_search, ..] = &falsified;
    let simulations = [
        task.clone(),
        controller.clone(),
        of_search.clone(),
        Column::Row("mean over successes, paper", |row| {
            let mean = published(&row.plan).and_then(|paper| paper.mean_simulations);
            mean.map_or(NOTHING.to_string(), |mean| format!("{mean:.2}"))
        }),
        Column::Each("mean over successes", |run| {
            run.mean_over_successes().map_or(NOTHING.to_string(), |mean| format!("{mean:.1}"))
        }),
        Column::Each("restricted mean", |run| run.restricted_mean()),
        Column::Each("ended early", |run| run.ended_early.to_string()),
        Column::Each("simulations", |run| run.run.simulations().to_string()),
    ];
    let mut blocks = vec![
        Block::Heading(format!("Falsified trials, preset {}", code(preset))),
        Block::Table(rows.table(format!("Falsified trials, preset {preset}"), 3, &falsified, |_| true)),
        Block::Table(rows.table(
            format!("Simulations to the first violation, preset {preset}"),
            3,
            &simulations,
            |_| true,
        )),
    ];
    blocks.extend(survival(preset, runs));
    let remarks = remarks(results, notes, runs);
    if !remarks.is_empty() {
        blocks.push(Block::Heading(format!("Where the values differ, and why, preset {}", code(preset))));
        blocks.push(Block::List(remarks));
    }
    let comparisons = comparisons(runs);
    if !comparisons.is_empty() {
        blocks.push(Block::Heading(format!("Comparison of our searches, preset {}", code(preset))));
        blocks.push(Block::Paragraph(format!(
            "Log-rank tests of the simulations to the first violation, corrected by Holm's method for all {} on this table. A: Vargha \
             and Delaney's effect size, the probability that the first search needs more simulations than the second (ties count \
             half), with its interval. Pairs in which neither search finds a violation are left out.",
            plural(comparisons.len(), "test")
        )));
        blocks.push(Block::Table(Table {
            caption: format!("Comparison of searches, preset {preset}"),
            columns: columns(&["task", "controller", "searches", "χ²", "p", "p, Holm", "A", "n"]),
            left: 3,
            rows: comparisons,
        }));
    }
    let rates = rows.table(
        format!("Violations per random simulation in percent, preset {preset}"),
        2,
        &[
            task.clone(),
            controller.clone(),
            Column::Row("paper, from falsification", |row| {
                let rate = published(&row.plan).map(|paper| 100.0 * paper.violations_per_simulation());
                rate.map_or(NOTHING.to_string(), |rate| format!("{rate:.2}"))
            }),
            Column::Row("paper, from performance", |row| {
                let paper = paper_performance(&row.plan.target, &row.plan.controller);
                paper.map_or(NOTHING.to_string(), |found| format!("{:.0}", 100.0 - found[0].success))
            }),
            Column::Each("violations", |run| {
                let n = run.run.simulations() as u64;
                percent_with_interval(&wilson(run.run.violations() as u64, n), 2)
            }),
            Column::Each("n", |run| run.run.simulations().to_string()),
        ],
        |row| search(&row.plan) == "random" && row.any(|run| !run.lifetimes.is_empty()),
    );
    if !rates.rows.is_empty() {
        blocks.push(Block::Heading(format!("Violations per random simulation, preset {}", code(preset))));
        blocks.push(Block::Paragraph(
            "Random search draws its scenarios as an evaluation does, so its violations per simulation estimate the failure rate of \
             the controller. For the paper, one column follows from its table of falsification (falsified trials by all simulations) \
             and one from its table of performance (100 % minus the success rate without noise). If both were measured under the \
             same conditions, they would agree up to chance."
                .to_string(),
        ));
        blocks.push(Block::Table(rates));
    }
    blocks
}

/// Returns the search of a falsification.
fn search(plan: &Plan) -> &str {
    plan.falsify.as_ref().map_or("", |falsify| &falsify.search)
}

/// Returns the paper's result beside a plan whose controller is the name of an algorithm.
fn published(plan: &Plan) -> Option<PaperFalsification> {
    paper_falsification(&plan.target, &plan.controller, search(plan))
        .filter(|_| is_of_paper(plan) && plan.action_noise == 0.0)
}

/// Size of a chart, pixels.
const CHART: [u32; 2] = [400, 260];

/// Returns the survival curves: a chart for each controller with one curve per search; `None`
/// before the first trial ended.
fn survival(preset: &str, runs: &[&Falsified<'_>]) -> Option<Block> {
    let mut groups: Vec<Vec<&Falsified<'_>>> = Vec::new();
    for run in runs.iter().filter(|run| !run.lifetimes.is_empty()) {
        let is_same = |group: &&mut Vec<&Falsified<'_>>| {
            group[0].is_of_same_controller(&run.run.plan)
                && group[0].run.facts.formula == run.run.facts.formula
        };
        match groups.iter_mut().find(is_same) {
            Some(group) => group.push(run),
            None => groups.push(vec![run]),
        }
    }
    let chart = |group: &Vec<&Falsified<'_>>| {
        let lines: Vec<SurvivalLine<'_>> = group
            .iter()
            .map(|run| SurvivalLine { name: run.search, lifetimes: run.lifetimes.clone() })
            .collect();
        let plan = &group[0].run.plan;
        let title = inline(&format!("{} `{}`.", target_cell(plan), plan.controller));
        let end = group.iter().map(|run| run.budget).max().unwrap_or(1);
        survival_figure(&title, "", &lines, end, CHART)
    };
    let has_failures = |group: &&Vec<&Falsified<'_>>| group.iter().any(|run| run.falsified() > 0);
    let charts: String = groups.iter().filter(has_failures).map(chart).collect();
    let names = groups.iter().filter(|group| !has_failures(group)).map(|group| {
        let plan = &group[0].run.plan;
        format!("{} `{}`", target_cell(plan), plan.controller)
    });
    let names: Vec<String> = names.collect();
    let flat = match names.is_empty() {
        true => String::new(),
        false => format!(" No search falsifies {}, so they have no chart.", names.join(", ")),
    };
    (!groups.is_empty()).then(|| Block::Charts {
        heading: format!("Survival curves, preset `{preset}`"),
        text: format!(
            "The share of trials that have not failed yet over the simulations of the trial (Kaplan-Meier), one curve per search. A \
             tick is where trials ended without a failure: at the budget, also if the search ended earlier by its own criterion. A \
             curve that falls early belongs to a search that finds failures with few simulations.{flat}"
        ),
        html: format!("<div class=\"grid small\">\n{charts}</div>\n"),
    })
}

/// Summarizes the complete rows that the paper has, too.
fn summary(runs: &[Falsified<'_>], generations: &[&Generation]) -> Option<String> {
    let compared: Vec<(&Falsified<'_>, PaperFalsification, f64)> =
        runs.iter().filter_map(|run| Some((run, run.paper?, run.p_value()?))).collect();
    if compared.is_empty() {
        return None;
    }
    let ours: u64 = compared.iter().map(|(run, ..)| run.falsified()).sum();
    let trials: usize = compared.iter().map(|(run, ..)| run.lifetimes.len()).sum();
    let paper: u64 = compared.iter().map(|(_, paper, _)| paper.falsified).sum();
    let differ = |is_less: bool| {
        let is_it = |(run, paper, p): &&(&Falsified<'_>, PaperFalsification, f64)| {
            *p < SIGNIFICANT && run.is_less_than(paper) == is_less
        };
        compared.iter().filter(is_it).count()
    };
    let of = match generations {
        [_] => "",
        _ => " of the first generation",
    };
    Some(format!(
        "In the {}{of} that are complete and that the paper has, our searches falsify {ours} of {trials} trials and the paper's \
         {paper} of {}. Ours are falsified significantly less often in {} of these rows and more often in {} (p < {SIGNIFICANT} for each row, not \
         corrected).",
        plural(compared.len(), "row"),
        compared.len() as u64 * PAPER_TRIALS,
        differ(true),
        differ(false),
    ))
}

/// Compares the generations in the rows that are complete for all of them; `None` for one
/// generation.
fn summary_of_generations(rows: &SideBySide<&Falsified<'_>>) -> Option<String> {
    let generations = rows.generations();
    let complete = rows.rows.iter().filter_map(|row| row.all(generations));
    let complete: Vec<Vec<&&Falsified<'_>>> =
        complete.filter(|runs| runs.iter().all(|run| run.is_complete())).collect();
    if generations.len() < 2 || complete.is_empty() {
        return None;
    }
    let counts = generations.iter().enumerate().map(|(i, generation)| {
        let falsified: u64 = complete.iter().map(|runs| runs[i].falsified()).sum();
        let trials: usize = complete.iter().map(|runs| runs[i].lifetimes.len()).sum();
        format!("{falsified} of {trials} trials of the {} generation", generation.name)
    });
    Some(format!(
        "In the {} that all generations have complete, our searches falsify {}.",
        plural(complete.len(), "row"),
        counts.collect::<Vec<_>>().join(" and ")
    ))
}

/// Returns where and why rows differ, one entry per task and controller. Controllers of another
/// protocol than the paper's are not compared with it.
fn remarks(results: &Results, notes: &Notes, runs: &[&Falsified<'_>]) -> Vec<String> {
    let mut groups: Vec<Vec<&Falsified<'_>>> = Vec::new();
    for run in runs.iter().filter(|run| !run.lifetimes.is_empty() && run.follows_paper) {
        match groups.iter_mut().find(|group| group[0].is_of_same_controller(&run.run.plan)) {
            Some(group) => group.push(run),
            None => groups.push(vec![run]),
        }
    }
    groups.iter().filter_map(|group| remark(results, notes, group)).collect()
}

/// Returns where and why the rows of a controller differ from the paper's, and the notes on them.
fn remark(results: &Results, notes: &Notes, group: &[&Falsified<'_>]) -> Option<String> {
    let plan = &group[0].run.plan;
    let mut parts = differing(results, group);
    for falsified in group {
        for note in notes.on(&row(plan, falsified.search)) {
            if !parts.iter().any(|part| part == note) {
                parts.push(note.to_string());
            }
        }
    }
    (!parts.is_empty())
        .then(|| format!("{} {}: {}", code(&plan.target), code(&plan.controller), sentences(parts)))
}

/// Returns the row of a search, as notes name it.
fn row<'a>(plan: &'a Plan, search: &'a str) -> notes::Row<'a> {
    let Plan { target, controller, preset, .. } = plan;
    notes::Row { table: "falsification", task: target, controller, search, preset }
}

/// Returns sentences on the rows that differ significantly from the paper's, and what our
/// simulations say about the reason.
fn differing(results: &Results, group: &[&Falsified<'_>]) -> Vec<String> {
    let mut parts = Vec::new();
    for (is_less, words) in [(true, "less often"), (false, "more often")] {
        let rows = group.iter().filter_map(|run| {
            let paper = run.paper?;
            let differs = run.p_value()? < SIGNIFICANT && run.is_less_than(&paper) == is_less;
            differs.then(|| {
                let (ours, n) = (run.falsified(), run.lifetimes.len());
                format!("{} ({ours} of {n} against {} of {PAPER_TRIALS})", code(run.search), paper.falsified)
            })
        });
        let rows: Vec<String> = rows.collect();
        if !rows.is_empty() {
            parts.push(format!("Falsified {words} than the paper's by {}.", rows.join(", ")));
        }
    }
    if parts.is_empty() {
        return parts;
    }
    parts.push(violations(group));
    parts.extend(failure_rates(group));
    parts.extend(corners(results, group[0]));
    let early: usize = group.iter().map(|run| run.ended_early).sum();
    if early > 0 {
        parts.push(format!("{} ended by the criterion of the search.", plural(early, "trial")));
    }
    parts
}

/// Returns how many simulations violate the formula, or how close they come to it.
fn violations(group: &[&Falsified<'_>]) -> String {
    let units = || group.iter().flat_map(|run| &run.run.units);
    let n: usize = group.iter().map(|run| run.run.simulations()).sum();
    match group.iter().map(|run| run.run.violations()).sum() {
        0 => {}
        1 => return format!("One of our {} violates the formula.", plural(n, "simulation")),
        violations => return format!("{violations} of our {} violate the formula.", plural(n, "simulation")),
    }
    let low = units().filter_map(|unit| unit.lowest).fold(f64::INFINITY, f64::min);
    let high = units().filter_map(|unit| unit.highest).fold(f64::NEG_INFINITY, f64::max);
    let none = format!("None of our {} violates the formula", plural(n, "simulation"));
    match units().map(|unit| unit.stopped as usize).sum::<usize>() {
        0 => format!("{none}: their robustness is between {low:.4} and {high:.4}."),
        stopped if stopped == n => format!("{none}."),
        stopped => format!(
            "{none}: {stopped} of them ended as soon as they met it, and the robustness of the others is between {low:.4} and {high:.4}."
        ),
    }
}

/// Returns how often our controller and the paper's fail in random simulations: the main reason for
/// different rows.
fn failure_rates(group: &[&Falsified<'_>]) -> Option<String> {
    let random = group.iter().find(|run| run.search == "random" && run.run.simulations() > 0)?;
    let plan = &random.run.plan;
    let n = random.run.simulations();
    let failures = random.run.violations();
    let paper = 100.0 - paper_performance(&plan.target, &plan.controller)?[0].success;
    Some(format!(
        "Our controller fails in {failures} of {} ({:.2} %), the paper's in {paper:.0} % of its starts.",
        plural(n, "random simulation"),
        100.0 * failures as f64 / n as f64,
    ))
}

/// Returns what the evaluation of the same controller says about the corners of the initial box.
fn corners(results: &Results, falsified: &Falsified<'_>) -> Option<String> {
    let mut runs = results.campaigns.iter().flat_map(|campaign| &campaign.runs);
    let evaluation =
        runs.find(|run| run.plan.evaluate.is_some() && falsified.is_of_same_controller(&run.plan))?;
    let (failing, n) = failing_corners(evaluation)?;
    Some(match failing {
        0 => format!("It succeeds at all {n} corners and centers of the initial box."),
        _ => format!("It fails at {failing} of {n} corners and centers of the initial box."),
    })
}

/// A falsification and its trials.
struct Falsified<'a> {
    run: &'a RunResults,
    search: &'a str,
    budget: u32,
    /// The ended trials, censored at the budget.
    lifetimes: Vec<Lifetime>,
    ended_early: usize,
    planned: usize,
    paper: Option<PaperFalsification>,
    /// Whether the controller was trained by the paper's protocol.
    follows_paper: bool,
    /// Whether the paper's values are compared with ours; otherwise they are only shown.
    is_compared: bool,
}

impl Falsified<'_> {
    /// Returns the trials of a run; `None` if it is not a falsification.
    fn new<'a>(run: &'a RunResults, notes: &Notes) -> Option<Falsified<'a>> {
        let falsify = run.plan.falsify.as_ref()?;
        let lifetimes = run.ended().map(|trial| match trial.status {
            TrialStatus::Falsified => Lifetime::failed(trial.simulations),
            _ => Lifetime::censored(falsify.budget),
        });
        let follows_paper = algorithm(&run.plan.controller).1.is_of_paper;
        Some(Falsified {
            run,
            search: &falsify.search,
            budget: falsify.budget,
            lifetimes: lifetimes.collect(),
            ended_early: run.ended().filter(|trial| trial.status == TrialStatus::Converged).count(),
            planned: falsify.trials as usize,
            paper: published(&run.plan),
            follows_paper,
            is_compared: follows_paper && notes.compares(&row(&run.plan, &falsify.search)),
        })
    }

    fn falsified(&self) -> u64 {
        self.lifetimes.iter().filter(|lifetime| lifetime.failed).count() as u64
    }

    /// Returns whether a smaller part of our trials than of the paper's is falsified.
    fn is_less_than(&self, paper: &PaperFalsification) -> bool {
        self.falsified() * PAPER_TRIALS < paper.falsified * self.lifetimes.len() as u64
    }

    /// Returns whether a plan has the same target, controller, preset and noise.
    fn is_of_same_controller(&self, other: &Plan) -> bool {
        let of = |plan: &Plan| {
            (plan.target.clone(), plan.controller.clone(), plan.preset.clone(), plan.space.clone(), plan.seed)
        };
        of(&self.run.plan) == of(other) && self.run.plan.action_noise == other.action_noise
    }

    fn rate(&self) -> Estimate {
        wilson(self.falsified(), self.lifetimes.len() as u64)
    }

    fn is_complete(&self) -> bool {
        self.lifetimes.len() == self.planned
    }

    fn mean_over_successes(&self) -> Option<f64> {
        let found: Vec<u32> =
            self.lifetimes.iter().filter(|life| life.failed).map(|life| life.simulations).collect();
        (!found.is_empty()).then(|| f64::from(found.iter().sum::<u32>()) / found.len() as f64)
    }

    fn p_value(&self) -> Option<f64> {
        // With another budget, the rates cannot be compared.
        let is_compared = self.is_complete() && self.budget == PAPER_BUDGET && self.is_compared;
        let paper = self.paper.filter(|_| is_compared)?;
        let ours = (self.falsified(), self.lifetimes.len() as u64);
        Some(fisher_test(ours, (paper.falsified, PAPER_TRIALS)))
    }

    /// Returns the number of falsified trials, and how far a run is that has not finished.
    fn falsified_cell(&self) -> String {
        match self.lifetimes.len() {
            0 if self.run.simulations() == 0 => "not run".to_string(),
            0 => format!("none of {} trials ended", self.planned),
            n if n < self.planned => {
                format!("{} of {n}; {n} of {} trials ended", self.falsified(), self.planned)
            }
            n => format!("{} of {n}", self.falsified()),
        }
    }

    fn restricted_mean(&self) -> String {
        let restricted = SurvivalCurve::new(&self.lifetimes).restricted_mean(self.budget);
        restricted
            .map_or(NOTHING.to_string(), |mean| with_interval(&mean, &|value: f64| format!("{value:.1}")))
    }
}

/// Returns the rows of the tests of each pair of complete runs that differ in their searches alone.
fn comparisons(runs: &[&Falsified<'_>]) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for (i, first) in runs.iter().enumerate() {
        for second in &runs[i + 1..] {
            let formula = |falsified: &Falsified<'_>| falsified.run.facts.formula.clone();
            let is_pair = first.is_of_same_controller(&second.run.plan)
                && formula(first) == formula(second)
                && first.search != second.search
                && first.budget == second.budget
                && first.is_complete()
                && second.is_complete();
            if is_pair && let Some(test) = log_rank(&[&first.lifetimes, &second.lifetimes]) {
                found.push((*first, *second, test));
            }
        }
    }
    let adjusted = holm(&found.iter().map(|(.., test)| test.p_value).collect::<Vec<f64>>());
    let rows = found.iter().zip(adjusted).map(|((first, second, test), adjusted)| {
        let simulations = |falsified: &Falsified<'_>| -> Vec<f64> {
            falsified.lifetimes.iter().map(|lifetime| f64::from(lifetime.simulations)).collect()
        };
        let effect = vargha_delaney(&simulations(first), &simulations(second));
        vec![
            target_cell(&first.run.plan),
            code(&first.run.plan.controller),
            format!("{}, {}", code(first.search), code(second.search)),
            format!("{:.2}", test.chi_squared),
            p_text(test.p_value),
            p_text(adjusted),
            with_interval(&effect, &|value| format!("{value:.2}")),
            effect.n.to_string(),
        ]
    });
    rows.collect()
}

#[cfg(test)]
mod tests {
    use mishandle::shipped::GENERATIONS;

    use super::*;

    #[test]
    fn the_budget_of_the_paper_is_that_of_the_plan() {
        let plan = include_str!("../../../experiments/paper/falsification.toml");
        let runs = mishandle::plan::read_grid(plan).unwrap();
        assert_eq!(runs.len(), 8 * 2 * GENERATIONS.len() * 3);
        for run in runs {
            let falsify = run.plan.falsify.unwrap();
            assert_eq!((u64::from(falsify.trials), falsify.budget), (PAPER_TRIALS, PAPER_BUDGET));
        }
    }
}
