//! What a replay remembers: returns of some steps, where they end, the ring, batches.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod toy;

use std::sync::Arc;

use mishandle_network::Normalizer;
use mishandle_rollout::{EnvironmentWorker, Sample, Scenario, Seed, StepStatus};
use mishandle_training::replay::{Batch, Replay, Sampling};
use mishandle_training::{Checkpoint, EpisodeSettings, Episodes};
use toy::{Toy, names, space};

/// Shows how many control steps it has made, and its fate, the value of x₀; the reward of the k-th step is 10^k, counted
/// from 0. A fate of at least 1 is to be ended by the task at step 4.
#[derive(Clone)]
struct Powers;

fn powers(fate: f64) -> Arc<Toy<Powers>> {
    Arc::new(Toy {
        name: "powers",
        space: space(&[("fate", fate, fate + 0.5)]),
        signals: names(&["step"]),
        reward_terms: names(&["power"]),
        observation_size: 1,
        action_size: 1,
        state_size: 2,
        episode_steps: 300,
        worker: Powers,
    })
}

impl EnvironmentWorker for Powers {
    fn reset(&mut self, scenario: &Scenario, _seed: Seed, state: &mut [f64], sample: Sample<'_>) {
        state.copy_from_slice(&[0.0, scenario.get(0).unwrap()]);
        sample.observation[0] = 0.0;
        sample.rewards.fill(0.0);
    }

    fn step(&mut self, _action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        sample.rewards[0] = 10.0_f64.powf(state[0]);
        state[0] += 1.0;
        sample.observation[0] = state[0] as f32;
        if state[1] >= 1.0 && state[0] == 4.0 { StepStatus::Terminated } else { StepStatus::Running }
    }
}

/// Rows that have made `steps` control steps, in episodes of 5 unless their fate ends them at 4; the action tells the step.
fn remembered(fate: f64, rows: usize, steps: usize, capacity: usize) -> (Replay, Episodes) {
    let mut replay = Replay::new(capacity, rows, 1, 1);
    let settings = EpisodeSettings { environments: rows, time_limit: Some(5), ..EpisodeSettings::default() };
    let settings = EpisodeSettings { staggered: false, ..settings };
    let mut episodes = Episodes::new(&powers(fate), &settings, Seed(3)).unwrap();
    for step in 0..steps {
        step_once(&mut replay, &mut episodes, step);
    }
    (replay, episodes)
}

fn step_once(replay: &mut Replay, episodes: &mut Episodes, step: usize) {
    let seen = episodes.observations().to_vec();
    let actions = vec![step as f32 / 100.0; episodes.rows()];
    episodes.step(&actions).unwrap();
    replay.push(&seen, &actions, episodes);
}

/// γ = ½
fn sampling(n_steps: usize) -> Sampling {
    Sampling { n_steps, gamma: 0.5, reward_scale: 2.0, replacement: true }
}

/// The `index`-th batch of 400 rows.
fn batch(replay: &Replay, n_steps: usize, index: u64) -> Batch<f32> {
    let plain = Normalizer::new(&[0.0], &[1.0]).unwrap();
    let mut batch = Batch::default();
    replay.sample(&sampling(n_steps), (Seed(7), index), 400, &plain, &mut batch);
    batch
}

/// Checks what follows a start with the observation `seen`: half of the returns (rewards are doubled), discount, and
/// what is seen then. Numbers up to 5 pass the scaling, which clips at 5, unchanged.
#[track_caller]
fn check(fate: f64, n_steps: usize, seen: f32, half_returns: f32, discount: f32, next: Option<f32>) {
    let (replay, _) = remembered(fate, 3, 40, 10_000);
    let batch = batch(&replay, n_steps, 0);
    let rows: Vec<usize> = (0..batch.rows()).filter(|row| batch.observations[*row] == seen).collect();
    assert!(rows.len() > 20, "{} rows", rows.len());
    for row in rows {
        assert_eq!((batch.returns[row], batch.discounts[row]), (2.0 * half_returns, discount));
        if let Some(next) = next {
            assert!((batch.next_observations[row] - next).abs() < 1e-6, "{}", batch.next_observations[row]);
        }
    }
}

#[test]
fn one_step() {
    check(0.0, 1, 2.0, 100.0, 0.5, Some(3.0));
}

#[test]
fn three_steps_within_an_episode() {
    // 10 + 100 / 2 + 1000 / 4
    check(0.0, 3, 1.0, 310.0, 0.125, Some(4.0));
}

#[test]
fn the_clock_cuts_the_sum_and_shows_the_true_last_observation() {
    // The last step of 5: 10^4, then the observation 5, not 0 of the next episode.
    check(0.0, 1, 4.0, 10_000.0, 0.5, Some(5.0));
    // 1000 + 10,000 / 2 and no third step.
    check(0.0, 3, 3.0, 6_000.0, 0.25, Some(5.0));
    // Three whole steps that end with the clock.
    check(0.0, 3, 2.0, 100.0 + 500.0 + 2_500.0, 0.125, Some(5.0));
}

