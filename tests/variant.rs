//! A variant of a task accepts the controllers of its base task.

use std::borrow::Cow;
use std::sync::{Arc, LazyLock, Once};

use mishandle::plan::{EvaluatePlan, StartRegion};
use mishandle::rollout::Controller;
use mishandle::shipped::shipped_controllers;
use mishandle::tasks::{Definition, Panda, Scene, Task};
use mishandle::world::{Model, WorldError};
use mishandle::{Plan, ResolvedPlan};

const BASE: &str = "ball-balancing";

fn base() -> &'static dyn Task {
    mishandle::resolve::task(BASE).unwrap()
}

static DEFINITION: LazyLock<Definition> = LazyLock::new(|| Definition {
    name: "ball-balancing-again",
    variant_of: Some(BASE),
    ..*base().definition()
});

struct Variant;

impl Task for Variant {
    fn definition(&self) -> &'static Definition {
        &DEFINITION
    }

    fn scene(&self) -> Cow<'static, str> {
        base().scene()
    }

    fn bind(&self, model: &Model, panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        base().bind(model, panda)
    }

    fn reachable(&self, x0: &[f64]) -> bool {
        x0[0] < 0.35
    }

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        base().expert()
    }
}

/// Registers the variant once for all tests.
fn add_variant() {
    static ADDED: Once = Once::new();
    ADDED.call_once(|| mishandle::tasks::add(&Variant).unwrap());
}

#[test]
fn a_variant_has_the_controllers_of_its_base_task() {
    add_variant();
    assert_eq!(shipped_controllers(&DEFINITION), shipped_controllers(base().definition()));
    let hash =
        |task: &str| mishandle::resolve::target(&Plan::new(task, "ppo")).unwrap().components[0].hash.clone();
    assert_eq!(hash(DEFINITION.name), hash(BASE));
    // A controller of another task is an error.
    let other = concat!(env!("CARGO_MANIFEST_DIR"), "/controllers/ball-pushing/ppo.safetensors");
    let error = mishandle::resolve::target(&Plan::new(DEFINITION.name, other)).err().unwrap().to_string();
    assert!(error.contains("ball-pushing"), "{error}");
}

#[test]
fn only_unreachable_initial_states_are_excluded() {
    add_variant();
    let excludes = |task: &str, starts| {
        let evaluate = EvaluatePlan { episodes: 20, starts, ..EvaluatePlan::default() };
        let plan = Plan { evaluate: Some(evaluate), ..Plan::new(task, "expert") };
        mishandle::run::rejects_scenarios(&ResolvedPlan::new(&plan).unwrap())
    };
    // Half of the variant's box is reachable. The probability that all 20 initial states are
    // reachable is 1e-6.
    assert!(excludes(DEFINITION.name, StartRegion::Reachable));
    assert!(!excludes(DEFINITION.name, StartRegion::Whole));
    assert!(!excludes(BASE, StartRegion::Reachable));
}
