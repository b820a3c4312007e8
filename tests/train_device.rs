//! Training in worlds of another physics engine. Here that engine is MuJoCo C behind the interface
//! of the engines.

use std::path::Path;
use std::sync::Arc;

use mishandle::MishandleError;
use mishandle::plan::TrainPlan;
use mishandle::run::Device;
use mishandle::train::{Curve, TrainReport};
use mishandle::world::CpuDevice;

use crate::silent::Silent;

const SETTINGS: &str = "
rollout_steps = 8
minibatch_size = 32
run.total_steps = 256
run.validation_episodes = 4
episodes.environments = 8
";

fn plan(folder: &Path, device: &str) -> TrainPlan {
    plan_with(folder, device, "")
}

fn plan_with(folder: &Path, device: &str, more: &str) -> TrainPlan {
    let settings = folder.join("settings.toml");
    std::fs::write(&settings, format!("{SETTINGS}{more}")).unwrap();
    TrainPlan {
        task: "cube-stacking".to_string(),
        algorithm: "ppo".to_string(),
        reward: "shaped".to_string(),
        device: device.to_string(),
        settings: Some(settings),
        seed: 4,
        out: folder.join(format!("{device}.safetensors")),
        ..TrainPlan::default()
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
    assert!(gpu.command().contains(" -k train.device=gpu "), "{}", gpu.command());

    // A run of one engine is not resumed on another.
    let other = TrainPlan { device: "cpu".to_string(), resume: true, ..gpu };
    let error = train(&other).unwrap_err().to_string();
    assert!(error.contains("cube-stacking on MuJoCo C") && !error.contains('\n'), "{error}");
    let unknown = train(&plan(folder.path(), "tpu")).unwrap_err().to_string();
    assert!(unknown.contains("device") && unknown.contains("gpu"), "{unknown}");
}

#[test]
fn reward_terms_without_forces_have_the_same_bits_on_every_engine() {
    let folder = tempfile::tempdir().unwrap();
    let motion = "rewards = { action_rate = 0.5, speed = 0.5, rest = 0.5 }\nepisodes.time_limit = 20\n";
    let plan = |device| {
        let csv = Some(folder.path().join(format!("{device}.csv")));
        TrainPlan { csv, ..plan_with(folder.path(), device, motion) }
    };
    let [cpu, gpu] = ["cpu", "gpu"].map(|device| train(&plan(device)).unwrap().result);
    assert_eq!(cpu.last.hash(), gpu.last.hash());
    let curve = Curve::load(&folder.path().join("cpu.csv")).unwrap();
    let terms = curve.reward_terms.len() - 3;
    assert_eq!(curve.reward_terms[terms..], ["action_rate", "speed", "rest"]);
    for row in &curve.rows[3..] {
        assert!(row.reward_terms[terms..].iter().all(|mean| *mean < 0.0), "{:?}", row.reward_terms);
    }
}

#[test]
fn contact_forces_cost_reward_with_the_same_bits_on_every_engine() {
    let folder = tempfile::tempdir().unwrap();
    let plan = |device, name: &str, more| TrainPlan {
        task: "peg-in-hole".to_string(),
        // Until the peg or the arm touches the block.
        steps: Some(1024),
        out: folder.path().join(format!("{name}.safetensors")),
        csv: Some(folder.path().join(format!("{name}.csv"))),
        ..plan_with(folder.path(), device, more)
    };
    let forces = "rewards.contact_force = 0.5\n";
    let whole = train(&plan("cpu", "cpu", forces)).unwrap();
    let curve = Curve::load(&folder.path().join("cpu.csv")).unwrap();
    assert_eq!(curve.reward_terms.last().unwrap(), "contact_force");
    let costs: Vec<f64> = curve.rows.iter().map(|row| *row.reward_terms.last().unwrap()).collect();
    assert!(costs.iter().all(|cost| *cost <= 0.0) && costs.iter().any(|cost| *cost < -1e-3), "{costs:?}");
    let gpu = plan("gpu", "gpu", forces);
    train(&TrainPlan { steps: Some(512), ..gpu.clone() }).unwrap();
    let resumed = train(&TrainPlan { resume: true, ..gpu }).unwrap();
    assert_eq!(resumed.result.last.hash(), whole.result.last.hash());
    let without = train(&plan("gpu", "without", "")).unwrap();
    assert_ne!(without.result.last.hash(), whole.result.last.hash());
}
