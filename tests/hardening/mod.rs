//! Shared parts of the tests of hardenings.

use std::collections::BTreeSet;
use std::ops::ControlFlow;

use mishandle::harden::HardenProgress;
use mishandle::plan::HardenPlan;
use mishandle::results::Hardening;

/// Watches a hardening and decides whether it continues.
pub type Watch<'a> = &'a mut (dyn FnMut(&HardenProgress) -> ControlFlow<()> + Send);

/// A hardening of few simulations and steps.
pub fn few() -> HardenPlan {
    HardenPlan {
        rounds: 1,
        steps: 512,
        searches: vec!["random".to_string()],
        budget: 12,
        validation: 12,
        episodes: 12,
        risk: 100,
        margin: 20,
        ..HardenPlan::default()
    }
}

/// Stops a hardening at the first report of each phase, and calls it again. It gets whether the
/// call is the first one.
pub fn in_parts(mut harden: impl FnMut(bool, Watch<'_>) -> Option<Hardening>) -> Hardening {
    let mut stopped = BTreeSet::new();
    let mut stop_once = |progress: &HardenProgress| {
        if stopped.insert(progress.phase.clone()) {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    };
    for calls in 0..100 {
        if let Some(found) = harden(calls == 0, &mut stop_once) {
            assert!(calls > 4, "{calls} interruptions");
            return found;
        }
    }
    panic!("it does not end");
}

/// Returns a result without the paths, which differ between hardenings.
pub fn without_paths(mut found: Hardening) -> Hardening {
    found.folder = String::new();
    found.after = found.after.map(|_| String::new());
    found
}
