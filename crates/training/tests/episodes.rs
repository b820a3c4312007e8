//! Episodes: boundaries, final observations, statistics, action noise.

use std::sync::Arc;

use crate::toy::{Toy, names, space};
use mishandle_rollout::{
    EnvironmentFacts, EnvironmentWorker, Sample, Scenario, Seed, StepStatus, TrainingScenarios,
};
use mishandle_training::{
    Boundary, EpisodeSettings, Episodes, RolloutBuffer, ScenarioDraw, ScenarioSettings, TimeoutHandling,
};

/// Environment whose observation is (control step, 100) and whose reward is the action. The axis
/// `fate` determines the end: below 1 none, below 2 termination at control step 5, otherwise
/// divergence at step 3. Scenarios of 3 and more cannot be started.
#[derive(Clone)]
struct Counter;

fn counter(low: f64) -> Arc<Toy<Counter>> {
    Arc::new(Toy {
        facts: EnvironmentFacts {
            name: "counter".to_string(),
            space: space(&[("fate", low, low + 0.5)]),
            signals: names(&["step"]),
            reward_terms: names(&["action"]).to_vec(),
            observation_size: 2,
            exact_size: 0,
            action_size: 1,
            state_size: 2,
            episode_steps: 300,
            action_limit: 1.0,
            control_dt: 0.1,
        },
        worker: Counter,
    })
}

impl EnvironmentWorker for Counter {
    fn reset(
        &mut self,
        scenario: &Scenario,
        _seed: Seed,
        state: &mut [f64],
        sample: Sample<'_>,
    ) -> StepStatus {
        state.copy_from_slice(&[0.0, scenario.get(0).unwrap()]);
        sample.observation.copy_from_slice(&[0.0, 100.0]);
        sample.rewards.fill(0.0);
        if state[1] >= 3.0 { StepStatus::InvalidStart } else { StepStatus::Running }
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        state[0] += 1.0;
        if state[1] >= 2.0 && state[0] == 3.0 {
            sample.observation.fill(f32::NAN);
            sample.rewards.fill(f64::NAN);
            return StepStatus::Diverged;
        }
        sample.observation.copy_from_slice(&[state[0] as f32, 100.0]);
        sample.rewards[0] = action[0];
        if state[1] >= 1.0 && state[0] == 5.0 { StepStatus::Terminated } else { StepStatus::Running }
    }
}

fn settings(environments: usize, time_limit: usize) -> EpisodeSettings {
    let settings =
        EpisodeSettings { environments, time_limit: Some(time_limit), ..EpisodeSettings::default() };
    EpisodeSettings { staggered: false, ..settings }
}

fn episodes(low: f64, rows: usize, time_limit: usize, action_noise: f64, staggered: bool) -> Episodes {
    let settings = EpisodeSettings { action_noise, staggered, ..settings(rows, time_limit) };
    Episodes::new(&counter(low), &settings, &ScenarioSettings::default(), Seed(3)).unwrap()
}

/// Steps one row with the action 0.5 until its episode ends; checks the step, the boundary and the
/// observations.
#[track_caller]
fn check_end(low: f64, step: usize, boundary: Boundary, final_step: f32, reward: f64) {
    let mut episodes = episodes(low, 1, 7, 0.0, false);
    for i in 1.. {
        episodes.step(&[0.5]).unwrap();
        if episodes.boundaries()[0] != Boundary::Running {
            assert_eq!((i, episodes.boundaries()[0]), (step, boundary));
            break;
        }
        assert_eq!(episodes.observations(), [i as f32, 100.0]);
    }
    assert_eq!(episodes.final_observations(), [final_step, 100.0]);
    assert_eq!(episodes.observations(), [0.0, 100.0]);
    assert_eq!(episodes.rewards(), [reward]);
}

#[test]
fn a_time_limit_truncates_and_keeps_the_final_observation() {
    check_end(0.0, 7, Boundary::Truncated, 7.0, 0.5);
}

#[test]
fn the_task_terminates_an_episode() {
    check_end(1.0, 5, Boundary::Terminated, 5.0, 0.5);
}

#[test]
fn a_diverged_row_terminates_with_its_last_finite_observation() {
    check_end(2.0, 3, Boundary::Terminated, 2.0, 0.0);
}

#[test]
fn a_terminal_timeout_terminates_but_does_not_count_as_terminated_in_the_statistics() {
    let settings = EpisodeSettings { timeouts: TimeoutHandling::Terminal, ..settings(1, 7) };
    let scenarios = ScenarioSettings::default();
    let mut episodes = Episodes::new(&counter(0.0), &settings, &scenarios, Seed(3)).unwrap();
    (0..7).for_each(|_| episodes.step(&[0.5]).unwrap());
    assert_eq!(episodes.boundaries(), [Boundary::Terminated]);
    assert_eq!(episodes.observations(), [0.0, 100.0]);
    let statistics = episodes.take_statistics();
    assert_eq!((statistics.episodes, statistics.terminated), (1, 0));
}

#[test]
fn statistics_count_whole_episodes() {
    let mut one = episodes(1.0, 2, 7, 0.0, false);
    (0..11).for_each(|_| one.step(&[0.5, 3.0]).unwrap());
    let statistics = one.take_statistics();
    // Two rows with two episodes of 5 steps each; an action of 3 counts as 1.
    assert_eq!((statistics.steps, statistics.episodes, statistics.terminated), (22, 4, 4));
    assert_eq!((statistics.total_steps, statistics.total_reward), (20, 15.0));
    assert_eq!(statistics.reward_terms, [16.5]);
    assert_eq!(one.take_statistics().steps, 0);
}

