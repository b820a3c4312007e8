//! Results of campaigns: the facts of each run, its trials and all its simulations.

use std::path::Path;

use mishandle::Plan;
use mishandle::evaluation::{FormulaRoles, MetricCounter, Metrics};
use mishandle::rollout::Seed;
use mishandle::run::{campaign_runs, recorded_episode};
use mishandle::store::{RunFile, RunKind, Simulation, TrialRecord, TrialStatus};
use mishandle_text::shell_quote;
use serde::{Deserialize, Serialize};

use crate::{PaperError, training_steps};

/// Results of several campaigns, and where they come from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Results {
    /// Date of the results; empty for campaigns that were not collected.
    pub date: String,
    /// The machine.
    pub machine: String,
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
    /// The started trials.
    pub trials: Vec<TrialRecord>,
    /// The simulations, by trial and number. Unit points, bounds of the robustness, trace
    /// digests and traces are left out; the robustness of a simulation that did not complete its episode is a bound.
    pub simulations: Vec<Simulation>,
}

/// Subject of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
    /// Merges campaigns of the same name, so that parts of a campaign that ran at different times become one. The runs keep
    /// their order. A run that two parts have with the same rows is kept once.
    ///
    /// # Errors
    /// Two parts contain a run of the same name with different rows or facts.
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
    /// Reads the run files of a campaign, which may be incomplete. `root`, the repository, has the training times of
    /// shipped controllers.
    ///
    /// # Errors
    /// If the folder has no campaign, or a file cannot be read.
    pub fn read(folder: &Path, root: &Path) -> Result<CampaignResults, PaperError> {
        let name = folder.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        let runs = campaign_runs(folder)?
            .iter()
            .map(|run| read_run(&run.name, &run.path, root))
            .collect::<Result<Vec<RunResults>, PaperError>>()?;
        let plan = format!("experiments/paper/{name}.toml");
        let plan = if root.join(&plan).is_file() {
            plan
        } else {
            shell_quote(&folder.join("campaign.toml").to_string_lossy())
        };
        Ok(CampaignResults { command: format!("mishandle campaign {plan}"), name, runs })
    }
}

fn read_run(name: &str, path: &Path, root: &Path) -> Result<RunResults, PaperError> {
    let store = |error| PaperError::from(mishandle::MishandleError::from(error));
    let file = RunFile::open_unchecked(path).map_err(store)?;
    let header = file.header();
    let plan = Plan::from_toml(&header.plan)?;
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
        training_steps: training_steps(root, &plan.target, &plan.controller)?,
    };
    let is_falsification = header.kind == RunKind::Falsify;
    let row = |row: mishandle::store::Result<Simulation>| {
        row.map(|row| Simulation {
            unit_point: Vec::new(),
            robustness_low: None,
            robustness_high: None,
            stop_threshold: None,
            trace_digest: None,
            // The verdict of a falsification is its robustness.
            verdicts: if is_falsification { Vec::new() } else { row.verdicts },
            ..row
        })
    };
    let trials = file.trials().map_err(store)?.into_iter().map(|trial| trial.trial).collect();
    let simulations = file.simulations().map(row).collect::<Result<_, _>>().map_err(store)?;
    Ok(RunResults { facts, plan, trials, simulations })
}

impl RunResults {
    /// Returns whether all trials of the plan have ended.
    pub fn is_complete(&self) -> bool {
        let trials = self.plan.falsify.as_ref().map_or(1, |falsify| falsify.trials as usize);
        self.ended().count() == self.trials.len() && self.trials.len() >= trials
    }

    /// Returns the trials that have ended.
    pub fn ended(&self) -> impl Iterator<Item = &TrialRecord> {
        self.trials.iter().filter(|trial| trial.status != TrialStatus::Running)
    }

    /// Returns the simulations of a trial.
    pub fn simulations_of(&self, trial: u32) -> impl Iterator<Item = &Simulation> {
        self.simulations.iter().filter(move |simulation| simulation.trial == trial)
    }

    /// Returns the metrics of the first `n` random simulations of an evaluation.
    pub fn metrics(&self, n: usize) -> Metrics {
        let has = |name: &str| self.facts.formulas.iter().any(|formula| formula == name);
        let roles = FormulaRoles { strict: has("strict"), safe: has("safe"), completion: has("completion") };
        let counts_failures = self.plan.preset == "code";
        let mut metrics = MetricCounter::new(roles).with_completion_times_of_failures(counts_failures);
        self.simulations_of(1).take(n).for_each(|simulation| metrics.add(&recorded_episode(simulation)));
        metrics.report(Seed(self.plan.seed))
    }

    /// Returns the seed that the plan gives a simulation of trial `trial` with the seed `seed`.
    pub(crate) fn planned_seed(&self, trial: &TrialRecord, number: u32) -> u64 {
        // Simulation m of a search has child m, because child 0 is the seed of the search; an evaluation has no search.
        let child = if self.plan.falsify.is_some() { number } else { number.wrapping_sub(1) };
        Seed(trial.seed).child(child.into()).0
    }
}
