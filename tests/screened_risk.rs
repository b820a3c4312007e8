//! A failure probability from screened simulations is that of Monte Carlo, if the engines agree or every simulation is repeated.

#![allow(clippy::unwrap_used)]

use std::ops::ControlFlow;

use mishandle::world::{Backend, BatchBuffers, BatchSpec, CpuBackend, WorldBatch, WorldError};
use mishandle::{Plan, ResolvedPlan, RiskPlan};

fn resolved() -> ResolvedPlan {
    let risk = RiskPlan {
        // The controller meets this bound in a part of the simulations.
        formula: Some("always[50:300](finger_target_distance <= 0.008)".to_string()),
        simulations: 100,
        method: "monte-carlo".to_string(),
        ..RiskPlan::default()
    };
    let plan = Plan { action_noise: 0.3, seed: 4, risk: Some(risk), ..Plan::new("point-reaching", "ppo") };
    ResolvedPlan::new(&plan).unwrap()
}

fn screened(backend: &dyn Backend, sample_rate: f64) -> mishandle::risk::ScreenedReport {
    let resolved = resolved();
    let scenarios = mishandle::risk_scenarios(&resolved).unwrap();
    let mut screening = mishandle::screening(&resolved, backend, 24).unwrap();
    mishandle::risk_on_backend(&resolved, &scenarios, &mut screening, sample_rate, &mut |_| {
        ControlFlow::Continue(())
    })
    .unwrap()
}

#[test]
fn an_engine_with_the_bits_of_the_system_flags_exactly_the_failures() {
    let report = mishandle::risk(&resolved(), |_| ControlFlow::Continue(())).unwrap();
    let failures = report.monte_carlo.failures;
    assert!((5..95).contains(&failures), "{failures} failures: the test needs both outcomes");
    let counts = screened(&CpuBackend, 0.3).counts;
    assert_eq!((counts.trials, counts.flagged, counts.flagged_events), (100, failures, failures));
    assert!(counts.sampled > 0);
    assert_eq!(counts.sampled_events, 0);
}

/// An engine that reports every row as diverged, or moves the robot without regard to its targets.
struct Wrong(bool);

struct WrongWorlds(Box<dyn WorldBatch>, bool);

impl Backend for Wrong {
    fn batch(&self, spec: &BatchSpec) -> Result<Box<dyn WorldBatch>, WorldError> {
        Ok(Box::new(WrongWorlds(CpuBackend.batch(spec)?, self.0)))
    }
}

impl WorldBatch for WrongWorlds {
    fn write_states(&mut self, rows: &[usize], states: &[f64]) -> Result<(), WorldError> {
        self.0.write_states(rows, states)
    }

    fn buffers(&mut self) -> BatchBuffers<'_> {
        self.0.buffers()
    }

    fn step(&mut self) -> Result<(), WorldError> {
        if !self.1 {
            self.0.buffers().targets.fill(0.1);
            return self.0.step();
        }
        self.0.step()?;
        self.0.buffers().outputs.fill(1.0);
        Ok(())
    }
}

#[test]
fn a_wrong_engine_changes_the_effort_but_not_the_answer() {
    let failures = mishandle::risk(&resolved(), |_| ControlFlow::Continue(())).unwrap().monte_carlo.failures;
    for is_diverging in [false, true] {
        let report = screened(&Wrong(is_diverging), 1.0);
        let counts = report.counts;
        assert_eq!(counts.flagged + counts.sampled, 100);
        assert_eq!(counts.flagged_events + counts.sampled_events, failures);
        assert_eq!(report.screened_without_verdict, if is_diverging { 100 } else { 0 });
        assert!((report.estimate().value.unwrap() - failures as f64 / 100.0).abs() < 1e-12);
    }
}
