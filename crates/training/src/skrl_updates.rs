//! Updates of SAC, TD3 and DDPG against skrl's: `tests/golden/skrl/make.py` writes the cases.

use mishandle_network::Mlp;
use mishandle_rollout::Seed;
use serde_json::Value;

use crate::Settings;
use crate::action_value::Followed;
use crate::agent::Agent;
use crate::batch::Batch;
use crate::ddpg::{Ddpg, DdpgConfig};
use crate::sac::{Sac, SacConfig};
use crate::td3::{Td3, Td3Config};

/// Observations and actions of the cases, as many as `make.py` says.
const SIZES: (usize, usize) = (3, 2);

/// Kinds of cases, with their names in the document.
const TUNED: &str = "tuned";
const DEFAULT: &str = "default";

/// Some updates of one of skrl's agents.
struct Case {
    document: Value,
    kind: &'static str,
    name: &'static str,
}

impl Case {
    fn new(kind: &'static str, name: &'static str) -> Case {
        let document = serde_json::from_str(include_str!("../tests/golden/skrl/cases.json")).unwrap();
        Case { document, kind, name }
    }

    fn of(&self, key: &str) -> &Value {
        &self.document[self.kind][self.name][key]
    }

    /// A number that all tuned cases were made with.
    fn setting(&self, key: &str) -> f64 {
        number(&self.document, key)
    }

    /// The settings of the case, tuned or the preset's, and what else it has.
    fn config<S: Settings>(&self, own: &str) -> S {
        let (hidden, rows) = (self.setting("hidden"), self.batch().rows());
        let sizes =
            format!("replay.batch_rows = {rows}\npolicy.hidden = [{hidden}]\ncritic.hidden = [{hidden}]\n");
        let rates = format!(
            "gamma = {}\ntau = {}\npolicy.learning_rate = {}\ncritic.learning_rate = {}\ncritic.layer_norm = false\n",
            self.of("gamma"),
            self.setting("tau"),
            self.setting("actor_learning_rate"),
            self.setting("critic_learning_rate")
        );
        let text = match self.kind {
            TUNED => format!("{sizes}{rates}{own}"),
            _ => format!("preset = \"skrl-0.10\"\n{sizes}{own}"),
        };
        S::from_toml(&text).unwrap()
    }

    fn batch(&self) -> Batch<f32> {
        Batch {
            observations: singles(self.of("observations")),
            actions: singles(self.of("actions")),
            returns: singles(self.of("returns")),
            discounts: singles(self.of("discounts")),
            next_observations: singles(self.of("next_observations")),
            starts: vec![],
        }
    }

    fn draws(&self) -> Vec<Vec<f64>> {
        self.of("draws").as_array().unwrap().iter().map(numbers).collect()
    }

    fn begin(&self, network: &mut Mlp<f32>, name: &str) {
        let start = singles(&self.of("start")[name]);
        network.update(|parameters| parameters.copy_from_slice(&start));
    }

