//! Early stopping changes neither the points of a search nor the trials that it falsifies.

use std::ops::ControlFlow;

use mishandle::plan::FalsifyPlan;
use mishandle::run::{Engine, ask};
use mishandle::search::SEARCHES;
use mishandle::store::{RunFile, Simulation, SimulationEnd};
use mishandle::{Plan, ResolvedPlan};
use tempfile::TempDir;

/// Returns the simulations of a campaign.
fn simulations(folder: &TempDir, task: &str, search: &str, early_stopping: bool) -> Vec<Simulation> {
    let falsify = FalsifyPlan {
        search: search.to_string(),
        trials: 1,
        budget: 30,
        early_stopping,
        ..FalsifyPlan::default()
    };
    let plan = Plan { action_noise: 0.5, seed: 2, falsify: Some(falsify), ..Plan::new(task, "ppo") };
    let resolved = ResolvedPlan::new(&plan).unwrap();
    let path = folder.path().join(format!("{task}-{search}-{early_stopping}.sqlite"));
    let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
    ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    let run = RunFile::open(&path).unwrap();
    let found: Vec<Simulation> = run.simulations().map(Result::unwrap).collect();
    let last = found.last().unwrap();
    let replayed = mishandle::replay::replay(&run, last.trial, last.number, None).unwrap();
    assert_eq!(replayed.differences, Vec::<String>::new(), "{task} {search}");
    found
}

/// The formula of ball balancing ends at step 200 of 300, that of ball pushing holds once the ball
/// is near the hole.
#[test]
#[ignore = "long"]
fn every_search_proposes_the_same_points_and_robustness_is_bounded() {
    let folder = tempfile::tempdir().unwrap();
    // A search knows no task. Those of the second task do not look at robustness.
    let searches = SEARCHES.iter().map(|entry| ("ball-balancing", entry.name));
    for (task, search) in searches.chain(["random", "sobol", "corners"].map(|name| ("ball-pushing", name))) {
        let whole = simulations(&folder, task, search, false);
        let early = simulations(&folder, task, search, true);
        assert_eq!(whole.len(), early.len(), "{task} {search}");
        for (whole, early) in whole.iter().zip(&early) {
            let place = format!("{task} {search} simulation {} of trial {}", early.number, early.trial);
            assert_eq!((&whole.scenario, &whole.unit_point), (&early.scenario, &early.unit_point), "{place}");
            let [low, exact, high] =
                [early.robustness_low, whole.robustness, early.robustness_high].map(Option::unwrap);
            assert!(low <= exact && exact <= high, "{place}: {low} {exact} {high}");
            assert!(low == high || low > early.stop_threshold.unwrap(), "{place}");
            assert_eq!(matches!(early.end, SimulationEnd::Stopped { .. }), early.steps < 300, "{place}");
            assert_eq!(early.robustness, early.robustness_low, "{place}");
        }
        let steps = |rows: &[Simulation]| rows.iter().map(|row| row.steps).sum::<u32>();
        assert!(steps(&early) < steps(&whole), "{task} {search}");
    }
}
