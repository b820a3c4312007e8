//! PPO and TRPO learn, and their results do not depend on the number of threads or on
//! interruptions.

use crate::harness::{RecordingObserver, best_return, check_resumption, check_threads, mean_return, run};
use crate::line::Line;
use mishandle_network::{DeviceBuffers, DeviceNetwork, Mlp, NetworkDevice, NetworkError, Workspace};
use mishandle_rollout::Seed;
use mishandle_training::{AlgorithmSettings, Origin, TrainingError};

const ALGORITHMS: [&str; 2] = ["ppo", "trpo"];

/// Variants: linear learning rate schedule, subsampled Fisher matrix, a history, the skrl bases.
const VARIANTS: [(&str, &str); 5] = [
    ("ppo", "learning_rate_schedule = \"linear\"\n"),
    ("trpo", "fisher_subsampling = 3\n"),
    (
        "ppo",
        "base = \"skrl-0.10\"\npolicy.normalize_observations = true\ncritic.normalize_values = true\n\
         value_clip = 0.2\nkl_threshold = 0.05\n",
    ),
    ("ppo", "policy.history = 2\n"),
    ("trpo", "base = \"skrl-0.10\"\npolicy.normalize_observations = true\ncritic.normalize_values = true\n"),
];

fn settings_of(algorithm: &str, text: &str) -> AlgorithmSettings {
    let common = "episodes.environments = 48\nrollout_steps = 16\nminibatch_size = 300\npolicy.hidden = [16]\n\
                  critic.hidden = [16]\nrun.validation_episodes = 10\nrun.validation_interval = 2\n";
    AlgorithmSettings::from_toml(algorithm, &format!("{common}{text}")).unwrap().unwrap()
}

fn all_variants() -> impl Iterator<Item = (&'static str, &'static str)> {
    ALGORITHMS.iter().map(|algorithm| (*algorithm, "")).chain(VARIANTS)
}

/// Checks that training on the line environment reaches at least 98 % of the optimal return.
#[track_caller]
fn check_learned(settings: &AlgorithmSettings, observer: &mut RecordingObserver) {
    let trained = run(2, settings, Origin::New, observer);
    let found = mean_return(&trained.last, 500);
    let best = best_return(500);
    assert!(found > 0.98 * best, "mean return {found}, optimal {best}");
    // A policy that does not move reaches a third: the mean of |x - goal| over the space is 2/3.
    assert!(best > 35.0, "{best}");
}

#[test]
fn ppo_learns_the_line() {
    let settings = settings_of("ppo", "run.total_steps = 120_000\ngamma = 0.9\nepisodes.time_limit = 20");
    check_learned(&settings, &mut RecordingObserver::default());
}

#[test]
fn trpo_learns_the_line_within_the_trust_region() {
    let text = "run.total_steps = 120_000\ngamma = 0.9\nepisodes.time_limit = 20\nmax_kl = 0.02";
    let mut observer = RecordingObserver::default();
    check_learned(&settings_of("trpo", text), &mut observer);
    assert!(
        observer.progress.iter().all(|progress| progress.kl.is_some_and(|kl| (0.0..=0.02).contains(&kl)))
    );
    let taken = observer.progress.iter().filter(|progress| progress.kl > Some(0.0)).count();
    assert!(2 * taken > observer.progress.len(), "{taken} steps of {} were taken", observer.progress.len());
}