#[test]
fn staggered_rows_end_at_different_times_and_statistics_skip_their_first_episodes() {
    let mut episodes = episodes(0.0, 100, 50, 0.0, true);
    let mut ends = vec![0; 51];
    for end in &mut ends[1..] {
        episodes.step(&[0.0; 100]).unwrap();
        *end = episodes.boundaries().iter().filter(|boundary| **boundary == Boundary::Truncated).count();
    }
    assert!(ends.iter().all(|count| *count < 15), "{ends:?}");
    let statistics = episodes.take_statistics();
    assert!(ends.iter().sum::<usize>() >= 100);
    // Only rows whose first episode has full length can count so far.
    assert!(statistics.episodes <= 5, "{}", statistics.episodes);
    (0..50).for_each(|_| episodes.step(&[0.0; 100]).unwrap());
    let statistics = episodes.take_statistics();
    assert_eq!(statistics.total_steps, 50 * statistics.episodes);
    assert!(statistics.episodes >= 95);
}

#[test]
fn noise_is_added_after_clipping() {
    let mut episodes = episodes(0.0, 4000, 300, 0.5, false);
    episodes.step(&[9.0; 4000]).unwrap();
    let noise: Vec<f64> = episodes.rewards().iter().map(|reward| reward - 1.0).collect();
    let n = noise.len() as f64;
    let variance = noise.iter().map(|x| x * x).sum::<f64>() / n;
    // Five standard errors.
    assert!((noise.iter().sum::<f64>() / n).abs() < 5.0 * 0.5 / n.sqrt());
    assert!((variance / 0.25 - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
}

#[test]
fn rows_are_independent() {
    let mut few = episodes(0.0, 2, 4, 0.5, true);
    let mut many = episodes(0.0, 30, 4, 0.5, true);
    for _ in 0..20 {
        few.step(&[0.1; 2]).unwrap();
        many.step(&[0.1; 30]).unwrap();
        assert_eq!(few.rewards(), &many.rewards()[..2]);
        assert_eq!(few.boundaries(), &many.boundaries()[..2]);
    }
}

#[test]
fn the_rollout_buffer_stores_the_value_after_each_step() {
    let mut episodes = episodes(0.0, 2, 3, 0.0, false);
    let mut buffer = RolloutBuffer::new(4, 2, 2, 1);
    for step in 0..4 {
        let (observations, actions, log_probs) = buffer.begin_step(&episodes);
        assert_eq!(observations, [step as f32 % 3.0, 100.0].repeat(2));
        actions.fill(0.25);
        log_probs.fill(-1.0);
        episodes.step(buffer.step_actions()).unwrap();
        buffer.end_step(&episodes);
    }
    // Both rows are truncated after their third step, with the observation 3.
    assert_eq!(buffer.truncated, [4, 5]);
    assert_eq!(buffer.truncated_observations, [3.0, 100.0, 3.0, 100.0]);
    for (value, index) in buffer.values.iter_mut().zip(0..) {
        *value = f64::from(index);
    }
    buffer.set_next_values(&[20.0, 21.0], &[30.0, 31.0]);
    assert_eq!(buffer.next_values, [2.0, 3.0, 4.0, 5.0, 30.0, 31.0, 20.0, 21.0]);
    // Observations 0 1 2 0 in both rows: mean 3/4, variance 5/4 - 9/16.
    let moments = buffer.observation_moments(2);
    assert_eq!(moments.mean(), [0.75, 100.0]);
    assert_eq!(moments.variance().collect::<Vec<_>>(), [0.6875, 0.0]);
}

#[test]
fn an_episode_that_cannot_start_is_skipped_and_the_others_keep_their_seeds() {
    let rows = 4;
    let seed = Seed(3);
    let scenarios = ScenarioSettings::default();
    let environment = counter(2.75);
    let draw = ScenarioDraw::new(TrainingScenarios::of(environment.facts.space.clone()), &scenarios);
    // Every other scenario cannot be started; the others diverge at control step 3.
    let started = |row: u64| -> Vec<f64> {
        let fates = (0..200).map(|episode| draw.draw(seed.child(row).child(episode)).1.get(0).unwrap());
        fates.filter(|fate| *fate < 3.0).collect()
    };
    let expected: Vec<Vec<f64>> = (0..rows).map(started).collect();
    let made = Episodes::new(&environment, &settings(4, 50), &scenarios, seed).unwrap();
    let mut episodes = made.with_privileged();
    for episode in 0..60 {
        for (row, fates) in expected.iter().enumerate() {
            let found = 2.75 + 0.25 * (1.0 + f64::from(episodes.privileged()[3 * row + 2]));
            assert!((found - fates[episode]).abs() < 1e-6, "{found} in episode {episode} of row {row}");
        }
        (0..3).for_each(|_| episodes.step(&[0.5; 4]).unwrap());
    }
    let statistics = episodes.take_statistics();
    assert_eq!((statistics.episodes, statistics.diverged, statistics.steps), (4 * 60, 4 * 60, 4 * 180));
}

#[test]
fn a_row_that_never_starts_is_an_error() {
    let made = Episodes::new(&counter(3.0), &settings(2, 7), &ScenarioSettings::default(), Seed(3));
    let message = made.err().map(|error| error.to_string());
    let expected = "counter could not start from 1000 random scenarios one after the other";
    assert_eq!(message.as_deref(), Some(expected));
}
