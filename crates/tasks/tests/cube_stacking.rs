//! Tests the observation, the gripper and the rewards of cube stacking.

use mishandle_rollout::{Environment, Sample, Seed};
use mishandle_tasks::{JOINTS, Preset, Reward, TaskEnvironment, task};

/// One sample of an episode.
struct Row {
    observation: Vec<f32>,
    signals: Vec<f64>,
    reward: f64,
}

/// An episode of the expert.
struct ExpertEpisode {
    signal_names: Vec<String>,
    rows: Vec<Row>,
}

impl ExpertEpisode {
    fn run(x0: &[f64], reward: Reward) -> ExpertEpisode {
        let task = task("cube-stacking").unwrap();
        let environment = TaskEnvironment::new(task, Preset::Paper, reward).unwrap();
        let expert = task.expert().unwrap();
        let environment = environment.with_further_parts(expert.further_parts()).unwrap();
        let mut worker = environment.worker();
        let mut controller = expert.worker();
        let mut state = vec![0.0; environment.state_size()];
        let mut memory = vec![0.0; expert.state_size()];
        let mut observation = vec![0.0; environment.observation_size()];
        let mut signals = vec![0.0; environment.signals().len()];
        let mut rewards = vec![0.0; environment.reward_terms().len()];
        let mut rows = Vec::new();
        controller.reset(&mut memory, Seed(1));
        for step in 0..=environment.episode_steps() {
            let mut action = [0.0; JOINTS];
            if step > 0 {
                controller.act(1, &observation, &mut memory, &mut action);
            }
            let sample =
                Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
            let _ = match step {
                0 => worker.reset(&x0.into(), Seed(1), &mut state, sample),
                _ => worker.step(&action.map(f64::from), &mut state, sample),
            };
            let observation = observation.clone();
            let signals = signals.clone();
            rows.push(Row { observation, signals, reward: rewards.iter().sum() });
        }
        ExpertEpisode { signal_names: environment.signals().to_vec(), rows }
    }

    fn signal(&self, name: &str) -> Vec<f64> {
        let i = self.signal_names.iter().position(|known| known == name).unwrap();
        self.rows.iter().map(|row| row.signals[i]).collect()
    }
}

#[test]
fn the_initial_state_matches_the_original_benchmark() {
    let episode = ExpertEpisode::run(&[0.6, -0.1], Reward::Original);
    let observation = &episode.rows[0].observation;
    // Position of the cube, its quaternion, cube minus target cube. The targets, which the expert
    // reads, follow.
    let expected = [0.34, 0.0, 0.91, 1.0, 0.0, 0.0, 0.0, -0.26, 0.1, 0.885];
    assert_eq!(observation.len(), 28 + JOINTS);
    for (found, expected) in observation[18..].iter().zip(expected) {
        assert!((f64::from(*found) - expected).abs() < 1e-6, "{:?}", &observation[18..]);
    }
    // The fingers touch the cube's faces, and its center is between their pads.
    assert!((observation[7] - 0.25).abs() < 1e-6 && (observation[8] - 0.25).abs() < 1e-6);
    assert!(episode.signal("finger_cube_distance")[0] < 1e-3);
}

#[test]
fn the_hand_releases_the_cube_permanently_one_step_after_the_cubes_are_close() {
    let episode = ExpertEpisode::run(&[0.6, 0.1], Reward::Shaped);
    let distance = episode.signal("cube_target_horizontal_distance");
    let height = episode.signal("cube_height_above_target");
    let close = |k: usize| distance[k].hypot(height[k]) < 0.08 && height[k] >= 0.025;
    let first = (0..=300).find(|k| close(*k)).unwrap();
    for (step, held) in episode.signal("cube_held").into_iter().enumerate() {
        assert_eq!(held == 1.0, step <= first, "step {step}, close at {first}");
    }
    let fingers = |step: usize| episode.rows[step].observation[7];
    assert!(
        fingers(first) < 0.25 && fingers(first + 10) > 0.95,
        "{} {}",
        fingers(first),
        fingers(first + 10)
    );
}

#[test]
fn the_shaped_reward_of_a_stack_is_twice_the_maximum_while_holding_the_cube() {
    let episode = ExpertEpisode::run(&[0.6, 0.1], Reward::Shaped);
    let held = episode.signal("cube_held");
    let holding = episode.rows.iter().zip(&held).filter(|(_, held)| **held == 1.0);
    let maximum = holding.map(|(row, _)| row.reward).fold(0.0, f64::max);
    let stacked = episode.rows[300].reward;
    assert!(
        maximum < 0.4 && stacked > 0.98,
        "at most {maximum} with the cube in the hand, {stacked} stacked"
    );
}

#[test]
fn the_original_reward_of_a_stack_matches_a_hand_calculation() {
    let episode = ExpertEpisode::run(&[0.6, 0.1], Reward::Original);
    // The cube is 3 cm above the point of the reward: 2 / 1.03 + 10 - 0 + 2.
    let expected = 2.0 / 1.03 + 12.0;
    let found = episode.rows[300].reward;
    assert!((found - expected).abs() < 1e-3, "{found} instead of {expected}");
    // Initially d = |(-0.26, -0.1, 0.865)| for a target at y = 0.1, and only the first term is
    // not 0.
    let start = episode.rows[1].reward;
    let d = (0.26_f64.powi(2) + 0.1_f64.powi(2) + 0.865_f64.powi(2)).sqrt();
    assert!((start - 2.0 / (1.0 + d)).abs() < 5e-3, "{start}");
}
