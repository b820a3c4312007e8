//! Bisections that are interrupted and continued.

use std::ops::ControlFlow;
use std::path::Path;

use mishandle::Plan;
use mishandle::bisect::{BisectionPlan, BisectionProgress, BisectionTest, bisect, finished};
use mishandle::plan::EvaluatePlan;
use mishandle::results::Bisection;

fn plan(folder: &Path) -> BisectionPlan {
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/controllers/point-reaching/ppo.safetensors");
    let steps = folder.join("steps");
    std::fs::create_dir_all(&steps).unwrap();
    for step in 1..=2 {
        std::fs::copy(shipped, steps.join(format!("step-{step}.safetensors"))).unwrap();
    }
    let evaluate = EvaluatePlan { episodes: 200, batch: 8, ..EvaluatePlan::default() };
    let asked = Plan { evaluate: Some(evaluate), ..Plan::new("point-reaching", "") };
    BisectionPlan {
        controllers: steps,
        test: BisectionTest::rate(asked, 0.9).unwrap(),
        every: false,
        folder: folder.join("bisect"),
        command: String::new(),
    }
}

#[test]
fn an_interrupted_bisection_continues_in_the_middle_of_a_candidate() {
    let whole = tempfile::tempdir().unwrap();
    let part = tempfile::tempdir().unwrap();
    let whole = bisect(&plan(whole.path()), &mut |_| ControlFlow::Continue(())).unwrap();
    let plan = plan(part.path());
    // Number of simulations of the second candidate.
    let second = |progress: BisectionProgress<'_>| {
        Some(progress.simulations.0).filter(|_| progress.candidate.name == "step-2.safetensors")
    };
    let mut interrupted_at = None;
    let found = bisect(&plan, &mut |progress| {
        interrupted_at = interrupted_at.or(second(progress).filter(|done| *done > 0));
        if interrupted_at.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    let found = found.unwrap();
    assert_eq!((found.is_complete, found.tested.len()), (false, 1));
    assert_eq!(finished(&plan.folder).unwrap().unwrap(), found);
    let mut continued_at = None;
    let found = bisect(&plan, &mut |progress| {
        continued_at = continued_at.or(second(progress));
        ControlFlow::Continue(())
    });
    let found = found.unwrap();
    assert_eq!(continued_at, interrupted_at);
    let facts = |found: &Bisection| {
        found.tested.iter().map(|one| (one.result, one.success_rate, one.simulations)).collect::<Vec<_>>()
    };
    assert_eq!((facts(&found), &found.verdict), (facts(&whole), &whole.verdict));
    assert_eq!(finished(&plan.folder).unwrap().unwrap(), found);
}
