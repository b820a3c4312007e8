//! Updates of PPO and TRPO. `tests/golden/skrl/make_on_policy.py` writes the cases.

#[path = "../../tests/toy/mod.rs"]
mod toy;

use std::sync::Arc;

use mishandle_network::RunningNormalizer;
use mishandle_rollout::{EnvironmentFacts, EnvironmentWorker, Sample, Scenario, Seed, StepStatus};
use serde_json::Value;

use super::{close, close_within, number, numbers, singles};
use crate::algorithm::BuildLearner;
use crate::on_policy::{ActorCritic, OnPolicy, PolicyOptimizer, mean_and_inverse_std};
use crate::ppo::{Ppo, PpoSettings};
use crate::trpo::{Trpo, TrpoSettings};
use crate::{Boundary, Checkpoint, TomlSettings};
use toy::{Toy, names, space};

/// Observation size and action size of the cases, as in `make_on_policy.py`.
const SIZES: (usize, usize) = (3, 2);

/// An environment with these sizes; the tests do not step it.
#[derive(Clone)]
struct Still;

fn nowhere() -> Arc<Toy<Still>> {
    Arc::new(Toy {
        facts: EnvironmentFacts {
            name: "nowhere".to_string(),
            space: space(&[("x", 0.0, 1.0)]),
            signals: names(&["x"]),
            reward_terms: names(&["x"]).to_vec(),
            observation_size: SIZES.0,
            exact_size: 0,
            action_size: SIZES.1,
            state_size: 1,
            episode_steps: 10,
            action_limit: 1.0,
            control_dt: 0.1,
        },
        worker: Still,
    })
}

impl EnvironmentWorker for Still {
    fn reset(
        &mut self,
        _scenario: &Scenario,
        _seed: Seed,
        state: &mut [f64],
        sample: Sample<'_>,
    ) -> StepStatus {
        state.fill(0.0);
        sample.observation.fill(0.0);
        sample.rewards.fill(0.0);
        StepStatus::Running
    }

    fn step(&mut self, _action: &[f64], _state: &mut [f64], _sample: Sample<'_>) -> StepStatus {
        StepStatus::Running
    }
}

/// Returns the cases of an algorithm: name, settings, document.
fn cases<S: TomlSettings>() -> Vec<(String, S, Value)> {
    let document: Value =
        serde_json::from_str(include_str!("../../tests/golden/skrl/on_policy.json")).unwrap();
    let common = document["common"].as_str().unwrap();
    let cases = document[S::ALGORITHM].as_object().unwrap().iter();
    let settings = |case: &Value| S::from_toml(&format!("{common}{}", case["settings"].as_str().unwrap()));
    cases.map(|(name, case)| (name.clone(), settings(case).unwrap(), case.clone())).collect()
}

fn on_policy<A: PolicyOptimizer>(settings: &A::Settings) -> OnPolicy<A> {
    OnPolicy::build(settings, &nowhere(), Seed(0)).unwrap()
}

