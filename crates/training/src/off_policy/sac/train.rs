use mishandle_controllers::Policy;
use mishandle_network::{Adam, Mlp};
use mishandle_rollout::Seed;

use super::distribution::{Actor, Distribution};
use super::loss::{CriticLoss, CriticScratch, PolicyLoss, PolicyScratch, temperature_loss};
use super::settings::SacSettings;
use super::squashed_sample::CLIPPED_LOG_STD_RANGE;
use crate::gaussian::DiagonalGaussian;
use crate::initialization::initial_network;
use crate::off_policy::action_value::Sizes;
use crate::off_policy::agent::{Agent, BehaviorPolicy, weight_seed};
use crate::off_policy::batch_gradient::BatchGradient;
use crate::off_policy::sample_noise;
use crate::off_policy::transitions::TransitionBatch;
use crate::off_policy::twin_critics::TwinCritics;
use crate::{Checkpoint, TrainingError};

pub(crate) struct Sac {
    tau: f64,
    noise_hold: u64,
    /// Target entropy H̄.
    pub target_entropy: f64,
    distribution: Distribution,
    pub actor: Mlp<f32>,
    actor_adam: Adam<f32>,
    /// log σ of each action dimension before clamping; empty if the network outputs it.
    pub log_std: Vec<f32>,
    log_std_adam: Adam<f32>,
    pub critics: TwinCritics,
    /// log α, as an array for its optimizer.
    pub log_temperature: [f64; 1],
    temperature_adam: Adam<f64>,
    /// Entropy in the last update.
    entropy: f64,
    /// z of the next actions in the targets, and of the actions in the policy loss.
    noise: [Vec<f64>; 2],
    pub critics_gradient: BatchGradient<CriticScratch<f32>>,
    /// Gradient with respect to the actor's network, then log σ; then the mean of log π.
    pub actor_gradient: BatchGradient<PolicyScratch<f32>>,
}

impl Sac {
    /// Updates all networks and the temperature, or the critics only; returns the losses of critics
    /// and policy.
    ///
    /// # Errors
    /// If a loss is NaN or infinite; returns its name.
    pub fn train_batch(
        &mut self,
        batch: &TransitionBatch<f32>,
        noise: &[Vec<f64>; 2],
        learns_policy: bool,
    ) -> Result<(f32, Option<f32>), &'static str> {
        let Sac { distribution, actor, log_std, critics, critics_gradient, actor_gradient, .. } = self;
        let policy = Actor { distribution: *distribution, network: actor, log_std };
        let temperature = self.log_temperature[0].exp();
        let loss = CriticLoss {
            batch,
            noise: &noise[0],
            temperature,
            actor: policy,
            critics: critics.networks(),
            target_critics: critics.targets(),
        };
        let (gradient, critic_loss) = critics_gradient
            .compute(batch.rows(), |rows, scratch, gradient| loss.add_gradient(rows, scratch, gradient))?;
        critics.step(gradient);
        if !learns_policy {
            critics.soft_update(self.tau);
            return Ok((critic_loss, None));
        }

        let loss =
            PolicyLoss { batch, noise: &noise[1], temperature, actor: policy, critics: critics.networks() };
        let log_stds_end = actor.parameter_count() + log_std.len();
        let (sums, policy_loss) = actor_gradient.compute(batch.rows(), |rows, scratch, sums| {
            let (gradient, mean_log_prob_sum) = sums.split_at_mut(log_stds_end);
            let (loss, mean_log_prob) = loss.add_gradient(rows, scratch, gradient);
            mean_log_prob_sum[0] += mean_log_prob as f32;
            loss
        })?;
        let (gradient, mean_log_prob) = sums.split_at(log_stds_end);
        let (network_gradient, log_std_gradient) = gradient.split_at(actor.parameter_count());
        actor.update(|parameters| self.actor_adam.step(parameters, network_gradient));
        self.log_std_adam.step(log_std, log_std_gradient);

        let mean_log_prob = f64::from(mean_log_prob[0]);
        let (_, slope) = temperature_loss(self.log_temperature[0], mean_log_prob, self.target_entropy);
        self.temperature_adam.step(&mut self.log_temperature, &[slope]);
        self.entropy = -mean_log_prob;
        critics.soft_update(self.tau);
        Ok((critic_loss, Some(policy_loss)))
    }
}

impl BehaviorPolicy for Sac {
    fn network(&self) -> &Mlp<f32> {
        &self.actor
    }

    fn noise_hold(&self) -> u64 {
        self.noise_hold
    }

    fn sample_action(&self, _row: usize, _rows: usize, outputs: &[f32], noise: &[f64], action: &mut [f32]) {
        let policy = Actor { distribution: self.distribution, network: &self.actor, log_std: &self.log_std };
        for (action, sample) in action.iter_mut().zip(policy.row_samples(outputs, noise)) {
            *action = sample.action as f32;
        }
    }

