//! What a training takes is told by the settings that decide it.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod line;
mod toy;

use line::Line;
use mishandle_rollout::{Environment, EnvironmentSpec};
use mishandle_training::Config;

fn need(algorithm: &str, text: &str, settings: &str) -> f64 {
    let config = Config::from_toml(algorithm, text).unwrap().unwrap();
    let needs = config.memory_needs(&EnvironmentSpec::of(&*Line::new(0.0)));
    needs.iter().find(|need| need.settings == settings).unwrap().bytes
}

#[test]
fn a_replay_takes_what_its_entries_take_and_what_is_filled_thrice_more_in_a_checkpoint() {
    let line = Line::new(0.0);
    // Four bytes for each number of what was seen and done and for the reward, one for the kind of the entry.
    let entry = (4 * (line.observation_size() + line.action_size() + 1) + 1) as f64;
    for algorithm in ["sac", "td3", "ddpg"] {
        for (steps, entries) in [(1_000_000, 8e6), (5_000_000, 2e7), (9_000_000, 2e7)] {
            let text = format!("replay.capacity = 5_000_000\nrun.total_steps = {steps}");
            assert_eq!(need(algorithm, &text, "replay.capacity"), entries * entry, "{steps}");
        }
    }
}

#[test]
fn a_batch_takes_what_was_seen_before_and_after_and_done() {
    let line = Line::new(0.0);
    let row = (4 * (2 * line.observation_size() + line.action_size())) as f64;
    assert_eq!(need("sac", "replay.batch_rows = 100_000_000_000", "replay.batch_rows"), 1e11 * row);
}

#[test]
fn a_rollout_and_its_simulations_grow_with_their_number() {
    for algorithm in ["ppo", "trpo"] {
        for settings in ["rollout_steps and episodes.environments", "episodes.environments"] {
            let of = |environments: usize| {
                need(algorithm, &format!("episodes.environments = {environments}"), settings)
            };
            assert!(of(100) > 0.0, "{settings}");
            assert_eq!(of(10_000_000), 1e5 * of(100), "{settings}");
        }
        // The largest that settings may be: no product overflows.
        let text = "rollout_steps = 1_000_000_000_000\nepisodes.environments = 1_000_000_000_000";
        assert!(need(algorithm, text, "rollout_steps and episodes.environments") > 1e24);
    }
}

#[test]
fn networks_take_four_numbers_for_each_parameter() {
    // 2 · (n + 1) · 10 + 2 · (10 + 1) · 20 parameters of 4 bytes: weight, gradient, two moments.
    let n = Line::new(0.0).observation_size();
    let text = "policy.hidden = [10, 20]\ncritic.hidden = [10, 20]";
    let count = 2 * (n + 1) * 10 + 2 * 11 * 20;
    assert_eq!(need("ppo", text, "policy.hidden and critic.hidden"), (16 * count) as f64);
}
