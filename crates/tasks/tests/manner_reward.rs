//! The reward terms of the manner follow their formulas, and change nothing else.

use std::sync::Arc;

use crate::stepped::Run;
use mishandle_rollout::{BatchFactory, Environment, Seed, Start, Stream};
use mishandle_tasks::{
    CONTROL_DT, JOINT_NAMES, MANNER, MANNER_REWARD, MannerWeights, Preset, Reward, TASKS, TaskBatches,
    TaskEnvironment, task,
};
use mishandle_world::CpuDevice;

const ALL: MannerWeights = MannerWeights { contact_force: 2.0, action_rate: 3.0, speed: 5.0, rest: 7.0 };

/// Control steps of a training episode; the robot shall rest in the second half.
const STEPS: usize = 40;

fn plain(name: &str) -> TaskEnvironment {
    TaskEnvironment::new(task(name).unwrap(), Preset::Paper, Reward::Shaped).unwrap()
}

impl Run {
    /// Returns the speeds of the joints of the arm.
    fn speeds(&self) -> Vec<f64> {
        let model = self.environment.model();
        let mut world = model.world();
        world.set_state(&self.state);
        let speed = |name: &&str| world.qvel()[model.joint(name).unwrap().dof].abs();
        JOINT_NAMES[..7].iter().map(speed).collect()
    }
}

/// Random actions that change every fifth control step.
fn actions(step: usize) -> [f64; 9] {
    let draw = |joint| 2.0 * Seed(9).uniform(Stream::ActionNoise, step as u64 / 5, joint) - 1.0;
    std::array::from_fn(|joint| draw(u32::try_from(joint).unwrap()))
}

/// Random actions under which the arm reaches down, so that it touches the ground.
fn downward(step: usize) -> [f64; 9] {
    let mut action = actions(step);
    (action[1], action[3]) = (1.0, 0.2);
    action
}

#[track_caller]
fn assert_near(found: f64, expected: f64) {
    assert!((found - expected).abs() <= 1e-12, "{found} instead of {expected}");
}

#[test]
fn each_term_is_its_weight_times_its_formula_and_no_other_bit_changes() {
    let mut largest_force = 0.0_f64;
    let mut largest_share = 0.0_f64;
    for name in ["cube-stacking", "door-opening", "peg-in-hole"] {
        let scenario = plain(name).space().nominal();
        let mut with = Run::new(plain(name).with_manner_reward(ALL, STEPS), &scenario);
        let mut without = Run::new(plain(name), &scenario);
        let own = without.rewards.len();
        let names: Vec<&str> = MANNER_REWARD.iter().map(|term| term.name).collect();
        assert_eq!(with.environment.reward_terms()[own..], names);
        assert!(with.rewards.iter().all(|reward| *reward == 0.0));
        let mut before = [0.0; 9];
        for step in 0..3 * STEPS {
            let action = downward(step);
            with.step(&action);
            without.step(&action);
            assert_eq!(with.rewards[..own], without.rewards, "{name}");
            assert_eq!(with.observation, without.observation, "{name}");
            assert_eq!(with.signals[..without.signals.len()], without.signals, "{name}");
            assert_eq!(with.state[..without.state.len()], without.state, "{name}");

            let limited = ["fixture_force", "ground_force", "object_force"];
            let force: f64 = limited.iter().map(|name| with.signal(name)).sum();
            largest_force = largest_force.max(force);
            assert_near(with.rewards[own], -2.0 * force / (force + 140.0));
            let changes = action.iter().zip(before).map(|(now, before)| (now - before).powi(2) / 4.0);
            assert_near(with.rewards[own + 1], -3.0 * changes.sum::<f64>() / 9.0);
            let share = (with.signal("joint_speed_share") / 1.05).max(with.signal("tool_speed") / 1.7);
            largest_share = largest_share.max(share);
            assert_near(with.rewards[own + 2], -5.0 * (share - 0.8).clamp(0.0, 1.0));
            let fastest = with.speeds().into_iter().fold(0.0, f64::max);
            let rest = if step < STEPS / 2 { 0.0 } else { -7.0 * fastest / (fastest + 0.05) };
            assert_near(with.rewards[own + 3], rest);
            before = action;
        }
    }
    assert!(largest_force > 50.0, "{largest_force}");
    assert!(largest_share > 0.9, "{largest_share}");
}

