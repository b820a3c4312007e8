//! Training works with any environment batch, and the CPU batch produces the same bits as single
//! workers.

use crate::keeper::Keeper;
use crate::line::Line;
use mishandle_controllers::Policy;
use mishandle_rollout::{
    BatchFactory, Controller, Environment, EnvironmentBatch, EnvironmentSpec, RolloutError, Sample, Seed,
    Space, Start, StepStatus, Stream,
};
use mishandle_training::{AlgorithmSettings, Checkpoint, Origin, TrainingError, TrainingResult};

/// Batch of points on a line in closed form: x' = x + 0.2 clip(a), reward 1 - |x'|, episodes of 20
/// control steps, initial x uniform in [-1, 1]. It implements no `Environment` and has no workers.
struct Homing {
    x: Vec<f32>,
    rewards: Vec<f64>,
    statuses: Vec<StepStatus>,
    /// Number of steps after which the batch fails, like a killed process.
    steps_left: u64,
}

struct HomingFactory {
    steps: u64,
}

impl BatchFactory for HomingFactory {
    fn spec(&self) -> EnvironmentSpec {
        EnvironmentSpec {
            name: "homing".to_string(),
            space: Space::new("nothing", Vec::new()).unwrap(),
            observation_size: 1,
            exact_size: 0,
            action_size: 1,
            action_limit: 1.0,
            state_size: 1,
            signal_count: 0,
            reward_terms: vec!["near".to_string()],
            episode_steps: 20,
        }
    }

    fn batch(&self, rows: usize) -> Result<Box<dyn EnvironmentBatch>, RolloutError> {
        Ok(Box::new(Homing {
            x: vec![0.0; rows],
            rewards: vec![0.0; rows],
            statuses: vec![StepStatus::Running; rows],
            steps_left: self.steps,
        }))
    }
}

impl EnvironmentBatch for Homing {
    fn rows(&self) -> usize {
        self.x.len()
    }

    fn reset(&mut self, starts: &[Start]) -> Result<(), RolloutError> {
        for Start { row, seed, .. } in starts {
            self.x[*row] = (2.0 * seed.uniform(Stream::Reset, 0, 0) - 1.0) as f32;
        }
        Ok(())
    }

    fn step(&mut self, actions: &[f64]) -> Result<(), RolloutError> {
        let left = self.steps_left.checked_sub(1);
        self.steps_left = left.ok_or_else(|| RolloutError::Batch("the process was killed".to_string()))?;
        for ((x, reward), action) in self.x.iter_mut().zip(&mut self.rewards).zip(actions) {
            *x += 0.2 * action.clamp(-1.0, 1.0) as f32;
            *reward = 1.0 - f64::from(x.abs());
        }
        Ok(())
    }

    fn observations(&self) -> &[f32] {
        &self.x
    }

    fn rewards(&self) -> &[f64] {
        &self.rewards
    }

    fn statuses(&self) -> &[StepStatus] {
        &self.statuses
    }

    fn read_states(&mut self, states: &mut [f64]) -> Result<(), RolloutError> {
        states.iter_mut().zip(&self.x).for_each(|(state, x)| *state = f64::from(*x));
        Ok(())
    }

    fn write_states(&mut self, states: &[f64], _observations: &[f32]) -> Result<(), RolloutError> {
        self.x.iter_mut().zip(states).for_each(|(x, state)| *x = *state as f32);
        Ok(())
    }
}

fn settings(algorithm: &str) -> AlgorithmSettings {
    let own = match algorithm {
        "ppo" => "rollout_steps = 20\nminibatch_size = 160\nrun.total_steps = 32_000",
        _ => {
            "steps_per_iteration = 20\ntau = 0.01\nreplay = { warmup_steps = 500, batch_size = 64, n_steps = 1, \
             updates_per_step = 0.5, reward_scale = 1.0 }\npolicy.learning_rate = 0.003\nrun.total_steps = 6_400"
        }
    };
    let common = "gamma = 0.9\nepisodes.environments = 32\npolicy.hidden = [16]\ncritic.hidden = [16]\n";
    AlgorithmSettings::from_toml(algorithm, &format!("{common}{own}")).unwrap().unwrap()
}

fn train(algorithm: &str, resume: Option<&Checkpoint>, keeper: &mut Keeper) -> TrainingResult {
    settings(algorithm)
        .train(
            &HomingFactory { steps: u64::MAX },
            Seed(2),
            resume.map_or(Origin::New, Origin::Checkpoint),
            keeper,
        )
        .unwrap()
}