    fn begin_both(&self, followed: &mut Followed, name: &str) {
        self.begin(&mut followed.network, name);
        self.begin(&mut followed.target, name);
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
    fn check_ends(&self, networks: &[(&Followed, &str)]) {
        let end = self.of("end");
        for (followed, name) in networks {
            close(name, followed.network.parameters(), &end[*name]);
            close(&format!("target of {name}"), followed.target.parameters(), &end[format!("target_{name}")]);
        }
    }
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

fn check_sac(kind: &'static str) {
    let case = Case::new(kind, "sac");
    let (rate, alpha) = (case.setting("temperature_learning_rate"), case.setting("temperature"));
    let rates = format!("temperature_learning_rate = {rate}\ninitial_temperature = {alpha}");
    let config: SacConfig = case.config(if kind == TUNED { &rates } else { "" });
    let mut sac = Sac::new(SIZES, &config, Seed(0)).unwrap();
    if kind == TUNED {
        sac.target_entropy = case.setting("target_entropy");
    } else {
        // skrl's default is -1 for each number of an action. Adam makes steps of the same length with any other at first.
        assert!((sac.target_entropy + SIZES.1 as f64).abs() < 1e-6, "{}", sac.target_entropy);
    }
    case.begin(&mut sac.actor, "policy");
    if let Some(start) = case.of("start").get("log_std") {
        sac.log_std = singles(start);
    }
    case.begin_both(&mut sac.critics.0[0], "critic_1");
    case.begin_both(&mut sac.critics.0[1], "critic_2");
    let (batch, count) = (case.batch(), sac.actor.parameter_count());
    let (mut critic_losses, mut policy_losses, mut temperatures) = (vec![], vec![], vec![]);
    for (step, pair) in case.draws().chunks(2).enumerate() {
        let told = sac.learn(&batch, &[pair[0].clone(), pair[1].clone()]).unwrap();
        critic_losses.push(told[0]);
        policy_losses.push(told[1]);
        temperatures.push(sac.log_temperature[0].exp() as f32);
        let (first, second) = halves(&sac.by_critics.sums);
        case.check_gradient("critic_1", step, first);
        case.check_gradient("critic_2", step, second);
        case.check_gradient("policy", step, &sac.by_actor.sums[..count]);
        if !sac.log_std.is_empty() {
            case.check_gradient("log_std", step, &sac.by_actor.sums[count..][..SIZES.1]);
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
    assert_eq!(Some(config.gamma), case.of("gamma").as_f64());
}

/// The gradients of two critics, of what ends in the loss.
fn halves(by_critics: &[f32]) -> (&[f32], &[f32]) {
    by_critics[..by_critics.len() - 1].split_at(by_critics.len() / 2)
}

fn check_td3(kind: &'static str, name: &'static str, smoothing: &str) {
    let case = Case::new(kind, name);
    let config: Td3Config = case.config(smoothing);
    let mut td3 = Td3::new(SIZES, &config, Seed(0)).unwrap();
    case.begin_both(&mut td3.actor.followed, "policy");
    case.begin_both(&mut td3.critics.0[0], "critic_1");
    case.begin_both(&mut td3.critics.0[1], "critic_2");
    let (batch, mut critic_losses, mut policy_losses) = (case.batch(), vec![], vec![]);
    for (step, draws) in case.draws().iter().enumerate() {
        let (critic_loss, policy_loss) = td3.learn(&batch, draws, step as u64).unwrap();
        let (first, second) = halves(&td3.by_critics.sums);
        case.check_gradient("critic_1", step, first);
        case.check_gradient("critic_2", step, second);
        critic_losses.push(critic_loss);
        if let Some(policy_loss) = policy_loss {
            case.check_gradient(
                "policy",
                policy_losses.len(),
                &td3.by_actor.sums[..td3.by_actor.sums.len() - 1],
            );
            policy_losses.push(policy_loss);
        }
    }
    case.check("critic_losses", &critic_losses);
    case.check("policy_losses", &policy_losses);
    case.check_ends(&[
        (&td3.actor.followed, "policy"),
        (&td3.critics.0[0], "critic_1"),
        (&td3.critics.0[1], "critic_2"),
    ]);
    assert_eq!(Some(config.gamma), case.of("gamma").as_f64());
}

fn check_ddpg(kind: &'static str) {
    let case = Case::new(kind, "ddpg");
    let config: DdpgConfig = case.config("");
    let mut ddpg = Ddpg::new(SIZES, &config, Seed(0)).unwrap();
    case.begin_both(&mut ddpg.actor.followed, "policy");
    case.begin_both(&mut ddpg.critic, "critic");
    let (batch, mut critic_losses, mut policy_losses) = (case.batch(), vec![], vec![]);
    for step in 0..case.of("critic_losses").as_array().unwrap().len() {
        let [critic_loss, policy_loss] = ddpg.learn(&batch).unwrap();
        critic_losses.push(critic_loss);
        policy_losses.push(policy_loss);
        case.check_gradient("critic", step, &ddpg.by_critic.sums[..ddpg.by_critic.sums.len() - 1]);
        case.check_gradient("policy", step, &ddpg.by_actor.sums[..ddpg.by_actor.sums.len() - 1]);
    }
    case.check("critic_losses", &critic_losses);
    case.check("policy_losses", &policy_losses);
    case.check_ends(&[(&ddpg.actor.followed, "policy"), (&ddpg.critic, "critic")]);
    assert_eq!(Some(config.gamma), case.of("gamma").as_f64());
}

#[test]
fn a_squashed_sac_moves_as_skrls_would() {
    check_sac(TUNED);
}

#[test]
fn sac_under_its_preset_is_skrls() {
    check_sac(DEFAULT);
}

#[test]
fn td3_moves_as_skrls() {
    check_td3(TUNED, "td3", "smoothing_std = 0.5\nsmoothing_clip = 0.4");
}

#[test]
fn td3_under_its_preset_is_skrls() {
    check_td3(DEFAULT, "td3_without_smoothing", "");
    // The preset's clip, with noise.
    check_td3(DEFAULT, "td3", "smoothing_std = 0.5");
}

#[test]
fn ddpg_is_skrls() {
    check_ddpg(TUNED);
    check_ddpg(DEFAULT);
}
