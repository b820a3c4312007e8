//! Updates of SAC, TD3 and DDPG. `tests/golden/skrl/make.py` writes the cases.

use mishandle_network::Mlp;
use mishandle_rollout::Seed;
use serde_json::Value;

use super::{close, number, numbers, singles};
use crate::TomlSettings;
use crate::ddpg::{Ddpg, DdpgSettings};
use crate::off_policy::action_value::{NetworkWithTarget, Sizes};
use crate::off_policy::agent::Agent;
use crate::off_policy::transitions::TransitionBatch;
use crate::sac::{Sac, SacSettings};
use crate::td3::{Td3, Td3Settings};

/// Observation size and action size of the cases, as in `make.py`.
const SIZES: Sizes = Sizes { observation: 3, action: 2, privileged: 0 };

/// Kinds of cases, by their keys in the document.
const TUNED: &str = "tuned";
const DEFAULT: &str = "default";

/// Several updates of one skrl agent.
struct Case {
    document: Value,
    kind: &'static str,
    name: &'static str,
}

impl Case {
    fn new(kind: &'static str, name: &'static str) -> Case {
        let document = serde_json::from_str(include_str!("../../tests/golden/skrl/cases.json")).unwrap();
        Case { document, kind, name }
    }

    fn of(&self, key: &str) -> &Value {
        &self.document[self.kind][self.name][key]
    }

    /// Returns a setting of all tuned cases.
    fn setting(&self, key: &str) -> f64 {
        number(&self.document, key)
    }

    /// Returns the settings of the case (tuned or those of the base) with the additional settings
    /// `own`.
    fn settings<S: TomlSettings>(&self, own: &str) -> S {
        let hidden = self.setting("hidden");
        let rows = self.batch().rows();
        let sizes =
            format!("replay.batch_size = {rows}\npolicy.hidden = [{hidden}]\ncritic.hidden = [{hidden}]\n");
        let rates = format!(
            "gamma = {}\ntau = {}\npolicy.learning_rate = {}\ncritic.learning_rate = {}\ncritic.layer_norm = false\n",
            self.of("gamma"),
            self.setting("tau"),
            self.setting("actor_learning_rate"),
            self.setting("critic_learning_rate")
        );
        let text = match self.kind {
            TUNED => format!("{sizes}{rates}{own}"),
            _ => format!("base = \"skrl-0.10\"\n{sizes}{own}"),
        };
        S::from_toml(&text).unwrap()
    }

    fn batch(&self) -> TransitionBatch<f32> {
        TransitionBatch {
            observations: singles(self.of("observations")),
            actions: singles(self.of("actions")),
            returns: singles(self.of("returns")),
            discounts: singles(self.of("discounts")),
            next_observations: singles(self.of("next_observations")),
            ..TransitionBatch::default()
        }
    }

    fn noise(&self) -> Vec<Vec<f64>> {
        self.of("draws").as_array().unwrap().iter().map(numbers).collect()
    }

    fn initialize(&self, network: &mut Mlp<f32>, name: &str) {
        let start = singles(&self.of("start")[name]);
        network.update(|parameters| parameters.copy_from_slice(&start));
    }

    fn initialize_both(&self, networks: &mut NetworkWithTarget, name: &str) {
        self.initialize(&mut networks.network, name);
        self.initialize(&mut networks.target, name);
    }

    #[track_caller]
    fn check(&self, what: &str, found: &[f32]) {
        close(what, found, self.of(what));
    }

    #[track_caller]
    fn check_gradient(&self, network: &str, step: usize, found: &[f32]) {
        close(&format!("gradient {step} of {network}"), found, &self.of("gradients")[network][step]);
    }

    #[track_caller]
    fn check_ends(&self, networks: &[(&NetworkWithTarget, &str)]) {
        let end = self.of("end");
        for (with_target, name) in networks {
            close(name, with_target.network.parameters(), &end[*name]);
            close(
                &format!("target of {name}"),
                with_target.target.parameters(),
                &end[format!("target_{name}")],
            );
        }
    }
}

