//! Training and hardening of a robot that a file describes: a pole on a cart.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle::controllers::ControllerFile;
use mishandle::harden::{ModeExamples, finished, harden, harden_folder};
use mishandle::plan::{AxisSetting, EvaluatePlan, HardenPlan, TrainPlan};
use mishandle::resolve::{ResolvedPlan, robot_file};
use mishandle::results;
use mishandle::rollout::Seed;
use mishandle::run::{Engine, ask, create_run};
use mishandle::train::{
    Curve, TrainObserver, TrainReport, default_out, default_reward, train, training_facts,
    uses_default_settings,
};
use mishandle::training::{
    ALGORITHMS, EpisodeSettings, Episodes, ScenarioSettings, TrainingControl, TrainingProgress,
};
use mishandle::{MishandleError, Plan};

use crate::cart_pole;
use crate::cart_pole::MODEL;
use crate::silent::Silent;

const PPO: &str = "
rollout_steps = 64
minibatch_size = 256
learning_rate = 0.003
policy.hidden = [32, 32]
critic.hidden = [32, 32]
episodes.environments = 16
run = { validation_episodes = 40, validation_interval = 10, total_steps = 30720 }
";

/// Writes the robot with its file changed, and settings; returns the plan of a training run.
fn plan(folder: &Path, change: impl Fn(String) -> String, settings: &str) -> TrainPlan {
    let file = cart_pole::write(folder, change);
    let path = folder.join("settings.toml");
    std::fs::write(&path, settings).unwrap();
    TrainPlan {
        task: file.to_string_lossy().into_owned(),
        algorithm: "ppo".to_string(),
        reward: "file".to_string(),
        settings: Some(path),
        seed: 1,
        out: folder.join("c.safetensors"),
        csv: Some(folder.join("curve.csv")),
        ..TrainPlan::default()
    }
}

fn trained(plan: &TrainPlan) -> TrainReport {
    train(plan, None, &mut Silent).unwrap()
}

fn same(text: String) -> String {
    text
}

/// Returns the success rate of a controller in a space, by an evaluation.
fn success(target: &str, controller: &Path, space: &str) -> f64 {
    let (_, found) = evaluated(target, controller, space, None);
    found
}

/// Evaluates a controller; the run file has this path.
fn evaluated(target: &str, controller: &Path, space: &str, path: Option<&Path>) -> (ResolvedPlan, f64) {
    let evaluate = Some(EvaluatePlan { episodes: 40, ..EvaluatePlan::default() });
    let controller = controller.to_string_lossy().into_owned();
    let plan = Plan { space: space.to_string(), seed: 9, evaluate, ..Plan::new(target, &controller) };
    let resolved = ResolvedPlan::new(&plan).unwrap();
    let run = create_run(&resolved, path).unwrap();
    let answer = ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    let found: results::Evaluation = answer.try_into().unwrap();
    let rate = found.metrics.success_rate.value.unwrap();
    (resolved, rate)
}

#[test]
fn ppo_learns_to_balance() {
    let folder = tempfile::tempdir().unwrap();
    let plan = plan(folder.path(), same, PPO);
    // After one iteration, which changes little.
    let short = TrainPlan { steps: Some(1), out: folder.path().join("short.safetensors"), ..plan.clone() };
    trained(&TrainPlan { csv: None, ..short.clone() });
    let report = trained(&plan);
    let curve = Curve::load(plan.csv.as_ref().unwrap()).unwrap();
    let returns: Vec<f64> = curve.rows.iter().filter_map(|row| row.mean_return).collect();
    let first = returns[0];
    let last = returns[returns.len() - 1];
    // An upright pole earns 1 in each of the 100 control steps; one that falls earns nothing more.
    assert!(first < 60.0 && last > 90.0, "{returns:?}");
    let [before, after] = [&short.last(), &plan.out].map(|file| success(&plan.task, file, "starts"));
    assert!(before < 0.3 && after > 0.9, "success {before} before, {after} after");
    let best = report.result.best_validation.unwrap();
    assert!(best.success_rate > 0.9, "{best:?}");
    assert_eq!(best.strict_success_rate, best.success_rate, "the file has no formula `strict`");

    let file = ControllerFile::load(&plan.out).unwrap();
    let header = &file.header;
    assert_eq!((header.task.as_str(), header.reward.as_str()), ("cartpole", "file"));
    let names: Vec<&str> = header.layout.observation.iter().map(|entry| entry.name.as_str()).collect();
    assert_eq!((names, header.layout.action_size()), (vec!["state"], 1));
    assert_eq!(header.task_hash, training_facts(&other(&plan), None).unwrap().task_hash);
}

