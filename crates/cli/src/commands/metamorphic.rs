//! `mishandle metamorphic`: relations between the results of pairs of scenarios.

use anyhow::{Result, bail, ensure};
use clap::Args;
use mishandle::Plan;
use mishandle::falsification::MetamorphicSettings;
use mishandle::plan::RelationPlan;
use mishandle::results::Answer;
use mishandle::store::RunKind;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, question};
use crate::show::{metamorphic, output};

/// Name of the relation that flags give.
const NAME: &str = "change";

/// Compare pairs of scenarios: what must hold if a scenario is changed (metamorphic relations)
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle metamorphic ball-pushing --controller ppo --change ball_x=+0.02 --change goal_x=+0.02
  mishandle metamorphic peg-in-hole --controller ppo --change friction_scale=*0.8 --holds not-better
  mishandle metamorphic toy/car-following --plan relations.toml
  mishandle metamorphic --resume runs/RUN.sqlite

Source cases are random scenarios; the change gives the follow-up case. Both have the same seed, so
their noise is equal. A plan may have several relations, [metamorphic.relations.NAME] with the keys
`change` and `holds`. Exit code 1 means that a relation is broken.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    /// Change of an axis from source case to follow-up case: an offset NAME=+0.02, a factor
    /// NAME=*0.8 or NAME=-20%, a value NAME==0.3, or a category; repeat the flag for several axes
    #[arg(long, value_name = "NAME=CHANGE", allow_hyphen_values = true, value_parser = change, conflicts_with = "resume")]
    pub change: Vec<(String, String)>,
    /// Relation of the results: same-verdict, not-better, not-worse, the last two also with a
    /// tolerance of the robustness as in not-worse:0.05, or robustness-within:DISTANCE [default:
    /// same-verdict]
    #[arg(long, value_name = "RELATION", requires = "change", conflicts_with = "resume")]
    pub holds: Option<String>,
    /// Number of source cases [default: 100]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::integer::<u64>(MetamorphicSettings::PAIRS), conflicts_with = "resume")]
    pub pairs: Option<u64>,
    /// Requirement: the name of a formula of the target, or the text of a formula [default: the
    /// target's first formula]
    #[arg(long, allow_hyphen_values = true, conflicts_with = "resume")]
    pub formula: Option<String>,
    #[command(flatten)]
    pub file: flags::OpenRun,
    #[command(flatten)]
    pub run: flags::Run,
}

/// Parses `NAME=CHANGE`.
fn change(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, change)) if !name.is_empty() && !change.is_empty() => {
            Ok((name.to_string(), change.to_string()))
        }
        _ => Err("expected the name of an axis and a change, such as ball_x=+0.02".to_string()),
    }
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let asked = question::ask(RunKind::Metamorphic, &command.subject, &command.file, None, || plan(command))?;
    let Answer::Metamorphic(found) = asked.answer.result(&asked.resolved, &asked.path)? else {
        bail!("the answer is that of another question");
    };
    match command.run.json {
        true => output::json(&found)?,
        false => output::line(&metamorphic::text(&found))?,
    }
    for pair in found.relations.iter().filter_map(|relation| relation.worst.first()) {
        for (what, case) in [("Source", &pair.source), ("Follow-up", &pair.follow_up)] {
            output::message(&format!(
                "{what} of pair {}: mishandle replay {} --trial {} --simulation {}",
                pair.pair, asked.name, case.trial, case.simulation
            ));
        }
    }
    if let Some(status) = asked.report_file() {
        return Ok(status);
    }
    ensure!(found.has_verdict(), "no pair has two verdicts, so no relation was tested");
    Ok(if found.is_broken() { ExitStatus::Violated } else { ExitStatus::Done })
}

fn plan(command: &Arguments) -> Result<Plan> {
    let mut plan = flags::plan(&command.subject, &command.run)?;
    let mut table = plan.metamorphic.take().unwrap_or_default();
    table.formula = command.formula.clone().or(table.formula);
    table.pairs = command.pairs.unwrap_or(table.pairs);
    table.batch = command.subject.batch.unwrap_or(table.batch);
    if !command.change.is_empty() {
        let mut relation = RelationPlan::default();
        relation.holds = command.holds.clone().unwrap_or(relation.holds);
        for (name, change) in &command.change {
            let earlier = relation.change.insert(name.clone(), change.clone());
            ensure!(earlier.is_none(), "the axis {name} has two changes; give --change {name}=... once");
        }
        table.relations = [(NAME.to_string(), relation)].into();
    }
    ensure!(
        !table.relations.is_empty(),
        "there is no relation: give --change NAME=CHANGE, such as --change ball_x=+0.02, or [metamorphic.relations.NAME] in a plan"
    );
    plan.metamorphic = Some(table);
    Ok(plan.only(RunKind::Metamorphic))
}
