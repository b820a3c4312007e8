//! Cameras of a file: the same images as those of a model, axes that change images and no physics,
//! and errors that name what is wrong.

use std::path::Path;
use std::sync::{Arc, Mutex};

use mishandle_camera::sight::{CAMERA_FAULTS, Factor, SEVERITIES, Sight, Sighting, View};
use mishandle_camera::{Output, PoseReader, Poses, Renderer, Shot, Size};
use mishandle_robots::{RobotFile, RobotPolicy};
use mishandle_rollout::{
    Component, Controller, ControllerWorker, Environment, Image, Noise, Request, Sample, Scenario, Seed,
    Space, Specification, System, Target,
};

const MODEL: &str = r#"<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1"/>
    <geom name="wall" type="box" size="0.05 1 0.3" pos="-0.8 0 0.3"/>
    <camera name="fixed" pos="1.5 0 1" xyaxes="0 1 0 -0.5547002 0 0.8320503" fovy="50"/>
    <camera name="narrow" pos="1.5 0 1" fovy="0.5"/>
    <camera name="tracking" pos="1 0 1" mode="targetbody" target="arm"/>
    <body name="arm" pos="0 0 0.5">
      <joint name="hinge" axis="0 1 0" damping="0.5"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.04" rgba="0.2 0.3 0.7 1"/>
    </body>
    <body name="ball" pos="0.2 0.3 0.1"><freejoint/>
      <geom type="sphere" size="0.1" rgba="0.9 0.4 0.1 1"/></body>
  </worldbody>
  <actuator><motor name="torque" joint="hinge"/></actuator>
</mujoco>"#;

const FILE: &str = r#"
format = 1
name = "seen"
model.file = "seen.xml"
control = { period = 0.02, steps = 50 }
start = { hinge = "tilt" }
observation = { angle = "qpos('hinge')" }
policy = { expression = "-5 * angle", action = "action" }
signals = { angle = "qpos('hinge')[0]" }
axes = { tilt = { range = [-0.3, 0.3], unit = "rad" } }
formulas = { small = "always(angle <= 2)" }
sight = { object = "ball" }

[cameras]
desk = { position = [1.5, 0, 1], look_at = [0, 0, 0], fovy = 50 }
model = { mjcf = "fixed" }
hand = { body = "arm", position = [0.2, 0, 0.15], quaternion = [0.5, 0.5, -0.5, -0.5], fovy = 90 }
"#;

fn read(folder: &Path, file: &str) -> Result<RobotFile, String> {
    std::fs::write(folder.join("seen.xml"), MODEL).unwrap();
    std::fs::write(folder.join("target.toml"), file).unwrap();
    RobotFile::read(&folder.join("target.toml")).map_err(|error| error.to_string())
}

fn target(file: &RobotFile) -> Target {
    let RobotPolicy::Expression(policy) = file.policy() else { panic!("an expression") };
    let component =
        Component { role: "controller".into(), name: "-".into(), hash: "-".into(), file_hash: "".into() };
    file.target(policy.clone(), vec![component], Noise::default()).unwrap()
}

/// The states of the first and the tenth control step.
fn states(file: &RobotFile) -> [Vec<f64>; 2] {
    let environment = file.starts().unwrap();
    let mut worker = environment.worker();
    let mut state = vec![0.0; environment.state_size()];
    let mut sizes =
        [environment.observation_size(), environment.signals().len(), environment.reward_terms().len()]
            .map(|size| vec![0.0; size]);
    let mut observation = vec![0.0_f32; sizes[0].len()];
    let [_, signals, rewards] = &mut sizes;
    macro_rules! sample {
        () => {
            Sample { observation: &mut observation, signals, rewards }
        };
    }
    worker.reset(&environment.space().nominal(), Seed(0), &mut state, sample!());
    let first = state.clone();
    for _ in 0..10 {
        worker.step(&[0.3], &mut state, sample!());
    }
    [first, state]
}

struct Eyes {
    renderer: Renderer,
    poses: [Poses; 2],
}

