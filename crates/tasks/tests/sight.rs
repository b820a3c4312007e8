//! Laws of the axes of sight, on every task.

use std::path::Path;
use std::sync::Arc;

use mishandle_camera::sight::{Feed, Frame, SIGHT_SPACES, Sighting, View};
use mishandle_camera::{Camera, Output, PoseReader, Poses, Renderer, Scene, Shot, Size};
use mishandle_controllers::ControllerFile;
use mishandle_rollout::{
    Axis, Component, Environment, Noise, Request, Sample, Scenario, Seed, Space, Target,
};
use mishandle_tasks::sight::view;
use mishandle_tasks::{Preset, Reward, TASKS, Task, TaskEnvironment, TaskTarget};
use mishandle_world::{Change, Model};

fn target(task: &'static dyn Task) -> Target {
    let name = task.definition().variant_of.unwrap_or(task.definition().name);
    let file = format!("../../controllers/{name}/ppo.safetensors");
    let controller = Arc::new(ControllerFile::load(Path::new(&file)).unwrap().policy);
    let component = Component {
        role: "controller".into(),
        name: "ppo".into(),
        hash: "-".into(),
        file_hash: String::new(),
    };
    TaskTarget::new(task, Preset::Paper, controller, vec![component], Noise::default())
        .unwrap()
        .target()
        .unwrap()
}

/// The space of all axes of sight.
fn sight(target: &Target) -> Space {
    target.space(&SIGHT_SPACES.join("+")).unwrap()
}

/// Two states of a task: the start, and 24 steps later with the same action.
fn states(task: &dyn Task) -> [Vec<f64>; 2] {
    let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Original).unwrap();
    let mut worker = environment.worker();
    let mut state = vec![0.0; environment.state_size()];
    let mut observation = vec![0.0; environment.observation_size()];
    let mut signals = vec![0.0; environment.signals().len()];
    let mut rewards = vec![0.0; environment.reward_terms().len()];
    macro_rules! sample {
        () => {
            Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards }
        };
    }
    worker.reset(&environment.space().nominal(), Seed(0), &mut state, sample!());
    let first = state.clone();
    for _ in 0..24 {
        worker.step(&vec![0.3; environment.action_size()], &mut state, sample!());
    }
    [first, state]
}

struct Studio {
    renderer: Renderer,
    poses: [Poses; 2],
}

impl Studio {
    fn new(model: &Model, [before, now]: &[Vec<f64>; 2]) -> Studio {
        let mut reader = PoseReader::new(model);
        let mut poses = [Poses::default(), Poses::default()];
        reader.read(before, &mut poses[0]);
        reader.read(now, &mut poses[1]);
        Studio { renderer: Renderer::new(), poses }
    }

    /// Returns the colors and the segments of an image of a moment.
    fn shot(&mut self, scene: &Scene, camera: &Camera, moment: usize) -> (Vec<u8>, Vec<u16>) {
        let mut rgb = vec![0; 3 * camera.size.pixels()];
        let mut segments = vec![0; camera.size.pixels()];
        let poses = &self.poses[moment];
        let before = Some(&self.poses[0]);
        let shot = Shot { scene, poses, before, camera, seed: Seed(3), step: 12 };
        let mut output = Output { rgb: Some(&mut rgb), depth: None, segments: Some(&mut segments) };
        self.renderer.render(&shot, &mut output);
        (rgb, segments)
    }

    /// Returns the images of both cameras at the second moment, one after the other.
    fn images(&mut self, view: &View) -> Vec<u8> {
        view.cameras.iter().flat_map(|camera| self.shot(&view.scene, camera, 1).0).collect()
    }
}

/// Returns the nominal scenario with one axis at a value, and the conditions of this axis met.
fn with(space: &Space, axis: &Axis, value: f64) -> Scenario {
    let mut values = space.nominal().values().to_vec();
    let place = |name: &str| space.axes().iter().position(|own| own.name == name).unwrap();
    values[place(&axis.name)] = Some(value);
    for condition in &axis.conditions {
        let gate = place(&condition.axis);
        let own = &space.axes()[gate];
        let scenario = |value: f64| {
            let mut values = values.clone();
            values[gate] = Some(value);
            Scenario::new(values)
        };
        // A value of the gate for which the axis keeps its value.
        let open = [own.high, own.low, 2.0, 3.0, 1.0]
            .into_iter()
            .filter(|gate| (own.low..=own.high).contains(gate))
            .find(|gate| space.canonical(scenario(*gate)).get(place(&axis.name)) == Some(value));
        values[gate] = Some(open.unwrap());
    }
    Scenario::new(values)
}

