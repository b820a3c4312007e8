//! A variant of a task takes the controllers of the task that it varies.

#![allow(clippy::unwrap_used)]

use std::borrow::Cow;
use std::sync::{Arc, LazyLock, Once};

use mishandle::rollout::Controller;
use mishandle::tasks::{Definition, Panda, Scene, Task};
use mishandle::world::{Model, WorldError};
use mishandle::{EvaluatePlan, Plan, ResolvedPlan, StartRegion, shipped_controllers};

const BASE: &str = "ball-balancing";

fn base() -> &'static dyn Task {
    mishandle::task(BASE).unwrap()
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

/// Makes the variant known, once for all tests.
fn add_variant() {
    static ADDED: Once = Once::new();
    ADDED.call_once(|| mishandle::tasks::add(&Variant).unwrap());
}

#[test]
fn controllers_of_the_base_task_are_the_variants_too() {
    add_variant();
    assert_eq!(shipped_controllers(&DEFINITION), shipped_controllers(base().definition()));
    let hash = |task: &str| mishandle::target(&Plan::new(task, "ppo")).unwrap().components[0].hash.clone();
    assert_eq!(hash(DEFINITION.name), hash(BASE));
    // Another task's controller is none of its own.
    let other = concat!(env!("CARGO_MANIFEST_DIR"), "/controllers/ball-pushing/ppo.safetensors");
    let told = mishandle::target(&Plan::new(DEFINITION.name, other)).err().unwrap().to_string();
    assert!(told.contains("ball-pushing"), "{told}");
}

#[test]
fn starts_are_left_out_only_of_a_box_that_is_in_part_out_of_reach() {
    add_variant();
    let leaves_out = |task: &str, starts| {
        let evaluate = EvaluatePlan { episodes: 20, starts, ..EvaluatePlan::default() };
        let plan = Plan { evaluate: Some(evaluate), ..Plan::new(task, "expert") };
        mishandle::leaves_out_starts(&ResolvedPlan::new(&plan).unwrap())
    };
    // The variant's reach is half of the box: that all of twenty starts lie within has a chance of one in a million.
    assert!(leaves_out(DEFINITION.name, StartRegion::Reachable));
    assert!(!leaves_out(DEFINITION.name, StartRegion::Whole));
    assert!(!leaves_out(BASE, StartRegion::Reachable));
}
