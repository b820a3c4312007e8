//! Compares the gradients of the SAC, TD3 and DDPG losses with finite differences, and the losses
//! with loops over their definitions, in f64.

use mishandle_network::{Activation, Mlp, Workspace};
use mishandle_rollout::{Seed, Stream};
use mishandle_training::deterministic::{PolicyLoss, PolicyScratch};
use mishandle_training::replay_buffer::TransitionBatch;
use mishandle_training::td3::TargetSmoothing;
use mishandle_training::{ddpg, sac, td3};

const OBSERVATION: usize = 3;
const ACTION: usize = 2;
/// Privileged inputs of the critics.
const PRIVILEGED: usize = 2;
const ROWS: usize = 7;

fn numbers(seed: u64, count: usize) -> Vec<f64> {
    let mut numbers = vec![0.0; count];
    Seed(seed).normals(Stream::Weights, 0, &mut numbers);
    numbers
}

fn network(inputs: usize, outputs: usize, last: Activation, layer_norm: bool, seed: u64) -> Mlp<f64> {
    let mut network = Mlp::new(&[inputs, 6, outputs], Activation::Elu, last).unwrap();
    if layer_norm {
        network = network.with_layer_norm();
    }
    let weights = numbers(seed, network.parameter_count());
    network.update(|own| own.iter_mut().zip(weights).for_each(|(own, weight)| *own = 0.6 * weight));
    network
}

fn critic(seed: u64) -> Mlp<f64> {
    network(OBSERVATION + ACTION + PRIVILEGED, 1, Activation::Identity, true, seed)
}

fn batch() -> TransitionBatch<f64> {
    let mut discounts = vec![0.9; ROWS];
    discounts[2] = 0.0;
    TransitionBatch {
        observations: numbers(1, ROWS * OBSERVATION),
        actions: numbers(2, ROWS * ACTION).into_iter().map(f64::tanh).collect(),
        returns: numbers(3, ROWS),
        discounts,
        next_observations: numbers(4, ROWS * OBSERVATION),
        privileged: numbers(5, ROWS * PRIVILEGED),
        next_privileged: numbers(6, ROWS * PRIVILEGED),
        indices: vec![],
    }
}

fn value(critic: &Mlp<f64>, observations: &[f64], privileged: &[f64], row: usize, action: &[f64]) -> f64 {
    let privileged = &privileged[row * PRIVILEGED..][..PRIVILEGED];
    let inputs = [&observations[row * OBSERVATION..][..OBSERVATION], action, privileged].concat();
    critic.forward(&inputs, &mut Workspace::default())[0]
}

fn outputs(actor: &Mlp<f64>, observations: &[f64], row: usize) -> Vec<f64> {
    actor.forward(&observations[row * OBSERVATION..][..OBSERVATION], &mut Workspace::default()).to_vec()
}

/// Compares `gradient` with finite differences of `loss` with respect to the parameters of
/// `network`.
#[track_caller]
fn check_slopes(network: &Mlp<f64>, gradient: &[f64], loss: impl Fn(&Mlp<f64>) -> f64) {
    const H: f64 = 1e-6;
    assert_eq!(gradient.len(), network.parameter_count());
    let moved = |i: usize, by: f64| {
        let mut moved = network.clone();
        moved.update(|parameters| parameters[i] += by);
        loss(&moved)
    };
    for (i, found) in gradient.iter().enumerate() {
        let slope = (moved(i, H) - moved(i, -H)) / (2.0 * H);
        assert!((slope - found).abs() < 1e-7 * (1.0 + slope.abs()), "{i}: {slope} {found}");
    }
}

/// Returns the sum over two chunks, as on two threads.
fn in_two_chunks(add: &mut dyn FnMut(std::ops::Range<usize>) -> f64) -> f64 {
    add(0..4) + add(4..ROWS)
}

#[test]
fn critic_loss_of_ddpg() {
    let batch = batch();
    let target_actor = network(OBSERVATION, ACTION, Activation::Tanh, false, 10);
    let target_critic = critic(11);
    let whole = |critic: &Mlp<f64>, gradient: &mut [f64]| {
        let loss = ddpg::CriticLoss {
            batch: &batch,
            target_actor: &target_actor,
            critic,
            target_critic: &target_critic,
        };
        let mut scratch = ddpg::CriticScratch::default();
        in_two_chunks(&mut |rows| loss.add_gradient(rows, &mut scratch, gradient))
    };
    let own = critic(12);
    let mut gradient = vec![0.0; own.parameter_count()];
    let found = whole(&own, &mut gradient);
    let expected: f64 = (0..ROWS)
        .map(|row| {
            let action = outputs(&target_actor, &batch.next_observations, row);
            let next_value =
                value(&target_critic, &batch.next_observations, &batch.next_privileged, row, &action);
            let y = batch.returns[row] + batch.discounts[row] * next_value;
            (value(
                &own,
                &batch.observations,
                &batch.privileged,
                row,
                &batch.actions[row * ACTION..][..ACTION],
            ) - y)
                .powi(2)
        })
        .sum();
    assert!((found - expected / ROWS as f64).abs() < 1e-12);
    check_slopes(&own, &gradient, |critic| whole(critic, &mut vec![0.0; critic.parameter_count()]));
}