/// The same training run with other output files.
fn other(plan: &TrainPlan) -> TrainPlan {
    TrainPlan { out: plan.out.with_file_name("other.safetensors"), csv: None, ..plan.clone() }
}

#[test]
fn the_hash_covers_the_file_and_the_model() {
    let folder = tempfile::tempdir().unwrap();
    let hash = |change: fn(String) -> String, model: &str| {
        let plan = plan(folder.path(), change, PPO);
        std::fs::write(folder.path().join("cartpole.xml"), model).unwrap();
        training_facts(&plan, None).unwrap().task_hash
    };
    let known = hash(same, MODEL);
    assert_eq!(known, hash(same, MODEL));
    assert_ne!(known, hash(|text| text.replace("1 - angle", "2 - angle"), MODEL));
    assert_ne!(known, hash(same, &MODEL.replace("mass=\"1\"", "mass=\"2\"")));
}

#[test]
fn training_clips_actions_to_the_limit_of_the_file() {
    for limit in [0.25, 2.0] {
        let folder = tempfile::tempdir().unwrap();
        let change = |text: String| {
            text.replace("limit = 1", &format!("limit = {limit}")).replace("1 - angle ** 2", "action[0]")
        };
        let plan = plan(folder.path(), change, PPO);
        let environment = robot_file(&Plan::new(&plan.task, "")).unwrap().training().unwrap().environment;
        let settings = EpisodeSettings { environments: 3, ..EpisodeSettings::default() };
        let mut episodes =
            Episodes::new(&environment, &settings, &ScenarioSettings::default(), Seed(1)).unwrap();
        episodes.step(&[3.0, -3.0, 0.125]).unwrap();
        assert_eq!(episodes.rewards(), [limit, -limit, 0.125]);
    }
}

