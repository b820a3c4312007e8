//! Falsifications side by side: falsified trials, simulations to the first violation, survival
//! curves, and tests of each pair of searches.

use mishandle::Plan;
use mishandle::evaluation::{
    Estimate, Lifetime, SurvivalCurve, holm, lifetimes, log_rank, vargha_delaney, wilson,
};
use mishandle::results::{Falsification, Trial, TrialEnd};
use mishandle_text::{p_value_text as p_text, plural};

use super::{
    Block, NOTHING, Table, code, columns, inline, percent_with_interval, target_cell, with_interval,
};
use crate::survival::{SurvivalLine, survival_figure};

/// A falsification and its trials.
#[derive(Clone, Debug, PartialEq)]
pub struct GridFalsification {
    /// The plan.
    pub plan: Plan,
    /// Name of the search.
    pub search: String,
    /// Simulations per trial.
    pub budget: u32,
    /// Number of planned trials.
    pub planned: usize,
    /// Text of the formula.
    pub formula: String,
    /// The ended trials, censored at the budget.
    pub lifetimes: Vec<Lifetime>,
    /// Number of trials whose search ended by its own criterion.
    pub ended_early: usize,
    /// Number of simulations of all trials.
    pub simulations: u64,
}

impl GridFalsification {
    /// Returns the trials of an answer of a plan.
    pub(super) fn new(found: &Falsification, plan: Plan) -> GridFalsification {
        let ended_early = |trial: &&Trial| !trial.falsified && trial.end == Some(TrialEnd::SearchEnded);
        GridFalsification {
            search: found.search.clone(),
            budget: found.budget,
            planned: plan.falsify.as_ref().map_or(0, |falsify| falsify.trials as usize),
            formula: found.formula.clone(),
            lifetimes: lifetimes(&found.trials, found.budget),
            ended_early: found.trials.iter().filter(ended_early).count(),
            simulations: found.simulations,
            plan,
        }
    }

    /// Returns the number of falsified trials.
    pub fn falsified(&self) -> u64 {
        self.lifetimes.iter().filter(|lifetime| lifetime.failed).count() as u64
    }

    /// Returns whether a plan has the same target, controller, preset and noise.
    pub fn is_of_same_controller(&self, other: &Plan) -> bool {
        let of = |plan: &Plan| {
            (plan.target.clone(), plan.controller.clone(), plan.preset.clone(), plan.space.clone(), plan.seed)
        };
        of(&self.plan) == of(other) && self.plan.action_noise == other.action_noise
    }

    /// Returns the share of falsified trials.
    pub fn rate(&self) -> Estimate {
        wilson(self.falsified(), self.lifetimes.len() as u64)
    }

    /// Returns whether all planned trials have ended.
    pub fn is_complete(&self) -> bool {
        self.lifetimes.len() == self.planned
    }

    /// Returns the mean number of simulations of the falsified trials, as a cell.
    pub fn mean_over_successes(&self) -> String {
        let found: Vec<u32> =
            self.lifetimes.iter().filter(|life| life.failed).map(|life| life.simulations).collect();
        match found.len() {
            0 => NOTHING.to_string(),
            n => format!("{:.1}", f64::from(found.iter().sum::<u32>()) / n as f64),
        }
    }

    /// Returns the number of falsified trials, and how far a run is that has not finished.
    pub fn falsified_cell(&self) -> String {
        match self.lifetimes.len() {
            0 if self.simulations == 0 => "not run".to_string(),
            0 => format!("none of {} trials ended", self.planned),
            n if n < self.planned => {
                format!("{} of {n}; {n} of {} trials ended", self.falsified(), self.planned)
            }
            n => format!("{} of {n}", self.falsified()),
        }
    }

    /// Returns the mean of min(simulations to the first violation, budget), as a cell.
    pub fn restricted_mean(&self) -> String {
        let restricted = SurvivalCurve::new(&self.lifetimes).restricted_mean(self.budget);
        restricted
            .map_or(NOTHING.to_string(), |mean| with_interval(&mean, &|value: f64| format!("{value:.1}")))
    }
}

/// Returns the section on falsifications.
pub(super) fn section(runs: &[&GridFalsification]) -> Vec<Block> {
    let row = |run: &&GridFalsification| {
        vec![
            target_cell(&run.plan),
            code(&run.plan.controller),
            code(&run.search),
            run.falsified_cell(),
            percent_with_interval(&run.rate(), 0),
            run.mean_over_successes(),
            run.restricted_mean(),
            run.ended_early.to_string(),
            run.simulations.to_string(),
        ]
    };
    let names = [
        "target",
        "controller",
        "search",
        "falsified",
        "rate %",
        "mean over successes",
        "restricted mean",
        "ended early",
        "simulations",
    ];
    let mut blocks = vec![
        Block::Heading("Falsifications".to_string()),
        Block::List(vec![
            "falsified: trials with a violation, of all ended trials, with the Wilson interval (95 %) of the rate in percent."
                .to_string(),
            "mean over successes: mean number of simulations of the falsified trials, including the violating one. It says nothing \
             about the trials without a violation, so a search that finds little can have a small one."
                .to_string(),
            "restricted mean: mean of min(simulations to the first violation, budget), with its interval from Greenwood's variance. \
             A trial without a violation is censored at the budget, also if its search ended earlier by its own criterion."
                .to_string(),
            "ended early: trials whose search ended by its own criterion before the budget was spent.".to_string(),
        ]),
        Block::Table(Table {
            caption: "Falsifications".to_string(),
            columns: columns(&names),
            left: 3,
            rows: runs.iter().map(row).collect(),
        }),
    ];
    blocks.extend(survival_curves("", runs));
    blocks.extend(search_comparison("", runs));
    blocks
}