impl Eyes {
    fn new(file: &RobotFile, size: Size) -> (Eyes, View) {
        let (model, view) = file.view(size).unwrap().unwrap();
        let mut reader = PoseReader::new(&model);
        let mut poses = [Poses::default(), Poses::default()];
        states(file).iter().zip(&mut poses).for_each(|(state, poses)| reader.read(state, poses));
        (Eyes { renderer: Renderer::new(), poses }, view)
    }

    fn image(&mut self, view: &View, camera: usize) -> (Vec<u8>, Vec<u16>) {
        let camera = &view.cameras[camera];
        let mut rgb = vec![0; 3 * camera.size.pixels()];
        let mut segments = vec![0; camera.size.pixels()];
        let [before, poses] = &self.poses;
        let shot = Shot { scene: &view.scene, poses, before: Some(before), camera, seed: Seed(3), step: 4 };
        self.renderer
            .render(&shot, &mut Output { rgb: Some(&mut rgb), depth: None, segments: Some(&mut segments) });
        (rgb, segments)
    }

    fn images(&mut self, view: &View) -> Vec<u8> {
        (0..view.cameras.len()).flat_map(|camera| self.image(view, camera).0).collect()
    }
}

#[test]
fn a_camera_of_the_file_sees_what_the_same_camera_of_the_model_sees() {
    let folder = tempfile::tempdir().unwrap();
    let file = read(folder.path(), FILE).unwrap();
    assert_eq!(file.sight().unwrap().names().collect::<Vec<_>>(), ["desk", "model", "hand"]);
    let (mut eyes, view) = Eyes::new(&file, Size::new(96, 64).unwrap());
    let [desk, model, hand] = [0, 1, 2].map(|camera| eyes.image(&view, camera));
    // The directions of the model are rounded to seven digits.
    let differing = desk.1.iter().zip(&model.1).filter(|(a, b)| a != b).count();
    assert!(differing < 20, "{differing} of {} pixels", desk.1.len());
    // The ball is 0.3 m beside the middle, which is to the right of a camera that looks along -x.
    let width = 96;
    let mut only = view.clone();
    only.scene = view.object_alone();
    let alone = eyes.image(&only, 0).1;
    let found = Sighting::new(&view, width, &desk.0, &desk.1, &alone);
    assert!(found.is_visible() && found.visible_share == 1.0, "{found:?}");
    let columns: Vec<usize> =
        (0..alone.len()).filter(|pixel| alone[*pixel] == 0).map(|pixel| pixel % width).collect();
    assert!(columns.iter().all(|column| *column > width / 2), "{columns:?}");
    // The camera on the arm moves with it, and sees other things than those in the world.
    let moved = |eyes: &mut Eyes, camera| {
        let later = eyes.image(&view, camera).0;
        eyes.poses.swap(0, 1);
        let earlier = eyes.image(&view, camera).0;
        eyes.poses.swap(0, 1);
        later != earlier
    };
    assert!(moved(&mut eyes, 2));
    assert_ne!(hand.0, desk.0);
}

/// Returns the name of the space of all factors at their largest severity and of camera faults.
fn all_factors() -> String {
    let factors = Factor::ALL.map(|(factor, _)| factor.space(SEVERITIES));
    format!("{}+{CAMERA_FAULTS}", factors.join("+"))
}

