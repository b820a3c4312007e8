//! The search for failures: several searches, random scenarios, and the corners of the box.

use std::path::Path;

use mishandle_rollout::Seed;
use mishandle_store::RunFile;

use super::Watch;
use super::archive::Simulated;
use super::folder::{Asked, Folder};
use super::measure::path_of;
use crate::error::MishandleError;
use crate::inspect::failure_modes;
use crate::plan::{EvaluatePlan, FalsifyPlan, HardenPlan, Plan};

/// The runs of all searches.
pub(super) struct Searched {
    runs: Vec<Asked>,
}

/// Looks for failures of a controller in the space. The run files have names that begin with
/// `prefix`. Returns `None` if it was interrupted.
///
/// # Errors
/// If a search is unknown, or a simulation cannot be run or stored.
pub(super) fn search(
    folder: &Folder,
    (base, table): (&Plan, &HardenPlan),
    controller: &Path,
    (prefix, seed): (&Path, Seed),
    phase: &str,
    watch: Watch<'_>,
) -> Result<Option<Searched>, MishandleError> {
    let controller = controller.to_string_lossy().into_owned();
    let plan =
        |seed: Seed| Plan { controller: controller.clone(), seed: seed.0, harden: None, ..base.clone() };
    let evaluate = EvaluatePlan { episodes: table.budget.into(), ..EvaluatePlan::default() };
    let mut plans = vec![("corners".to_string(), Plan { evaluate: Some(evaluate), ..plan(seed.child(0)) })];
    for (number, name) in (1..).zip(&table.searches) {
        let falsify = FalsifyPlan {
            search: name.clone(),
            trials: 1,
            budget: table.budget,
            keep_going: true,
            new_mode_rate: 0.0,
            isolate: Some(false),
            ..FalsifyPlan::default()
        };
        plans.push((name.clone(), Plan { falsify: Some(falsify), ..plan(seed.child(number)) }));
    }
    let mut runs = Vec::new();
    for (name, plan) in plans {
        let path = path_of(prefix, &name);
        match folder.ask(&plan, &path, &format!("{phase}: {name}"), &mut *watch)? {
            Some(asked) => runs.push(asked),
            None => return Ok(None),
        }
    }
    Ok(Some(Searched { runs }))
}

/// A failure mode of a search: the decisive predicate, and the names of the axes of its failures.
pub(super) type ModeKey = (String, Vec<String>);

/// Failure modes with the numbers of their failures.
pub(super) type Modes = Vec<(ModeKey, u64)>;

impl Searched {
    /// Returns all simulations with a verdict, and the failure modes with the numbers of their
    /// failures.
    ///
    /// # Errors
    /// If a run cannot be read.
    pub fn simulated(&self) -> Result<(Vec<Simulated>, Modes), MishandleError> {
        let runs = self.runs.iter().map(Asked::run).collect::<Result<Vec<_>, _>>()?;
        simulated(&runs)
    }

    /// Returns the number of simulations.
    ///
    /// # Errors
    /// If a run cannot be read.
    pub fn simulations(&self) -> Result<u64, MishandleError> {
        self.runs.iter().map(|asked| Ok(asked.run()?.counts()?.simulations)).sum()
    }
}

/// Returns all simulations of runs with a verdict, and the failure modes with the numbers of their
/// failures. A mode of one run is the same in another one.
///
/// # Errors
/// If a run cannot be read.
pub(super) fn simulated(runs: &[RunFile]) -> Result<(Vec<Simulated>, Modes), MishandleError> {
    let (mut simulated, mut modes) = (Vec::new(), Modes::new());
    for run in runs {
        let names = |axes: &[usize]| axes.iter().map(|axis| run.header().axes[*axis].name.clone()).collect();
        let mut mode_of = Vec::new();
        for mode in &failure_modes(run)?.modes {
            let key = (mode.representative().predicate.clone(), names(&mode.axes));
            let index = modes.iter().position(|(known, _)| *known == key).unwrap_or_else(|| {
                modes.push((key, 0));
                modes.len() - 1
            });
            modes[index].1 += mode.failures.len() as u64;
            mode_of.extend(mode.failures.iter().map(|failure| ((failure.trial, failure.number), index)));
        }
        simulated.extend(rows(run, &mode_of)?);
    }
    Ok((simulated, modes))
}

fn rows(run: &RunFile, mode_of: &[((u32, u32), usize)]) -> Result<Vec<Simulated>, MishandleError> {
    let mut found = Vec::new();
    for simulation in run.simulations() {
        let simulation = simulation?;
        let Some(robustness) = simulation.robustness else { continue };
        let place = (simulation.trial, simulation.number);
        let mode = mode_of.iter().find(|(known, _)| *known == place).map(|(_, mode)| *mode);
        found.push(Simulated { scenario: simulation.scenario, seed: simulation.seed, robustness, mode });
    }
    Ok(found)
}
