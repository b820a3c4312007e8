//! Statistics of the runs of a grid side by side: rates, survival curves, tests of the searches.

mod falsifications;
mod page;

use mishandle::Plan;
use mishandle::evaluation::{Estimate, Metrics};
use mishandle::plan::AxisSetting;
use mishandle::results::Answer;

use crate::RunReport;
pub use falsifications::{GridFalsification, search_comparison, survival_curves};
use page::inline;
pub use page::{Block, Page, Table, code, value};

/// An empty cell.
pub const NOTHING: &str = "-";

/// A run of a grid whose statistics stand beside those of others.
#[derive(Clone, Debug)]
pub enum GridRun {
    /// An evaluation: its plan and its rates.
    Evaluation(Box<Plan>, Box<Metrics>),
    /// A falsification.
    Falsification(Box<GridFalsification>),
}

impl GridRun {
    /// Returns the statistics of a run; `None` for a question that has none of these.
    pub fn new(report: &RunReport) -> Option<GridRun> {
        let plan = report.plan.clone()?;
        match report.answer.as_ref()? {
            Answer::Evaluation(found) => {
                Some(GridRun::Evaluation(Box::new(plan), Box::new(found.metrics.clone())))
            }
            Answer::Falsification(found) => {
                Some(GridRun::Falsification(Box::new(GridFalsification::new(found, plan))))
            }
            _ => None,
        }
    }
}

/// Returns the page that compares the runs of a grid; `None` without an evaluation or a
/// falsification.
pub fn statistics_page(name: &str, runs: &[GridRun]) -> Option<Page> {
    let evaluations = runs.iter().filter_map(|run| match run {
        GridRun::Evaluation(plan, rates) => Some((&**plan, &**rates)),
        GridRun::Falsification(_) => None,
    });
    let falsifications = runs.iter().filter_map(|run| match run {
        GridRun::Falsification(found) => Some(&**found),
        GridRun::Evaluation(..) => None,
    });
    let evaluations: Vec<_> = evaluations.collect();
    let falsifications: Vec<_> = falsifications.collect();
    let mut blocks = Vec::new();
    if !evaluations.is_empty() {
        blocks.extend(evaluated(&evaluations));
    }
    if !falsifications.is_empty() {
        blocks.extend(falsifications::section(&falsifications));
    }
    (!blocks.is_empty()).then(|| Page { title: format!("{}: statistics", value(name)), blocks })
}

/// Returns the section on evaluations.
fn evaluated(runs: &[(&Plan, &Metrics)]) -> Vec<Block> {
    let cell = |estimate: &Option<Estimate>, show: &dyn Fn(f64) -> String| {
        estimate.as_ref().map_or(NOTHING.to_string(), |estimate| with_interval(estimate, show))
    };
    let row = |(plan, rates): &(&Plan, &Metrics)| {
        vec![
            target_cell(plan),
            code(&plan.controller),
            percent_with_interval(&rates.success_rate, 1),
            cell(&rates.dangerous_behavior_rate, &|rate| format!("{:.2}", 100.0 * rate)),
            cell(&rates.task_completion_time, &|steps| format!("{steps:.1}")),
            rates.simulations.to_string(),
        ]
    };
    vec![
        Block::Heading("Evaluations".to_string()),
        Block::List(vec![
            "SR: success rate in percent, with its Wilson interval (95 %).".to_string(),
            "DBR: dangerous behavior rate, the mean percentage of control steps that violate the formula `safe`, with a betting \
             interval."
                .to_string(),
            "TCT: task completion time, the mean number of control steps until completion over the successful simulations, with a \
             bootstrap interval."
                .to_string(),
        ]),
        Block::Table(Table {
            caption: "Evaluations".to_string(),
            columns: columns(&["target", "controller", "SR", "DBR", "TCT", "simulations"]),
            left: 2,
            rows: runs.iter().map(row).collect(),
        }),
    ]
}

/// Names the target of a run, with what differs from the defaults of a task.
pub fn target_cell(plan: &Plan) -> String {
    let mut text = code(&plan.target);
    if plan.preset != DEFAULT_PRESET {
        text += &format!(", preset {}", code(&plan.preset));
    }
    if plan.space != DEFAULT_SPACE {
        text += &format!(", space {}", code(&plan.space));
    }
    for (name, setting) in &plan.axes {
        let setting = match setting {
            AxisSetting::Value(value) => value.to_string(),
            AxisSetting::Range([low, high]) => format!("{low} to {high}"),
            AxisSetting::Text(text) => text.clone(),
        };
        text += &format!(", {} {}", code(name), value(&setting));
    }
    if let Some(formula) = plan.falsify.as_ref().and_then(|falsify| falsify.formula.as_ref())
        && formula != DEFAULT_FORMULA
    {
        text += &format!(", {}", code(formula));
    }
    let noises = [("action noise", plan.action_noise), ("observation noise", plan.observation_noise)];
    for (what, noise) in noises.iter().filter(|(_, noise)| *noise > 0.0) {
        text += &format!(", {what} {noise}");
    }
    if plan.stochastic {
        text += ", sampled actions";
    }
    if plan.seed > 0 {
        text += &format!(", seed {}", plan.seed);
    }
    text
}

/// The values of a task's plan that names none.
const DEFAULT_PRESET: &str = "paper";
const DEFAULT_SPACE: &str = "starts";
const DEFAULT_FORMULA: &str = "success";

/// Formats a rate in percent with its interval.
pub fn percent_with_interval(rate: &Estimate, decimals: usize) -> String {
    let percent = |value: f64| format!("{:.decimals$}", 100.0 * value);
    with_interval(rate, &percent)
}

/// Formats an estimate with its interval.
pub fn with_interval(estimate: &Estimate, show: &dyn Fn(f64) -> String) -> String {
    match (estimate.value, estimate.low.zip(estimate.high)) {
        (Some(value), Some((low, high))) => {
            format!("{} [{}, {}]", show(value), show(low), show(high))
        }
        (Some(value), None) => show(value),
        (None, _) => NOTHING.to_string(),
    }
}

fn columns(names: &[&str]) -> Vec<String> {
    names.iter().map(ToString::to_string).collect()
}
