//! PPO and TRPO learn, and their results do not depend on threads or interruptions.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod line;
mod toy;
mod watch;

use line::Line;
use mishandle_rollout::Seed;
use mishandle_training::{Config, TrainingError};
use watch::{Watch, best_return, check_resumption, check_threads, mean_return, run};

const ALGORITHMS: [&str; 2] = ["ppo", "trpo"];

/// What else an algorithm may do: a step length that falls, a part of the Fisher information, and all that skrl does.
const OTHER_WAYS: [(&str, &str); 4] = [
    ("ppo", "learning_rate_schedule = \"linear\"\n"),
    ("trpo", "fisher_every = 3\n"),
    (
        "ppo",
        "preset = \"skrl-0.10\"\npolicy.normalize_observations = true\ncritic.normalize_values = true\n\
         value_clip = 0.2\nkl_threshold = 0.05\n",
    ),
    (
        "trpo",
        "preset = \"skrl-0.10\"\npolicy.normalize_observations = true\ncritic.normalize_values = true\n",
    ),
];

fn settings(algorithm: &str, text: &str) -> Config {
    let common = "episodes.environments = 48\nrollout_steps = 16\nminibatch_rows = 300\npolicy.hidden = [16]\n\
                  critic.hidden = [16]\nrun.validation_episodes = 10\nrun.validation_every = 2\n";
    Config::from_toml(algorithm, &format!("{common}{text}")).unwrap().unwrap()
}

fn all_ways() -> impl Iterator<Item = (&'static str, &'static str)> {
    ALGORITHMS.iter().map(|algorithm| (*algorithm, "")).chain(OTHER_WAYS)
}

/// Checks that the line is learned nearly as well as it can be.
#[track_caller]
fn check_learned(config: &Config, watch: &mut Watch) {
    let trained = run(2, config, None, watch);
    let (found, best) = (mean_return(&trained.last, 500), best_return(500));
    assert!(found > 0.98 * best, "mean return {found}, the best there is {best}");
    // Standing still gets two thirds: the mean of |x - goal| over the box is 2/3.
    assert!(best > 35.0, "{best}");
}

#[test]
fn the_line_is_learned_by_ppo() {
    let config = settings("ppo", "run.total_steps = 120_000\ngamma = 0.9\nepisodes.time_limit = 20");
    check_learned(&config, &mut Watch::default());
}

#[test]
fn the_line_is_learned_by_trpo_within_the_trust_region() {
    let text = "run.total_steps = 120_000\ngamma = 0.9\nepisodes.time_limit = 20\nmax_kl = 0.02";
    let mut watch = Watch::default();
    check_learned(&settings("trpo", text), &mut watch);
    assert!(watch.told.iter().all(|progress| progress.kl.is_some_and(|kl| (0.0..=0.02).contains(&kl))));
    let taken = watch.told.iter().filter(|progress| progress.kl > Some(0.0)).count();
    assert!(2 * taken > watch.told.len(), "{taken} steps of {} were taken", watch.told.len());
}

#[test]
fn deviations_stay_within_their_range() {
    for (algorithm, text) in
        [("ppo", "learning_rate = 0.03\nlearning_rate_schedule = \"constant\"\n"), ("trpo", "max_kl = 0.1\n")]
    {
        let text =
            format!("{text}policy.min_log_std = -0.55\npolicy.max_log_std = -0.5\nrun.total_steps = 20_000");
        let mut watch = Watch::default();
        run(2, &settings(algorithm, &text), None, &mut watch);
        // Of one action, the entropy is log σ + ½ log 2πe.
        let constant = 0.5 * (std::f64::consts::TAU.ln() + 1.0);
        let log_stds: Vec<f64> = watch.told.iter().map(|told| told.entropy.unwrap() - constant).collect();
        assert!(
            log_stds.iter().all(|x| (-0.55 - 1e-6..=-0.5 + 1e-6).contains(x)),
            "{algorithm}: {log_stds:?}"
        );
        // The line is learned with ever smaller deviations, so that the least one is reached.
        assert!(log_stds.last().unwrap() - -0.55 < 1e-6, "{algorithm}: {log_stds:?}");
    }
}

#[test]
fn threads_change_no_bit() {
    for (algorithm, way) in all_ways() {
        let text = format!("{way}run.total_steps = 4_000\nepisodes.action_noise = 0.2");
        assert_eq!(check_threads(&settings(algorithm, &text)), 6);
    }
}

#[test]
fn a_resumed_training_goes_on_to_the_same_bits() {
    for (algorithm, way) in all_ways() {
        let config = settings(algorithm, &format!("{way}run.total_steps = 4_600"));
        assert_eq!(check_resumption(&config, &[3]), 6);
    }
}

#[test]
fn every_way_is_another() {
    let hash = |(algorithm, way): (&str, &str)| {
        let config = settings(algorithm, &format!("{way}run.total_steps = 4_600"));
        run(2, &config, None, &mut Watch::default()).last.hash().to_string()
    };
    let mut hashes: Vec<String> = all_ways().map(hash).collect();
    hashes.sort();
    hashes.dedup();
    assert_eq!(hashes.len(), ALGORITHMS.len() + OTHER_WAYS.len());
}

