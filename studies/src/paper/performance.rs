//! The table of performance: success rate, dangerous behavior rate, task completion time and
//! training time.

use mishandle::Plan;
use mishandle::evaluation::{Estimate, fisher_test, wilson};
use mishandle_report::{Block, NOTHING, Page, code, percent_with_interval, target_cell, with_interval};
use mishandle_text::p_value_text as p_text;

use crate::paper::notes::{self, Notes};
use crate::paper::pages::{SIGNIFICANT, differences, is_of_paper, on_the_paper, provenance, sentences};
use crate::paper::published::{PAPER_STARTS, PaperPerformance, paper_performance, paper_training_time};
use crate::paper::results::{Results, RunResults};
use crate::paper::side_by_side::{Column, SideBySide, algorithm};
use crate::paper::unit::{Evaluated, UNIT_OF_EVALUATION, Unit};

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
    let measured: Vec<Measured<'_>> = runs.iter().map(|run| Measured::new(run)).collect();
    blocks.extend(side_by_side(measured.iter()).protocols());
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
        "n: number of our starts. p: two-sided p-value of Fisher's exact test that our success rate and the paper's (of 100) are \
         equal. Controllers of another protocol than the paper's have none."
            .to_string(),
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
        let is_of_level = |plan: &Plan| plan.preset == *preset && plan.action_noise == *noise;
        let of_level = measured.iter().filter(|measured| is_of_level(&measured.run.plan));
        remarks.extend(of_level.clone().filter_map(|measured| measured.remark(notes)));
        blocks.extend(section(preset, *noise, &side_by_side(of_level)));
    }
    if !remarks.is_empty() {
        blocks.push(Block::Heading("Where the values differ, and why".to_string()));
        blocks.push(Block::List(remarks));
    }
    blocks.extend(differences(notes, "performance"));
    blocks.extend(on_the_paper(notes, "performance"));
    Some(Page { title: "Performance: our controllers beside the paper's".to_string(), blocks })
}

/// Sorts evaluations into rows.
fn side_by_side<'a>(measured: impl Iterator<Item = &'a Measured<'a>>) -> SideBySide<&'a Measured<'a>> {
    SideBySide::new(measured.map(|measured| (&measured.run.plan, measured)))
}

/// Returns the tables of a preset and a level of noise.
fn section(preset: &str, noise: f64, rows: &SideBySide<&Measured<'_>>) -> Vec<Block> {
    let variance = noise * noise;
    let noise = match noise {
        0.0 => "without noise".to_string(),
        noise => {
            format!("with Gaussian action noise of standard deviation {noise}, variance {variance}")
        }
    };
    let success = [
        // The heading names the preset and the action noise.
        Column::Row("task", |row| {
            target_cell(&Plan { preset: Plan::new("", "").preset, action_noise: 0.0, ..row.plan.clone() })
        }),
        Column::Row("controller", |row| code(&row.plan.controller)),
        Column::Row("SR, paper", |row| published_cell(&row.plan, |paper| format!("{:.0}", paper.success))),
        Column::Each("SR, 100 starts", |run: &&Measured<'_>| {
            run.first.value.map_or(NOTHING.to_string(), |rate| format!("{:.0}", 100.0 * rate))
        }),
        Column::Each("SR", |run| percent_with_interval(&run.success_rate, 1)),
        Column::Row("p", |row| {
            row.of_paper().and_then(|run| run.p_value()).map_or(NOTHING.to_string(), p_text)
        }),
        Column::Each("n", |run| run.starts_cell()),
    ];
    let [task, controller, ..] = &success;
    let others = [
        task.clone(),
        controller.clone(),
        Column::Row("DBR, paper", |row| published_cell(&row.plan, |paper| format!("{:.2}", paper.danger))),
        Column::Each("DBR", |run| {
            let rate = run.dangerous_behavior_rate.as_ref();
            rate.map_or(NOTHING.to_string(), |rate| percent_with_interval(rate, 2))
        }),
        Column::Row("TCT, paper", |row| {
            published_cell(&row.plan, |paper| format!("{:.1}", paper.completion))
        }),
        Column::Each("TCT", |run| {
            let time = run.task_completion_time.as_ref();
            time.map_or(NOTHING.to_string(), |time| with_interval(time, &|steps: f64| format!("{steps:.1}")))
        }),
        Column::Row("TT, paper", |row| {
            let steps = paper_training_time(&row.plan.target, &row.plan.controller);
            steps.map_or(NOTHING.to_string(), |steps| steps.to_string())
        }),
        Column::Each("TT", |run| {
            run.run.facts.training_steps.map_or(NOTHING.to_string(), |steps| steps.to_string())
        }),
        Column::Each("failing corners", |run| {
            failing_corners(run.run).map_or(NOTHING.to_string(), |(failing, n)| format!("{failing} of {n}"))
        }),
    ];
    vec![
        Block::Heading(format!("Performance {noise}, preset {}", code(preset))),
        Block::Table(rows.table(format!("Success rate {noise}, preset {preset}"), 2, &success, |_| true)),
        Block::Table(rows.table(
            format!("Danger, times and corners {noise}, preset {preset}"),
            2,
            &others,
            |_| true,
        )),
    ]
}

