//! The world of the eight tasks is frozen: physics, axes, formulas, experts and images have the
//! hashes of `frozen.txt`.
//!
//! Published figures and shipped controllers belong to this world, so a difference is a mistake of
//! the change that makes it, not of the list.

use mishandle_camera::Size;
use mishandle_camera::sight::{Factor, SEVERITIES};
use mishandle_controllers::bytes_hash;
use mishandle_rollout::{Component, Environment, Noise, Request, Seed, Stream, Target};
use mishandle_tasks::sight::view;
use mishandle_tasks::{
    JOINTS, Preset, Reward, TASKS, Task, TaskEnvironment, TaskTarget, target_identity, task,
};

use crate::sight::{Studio, states};
use crate::stepped::Run;

/// Control steps under random actions.
const STEPS: u64 = 120;

/// Size of the images.
const SIZE: usize = 64;

fn bits(numbers: &[f64]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_bits().to_le_bytes()).collect()
}

/// Returns the bits of all states, signals, observations and rewards of episodes under random
/// actions.
fn physics(task: &dyn Task) -> Vec<u8> {
    let mut found = Vec::new();
    for reward in [Reward::Original, Reward::Shaped] {
        let environment = TaskEnvironment::new(task, Preset::Paper, reward).unwrap().with_manner();
        for start in 0..2 {
            let scenario = environment.space().sample(Seed(start), start);
            let mut run = Run::new(environment.clone(), &scenario);
            for step in 0..STEPS {
                let joint = |joint| 2.0 * Seed(start).uniform(Stream::ActionNoise, step / 20, joint) - 1.0;
                run.step(&std::array::from_fn::<f64, JOINTS, _>(|index| joint(index as u32)));
                found.extend(bits(&run.state));
                found.extend(bits(&run.signals));
                found.extend(bits(&run.rewards));
                found.extend(run.observation.iter().flat_map(|value| value.to_bits().to_le_bytes()));
            }
        }
    }
    found
}

/// Returns the task under a preset with its expert.
fn target(task: &'static dyn Task, preset: Preset) -> Target {
    let component = Component {
        role: "controller".into(),
        name: "expert".into(),
        hash: String::new(),
        file_hash: String::new(),
    };
    let expert = task.expert().unwrap();
    TaskTarget::new(task, preset, expert, vec![component], Noise::default()).unwrap().target().unwrap()
}

/// Returns all axes and the spaces that they belong to.
fn axes(target: &Target) -> String {
    let mut text = String::new();
    for axis in &target.axes {
        let plain = mishandle_rollout::Axis { meaning: String::new(), ..axis.clone() };
        text += &format!("{plain:?}\n");
    }
    for space in &target.spaces {
        let axes = space.axes().iter().map(|axis| (&axis.name, axis.low, axis.high));
        text += &format!("{}: {:?}\n", space.name(), axes.collect::<Vec<_>>());
    }
    text
}

/// Returns the bits of the traces of episodes of the expert.
fn expert(task: &dyn Task, target: &Target) -> Vec<u8> {
    let specification = task.definition().paper.specification().unwrap();
    let space = target.space("starts").unwrap();
    let mut system = target.system(&space, &specification).unwrap();
    let requests = [0, 1].map(|index| Request::new(space.sample(Seed(11), index), Seed(index)));
    let mut found = Vec::new();
    for episode in system.rollout(&requests).unwrap() {
        for signal in &target.signals {
            found.extend(bits(episode.trace.signal(&signal.name).unwrap()));
        }
    }
    found
}

/// Returns the images of both cameras, nominal and under the factors.
fn images(task: &'static dyn Task, target: &Target) -> Vec<u8> {
    let (model, view) = view(task, Size::new(SIZE, SIZE).unwrap()).unwrap();
    let mut studio = Studio::new(&model, &states(task));
    let start = studio.poses[0].clone();
    let mut found = studio.images_at(&view, 0);
    found.extend(studio.images(&view));
    for (factor, _) in Factor::ALL {
        for severity in [1, 3, SEVERITIES] {
            let space = target.space(&factor.space(severity)).unwrap();
            let under = view.under(&space, &space.sample(Seed(3), 1), &start);
            found.extend(studio.images(&under));
        }
    }
    found
}

/// Returns the lines of a task.
fn lines(task: &'static dyn Task) -> Vec<String> {
    let name = task.definition().name;
    let [paper, code] = [Preset::Paper, Preset::Code].map(|preset| target(task, preset));
    let identity = |preset| target_identity(task, preset, "", Noise::default()).unwrap().hash;
    let parts = [
        ("definition", identity(Preset::Paper) + &identity(Preset::Code)),
        ("physics", bytes_hash(&physics(task))),
        ("axes", bytes_hash((axes(&paper) + &axes(&code)).as_bytes())),
        ("expert", bytes_hash(&expert(task, &paper))),
        ("images", bytes_hash(&images(task, &paper))),
    ];
    parts.map(|(part, hash)| format!("{name} {part} {}", bytes_hash(hash.as_bytes()))).to_vec()
}

fn is_frozen(name: &str) {
    let found = lines(task(name).unwrap());
    let list: Vec<&str> = include_str!("frozen.txt").lines().collect();
    let changed: Vec<&String> = found.iter().filter(|line| !list.contains(&line.as_str())).collect();
    assert!(changed.is_empty(), "the frozen world has changed:\n{changed:#?}");
}

macro_rules! frozen {
    ($($test:ident $name:literal;)*) => {
        $(#[test]
        fn $test() {
            is_frozen($name);
        })*

        #[test]
        fn the_list_has_five_parts_of_every_task() {
            let names = [$($name),*];
            let is_listed = |task: &&dyn Task| {
                task.definition().variant_of.is_some() || names.contains(&task.definition().name)
            };
            assert!(TASKS.iter().all(is_listed));
            assert_eq!(include_str!("frozen.txt").lines().count(), 5 * names.len());
        }
    };
}

frozen! {
    point_reaching_is_frozen "point-reaching";
    cube_stacking_is_frozen "cube-stacking";
    peg_in_hole_is_frozen "peg-in-hole";
    ball_balancing_is_frozen "ball-balancing";
    ball_catching_is_frozen "ball-catching";
    ball_pushing_is_frozen "ball-pushing";
    door_opening_is_frozen "door-opening";
    cloth_placing_is_frozen "cloth-placing";
}
