//! Replay buffer: n-step returns, episode ends, overwriting, sampling.

use std::sync::Arc;

use crate::toy::{Toy, names, space};
use mishandle_network::Normalizer;
use mishandle_rollout::{EnvironmentFacts, EnvironmentWorker, Sample, Scenario, Seed, StepStatus};
use mishandle_training::replay_buffer::{ReplayBuffer, Sampling, TransitionBatch};
use mishandle_training::{Checkpoint, EpisodeSettings, Episodes, ScenarioSettings};

/// Environment whose observation is the control step and whose reward in step k, counted from 0, is
/// 10^k. With a `fate` of at least 1 the task terminates the episode at step 4.
#[derive(Clone)]
struct Powers;

fn powers(fate: f64) -> Arc<Toy<Powers>> {
    Arc::new(Toy {
        facts: EnvironmentFacts {
            name: "powers".to_string(),
            space: space(&[("fate", fate, fate + 0.5)]),
            signals: names(&["step"]),
            reward_terms: names(&["power"]).to_vec(),
            observation_size: 1,
            exact_size: 0,
            action_size: 1,
            state_size: 2,
            episode_steps: 300,
            action_limit: 1.0,
            control_dt: 0.1,
        },
        worker: Powers,
    })
}

impl EnvironmentWorker for Powers {
    fn reset(
        &mut self,
        scenario: &Scenario,
        _seed: Seed,
        state: &mut [f64],
        sample: Sample<'_>,
    ) -> StepStatus {
        state.copy_from_slice(&[0.0, scenario.get(0).unwrap()]);
        sample.observation[0] = 0.0;
        sample.rewards.fill(0.0);
        StepStatus::Running
    }

    fn step(&mut self, _action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        sample.rewards[0] = 10.0_f64.powf(state[0]);
        state[0] += 1.0;
        sample.observation[0] = state[0] as f32;
        if state[1] >= 1.0 && state[0] == 4.0 { StepStatus::Terminated } else { StepStatus::Running }
    }
}

/// Returns a replay buffer after `steps` control steps in episodes of 5 steps, or 4 with
/// termination; the action encodes the step.
fn filled(fate: f64, rows: usize, steps: usize, capacity: usize) -> (ReplayBuffer, Episodes) {
    let mut replay = ReplayBuffer::new(capacity, rows, 1, 1);
    let settings = EpisodeSettings { environments: rows, time_limit: Some(5), ..EpisodeSettings::default() };
    let settings = EpisodeSettings { staggered: false, ..settings };
    let scenarios = ScenarioSettings::default();
    let mut episodes = Episodes::new(&powers(fate), &settings, &scenarios, Seed(3)).unwrap();
    for step in 0..steps {
        step_once(&mut replay, &mut episodes, step);
    }
    (replay, episodes)
}

fn step_once(replay: &mut ReplayBuffer, episodes: &mut Episodes, step: usize) {
    let observations = episodes.observations().to_vec();
    let actions = vec![step as f32 / 100.0; episodes.rows()];
    episodes.step(&actions).unwrap();
    replay.push(&observations, &actions, episodes);
}

/// Sampling with γ = ½ and doubled rewards.
fn sampling(n_steps: usize) -> Sampling {
    Sampling { n_steps, gamma: 0.5, reward_scale: 2.0, replacement: true }
}

/// Returns batch `index` of 400 rows.
fn batch(replay: &ReplayBuffer, n_steps: usize, index: u64) -> TransitionBatch<f32> {
    let plain = Normalizer::new(&[0.0], &[1.0]).unwrap();
    let mut batch = TransitionBatch::default();
    replay.sample(&sampling(n_steps), Seed(7), index, 400, &plain, &mut batch);
    batch
}

