//! Updates of PPO and TRPO under the preset `skrl-0.10` against skrl's: `tests/golden/skrl/make_on_policy.py` writes the
//! cases.

#[path = "../tests/toy/mod.rs"]
mod toy;

use std::sync::Arc;

use mishandle_network::RunningNormalizer;
use mishandle_rollout::{EnvironmentWorker, Sample, Scenario, Seed, StepStatus};
use serde_json::Value;

use crate::actor_critic::{ActorCritic, mean_and_scale};
use crate::algorithm::FromSettings;
use crate::on_policy::{Improver, OnPolicy};
use crate::ppo::{Ppo, PpoConfig};
use crate::skrl_updates::{close, close_within, number, numbers, singles};
use crate::trpo::{Trpo, TrpoConfig};
use crate::{Boundary, Checkpoint, Settings};
use toy::{Toy, names, space};

/// Observations and actions of the cases, as many as `make_on_policy.py` says.
const SIZES: (usize, usize) = (3, 2);

/// Something of the right sizes to act in; what happens in it is not looked at.
#[derive(Clone)]
struct Still;

fn nowhere() -> Arc<Toy<Still>> {
    Arc::new(Toy {
        name: "nowhere",
        space: space(&[("x", 0.0, 1.0)]),
        signals: names(&["x"]),
        reward_terms: names(&["x"]),
        observation_size: SIZES.0,
        action_size: SIZES.1,
        state_size: 1,
        episode_steps: 10,
        worker: Still,
    })
}

impl EnvironmentWorker for Still {
    fn reset(&mut self, _scenario: &Scenario, _seed: Seed, state: &mut [f64], sample: Sample<'_>) {
        state.fill(0.0);
        sample.observation.fill(0.0);
        sample.rewards.fill(0.0);
    }

    fn step(&mut self, _action: &[f64], _state: &mut [f64], _sample: Sample<'_>) -> StepStatus {
        StepStatus::Running
    }
}

/// The cases of an algorithm, each with its name and the settings that it is for.
fn cases<S: Settings>() -> Vec<(String, S, Value)> {
    let document: Value = serde_json::from_str(include_str!("../tests/golden/skrl/on_policy.json")).unwrap();
    let common = document["common"].as_str().unwrap();
    let cases = document[S::ALGORITHM].as_object().unwrap().iter();
    let settings = |case: &Value| S::from_toml(&format!("{common}{}", case["settings"].as_str().unwrap()));
    cases.map(|(name, case)| (name.clone(), settings(case).unwrap(), case.clone())).collect()
}

fn on_policy<A: Improver>(config: &A::Config) -> OnPolicy<A> {
    OnPolicy::start(config, &nowhere(), Seed(0)).unwrap()
}

fn begin(actor_critic: &mut ActorCritic, start: &Value) {
    set_policy(actor_critic, start);
    let mut checkpoint = Checkpoint::new("", "", 0, "");
    actor_critic.critic.save(&mut checkpoint);
    checkpoint.put("critic.parameters", singles(&start["critic"]));
    actor_critic.critic.load(&checkpoint).unwrap();
}

fn set_policy(actor_critic: &mut ActorCritic, weights: &Value) {
    let network = singles(&weights["network"]);
    actor_critic.network.update(|parameters| parameters.copy_from_slice(&network));
    actor_critic.log_std = singles(&weights["log_std"]);
}

/// Has the rollout in the buffer, and checks what is made of it before anything is learned.
fn roll_out(actor_critic: &mut ActorCritic, name: &str, rollout: &Value) {
    let buffer = &mut actor_critic.buffer;
    buffer.clear();
    buffer.observations = singles(&rollout["observations"]);
    buffer.last_observations = singles(&rollout["last_observations"]);
    buffer.actions = singles(&rollout["actions"]);
    buffer.log_probs = numbers(&rollout["log_probs"]);
    buffer.rewards = numbers(&rollout["rewards"]);
    let terminated = rollout["terminated"].as_array().unwrap();
    for (boundary, terminated) in buffer.boundaries.iter_mut().zip(terminated) {
        let ends = terminated.as_bool().unwrap();
        *boundary = if ends { Boundary::Terminated } else { Boundary::Running };
    }
    let normalizer = actor_critic.normalizer();
    actor_critic.estimate(&normalizer);
    let single = |numbers: &[f64]| numbers.iter().map(|x| *x as f32).collect::<Vec<f32>>();
    let (mean, scale) = mean_and_scale(actor_critic.buffer.advantages.iter().copied());
    let advantages: Vec<f64> = actor_critic.buffer.advantages.iter().map(|a| (a - mean) * scale).collect();
    close(&format!("{name}: value"), &single(&actor_critic.buffer.values), &rollout["values"]);
    close(&format!("{name}: advantage"), &single(&advantages), &rollout["advantages"]);
    close(&format!("{name}: target"), &actor_critic.targets, &rollout["targets"]);
}