/// Settings of a training run of few steps.
fn few(algorithm: &str) -> String {
    let own = match algorithm {
        "ppo" => "rollout_steps = 16\nminibatch_size = 64",
        "trpo" => "rollout_steps = 16",
        _ => "steps_per_iteration = 16\nreplay = { capacity = 4000, batch_size = 32, warmup_steps = 64 }",
    };
    format!(
        "{own}
        policy.hidden = [8]
        critic = {{ hidden = [8], sees_scenario = true }}
        episodes.environments = 8
        run = {{ total_steps = 512, validation_episodes = 4, validation_interval = 2 }}
        [scenarios]
        space = {{ \"dynamics+delay\" = 2, events = 1 }}
        nominal = 0.25
        corners = 0.25
        curriculum = {{ start = 0.5, step = 0.25, threshold = 0.0 }}
        axes.action_delay = [0, 2]"
    )
}

/// Stops after a number of iterations.
struct Stopping(u32);

impl TrainObserver for Stopping {
    fn iteration_finished(&mut self, _progress: &TrainingProgress) -> TrainingControl {
        self.0 -= 1;
        if self.0 == 0 { TrainingControl::Stop } else { TrainingControl::Continue }
    }

    fn write_failed(&mut self, error: &MishandleError) {
        panic!("{error}");
    }
}

#[test]
fn every_algorithm_resumes_on_scenarios_to_the_same_bits() {
    for algorithm in ALGORITHMS.iter().map(|entry| entry.name) {
        let folder = tempfile::tempdir().unwrap();
        let whole = TrainPlan {
            algorithm: algorithm.to_string(),
            csv: None,
            ..plan(folder.path(), same, &few(algorithm))
        };
        trained(&whole);
        let mut parts = other(&whole);
        train(&parts, None, &mut Stopping(2)).unwrap();
        assert!(parts.checkpoint().exists());
        parts.resume = true;
        trained(&parts);
        let policy = |plan: &TrainPlan| ControllerFile::load(&plan.last()).unwrap().policy.hash();
        assert_eq!(policy(&whole), policy(&parts), "{algorithm}");

        let from = TrainPlan {
            from: Some(whole.out.to_string_lossy().into_owned()),
            settings: None,
            steps: Some(128),
            out: folder.path().join("from.safetensors"),
            ..whole.clone()
        };
        trained(&from);
        let settings = ControllerFile::load(&from.out).unwrap().header.training.settings;
        assert!(settings.contains("critic_steps = 6"), "a twentieth of the steps: {settings}");
    }
}

#[test]
fn a_training_run_is_not_resumed_with_another_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut started = plan(folder.path(), same, &few("ppo"));
    train(&started, None, &mut Stopping(1)).unwrap();
    started.resume = true;
    plan(folder.path(), |text| text.replace("10 * action", "9 * action"), &few("ppo"));
    let error = train(&started, None, &mut Silent).unwrap_err().to_string();
    assert!(error.contains("the checkpoint's environment is cartpole "), "{error}");
}

/// Returns the error of a training run with the file changed.
fn error(change: impl Fn(String) -> String, settings: &str, edit: impl Fn(&mut TrainPlan)) -> String {
    let folder = tempfile::tempdir().unwrap();
    let mut plan = plan(folder.path(), change, settings);
    edit(&mut plan);
    let error = train(&plan, None, &mut Silent).unwrap_err();
    let causes = std::iter::successors(Some(&error as &dyn std::error::Error), |error| error.source());
    let text = causes.map(ToString::to_string).collect::<Vec<_>>().join(": ");
    assert!(!plan.out.exists() && !plan.checkpoint().exists(), "{text}");
    text
}

#[test]
fn what_a_robot_cannot_train_with_is_an_error_that_says_so() {
    let without = |key: &'static str| {
        move |text: String| text.lines().filter(|line| !line.starts_with(key)).collect::<Vec<_>>().join("\n")
    };
    let text = error(without("rewards"), PPO, |_| ());
    assert!(text.contains("cartpole.toml cannot be trained: it has no rewards"), "{text}");
    assert!(text.contains("[rewards]"), "{text}");
    let text = error(|text| text.replace(", limit = 1", ""), PPO, |_| ());
    assert!(text.contains("cartpole.toml, line 8: ") && text.contains("set `policy.limit = 1`"), "{text}");
    for (from, to, part) in [
        ("1 - angle ** 2", "1 - anle ** 2", "did you mean `angle`"),
        ("1 - angle ** 2", "qvel('.*')", "a reward term is one number"),
        ("angle > 0.5", "qpos('.*') > 0.5", "a condition of [ends] is one number"),
        (
            "unit = \"rad\" }\nrewards",
            "over = \"max\" }\nrewards",
            "`angle` is a signal over the physics steps",
        ),
    ] {
        let text = error(|text| text.replace(from, to), PPO, |_| ());
        assert!(text.contains("cartpole.toml, line ") && text.contains(part), "{text}");
    }
    let text = error(same, PPO, |plan| plan.reward = "shaped".to_string());
    assert!(text.contains("the reward is shaped; it must be left out"), "{text}");
    let text = error(same, PPO, |plan| plan.device = "gpu".to_string());
    assert!(text.contains("does not support training on a GPU; only tasks do"), "{text}");
    let text = error(same, &format!("{PPO}rewards.speed = 0.1"), |_| ());
    assert!(text.contains("cartpole does not support reward terms for the manner"), "{text}");
    let text = error(same, PPO, |plan| plan.space = Some("delays".to_string()));
    assert!(text.contains("there is no space `delays`") && text.contains("dynamics"), "{text}");
    let text = error(same, PPO, |plan| plan.from = Some("ppo".to_string()));
    assert!(text.contains("cannot read") && text.contains("ppo"), "{text}");
    let text = error(same, PPO, |plan| {
        plan.from = Some("controllers/point-reaching/ppo.safetensors".to_string());
    });
    assert!(text.contains("cartpole") && text.contains("point-reaching"), "{text}");
    let text = error(same, PPO, |plan| plan.task = "toy/noisy".to_string());
    assert!(text.contains("there is no task `toy/noisy`"), "{text}");
}

