//! Training that starts from the policy of a controller: `run.from` and `run.critic_steps`.

use crate::keeper::Keeper;
use crate::line::Line;
use mishandle_controllers::Policy;
use mishandle_rollout::{Controller, Seed};
use mishandle_training::{ALGORITHMS, AlgorithmSettings, Origin, TrainingError};

fn train(
    settings: &AlgorithmSettings,
    origin: Origin<'_>,
    keeper: &mut Keeper,
) -> Result<Policy, TrainingError> {
    Ok(settings.train(&Line::new(0.05), Seed(5), origin, keeper)?.last)
}

/// Settings of a short training run with other settings of the table `[run]`.
fn settings(algorithm: &str, table: &str) -> AlgorithmSettings {
    let own = match algorithm {
        "ppo" => "rollout_steps = 12\nminibatch_size = 48",
        "trpo" => "rollout_steps = 12",
        _ => "steps_per_iteration = 12\nreplay = { warmup_steps = 50, batch_size = 32 }",
    };
    let text = format!(
        "run = {{ {table} }}\nepisodes.environments = 8\npolicy.hidden = [8]\npolicy.history = 1\ncritic.hidden = [8]\n{own}"
    );
    AlgorithmSettings::from_toml(algorithm, &text).unwrap().unwrap()
}

/// Trains a policy from scratch.
fn first(algorithm: &str) -> Policy {
    train(&settings(algorithm, "total_steps = 600"), Origin::New, &mut Keeper::default()).unwrap()
}

fn continued(algorithm: &str, table: &str, policy: &Policy) -> Result<Policy, TrainingError> {
    let settings = settings(algorithm, &format!("from = \"first\", {table}"));
    train(&settings, Origin::Policy(policy), &mut Keeper::default())
}

#[test]
fn while_only_the_critic_learns_the_policy_stays_and_then_it_learns_with_the_same_normalizer() {
    for algorithm in ALGORITHMS.iter().map(|entry| entry.name) {
        let policy = first(algorithm);
        let held = continued(algorithm, "total_steps = 600, critic_steps = 10_000", &policy).unwrap();
        assert_eq!(held.hash(), policy.hash(), "{algorithm}: a whole run of the critic");
        let learned = continued(algorithm, "total_steps = 600, critic_steps = 300", &policy).unwrap();
        assert_ne!(learned.network().parameters(), policy.network().parameters(), "{algorithm}");
        assert_eq!(learned.mean(), policy.mean(), "{algorithm}");
        assert_eq!(learned.variance(), policy.variance(), "{algorithm}");
        let at_once = continued(algorithm, "total_steps = 600", &policy).unwrap();
        assert_ne!(at_once.hash(), learned.hash(), "{algorithm}: the critic learned first");
    }
}

#[test]
fn a_resumed_training_from_a_controller_gives_the_same_bits() {
    for algorithm in ALGORITHMS.iter().map(|entry| entry.name) {
        let policy = first(algorithm);
        let settings = settings(algorithm, "from = \"first\", total_steps = 900, critic_steps = 200");
        let whole = train(&settings, Origin::Policy(&policy), &mut Keeper::default()).unwrap();
        for stop_after in [1, 4] {
            let mut keeper = Keeper { stop_after: Some(stop_after), ..Default::default() };
            train(&settings, Origin::Policy(&policy), &mut keeper).unwrap();
            let origin = Origin::Checkpoint(keeper.checkpoint.as_ref().unwrap());
            let resumed = train(&settings, origin, &mut Keeper::default()).unwrap();
            assert_eq!(resumed.hash(), whole.hash(), "{algorithm} after {stop_after}");
        }
    }
}

#[test]
fn a_controller_gets_a_longer_history_but_no_shorter_one() {
    for algorithm in ALGORITHMS.iter().map(|entry| entry.name) {
        let policy = first(algorithm);
        let settings = |length: usize| {
            let text = format!(
                "run = {{ from = \"first\", total_steps = 600, critic_steps = 10_000 }}\n\
                 episodes.environments = 8\npolicy = {{ hidden = [8], history = {length} }}\ncritic.hidden = [8]"
            );
            AlgorithmSettings::from_toml(algorithm, &text).unwrap().unwrap()
        };
        let train = |length| train(&settings(length), Origin::Policy(&policy), &mut Keeper::default());
        let longer = train(3).unwrap();
        assert_eq!(longer.hash(), policy.remembering(3).unwrap().hash(), "{algorithm}");
        // It acts as before, whatever it remembers.
        let mut before = policy.worker();
        let mut after = longer.worker();
        let states = [policy.state_size(), longer.state_size()];
        let mut state = vec![0.0; states[0]];
        let mut longer_state = vec![0.0; states[1]];
        before.reset(&mut state, Seed(0));
        after.reset(&mut longer_state, Seed(0));
        for step in 0..20_u8 {
            let observation = vec![f32::from(step).sin(); policy.history().observation_size()];
            let mut actions = [0, 1].map(|_| vec![0.0_f32; policy.history().action_size()]);
            before.act(1, &observation, &mut state, &mut actions[0]);
            after.act(1, &observation, &mut longer_state, &mut actions[1]);
            let close = actions[0].iter().zip(&actions[1]).all(|(a, b)| (a - b).abs() < 1e-6);
            assert!(close, "{algorithm}, step {step}: {actions:?}");
        }
        let error = train(0).unwrap_err().to_string();
        assert!(error.contains("its history is 1, that of the settings 0"), "{algorithm}: {error}");
    }
}

#[test]
fn a_controller_of_another_form_is_an_error() {
    let other = |algorithm: &str, policy: &Policy| {
        let text = "run = { from = \"first\", total_steps = 600 }\npolicy = { hidden = [8], history = 1, activation = \"tanh\" }";
        let settings = AlgorithmSettings::from_toml(algorithm, text).unwrap().unwrap();
        train(&settings, Origin::Policy(policy), &mut Keeper::default()).unwrap_err().to_string()
    };
    let ppo = first("ppo");
    let sac = first("sac");
    let td3 = first("td3");
    let error = other("ppo", &ppo);
    assert!(
        error.contains("its activation is Elu and Identity at the end, that of the settings Tanh"),
        "{error}"
    );
    // The network of SAC has two outputs per action, that of TD3 ends in tanh.
    for (algorithm, policy, part) in [
        ("ppo", &sac, "layers"),
        ("sac", &ppo, "layers"),
        ("ppo", &td3, "Tanh at the end"),
        ("td3", &ppo, "Identity at the end"),
    ] {
        let error = continued(algorithm, "total_steps = 600", policy).unwrap_err().to_string();
        assert!(error.contains(part), "{algorithm}: {error}");
    }
}

#[test]
fn settings_and_origin_must_agree() {
    let policy = first("ppo");
    for (table, origin, expected) in [
        (
            "from = \"first\"",
            Origin::New,
            "the setting `run.from` names `first`, but training starts from a random policy",
        ),
        (
            "total_steps = 600",
            Origin::Policy(&policy),
            "the setting `run.from` names no controller, but training starts from the policy of a controller",
        ),
    ] {
        let settings = settings("ppo", table);
        let trained = train(&settings, origin, &mut Keeper::default());
        assert_eq!(trained.unwrap_err().to_string(), expected);
    }
}
