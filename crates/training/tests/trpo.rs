//! TRPO learns within its trust region, and its results do not depend on threads or interruptions.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod line;
mod watch;

use line::Line;
use mishandle_rollout::Seed;
use mishandle_training::{Checkpoint, Config, Trained};
use watch::{Watch, best_return, facts, mean_return};

fn settings(text: &str) -> Config {
    let common = "episodes.environments = 48\nrollout_steps = 16\nminibatch_rows = 300\npolicy.hidden = [16]\n\
                  critic.hidden = [16]\nrun.validation_episodes = 10\nrun.validation_every = 2\n";
    Config::from_toml("trpo", &format!("{common}{text}")).unwrap().unwrap()
}

fn run(threads: usize, config: &Config, resume: Option<&Checkpoint>, watch: &mut Watch) -> Trained {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| config.train(Line::new(0.05), Seed(5), resume, watch)).unwrap()
}

#[test]
fn the_line_is_learned_within_the_trust_region() {
    let config = settings("run.total_steps = 120_000\ngamma = 0.9\nepisodes.time_limit = 20\nmax_kl = 0.02");
    let mut watch = Watch::default();
    let trained = run(2, &config, None, &mut watch);
    let (found, best) = (mean_return(&trained.last, 500), best_return(500));
    assert!(found > 0.98 * best, "mean return {found}, the best there is {best}");
    assert!(watch.told.iter().all(|progress| progress.kl.is_some_and(|kl| (0.0..=0.02).contains(&kl))));
    let taken = watch.told.iter().filter(|progress| progress.kl > Some(0.0)).count();
    assert!(2 * taken > watch.told.len(), "{taken} steps of {} were taken", watch.told.len());
}

#[test]
fn threads_change_no_bit() {
    let config = settings("run.total_steps = 4_000\nepisodes.action_noise = 0.2\nfisher_every = 3");
    let (mut one, mut many) = (Watch::default(), Watch::default());
    let trained = run(1, &config, None, &mut one);
    for threads in [2, 4] {
        many = Watch::default();
        let again = run(threads, &config, None, &mut many);
        assert_eq!(trained.last.hash(), again.last.hash(), "{threads} threads");
        assert_eq!(facts(&one), facts(&many), "{threads} threads");
    }
    assert_eq!(many.told.len(), 6);
}

#[test]
fn a_resumed_training_goes_on_to_the_same_bits() {
    let config = settings("run.total_steps = 4_600");
    let mut whole = Watch::default();
    let trained = run(2, &config, None, &mut whole);
    let mut first = Watch { stop_after: Some(3), ..Watch::default() };
    run(2, &config, None, &mut first);
    let mut second = Watch::default();
    let resumed = run(3, &config, first.checkpoint.as_ref(), &mut second);
    assert_eq!(resumed.last.hash(), trained.last.hash());
    assert_eq!(facts(&second), facts(&whole)[3..]);
}