#[test]
fn axes_of_sight_at_nominal_change_no_image_and_each_one_changes_some_at_a_bound() {
    // Smaller images lack the ball of ball catching.
    let size = Size::new(96, 96).unwrap();
    let mut unchanged = Vec::new();
    for task in TASKS {
        let target = target(*task);
        let name = task.definition().name;
        let space = sight(&target);
        let (model, view) = view(*task, size).unwrap();
        let mut studio = Studio::new(&model, &states(*task));
        let nominal = studio.images(&view);
        let start = studio.poses[0].clone();
        assert_eq!(studio.images(&view.under(&space, &space.nominal(), &start)), nominal, "{name}");
        for axis in space.axes().iter().filter(|axis| !axis.name.starts_with("camera_")) {
            let mut image =
                |value: f64| studio.images(&view.under(&space, &with(&space, axis, value), &start));
            let changed = if axis.conditions.is_empty() {
                image(axis.low) != nominal || image(axis.high) != nominal
            } else {
                image(axis.low) != image(axis.high)
            };
            if !changed {
                unchanged.push(format!("{name}: {}", axis.name));
            }
        }
        assert_eq!(studio.images(&view), nominal, "{name}: a view changed another one");
    }
    // A distractor can be behind an arm or beside the image, but not in most tasks.
    let of_clutter = |name: &str| name.contains(": clutter");
    for axis in sight(&target(TASKS[0])).axes() {
        let tasks = unchanged.iter().filter(|found| found.ends_with(&format!(": {}", axis.name))).count();
        assert!(2 * tasks < TASKS.len(), "{} changes no image of {tasks} tasks", axis.name);
    }
    unchanged.retain(|found| !of_clutter(found));
    assert!(unchanged.is_empty(), "axes that change no image: {unchanged:?}");
}

/// An object is drawn in the size that it has in the physics of its scenario.
#[test]
fn objects_have_the_size_of_their_scenario() {
    let mut sizes = 0;
    for task in TASKS {
        let target = target(*task);
        let name = task.definition().name;
        let Ok(space) = target.space("dynamics") else { continue };
        let (model, view) = view(*task, Size::new(64, 64).unwrap()).unwrap();
        for (index, axis) in space.axes().iter().enumerate() {
            let Some(body) = axis.name.strip_suffix("_size_scale") else { continue };
            let body = model.body(body).unwrap();
            let seen = |factor: f64| {
                let mut values = space.nominal().values().to_vec();
                values[index] = Some(factor);
                view.under(&space, &Scenario::new(values), &Poses::default()).scene.shapes
            };
            let changed = model.changed(&[Change::Size(vec![body], 1.05)]);
            for (shape, nominal) in seen(1.05).iter().zip(&seen(1.0)) {
                let Some(geom) = shape.geom else { continue };
                let is_own = shape.body == body.index();
                assert_eq!(shape.form != nominal.form, is_own, "{name}: {}", axis.name);
                let large = changed.geoms()[geom].size;
                let small = model.geoms()[geom].size;
                let factor = if is_own { 1.05 } else { 1.0 };
                assert!(large.iter().zip(small).all(|(a, b)| (a - factor * b).abs() < 1e-12), "{name}");
                sizes += usize::from(is_own);
            }
        }
    }
    assert!(sizes >= 5, "{sizes}");
}

#[test]
fn axes_of_sight_change_no_physics() {
    for task in TASKS.iter().filter(|task| !task.definition().name.starts_with("cloth")) {
        let target = target(*task);
        let starts = target.space("starts").unwrap();
        let seen = target.space(&format!("starts+{}", SIGHT_SPACES.join("+"))).unwrap();
        let specification = task.definition().paper.specification().unwrap();
        let run = |space: &Space, scenario: Scenario| {
            let mut system = target.system(space, &specification).unwrap();
            system.rollout(&[Request::new(scenario, Seed(4))]).unwrap().remove(0)
        };
        for index in 0..3 {
            let scenario = seen.sample(Seed(5), index);
            let start = starts
                .axes()
                .iter()
                .map(|axis| scenario.get(seen.axes().iter().position(|own| own.name == axis.name).unwrap()));
            let start = Scenario::new(start.collect());
            let plain = run(&starts, start);
            let with_sight = run(&seen, scenario);
            assert_eq!(plain.trace, with_sight.trace, "{}", task.definition().name);
        }
    }
}

