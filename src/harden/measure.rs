//! The measures of a controller: what validations and the final comparison simulate.

use std::path::{Path, PathBuf};

use mishandle_results::{EndCounts, Evaluation};
use mishandle_rollout::Seed;
use mishandle_text::path_text;

use super::decision::{CornerCounts, Measure, failure_bound};
use super::folder::Asked;
use super::{Hardener, Watch};
use crate::error::MishandleError;
use crate::inspect::compare;
use crate::plan::{EvaluatePlan, Plan};
use crate::resolve::STARTS;

/// Standard deviation of the action noise of the measure `noise`, as in the benchmark.
const ACTION_NOISE: f64 = 0.5;

/// Number of evaluations of a controller: the fields of [`Measured`].
pub(super) const SPACES: u64 = 3;

/// Evaluations of a controller.
pub(super) struct Measured {
    /// From random starts.
    starts: Asked,
    /// From random starts, with action noise.
    noise: Asked,
    /// In the space.
    space: Asked,
}

/// Evaluates a controller. The run files have names that begin with `prefix`. Returns `None` if it
/// was interrupted.
///
/// # Errors
/// If a simulation cannot be run or stored.
pub(super) fn measure(
    hardener: &Hardener<'_>,
    controller: &Path,
    prefix: &Path,
    seed: Seed,
    episodes: u64,
    phase: &str,
    watch: Watch<'_>,
) -> Result<Option<Measured>, MishandleError> {
    let Hardener { plan: base, folder, .. } = *hardener;
    let plan = |space: &str, action_noise: f64| Plan {
        space: space.to_string(),
        axes: if space == base.space { base.axes.clone() } else { Default::default() },
        action_noise,
        controller: path_text(controller),
        seed: seed.0,
        evaluate: Some(EvaluatePlan { episodes, control: false, ..EvaluatePlan::default() }),
        harden: None,
        ..base.clone()
    };
    let mut ask = |plan: Plan, name: &str| {
        let path = path_of(prefix, name);
        folder.ask(&plan, &path, &format!("{phase}: {name}"), &mut *watch)
    };
    let Some(starts_asked) = ask(plan(STARTS, base.action_noise), "starts")? else {
        return Ok(None);
    };
    let Some(noise) = ask(plan(STARTS, ACTION_NOISE), "noise")? else { return Ok(None) };
    let Some(space) = ask(plan(&base.space, base.action_noise), "space")? else { return Ok(None) };
    Ok(Some(Measured { starts: starts_asked, noise, space }))
}

/// Returns the path of a run file whose name begins with that of `prefix`.
pub(super) fn path_of(prefix: &Path, name: &str) -> PathBuf {
    let stem = prefix.file_name().unwrap_or_default().to_string_lossy();
    prefix.with_file_name(format!("{stem}-{name}.sqlite"))
}

impl Measured {
    /// Returns the upper bound of the failure rate in the space.
    ///
    /// # Errors
    /// If the evaluation has no rates.
    pub fn bound(&self) -> Result<f64, MishandleError> {
        Ok(failure_bound(&self.evaluation(&self.space)?.metrics.success_rate))
    }

    /// Returns how the random simulations in the space ended.
    pub fn ends(&self) -> EndCounts {
        self.space.answer.without_verdict().ends
    }

    /// Returns the commit of the program that simulated them. Another one may read them later.
    ///
    /// # Errors
    /// If the run file cannot be read.
    pub fn commit(&self) -> Result<String, MishandleError> {
        Ok(self.space.run()?.header().build.git_commit.clone())
    }

    /// Returns the hash of the file of the controller.
    ///
    /// # Errors
    /// If the run file cannot be read.
    pub fn file_hash(&self) -> Result<String, MishandleError> {
        let run = self.space.run()?;
        Ok(run.header().components.first().map_or(String::new(), |component| component.file_hash.clone()))
    }

    fn evaluation(&self, asked: &Asked) -> Result<Evaluation, MishandleError> {
        Ok(asked.answer.clone().try_into()?)
    }

    /// Returns the corners of the initial box, and at how many of them all simulations succeed.
    ///
    /// # Errors
    /// If the evaluation has no result.
    fn corners(&self) -> Result<Option<[u64; 2]>, MishandleError> {
        let corners = self.evaluation(&self.starts)?.corners;
        Ok(corners.map(|corners| [corners.n, corners.succeeding]))
    }

    /// Compares this controller with another one on the same scenarios and seeds. A controller that
    /// is compared with itself gives its own rates.
    ///
    /// # Errors
    /// If the run files cannot be read.
    pub fn compare(&self, other: &Measured) -> Result<(Vec<Measure>, Option<CornerCounts>), MishandleError> {
        let compared = |a: &Asked, b: &Asked| compare(&a.run()?, &b.run()?, |_| String::new());
        let space = compared(&self.space, &other.space)?;
        let starts = compared(&self.starts, &other.starts)?;
        let noise = compared(&self.noise, &other.noise)?;
        let found = [
            ("space", Some(space.success)),
            ("success", Some(starts.success)),
            ("strict", starts.strict_success),
            ("careful", starts.careful_success),
            ("noise", Some(noise.success)),
        ];
        let measures = found.into_iter().filter_map(|(name, rates)| Some(Measure { name, rates: rates? }));
        let corners = match (self.corners()?, other.corners()?) {
            (Some([all, first]), Some([_, second])) => Some(CornerCounts { all, first, second }),
            _ => None,
        };
        Ok((measures.collect(), corners))
    }
}