#[test]
fn axes_of_sight_change_images_and_neither_nominal_images_nor_physics() {
    let folder = tempfile::tempdir().unwrap();
    let file = read(folder.path(), FILE).unwrap();
    let target = target(&file);
    let space = target.space(&all_factors()).unwrap();
    let (mut eyes, view) = Eyes::new(&file, Size::new(64, 64).unwrap());
    let nominal = eyes.images(&view);
    let start = eyes.poses[0].clone();
    assert_eq!(eyes.images(&view.under(&space, &space.nominal(), &start)), nominal);
    let mut unchanged = Vec::new();
    for (index, axis) in space.axes().iter().enumerate() {
        // Conditional axes need others, and faults change no image.
        if !axis.conditions.is_empty() || axis.name.starts_with("camera_") {
            continue;
        }
        let changes = |value: f64| {
            let mut values = space.nominal().values().to_vec();
            values[index] = Some(value);
            eyes.images(&view.under(&space, &Scenario::new(values), &start)) != nominal
        };
        if ![axis.low, axis.high].map(changes).contains(&true) {
            unchanged.push(axis.name.clone());
        }
    }
    assert_eq!(unchanged, Vec::<String>::new());
    assert!(space.axes().iter().any(|axis| axis.name == "hand_camera_z" && axis.high < 0.02));
    assert!(space.axes().iter().any(|axis| axis.name == "desk_camera_z" && axis.high > 0.1));

    let seen = target.space(&format!("starts+{}", all_factors())).unwrap();
    let starts = target.space("starts").unwrap();
    assert!(target.space("all").unwrap().axes().iter().all(|axis| !axis.name.starts_with("lamp")));
    let specification = Specification::from_formulas(
        &target.formulas,
        mishandle_stl::Formula::parse(&target.formulas[0].text).unwrap(),
    )
    .unwrap();
    let run = |space: &Space, scenario: Scenario| {
        let mut system = target.system(space, &specification).unwrap();
        system.rollout(&[Request::new(scenario, Seed(4))]).unwrap().remove(0).trace
    };
    for index in 0..3 {
        let scenario = seen.sample(Seed(5), index);
        let start = Scenario::new(vec![scenario.get(0)]);
        assert_eq!(run(&starts, start), run(&seen, scenario));
    }
}

#[test]
fn a_part_that_the_scene_lacks_has_no_axes() {
    let folder = tempfile::tempdir().unwrap();
    let names = |file: &str| -> Vec<String> {
        let file = read(folder.path(), file).unwrap();
        file.sight().into_iter().flat_map(Sight::axes).map(|axis| axis.name.clone()).collect()
    };
    let all = names(FILE);
    for part in ["object", "support", "floor"] {
        assert!(all.contains(&format!("{part}_red")), "{part}");
    }
    let without = names(&FILE.replace("sight = { object = \"ball\" }", ""));
    assert!(!without.contains(&"object_red".to_string()));
    let cameras = FILE.find("[cameras]").unwrap();
    let blind = FILE[..cameras].replace("sight = { object = \"ball\" }", "");
    assert_eq!(names(&blind), Vec::<String>::new());
    assert!(read(folder.path(), &blind).unwrap().view(Size::new(8, 8).unwrap()).unwrap().is_none());
}

#[test]
fn mistakes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for (old, new, message) in [
        ("body = \"arm\"", "body = \"arn\"", "did you mean `arm`?"),
        ("mjcf = \"fixed\"", "mjcf = \"fixd\"", "did you mean `fixed`?"),
        ("mjcf = \"fixed\"", "mjcf = \"tracking\"", "the mode `fixed`"),
        ("mjcf = \"fixed\"", "mjcf = \"narrow\"", "from 1 to 170 degrees"),
        ("mjcf = \"fixed\"", "mjcf = \"fixed\", fovy = 3", "no key `fovy`"),
        ("look_at = [0, 0, 0]", "look_at = [1.5, 0, 1]", "is the position of the camera"),
        ("look_at = [0, 0, 0]", "look_at = [1.5, 0, 0]", "set `up` to a direction across it"),
        ("look_at = [0, 0, 0]", "look_at = [0, 0, 1e300]", "at most 1000000"),
        ("[1.5, 0, 1], look_at = [0, 0, 0]", "[9e5, 0, 0], look_at = [900000.001, 0, 0]", "another point"),
        ("look_at = [0, 0, 0]", "look_at = [0, 0]", "`look_at` has 3 numbers, not 2"),
        ("look_at = [0, 0, 0], ", "", "exactly one of `look_at`"),
        ("look_at = [0, 0, 0]", "lookat = [0, 0, 0]", "exactly one of `look_at`"),
        ("[0.5, 0.5, -0.5, -0.5]", "[0, 0, 0, 0]", "`quaternion` has the length 0"),
        ("fovy = 90", "fovy = 0", "from 1 to 170 degrees"),
        ("fovy = 90", "fov = 90", "did you mean `fovy`?"),
        ("hand =", "desk =", "duplicate key"),
        ("hand =", "close =", "is a view that every model has"),
        ("hand =", "\"a b\" =", "letters, digits and `_`"),
        ("object = \"ball\"", "object = \"bal\"", "did you mean `ball`?"),
        ("tilt = {", "lamp_x = {", "every robot with cameras has an axis `lamp_x`"),
    ] {
        let file = match new {
            "lamp_x = {" => FILE.replace(old, new).replace("\"tilt\"", "\"lamp_x\""),
            _ => FILE.replace(old, new),
        };
        let error = read(folder.path(), &file).err().unwrap_or_else(|| panic!("{new} is accepted"));
        assert!(error.contains(message), "{new}: {error}");
    }
    let blind = &FILE[..FILE.find("[cameras]").unwrap()];
    assert!(read(folder.path(), blind).err().unwrap().contains("[sight] needs cameras"));
    // Looking straight down works with another direction that is up in images.
    let down = FILE.replace("look_at = [0, 0, 0]", "look_at = [1.5, 0, 0], up = [1, 0, 0]");
    read(folder.path(), &down).unwrap();
}