fn initialize(actor_critic: &mut ActorCritic, start: &Value) {
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

/// Copies the rollout to the buffer and checks values, advantages and targets.
fn load_rollout(actor_critic: &mut ActorCritic, name: &str, rollout: &Value) {
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
    actor_critic.compute_advantages(&normalizer);
    let single = |numbers: &[f64]| numbers.iter().map(|x| *x as f32).collect::<Vec<f32>>();
    let (mean, inverse_std) = mean_and_inverse_std(actor_critic.buffer.advantages.iter().copied());
    let advantages: Vec<f64> =
        actor_critic.buffer.advantages.iter().map(|a| (a - mean) * inverse_std).collect();
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
    for (moments, expected, columns) in [
        ("normalizer", &rollout["observation_moments"], SIZES.0),
        ("critic.scale", &rollout["value_moments"], 1),
    ] {
        if !expected.is_null() {
            let found =
                RunningNormalizer::from_moments(checkpoint.moments(moments, columns).unwrap()).unwrap();
            let single = |numbers: &[f64]| numbers.iter().map(|x| *x as f32).collect::<Vec<f32>>();
            assert_eq!(found.count(), number(expected, "count"), "{name}: rows of {moments}");
            close(&format!("{name}: mean of {moments}"), &single(found.mean()), &expected["mean"]);
            close(
                &format!("{name}: variance of {moments}"),
                &single(&found.variance()),
                &expected["variance"],
            );
        }
    }
}

#[test]
fn updates_of_ppo_match_skrl() {
    for (name, settings, case) in cases::<PpoSettings>() {
        let OnPolicy { mut actor_critic, optimizer: mut ppo, .. } = on_policy::<Ppo>(&settings);
        initialize(&mut actor_critic, &case["start"]);
        for (rollout, index) in case["rollouts"].as_array().unwrap().iter().zip(1..) {
            let name = format!("{name}, update {index}");
            load_rollout(&mut actor_critic, &name, rollout);
            let rate = ppo.update(&mut actor_critic, 0).unwrap().learning_rate;
            assert!((rate / number(rollout, "learning_rate") - 1.0).abs() < 1e-9, "{name}: {rate}");
            // If a minibatch ended the last epoch, skrl's gradient is that of the previous
            // minibatch.
            if settings.kl_threshold.is_none() {
                let (gradient, metrics) = ppo.gradient.split_at(ppo.gradient.len() - 3);
                close(&format!("{name}: gradient"), gradient, &rollout["last_gradient"]);
                if settings.entropy_coef == 0.0 {
                    let loss = f64::from(metrics[1] + metrics[2]);
                    assert!((loss - number(rollout, "last_loss")).abs() < 1e-5, "{name}: loss {loss}");
                }
            }
            check_end(&mut actor_critic, 1e-5, &name, rollout);
        }
    }
}

/// Tolerance of TRPO's steps compared with skrl in double precision. Ten conjugate gradient
/// iterations, the default, amplify the single-precision errors of the Fisher-vector products;
/// PyTorch in single precision is less accurate.
fn step_tolerance(settings: &TrpoSettings) -> f64 {
    if settings.cg_iterations == 10 { 1e-4 } else { 1e-5 }
}

#[test]
fn constants_outside_of_the_cases_match_skrl() {
    let base = "base = \"skrl-0.10\"";
    // KLAdaptiveRL's min_lr and max_lr.
    assert_eq!(PpoSettings::from_toml(base).unwrap().learning_rate_range, [1e-6, 1e-2]);
    // `accept_ratio` of TRPO_DEFAULT_CONFIG, and `residual_tolerance` of its conjugate gradients.
    let trpo = TrpoSettings::from_toml(base).unwrap();
    assert_eq!((trpo.accept_ratio, trpo.cg_tolerance), (0.5, 1e-10));
}

#[test]
fn updates_of_trpo_match_skrl() {
    for (name, settings, case) in cases::<TrpoSettings>() {
        let tolerance = step_tolerance(&settings);
        let OnPolicy { mut actor_critic, optimizer: mut trpo, .. } = on_policy::<Trpo>(&settings);
        initialize(&mut actor_critic, &case["start"]);
        for (rollout, index) in case["rollouts"].as_array().unwrap().iter().zip(1..) {
            let name = format!("{name}, update {index}");
            load_rollout(&mut actor_critic, &name, rollout);
            let step = trpo.step_policy(&mut actor_critic).unwrap();
            let gradient: Vec<f32> = trpo.gradient.iter().map(|x| *x as f32).collect();
            close(&format!("{name}: gradient"), &gradient, &rollout["gradient"]);
            assert_eq!(step.fraction, number(rollout, "fraction"), "{name}: fraction of the full step");
            if let Some(kl) = rollout["kl"].as_f64() {
                assert!((step.kl - kl).abs() < tolerance * kl.max(1.0), "{name}: divergence {}", step.kl);
            }
            let loss = trpo.train_critic(&mut actor_critic, 0).unwrap();
            assert!((loss - number(rollout, "last_loss")).abs() < 1e-5, "{name}: critic's loss {loss}");
            check_end(&mut actor_critic, tolerance, &name, rollout);
            // Errors of the conjugate gradient iterations must not accumulate over updates.
            set_policy(&mut actor_critic, &rollout["end"]);
        }
    }
}