fn check_sac(kind: &'static str) {
    let case = Case::new(kind, "sac");
    let rate = case.setting("temperature_learning_rate");
    let alpha = case.setting("temperature");
    let rates = format!("temperature_learning_rate = {rate}\ninitial_temperature = {alpha}");
    let settings: SacSettings = case.settings(if kind == TUNED { &rates } else { "" });
    let mut sac = Sac::new(SIZES, &settings, Seed(0)).unwrap();
    if kind == TUNED {
        sac.target_entropy = case.setting("target_entropy");
    } else {
        // skrl's default is -1 per action dimension. The first Adam steps would have the same
        // length for any other value.
        assert!((sac.target_entropy + SIZES.action as f64).abs() < 1e-6, "{}", sac.target_entropy);
    }
    case.initialize(&mut sac.actor, "policy");
    if let Some(start) = case.of("start").get("log_std") {
        sac.log_std = singles(start);
    }
    case.initialize_both(&mut sac.critics.0[0], "critic_1");
    case.initialize_both(&mut sac.critics.0[1], "critic_2");
    let batch = case.batch();
    let count = sac.actor.parameter_count();
    let mut critic_losses = vec![];
    let mut policy_losses = vec![];
    let mut temperatures = vec![];
    for (step, pair) in case.noise().chunks(2).enumerate() {
        let losses = sac.train_batch(&batch, &[pair[0].clone(), pair[1].clone()], true).unwrap();
        critic_losses.push(losses.0);
        policy_losses.extend(losses.1);
        temperatures.push(sac.log_temperature[0].exp() as f32);
        let (first, second) = halves(&sac.critics_gradient.sums);
        case.check_gradient("critic_1", step, first);
        case.check_gradient("critic_2", step, second);
        case.check_gradient("policy", step, &sac.actor_gradient.sums[..count]);
        if !sac.log_std.is_empty() {
            case.check_gradient("log_std", step, &sac.actor_gradient.sums[count..][..SIZES.action]);
        }
    }
    case.check("critic_losses", &critic_losses);
    case.check("policy_losses", &policy_losses);
    case.check("temperatures", &temperatures);
    close("policy", sac.actor.parameters(), &case.of("end")["policy"]);
    if !sac.log_std.is_empty() {
        close("log σ", &sac.log_std, &case.of("end")["log_std"]);
    }
    case.check_ends(&[(&sac.critics.0[0], "critic_1"), (&sac.critics.0[1], "critic_2")]);
    assert_eq!(Some(settings.gamma), case.of("gamma").as_f64());
}

/// Splits the gradient of two critics, without the loss at its end.
fn halves(critics_gradient: &[f32]) -> (&[f32], &[f32]) {
    critics_gradient[..critics_gradient.len() - 1].split_at(critics_gradient.len() / 2)
}

fn check_td3(kind: &'static str, name: &'static str, smoothing: &str) {
    let case = Case::new(kind, name);
    let settings: Td3Settings = case.settings(smoothing);
    let mut td3 = Td3::new(SIZES, &settings, Seed(0)).unwrap();
    case.initialize_both(&mut td3.actor.policy, "policy");
    case.initialize_both(&mut td3.critics.0[0], "critic_1");
    case.initialize_both(&mut td3.critics.0[1], "critic_2");
    let batch = case.batch();
    let mut critic_losses = vec![];
    let mut policy_losses = vec![];
    for (step, noise) in case.noise().iter().enumerate() {
        let (critic_loss, policy_loss) = td3.train_batch(&batch, noise, step as u64, true).unwrap();
        let (first, second) = halves(&td3.critics_gradient.sums);
        case.check_gradient("critic_1", step, first);
        case.check_gradient("critic_2", step, second);
        critic_losses.push(critic_loss);
        if let Some(policy_loss) = policy_loss {
            case.check_gradient(
                "policy",
                policy_losses.len(),
                &td3.actor_gradient.sums[..td3.actor_gradient.sums.len() - 1],
            );
            policy_losses.push(policy_loss);
        }
    }
    case.check("critic_losses", &critic_losses);
    case.check("policy_losses", &policy_losses);
    case.check_ends(&[
        (&td3.actor.policy, "policy"),
        (&td3.critics.0[0], "critic_1"),
        (&td3.critics.0[1], "critic_2"),
    ]);
    assert_eq!(Some(settings.gamma), case.of("gamma").as_f64());
}

fn check_ddpg(kind: &'static str) {
    let case = Case::new(kind, "ddpg");
    let settings: DdpgSettings = case.settings("");
    let mut ddpg = Ddpg::new(SIZES, &settings, Seed(0)).unwrap();
    case.initialize_both(&mut ddpg.actor.policy, "policy");
    case.initialize_both(&mut ddpg.critic, "critic");
    let batch = case.batch();
    let mut critic_losses = vec![];
    let mut policy_losses = vec![];
    for step in 0..case.of("critic_losses").as_array().unwrap().len() {
        let (critic_loss, policy_loss) = ddpg.train_batch(&batch, true).unwrap();
        critic_losses.push(critic_loss);
        policy_losses.extend(policy_loss);
        case.check_gradient(
            "critic",
            step,
            &ddpg.critic_gradient.sums[..ddpg.critic_gradient.sums.len() - 1],
        );
        case.check_gradient("policy", step, &ddpg.actor_gradient.sums[..ddpg.actor_gradient.sums.len() - 1]);
    }
    case.check("critic_losses", &critic_losses);
    case.check("policy_losses", &policy_losses);
    case.check_ends(&[(&ddpg.actor.policy, "policy"), (&ddpg.critic, "critic")]);
    assert_eq!(Some(settings.gamma), case.of("gamma").as_f64());
}

#[test]
fn updates_of_squashed_sac_match_skrl() {
    check_sac(TUNED);
}

#[test]
fn updates_of_sac_with_the_base_match_skrl() {
    check_sac(DEFAULT);
}

#[test]
fn updates_of_td3_match_skrl() {
    check_td3(TUNED, "td3", "smoothing_std = 0.5\nsmoothing_clip = 0.4");
}

#[test]
fn updates_of_td3_with_the_base_match_skrl() {
    check_td3(DEFAULT, "td3_without_smoothing", "");
    // With smoothing noise and the clip range of the base.
    check_td3(DEFAULT, "td3", "smoothing_std = 0.5");
}

#[test]
fn updates_of_ddpg_match_skrl() {
    check_ddpg(TUNED);
    check_ddpg(DEFAULT);
}
