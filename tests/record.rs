//! Recorded demonstrations agree with evaluations, with the environment, and with the controllers.

use crate::graph;
use std::collections::HashMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use mishandle::dataset::Format;
use mishandle::picture::CameraSettings;
use mishandle::plan::{AxisSetting, EvaluatePlan, RecordSettings};
use mishandle::record::record;
use mishandle::results::Demonstrations;
use mishandle::rollout::{Controller, ControllerWorker, Environment, Request, Scenario, Seed, System};
use mishandle::run::{Engine, ask};
use mishandle::store::RunFile;
use mishandle::{MishandleError, Plan, ResolvedPlan};

fn npz() -> RecordSettings {
    RecordSettings { format: "npz".to_string(), ..RecordSettings::default() }
}

fn plan(target: &str, controller: &str, episodes: u64) -> Plan {
    let evaluate = EvaluatePlan { episodes, batch: 4, ..EvaluatePlan::default() };
    Plan { evaluate: Some(evaluate), seed: 5, ..Plan::new(target, controller) }
}

fn write(
    plan: &Plan,
    settings: &RecordSettings,
    out: &Path,
) -> Result<Option<Demonstrations>, Box<MishandleError>> {
    let resolved = ResolvedPlan::new(plan)?;
    Ok(record(&resolved, settings, out, |_| ControlFlow::Continue(()))?)
}

/// The arrays of an archive without compression: shape and bytes by name.
struct Arrays(HashMap<String, (Vec<usize>, Vec<u8>)>);

impl Arrays {
    fn read(folder: &Path) -> Arrays {
        let file = std::fs::read(folder.join("data.npz")).unwrap();
        let mut arrays = HashMap::new();
        let mut at = 0;
        let u16_at = |at: usize| usize::from(u16::from_le_bytes(file[at..at + 2].try_into().unwrap()));
        while file[at..at + 4] == *b"PK\x03\x04" {
            let name = u16_at(at + 26);
            let extra = u16_at(at + 28);
            let start = at + 30 + name + extra;
            let size = u64::from_le_bytes(file[at + 34 + name..at + 42 + name].try_into().unwrap()) as usize;
            let key = String::from_utf8(file[at + 30..at + 30 + name].to_vec()).unwrap();
            let header = u16_at(start + 8);
            let text = String::from_utf8(file[start + 10..start + 10 + header].to_vec()).unwrap();
            let shape = text.split_once("'shape': (").unwrap().1.split_once(')').unwrap().0;
            let shape = shape.split(',').filter_map(|size| size.trim().parse().ok()).collect();
            let data = file[start + 10 + header..start + size].to_vec();
            arrays.insert(key.trim_end_matches(".npy").to_string(), (shape, data));
            at = start + size;
        }
        Arrays(arrays)
    }

    fn shape(&self, name: &str) -> &[usize] {
        &self.0[name].0
    }

    fn bytes(&self, name: &str) -> &[u8] {
        &self.0[name].1
    }

    fn floats(&self, name: &str) -> Vec<f32> {
        self.bytes(name).chunks_exact(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect()
    }

    fn words(&self, name: &str) -> Vec<u64> {
        self.bytes(name).chunks_exact(8).map(|bytes| u64::from_le_bytes(bytes.try_into().unwrap())).collect()
    }
}

/// Seed, observations and actions of an episode.
type Recorded = (Seed, Vec<f32>, Vec<f32>);

/// Acts as recorded, and checks that it sees what was recorded. Its state is the index of the
/// episode and the control step.
#[derive(Clone)]
struct PlayBack {
    sizes: [usize; 2],
    episodes: Arc<Vec<Recorded>>,
}

impl Controller for PlayBack {
    fn observation_size(&self) -> usize {
        self.sizes[0]
    }

    fn action_size(&self) -> usize {
        self.sizes[1]
    }