#[test]
fn log_std_stays_within_its_bounds() {
    for (algorithm, text) in
        [("ppo", "learning_rate = 0.03\nlearning_rate_schedule = \"constant\"\n"), ("trpo", "max_kl = 0.1\n")]
    {
        let text =
            format!("{text}policy.min_log_std = -0.55\npolicy.max_log_std = -0.5\nrun.total_steps = 20_000");
        let mut observer = RecordingObserver::default();
        run(2, &settings_of(algorithm, &text), Origin::New, &mut observer);
        // The entropy of one action dimension is log σ + ½ log 2πe.
        let constant = 0.5 * (std::f64::consts::TAU.ln() + 1.0);
        let log_stds: Vec<f64> =
            observer.progress.iter().map(|progress| progress.entropy.unwrap() - constant).collect();
        assert!(
            log_stds.iter().all(|x| (-0.55 - 1e-6..=-0.5 + 1e-6).contains(x)),
            "{algorithm}: {log_stds:?}"
        );
        // σ decreases while the line is learned, so that it reaches its lower bound.
        assert!(log_stds.last().unwrap() - -0.55 < 1e-6, "{algorithm}: {log_stds:?}");
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    for (algorithm, variant) in all_variants() {
        let text = format!("{variant}run.total_steps = 4_000\nepisodes.action_noise = 0.2");
        assert_eq!(check_threads(&settings_of(algorithm, &text)), 6);
    }
}

#[test]
fn a_resumed_training_gives_the_same_bits() {
    for (algorithm, variant) in all_variants() {
        let settings = settings_of(algorithm, &format!("{variant}run.total_steps = 4_600"));
        assert_eq!(check_resumption(&settings, &[3]), 6);
    }
}

#[test]
fn every_variant_gives_other_weights() {
    let hash = |(algorithm, variant): (&str, &str)| {
        let settings = settings_of(algorithm, &format!("{variant}run.total_steps = 4_600"));
        run(2, &settings, Origin::New, &mut RecordingObserver::default()).last.hash().to_string()
    };
    let mut hashes: Vec<String> = all_variants().map(hash).collect();
    hashes.sort();
    hashes.dedup();
    assert_eq!(hashes.len(), ALGORITHMS.len() + VARIANTS.len());
}

#[test]
fn an_additional_checkpoint_changes_nothing_and_can_be_resumed() {
    let settings = settings_of("ppo", "run.total_steps = 4_600");
    assert!(settings.run().checkpoint_interval > 6, "the settings request no checkpoint before the end");
    let trained = run(2, &settings, Origin::New, &mut RecordingObserver::default());
    let mut saving = RecordingObserver { save_after: Some(2), ..RecordingObserver::default() };
    assert_eq!(run(2, &settings, Origin::New, &mut saving).last.hash(), trained.last.hash());
    let mut rest = RecordingObserver::default();
    let resumed = run(2, &settings, Origin::Checkpoint(saving.first_checkpoint.as_ref().unwrap()), &mut rest);
    assert_eq!(rest.progress[0].iteration, 3);
    assert_eq!(resumed.last.hash(), trained.last.hash());
}

#[test]
fn resuming_a_finished_training_returns_its_controller() {
    let settings = settings_of("ppo", "run.total_steps = 1_000");
    let mut observer = RecordingObserver::default();
    let trained = run(1, &settings, Origin::New, &mut observer);
    let mut nothing = RecordingObserver::default();
    let resumed = run(1, &settings, Origin::Checkpoint(observer.checkpoint.as_ref().unwrap()), &mut nothing);
    assert_eq!(resumed.last.hash(), trained.last.hash());
    assert!(nothing.progress.is_empty());
}

#[test]
fn different_seeds_give_different_weights() {
    let settings = settings_of("ppo", "run.total_steps = 1_000");
    let hash = |seed| {
        let trained =
            settings.train(&Line::new(0.0), Seed(seed), Origin::New, &mut RecordingObserver::default());
        trained.unwrap().last.hash()
    };
    assert_ne!(hash(1), hash(2));
    assert_eq!(hash(1), hash(1));
}

#[test]
fn training_stops_early_when_it_reaches_the_target_rates() {
    let settings =
        settings_of("ppo", "run.total_steps = 1_000_000\nrun.stop_success = 0.1\nrun.stop_validations = 2");
    let mut observer = RecordingObserver::default();
    let trained = run(2, &settings, Origin::New, &mut observer);
    assert!(trained.reached_target);
    assert_eq!(observer.progress.len(), 4);
}

#[test]
fn resuming_with_another_seed_or_other_settings_is_an_error() {
    let text = "run.total_steps = 1_000\n";
    let settings = settings_of("ppo", text);
    let mut observer = RecordingObserver::default();
    run(1, &settings, Origin::New, &mut observer);
    let checkpoint = observer.checkpoint.unwrap();
    let resume_error = |settings: &AlgorithmSettings, seed| {
        settings
            .train(
                &Line::new(0.0),
                Seed(seed),
                Origin::Checkpoint(&checkpoint),
                &mut RecordingObserver::default(),
            )
            .unwrap_err()
            .to_string()
    };
    assert_eq!(resume_error(&settings, 6), "the checkpoint's seed is 5, this training's is 6");
    let error = resume_error(&settings_of("ppo", &format!("{text}epochs = 9")), 5);
    // The message names only the settings that differ.
    assert_eq!(error, "the training started with other settings: `epochs` was 5, now 9");
    let mut longer = settings.clone();
    longer.run_mut().total_steps = 2_000;
    let resumed = longer.train(
        &Line::new(0.0),
        Seed(5),
        Origin::Checkpoint(&checkpoint),
        &mut RecordingObserver::default(),
    );
    assert!(resumed.is_ok(), "only the number of steps may differ");
    let error = resume_error(&settings_of("ppo", "run.total_steps = 1"), 5);
    assert!(error.ends_with(" environment steps; `run.total_steps` = 1 is fewer"), "{error}");
}

#[test]
fn a_training_that_depends_on_its_length_cannot_resume_with_another_length() {
    let of = |steps: u64, more: &str| settings_of("ppo", &format!("run.total_steps = {steps}\n{more}"));
    let linear = "learning_rate_schedule = \"linear\"";
    let mut observer = RecordingObserver::default();
    run(1, &of(1_000, linear), Origin::New, &mut observer);
    let checkpoint = observer.checkpoint.unwrap();
    let checked =
        |settings: &AlgorithmSettings| settings.check_resumption(&Line::new(0.0), Seed(5), &checkpoint);
    for steps in [100, 5_000] {
        let error = checked(&of(steps, linear)).unwrap_err().to_string();
        let expected = format!(
            "`run.total_steps` = 1000 cannot resume with {steps}: `learning_rate_schedule = \"linear\"`"
        );
        assert!(error.contains(&expected), "{error}");
        let trained = of(steps, linear).train(
            &Line::new(0.0),
            Seed(5),
            Origin::Checkpoint(&checkpoint),
            &mut RecordingObserver::default(),
        );
        assert!(trained.is_err());
    }
    // An equal number of iterations is allowed, even if the number of steps differs.
    assert!(checked(&of(999, linear)).is_ok() && checked(&of(1_000, linear)).is_ok());
    assert!(checked(&of(5_000, "")).unwrap_err().to_string().contains("started with other settings"));
}

#[test]
fn diverging_weights_are_an_error() {
    let settings = settings_of(
        "ppo",
        "learning_rate = 1e30\nlearning_rate_schedule = \"constant\"\nrun.total_steps = 100_000",
    );
    let error =
        settings.train(&Line::new(0.0), Seed(1), Origin::New, &mut RecordingObserver::default()).unwrap_err();
    assert!(matches!(error, TrainingError::NotFinite { .. } | TrainingError::Network(_)), "{error}");
}

/// Computes networks with their own passes, all rows at once. Fails after a number of backward
/// passes.
struct OtherDevice {
    passes: usize,
}

struct OtherNetwork {
    network: Mlp<f32>,
    workspace: Workspace<f32>,
    buffers: [Vec<f32>; 5],
    passes: usize,
}

impl NetworkDevice for OtherDevice {
    fn network(&self, network: &Mlp<f32>, rows: usize) -> Result<Box<dyn DeviceNetwork>, NetworkError> {
        let inputs = rows * network.input_size();
        let outputs = rows * network.output_size();
        let parameters = network.parameter_count();
        Ok(Box::new(OtherNetwork {
            network: network.clone(),
            workspace: Workspace::default(),
            buffers: [parameters, inputs, outputs, outputs, parameters].map(|length| vec![0.0; length]),
            passes: self.passes,
        }))
    }
}

impl DeviceNetwork for OtherNetwork {
    fn buffers(&mut self) -> DeviceBuffers<'_> {
        let [parameters, inputs, outputs, output_gradient, parameter_gradient] = &mut self.buffers;
        DeviceBuffers { parameters, inputs, outputs, output_gradient, parameter_gradient }
    }

    fn forward(&mut self) -> Result<(), NetworkError> {
        let OtherNetwork { network, workspace, buffers: [parameters, inputs, outputs, ..], .. } = self;
        network.update(|own| own.copy_from_slice(parameters));
        outputs.copy_from_slice(network.forward(inputs, workspace));
        Ok(())
    }

    fn backward(&mut self) -> Result<(), NetworkError> {
        let lost = || NetworkError::Device { reason: "the device is lost".to_string() };
        self.passes = self.passes.checked_sub(1).ok_or_else(lost)?;
        let OtherNetwork { network, workspace, buffers: [.., output_gradient, parameter_gradient], .. } =
            self;
        parameter_gradient.fill(0.0);
        network.backward(output_gradient, workspace, Some(parameter_gradient), None);
        Ok(())
    }
}

