//! Simulations of a page that a file keeps.

use std::ops::ControlFlow;

use mishandle::plan::FalsifyPlan;
use mishandle::rollout::{Episode, Request, Seed};
use mishandle::run::{Engine, KeptSimulations, ask, create_run};
use mishandle::store::{IfExists, RunFile, RunWriter, Simulation};
use mishandle::{Plan, ResolvedPlan};
use mishandle_report::{Measurement, RunReport, Samples, page};

fn plan() -> ResolvedPlan {
    let falsify = FalsifyPlan { trials: 2, budget: 20, ..FalsifyPlan::default() };
    ResolvedPlan::new(&Plan { falsify: Some(falsify), ..Plan::new("toy/sphere-2d", "") }).unwrap()
}

#[test]
fn recorded_simulations_are_not_repeated_unless_something_else_is_asked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite.report");
    let resolved = plan();
    let requests: Vec<Request> =
        (1_u32..=3).map(|x| Request::new([0.1 * f64::from(x), 0.5], Seed(x.into()))).collect();
    let robustness = |episodes: Vec<Episode>| episodes.iter().map(Episode::robustness).collect::<Vec<_>>();
    let ask = |asks: &str, requests: &[Request]| {
        let kept = KeptSimulations::open(&resolved, &path, asks.to_string()).unwrap();
        let found = robustness(kept.system().rollout(requests).unwrap());
        let answered = kept.answered();
        kept.close().unwrap();
        (found, answered)
    };
    let direct = robustness(resolved.system().unwrap().rollout(&requests).unwrap());
    assert_eq!(ask("a", &requests[..2]), (direct[..2].to_vec(), 0));
    assert_eq!(ask("a", &requests), (direct.clone(), 2));
    assert_eq!(ask("b", &requests), (direct, 0));
}

#[test]
fn a_forged_file_of_kept_simulations_is_not_believed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite.report");
    let resolved = plan();
    let requests: Vec<Request> =
        (1_u32..=5).map(|x| Request::new([0.1 * f64::from(x), 0.5], Seed(x.into()))).collect();
    let robustness = |kept: &KeptSimulations<'_>| {
        let episodes = kept.system().rollout(&requests).unwrap();
        episodes.iter().map(Episode::robustness).collect::<Vec<_>>()
    };
    let kept = KeptSimulations::open(&resolved, &path, "a".to_string()).unwrap();
    let truth = robustness(&kept);
    kept.close().unwrap();
    // A file with the right header, in which every simulation passes clearly.
    let honest = RunFile::open(&path).unwrap();
    let rows: Vec<Simulation> = honest.trial_simulations(1).collect::<Result<_, _>>().unwrap();
    let forged = folder.path().join("forged.sqlite");
    let mut writer = RunWriter::create(&forged, honest.header(), IfExists::Refuse).unwrap();
    writer.start_trial(1, honest.trials().unwrap()[0].trial.seed).unwrap();
    let pass = |row| Simulation {
        robustness: Some(9.0),
        robustness_low: Some(9.0),
        robustness_high: Some(9.0),
        ..row
    };
    writer.record(&rows.into_iter().map(pass).collect::<Vec<_>>()).unwrap();
    writer.close().unwrap();
    std::fs::rename(&forged, &path).unwrap();
    let kept = KeptSimulations::open(&resolved, &path, "a".to_string()).unwrap();
    assert_eq!((robustness(&kept), kept.answered()), (truth, 0));
}

#[test]
fn an_interrupted_page_goes_on_to_the_same_page() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let resolved = plan();
    let run = create_run(&resolved, Some(&path)).unwrap();
    ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    let run = RunFile::open(&path).unwrap();
    let measured = |kept: bool, calls: u64| {
        let mut report = RunReport::load(&run, "run.sqlite", None, crate::data).unwrap();
        if kept {
            report.keep_in(folder.path().join("run.sqlite.report"));
        }
        let mut left = calls;
        let samples = Samples { probes: 8, sensitivity: 0, repeats: 0 };
        let end = report.measure(&run, None, samples, |_, _| {
            left = left.saturating_sub(1);
            if left > 0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        });
        (end.unwrap(), page(&[report]))
    };
    assert_eq!(measured(true, 20).0, Measurement::Interrupted);
    let (end, html) = measured(true, u64::MAX);
    assert_eq!(end, Measurement::Done);
    let (before, rest) = html.split_once("<li>").unwrap();
    let (note, after) = rest.split_once("</li>").unwrap();
    assert!(note.contains("simulations of this page were kept in a file beside the run"), "{note}");
    let without = format!("{before}{after}").replace("<ul class=\"notes\"></ul>\n", "");
    assert_eq!(without, measured(false, u64::MAX).1);
    assert!(html.contains("random scenarios of the whole space"), "the maps have scenarios of the page");
}