    fn state_size(&self) -> usize {
        2
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(self.clone())
    }
}

impl ControllerWorker for PlayBack {
    fn reset(&mut self, state: &mut [f64], seed: Seed) {
        let index = self.episodes.iter().position(|(own, ..)| *own == seed).unwrap();
        state.copy_from_slice(&[index as f64, 0.0]);
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        let [seen, done] = self.sizes;
        for row in 0..rows {
            let state = &mut states[2 * row..2 * row + 2];
            let (_, observed, acted) = &self.episodes[state[0] as usize];
            let step = state[1] as usize;
            let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&observations[row * seen..][..seen]), bits(&observed[step * seen..][..seen]));
            actions[row * done..][..done].copy_from_slice(&acted[step * done..][..done]);
            state[1] += 1.0;
        }
    }
}

/// Noise and delays, so that what the controller sees and does is not what happens.
#[test]
fn replayed_actions_give_the_same_observations_and_the_facts_are_those_of_an_evaluation() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("set");
    let plan = Plan {
        space: "starts+delay".to_string(),
        action_noise: 0.5,
        observation_noise: 0.001,
        ..plan("ball-balancing", "ppo", 6)
    };
    let found = write(&plan, &npz(), &out).unwrap().unwrap();
    assert_eq!([found.episodes, found.simulations, found.frames, found.left_out], [6, 6, 1800, 0]);

    let resolved = ResolvedPlan::new(&plan).unwrap();
    let path = folder.path().join("run.sqlite");
    let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
    ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    let arrays = Arrays::read(&out);
    let rows: Vec<_> = RunFile::open(&path).unwrap().simulations().map(Result::unwrap).collect();
    let rows: Vec<_> = rows.iter().filter(|row| row.trial == 1).collect();
    assert_eq!(arrays.words("seed"), rows.iter().map(|row| row.seed).collect::<Vec<_>>());
    let robustness: Vec<u64> = rows.iter().map(|row| row.robustness.unwrap().to_bits()).collect();
    assert_eq!(arrays.words("robustness"), robustness);
    let success: Vec<u8> = rows.iter().map(|row| u8::from(!row.is_violated())).collect();
    assert_eq!(arrays.bytes("success"), success);
    assert_eq!(found.successes, success.iter().map(|success| u64::from(*success)).sum::<u64>());
    for (index, axis) in resolved.space.axes().iter().enumerate() {
        let values: Vec<u64> = rows.iter().map(|row| row.scenario[index].unwrap().to_bits()).collect();
        assert_eq!(arrays.words(&format!("scenario.{}", axis.name)), values, "{}", axis.name);
    }

    let target = mishandle::resolve::task_target(&plan).unwrap();
    let environment = target.environment(&resolved.space, &resolved.specification).unwrap();
    let sizes = [environment.observation_size(), environment.action_size()];
    assert_eq!(arrays.shape("observation.state"), [1800, sizes[0]]);
    let observations = arrays.floats("observation.state");
    let actions = arrays.floats("action");
    let starts = arrays.words("episode_starts");
    let episodes = rows.iter().zip(starts.windows(2)).map(|(row, span)| {
        let [from, to] = [span[0], span[1]].map(|index| index as usize);
        let part = |values: &[f32], size: usize| values[from * size..to * size].to_vec();
        (Seed(row.seed), part(&observations, sizes[0]), part(&actions, sizes[1]))
    });
    let play_back = PlayBack { sizes, episodes: Arc::new(episodes.collect()) };
    let mut system = target
        .system_in(Arc::new(environment), &resolved.space, &resolved.specification)
        .unwrap()
        .map_controller(|_| Arc::new(play_back));
    let requests: Vec<Request> =
        rows.iter().map(|row| Request::new(Scenario::new(row.scenario.clone()), Seed(row.seed))).collect();
    for (episode, row) in system.rollout(&requests).unwrap().iter().zip(&rows) {
        assert_eq!(episode.robustness(), row.robustness);
    }
}

