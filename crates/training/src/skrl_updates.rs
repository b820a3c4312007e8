//! Updates of SAC, TD3 and DDPG against skrl's: `tests/golden/skrl/make.py` writes the cases.

use mishandle_network::Mlp;
use mishandle_rollout::Seed;
use serde_json::Value;

use crate::action_value::Followed;
use crate::ddpg::{Ddpg, DdpgConfig};
use crate::replay::Batch;
use crate::sac::{Sac, SacConfig};
use crate::td3::{Td3, Td3Config};
use crate::{ActionValueSettings, ActorSettings, ReplaySettings};

/// Observations and actions of the cases, as many as `make.py` says.
const SIZES: (usize, usize) = (3, 2);

fn document() -> Value {
    serde_json::from_str(include_str!("../tests/golden/skrl/cases.json")).unwrap()
}

pub(crate) fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("`{key}` is no number"))
}

pub(crate) fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

pub(crate) fn singles(value: &Value) -> Vec<f32> {
    numbers(value).into_iter().map(|x| x as f32).collect()
}

fn batch(case: &Value) -> Batch<f32> {
    Batch {
        observations: singles(&case["observations"]),
        actions: singles(&case["actions"]),
        returns: singles(&case["returns"]),
        discounts: singles(&case["discounts"]),
        next_observations: singles(&case["next_observations"]),
    }
}

fn draws(case: &Value) -> Vec<Vec<f64>> {
    case["draws"].as_array().unwrap().iter().map(numbers).collect()
}

/// What all three are made with.
fn parts(document: &Value, rows: usize) -> (ReplaySettings, ActorSettings, ActionValueSettings) {
    let hidden = vec![number(document, "hidden") as usize];
    (
        ReplaySettings { batch_rows: rows, ..ReplaySettings::default() },
        ActorSettings {
            hidden: hidden.clone(),
            learning_rate: number(document, "actor_learning_rate"),
            ..ActorSettings::default()
        },
        ActionValueSettings {
            hidden,
            learning_rate: number(document, "critic_learning_rate"),
            layer_norm: false,
            ..ActionValueSettings::default()
        },
    )
}

fn begin(network: &mut Mlp<f32>, start: &Value) {
    let start = singles(start);
    network.update(|parameters| parameters.copy_from_slice(&start));
}

fn begin_both(followed: &mut Followed, start: &Value) {
    begin(&mut followed.network, start);
    begin(&mut followed.target, start);
}

#[track_caller]
pub(crate) fn close(what: &str, found: &[f32], wanted: &Value) {
    close_within(1e-5, what, found, wanted);
}

#[track_caller]
pub(crate) fn close_within(tolerance: f64, what: &str, found: &[f32], wanted: &Value) {
    let wanted = numbers(wanted);
    assert_eq!(found.len(), wanted.len(), "{what}");
    for (i, (found, wanted)) in found.iter().zip(wanted).enumerate() {
        let error = (f64::from(*found) - wanted).abs();
        assert!(error < tolerance * wanted.abs().max(1.0), "{what} {i}: {found}, skrl has {wanted}");
    }
}

#[test]
fn sac() {
    let document = document();
    let case = &document["sac"];
    let batch = batch(case);
    let (replay, policy, critic) = parts(&document, batch.rows());
    let config = SacConfig {
        tau: number(&document, "tau"),
        initial_temperature: number(&document, "temperature"),
        temperature_learning_rate: number(&document, "temperature_learning_rate"),
        replay,
        policy,
        critic,
        ..SacConfig::default()
    };
    let mut sac = Sac::new(SIZES, &config, Seed(0)).unwrap();
    sac.target_entropy = number(&document, "target_entropy");
    begin(&mut sac.actor, &case["start"]["policy"]);
    begin_both(&mut sac.critics[0], &case["start"]["critic_1"]);
    begin_both(&mut sac.critics[1], &case["start"]["critic_2"]);
    let (mut critic_losses, mut policy_losses, mut temperatures) = (vec![], vec![], vec![]);
    for pair in draws(case).chunks(2) {
        let told = sac.learn(&batch, &[pair[0].clone(), pair[1].clone()]).unwrap();
        critic_losses.push(told[0]);
        policy_losses.push(told[1]);
        temperatures.push(sac.log_temperature[0].exp() as f32);
    }
    close("critics' loss", &critic_losses, &case["critic_losses"]);
    close("policy's loss", &policy_losses, &case["policy_losses"]);
    close("temperature", &temperatures, &case["temperatures"]);
    close("policy", sac.actor.parameters(), &case["end"]["policy"]);
    for (critic, name) in sac.critics.iter().zip(["critic_1", "critic_2"]) {
        close(name, critic.network.parameters(), &case["end"][name]);
        close(name, critic.target.parameters(), &case["end"][format!("target_{name}")]);
    }
}

#[test]
fn td3() {
    let document = document();
    let case = &document["td3"];
    let batch = batch(case);
    let (replay, policy, critic) = parts(&document, batch.rows());
    let config = Td3Config {
        tau: number(&document, "tau"),
        smoothing_std: number(&document, "smoothing_std"),
        smoothing_clip: number(&document, "smoothing_clip"),
        replay,
        policy,
        critic,
        ..Td3Config::default()
    };
    let mut td3 = Td3::new(SIZES, &config, Seed(0)).unwrap();
    begin_both(&mut td3.actor, &case["start"]["policy"]);
    begin_both(&mut td3.critics[0], &case["start"]["critic_1"]);
    begin_both(&mut td3.critics[1], &case["start"]["critic_2"]);
    let (mut critic_losses, mut policy_losses) = (vec![], vec![]);
    for (draws, index) in draws(case).iter().zip(0..) {
        let (critic_loss, policy_loss) = td3.learn(&batch, draws, index).unwrap();
        critic_losses.push(critic_loss);
        policy_losses.extend(policy_loss);
    }
    close("critics' loss", &critic_losses, &case["critic_losses"]);
    close("policy's loss", &policy_losses, &case["policy_losses"]);
    let networks = [(&td3.actor, "policy"), (&td3.critics[0], "critic_1"), (&td3.critics[1], "critic_2")];
    for (followed, name) in networks {
        close(name, followed.network.parameters(), &case["end"][name]);
        close(name, followed.target.parameters(), &case["end"][format!("target_{name}")]);
    }
}

#[test]
fn ddpg() {
    let document = document();
    let case = &document["ddpg"];
    let batch = batch(case);
    let (replay, policy, critic) = parts(&document, batch.rows());
    let config =
        DdpgConfig { tau: number(&document, "tau"), replay, policy, critic, ..DdpgConfig::default() };
    let mut ddpg = Ddpg::new(SIZES, &config, Seed(0)).unwrap();
    begin_both(&mut ddpg.actor, &case["start"]["policy"]);
    begin_both(&mut ddpg.critic, &case["start"]["critic"]);
    let updates = case["critic_losses"].as_array().unwrap().len();
    let told: Vec<[f32; 2]> = (0..updates).map(|_| ddpg.learn(&batch).unwrap()).collect();
    let losses = |which: usize| told.iter().map(|losses| losses[which]).collect::<Vec<f32>>();
    close("critic's loss", &losses(0), &case["critic_losses"]);
    close("policy's loss", &losses(1), &case["policy_losses"]);
    for (followed, name) in [(&ddpg.actor, "policy"), (&ddpg.critic, "critic")] {
        close(name, followed.network.parameters(), &case["end"][name]);
        close(name, followed.target.parameters(), &case["end"][format!("target_{name}")]);
    }
}
