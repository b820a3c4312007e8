use mishandle_stl::is_violated;
use std::path::Path;

use mishandle_results::{Replay, Seed};
use mishandle_text::path_text;

use crate::counterexample::{Counterexample, CounterexampleReplay};
use crate::resolve::guard::guard_facts;
use crate::run::{end_text, given, recorded_axes};

impl CounterexampleReplay {
    /// Returns the replay of a counterexample as a result. `path` is that of its file.
    pub fn result(&self, recorded: &Counterexample, path: &Path) -> Replay {
        let CounterexampleReplay { header, episode, differences, .. } = self;
        let signals: Vec<&str> = header.signals.iter().map(|signal| signal.name.as_str()).collect();
        let scenario = || recorded.scenario.iter();
        Replay {
            run: path_text(path),
            target: recorded.target.name.clone(),
            space: recorded.plan.space.clone(),
            axes: scenario().map(|axis| axis.axis.clone()).collect(),
            guard: recorded.plan.guard.as_ref().map(guard_facts),
            trial: recorded.trial,
            simulation: recorded.simulation,
            point: None,
            initial_configuration: scenario().map(|axis| axis.value).collect(),
            scenario: scenario().map(|axis| (axis.axis.clone(), axis.value)).collect(),
            seed: Seed(recorded.seed),
            end: end_text(episode.end, &signals),
            reason: given(&episode.reason),
            steps: episode.steps as u64,
            robustness: episode.robustness().map(Into::into),
            violated: episode.robustness().map(is_violated),
            same: differences.is_empty(),
            differences: differences.clone(),
            formula: header.formula.clone(),
            has_verdict: episode.end.has_verdict(),
            space_axes: recorded_axes(&header.axes),
        }
    }
}
