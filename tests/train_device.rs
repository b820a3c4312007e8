//! Training in worlds of another physics engine. Here that engine is MuJoCo C behind the interface
//! of the engines.

#![allow(clippy::unwrap_used, reason = "a test")]

mod silent;

use std::path::Path;
use std::sync::Arc;

use mishandle::MishandleError;
use mishandle::run::Device;
use mishandle::train::{TrainPlan, TrainReport};
use mishandle::world::CpuDevice;

use silent::Silent;

const SETTINGS: &str = "
rollout_steps = 8
minibatch_size = 32
run.total_steps = 256
run.validation_episodes = 4
episodes.environments = 8
";

fn plan(folder: &Path, device: &str) -> TrainPlan {
    let settings = folder.join("settings.toml");
    std::fs::write(&settings, SETTINGS).unwrap();
    TrainPlan {
        task: "cube-stacking".to_string(),
        algorithm: "ppo".to_string(),
        reward: "shaped".to_string(),
        device: device.to_string(),
        settings: Some(settings),
        from: None,
        steps: None,
        space: None,
        axes: Default::default(),
        seed: 4,
        out: folder.join(format!("{device}.safetensors")),
        csv: None,
        tensorboard: None,
        resume: false,
    }
}

fn train(plan: &TrainPlan) -> Result<TrainReport, Box<MishandleError>> {
    let device = Device { worlds: Arc::new(CpuDevice), networks: None };
    mishandle::train::train(plan, Some(&device), &mut Silent).map_err(Box::new)
}

#[test]
fn the_bits_of_training_do_not_depend_on_the_interface_of_the_engines() {
    let folder = tempfile::tempdir().unwrap();
    let cpu = train(&plan(folder.path(), "cpu")).unwrap();
    let gpu = plan(folder.path(), "gpu");
    let half = TrainPlan { steps: Some(128), ..gpu.clone() };
    train(&half).unwrap();
    let resumed = train(&TrainPlan { resume: true, ..gpu.clone() }).unwrap();
    assert_eq!(resumed.result.last.hash(), cpu.result.last.hash());
    assert_eq!(resumed.result.last_validation, cpu.result.last_validation);
    assert!(gpu.command().contains(" --device gpu "), "{}", gpu.command());

    // A run of one engine is not resumed on another.
    let other = TrainPlan { device: "cpu".to_string(), resume: true, ..gpu };
    let error = train(&other).unwrap_err().to_string();
    assert!(error.contains("cube-stacking on MuJoCo C") && !error.contains('\n'), "{error}");
    let unknown = train(&plan(folder.path(), "tpu")).unwrap_err().to_string();
    assert!(unknown.contains("device") && unknown.contains("gpu"), "{unknown}");
}
