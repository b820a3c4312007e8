//! Training that starts from a controller: `train --from`.

use std::path::Path;

use mishandle::MishandleError;
use mishandle::controllers::ControllerFile;
use mishandle::plan::TrainPlan;
use mishandle::train::{TrainObserver, algorithm_of, train};
use mishandle::training::{AlgorithmSettings, TrainingControl, TrainingProgress};

struct Silent;

impl TrainObserver for Silent {
    fn iteration_finished(&mut self, _progress: &TrainingProgress) -> TrainingControl {
        TrainingControl::Continue
    }
    fn write_failed(&mut self, _error: &MishandleError) {}
}

fn plan(folder: &Path, algorithm: &str, from: &str) -> TrainPlan {
    let environments =
        "[episodes]\nenvironments = 8\n[run]\nvalidation_episodes = 2\ncritic_steps = 1_000_000\n";
    let own = if algorithm == "ppo" {
        "rollout_steps = 16\nminibatch_size = 64\n"
    } else {
        "steps_per_iteration = 16\n"
    };
    // The layers are those of the controller.
    let record = ControllerFile::load(&Path::new("controllers").join(format!("{from}.safetensors"))).unwrap();
    let recorded =
        AlgorithmSettings::from_toml(algorithm, &record.header.training.settings).unwrap().unwrap();
    let layers: toml::Table = recorded.to_toml().parse().unwrap();
    let policy = layers["policy"].as_table().unwrap();
    let text = format!(
        "{own}{environments}[policy]\nhidden = {}\nactivation = {}\n",
        policy["hidden"], policy["activation"]
    );
    let settings = folder.join("settings.toml");
    std::fs::write(&settings, text).unwrap();
    TrainPlan {
        task: "point-reaching".to_string(),
        algorithm: algorithm.to_string(),
        reward: "shaped".to_string(),
        settings: Some(settings),
        from: Some(from.to_string()),
        steps: Some(256),
        space: Some("delay".to_string()),
        seed: 2,
        out: folder.join("out.safetensors"),
        ..TrainPlan::default()
    }
}

#[test]
fn a_shipped_controller_stays_as_it_is_while_only_the_critic_learns() {
    for algorithm in ["ppo", "sac"] {
        let folder = tempfile::tempdir().unwrap();
        let name = format!("point-reaching/{algorithm}");
        assert_eq!(algorithm_of("point-reaching", &name).unwrap(), algorithm);
        let plan = plan(folder.path(), algorithm, &name);
        train(&plan, None, &mut Silent).unwrap();
        let shipped =
            ControllerFile::load(&Path::new("controllers").join(format!("{name}.safetensors"))).unwrap();
        let trained = ControllerFile::load(&plan.last()).unwrap();
        assert_eq!(trained.policy.network().parameters(), shipped.policy.network().parameters());
        assert_eq!(trained.policy.mean(), shipped.policy.mean());
        let record = trained.header.training;
        assert!(record.settings.contains(&format!("from = \"{name}\"")), "{}", record.settings);
        assert!(record.command.contains(&format!("--from {name}")), "{}", record.command);
    }
}

#[test]
fn a_start_that_cannot_be_trained_is_an_error_before_any_file_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let good = plan(folder.path(), "ppo", "point-reaching/ppo");
    for (from, part) in [
        ("expert", "the controller to start from is the expert"),
        ("nobody", "no controller `nobody`"),
        ("ball-balancing/ppo", "ball-balancing"),
        ("missing.safetensors", "missing.safetensors"),
        ("point-reaching/sac", "layers"),
    ] {
        let error = train(&TrainPlan { from: Some(from.to_string()), ..good.clone() }, None, &mut Silent);
        let error = format!("{:#}", error.unwrap_err());
        assert!(error.contains(part), "{from}: {error}");
        assert!(!good.out.exists() && !good.checkpoint().exists(), "{from}");
    }
    let other = TrainPlan { settings: None, from: Some("point-reaching/sac".to_string()), ..good };
    let error = train(&other, None, &mut Silent).unwrap_err().to_string();
    assert!(error.contains("the algorithm is ppo"), "{error}");
}
