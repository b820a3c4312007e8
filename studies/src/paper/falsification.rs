//! The table of falsification: falsified trials and simulations to the first violation.

use mishandle::Plan;
use mishandle::evaluation::{Lifetime, fisher_test, wilson};
use mishandle::store::TrialStatus;
use mishandle_report::{
    Block, GridFalsification, NOTHING, Page, code, percent_with_interval, search_comparison, survival_curves,
    target_cell,
};
use mishandle_text::{p_value_text as p_text, plural};

use crate::Generation;
use crate::paper::notes::{self, Notes};
use crate::paper::pages::{SIGNIFICANT, differences, is_of_paper, on_the_paper, provenance, sentences};
use crate::paper::performance::failing_corners;
use crate::paper::published::{
    PAPER_BUDGET, PAPER_TRIALS, PaperFalsification, paper_falsification, paper_performance,
};
use crate::paper::results::{Results, RunResults};
use crate::paper::side_by_side::{Column, SideBySide, algorithm};

/// Returns the page; `None` without falsifications.
pub(crate) fn page(results: &Results, notes: &Notes) -> Option<Page> {
    let runs = results.campaigns.iter().flat_map(|campaign| &campaign.runs);
    let runs: Vec<Falsified<'_>> = runs.filter_map(|run| Falsified::new(run, notes)).collect();
    if runs.is_empty() {
        return None;
    }
    let mut blocks = vec![Block::Paragraph(
        "Our falsification of our controllers beside the paper's falsification of its controllers. The controllers differ, so equal \
         values are not expected: the fewer scenarios a controller fails in, the more simulations a search needs."
            .to_string(),
    )];
    let rows = side_by_side(runs.iter());
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
        let rows = side_by_side(of_preset.iter().copied());
        blocks.extend(section(results, notes, preset, &of_preset, &rows));
    }
    blocks.extend(differences(notes, "falsification"));
    blocks.extend(on_the_paper(notes, "falsification"));
    Some(Page { title: "Falsification: our controllers beside the paper's".to_string(), blocks })
}

/// Sorts falsifications into rows.
fn side_by_side<'a>(runs: impl Iterator<Item = &'a Falsified<'a>>) -> SideBySide<&'a Falsified<'a>> {
    SideBySide::new(runs.map(|falsified| (&falsified.run.plan, falsified)))
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
        Column::Each("falsified", |run: &&Falsified<'_>| run.own.falsified_cell()),
        Column::Row("p", |row| {
            row.of_paper().and_then(|run| run.p_value()).map_or(NOTHING.to_string(), p_text)
        }),
        Column::Each("rate %", |run| percent_with_interval(&run.own.rate(), 0)),
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
        Column::Each("mean over successes", |run| run.own.mean_over_successes()),
        Column::Each("restricted mean", |run| run.own.restricted_mean()),
        Column::Each("ended early", |run| run.own.ended_early.to_string()),
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
    let of = format!(", preset {}", code(preset));
    let own: Vec<&GridFalsification> = runs.iter().map(|run| &run.own).collect();
    blocks.extend(survival_curves(&of, &own));
    let remarks = remarks(results, notes, runs);
    if !remarks.is_empty() {
        blocks.push(Block::Heading(format!("Where the values differ, and why{of}")));
        blocks.push(Block::List(remarks));
    }
    blocks.extend(search_comparison(&of, &own));
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
        |row| search(&row.plan) == "random" && row.any(|run| !run.own.lifetimes.is_empty()),
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

/// Summarizes the complete rows that the paper has, too.
fn summary(runs: &[Falsified<'_>], generations: &[&Generation]) -> Option<String> {
    let compared: Vec<(&Falsified<'_>, PaperFalsification, f64)> =
        runs.iter().filter_map(|run| Some((run, run.paper?, run.p_value()?))).collect();
    if compared.is_empty() {
        return None;
    }
    let ours: u64 = compared.iter().map(|(run, ..)| run.own.falsified()).sum();
    let trials: usize = compared.iter().map(|(run, ..)| run.own.lifetimes.len()).sum();
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
        complete.filter(|runs| runs.iter().all(|run| run.own.is_complete())).collect();
    if generations.len() < 2 || complete.is_empty() {
        return None;
    }
    let counts = generations.iter().enumerate().map(|(i, generation)| {
        let falsified: u64 = complete.iter().map(|runs| runs[i].own.falsified()).sum();
        let trials: usize = complete.iter().map(|runs| runs[i].own.lifetimes.len()).sum();
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
    for run in runs.iter().filter(|run| !run.own.lifetimes.is_empty() && run.follows_paper) {
        match groups.iter_mut().find(|group| group[0].own.is_of_same_controller(&run.run.plan)) {
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
        for note in notes.on(&row(plan, &falsified.own.search)) {
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
                let ours = run.own.falsified();
                let n = run.own.lifetimes.len();
                format!(
                    "{} ({ours} of {n} against {} of {PAPER_TRIALS})",
                    code(&run.own.search),
                    paper.falsified
                )
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
    let early: usize = group.iter().map(|run| run.own.ended_early).sum();
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
        violations => {
            return format!("{violations} of our {} violate the formula.", plural(n, "simulation"));
        }
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
    let random = group.iter().find(|run| run.own.search == "random" && run.run.simulations() > 0)?;
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
        runs.find(|run| run.plan.evaluate.is_some() && falsified.own.is_of_same_controller(&run.plan))?;
    let (failing, n) = failing_corners(evaluation)?;
    Some(match failing {
        0 => format!("It succeeds at all {n} corners and centers of the initial box."),
        _ => format!("It fails at {failing} of {n} corners and centers of the initial box."),
    })
}

/// A falsification beside the paper's.
struct Falsified<'a> {
    run: &'a RunResults,
    own: GridFalsification,
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
            own: GridFalsification {
                plan: run.plan.clone(),
                search: falsify.search.clone(),
                budget: falsify.budget,
                planned: falsify.trials as usize,
                formula: run.facts.formula.clone(),
                lifetimes: lifetimes.collect(),
                ended_early: run.ended().filter(|trial| trial.status == TrialStatus::Converged).count(),
                simulations: run.simulations() as u64,
            },
            paper: published(&run.plan),
            follows_paper,
            is_compared: follows_paper && notes.compares(&row(&run.plan, &falsify.search)),
        })
    }

    /// Returns whether a smaller part of our trials than of the paper's is falsified.
    fn is_less_than(&self, paper: &PaperFalsification) -> bool {
        self.own.falsified() * PAPER_TRIALS < paper.falsified * self.own.lifetimes.len() as u64
    }

    fn p_value(&self) -> Option<f64> {
        // With another budget, the rates cannot be compared.
        let is_compared = self.own.is_complete() && self.own.budget == PAPER_BUDGET && self.is_compared;
        let paper = self.paper.filter(|_| is_compared)?;
        let falsified = self.own.falsified();
        let ours = [falsified, self.own.lifetimes.len() as u64 - falsified];
        Some(fisher_test([ours, [paper.falsified, PAPER_TRIALS - paper.falsified]]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GENERATIONS;

    #[test]
    fn the_budget_of_the_paper_is_that_of_the_plan() {
        let plan = include_str!("../../experiments/paper/falsification.toml");
        let runs = mishandle::plan::read_grid(plan).unwrap();
        assert_eq!(runs.len(), 8 * 2 * GENERATIONS.len() * 3);
        for run in runs {
            let falsify = run.plan.falsify.unwrap();
            assert_eq!((u64::from(falsify.trials), falsify.budget), (PAPER_TRIALS, PAPER_BUDGET));
        }
    }
}
