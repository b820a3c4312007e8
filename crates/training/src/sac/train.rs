use mishandle_controllers::Policy;
use mishandle_network::{Adam, Mlp};
use mishandle_rollout::Seed;

use super::config::SacConfig;
use super::loss::{CriticLoss, CriticScratch, PolicyLoss, PolicyScratch, temperature_loss};
use crate::agent::{Agent, Explorer, weights};
use crate::batch::Batch;
use crate::batch_gradient::BatchGradient;
use crate::distribution::{Actor, Distribution};
use crate::drawn::CLIPPED_LOG_STD_RANGE;
use crate::gaussian::Deviations;
use crate::initialization::initial_network;
use crate::off_policy::draw_rows;
use crate::twin_critics::TwinCritics;
use crate::{Checkpoint, TrainingError};

pub(crate) struct Sac {
    tau: f64,
    hold: u64,
    /// H̄
    pub target_entropy: f64,
    distribution: Distribution,
    pub actor: Mlp<f32>,
    actor_adam: Adam<f32>,
    /// log σ of each action before it is kept in its range; none if the network gives it.
    pub log_std: Vec<f32>,
    log_std_adam: Adam<f32>,
    pub critics: TwinCritics,
    /// log α, alone in a vector for its optimiser.
    pub log_temperature: [f64; 1],
    temperature_adam: Adam<f64>,
    /// Of the last update.
    entropy: f64,
    /// z of the actions behind the returns, and of those that the policy learns from.
    draws: [Vec<f64>; 2],
    pub by_critics: BatchGradient<CriticScratch<f32>>,
    /// By the actor's network, then by log σ; then the mean of log π.
    pub by_actor: BatchGradient<PolicyScratch<f32>>,
}

impl Sac {
    /// One step of all networks and of the temperature, with z of both kinds; gives the losses of critics and policy.
    ///
    /// # Errors
    /// What is not finite.
    pub fn learn(&mut self, batch: &Batch<f32>, draws: &[Vec<f64>; 2]) -> Result<[f32; 2], &'static str> {
        let Sac { distribution, actor, log_std, critics, by_critics, by_actor, .. } = self;
        let policy = Actor { distribution: *distribution, network: actor, log_std };
        let temperature = self.log_temperature[0].exp();
        let loss = CriticLoss {
            batch,
            draws: &draws[0],
            temperature,
            actor: policy,
            critics: critics.networks(),
            target_critics: critics.targets(),
        };
        let (gradient, critic_loss) = by_critics
            .of(batch.rows(), |rows, scratch, gradient| loss.add_gradient(rows, scratch, gradient))?;
        critics.step(gradient);

        let loss =
            PolicyLoss { batch, draws: &draws[1], temperature, actor: policy, critics: critics.networks() };
        let log_stds_end = actor.parameter_count() + log_std.len();
        let (numbers, policy_loss) = by_actor.of(batch.rows(), |rows, scratch, numbers| {
            let (gradient, mean_log_prob_sum) = numbers.split_at_mut(log_stds_end);
            let (loss, mean_log_prob) = loss.add_gradient(rows, scratch, gradient);
            mean_log_prob_sum[0] += mean_log_prob as f32;
            loss
        })?;
        let (gradient, mean_log_prob) = numbers.split_at(log_stds_end);
        let (by_network, by_log_std) = gradient.split_at(actor.parameter_count());
        actor.update(|parameters| self.actor_adam.step(parameters, by_network));
        self.log_std_adam.step(log_std, by_log_std);

        let mean_log_prob = f64::from(mean_log_prob[0]);
        let (_, slope) = temperature_loss(self.log_temperature[0], mean_log_prob, self.target_entropy);
        self.temperature_adam.step(&mut self.log_temperature, &[slope]);
        self.entropy = -mean_log_prob;
        critics.follow(self.tau);
        Ok([critic_loss, policy_loss])
    }
}

impl Explorer for Sac {
    fn network(&self) -> &Mlp<f32> {
        &self.actor
    }

    fn hold(&self) -> u64 {
        self.hold
    }

    fn explore(&self, _row: usize, _rows: usize, outputs: &[f32], draws: &[f64], action: &mut [f32]) {
        let policy = Actor { distribution: self.distribution, network: &self.actor, log_std: &self.log_std };
        for (action, drawn) in action.iter_mut().zip(policy.drawn(outputs, draws)) {
            *action = drawn.action as f32;
        }
    }

    fn policy(&self, mean: Vec<f64>, variance: Vec<f64>) -> Result<Policy, TrainingError> {
        let actor = self.actor.clone();
        match self.distribution {
            Distribution::Squashed => Ok(Policy::squashed(mean, variance, actor)?),
            Distribution::Clipped => {
                let (low, high) = CLIPPED_LOG_STD_RANGE;
                let kept = self.log_std.iter().map(|x| x.clamp(low as f32, high as f32));
                Ok(Policy::new(mean, variance, actor, kept.collect())?)
            }
        }
    }
}

impl Agent for Sac {
    type Config = SacConfig;
    type Explorer = Sac;

    fn new(sizes: (usize, usize), config: &SacConfig, seed: Seed) -> Result<Sac, TrainingError> {
        let policy = &config.policy;
        let distribution = config.distribution;
        // A small last layer: the first actions are near the middle, with h near 0, whatever is seen.
        let actor = initial_network(
            (sizes.0, &policy.hidden, distribution.outputs(sizes.1)),
            policy.activation,
            policy.initialization,
            0.01,
            weights(seed, 0),
        )?;
        let mut log_std = vec![0.0; distribution.parameters(sizes.1)];
        policy.initialization.initialize_others(&mut log_std, weights(seed, 3));
        let critics = TwinCritics::new(sizes, &config.critic, seed)?;
        Ok(Sac {
            tau: config.tau,
            hold: config.exploration_hold,
            target_entropy: Deviations::new(&vec![config.target_std.ln() as f32; sizes.1]).entropy(),
            actor_adam: Adam::new(actor.parameter_count(), policy.learning_rate),
            log_std_adam: Adam::new(log_std.len(), policy.learning_rate),
            distribution,
            log_temperature: [config.initial_temperature.ln()],
            temperature_adam: Adam::new(1, config.temperature_learning_rate),
            entropy: 0.0,
            draws: [0, 1].map(|_| vec![0.0; config.replay.batch_rows * sizes.1]),
            by_critics: BatchGradient::new("the critics' loss", critics.parameter_count()),
            by_actor: BatchGradient::new("the policy's loss", actor.parameter_count() + log_std.len() + 1),
            actor,
            log_std,
            critics,
        })
    }

    fn explorer(&self) -> &Sac {
        self
    }

    fn update(&mut self, batch: &Batch<f32>, seed: Seed, index: u64) -> Result<(), &'static str> {
        let mut draws = std::mem::take(&mut self.draws);
        for (draws, child) in draws.iter_mut().zip(0..) {
            draw_rows(seed.child(child), index, batch.rows(), draws);
        }
        let told = self.learn(batch, &draws);
        self.draws = draws;
        told.map(|_| ())
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
        let (first, second) = (adam.first_moments()[0], adam.second_moments()[0]);
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
        let (rate, first, second) =
            (self.temperature_adam.learning_rate, vec![temperature[1]], vec![temperature[2]]);
        self.temperature_adam = Adam::resume(rate, first, second, steps)?;
        self.log_temperature = [temperature[0]];
        self.entropy = temperature[3];
        Ok(())
    }
}
