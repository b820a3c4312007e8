//! Results of campaigns: the facts of each run, and the summaries of its parts.

use std::path::Path;

use mishandle::campaign::campaign_runs;
use mishandle::evaluation::Estimate;
use mishandle::files::{limits, read_text_bounded};
use mishandle::results::{CornerPoint, Evaluation};
use mishandle::run::recorded_answer;
use mishandle::store::{RunFile, Simulation, TrialStatus};
use mishandle::{MishandleError, Plan};
use mishandle_text::shell_quote;
use serde::{Deserialize, Serialize};

use crate::paper::PaperError;
use crate::paper::unit::{Evaluated, Unit};
use crate::zoo::{Record, ZooFolder};

/// Results of several campaigns, and where they come from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Results {
    /// Date of the results; empty for campaigns that were not collected.
    pub date: String,
    /// The machine.
    pub machine: String,
    /// The commit at which the units can be run again; `None` if they are from several commits.
    pub commit: Option<String>,
    /// The campaigns.
    pub campaigns: Vec<CampaignResults>,
}

/// Results of a campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct CampaignResults {
    /// Name: that of its folder.
    pub name: String,
    /// The command that ran it.
    pub command: String,
    /// The runs, in the order of the campaign.
    pub runs: Vec<RunResults>,
}

/// Results of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct RunResults {
    /// Plan and command of the run.
    pub facts: RunFacts,
    /// The plan among the facts.
    pub plan: Plan,
    /// The parts of the run, by trial and first simulation. Each started trial has at least one.
    pub units: Vec<Unit>,
    /// Facts that the units of an evaluation do not add up to; `None` for another run.
    pub evaluation: Option<EvaluationSummary>,
}

/// Figures of an evaluation that depend on the order of its simulations, or on more than one unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvaluationSummary {
    /// Mean fraction of dangerous steps, with its interval; `None` without a formula for it.
    pub dangerous_behavior_rate: Option<Estimate>,
    /// Mean completion step, with its interval; `None` without a formula for it.
    pub task_completion_time: Option<Estimate>,
    /// Number of corners and centers of the initial box with a failing simulation.
    pub failing_corners: u32,
    /// Number of corners and centers.
    pub corners: u32,
}

/// Subject of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunFacts {
    /// Name of the run in its campaign.
    pub name: String,
    /// The plan, as TOML.
    pub plan: String,
    /// Text of the requirement.
    pub formula: String,
    /// Names of the target's formulas.
    pub formulas: Vec<String>,
    /// Name and unit of each axis.
    pub axes: Vec<(String, String)>,
    /// Hash of the target.
    pub target_hash: String,
    /// Hash of the controller; empty without one.
    pub controller_hash: String,
    /// Commit of the program.
    pub commit: String,
    /// Target triple and instruction set of the build.
    pub build: String,
    /// Name and version of each dependency that affects episodes.
    pub versions: Vec<(String, String)>,
    /// Training time of the controller in control steps of each environment; `None` if unknown.
    pub training_steps: Option<u64>,
}

impl Results {
    /// Merges campaigns of the same name, so that parts of a campaign that ran at different times
    /// become one. The runs keep their order. A run that two parts have with the same units is kept
    /// once.
    ///
    /// # Errors
    /// Two parts contain a run of the same name with different units or facts.
    pub fn merge_campaigns(&mut self) -> Result<(), PaperError> {
        let mut merged: Vec<CampaignResults> = Vec::new();
        for campaign in std::mem::take(&mut self.campaigns) {
            let Some(first) = merged.iter_mut().find(|other| other.name == campaign.name) else {
                merged.push(campaign);
                continue;
            };
            for run in campaign.runs {
                match first.runs.iter().find(|known| known.facts.name == run.facts.name) {
                    None => first.runs.push(run),
                    Some(known) if *known == run => {}
                    Some(_) => {
                        return Err(PaperError::DuplicateRun {
                            campaign: campaign.name,
                            run: run.facts.name,
                        });
                    }
                }
            }
        }
        self.campaigns = merged;
        Ok(())
    }
}

impl CampaignResults {
    /// Reads the run files of a campaign, which may be incomplete. Hardenings have none.
    /// `root`, the repository, has the training times of shipped controllers.
    ///
    /// # Errors
    /// If the folder has no campaign, or a file cannot be read.
    pub fn read(folder: &Path, root: &Path) -> Result<CampaignResults, PaperError> {
        let name = folder.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        let runs = campaign_runs(folder)?
            .iter()
            .filter(|run| !run.is_hardening())
            .map(|run| read_run(&run.name, &run.path, root))
            .collect::<Result<Vec<RunResults>, PaperError>>()?;
        Ok(CampaignResults { command: command(folder, &name, root), name, runs })
    }
}