    fn policy(&self, length: usize, mean: Vec<f64>, variance: Vec<f64>) -> Result<Policy, TrainingError> {
        let log_std = match self.distribution {
            Distribution::Squashed => None,
            Distribution::Clipped => {
                let (low, high) = CLIPPED_LOG_STD_RANGE;
                Some(self.log_std.iter().map(|x| x.clamp(low as f32, high as f32)).collect())
            }
        };
        Ok(Policy::with_history(length, mean, variance, self.actor.clone(), log_std)?)
    }
}

impl Agent for Sac {
    type Settings = SacSettings;
    type BehaviorPolicy = Sac;

    fn new(sizes: Sizes, settings: &SacSettings, seed: Seed) -> Result<Sac, TrainingError> {
        let policy = &settings.policy;
        let distribution = settings.distribution;
        // A small gain of the last layer: the initial actions are near 0 with h near 0 for all
        // observations.
        let actor = initial_network(
            sizes.observation,
            &policy.hidden,
            distribution.outputs(sizes.action),
            policy.activation,
            policy.initialization,
            0.01,
            weight_seed(seed, 0),
        )?;
        let mut log_std = vec![0.0; distribution.parameters(sizes.action)];
        policy.initialization.initialize_vector(&mut log_std, weight_seed(seed, 3));
        let critics = TwinCritics::new(sizes, &settings.critic, seed)?;
        Ok(Sac {
            tau: settings.tau,
            noise_hold: settings.exploration_hold,
            target_entropy: DiagonalGaussian::new(&vec![settings.target_std.ln() as f32; sizes.action])
                .entropy(),
            actor_adam: Adam::new(actor.parameter_count(), policy.learning_rate),
            log_std_adam: Adam::new(log_std.len(), policy.learning_rate),
            distribution,
            log_temperature: [settings.initial_temperature.ln()],
            temperature_adam: Adam::new(1, settings.temperature_learning_rate),
            entropy: 0.0,
            noise: [0, 1].map(|_| vec![0.0; settings.replay.batch_size * sizes.action]),
            critics_gradient: BatchGradient::new("the critics' loss", critics.parameter_count()),
            actor_gradient: BatchGradient::new(
                "the policy's loss",
                actor.parameter_count() + log_std.len() + 1,
            ),
            actor,
            log_std,
            critics,
        })
    }

    fn behavior_policy(&self) -> &Sac {
        self
    }

    fn start_from(&mut self, policy: &Policy) -> Result<(), TrainingError> {
        if policy.log_std().len() != self.log_std.len() {
            let name = |log_stds: usize| if log_stds == 0 { "squashed" } else { "a clipped Gaussian" };
            let expected = name(self.log_std.len());
            let found = name(policy.log_std().len());
            let expected = expected.to_string();
            let found = found.to_string();
            return Err(TrainingError::OtherPolicy { what: "distribution", expected, found });
        }
        self.actor = policy.network().clone();
        self.log_std = policy.log_std().to_vec();
        Ok(())
    }

    fn update(
        &mut self,
        batch: &TransitionBatch<f32>,
        seed: Seed,
        index: u64,
        learns_policy: bool,
    ) -> Result<(), &'static str> {
        let mut noise = std::mem::take(&mut self.noise);
        for (noise, child) in noise.iter_mut().zip(0..) {
            sample_noise(seed.child(child), index, batch.rows(), noise);
        }
        let trained = self.train_batch(batch, &noise, learns_policy);
        self.noise = noise;
        trained.map(|_| ())
    }

    fn entropy(&self) -> Option<f64> {
        Some(self.entropy)
    }

    fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.put("policy.parameters", self.actor.parameters().to_vec());
        checkpoint.put_adam("policy.adam", &self.actor_adam);
        if !self.log_std.is_empty() {
            checkpoint.put("policy.log_std", self.log_std.clone());
            checkpoint.put_adam("policy.log_std.adam", &self.log_std_adam);
        }
        self.critics.save(checkpoint);
        let adam = &self.temperature_adam;
        let first = adam.first_moments()[0];
        let second = adam.second_moments()[0];
        checkpoint.put("temperature", vec![self.log_temperature[0], first, second, self.entropy]);
        checkpoint.put("temperature.steps", vec![adam.steps()]);
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        let count = self.actor.parameter_count();
        let own = checkpoint.f32s("policy.parameters", count)?;
        self.actor.update(|parameters| parameters.copy_from_slice(own));
        self.actor_adam = checkpoint.adam("policy.adam", count)?;
        if !self.log_std.is_empty() {
            let count = self.log_std.len();
            self.log_std.copy_from_slice(checkpoint.f32s("policy.log_std", count)?);
            self.log_std_adam = checkpoint.adam("policy.log_std.adam", count)?;
        }
        self.critics.load(checkpoint)?;
        let temperature = checkpoint.f64s("temperature", 4)?;
        let steps = checkpoint.u64s("temperature.steps", 1)?[0];
        let rate = self.temperature_adam.learning_rate;
        let first = vec![temperature[1]];
        let second = vec![temperature[2]];
        self.temperature_adam = Adam::resume(rate, first, second, steps)?;
        self.log_temperature = [temperature[0]];
        self.entropy = temperature[3];
        Ok(())
    }
}
