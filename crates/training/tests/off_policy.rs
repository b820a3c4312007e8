//! SAC, TD3 and DDPG learn, and their results do not depend on threads or interruptions.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod line;
mod toy;
mod watch;

use line::Line;
use mishandle_rollout::Seed;
use mishandle_training::Config;
use watch::{Watch, best_return, check_resumption, check_threads, mean_return, run};

const ALGORITHMS: [&str; 3] = ["sac", "td3", "ddpg"];

/// What else an algorithm may do: the policy that skrl's SAC has, noise that falls, batches without repetition.
const OTHER_WAYS: [(&str, &str); 3] = [
    ("sac", "distribution = \"clipped\"\npolicy.initialization.normal = 0.1\n"),
    ("td3", "exploration_decay = { steps = 1_500, share = 0.1 }\nsmoothing_std = 0\n"),
    (
        "ddpg",
        "replay.replacement = false\nreplay.batch_rows = 16\nreplay.updates_count = \"control-steps\"\n",
    ),
];

fn settings(algorithm: &str, text: &str) -> Config {
    let batch_rows = if text.contains("batch_rows") { "" } else { "replay.batch_rows = 100\n" };
    let common = "episodes.environments = 16\nsteps_per_iteration = 25\npolicy.hidden = [16]\ncritic.hidden = [32]\n\
                  replay.warmup_steps = 500\nrun.validation_episodes = 10\n\
                  run.validation_every = 2\nepisodes.time_limit = 20\n";
    Config::from_toml(algorithm, &format!("{common}{batch_rows}{text}")).unwrap().unwrap()
}

#[test]
fn the_line_is_learned() {
    for algorithm in ALGORITHMS {
        let config = settings(
            algorithm,
            "run.total_steps = 24_000\ngamma = 0.9\ntau = 0.01\nreplay.n_steps = 1\n\
             replay.updates_per_step = 0.5\nreplay.reward_scale = 1.0\npolicy.learning_rate = 0.003",
        );
        let trained = run(2, &config, None, &mut Watch::default());
        let (found, best) = (mean_return(&trained.last, 500), best_return(500));
        assert!(found > 0.97 * best, "{algorithm}: mean return {found}, the best there is {best}");
    }
}

fn all_ways() -> impl Iterator<Item = (&'static str, &'static str)> {
    ALGORITHMS.iter().map(|algorithm| (*algorithm, "")).chain(OTHER_WAYS)
}

#[test]
fn threads_change_no_bit() {
    for (algorithm, way) in all_ways() {
        let text = format!("{way}run.total_steps = 2_000\nepisodes.action_noise = 0.2");
        assert_eq!(check_threads(&settings(algorithm, &text)), 5);
    }
}

#[test]
fn a_resumed_training_goes_on_to_the_same_bits() {
    for (algorithm, way) in all_ways() {
        // The ring of 1,600 entries is filled and written over.
        let config = settings(algorithm, &format!("{way}run.total_steps = 2_400\nreplay.capacity = 1_600"));
        // In the midst of the warm-up, and when the ring is full.
        assert_eq!(check_resumption(&config, &[1, 5]), 6);
    }
}

#[test]
fn a_checkpoint_of_other_settings_is_refused() {
    let config = settings("td3", "run.total_steps = 400");
    let mut watch = Watch::default();
    run(1, &config, None, &mut watch);
    let checkpoint = watch.checkpoint.unwrap();
    let resume = |config: &Config| {
        config.train(&Line::new(0.0), Seed(5), Some(&checkpoint), &mut Watch::default()).map(|_| ())
    };
    assert!(resume(&settings("td3", "run.total_steps = 800")).is_ok(), "only the number of steps may differ");
    let told = resume(&settings("td3", "run.total_steps = 400\ntau = 0.1")).unwrap_err().to_string();
    assert_eq!(
        told,
        "the training began with other settings: `tau` 0.005, now 0.1; go on with those, or begin again"
    );
    let told = resume(&settings("ddpg", "run.total_steps = 400")).unwrap_err().to_string();
    assert_eq!(told, "the checkpoint's algorithm is td3, this training's is ddpg");
}

#[test]
fn weights_that_run_wild_end_the_training_with_an_error() {
    for algorithm in ALGORITHMS {
        let config = settings(algorithm, "critic.learning_rate = 1e30\nrun.total_steps = 100_000");
        let error = config.train(&Line::new(0.0), Seed(1), None, &mut Watch::default()).unwrap_err();
        let told = error.to_string();
        assert!(told.contains("training broke down") || told.contains("must be finite"), "{told}");
    }
}