#[test]
fn a_checkpoint_asked_for_between_the_regular_ones_changes_nothing_and_can_be_resumed() {
    let config = settings("ppo", "run.total_steps = 4_600");
    assert!(config.run().checkpoint_every > 6, "the settings ask for none before the end");
    let trained = run(2, &config, None, &mut Watch::default());
    let mut saving = Watch { save_after: Some(2), ..Watch::default() };
    assert_eq!(run(2, &config, None, &mut saving).last.hash(), trained.last.hash());
    let mut rest = Watch::default();
    let resumed = run(2, &config, saving.first_checkpoint.as_ref(), &mut rest);
    assert_eq!(rest.told[0].iteration, 3);
    assert_eq!(resumed.last.hash(), trained.last.hash());
}

#[test]
fn a_finished_training_resumed_gives_its_controller() {
    let config = settings("ppo", "run.total_steps = 1_000");
    let mut watch = Watch::default();
    let trained = run(1, &config, None, &mut watch);
    let mut nothing = Watch::default();
    let resumed = run(1, &config, watch.checkpoint.as_ref(), &mut nothing);
    assert_eq!(resumed.last.hash(), trained.last.hash());
    assert!(nothing.told.is_empty());
}

#[test]
fn seeds_differ() {
    let config = settings("ppo", "run.total_steps = 1_000");
    let hash = |seed| {
        let trained = config.train(&Line::new(0.0), Seed(seed), None, &mut Watch::default());
        trained.unwrap().last.hash()
    };
    assert_ne!(hash(1), hash(2));
    assert_eq!(hash(1), hash(1));
}

#[test]
fn training_ends_when_it_is_good_enough() {
    let config =
        settings("ppo", "run.total_steps = 1_000_000\nrun.stop_success = 0.1\nrun.stop_validations = 2");
    let mut watch = Watch::default();
    let trained = run(2, &config, None, &mut watch);
    assert!(trained.reached);
    assert_eq!(watch.told.len(), 4);
}

#[test]
fn a_checkpoint_of_another_training_is_refused() {
    let text = "run.total_steps = 1_000\n";
    let config = settings("ppo", text);
    let mut watch = Watch::default();
    run(1, &config, None, &mut watch);
    let checkpoint = watch.checkpoint.unwrap();
    let refusal = |config: &Config, seed| {
        config
            .train(&Line::new(0.0), Seed(seed), Some(&checkpoint), &mut Watch::default())
            .unwrap_err()
            .to_string()
    };
    assert_eq!(refusal(&config, 6), "the checkpoint's seed is 5, this training's is 6");
    let told = refusal(&settings("ppo", &format!("{text}epochs = 9")), 5);
    // Only what differs is told.
    assert_eq!(
        told,
        "the training began with other settings: `epochs` 5, now 9; go on with those, or begin again"
    );
    let mut longer = config.clone();
    longer.run_mut().total_steps = 2_000;
    let resumed = longer.train(&Line::new(0.0), Seed(5), Some(&checkpoint), &mut Watch::default());
    assert!(resumed.is_ok(), "only the number of steps may differ");
    let told = refusal(&settings("ppo", "run.total_steps = 1"), 5);
    assert!(told.ends_with(" environment steps behind it, and cannot end at 1"), "{told}");
}

#[test]
fn a_training_whose_steps_hang_on_its_length_is_not_made_longer() {
    let of = |steps: u64, more: &str| settings("ppo", &format!("run.total_steps = {steps}\n{more}"));
    let linear = "learning_rate_schedule = \"linear\"";
    let mut watch = Watch::default();
    run(1, &of(1_000, linear), None, &mut watch);
    let checkpoint = watch.checkpoint.unwrap();
    let checked = |config: &Config| config.check_resumption(&Line::new(0.0), Seed(5), &checkpoint);
    for steps in [100, 5_000] {
        let told = checked(&of(steps, linear)).unwrap_err().to_string();
        let refused = format!(
            "`run.total_steps` = 1000 cannot go on with {steps}: `learning_rate_schedule = \"linear\"`"
        );
        assert!(told.contains(&refused), "{told}");
        let trained =
            of(steps, linear).train(&Line::new(0.0), Seed(5), Some(&checkpoint), &mut Watch::default());
        assert!(trained.is_err());
    }
    // As many iterations, though not as many steps, and other settings are other things.
    assert!(checked(&of(999, linear)).is_ok() && checked(&of(1_000, linear)).is_ok());
    assert!(checked(&of(5_000, "")).unwrap_err().to_string().contains("began with other settings"));
}

#[test]
fn weights_that_run_wild_end_the_training_with_an_error() {
    let config = settings(
        "ppo",
        "learning_rate = 1e30\nlearning_rate_schedule = \"constant\"\nrun.total_steps = 100_000",
    );
    let error = config.train(&Line::new(0.0), Seed(1), None, &mut Watch::default()).unwrap_err();
    assert!(matches!(error, TrainingError::NotFinite { .. } | TrainingError::Network(_)), "{error}");
}
