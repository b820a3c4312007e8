//! Processes that noise moves step by step, with known failure probabilities.

use std::sync::Arc;

use mishandle_risk::Scenarios;
use mishandle_rollout::{
    Axis, AxisKind, Distribution, Disturbance, Effect, Environment, EnvironmentFacts, EnvironmentWorker,
    Noise, Rollout, Sample, Scenario, Seed, Space, Specification, StepStatus, Stream,
};
use mishandle_stl::Formula;

use crate::function_controller::controller;

/// A process x' = f(x, z) from 0 whose noise z is standard normal, and the probability that it
/// violates a formula.
#[derive(Clone, Copy)]
pub struct Process {
    pub name: &'static str,
    /// From exact formulas, or from backward recursion over the steps: the program in
    /// studies/notebook/2026-11-27-risk-of-sequences.md.
    pub probability: f64,
    /// Number of steps, each with an axis for its noise.
    pub steps: usize,
    formula: &'static str,
    /// Next x from x, the noise and the observed sign r of the step.
    next: fn(f64, f64, f64) -> f64,
}

/// A sign that the seed draws for a step, and that the state shows.
fn sign(seed: f64, step: f64) -> f64 {
    if Seed(seed as u64).uniform(Stream::Reset, step as u64, 0) < 0.5 { -1.0 } else { 1.0 }
}

/// Upper quantiles of the standard normal distribution times √100: SciPy 1.17.1, `norm.isf`.
pub const PROCESSES: [Process; 10] = [
    Process {
        name: "end of a walk, 1e-6, 100 axes",
        probability: 1e-6,
        steps: 100,
        formula: "always[100:100](x <= 47.53424308822899)",
        next: |x, z, _| x + z,
    },
    Process {
        name: "walk to a barrier, 1e-4, 37 axes",
        probability: 9.999_344e-5,
        steps: 37,
        formula: "always(x <= 23.167)",
        next: |x, z, _| x + z,
    },
    Process {
        name: "walk to a barrier, 1e-6, 100 axes",
        probability: 9.997_533e-7,
        steps: 100,
        formula: "always(x <= 48.398)",
        next: |x, z, _| x + z,
    },
    Process {
        name: "walk to a barrier, 1e-7, 300 axes",
        probability: 9.998_489e-8,
        steps: 300,
        formula: "always(x <= 91.719)",
        next: |x, z, _| x + z,
    },
    Process {
        name: "walk to two barriers, 1e-6, 100 axes",
        probability: 1.000_038e-6,
        steps: 100,
        formula: "always(x <= 49.746 and x >= -49.746)",
        next: |x, z, _| x + z,
    },
    Process {
        name: "stable, barrier, 1e-5, 100 axes",
        probability: 1.000_859e-5,
        steps: 100,
        formula: "always(x <= 11.733)",
        next: |x, z, _| 0.9 * x + z,
    },
    Process {
        name: "stable, barrier, 1e-7, 300 axes",
        probability: 1.000_064e-7,
        steps: 300,
        formula: "always(x <= 14.078)",
        next: |x, z, _| 0.9 * x + z,
    },
    Process {
        name: "stable, two barriers, 1e-7, 300 axes",
        probability: 9.996_977e-8,
        steps: 300,
        formula: "always(x <= 14.332 and x >= -14.332)",
        next: |x, z, _| 0.9 * x + z,
    },
    Process {
        name: "sign of the noise is seen, 1e-6, 100 axes",
        probability: 1e-6,
        steps: 100,
        formula: "always[100:100](x <= 47.53424308822899)",
        next: |x, z, r| x + r * z,
    },
    Process {
        name: "noise leads away from 0, 1e-6, 100 axes",
        probability: 1e-6,
        steps: 100,
        // The distance from 0 is that of a walk: two tails of 5e-7.
        formula: "always[100:100](x <= 48.91638475698591 and x >= -48.91638475698591)",
        next: |x, z, _| if x < 0.0 { x - z } else { x + z },
    },
];

impl Process {
    /// Returns the system and the distribution of its scenarios.
    pub fn system(&self) -> (Rollout, Scenarios) {
        let axis = |step: usize| {
            let mut axis = Axis::new(AxisKind::Noise, &format!("draw_{step}"), "", [-9.0, 9.0], None);
            axis.distribution = Distribution::Normal;
            axis
        };
        let disturbances: Vec<Disturbance> = (0..self.steps)
            .map(|step| Disturbance {
                axis: axis(step),
                effect: Effect::ActionDraw { entry: 0, steps: step..step + 1 },
            })
            .collect();
        let space = Space::new("noise", disturbances.iter().map(|d| d.axis.clone()).collect()).unwrap();
        let specification = Specification::new(Formula::parse(self.formula).unwrap());
        let noise = Noise { action_std: 1.0, observation_std: 0.0 };
        let moving = Moving {
            facts: EnvironmentFacts {
                name: self.name.to_string(),
                space: Space::new("none", Vec::new()).unwrap(),
                signals: Arc::from(["x".to_string()]),
                reward_terms: Vec::new(),
                observation_size: 2,
                exact_size: 0,
                action_size: 1,
                action_limit: 1.0,
                state_size: 3,
                control_dt: 1.0,
                episode_steps: self.steps,
            },
            next: self.next,
        };
        let still = controller([2, 1, 0], |_, _, action| action.fill(0.0));
        let rollout = Rollout::new(Arc::new(moving), still, specification, noise).unwrap();
        let scenarios = Scenarios::new(&space, [], true).unwrap();
        (rollout.with_disturbances(space, &disturbances).unwrap(), scenarios)
    }
}

struct Moving {
    facts: EnvironmentFacts,
    next: fn(f64, f64, f64) -> f64,
}

impl Environment for Moving {
    fn facts(&self) -> &EnvironmentFacts {
        &self.facts
    }
    fn worker(&self) -> Box<dyn EnvironmentWorker> {
        Box::new(MovingWorker { next: self.next })
    }
}

struct MovingWorker {
    next: fn(f64, f64, f64) -> f64,
}

/// The state is x, the number of the next step and the seed of the signs.
fn show(state: &[f64], sample: &mut Sample<'_>) {
    sample.observation[0] = state[0] as f32;
    sample.observation[1] = sign(state[2], state[1]) as f32;
    sample.signals[0] = state[0];
}

impl EnvironmentWorker for MovingWorker {
    fn reset(&mut self, _: &Scenario, seed: Seed, state: &mut [f64], mut sample: Sample<'_>) -> StepStatus {
        state.copy_from_slice(&[0.0, 0.0, (seed.0 >> 16) as f64]);
        show(state, &mut sample);
        StepStatus::Running
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], mut sample: Sample<'_>) -> StepStatus {
        state[0] = (self.next)(state[0], action[0], sign(state[2], state[1]));
        state[1] += 1.0;
        show(state, &mut sample);
        StepStatus::Running
    }
}