#[test]
fn the_task_cuts_the_sum_and_nothing_follows() {
    check(1.0, 1, 3.0, 1_000.0, 0.0, None);
    check(1.0, 3, 2.0, 600.0, 0.0, None);
    check(1.0, 3, 1.0, 310.0, 0.0, None);
    check(1.0, 3, 0.0, 1.0 + 5.0 + 25.0, 0.125, Some(3.0));
}

#[test]
fn a_last_observation_starts_nothing() {
    let (replay, _) = remembered(0.0, 3, 40, 10_000);
    for index in 0..5 {
        let batch = batch(&replay, 2, index);
        assert!(batch.observations.iter().all(|seen| *seen < 5.0));
        assert_eq!(batch.rows(), 400);
    }
}

#[test]
fn a_full_ring_holds_the_newest_steps_alone() {
    // Two rows of 30 entries, of which every sixth is a last observation: 25 steps are held.
    let (replay, _) = remembered(0.0, 2, 90, 60);
    let mut drawn: Vec<i32> = (0..20)
        .flat_map(|index| batch(&replay, 3, index).actions)
        .map(|a| (100.0 * a).round() as i32)
        .collect();
    drawn.sort_unstable();
    drawn.dedup();
    // The newest 3 entries are the last observation and steps 89 and 88: not yet followed by enough.
    assert_eq!(drawn, (65..=87).collect::<Vec<i32>>());
    // What follows is right also where the ring's end lies between.
    let batch = batch(&replay, 3, 0);
    for row in 0..batch.rows() {
        let seen = batch.observations[row];
        let wanted = if seen < 3.0 { seen + 3.0 } else { 5.0 };
        assert!((batch.next_observations[row] - wanted).abs() < 1e-6, "{seen}");
    }
}

#[test]
fn starts_are_drawn_evenly() {
    let (replay, _) = remembered(0.0, 4, 52, 10_000);
    let mut counts = std::collections::BTreeMap::new();
    for index in 0..50 {
        for action in batch(&replay, 1, index).actions {
            *counts.entry((100.0 * action).round() as i32).or_insert(0) += 1;
        }
    }
    // 52 steps, the last without what follows: 20,000 draws, 392 for each; five deviations of a Poisson number.
    assert_eq!(counts.len(), 51);
    for (step, count) in counts {
        assert!((f64::from(count) - 392.0).abs() < 5.0 * 392.0_f64.sqrt(), "step {step}: {count}");
    }
}

#[test]
fn without_replacement_no_start_comes_twice() {
    let (replay, _) = remembered(0.0, 3, 10, 10_000);
    let plain = Normalizer::new(&[0.0], &[1.0]).unwrap();
    let mut seen = std::collections::BTreeSet::new();
    for index in 0..50 {
        let mut batch = Batch::default();
        let sampling = Sampling { replacement: false, ..sampling(1) };
        replay.sample(&sampling, (Seed(7), index), 20, &plain, &mut batch);
        let distinct: std::collections::BTreeSet<usize> = batch.starts.iter().copied().collect();
        assert_eq!((batch.rows(), distinct.len()), (20, 20));
        seen.extend(distinct);
    }
    // Ten steps of each row; the clock ended the last one's episode, so that its last observation is there too.
    assert_eq!(seen.len(), 3 * 10);
}

#[test]
fn batches_differ_and_observations_are_scaled() {
    let (replay, _) = remembered(0.0, 3, 40, 10_000);
    assert_ne!(batch(&replay, 1, 0), batch(&replay, 1, 1));
    assert_eq!(batch(&replay, 1, 1), batch(&replay, 1, 1));
    let mut scaled = Batch::default();
    let normalizer = Normalizer::new(&[2.0], &[4.0]).unwrap();
    replay.sample(&sampling(1), (Seed(7), 0), 400, &normalizer, &mut scaled);
    for (scaled, plain) in scaled.observations.iter().zip(batch(&replay, 1, 0).observations) {
        assert!((scaled - (plain - 2.0) / 2.0).abs() < 1e-6);
    }
}

#[test]
fn a_replay_goes_on_after_a_checkpoint() {
    // Before the ring is full, and after.
    for steps in [13, 90] {
        let (mut replay, mut episodes) = remembered(0.0, 2, steps, 60);
        let mut checkpoint = Checkpoint::new("td3", "powers", 0, "");
        replay.save(&mut checkpoint);
        let mut resumed = Replay::new(60, 2, 1, 1);
        resumed.load(&checkpoint).unwrap();
        assert_eq!(resumed, replay);
        for step in 0..7 {
            let seen = episodes.observations().to_vec();
            episodes.step(&[0.0, 0.0]).unwrap();
            replay.push(&seen, &[step as f32, 0.0], &episodes);
            resumed.push(&seen, &[step as f32, 0.0], &episodes);
        }
        assert_eq!(resumed, replay);
    }
}