/// Returns the command that runs the campaign of a folder. The plan is that of the repository if it
/// has the same text.
fn command(folder: &Path, name: &str, root: &Path) -> String {
    let own = folder.join("campaign.toml");
    let kept = format!("studies/experiments/paper/{name}.toml");
    let text = |path: &Path| read_text_bounded(path, limits::PLAN).ok();
    let plan = match text(&root.join(&kept)) {
        Some(found) if text(&own).as_ref() == Some(&found) => kept,
        _ => shell_quote(&own.to_string_lossy()),
    };
    format!("mishandle run {plan}")
}

fn read_run(name: &str, path: &Path, root: &Path) -> Result<RunResults, PaperError> {
    let store = |error| PaperError::from(MishandleError::from(error));
    let file = RunFile::open_unchecked(path).map_err(store)?;
    let header = file.header();
    let plan = Plan::from_toml(&header.plan)?;
    let record = Record::load(&ZooFolder::new(root), &plan.target, &plan.controller);
    let training = record.map_err(|error| PaperError::Zoo(Box::new(error)))?.and_then(|found| found.training);
    let build = [&header.build.target, &header.build.architecture];
    let facts = RunFacts {
        name: name.to_string(),
        plan: header.plan.clone(),
        formula: header.formula.clone(),
        formulas: header.formulas.iter().map(|formula| formula.name.clone()).collect(),
        axes: header.axes.iter().map(|axis| (axis.name.clone(), axis.unit.clone())).collect(),
        target_hash: header.target.hash.clone(),
        controller_hash: header.components.first().map_or(String::new(), |part| part.hash.clone()),
        commit: header.build.git_commit.clone(),
        build: build.map(String::as_str).join(", "),
        versions: header.versions.clone(),
        training_steps: training.and_then(|found| found.training_time).map(|time| time.control_steps),
    };
    let mut units = Vec::new();
    for trial in file.trials().map_err(store)? {
        let rows: Vec<Simulation> =
            file.trial_simulations(trial.trial.number).collect::<Result<_, _>>().map_err(store)?;
        units.extend(Unit::of_trial(&plan, &trial.trial, &rows));
    }
    let evaluation = match plan.evaluate {
        Some(_) => {
            let found = recorded_answer(&file, None)?.try_into().map_err(MishandleError::from)?;
            Some(EvaluationSummary::from(&found))
        }
        None => None,
    };
    Ok(RunResults { facts, plan, units, evaluation })
}

impl RunResults {
    /// Returns whether all trials of the plan have ended.
    pub fn is_complete(&self) -> bool {
        let trials = self.plan.falsify.as_ref().map_or(1, |falsify| falsify.trials as usize);
        self.ended().count() == self.trials().count() && self.trials().count() >= trials
    }

    /// Returns the first unit of each trial.
    pub fn trials(&self) -> impl Iterator<Item = &Unit> {
        self.units.iter().filter(|unit| unit.first == 1)
    }

    /// Returns the first unit of each trial that has ended.
    pub fn ended(&self) -> impl Iterator<Item = &Unit> {
        self.trials().filter(|unit| unit.status != TrialStatus::Running)
    }

    /// Returns the number of simulations of all trials.
    pub fn simulations(&self) -> usize {
        self.units.iter().map(|unit| unit.simulations as usize).sum()
    }

    /// Returns the number of violations of all trials.
    pub fn violations(&self) -> usize {
        self.units.iter().map(|unit| unit.violations as usize).sum()
    }

    /// Returns the units of the random simulations of an evaluation.
    pub fn random_units(&self) -> impl Iterator<Item = (&Unit, &Evaluated)> {
        self.units
            .iter()
            .filter(|unit| unit.trial == 1)
            .filter_map(|unit| Some((unit, unit.evaluated.as_ref()?)))
    }
}

impl From<&Evaluation> for EvaluationSummary {
    fn from(found: &Evaluation) -> EvaluationSummary {
        let points = found.corners.iter().flat_map(|corners| &corners.points);
        let tested: Vec<&CornerPoint> = points.filter(|point| point.has_verdict()).collect();
        EvaluationSummary {
            dangerous_behavior_rate: found.metrics.dangerous_behavior_rate,
            task_completion_time: found.metrics.task_completion_time,
            failing_corners: tested.iter().filter(|point| point.successes < point.n).count() as u32,
            corners: tested.len() as u32,
        }
    }
}

impl RunFacts {
    /// Returns whether the target has a formula of this name.
    pub(crate) fn has_formula(&self, name: &str) -> bool {
        self.formulas.iter().any(|formula| formula == name)
    }
}