/// Returns the mean return of 20 control steps from a grid of initial states.
fn mean_return(policy: &Policy) -> f64 {
    let mut actor = policy.worker();
    let starts = (-10..=10).map(|start| f64::from(start) / 10.0);
    let returns = starts.map(|mut x| {
        let step = |_| {
            let mut action = [0.0];
            actor.act(1, &[x as f32], &mut [], &mut action);
            x += 0.2 * f64::from(action[0]).clamp(-1.0, 1.0);
            1.0 - x.abs()
        };
        (0..20).map(step).sum::<f64>()
    });
    returns.sum::<f64>() / 21.0
}

#[test]
fn training_on_a_custom_batch_learns_and_resumes_to_the_same_bits() {
    for algorithm in ["ppo", "sac"] {
        let trained = train(algorithm, None, &mut Keeper::default());
        // The optimal policy from |x| = 0, 0.1, .. 1.0 loses 0, 0, 0, 0.1, 0.2, 0.4, 0.6, 0.9, 1.2,
        // 1.6 and 2.0 of 20: 14/21 on average over the grid. A policy that does not move loses
        // 20 |x|: 220/21 on average.
        let found = mean_return(&trained.last);
        assert!((18.5..=20.0 - 14.0 / 21.0 + 1e-6).contains(&found), "{algorithm}: {found}");

        let mut first = Keeper { stop_after: Some(4), ..Keeper::default() };
        train(algorithm, None, &mut first);
        let resumed = train(algorithm, first.checkpoint.as_ref(), &mut Keeper::default());
        assert_eq!(resumed.last.hash(), trained.last.hash(), "{algorithm}");
    }
}

#[test]
fn a_failing_batch_ends_the_training_with_its_error() {
    for algorithm in ["ppo", "sac"] {
        let failed = settings(algorithm).train(
            &HomingFactory { steps: 30 },
            Seed(2),
            Origin::New,
            &mut Keeper::default(),
        );
        let error = failed.unwrap_err();
        assert!(matches!(error, TrainingError::Environment(_)), "{algorithm}: {error}");
        assert_eq!(error.to_string(), "the environment batch failed: the process was killed");
    }
}

/// Buffers of a sample of the line environment.
#[derive(Default)]
struct SampleBuffers {
    observation: [f32; 2],
    signals: [f64; 1],
    rewards: [f64; 2],
}

impl SampleBuffers {
    fn sample(&mut self) -> Sample<'_> {
        let SampleBuffers { observation, signals, rewards } = self;
        Sample { observation, signals, rewards }
    }
}

#[test]
fn the_cpu_batch_gives_the_same_bits_as_single_workers() {
    let line = Line::new(0.3);
    let mut batch = line.batch(7).unwrap();
    let start = |row, seed| Start { row, scenario: line.space().sample(seed, 0), seed };
    let starts: Vec<Start> = (0..7).map(|row| start(row, Seed(4).child(row as u64))).collect();
    batch.reset(&starts).unwrap();
    // Two rows are reset after the first step, in arbitrary order; the other rows continue.
    let later = [start(5, Seed(8)), start(1, Seed(9))];
    let (before, after): (Vec<f64>, Vec<f64>) = (0..7).map(|row| (0.1 * row as f64, -0.2)).unzip();
    batch.step(&before).unwrap();
    batch.reset(&later).unwrap();
    batch.step(&after).unwrap();
    let mut states = vec![0.0; 7 * line.state_size()];
    batch.read_states(&mut states).unwrap();
    for row in 0..7 {
        let mut worker = line.worker();
        let mut state = vec![0.0; line.state_size()];
        let mut buffers = SampleBuffers::default();
        let again = later.iter().find(|other| other.row == row);
        let Start { scenario, seed, .. } = again.unwrap_or(&starts[row]);
        worker.reset(scenario, *seed, &mut state, buffers.sample());
        if again.is_none() {
            worker.step(&before[row..=row], &mut state, buffers.sample());
        }
        let status = worker.step(&after[row..=row], &mut state, buffers.sample());
        assert_eq!(batch.statuses()[row], status);
        assert_eq!(states[row * state.len()..][..state.len()], state);
        assert_eq!(batch.observations()[2 * row..][..2], buffers.observation);
        assert_eq!(batch.rewards()[2 * row..][..2], buffers.rewards);
    }
}