/// The images and the action of each call.
type Log = Arc<Mutex<Vec<(Vec<u8>, f32)>>>;

/// A controller whose action depends on every byte that it sees through two cameras.
#[derive(Clone)]
struct Watcher {
    images: Vec<Image>,
    log: Log,
    seen: Vec<u8>,
}

impl Watcher {
    fn new(cameras: [&str; 2]) -> Watcher {
        let image = |camera: &str| Image { camera: camera.into(), width: 12, height: 8 };
        Watcher { images: cameras.map(image).to_vec(), log: Log::default(), seen: Vec::new() }
    }

    fn target(&self, file: &RobotFile) -> Result<Target, String> {
        let component =
            Component { role: "controller".into(), name: "-".into(), hash: "-".into(), file_hash: "".into() };
        file.target(Arc::new(self.clone()), vec![component], Noise::default())
            .map_err(|error| error.to_string())
    }
}

impl Controller for Watcher {
    fn observation_size(&self) -> usize {
        1
    }

    fn action_size(&self) -> usize {
        1
    }

    fn sees(&self) -> &[Image] {
        &self.images
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(self.clone())
    }
}

impl ControllerWorker for Watcher {
    fn look(&mut self, _rows: usize, images: &[u8]) {
        self.seen = images.to_vec();
    }

    fn act(&mut self, rows: usize, _observations: &[f32], _states: &mut [f64], actions: &mut [f32]) {
        for (action, seen) in actions.iter_mut().zip(self.seen.chunks(self.seen.len() / rows)) {
            let sum: u32 = seen.iter().zip(1..).map(|(byte, weight)| weight * u32::from(*byte)).sum();
            *action = (sum % 201) as f32 / 100.0 - 1.0;
            if rows == 1 {
                self.log.lock().unwrap().push((seen.to_vec(), *action));
            }
        }
    }
}

fn system(target: &Target, space: &str) -> Box<dyn System> {
    let formula = mishandle_stl::Formula::parse("always(angle <= 2)").unwrap();
    let specification = Specification::from_formulas(&target.formulas, formula).unwrap();
    target.system(&target.space(space).unwrap(), &specification).unwrap()
}

