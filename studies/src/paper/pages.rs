//! The pages: which there are, and the parts that they share.

use mishandle::Plan;
use mishandle_report::{Block, Page, code, value};
use mishandle_text::plural;

use crate::paper::notes::{Notes, PaperNote};
use crate::paper::results::{CampaignResults, Results, RunResults};
use crate::paper::{falsification, performance};

/// A page with its file name, without an ending.
pub type NamedPage = (&'static str, Page);

/// Returns the pages of the tables that the results have rows for.
pub fn pages(results: &Results) -> Vec<NamedPage> {
    let notes = Notes::new();
    let performance = performance::page(results, &notes).map(|page| ("performance", page));
    let falsification = falsification::page(results, &notes).map(|page| ("falsification", page));
    performance.into_iter().chain(falsification).collect()
}

/// Returns the first paragraphs of a page: where its results come from.
pub(crate) fn provenance<'a>(
    results: &Results,
    runs: impl Iterator<Item = &'a RunResults> + Clone,
) -> Vec<Block> {
    let distinct = |values: &mut dyn Iterator<Item = String>| {
        let mut found: Vec<String> = Vec::new();
        values.for_each(|value| {
            if !value.is_empty() && !found.contains(&value) {
                found.push(value);
            }
        });
        found.join(", ")
    };
    let commits = distinct(&mut runs.clone().map(|run| value(&run.facts.commit)));
    let versions = distinct(
        &mut runs
            .clone()
            .flat_map(|run| &run.facts.versions)
            .map(|(name, version)| value(&format!("{name} {version}"))),
    );
    let simulations: usize = runs.clone().map(RunResults::simulations).sum();
    let is_shown = |campaign: &&CampaignResults| {
        runs.clone().any(|shown| campaign.runs.iter().any(|run| std::ptr::eq(run, shown)))
    };
    let commands = results.campaigns.iter().filter(is_shown).map(|campaign| code(&campaign.command));
    let commands = distinct(&mut { commands });
    let mut facts = vec![
        format!("{} in {}", plural(simulations, "simulation"), plural(runs.clone().count(), "run")),
        format!("commit {commits}"),
        versions,
    ];
    facts.extend(
        [&results.machine, &results.date].into_iter().filter(|fact| !fact.is_empty()).map(|fact| value(fact)),
    );
    let mut blocks = vec![Block::Paragraph(format!("{}. Commands: {commands}.", facts.join("; ")))];
    let incomplete = runs.clone().filter(|run| !run.is_complete()).count();
    if incomplete > 0 {
        blocks.push(Block::Paragraph(format!(
            "Not finished: {incomplete} of {} are incomplete. Their rows say how far they are; they are no results yet.",
            plural(runs.count(), "run")
        )));
    }
    blocks
}

/// Returns the section on what differs between the experiments in all rows.
pub(crate) fn differences(notes: &Notes, table: &str) -> Vec<Block> {
    let entries: Vec<String> = notes
        .differences
        .iter()
        .filter(|note| note.tables.iter().any(|name| name == table))
        .map(|note| note.text.clone())
        .collect();
    if entries.is_empty() {
        return Vec::new();
    }
    vec![Block::Heading("What differs in every row".to_string()), Block::List(entries)]
}

/// Returns the section on the paper itself.
pub(crate) fn on_the_paper(notes: &Notes, table: &str) -> Vec<Block> {
    let concerns = |note: &&PaperNote| note.tables.iter().any(|name| name == table);
    let entries: Vec<String> =
        notes.paper.iter().filter(concerns).map(|note| format!("{} {}", note.text, note.evidence)).collect();
    if entries.is_empty() {
        return Vec::new();
    }
    vec![
        Block::Heading("What to know about the published values".to_string()),
        Block::Paragraph(
            "These points concern the comparison, not the paper's merit. Each can be checked in the copies of the paper's tables \
             in `studies/experiments/paper/published` or in the authors' published code."
                .to_string(),
        ),
        Block::List(entries),
    ]
}

/// The space and the formula of the paper's experiments.
const PAPER_SPACE: &str = "starts";
const PAPER_FORMULA: &str = "success";

/// Returns whether a run has the space, the formula and the observations of the paper's
/// experiments.
pub(crate) fn is_of_paper(plan: &Plan) -> bool {
    let formula = plan.falsify.as_ref().and_then(|falsify| falsify.formula.as_deref());
    plan.space == PAPER_SPACE
        && plan.axes.is_empty()
        && plan.observation_noise == 0.0
        && formula.is_none_or(|name| name == PAPER_FORMULA)
}

/// Level below which a p-value counts as a difference.
pub(crate) const SIGNIFICANT: f64 = 0.05;

/// Joins sentences that are not empty.
pub(crate) fn sentences(parts: impl IntoIterator<Item = String>) -> String {
    parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ")
}