#[test]
fn networks_on_another_device_give_the_same_training_up_to_rounding() {
    for history in [0, 2] {
        let text = format!("run.total_steps = 2304\nentropy_coef = 0.01\npolicy.history = {history}\n");
        check_device(&settings_of("ppo", &text));
    }
}

/// Checks training with minibatches of 300, 300 and 168 rows.
fn check_device(settings: &AlgorithmSettings) {
    let train_on = |device: &dyn NetworkDevice| {
        settings.train_on(&Line::new(0.05), device, Seed(5), Origin::New, &mut RecordingObserver::default())
    };
    let expected =
        settings.train(&Line::new(0.05), Seed(5), Origin::New, &mut RecordingObserver::default()).unwrap();
    let found = train_on(&OtherDevice { passes: usize::MAX }).unwrap();
    let numbers = |policy: &mishandle_controllers::Policy| {
        let weights = policy.network().parameters().to_vec();
        let log_std = policy.log_std().to_vec();
        [weights, log_std].concat()
    };
    let expected = numbers(&expected.last);
    let found = numbers(&found.last);
    let largest = expected.iter().zip(&found).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest < 1e-4, "largest difference of a parameter: {largest}");
    assert!(largest > 0.0, "the device was not used: its sums have another order");

    let error = train_on(&OtherDevice { passes: 7 }).unwrap_err().to_string();
    assert!(error.contains("the device is lost"), "{error}");
}