#[test]
fn a_robot_without_random_starts_trains_on_its_other_axes() {
    let folder = tempfile::tempdir().unwrap();
    let fixed = |text: String| {
        let text = text.replace("start = { hinge = \"tilt\" }", "start = { hinge = \"0.05\" }");
        text.replace("tilt = { range = [-0.1, 0.1], unit = \"rad\" }\n", "")
    };
    let mut plan = TrainPlan { csv: None, ..plan(folder.path(), fixed, &few("ppo")) };
    trained(&plan);
    plan = other(&plan);
    plan.settings = None;
    (plan.steps, plan.algorithm) = (Some(1), "trpo".to_string());
    plan.axes.insert("pole".to_string(), AxisSetting::Range([1.0, 2.0]));
    let settings = training_facts(&plan, None).unwrap().settings;
    assert_eq!(settings.scenarios().axes["pole"], AxisSetting::Range([1.0, 2.0]));
    // A hardening measures success from random starts.
    let given = ControllerFile::load(&folder.path().join("c.safetensors")).unwrap();
    assert_eq!(given.header.task, "cartpole");
    let base = Plan {
        space: "dynamics".to_string(),
        ..Plan::new(&plan.task, &text(&folder.path().join("c.safetensors")))
    };
    let base = Plan { harden: Some(HardenPlan::default()), ..base };
    let out = folder.path().join("h.safetensors");
    let error = harden(&base, &out, None, &mut |_| ControlFlow::Continue(())).unwrap_err().to_string();
    assert!(error.contains("an axis of the kind start"), "{error}");
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

#[test]
fn failures_of_the_same_file_can_be_given_and_those_of_another_version_cannot() {
    let folder = tempfile::tempdir().unwrap();
    let plan = TrainPlan { csv: None, ..plan(folder.path(), same, &few("ppo")) };
    trained(&plan);
    let run = folder.path().join("failures.sqlite");
    let (_, rate) = evaluated(&plan.task, &plan.out, "starts+dynamics", Some(&run));
    assert!(rate < 1.0, "an untrained controller fails");
    let settings = folder.path().join("archive.toml");
    let scenarios = format!("space = \"dynamics\"\nfile = {:?}\nfile_share = 0.5", text(&run));
    let written = few("ppo").split("[scenarios]").next().unwrap().to_string();
    std::fs::write(&settings, format!("{written}[scenarios]\n{scenarios}")).unwrap();
    let again = TrainPlan { settings: Some(settings), ..other(&plan) };
    trained(&again);
    let changed = std::fs::read_to_string(&plan.task).unwrap().replace("<= 0.3", "<= 0.25");
    std::fs::write(&plan.task, changed).unwrap();
    let third = TrainPlan { out: folder.path().join("third.safetensors"), ..again };
    let error = train(&third, None, &mut Silent).unwrap_err();
    assert!(error.to_string().contains("cartpole in another version"), "{error}");
    assert_eq!(error.remedies(), [results::Remedy::Run(results::Command::Falsify { target: plan.task })]);
}

#[test]
fn commands_and_default_files_of_a_robot_are_complete() {
    assert_eq!(
        default_out("robots/cart pole.toml", "ppo", 3),
        PathBuf::from("runs/cart pole-ppo-s3.safetensors")
    );
    assert_eq!(
        default_out("point-reaching", "ppo", 3),
        PathBuf::from("runs/point-reaching-ppo-s3.safetensors")
    );
    assert_eq!((default_reward("cartpole.toml"), default_reward("point-reaching")), ("file", "shaped"));
    let folder = tempfile::tempdir().unwrap();
    let mut plan = plan(folder.path(), same, PPO);
    plan.settings = None;
    assert!(uses_default_settings(&plan).unwrap(), "nothing is shipped for a robot");
    plan.task = "my robots/cartpole.toml".to_string();
    assert_eq!(plan.command(), "mishandle train 'my robots/cartpole.toml' --algorithm ppo --seed 1");
}

#[test]
fn a_robot_is_hardened_in_a_space_of_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let short = TrainPlan { csv: None, ..plan(folder.path(), same, &few("ppo")) };
    trained(&short);
    let table = HardenPlan {
        rounds: 1,
        steps: 256,
        searches: vec!["random".to_string()],
        budget: 12,
        validation: 6,
        episodes: 6,
        risk: 100,
        margin: 20,
        allow: ["success", "strict", "noise", "corners"].map(String::from).to_vec(),
        ..HardenPlan::default()
    };
    // Without a space, it is the first one: all axes of the file.
    let base = Plan { seed: 5, harden: Some(table), ..Plan::new(&short.task, &text(&short.out)) };
    let out = folder.path().join("hardened.safetensors");
    let found = harden(&base, &out, None, &mut |_| ControlFlow::Continue(())).unwrap().unwrap();
    assert_eq!(found.space, "scenarios");
    assert!(found.rounds[0].failures > 0 && found.rounds[0].environment_steps == 256, "{:?}", found.rounds);
    assert_eq!(finished(&harden_folder(&out)).unwrap(), Some(found.clone()));
    assert_eq!(out.exists(), found.after.is_some());
    assert!(ModeExamples::open(&harden_folder(&out), &found).unwrap().is_none(), "there are no pictures");
    let gpu = HardenPlan { device: "gpu".to_string(), ..base.harden.clone().unwrap() };
    let gpu = Plan { harden: Some(gpu), ..base };
    let error = harden(&gpu, &folder.path().join("g.safetensors"), None, &mut |_| ControlFlow::Continue(()));
    let error = error.unwrap_err().to_string();
    assert!(error.contains("does not support training on a GPU"), "{error}");
}