#[test]
fn labels_are_the_actions_of_an_expert_that_begins_in_each_state() {
    let folder = tempfile::tempdir().unwrap();
    let [labeled, plain] = ["labeled", "plain"].map(|name| folder.path().join(name));
    // The expert of this task has phases.
    let plan = Plan { action_noise: 0.2, ..plan("cube-stacking", "ppo", 2) };
    let settings = RecordSettings { relabel: Some("expert".to_string()), ..npz() };
    write(&plan, &settings, &labeled).unwrap().unwrap();
    write(&plan, &npz(), &plain).unwrap().unwrap();
    let [labeled, plain] = [labeled, plain].map(|out| Arrays::read(&out));
    // Labels change nothing of what happens.
    assert_eq!(labeled.bytes("action.executed"), plain.bytes("action"));
    let task = mishandle::resolve::task("cube-stacking").unwrap();
    let expert = task.expert().unwrap();
    // The further parts that the expert reads follow the observation of the policy.
    let own = task.definition().layout().observation_size();
    let bits = |arrays: &Arrays, size: usize| -> Vec<Vec<u32>> {
        let observations = arrays.floats("observation.state");
        observations
            .chunks(size)
            .map(|row| row[..own].iter().map(|value| value.to_bits()).collect())
            .collect()
    };
    assert_eq!(bits(&labeled, expert.observation_size()), bits(&plain, own));
    let mut worker = expert.worker();
    let mut state = vec![0.0; expert.state_size()];
    let observations = labeled.floats("observation.state");
    let labels = labeled.floats("action");
    let mut action = vec![0.0_f32; expert.action_size()];
    let frames = observations.chunks(expert.observation_size()).zip(labels.chunks(action.len()));
    for (observation, label) in frames {
        worker.reset(&mut state, Seed(0));
        worker.act(1, observation, &mut state, &mut action);
        action.iter_mut().for_each(|value| *value = value.clamp(-1.0, 1.0));
        assert_eq!(action, label);
    }
    assert_ne!(labeled.bytes("action.executed"), labeled.bytes("action"));
}

/// The first state of an episode does not depend on noise.
#[test]
fn labels_are_those_of_the_state_and_not_of_what_the_student_saw() {
    let folder = tempfile::tempdir().unwrap();
    let [noisy, plain] = ["noisy", "plain"].map(|name| folder.path().join(name));
    let plan = plan("ball-pushing", "expert", 3);
    let settings = RecordSettings { relabel: Some("expert".to_string()), ..npz() };
    write(&Plan { observation_noise: 0.01, ..plan.clone() }, &settings, &noisy).unwrap().unwrap();
    write(&plan, &npz(), &plain).unwrap().unwrap();
    let [noisy, plain] = [noisy, plain].map(|out| Arrays::read(&out));
    for start in plain.words("episode_starts").into_iter().take(3) {
        let bytes = 9 * 4 * start as usize..9 * 4 * (start as usize + 1);
        let [label, executed] = ["action", "action.executed"].map(|name| &noisy.bytes(name)[bytes.clone()]);
        assert_eq!(label, &plain.bytes("action")[bytes.clone()]);
        assert_ne!(label, executed);
    }
}

