//! The first look at a target file: each of its spaces, evaluated and searched, in one table.

use std::path::Path;

use anyhow::Result;
use mishandle::Plan;
use mishandle::plan::{MarginPlan, Settings};
use mishandle::results::{Answer, Campaign, CampaignRun};
use mishandle::rollout::Space;
use mishandle::store::RunKind;
use mishandle::verdict::verdict;
use mishandle_report::Samples;
use mishandle_text::plural;
use toml::{Table, Value};

use super::{ExitStatus, pages, question};
use crate::flags::OpenRun;
use crate::show::output;
use crate::show::progress::Bar;

/// The first line of the campaign file of a first look.
pub const MARK: &str = "# a first look at a target file\n";

/// The question about the smallest disturbance.
const MARGIN: &str = "margin";

/// Number of simulations of each question in each space.
const SIMULATIONS: i64 = 100;

/// The space that joins others, in which the margin is sought.
const DISTURBANCE: &str = "disturbance";

/// Spaces that are left out: one joins others, the axes of the other are random draws.
const LEFT_OUT: [&str; 2] = [DISTURBANCE, "noise"];

/// The simulations of the pages of a first look: the pictures alone need some.
const SAMPLES: Samples = Samples { probes: 0, sensitivity: 0, repeats: 0 };

/// The question of a first look besides the runs of its campaign.
pub struct FirstLook {
    margin: Plan,
}

impl FirstLook {
    /// Adds the questions to a plan that names only its target: an evaluation and a search of each
    /// space, which moves its counterexample toward nominal. The plan's own space wins.
    pub fn of(plan: &mut Table) -> Result<FirstLook> {
        let only: Table = plan.clone().into_iter().filter(|(key, _)| key != "space").collect();
        let only = Plan::from_toml(&only.to_string())?;
        let target = mishandle::resolve::target(&only)?;
        let names = target.spaces.iter().map(Space::name).filter(|name| !LEFT_OUT.contains(name));
        let names: Vec<Value> = names.map(Value::from).collect();
        plan.entry("space").or_insert(Value::Array(names));
        let table = |keys: &[(&str, Value)]| {
            Value::Table(keys.iter().map(|(key, value)| (key.to_string(), value.clone())).collect())
        };
        plan.insert("evaluate".to_string(), table(&[("episodes", SIMULATIONS.into())]));
        let falsify = [("trials", 1.into()), ("budget", SIMULATIONS.into()), ("isolate", true.into())];
        plan.insert("falsify".to_string(), table(&falsify));
        Ok(FirstLook::with_margin(only, &target.spaces))
    }

    /// Returns the first look that began a campaign; `None` for another campaign.
    ///
    /// # Errors
    /// If the target cannot be resolved.
    pub fn resumed(text: &str, plan: &Plan) -> Result<Option<FirstLook>> {
        if !text.starts_with(MARK) {
            return Ok(None);
        }
        let only = Plan { evaluate: None, falsify: None, ..plan.clone() };
        let target = mishandle::resolve::target(&only)?;
        Ok(Some(FirstLook::with_margin(only, &target.spaces)))
    }

    fn with_margin(only: Plan, spaces: &[Space]) -> FirstLook {
        let margin = MarginPlan { budget: 3 * SIMULATIONS as u64, ..MarginPlan::default() };
        let joined = spaces.iter().map(Space::name).find(|name| *name == DISTURBANCE);
        let space = joined.unwrap_or_default().to_string();
        FirstLook { margin: Plan { margin: Some(margin), space, ..only } }
    }

    /// Searches for the smallest disturbance, with a run file in the folder of the campaign.
    pub fn margin(&self, folder: &Path) -> Result<CampaignRun> {
        let path = folder.join("margin.sqlite");
        let has_margin = path.exists();
        let [out, resume] = if has_margin { [None, Some(path)] } else { [Some(path), None] };
        let file = OpenRun { out, resume };
        let plan = || Ok((self.margin.clone(), Settings::default()));
        let asked = question::ask(RunKind::Margin, &[], &file, None, plan)?;
        Ok(CampaignRun { name: MARGIN.to_string(), kind: MARGIN.to_string(), result: asked.answer })
    }
}

/// Returns a row for each space: how many of its random scenarios fail, and how little is enough.
pub fn text(found: &Campaign) -> String {
    let mut rows = vec![["space", "fails", "cause, toward nominal"].map(String::from).to_vec()];
    for run in &found.runs {
        let Answer::Evaluation(evaluation) = &run.result else { continue };
        let space = &evaluation.subject.space;
        let is_search = |answer: &&Answer| matches!(answer, Answer::Falsification(found) if found.subject.space == *space);
        let search = found.runs.iter().map(|run| &run.result).find(is_search);
        let metrics = &evaluation.metrics;
        let started = metrics.simulations - metrics.invalid_starts;
        let fails = format!("{} of {started}", metrics.violations);
        let fails = match metrics.requirement_undecided {
            0 => fails,
            open => format!("{fails}, {open} no verdict"),
        };
        rows.push(vec![space.clone(), fails, search.map_or(String::new(), cause)]);
    }
    let width = output::width();
    let margins = found.runs.iter().filter(|run| run.kind == MARGIN).filter_map(|run| verdict(&run.result));
    let margins = margins
        .map(|found| format!("\n\n{}", output::wrapped(&format!("margin: {}", found.headline), width)));
    output::table_in(&rows, width) + &margins.collect::<String>()
}

/// Writes pages with pictures into the folder of the campaign.
pub fn write_pages(folder: &Path) -> Result<ExitStatus> {
    let bar = Bar::new(0, "simulations");
    let options = pages::Options {
        simulations: Some((SAMPLES, &bar)),
        controller: None,
        skip_check: false,
        has_replay: false,
        force: true,
    };
    pages::write_campaign(folder, &folder.join("pages"), &options)
}

/// Returns the cause of the counterexample of a search, or how many simulations found none.
fn cause(answer: &Answer) -> String {
    let fact = verdict(answer).and_then(|found| found.facts.into_iter().find(|fact| fact.label == "cause"));
    match (fact, answer) {
        (Some(fact), _) => fact.text,
        (None, Answer::Falsification(found)) => {
            let open = match found.simulations_without_verdict() {
                0 => String::new(),
                open => format!(", {} without a verdict", plural(open, "simulation")),
            };
            format!("none in {} simulations of a search{open}", found.simulations)
        }
        (None, _) => String::new(),
    }
}