#[test]
fn faults_of_cameras_move_images_and_change_none() {
    let target = target(TASKS[0]);
    let space = target.space("faults-camera").unwrap();
    let sight = mishandle_tasks::sight::sight(TASKS[0].definition());
    let frames = |values: &[(&str, f64)]| -> Vec<Vec<Frame>> {
        let nominal = space.nominal();
        let value = |(index, axis): (usize, &Axis)| {
            values.iter().find(|(name, _)| *name == axis.name).map(|(_, v)| *v).or(nominal.get(index))
        };
        let scenario = Scenario::new(space.axes().iter().enumerate().map(value).collect());
        let mut feed = Feed::new(&sight, &space, &scenario, Seed(2)).unwrap();
        (0..60).map(|step| feed.next(step).to_vec()).collect()
    };
    let frame = |camera, step| Frame { camera, step };
    let number_of = |name: &str, text: &str| {
        let axis = space.axes().iter().find(|axis| axis.name == name).unwrap();
        let mishandle_rollout::AxisValues::Categorical(names) = &axis.values else { panic!() };
        names.iter().position(|own| own == text).unwrap() as f64
    };
    for (step, found) in frames(&[]).into_iter().enumerate() {
        assert_eq!(found, [frame(0, step), frame(1, step)]);
    }
    for (step, found) in frames(&[("camera_delay", 4.0)]).into_iter().enumerate() {
        let late = step.saturating_sub(4);
        assert_eq!(found, [frame(0, late), frame(1, late)]);
    }
    // A freeze from 0.2 to 0.6 s, steps 12 to 35, of the first camera.
    let fault = |kind: &str, channel: f64| {
        frames(&[
            ("camera_fault", number_of("camera_fault", kind)),
            ("camera_fault_channel", channel),
            ("camera_fault_onset", 0.2),
            ("camera_fault_duration", 0.4),
        ])
    };
    for (step, found) in fault("freeze", 1.0).into_iter().enumerate() {
        let held = if (12..36).contains(&step) { 11 } else { step };
        assert_eq!(found, [frame(0, held), frame(1, step)], "{step}");
    }
    for (step, found) in fault("swap", 1.0).into_iter().enumerate() {
        let (a, b) = if (12..36).contains(&step) { (1, 0) } else { (0, 1) };
        assert_eq!(found, [frame(a, step), frame(b, step)], "{step}");
    }
}

/// The object of every task is seen by some camera at the start or 0.4 s later, and neither in the
/// dark nor behind a patch that covers the image.
#[test]
fn an_object_that_a_person_could_not_see_is_marked() {
    let size = Size::new(128, 128).unwrap();
    for task in TASKS {
        let name = task.definition().name;
        let (model, view) = view(*task, size).unwrap();
        let mut studio = Studio::new(&model, &states(*task));
        let mut sightings = |change: fn(&mut Camera)| -> Vec<bool> {
            let mut changed = view.clone();
            changed.cameras.iter_mut().for_each(change);
            let alone = changed.object_alone();
            let mut found = Vec::new();
            for camera in &changed.cameras {
                for moment in [0, 1] {
                    let (rgb, segments) = studio.shot(&changed.scene, camera, moment);
                    let (_, alone) = studio.shot(&alone, camera, moment);
                    let width = camera.size.width();
                    found.push(Sighting::new(&changed, width, &rgb, &segments, &alone).is_visible());
                }
            }
            found
        };
        assert!(sightings(|_| ()).contains(&true), "{name}: no camera sees the object");
        assert!(!sightings(|camera| camera.effects.exposure = 0.0).contains(&true), "{name}");
        let cover = |camera: &mut Camera| camera.effects.patch.size = [2.0; 2];
        assert!(!sightings(cover).contains(&true), "{name}");
    }
}
