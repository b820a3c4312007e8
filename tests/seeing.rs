//! Policies in ONNX files that see: their rows depend on no batch and no threads, and images that
//! they do not need are not rendered.

#![cfg(feature = "onnx")]

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::graph::seeing_policy;
use mishandle::plan::EvaluatePlan;
use mishandle::resolve::onnx_policy;
use mishandle::rollout::{
    Component, Controller, ControllerWorker, Episode, Image, Noise, Request, Scenario, Seed, Space,
};
use mishandle::run::{Engine, create_run};
use mishandle::shipped::ShippedFile;
use mishandle::store::RunFile;
use mishandle::{Plan, ResolvedPlan};
use mishandle_tasks::{Preset, TaskTarget, task};

/// Width and height of an image.
const SIZE: [usize; 2] = [16, 12];

/// Writes a policy that predicts `length` actions of `actions` numbers, with its side file.
fn write_policy(path: &Path, [actions, length]: [usize; 2], history: usize, side_file: &str) {
    std::fs::write(path, seeing_policy([actions, length], history, SIZE)).unwrap();
    std::fs::write(format!("{}.json", path.display()), side_file).unwrap();
}

const ROBOT: &str = r#"<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1"/>
    <body name="arm" pos="0 0 0.5">
      <joint name="hinge" axis="0 1 0" damping="0.5"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.04" rgba="0.2 0.3 0.7 1"/>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="hinge"/></actuator>
</mujoco>"#;

const TARGET: &str = r#"
format = 1
name = "seen"
model.file = "seen.xml"
control = { period = 0.02, steps = 40 }
start = { hinge = "tilt" }
observation = { angle = "qpos('hinge')" }
policy = { onnx = "policy.onnx", action = "action" }
signals = { angle = "qpos('hinge')[0]" }
axes = { tilt = { range = [-0.3, 0.3], unit = "rad" } }
formulas = { small = "always(angle <= 2)" }

[cameras]
desk = { position = [1.5, 0, 1], look_at = [0, 0, 0], fovy = 50 }
hand = { body = "arm", position = [0.2, 0, 0.15], quaternion = [0.5, 0.5, -0.5, -0.5], fovy = 90 }
"#;

/// Writes a robot with cameras, and a policy that plays two of three actions and gets the last two
/// images of its hand. Returns the path of the target file.
fn robot(folder: &Path) -> PathBuf {
    std::fs::write(folder.join("seen.xml"), ROBOT).unwrap();
    std::fs::write(folder.join("seen.toml"), TARGET).unwrap();
    let side = r#"{"images": [["i", "hand"]], "history": 2, "chunk": {"execute": 2}}"#;
    write_policy(&folder.join("policy.onnx"), [1, 3], 2, side);
    folder.join("seen.toml")
}

#[test]
fn rows_of_a_target_file_with_a_policy_that_sees_depend_on_no_batch_and_no_threads() {
    let folder = tempfile::tempdir().unwrap();
    let target = robot(folder.path());
    let rows = |batch: u32, threads: usize| {
        let evaluate = EvaluatePlan { episodes: 6, batch, corners: false, ..EvaluatePlan::default() };
        let space = "starts+light-3+image-3+faults-camera+faults-actuation".to_string();
        let plan =
            Plan { evaluate: Some(evaluate), space, seed: 3, ..Plan::new(target.to_str().unwrap(), "") };
        let path = folder.path().join(format!("{batch}-{threads}.sqlite"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let resolved = ResolvedPlan::new(&plan).unwrap();
            let run = create_run(&resolved, Some(&path)).unwrap();
            mishandle::run::ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
        });
        let run = RunFile::open(&path).unwrap();
        let row = |row: mishandle_store::Simulation| {
            let scenario: Vec<Option<u64>> = row.scenario.iter().map(|x| x.map(f64::to_bits)).collect();
            let end = (row.robustness.map(f64::to_bits), row.trace_digest, row.end, row.steps);
            (row.trial, row.number, row.seed, scenario, end)
        };
        run.simulations().map(|found| row(found.unwrap())).collect::<Vec<_>>()
    };
    let expected = rows(1, 1);
    assert!(expected.len() >= 6 && expected[0].4 != expected[1].4);
    for (batch, threads) in [(6, 1), (6, 2), (1, 2), (4, 2)] {
        assert_eq!(rows(batch, threads), expected, "batch {batch}, {threads} threads");
    }
}

/// A controller that asks for the images of every control step, or for those that another one asks
/// for. It counts them.
struct Asking {
    policy: Arc<dyn Controller>,
    asks_always: bool,
    asked: Arc<AtomicUsize>,
}

struct AskingWorker {
    worker: Box<dyn ControllerWorker>,
    asks_always: bool,
    asked: Arc<AtomicUsize>,
}

impl Controller for Asking {
    fn observation_size(&self) -> usize {
        self.policy.observation_size()
    }

