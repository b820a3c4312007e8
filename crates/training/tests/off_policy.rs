//! SAC, TD3 and DDPG learn, and their results do not depend on the number of threads or on
//! interruptions.

use crate::harness::{RecordingObserver, best_return, check_resumption, check_threads, mean_return, run};
use crate::line::Line;
use mishandle_rollout::Seed;
use mishandle_training::{AlgorithmSettings, Origin};

const ALGORITHMS: [&str; 3] = ["sac", "td3", "ddpg"];

/// Variants: the clipped Gaussian of skrl's SAC, decaying noise, sampling without replacement, a
/// history.
const VARIANTS: [(&str, &str); 4] = [
    ("sac", "distribution = \"clipped\"\npolicy.initialization.normal = 0.1\n"),
    ("td3", "exploration_decay = { steps = 1_500, share = 0.1 }\nsmoothing_std = 0\n"),
    ("ddpg", "replay.replacement = false\nreplay.batch_size = 16\nreplay.updates_unit = \"control-steps\"\n"),
    ("sac", "policy.history = 2\n"),
];

fn settings_of(algorithm: &str, text: &str) -> AlgorithmSettings {
    let batch_size = if text.contains("batch_size") { "" } else { "replay.batch_size = 100\n" };
    let common = "episodes.environments = 16\nsteps_per_iteration = 25\npolicy.hidden = [16]\ncritic.hidden = [32]\n\
                  replay.warmup_steps = 500\nrun.validation_episodes = 10\n\
                  run.validation_interval = 2\nepisodes.time_limit = 20\n";
    AlgorithmSettings::from_toml(algorithm, &format!("{common}{batch_size}{text}")).unwrap().unwrap()
}

#[test]
fn each_algorithm_learns_the_line() {
    for algorithm in ALGORITHMS {
        let settings = settings_of(
            algorithm,
            "run.total_steps = 24_000\ngamma = 0.9\ntau = 0.01\nreplay.n_steps = 1\n\
             replay.updates_per_step = 0.5\nreplay.reward_scale = 1.0\npolicy.learning_rate = 0.003",
        );
        let trained = run(2, &settings, Origin::New, &mut RecordingObserver::default());
        let found = mean_return(&trained.last, 500);
        let best = best_return(500);
        assert!(found > 0.97 * best, "{algorithm}: mean return {found}, optimal {best}");
    }
}

fn all_variants() -> impl Iterator<Item = (&'static str, &'static str)> {
    ALGORITHMS.iter().map(|algorithm| (*algorithm, "")).chain(VARIANTS)
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    for (algorithm, variant) in all_variants() {
        let text = format!("{variant}run.total_steps = 2_000\nepisodes.action_noise = 0.2");
        assert_eq!(check_threads(&settings_of(algorithm, &text)), 5);
    }
}

#[test]
fn a_resumed_training_gives_the_same_bits() {
    for (algorithm, variant) in all_variants() {
        // The replay buffer of 1,600 entries fills up and overwrites its oldest entries.
        let settings =
            settings_of(algorithm, &format!("{variant}run.total_steps = 2_400\nreplay.capacity = 1_600"));
        // During the warm-up, and with a full replay buffer.
        assert_eq!(check_resumption(&settings, &[1, 5]), 6);
    }
}

#[test]
fn resuming_with_other_settings_is_an_error() {
    let settings = settings_of("td3", "run.total_steps = 400");
    let mut observer = RecordingObserver::default();
    run(1, &settings, Origin::New, &mut observer);
    let checkpoint = observer.checkpoint.unwrap();
    let resume = |settings: &AlgorithmSettings| {
        settings
            .train(
                &Line::new(0.0),
                Seed(5),
                Origin::Checkpoint(&checkpoint),
                &mut RecordingObserver::default(),
            )
            .map(|_| ())
    };
    assert!(
        resume(&settings_of("td3", "run.total_steps = 800")).is_ok(),
        "only the number of steps may differ"
    );
    let error = resume(&settings_of("td3", "run.total_steps = 400\ntau = 0.1")).unwrap_err().to_string();
    assert_eq!(error, "the training started with other settings: `tau` was 0.005, now 0.1");
    let error = resume(&settings_of("ddpg", "run.total_steps = 400")).unwrap_err().to_string();
    assert_eq!(error, "the checkpoint's algorithm is td3, this training's is ddpg");
}

#[test]
fn diverging_weights_are_an_error() {
    for algorithm in ALGORITHMS {
        let settings = settings_of(algorithm, "critic.learning_rate = 1e30\nrun.total_steps = 100_000");
        let error = settings
            .train(&Line::new(0.0), Seed(1), Origin::New, &mut RecordingObserver::default())
            .unwrap_err();
        let message = error.to_string();
        assert!(message.contains("training diverged") || message.contains("must be finite"), "{message}");
    }
}
