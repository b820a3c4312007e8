//! A variant of a task takes the controllers of the task that it varies.

#![allow(clippy::unwrap_used)]

use std::borrow::Cow;
use std::sync::{Arc, LazyLock};

use mishandle::rollout::Controller;
use mishandle::tasks::{Definition, Panda, Scene, Task};
use mishandle::world::{Model, WorldError};
use mishandle::{Plan, Subject, shipped_controllers};

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

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        base().expert()
    }
}

#[test]
fn controllers_of_the_base_task_are_the_variants_too() {
    mishandle::tasks::add(&Variant);
    assert_eq!(shipped_controllers(&DEFINITION), shipped_controllers(base().definition()));
    let hash = |task: &str| Subject::new(&Plan::new(task, "ppo")).unwrap().controller_hash;
    assert_eq!(hash(DEFINITION.name), hash(BASE));
    // Another task's controller is none of its own.
    let other = mishandle::controller_path(mishandle::task("ball-pushing").unwrap().definition(), "ppo");
    let told = Subject::new(&Plan::new(DEFINITION.name, other.to_str().unwrap())).err().unwrap().to_string();
    assert!(told.contains("ball-pushing"), "{told}");
}