#[test]
fn a_controller_sees_what_the_cameras_of_the_file_show() {
    let folder = tempfile::tempdir().unwrap();
    let file = read(folder.path(), FILE).unwrap();
    let watcher = Watcher::new(["hand", "desk"]);
    let target = watcher.target(&file).unwrap();
    let name = "starts+light-3+camera-3+background-3+object-3";
    let space = target.space(name).unwrap();
    let environment = file.starts().unwrap().with_own_axes(&space).unwrap();
    for index in 0..2 {
        let scenario = space.sample(Seed(5), index);
        let seed = Seed(4 + index);
        watcher.log.lock().unwrap().clear();
        let request = Request::new(scenario.clone(), seed);
        let episode = system(&target, name).rollout(&[request]).unwrap().remove(0);
        let log = watcher.log.lock().unwrap();
        assert_eq!((log.len(), episode.steps), (50, 50));
        // The states again, from the actions alone.
        let mut worker = environment.worker();
        let mut state = vec![0.0; environment.state_size()];
        let mut observation = [0.0_f32];
        let mut signals = [0.0];
        let mut rewards = vec![0.0; environment.reward_terms().len()];
        macro_rules! sample {
            () => {
                Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards }
            };
        }
        worker.reset(&scenario, seed, &mut state, sample!());
        let (model, view) = file.view(Size::new(12, 8).unwrap()).unwrap().unwrap();
        let mut renderer = mishandle_camera::StateRenderer::new(&model);
        let view = view.under(&space, &scenario, renderer.poses(&state));
        let mut before: Option<Vec<f64>> = None;
        for (step, (seen, action)) in log.iter().enumerate() {
            // The desk is the first camera of the file, the hand the last one.
            for (seen, camera) in seen.chunks(3 * 12 * 8).zip([2, 0]) {
                let mut rgb = vec![0; 3 * 12 * 8];
                let shot = mishandle_camera::StateShot {
                    state: &state,
                    before: before.as_deref(),
                    scene: &view.scene,
                    camera: &view.cameras[camera],
                    seed: seed.child(camera as u64),
                    step: step as u64,
                };
                renderer.render(&shot, &mut Output { rgb: Some(&mut rgb), depth: None, segments: None });
                assert!(seen == rgb, "scenario {index}, step {step}, camera {camera}");
            }
            before = Some(state.clone());
            worker.step(&[f64::from(*action)], &mut state, sample!());
        }
    }
}

#[test]
fn bits_of_a_controller_that_sees_depend_on_no_threads_and_no_batch() {
    let folder = tempfile::tempdir().unwrap();
    let target = Watcher::new(["hand", "model"]).target(&read(folder.path(), FILE).unwrap()).unwrap();
    let name = "starts+light-3+image-3+faults-camera";
    let space = target.space(name).unwrap();
    let requests: Vec<Request> = (0..5).map(|i| Request::new(space.sample(Seed(1), i), Seed(i))).collect();
    let run = |threads: usize, batch: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut system = system(&target, name);
            let chunks = requests.chunks(batch);
            chunks.flat_map(|requests| system.rollout(requests).unwrap()).collect::<Vec<_>>()
        })
    };
    let expected = run(1, 5);
    assert!(expected[0].trace != expected[1].trace);
    for (threads, batch) in [(3, 5), (1, 1), (2, 3)] {
        for (a, b) in expected.iter().zip(run(threads, batch)) {
            assert!(a.trace == b.trace && a.robustness() == b.robustness(), "{threads} {batch}");
        }
    }
}

#[test]
fn the_axes_of_all_are_those_of_what_the_controller_sees() {
    let folder = tempfile::tempdir().unwrap();
    let file = read(folder.path(), FILE).unwrap();
    let names = |target: &Target| target.axes.iter().map(|axis| axis.name.clone()).collect::<Vec<_>>();
    let blind = names(&target(&file));
    let seeing = names(&Watcher::new(["hand", "hand"]).target(&file).unwrap());
    let has = |names: &[String], name: &str| names.iter().any(|own| own == name);
    for (axis, expected) in [
        ("lamp_x", [false, true]),
        ("hand_camera_x", [false, true]),
        ("desk_camera_x", [false, false]),
        ("tilt", [true, true]),
    ] {
        assert_eq!([has(&blind, axis), has(&seeing, axis)], expected, "{axis}");
    }
    let error = Watcher::new(["hand", "dsk"]).target(&file).err().unwrap();
    assert!(
        error.contains("the camera `dsk`, but seen has only desk, model, hand; did you mean `desk`?"),
        "{error}"
    );
    let without = FILE.split("[cameras]").next().unwrap().replace("sight = { object = \"ball\" }", "");
    let error = Watcher::new(["hand", "desk"]).target(&read(folder.path(), &without).unwrap()).err().unwrap();
    assert!(error.contains("the camera `hand`, but seen has no cameras"), "{error}");
}