/// Returns the paper's performance beside a plan whose controller is the name of an algorithm.
fn published(plan: &Plan) -> Option<PaperPerformance> {
    // The paper's noise has variance 0.25.
    let noise = [0.0, 0.5].iter().position(|noise| *noise == plan.action_noise)?;
    let found = paper_performance(&plan.target, &plan.controller).filter(|_| is_of_paper(plan))?;
    Some(found[noise])
}

fn published_cell(plan: &Plan, show: fn(&PaperPerformance) -> String) -> String {
    published(plan).as_ref().map_or(NOTHING.to_string(), show)
}

/// The values of an evaluation.
struct Measured<'a> {
    run: &'a RunResults,
    /// Success rate of the first simulations, as many as the paper has.
    first: Estimate,
    success_rate: Estimate,
    simulations: u64,
    dangerous_behavior_rate: Option<Estimate>,
    task_completion_time: Option<Estimate>,
    paper: Option<PaperPerformance>,
    /// Whether the controller was trained by the paper's protocol.
    follows_paper: bool,
}

impl Measured<'_> {
    fn new(run: &RunResults) -> Measured<'_> {
        Measured {
            run,
            first: success_rate(
                run.random_units().take((PAPER_STARTS / u64::from(UNIT_OF_EVALUATION)) as usize),
            ),
            success_rate: success_rate(run.random_units()),
            simulations: run.random_units().map(|(unit, _)| u64::from(unit.simulations)).sum(),
            dangerous_behavior_rate: run.evaluation.and_then(|summary| summary.dangerous_behavior_rate),
            task_completion_time: run.evaluation.and_then(|summary| summary.task_completion_time),
            paper: published(&run.plan),
            follows_paper: algorithm(&run.plan.controller).1.is_of_paper,
        }
    }

    /// Returns the number of starts, and how many are planned for a run that has not finished.
    fn starts_cell(&self) -> String {
        let planned = self.run.plan.evaluate.as_ref().map_or(0, |evaluate| evaluate.episodes);
        match self.simulations {
            0 => "not run".to_string(),
            n if n < planned => format!("{n} of {planned}"),
            n => n.to_string(),
        }
    }

    fn p_value(&self) -> Option<f64> {
        let rate = &self.success_rate;
        let successes = (rate.value? * rate.n as f64).round() as u64;
        let of_paper = (self.paper?.success / 100.0 * PAPER_STARTS as f64).round() as u64;
        Some(fisher_test([[successes, rate.n - successes], [of_paper, PAPER_STARTS - of_paper]]))
    }

    /// Returns a sentence on where the row differs from the paper's, and the notes on it; `None` if
    /// it is not compared with the paper's.
    fn remark(&self, notes: &Notes) -> Option<String> {
        let plan = &self.run.plan;
        let row = notes::Row {
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
        (!found.is_empty() && self.simulations > 0 && self.follows_paper).then_some(name + &found)
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