fn check_end(actor_critic: &mut ActorCritic, policy_tolerance: f64, name: &str, rollout: &Value) {
    let end = &rollout["end"];
    let network = actor_critic.network.parameters();
    close_within(policy_tolerance, &format!("{name}: policy"), network, &end["network"]);
    close_within(policy_tolerance, &format!("{name}: log σ"), &actor_critic.log_std, &end["log_std"]);
    close(&format!("{name}: critic"), actor_critic.critic.network().parameters(), &end["critic"]);
    let mut checkpoint = Checkpoint::new("", "", 0, "");
    actor_critic.save(&mut checkpoint).unwrap();
    for (moments, wanted, columns) in [
        ("normalizer", &rollout["observation_moments"], SIZES.0),
        ("critic.scale", &rollout["value_moments"], 1),
    ] {
        if !wanted.is_null() {
            let found =
                RunningNormalizer::from_moments(checkpoint.moments(moments, columns).unwrap()).unwrap();
            let single = |numbers: &[f64]| numbers.iter().map(|x| *x as f32).collect::<Vec<f32>>();
            assert_eq!(found.count(), number(wanted, "count"), "{name}: rows of {moments}");
            close(&format!("{name}: mean of {moments}"), &single(found.mean()), &wanted["mean"]);
            close(&format!("{name}: variance of {moments}"), &single(&found.variance()), &wanted["variance"]);
        }
    }
}

#[test]
fn ppo() {
    for (name, config, case) in cases::<PpoConfig>() {
        let OnPolicy { mut actor_critic, improver: mut ppo, .. } = on_policy::<Ppo>(&config);
        begin(&mut actor_critic, &case["start"]);
        for (rollout, index) in case["rollouts"].as_array().unwrap().iter().zip(1..) {
            let name = format!("{name}, update {index}");
            roll_out(&mut actor_critic, &name, rollout);
            let rate = ppo.improve(&mut actor_critic, 0).unwrap().learning_rate;
            assert!((rate / number(rollout, "learning_rate") - 1.0).abs() < 1e-9, "{name}: {rate}");
            // A minibatch that ended the last epoch was not learned from; skrl's gradient is of one before.
            if config.kl_threshold.is_none() {
                let (gradient, riders) = ppo.gradient.split_at(ppo.gradient.len() - 3);
                close(&format!("{name}: gradient"), gradient, &rollout["last_gradient"]);
                if config.entropy_coef == 0.0 {
                    let loss = f64::from(riders[1] + riders[2]);
                    assert!((loss - number(rollout, "last_loss")).abs() < 1e-5, "{name}: loss {loss}");
                }
            }
            check_end(&mut actor_critic, 1e-5, &name, rollout);
        }
    }
}

/// How near TRPO's steps come to skrl's in double precision. Ten conjugate gradients, which is the default, enlarge what
/// single precision leaves in each product with the Fisher information: PyTorch's own in single precision is farther off.
fn step_tolerance(config: &TrpoConfig) -> f64 {
    if config.cg_iterations == 10 { 1e-4 } else { 1e-5 }
}

#[test]
fn numbers_that_the_cases_do_not_show_are_skrls() {
    let preset = "preset = \"skrl-0.10\"";
    // KLAdaptiveRL's min_lr and max_lr.
    assert_eq!(PpoConfig::from_toml(preset).unwrap().learning_rate_range, [1e-6, 1e-2]);
    // `accept_ratio` of TRPO_DEFAULT_CONFIG, and `residual_tolerance` of its conjugate gradients.
    let trpo = TrpoConfig::from_toml(preset).unwrap();
    assert_eq!((trpo.accept_ratio, trpo.cg_tolerance), (0.5, 1e-10));
}

#[test]
fn trpo() {
    for (name, config, case) in cases::<TrpoConfig>() {
        let tolerance = step_tolerance(&config);
        let OnPolicy { mut actor_critic, improver: mut trpo, .. } = on_policy::<Trpo>(&config);
        begin(&mut actor_critic, &case["start"]);
        for (rollout, index) in case["rollouts"].as_array().unwrap().iter().zip(1..) {
            let name = format!("{name}, update {index}");
            roll_out(&mut actor_critic, &name, rollout);
            let step = trpo.step_policy(&mut actor_critic).unwrap();
            let gradient: Vec<f32> = trpo.gradient.iter().map(|x| *x as f32).collect();
            close(&format!("{name}: gradient"), &gradient, &rollout["gradient"]);
            assert_eq!(step.fraction, number(rollout, "fraction"), "{name}: fraction of the longest step");
            if let Some(kl) = rollout["kl"].as_f64() {
                assert!((step.kl - kl).abs() < tolerance * kl.max(1.0), "{name}: divergence {}", step.kl);
            }
            let loss = trpo.learn_values(&mut actor_critic, 0).unwrap();
            assert!((loss - number(rollout, "last_loss")).abs() < 1e-5, "{name}: critic's loss {loss}");
            check_end(&mut actor_critic, tolerance, &name, rollout);
            // What conjugate gradients left is not to add up.
            set_policy(&mut actor_critic, &rollout["end"]);
        }
    }
}
