//! Every command accepts a task outside the benchmark: the one of `examples/your_task`.

use crate::cube_flipping;
use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Once;

use mishandle::plan::TrainPlan;
use mishandle::store::RunFile;
use mishandle::training::AlgorithmSettings;

/// Registers the task once for all tests.
fn add_task() {
    static ADDED: Once = Once::new();
    ADDED.call_once(|| mishandle::tasks::add(&cube_flipping::CubeFlipping).unwrap());
}

/// Runs the program with the registered task. `HERE` in the arguments is replaced by `folder`, and
/// text in single quotes is one argument.
fn run(folder: &Path, arguments: &str) -> ExitCode {
    let folder = folder.to_str().unwrap();
    let words = arguments.split('\'').enumerate().flat_map(|(i, part)| match i % 2 {
        0 => part.split_whitespace().map(String::from).collect::<Vec<_>>(),
        _ => vec![part.to_string()],
    });
    let words = words.map(|word| OsString::from(word.replace("HERE", folder)));
    mishandle_cli::run_with(std::iter::once("mishandle".into()).chain(words))
}

#[test]
fn every_command_accepts_a_user_s_task() {
    add_task();
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &str| run(folder.path(), arguments);
    let success = ExitCode::SUCCESS;

    assert_eq!(run("list cube-flipping --all"), success);
    assert_eq!(run("export cube-flipping --out HERE/scene.xml"), success);
    assert_eq!(
        run("evaluate cube-flipping --controller expert --episodes 24 --seed 5 --out HERE/run.sqlite"),
        success
    );
    let run_file = RunFile::open(folder.path().join("run.sqlite")).unwrap();
    let robustness: Vec<f64> =
        run_file.simulations().map(|simulation| simulation.unwrap().robustness.unwrap()).collect();
    // 24 random starts, and the corners and the center of the initial box.
    assert_eq!(robustness.len(), 33);
    assert!(robustness.iter().all(|rho| *rho > 0.0), "the expert does not flip the cube: {robustness:?}");
    assert_eq!(run("replay HERE/run.sqlite --simulation 7"), success);

    // No controller can flip the cube within 0.5 s, so every initial state violates this formula.
    let early = "falsify cube-flipping --controller expert --formula 'eventually[0:30](cube_tilt >= 1.5)' --trials 1 \
                 --out HERE/early.sqlite";
    assert_eq!(run(early), ExitCode::from(1));

    let settings = "rollout_steps = 16\nminibatch_size = 128\nepisodes.environments = 16\nrun.total_steps = 512\n\
                    run.validation_episodes = 2\n";
    std::fs::write(folder.path().join("ppo.toml"), settings).unwrap();
    assert_eq!(run("train cube-flipping --settings HERE/ppo.toml --out HERE/mine.safetensors"), success);
    assert_eq!(
        run("evaluate cube-flipping --controller HERE/mine.safetensors --episodes 2 --out HERE/mine.sqlite"),
        success
    );
    // There are no shipped settings for the task, so it uses the defaults.
    assert_eq!(run("train cube-flipping --dry-run --out HERE/other.safetensors"), success);
    assert_eq!(run("evaluate cube-floping --controller expert"), ExitCode::from(2));
}

#[test]
fn the_example_has_less_than_200_lines() {
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/your_task");
    let lines = |name: &str| std::fs::read_to_string(example.join(name)).unwrap().lines().count();
    let all: usize = ["main.rs", "cube_flipping.rs", "scene.xml", "ppo.toml"].map(lines).iter().sum();
    assert!(all < 200, "it has {all} lines");
}

#[test]
fn a_training_run_without_shipped_settings_uses_the_defaults() {
    add_task();
    let plan = |task: &str, settings: Option<&str>| TrainPlan {
        task: task.to_string(),
        algorithm: "sac".to_string(),
        reward: "shaped".to_string(),
        settings: settings.map(Into::into),
        steps: Some(512),
        out: "unused.safetensors".into(),
        ..TrainPlan::default()
    };
    let uses_defaults =
        |task, settings| mishandle::train::uses_default_settings(&plan(task, settings)).unwrap();
    assert!(uses_defaults("cube-flipping", None) && uses_defaults("cube-flipping", Some("best")));
    assert!(!uses_defaults("cube-flipping", Some("skrl-0.10")));
    assert!(!uses_defaults("ball-balancing", None) && !uses_defaults("cloth-placing-7x7", None));
    let mut defaults = AlgorithmSettings::from_toml("sac", "").unwrap().unwrap();
    defaults.run_mut().total_steps = 512;
    assert_eq!(
        mishandle::train::training_facts(&plan("cube-flipping", None), None).unwrap().settings,
        defaults
    );
}
