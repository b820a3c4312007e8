use mishandle_results::{Replay, Seed};
use mishandle_stl::is_violated;
use mishandle_store::RunFile;

use crate::replay::ReplayResult;
use crate::resolve::guard::recorded_guard;
use crate::run::{box_point, end_text, given, recorded_axes, recorded_scenario};

impl ReplayResult {
    /// Returns the replay of a simulation of `run` as a result.
    pub fn result(&self, run: &RunFile) -> Replay {
        let header = run.header();
        let recorded = &self.recorded;
        let episode = &self.episode;
        let signals: Vec<&str> = header.signals.iter().map(|signal| signal.name.as_str()).collect();
        Replay {
            run: run.path().to_string_lossy().into_owned(),
            target: header.target.name.clone(),
            guard: recorded_guard(header),
            space: header.space.clone(),
            axes: header.axes.iter().map(|axis| axis.name.clone()).collect(),
            trial: recorded.trial,
            simulation: recorded.number,
            point: box_point(header, recorded.trial, &recorded.scenario),
            initial_configuration: recorded.scenario.clone(),
            scenario: recorded_scenario(&header.axes, &recorded.scenario),
            seed: Seed(recorded.seed),
            end: end_text(episode.end, &signals),
            reason: given(&recorded.reason).or_else(|| given(&episode.reason)),
            steps: episode.steps as u64,
            robustness: episode.robustness().map(Into::into),
            violated: episode.robustness().map(is_violated),
            same: self.differences.is_empty(),
            differences: self.differences.clone(),
            formula: header.formula.clone(),
            has_verdict: episode.end.has_verdict(),
            space_axes: recorded_axes(&header.axes),
        }
    }
}