#[test]
fn critic_loss_of_td3() {
    let batch = batch();
    let target_actor = network(OBSERVATION, ACTION, Activation::Tanh, false, 20);
    let noise = numbers(21, ROWS * ACTION);
    let smoothing = TargetSmoothing { std: 0.6, clip: 0.5 };
    let targets = [critic(22), critic(23)];
    let whole = |first: &Mlp<f64>, second: &Mlp<f64>, gradient: &mut [f64]| {
        let loss = td3::CriticLoss {
            batch: &batch,
            noise: &noise,
            smoothing,
            target_actor: &target_actor,
            critics: [first, second],
            target_critics: [&targets[0], &targets[1]],
        };
        let mut scratch = td3::CriticScratch::default();
        in_two_chunks(&mut |rows| loss.add_gradient(rows, &mut scratch, gradient))
    };
    let first = critic(24);
    let second = critic(25);
    let count = first.parameter_count();
    let mut gradient = vec![0.0; 2 * count];
    let found = whole(&first, &second, &mut gradient);
    let expected: f64 = (0..ROWS)
        .map(|row| {
            let smoothing_noise = noise[row * ACTION..][..ACTION].iter().map(|z| (0.6 * z).clamp(-0.5, 0.5));
            let action = outputs(&target_actor, &batch.next_observations, row);
            let action: Vec<f64> =
                action.iter().zip(smoothing_noise).map(|(a, n)| (a + n).clamp(-1.0, 1.0)).collect();
            let next_value = |target: &Mlp<f64>| {
                value(target, &batch.next_observations, &batch.next_privileged, row, &action)
            };
            let y = batch.returns[row]
                + batch.discounts[row] * next_value(&targets[0]).min(next_value(&targets[1]));
            let action = &batch.actions[row * ACTION..][..ACTION];
            let error = |critic: &Mlp<f64>| {
                (value(critic, &batch.observations, &batch.privileged, row, action) - y).powi(2)
            };
            error(&first) + error(&second)
        })
        .sum();
    assert!((found - expected / ROWS as f64).abs() < 1e-12);
    check_slopes(&first, &gradient[..count], |first| whole(first, &second, &mut vec![0.0; 2 * count]));
    check_slopes(&second, &gradient[count..], |second| whole(&first, second, &mut vec![0.0; 2 * count]));
}

#[test]
fn policy_loss_of_deterministic_policies() {
    let batch = batch();
    let critic = critic(30);
    let whole = |actor: &Mlp<f64>, gradient: &mut [f64]| {
        let loss = PolicyLoss { batch: &batch, actor, critic: &critic };
        let mut scratch = PolicyScratch::default();
        in_two_chunks(&mut |rows| loss.add_gradient(rows, &mut scratch, gradient))
    };
    let actor = network(OBSERVATION, ACTION, Activation::Tanh, false, 31);
    let mut gradient = vec![0.0; actor.parameter_count()];
    let found = whole(&actor, &mut gradient);
    let expected: f64 = (0..ROWS)
        .map(|row| {
            -value(
                &critic,
                &batch.observations,
                &batch.privileged,
                row,
                &outputs(&actor, &batch.observations, row),
            )
        })
        .sum();
    assert!((found - expected / ROWS as f64).abs() < 1e-12);
    check_slopes(&actor, &gradient, |actor| whole(actor, &mut vec![0.0; actor.parameter_count()]));
}

/// Returns the squashed action of a row and its log-probability, from the definition.
fn squashed(outputs: &[f64], noise: &[f64]) -> (Vec<f64>, f64) {
    let mut action = vec![];
    let mut log_prob = 0.0;
    for (i, z) in noise.iter().enumerate() {
        let std = (-5.0 + 3.5 * (1.0 + outputs[ACTION + i].tanh())).exp();
        let u = outputs[i] + std * z;
        // 1 - tanh² u = 1 / cosh² u avoids cancellation.
        log_prob += -0.5 * z * z - (std * std::f64::consts::TAU.sqrt()).ln() + 2.0 * u.cosh().ln();
        action.push(u.tanh());
    }
    (action, log_prob)
}