#[test]
fn only_contact_force_and_speed_need_the_signals_of_the_manner() {
    let task = plain("door-opening");
    let count = task.signals().len();
    let with = |weights| task.with_manner_reward(weights, STEPS);
    let motion = MannerWeights { contact_force: 0.0, speed: 0.0, ..ALL };
    assert_eq!(with(motion).signals().len(), count);
    assert_eq!(with(ALL).signals().len(), count + MANNER.len());
    let nothing = with(MannerWeights::default());
    assert_eq!((nothing.reward_terms(), nothing.state_size()), (task.reward_terms(), task.state_size()));
    let speed = with(MannerWeights { speed: 1.0, ..MannerWeights::default() });
    assert_eq!(speed.signals().len(), count + MANNER.len());
    let force = with(MannerWeights { contact_force: 1.0, ..MannerWeights::default() });
    assert_eq!(force.reward_terms()[task.reward_terms().len()..], ["contact_force"]);
}

#[test]
fn no_task_has_a_reward_term_of_the_same_name() {
    for task in TASKS {
        for reward in [Reward::Original, Reward::Shaped] {
            let mut own = task.definition().reward(reward).iter();
            assert!(!own.any(|own| MANNER_REWARD.iter().any(|term| term.name == own.name)));
        }
    }
}

#[test]
fn a_state_row_continues_to_the_same_rewards_on_another_worker() {
    let environment = plain("door-opening").with_manner_reward(ALL, STEPS);
    let mut first = Run::new(environment.clone(), &environment.space().sample(Seed(5), 2));
    (0..15).for_each(|step| first.step(&actions(step)));
    let mut second = Run::new(environment.clone(), &environment.space().sample(Seed(5), 3));
    second.step(&actions(50));
    second.state.copy_from_slice(&first.state);
    for step in 15..STEPS {
        first.step(&actions(step));
        second.step(&actions(step));
        assert_eq!((&first.rewards, &first.state), (&second.rewards, &second.state));
    }
}

#[test]
fn another_engine_gives_the_same_terms() {
    for name in ["cube-stacking", "door-opening", "peg-in-hole"] {
        let environment = Arc::new(plain(name).with_manner_reward(ALL, STEPS));
        let force = plain(name).reward_terms().len();
        let factory = TaskBatches::new(environment.clone(), Arc::new(CpuDevice));
        let starts: Vec<Start> = (0..3)
            .map(|row| Start {
                row,
                scenario: environment.space().sample(Seed(4), row as u64),
                seed: Seed(7),
            })
            .collect();
        let mut batches =
            [environment.batch(3).unwrap(), factory.batch(3).unwrap(), factory.batch(3).unwrap()];
        batches.iter_mut().for_each(|batch| batch.reset(&starts).unwrap());
        let mut least = 0.0_f64;
        for step in 0..3 * STEPS {
            if step == STEPS {
                let mut states = vec![0.0; 3 * environment.state_size()];
                batches[1].read_states(&mut states).unwrap();
                let observations = batches[1].observations().to_vec();
                batches[2].write_states(&states, &observations).unwrap();
            }
            let all: Vec<f64> = (0..3).flat_map(|row| downward(step + 10 * row)).collect();
            batches.iter_mut().for_each(|batch| batch.step(&all).unwrap());
            assert_eq!(batches[0].rewards(), batches[1].rewards(), "{name}, step {step}");
            assert_eq!(batches[1].rewards(), batches[2].rewards(), "{name}, step {step}");
            let terms = environment.reward_terms().len();
            least = batches[1].rewards().chunks(terms).map(|row| row[force]).fold(least, f64::min);
        }
        assert!(least < -0.01, "{name}: nothing touches");
    }
}

#[test]
fn one_changed_action_counts_a_ninth_of_its_squared_share() {
    // The signal is the largest change over the duration of a control step.
    let environment = plain("door-opening").with_manner_reward(ALL, STEPS);
    let own = environment.reward_terms().len() - 4;
    let mut run = Run::new(environment.clone(), &environment.space().nominal());
    let mut action = [0.0; 9];
    action[4] = 0.5;
    run.step(&action);
    assert_near(run.signal("action_rate"), 0.5 / CONTROL_DT);
    assert_near(run.rewards[own + 1], -3.0 * 0.25 * 0.25 / 9.0);
}
