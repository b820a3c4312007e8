//! The memory that a comparison takes for each pair of simulations.

#![cfg(target_os = "linux")] // where a process can read its peak memory

use std::ops::ControlFlow;
use std::path::Path;

use mishandle::inspect::compare;
use mishandle::plan::EvaluatePlan;
use mishandle::run::{Engine, ask, create_run};
use mishandle::store::{RunFile, Simulation, TrialStatus};
use mishandle::{Plan, ResolvedPlan};

use crate::own_process::own_process;

/// Creates the run of an evaluation.
fn resolved(episodes: u64) -> ResolvedPlan {
    let table = EvaluatePlan { episodes, corners: false, control: false, ..EvaluatePlan::default() };
    ResolvedPlan::new(&Plan { evaluate: Some(table), ..Plan::new("toy/sphere-2d", "") }).unwrap()
}

/// Returns a recorded simulation.
fn template(folder: &Path) -> Simulation {
    let resolved = resolved(1);
    let path = folder.join("template.sqlite");
    let run = create_run(&resolved, Some(&path)).unwrap();
    ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    RunFile::open(&path).unwrap().simulation(1, 1).unwrap()
}

/// Writes an evaluation whose simulation i has the robustness i % 7 - `less`.
fn write(path: &Path, template: &Simulation, simulations: u32, less: f64) -> RunFile {
    let mut run = create_run(&resolved(simulations.into()), Some(path)).unwrap();
    run.start_trial(1, 0).unwrap();
    let row = |number: u32| {
        let rho = Some(f64::from(number % 7) - less);
        let verdicts = template.verdicts.iter().map(|verdict| verdict.and(rho)).collect();
        let seed = u64::from(number);
        Simulation {
            number,
            seed,
            robustness: rho,
            robustness_low: rho,
            robustness_high: rho,
            verdicts,
            trace: None,
            ..template.clone()
        }
    };
    for first in (1..=simulations).step_by(1000) {
        run.record(&(first..first + 1000).map(row).collect::<Vec<_>>()).unwrap();
    }
    run.end_trial(1, TrialStatus::BudgetSpent).unwrap();
    run.close().unwrap();
    RunFile::open(path).unwrap()
}

#[test]
fn a_pair_takes_less_than_64_bytes() {
    own_process("compare_memory::a_pair_takes_less_than_64_bytes", || {
        let folder = tempfile::tempdir().unwrap();
        let template = template(folder.path());
        let pairs = 200_000;
        let a = write(&folder.path().join("a.sqlite"), &template, pairs, 0.0);
        let b = write(&folder.path().join("b.sqlite"), &template, pairs, 1.0);
        let before = peak_bytes();
        let found = compare(&a, &b, |_| String::new()).unwrap();
        let bytes = (peak_bytes() - before) / u64::from(pairs);
        assert!(bytes < 64, "{bytes} bytes for each pair");
        assert_eq!((found.pairs, found.robustness.difference.value), (pairs.into(), Some(-1.0)));
        // A document of a million failures would be larger than both run files.
        assert_eq!((found.new_failures.len(), found.changes()), (10_000, [u64::from(pairs / 7), 0]));
    });
}

fn peak_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB"));
    peak.unwrap().parse::<u64>().unwrap() * 1024
}