/// Checks the transitions from `observation`: half of the return (rewards are doubled), discount,
/// next observation. The normalizer does not change numbers up to 5, its clip range.
#[track_caller]
fn check(fate: f64, n_steps: usize, observation: f32, half_returns: f32, discount: f32, next: Option<f32>) {
    let (replay, _) = filled(fate, 3, 40, 10_000);
    let batch = batch(&replay, n_steps, 0);
    let rows: Vec<usize> = (0..batch.rows()).filter(|row| batch.observations[*row] == observation).collect();
    assert!(rows.len() > 20, "{} rows", rows.len());
    for row in rows {
        assert_eq!((batch.returns[row], batch.discounts[row]), (2.0 * half_returns, discount));
        if let Some(next) = next {
            assert!((batch.next_observations[row] - next).abs() < 1e-6, "{}", batch.next_observations[row]);
        }
    }
}

#[test]
fn one_step_return() {
    check(0.0, 1, 2.0, 100.0, 0.5, Some(3.0));
}

#[test]
fn three_step_return_within_an_episode() {
    // 10 + 100 / 2 + 1000 / 4
    check(0.0, 3, 1.0, 310.0, 0.125, Some(4.0));
}

#[test]
fn a_truncation_ends_the_sum_and_keeps_the_final_observation() {
    // The last of 5 steps: 10^4, then the final observation 5, not the observation 0 of the next
    // episode.
    check(0.0, 1, 4.0, 10_000.0, 0.5, Some(5.0));
    // 1000 + 10,000 / 2 and no third step.
    check(0.0, 3, 3.0, 6_000.0, 0.25, Some(5.0));
    // Three full steps up to the time limit.
    check(0.0, 3, 2.0, 100.0 + 500.0 + 2_500.0, 0.125, Some(5.0));
}

#[test]
fn the_next_input_continues_the_history_and_a_final_one_has_its_own() {
    let mut replay = ReplayBuffer::new(10_000, 3, 5, 1);
    let settings = EpisodeSettings { environments: 3, time_limit: Some(5), ..EpisodeSettings::default() };
    let settings = EpisodeSettings { staggered: false, ..settings };
    let episodes = Episodes::new(&powers(0.0), &settings, &ScenarioSettings::default(), Seed(3)).unwrap();
    let mut episodes = episodes.with_history(2);
    for step in 0..40 {
        let inputs = episodes.inputs().to_vec();
        let actions = [0.01, 0.02, 0.03].map(|row| row + step as f32 / 10.0);
        episodes.step(&actions).unwrap();
        replay.push(&inputs, &actions, &episodes);
    }
    let batch = batch(&replay, 1, 0);
    let rows = batch.observations.chunks(5).zip(&batch.actions).zip(batch.next_observations.chunks(5));
    let mut ends = 0;
    for ((input, action), next) in rows {
        // The observation is the control step.
        let action = action.min(1.0);
        assert_eq!(next, [input[0] + 1.0, input[0], action, input[1], input[2]]);
        assert!(input[0] > 0.0 || input[1..] == [0.0; 4], "an episode starts without a history");
        ends += usize::from(next[0] == 5.0);
    }
    assert!(ends > 20, "{ends}");
}

#[test]
fn a_termination_ends_the_sum_with_discount_zero() {
    check(1.0, 1, 3.0, 1_000.0, 0.0, None);
    check(1.0, 3, 2.0, 600.0, 0.0, None);
    check(1.0, 3, 1.0, 310.0, 0.0, None);
    check(1.0, 3, 0.0, 1.0 + 5.0 + 25.0, 0.125, Some(3.0));
}

#[test]
fn a_final_observation_is_never_sampled_as_a_transition() {
    let (replay, _) = filled(0.0, 3, 40, 10_000);
    for index in 0..5 {
        let batch = batch(&replay, 2, index);
        assert!(batch.observations.iter().all(|step| *step < 5.0));
        assert_eq!(batch.rows(), 400);
    }
}

