//! The table of performance: success rate, dangerous behavior rate, task completion time and
//! training time.

use mishandle::evaluation::{Estimate, fisher_test, wilson};
use mishandle_text::p_value_text as p_text;

use crate::notes::{Notes, Row};
use crate::page::{Block, Page, Table, code};
use crate::pages::{
    NOTHING, SIGNIFICANT, columns, differences, is_of_paper, on_the_paper, percent_with_interval, provenance,
    sentences, target_cell, with_interval,
};
use crate::published::{PAPER_STARTS, PaperPerformance, paper_performance, paper_training_time};
use crate::results::{Results, RunResults};
use crate::unit::{Evaluated, UNIT_OF_EVALUATION, Unit};

/// Returns the page; `None` without evaluations.
pub(crate) fn page(results: &Results, notes: &Notes) -> Option<Page> {
    let runs = results.campaigns.iter().flat_map(|campaign| &campaign.runs);
    let runs: Vec<&RunResults> = runs.filter(|run| run.plan.evaluate.is_some()).collect();
    if runs.is_empty() {
        return None;
    }
    let mut blocks = vec![Block::Paragraph(
        "Our controllers beside the paper's table of performance. The controllers differ: ours were trained here, in MuJoCo; the \
         paper's in Isaac Sim. So equal values are not expected; the table shows where the benchmark behaves alike."
            .to_string(),
    )];
    blocks.extend(provenance(results, runs.iter().copied()));
    blocks.push(Block::List(vec![
        "SR: success rate, in percent, with its Wilson interval (95 %). The column for 100 starts contains the first 100 of the \
         same simulations, the number that the paper uses."
            .to_string(),
        "DBR: dangerous behavior rate, the mean percentage of control steps that violate the formula `safe`, with a betting \
         interval."
            .to_string(),
        "TCT: task completion time, the mean number of control steps until completion over the successful simulations, with a \
         bootstrap interval. TT: training time, in control steps of each environment, until the return is flat."
            .to_string(),
        "p: two-sided p-value of Fisher's exact test that our success rate and the paper's (of 100) are equal.".to_string(),
    ]));
    let mut levels: Vec<(String, f64)> = Vec::new();
    for run in &runs {
        let level = (run.plan.preset.clone(), run.plan.action_noise);
        if !levels.contains(&level) {
            levels.push(level);
        }
    }
    let mut remarks = Vec::new();
    for (preset, noise) in &levels {
        let of_level = |run: &&&RunResults| run.plan.preset == *preset && run.plan.action_noise == *noise;
        let rows = runs.iter().filter(of_level).map(|run| {
            let row = Measured::new(run);
            remarks.extend(row.remark(notes));
            row.cells()
        });
        let (noise, variance) = (*noise, noise * noise);
        let noise = match noise {
            0.0 => "without noise".to_string(),
            noise => format!("with Gaussian action noise of standard deviation {noise}, variance {variance}"),
        };
        blocks.push(Block::Heading(format!("Performance {noise}, preset {}", code(preset))));
        blocks.push(Block::Table(Table {
            caption: format!("Performance {noise}. n: number of our starts"),
            columns: columns(&[
                "task",
                "controller",
                "SR, 100 starts",
                "SR",
                "n",
                "paper SR",
                "p",
                "DBR",
                "paper DBR",
                "TCT",
                "paper TCT",
                "TT",
                "paper TT",
                "failing corners",
            ]),
            left: 2,
            rows: rows.collect(),
        }));
    }
    if !remarks.is_empty() {
        blocks.push(Block::Heading("Where the values differ, and why".to_string()));
        blocks.push(Block::List(remarks));
    }
    blocks.extend(differences(notes, "performance"));
    blocks.extend(on_the_paper(notes, "performance"));
    Some(Page { title: "Performance: our controllers beside the paper's".to_string(), blocks })
}

/// The values of a row.
struct Measured<'a> {
    run: &'a RunResults,
    /// Success rate of the first simulations, as many as the paper has.
    first: Estimate,
    success_rate: Estimate,
    simulations: u64,
    dangerous_behavior_rate: Option<Estimate>,
    task_completion_time: Option<Estimate>,
    paper: Option<PaperPerformance>,
}