fn squashed_policy(network: &Mlp<f64>) -> sac::Actor<'_, f64> {
    sac::Actor { distribution: sac::Distribution::Squashed, network, log_std: &[] }
}

const TEMPERATURE: f64 = 0.3;

#[test]
fn critic_loss_of_sac() {
    let batch = batch();
    let actor = network(OBSERVATION, 2 * ACTION, Activation::Identity, false, 40);
    let noise = numbers(41, ROWS * ACTION);
    let targets = [critic(42), critic(43)];
    let whole = |first: &Mlp<f64>, second: &Mlp<f64>, gradient: &mut [f64]| {
        let loss = sac::CriticLoss {
            batch: &batch,
            noise: &noise,
            temperature: TEMPERATURE,
            actor: squashed_policy(&actor),
            critics: [first, second],
            target_critics: [&targets[0], &targets[1]],
        };
        let mut scratch = sac::CriticScratch::default();
        in_two_chunks(&mut |rows| loss.add_gradient(rows, &mut scratch, gradient))
    };
    let first = critic(44);
    let second = critic(45);
    let count = first.parameter_count();
    let mut gradient = vec![0.0; 2 * count];
    let found = whole(&first, &second, &mut gradient);
    let expected: f64 = (0..ROWS)
        .map(|row| {
            let outputs = outputs(&actor, &batch.next_observations, row);
            let (action, log_prob) = squashed(&outputs, &noise[row * ACTION..][..ACTION]);
            let next_value = |target: &Mlp<f64>| {
                value(target, &batch.next_observations, &batch.next_privileged, row, &action)
            };
            let soft = next_value(&targets[0]).min(next_value(&targets[1])) - TEMPERATURE * log_prob;
            let y = batch.returns[row] + batch.discounts[row] * soft;
            let action = &batch.actions[row * ACTION..][..ACTION];
            let error = |critic: &Mlp<f64>| {
                0.5 * (value(critic, &batch.observations, &batch.privileged, row, action) - y).powi(2)
            };
            error(&first) + error(&second)
        })
        .sum();
    assert!((found - expected / ROWS as f64).abs() < 1e-11, "{found} {}", expected / ROWS as f64);
    check_slopes(&first, &gradient[..count], |first| whole(first, &second, &mut vec![0.0; 2 * count]));
    check_slopes(&second, &gradient[count..], |second| whole(&first, second, &mut vec![0.0; 2 * count]));
}

#[test]
fn policy_loss_of_sac() {
    let batch = batch();
    let critics = [critic(50), critic(51)];
    let noise = numbers(52, ROWS * ACTION);
    let whole = |actor: &Mlp<f64>, gradient: &mut [f64]| {
        let loss = sac::PolicyLoss {
            batch: &batch,
            noise: &noise,
            temperature: TEMPERATURE,
            actor: squashed_policy(actor),
            critics: [&critics[0], &critics[1]],
        };
        let mut scratch = sac::PolicyScratch::default();
        let mut log_prob = 0.0;
        let loss = in_two_chunks(&mut |rows| {
            let (loss, share) = loss.add_gradient(rows, &mut scratch, gradient);
            log_prob += share;
            loss
        });
        (loss, log_prob)
    };
    let actor = network(OBSERVATION, 2 * ACTION, Activation::Identity, false, 53);
    let mut gradient = vec![0.0; actor.parameter_count()];
    let (found, mean_log_prob) = whole(&actor, &mut gradient);
    let mut expected = 0.0;
    let mut log_probs = 0.0;
    let mut chosen = [0, 0];
    for row in 0..ROWS {
        let (action, log_prob) =
            squashed(&outputs(&actor, &batch.observations, row), &noise[row * ACTION..][..ACTION]);
        let values = [0, 1].map(|i| value(&critics[i], &batch.observations, &batch.privileged, row, &action));
        expected += TEMPERATURE * log_prob - values[0].min(values[1]);
        log_probs += log_prob;
        chosen[usize::from(values[1] < values[0])] += 1;
    }
    assert!(
        chosen.iter().all(|count| *count > 0),
        "each critic has the smaller value in some row: {chosen:?}"
    );
    assert!((found - expected / ROWS as f64).abs() < 1e-11);
    assert!((mean_log_prob - log_probs / ROWS as f64).abs() < 1e-11);
    check_slopes(&actor, &gradient, |actor| whole(actor, &mut vec![0.0; actor.parameter_count()]).0);
}