/// Size of a chart, pixels.
const CHART: [u32; 2] = [400, 260];

/// Returns the survival curves: a chart for each controller with one curve per search; `None`
/// before the first trial ended. `of` ends the heading.
pub fn survival_curves(of: &str, runs: &[&GridFalsification]) -> Option<Block> {
    let mut groups: Vec<Vec<&GridFalsification>> = Vec::new();
    for run in runs.iter().filter(|run| !run.lifetimes.is_empty()) {
        let is_same = |group: &&mut Vec<&GridFalsification>| {
            group[0].is_of_same_controller(&run.plan) && group[0].formula == run.formula
        };
        match groups.iter_mut().find(is_same) {
            Some(group) => group.push(run),
            None => groups.push(vec![run]),
        }
    }
    let name = |group: &[&GridFalsification]| {
        let plan = &group[0].plan;
        if plan.controller.is_empty() {
            target_cell(plan)
        } else {
            format!("{} {}", target_cell(plan), code(&plan.controller))
        }
    };
    let chart = |group: &Vec<&GridFalsification>| {
        let lines: Vec<SurvivalLine<'_>> = group
            .iter()
            .map(|run| SurvivalLine { name: &run.search, lifetimes: run.lifetimes.clone() })
            .collect();
        let title = inline(&format!("{}.", name(group)));
        let end = group.iter().map(|run| run.budget).max().unwrap_or(1);
        survival_figure(&title, "", &lines, end, CHART)
    };
    let has_failures = |group: &&Vec<&GridFalsification>| group.iter().any(|run| run.falsified() > 0);
    let charts: String = groups.iter().filter(has_failures).map(chart).collect();
    let names: Vec<String> =
        groups.iter().filter(|group| !has_failures(group)).map(|group| name(group)).collect();
    let flat = if names.is_empty() {
        String::new()
    } else {
        format!(" No search falsifies {}, so they have no chart.", names.join(", "))
    };
    (!groups.is_empty()).then(|| Block::Charts {
        heading: format!("Survival curves{of}"),
        text: format!(
            "The share of trials that have not failed yet over the simulations of the trial (Kaplan-Meier), one curve per search. A \
             tick is where trials ended without a failure: at the budget, also if the search ended earlier by its own criterion. A \
             curve that falls early belongs to a search that finds failures with few simulations.{flat}"
        ),
        html: format!("<div class=\"grid small\">\n{charts}</div>\n"),
    })
}

/// Returns the tests of each pair of complete runs that differ in their searches alone; nothing
/// without such a pair. `of` ends the heading.
pub fn search_comparison(of: &str, runs: &[&GridFalsification]) -> Vec<Block> {
    let rows = comparisons(runs);
    if rows.is_empty() {
        return Vec::new();
    }
    vec![
        Block::Heading(format!("Comparison of our searches{of}")),
        Block::Paragraph(format!(
            "Log-rank tests of the simulations to the first violation, corrected by Holm's method for all {} on this table. A: Vargha \
             and Delaney's effect size, the probability that the first search needs more simulations than the second (ties count \
             half), with its interval. Pairs in which neither search finds a violation are left out.",
            plural(rows.len(), "test")
        )),
        Block::Table(Table {
            caption: format!("Comparison of searches{}", of.replace('`', "")),
            columns: columns(&["task", "controller", "searches", "χ²", "p", "p, Holm", "A", "n"]),
            left: 3,
            rows,
        }),
    ]
}

fn comparisons(runs: &[&GridFalsification]) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for (i, first) in runs.iter().enumerate() {
        for second in &runs[i + 1..] {
            let is_pair = first.is_of_same_controller(&second.plan)
                && first.formula == second.formula
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
        let simulations = |run: &GridFalsification| -> Vec<f64> {
            run.lifetimes.iter().map(|lifetime| f64::from(lifetime.simulations)).collect()
        };
        let effect = vargha_delaney(&simulations(first), &simulations(second));
        vec![
            target_cell(&first.plan),
            code(&first.plan.controller),
            format!("{}, {}", code(&first.search), code(&second.search)),
            format!("{:.2}", test.chi_squared),
            p_text(test.p_value),
            p_text(adjusted),
            with_interval(&effect, &|value| format!("{value:.2}")),
            effect.n.to_string(),
        ]
    });
    rows.collect()
}