    fn action_size(&self) -> usize {
        self.policy.action_size()
    }

    fn state_size(&self) -> usize {
        self.policy.state_size()
    }

    fn sees(&self) -> &[Image] {
        self.policy.sees()
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        let worker = self.policy.worker();
        let asked = self.asked.clone();
        Box::new(AskingWorker { worker, asks_always: self.asks_always, asked })
    }
}

impl ControllerWorker for AskingWorker {
    fn reset(&mut self, state: &mut [f64], seed: Seed) {
        self.worker.reset(state, seed);
    }

    fn needs_images(&self, state: &[f64]) -> bool {
        let asks = self.asks_always || self.worker.needs_images(state);
        self.asked.fetch_add(usize::from(asks), Ordering::Relaxed);
        asks
    }

    fn look(&mut self, rows: usize, images: &[u8]) {
        self.worker.look(rows, images);
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        self.worker.act(rows, observations, states, actions);
    }
}

/// Simulates requests of point-reaching with a policy. Returns the episodes and the number of
/// control steps whose images it needed.
fn episodes(
    policy: &Arc<dyn Controller>,
    asks_always: bool,
    space: &str,
    requests: impl Fn(&Space) -> Vec<Request>,
) -> (Vec<Episode>, usize) {
    let asked = Arc::new(AtomicUsize::new(0));
    let controller = Asking { policy: policy.clone(), asks_always, asked: asked.clone() };
    let component =
        Component { role: "controller".into(), name: "-".into(), hash: "-".into(), file_hash: "".into() };
    let task = task("point-reaching").unwrap();
    let target =
        TaskTarget::new(task, Preset::Paper, Arc::new(controller), vec![component], Noise::default())
            .unwrap();
    let target = target.target().unwrap();
    let space = target.space(space).unwrap();
    let specification = task.definition().paper.specification().unwrap();
    let episodes = target.system(&space, &specification).unwrap().rollout(&requests(&space)).unwrap();
    (episodes, asked.load(Ordering::Relaxed))
}

/// Random scenarios, the second one with a pause of the controller, and the last one with a late
/// image and a freeze.
fn requests(space: &Space) -> Vec<Request> {
    let set = |scenario: Scenario, settings: &[(&str, f64)]| {
        let mut values = scenario.values().to_vec();
        for (name, value) in settings {
            let place = space.axes().iter().position(|axis| axis.name == *name).unwrap();
            values[place] = Some(*value);
        }
        Scenario::new(values)
    };
    let pause = [("actuator_fault", 7.0), ("actuator_fault_onset", 0.31), ("actuator_fault_duration", 0.52)];
    let random = |index: u64| space.sample(Seed(9), index);
    let scenarios = [
        random(0),
        set(space.nominal(), &pause),
        random(1),
        set(space.nominal(), &[("camera_delay", 3.0)]),
        random(2),
    ];
    scenarios.into_iter().zip(0..).map(|(scenario, seed)| Request::new(scenario, Seed(seed))).collect()
}

#[test]
fn a_policy_that_plays_chunks_acts_as_one_that_gets_every_image() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("policy.onnx");
    let space = "starts+light-3+image-3+faults-camera+faults-actuation";
    // How many images of a period of `execute` control steps a run of the model gets.
    for (play, history, padding, period, used) in [
        (r#"{"execute": 5}"#, 1, "zeros", 5, 1),
        (r#"{"execute": 5}"#, 3, "first", 5, 3),
        (r#"{"execute": 3}"#, 4, "zeros", 3, 3),
        (r#"{"ensemble": 0.1}"#, 2, "zeros", 1, 1),
    ] {
        let own = match history {
            1 => String::new(),
            _ => format!(r#", "history": {history}, "padding": "{padding}""#),
        };
        let side =
            format!(r#"{{"task": "point-reaching", "images": [["i", "over"]], "chunk": {play}{own}}}"#);
        write_policy(&path, [9, 6], history, &side);
        let policy = onnx_policy(&ShippedFile::Path(path.clone()), None).unwrap().controller;
        let (expected, all) = episodes(&policy, true, space, requests);
        let (found, asked) = episodes(&policy, false, space, requests);
        for (index, (a, b)) in expected.iter().zip(&found).enumerate() {
            assert_eq!(a.steps, 300, "{side}: the scenario {index} ends early");
            assert!(a.trace == b.trace && a.robustness() == b.robustness(), "{side}, scenario {index}");
        }
        assert!(expected[0].trace != expected[2].trace);
        assert_eq!(all, 5 * 300);
        // In the last period of an episode, no run follows that would have the images in its
        // history; and an image may be needed again while a fault pauses the controller.
        let share = used as f64 / period as f64;
        assert!((asked as f64 - share * all as f64).abs() <= 60.0, "{side}: {asked} of {all} images");
    }
}