#[test]
fn a_full_buffer_contains_only_the_newest_steps() {
    // Two rows of 30 entries; every sixth entry is a final observation, so there are 25 steps.
    let (replay, _) = filled(0.0, 2, 90, 60);
    let mut sampled: Vec<i32> = (0..20)
        .flat_map(|index| batch(&replay, 3, index).actions)
        .map(|a| (100.0 * a).round() as i32)
        .collect();
    sampled.sort_unstable();
    sampled.dedup();
    // Too few entries follow the newest 3: the final observation and steps 89 and 88.
    assert_eq!(sampled, (65..=87).collect::<Vec<i32>>());
    // Returns are correct across the end of the ring.
    let batch = batch(&replay, 3, 0);
    for row in 0..batch.rows() {
        let step = batch.observations[row];
        let expected = if step < 3.0 { step + 3.0 } else { 5.0 };
        assert!((batch.next_observations[row] - expected).abs() < 1e-6, "{step}");
    }
}

#[test]
fn transitions_are_sampled_uniformly() {
    let (replay, _) = filled(0.0, 4, 52, 10_000);
    let mut counts = std::collections::BTreeMap::new();
    for index in 0..50 {
        for action in batch(&replay, 1, index).actions {
            *counts.entry((100.0 * action).round() as i32).or_insert(0) += 1;
        }
    }
    // 51 of 52 steps have a next step: 20,000 samples, 392 per step; tolerance five Poisson
    // standard deviations.
    assert_eq!(counts.len(), 51);
    for (step, count) in counts {
        assert!((f64::from(count) - 392.0).abs() < 5.0 * 392.0_f64.sqrt(), "step {step}: {count}");
    }
}

#[test]
fn without_replacement_no_transition_repeats() {
    let (replay, _) = filled(0.0, 3, 10, 10_000);
    let plain = Normalizer::new(&[0.0], &[1.0]).unwrap();
    let mut sampled = std::collections::BTreeSet::new();
    for index in 0..50 {
        let mut batch = TransitionBatch::default();
        let sampling = Sampling { replacement: false, ..sampling(1) };
        replay.sample(&sampling, Seed(7), index, 20, &plain, &mut batch);
        let distinct: std::collections::BTreeSet<usize> = batch.indices.iter().copied().collect();
        assert_eq!((batch.rows(), distinct.len()), (20, 20));
        sampled.extend(distinct);
    }
    // Ten steps per row; the last one ends its episode, so its final observation is there too.
    assert_eq!(sampled.len(), 3 * 10);
}

#[test]
fn batches_differ_and_observations_are_normalized() {
    let (replay, _) = filled(0.0, 3, 40, 10_000);
    assert_ne!(batch(&replay, 1, 0), batch(&replay, 1, 1));
    assert_eq!(batch(&replay, 1, 1), batch(&replay, 1, 1));
    let mut scaled = TransitionBatch::default();
    let normalizer = Normalizer::new(&[2.0], &[4.0]).unwrap();
    replay.sample(&sampling(1), Seed(7), 0, 400, &normalizer, &mut scaled);
    for (scaled, plain) in scaled.observations.iter().zip(batch(&replay, 1, 0).observations) {
        assert!((scaled - (plain - 2.0) / 2.0).abs() < 1e-6);
    }
}

#[test]
fn a_replay_buffer_is_restored_from_a_checkpoint() {
    // Before and after the buffer is full.
    for steps in [13, 90] {
        let (mut replay, mut episodes) = filled(0.0, 2, steps, 60);
        let mut checkpoint = Checkpoint::new("td3", "powers", 0, "");
        replay.save(&mut checkpoint);
        let mut resumed = ReplayBuffer::new(60, 2, 1, 1);
        resumed.load(&checkpoint).unwrap();
        assert_eq!(resumed, replay);
        for step in 0..7 {
            let observations = episodes.observations().to_vec();
            episodes.step(&[0.0, 0.0]).unwrap();
            replay.push(&observations, &[step as f32, 0.0], &episodes);
            resumed.push(&observations, &[step as f32, 0.0], &episodes);
        }
        assert_eq!(resumed, replay);
    }
}