#[test]
fn scenarios_of_an_archive_are_drawn_by_weight_and_the_others_are_those_of_the_evaluation() {
    let folder = tempfile::tempdir().unwrap();
    let [plain, none, mixed, out] = ["plain", "none", "mixed", "out"].map(|name| folder.path().join(name));
    let failures = folder.path().join("failures");
    std::fs::create_dir(&failures).unwrap();
    let table = |text: &str| std::fs::write(failures.join("archive.csv"), text).unwrap();
    table("weight,action_delay,observation_delay\n3,3,0\n1,0,3\n");
    let plan = Plan { space: "starts+delay".to_string(), ..plan("ball-balancing", "ppo", 100) };
    let archive = |share: f64| {
        let archive = Some(failures.clone());
        RecordSettings { archive, archive_share: share, ..npz() }
    };
    let without = write(&plan, &npz(), &plain).unwrap().unwrap();
    assert_eq!((without.archive, without.archived), (None, 0));
    assert_eq!(write(&plan, &archive(0.0), &none).unwrap().unwrap().archived, 0);
    let found = write(&plan, &archive(0.5), &mixed).unwrap().unwrap();
    let [plain, none, mixed] = [plain, none, mixed].map(|out| Arrays::read(&out));
    assert_eq!(plain.bytes("action"), none.bytes("action"));
    let axis = |arrays: &Arrays, name: &str| -> Vec<f64> {
        arrays.words(&format!("scenario.{name}")).into_iter().map(f64::from_bits).collect()
    };
    let delays = |arrays: &Arrays| -> Vec<[f64; 2]> {
        let [action, observation] = ["action_delay", "observation_delay"].map(|name| axis(arrays, name));
        action.into_iter().zip(observation).map(|(action, observation)| [action, observation]).collect()
    };
    let before = delays(&plain);
    let after = delays(&mixed);
    let starts = [&plain, &mixed].map(|arrays| axis(arrays, "ball_x"));
    let mut given = [0_u64; 2];
    for episode in 0..100 {
        // Starts of the archive are random, so they differ from those of the evaluation.
        if starts[0][episode] == starts[1][episode] {
            assert_eq!(before[episode], after[episode]);
        } else {
            let row = [[3.0, 0.0], [0.0, 3.0]].iter().position(|row| *row == after[episode]);
            given[row.expect("a scenario of the archive")] += 1;
        }
    }
    assert_eq!(given[0] + given[1], found.archived);
    // Three standard deviations of the shares 1/2 of 100 and 3/4 of 50 are 15 and 0.18.
    assert!((35..=65).contains(&found.archived), "{given:?}");
    assert!((0.57..=0.93).contains(&(given[0] as f64 / found.archived as f64)), "{given:?}");

    let error = |settings: &RecordSettings| write(&plan, settings, &out).unwrap_err().with_causes();
    assert!(error(&archive(1.5)).contains("record.archive-share"));
    assert!(error(&archive(f64::NAN)).contains("record.archive-share"));
    table("weight,drift_x\n1,0\n");
    let said = error(&archive(0.5));
    assert!(said.contains("archive.csv") && said.contains("`drift_x` is not an axis"), "{said}");
    std::fs::remove_dir_all(&failures).unwrap();
    assert!(error(&archive(0.5)).contains("failures"));
    assert!(!out.exists());
}

#[test]
fn successful_episodes_are_those_of_the_whole_data_set() {
    let folder = tempfile::tempdir().unwrap();
    let [all, some] = ["all", "some"].map(|name| folder.path().join(name));
    let plan = Plan { space: "delay".to_string(), ..plan("ball-balancing", "ppo", 8) };
    let whole = write(&plan, &npz(), &all).unwrap().unwrap();
    let settings = RecordSettings { successful: true, ..npz() };
    let kept = write(&plan, &settings, &some).unwrap().unwrap();
    assert!((1..8).contains(&whole.successes), "{}", whole.successes);
    assert_eq!(
        [kept.episodes, kept.successes, kept.left_out],
        [whole.successes, whole.successes, 8 - whole.successes]
    );
    let [all, some] = [all, some].map(|out| Arrays::read(&out));
    let seeds = all.words("seed").into_iter().zip(all.bytes("success")).filter(|(_, success)| **success == 1);
    assert_eq!(some.words("seed"), seeds.map(|(seed, _)| seed).collect::<Vec<_>>());
}

#[test]
fn bytes_do_not_depend_on_the_batch_size_and_images_are_those_of_the_states() {
    let folder = tempfile::tempdir().unwrap();
    let camera = vec!["wrist".to_string(), "over".to_string()];
    let settings = RecordSettings { camera, size: [12, 8], ..npz() };
    let sets = [1, 3].map(|batch| {
        let out = folder.path().join(format!("batch-{batch}"));
        let mut plan = plan("point-reaching", "expert", 3);
        plan.evaluate.as_mut().unwrap().batch = batch;
        write(&plan, &settings, &out).unwrap().unwrap();
        out
    });
    let [one, three] = sets.each_ref().map(|out| std::fs::read(out.join("data.npz")).unwrap());
    assert!(one == three);
    let arrays = Arrays::read(&sets[0]);
    assert_eq!(arrays.shape("observation.images.wrist"), [900, 8, 12, 3]);
    let size = 3 * 8 * 12;
    let image = |camera: &str, frame: usize| {
        arrays.bytes(&format!("observation.images.{camera}"))[frame * size..][..size].to_vec()
    };
    assert_ne!(image("wrist", 0), image("over", 0));
    // The arm moves, and each episode starts in the same pose.
    assert_ne!(image("over", 0), image("over", 60));
    assert_eq!(std::fs::read_dir(&sets[0]).unwrap().count(), 2, "data.npz and plan.toml");
}

