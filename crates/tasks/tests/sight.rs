//! Laws of the axes of sight, on every task.

use std::path::Path;
use std::sync::Arc;

use mishandle_camera::sight::{CAMERA_FAULTS, Factor, Feed, Frame, SEVERITIES, Sighting, View};
use mishandle_camera::{Camera, Output, PoseReader, Poses, Renderer, Scene, Shot, Size};
use mishandle_controllers::ControllerFile;
use mishandle_rollout::{
    Axis, Component, Environment, Holds, Noise, Request, Sample, Scenario, Seed, Space, Target,
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

/// Returns the name of the space of all factors at their largest severity and of camera faults.
fn all_factors() -> String {
    let factors = Factor::ALL.map(|(factor, _)| factor.space(SEVERITIES));
    format!("{}+{CAMERA_FAULTS}", factors.join("+"))
}

/// The space of all axes of sight.
fn sight(target: &Target) -> Space {
    target.space(&all_factors()).unwrap()
}

/// Two states of a task: the start, and 24 steps later with the same action.
pub fn states(task: &dyn Task) -> [Vec<f64>; 2] {
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

pub struct Studio {
    renderer: Renderer,
    pub poses: [Poses; 2],
}

impl Studio {
    pub fn new(model: &Model, [before, now]: &[Vec<f64>; 2]) -> Studio {
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
    pub fn images(&mut self, view: &View) -> Vec<u8> {
        self.images_at(view, 1)
    }

    pub fn images_at(&mut self, view: &View, moment: usize) -> Vec<u8> {
        view.cameras.iter().flat_map(|camera| self.shot(&view.scene, camera, moment).0).collect()
    }
}

/// Returns the nominal scenario with one axis at a value, and the conditions of this axis met.
fn with(space: &Space, axis: &Axis, value: f64) -> Scenario {
    let mut values = space.nominal().values().to_vec();
    let place = |name: &str| space.axes().iter().position(|own| own.name == name).unwrap();
    values[place(&axis.name)] = Some(value);
    let mut unmet = axis.conditions.clone();
    while let Some(condition) = unmet.pop() {
        let gate = &space.axes()[place(&condition.axis)];
        let holds = |value: f64| match &condition.holds {
            Holds::Except(idle) => value != *idle,
            Holds::OneOf(values) => values.contains(&value),
        };
        let levels = gate.levels().map_or(1, |levels| levels - 1);
        let open = (0..=levels).rev().map(|level| gate.at(level as f64 / levels as f64)).find(|v| holds(*v));
        let is_met = gate.name == axis.name || values[place(&gate.name)].is_some_and(holds);
        if !is_met {
            values[place(&gate.name)] = Some(open.unwrap());
            unmet.extend(gate.conditions.clone());
        }
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
    // No sky may be in view, or the free place that is nearest to both bounds the same one.
    let may_not = |name: &str| name.contains(": background_") || name.ends_with("_x") || name.ends_with("_y");
    for axis in sight(&target(TASKS[0])).axes() {
        let tasks = unchanged.iter().filter(|found| found.ends_with(&format!(": {}", axis.name))).count();
        assert!(2 * tasks < TASKS.len(), "{} changes no image of {tasks} tasks", axis.name);
    }
    unchanged.retain(|found| !may_not(found));
    assert!(unchanged.is_empty(), "axes that change no image: {unchanged:?}");
}

/// Random scenarios of a factor change images, one factor has no axis of another, and what is
/// nominal in a factor is nominal at every severity.
#[test]
fn every_factor_changes_images_at_every_severity_and_nothing_else() {
    let size = Size::new(64, 64).unwrap();
    for task in TASKS {
        let name = task.definition().name;
        let target = target(*task);
        let (model, view) = view(*task, size).unwrap();
        let mut studio = Studio::new(&model, &states(*task));
        let start = studio.poses[0].clone();
        // A ball in flight is less than a pixel later.
        let mut images = |view: &View| [0, 1].map(|moment| studio.images_at(view, moment)).concat();
        let nominal = images(&view);
        let mut seen: Vec<String> = Vec::new();
        for (factor, _) in Factor::ALL {
            let mut before = 0.0;
            for severity in 1..=SEVERITIES {
                let space = target.space(&factor.space(severity)).unwrap();
                assert_eq!(images(&view.under(&space, &space.nominal(), &start)), nominal);
                let mut change = 0.0;
                for number in 0..6 {
                    let changed = images(&view.under(&space, &space.sample(Seed(1), number), &start));
                    let far =
                        changed.iter().zip(&nominal).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>();
                    assert!(far > 0.0, "{name}: scenario {number} of {} changes nothing", space.name());
                    change += far;
                }
                if severity == 1 || severity == SEVERITIES {
                    assert!(change > before, "{name}: {} changes no more than a weaker one", space.name());
                    before = change;
                }
                if severity == SEVERITIES {
                    let own = space.axes().iter().map(|axis| axis.name.clone());
                    assert!(own.clone().all(|name| !seen.contains(&name)), "{name}: {}", space.name());
                    seen.extend(own.collect::<Vec<_>>());
                }
            }
        }
    }
}

/// Every distractor of every scenario changes at least 2 % of the pixels of `over`, stands on a
/// table or the ground, and is inside of nothing at the start.
#[test]
fn distractors_stand_apart_and_change_two_percent_of_the_pixels() {
    let size = Size::new(64, 64).unwrap();
    for task in TASKS {
        let name = task.definition().name;
        let target = target(*task);
        let (model, view) = view(*task, size).unwrap();
        let mut studio = Studio::new(&model, &states(*task));
        let start = studio.poses[0].clone();
        let nominal = studio.shot(&view.scene, &view.cameras[0], 0).0;
        for severity in [1, 3, 5] {
            let space = target.space(&Factor::Distractors.space(severity)).unwrap();
            for number in 0..10 {
                let scenario = space.sample(Seed(9), number);
                let changed = view.under(&space, &scenario, &start);
                let own = &changed.scene.shapes[view.scene.shapes.len()..];
                assert_eq!(own.len(), severity, "{name}: scenario {number} of {}", space.name());
                let (rgb, segments) = studio.shot(&changed.scene, &changed.cameras[0], 0);
                for (index, shape) in own.iter().enumerate() {
                    let index = (view.scene.shapes.len() + index) as u16;
                    let is_changed = |pixel: &usize| {
                        segments[*pixel] == index && rgb[3 * pixel..][..3] != nominal[3 * pixel..][..3]
                    };
                    let pixels = (0..size.pixels()).filter(is_changed).count();
                    assert!(50 * pixels >= size.pixels(), "{name}: {pixels} pixels of {:?}", shape.form);
                    assert_eq!(shape.body, 0, "a distractor moves with nothing");
                }
            }
        }
    }
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
        let seen = target.space(&format!("starts+{}", all_factors())).unwrap();
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