impl Measured<'_> {
    fn new(run: &RunResults) -> Measured<'_> {
        let plan = &run.plan;
        // The paper's noise has variance 0.25.
        let noise = [0.0, 0.5].iter().position(|noise| *noise == plan.action_noise);
        let paper =
            paper_performance(&plan.target, &plan.controller).filter(|_| is_of_paper(plan)).zip(noise);
        Measured {
            run,
            first: success_rate(
                run.random_units().take((PAPER_STARTS / u64::from(UNIT_OF_EVALUATION)) as usize),
            ),
            success_rate: success_rate(run.random_units()),
            simulations: run.random_units().map(|(unit, _)| u64::from(unit.simulations)).sum(),
            dangerous_behavior_rate: run.evaluation.and_then(|summary| summary.dangerous_behavior_rate),
            task_completion_time: run.evaluation.and_then(|summary| summary.task_completion_time),
            paper: paper.map(|(found, noise)| found[noise]),
        }
    }

    fn cells(&self) -> Vec<String> {
        let Measured { run, paper, .. } = self;
        let plan = &run.plan;
        let planned = plan.evaluate.as_ref().map_or(0, |evaluate| evaluate.episodes);
        let n = match self.simulations {
            0 => "not run".to_string(),
            n if n < planned => format!("{n} of {planned}"),
            n => n.to_string(),
        };
        let of_paper = |value: fn(&PaperPerformance) -> f64, decimals: usize| {
            paper.as_ref().map_or(NOTHING.to_string(), |paper| format!("{:.decimals$}", value(paper)))
        };
        let steps = |value: f64| format!("{value:.1}");
        let optional = |estimate: &Option<Estimate>, show: &dyn Fn(&Estimate) -> String| {
            estimate.as_ref().map_or(NOTHING.to_string(), show)
        };
        vec![
            target_cell(plan),
            code(&plan.controller),
            self.first.value.map_or(NOTHING.to_string(), |rate| format!("{:.0}", 100.0 * rate)),
            percent_with_interval(&self.success_rate, 1),
            n,
            of_paper(|paper| paper.success, 0),
            self.p_value().map_or(NOTHING.to_string(), p_text),
            optional(&self.dangerous_behavior_rate, &|rate| percent_with_interval(rate, 2)),
            of_paper(|paper| paper.danger, 2),
            optional(&self.task_completion_time, &|time| with_interval(time, &steps)),
            of_paper(|paper| paper.completion, 1),
            run.facts.training_steps.map_or(NOTHING.to_string(), |steps| steps.to_string()),
            paper_training_time(&plan.target, &plan.controller)
                .map_or(NOTHING.to_string(), |steps| steps.to_string()),
            failing_corners(run).map_or(NOTHING.to_string(), |(failing, n)| format!("{failing} of {n}")),
        ]
    }

    fn p_value(&self) -> Option<f64> {
        let rate = &self.success_rate;
        let successes = (rate.value? * rate.n as f64).round() as u64;
        let of_paper = (self.paper?.success / 100.0 * PAPER_STARTS as f64).round() as u64;
        Some(fisher_test((successes, rate.n), (of_paper, PAPER_STARTS)))
    }

    /// Returns a sentence on where the row differs from the paper's, and the notes on it.
    fn remark(&self, notes: &Notes) -> Option<String> {
        let plan = &self.run.plan;
        let row = Row {
            table: "performance",
            task: &plan.target,
            controller: &plan.controller,
            search: "",
            preset: &plan.preset,
        };
        let found =
            sentences([self.differences()].into_iter().flatten().chain(notes.on(&row).map(str::to_string)));
        let noise = if plan.action_noise == 0.0 { "" } else { ", with noise" };
        let name = format!("{} {}{noise}: ", code(&plan.target), code(&plan.controller));
        (!found.is_empty() && self.simulations > 0).then_some(name + &found)
    }

    fn differences(&self) -> Option<String> {
        let paper = self.paper?;
        let rate = self.success_rate.value?;
        let mut parts = Vec::new();
        if let Some(p) = self.p_value().filter(|p| *p < SIGNIFICANT) {
            let more = if 100.0 * rate > paper.success { "more often" } else { "less often" };
            parts.push(format!(
                "ours succeeds {more}, in {:.1} % against {:.0} % (p {})",
                100.0 * rate,
                paper.success,
                match p_text(p) {
                    text if text.starts_with('<') => text,
                    text => format!("= {text}"),
                }
            ));
        }
        let outside = |estimate: &Option<Estimate>, value: f64| {
            let Estimate { value: found, low, high, .. } = (*estimate)?;
            (value < low? || value > high?).then_some(found?)
        };
        if let Some(danger) = outside(&self.dangerous_behavior_rate, paper.danger / 100.0) {
            let word = if 100.0 * danger < paper.danger { "less" } else { "more" };
            parts.push(format!(
                "ours is {word} often in danger ({:.2} % against {:.2} %)",
                100.0 * danger,
                paper.danger
            ));
        }
        if let Some(steps) = outside(&self.task_completion_time, paper.completion) {
            let word = if steps < paper.completion { "faster" } else { "slower" };
            parts.push(format!("ours is {word} ({steps:.1} against {:.1} control steps)", paper.completion));
        }
        let mut text = parts.join("; ");
        if let Some(first) = text.get(..1).map(str::to_uppercase) {
            text.replace_range(..1, &first);
            text.push('.');
        }
        Some(text)
    }
}

/// Returns the success rate of units of an evaluation.
fn success_rate<'a>(units: impl Iterator<Item = (&'a Unit, &'a Evaluated)>) -> Estimate {
    let (successes, started) = units.fold((0, 0), |(successes, started), (_, found)| {
        (successes + found.successes, started + found.started)
    });
    wilson(successes, started)
}

/// Returns the number of corners of the initial box with a failing simulation, and the number of
/// corners and centers.
pub(crate) fn failing_corners(run: &RunResults) -> Option<(u32, u32)> {
    let summary = run.evaluation?;
    (summary.corners > 0).then_some((summary.failing_corners, summary.corners))
}