/// A recorded simulation shows the images again that were recorded of the same simulation, with its
/// light, its noise and its late frames; also those that the controller saw, which are recorded as
/// it got them.
#[test]
fn images_of_a_replay_are_those_of_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let seeing = folder.path().join("seeing.onnx");
    std::fs::write(&seeing, graph::seeing_policy([9, 3], 1, [12, 8])).unwrap();
    let side = r#"{"task": "point-reaching", "images": [["i", "over"]], "chunk": {"execute": 3}}"#;
    std::fs::write(folder.path().join("seeing.onnx.json"), side).unwrap();
    let seeing = seeing.to_str().filter(|_| cfg!(feature = "onnx"));
    for controller in seeing.into_iter().chain(["expert"]) {
        let space = "starts+light-3+camera-3+image-3+faults-camera".to_string();
        let mut plan = Plan { space, ..plan("point-reaching", controller, 2) };
        let evaluate = plan.evaluate.as_mut().unwrap();
        (evaluate.corners, evaluate.control) = (false, false);
        let cameras = CameraSettings { names: vec!["wrist".to_string(), "over".to_string()], size: [12, 8] };
        let settings = RecordSettings { camera: cameras.names.clone(), size: cameras.size, ..npz() };
        let out = folder.path().join(format!("recorded-{}", controller.len()));
        write(&plan, &settings, &out).unwrap();
        let arrays = Arrays::read(&out);
        let resolved = ResolvedPlan::new(&plan).unwrap();
        let path = out.with_extension("sqlite");
        let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
        ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
        let (_, trajectory) =
            mishandle::picture::replay_states(&RunFile::open(&path).unwrap(), 1, 2, None).unwrap();
        let mut seen = trajectory.seen_by(&cameras).unwrap().unwrap();
        let size = 3 * 8 * 12;
        for (index, name) in cameras.names.iter().enumerate() {
            let recorded = arrays.bytes(&format!("observation.images.{name}"));
            for step in [0, 1, 2, 40, 41, 299] {
                let frame = 300 + step;
                let recorded = &recorded[frame * size..][..size];
                assert_eq!(seen.image(index, step), recorded, "{controller} {name} {step}");
            }
        }
    }
}

/// The folder appears when it is complete, and nothing else is left.
#[test]
fn an_interrupted_or_impossible_recording_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("set");
    let resolved = ResolvedPlan::new(&plan("point-reaching", "expert", 8)).unwrap();
    for format in Format::ALL {
        let settings = RecordSettings { format: format.name().to_string(), ..npz() };
        let found = record(&resolved, &settings, &out, |done| {
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "{done}");
            assert!(!out.exists());
            ControlFlow::Break(())
        });
        assert!(found.unwrap().is_none());
    }
    let settings = RecordSettings { relabel: Some("expert".to_string()), ..npz() };
    let seen_by = |camera: &[&str]| RecordSettings {
        camera: camera.iter().map(ToString::to_string).collect(),
        size: [8, 8],
        ..npz()
    };
    let drawn = seen_by(&["left"]);
    let lost = Plan { space: "delay".to_string(), ..plan("ball-balancing", "ppo", 1) };
    let error = |plan: &Plan, settings: &RecordSettings| write(plan, settings, &out).unwrap_err().to_string();
    assert!(error(&plan("toy/noisy", "", 1), &settings).contains("a task or a target file"));
    assert!(error(&plan("point-reaching", "ppo", 1), &drawn).contains("over, wrist"));
    let twice = seen_by(&["over"; 2]);
    assert!(error(&plan("point-reaching", "ppo", 1), &twice).contains("over twice"));
    let missing = RecordSettings { relabel: Some("experts".to_string()), ..npz() };
    assert!(error(&plan("point-reaching", "ppo", 1), &missing).contains("experts"));
    let only_successful = RecordSettings { successful: true, ..npz() };
    let no_success = Plan { axes: [("action_delay".to_string(), AxisSetting::Value(3.0))].into(), ..lost };
    assert!(error(&no_success, &only_successful).contains("none of 1 simulation"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    std::fs::create_dir(&out).unwrap();
    assert!(error(&plan("point-reaching", "expert", 1), &npz()).contains("nothing exists"));
}
