use mishandle_controllers::Policy;
use mishandle_network::Mlp;
use mishandle_rollout::Seed;

use super::config::Td3Config;
use super::loss::{CriticLoss, CriticScratch, Smoothing};
use crate::action_value::Followed;
use crate::agent::{Agent, weights};
use crate::batch::Batch;
use crate::batch_gradient::BatchGradient;
use crate::deterministic::{self, Exploration, PolicyLoss, PolicyScratch};
use crate::off_policy::draw_rows;
use crate::twin_critics::TwinCritics;
use crate::{Checkpoint, ExplorationDecay, TrainingError};

pub(crate) struct Td3 {
    tau: f64,
    exploration: Exploration,
    pub actor: Followed,
    pub critics: TwinCritics,
    smoothing: Smoothing,
    policy_delay: u64,
    draws: Vec<f64>,
    pub by_critics: BatchGradient<CriticScratch<f32>>,
    pub by_actor: BatchGradient<PolicyScratch<f32>>,
}

impl Td3 {
    /// The update numbered `index`, with z of the smoothing; gives the losses of critics and policy, if it had its turn.
    ///
    /// # Errors
    /// What is not finite.
    pub fn learn(
        &mut self,
        batch: &Batch<f32>,
        draws: &[f64],
        index: u64,
    ) -> Result<(f32, Option<f32>), &'static str> {
        let Td3 { actor, critics, by_critics, by_actor, .. } = self;
        let loss = CriticLoss {
            batch,
            draws,
            smoothing: self.smoothing,
            target_actor: &actor.target,
            critics: critics.networks(),
            target_critics: critics.targets(),
        };
        let (gradient, critic_loss) = by_critics
            .of(batch.rows(), |rows, scratch, gradient| loss.add_gradient(rows, scratch, gradient))?;
        critics.step(gradient);
        if !(index + 1).is_multiple_of(self.policy_delay) {
            return Ok((critic_loss, None));
        }

        let loss = PolicyLoss { batch, actor: &actor.network, critic: critics.networks()[0] };
        let (gradient, policy_loss) = by_actor
            .of(batch.rows(), |rows, scratch, gradient| loss.add_gradient(rows, scratch, gradient))?;
        actor.step(gradient);

        critics.follow(self.tau);
        actor.follow(self.tau);
        Ok((critic_loss, Some(policy_loss)))
    }
}

impl Agent for Td3 {
    type Config = Td3Config;

    fn new(sizes: (usize, usize), config: &Td3Config, seed: Seed) -> Result<Td3, TrainingError> {
        let actor = deterministic::actor(sizes, &config.policy, weights(seed, 0))?;
        let critics = TwinCritics::new(sizes, &config.critic, seed)?;
        Ok(Td3 {
            tau: config.tau,
            exploration: config.exploration(),
            smoothing: Smoothing { std: config.smoothing_std, clip: config.smoothing_clip },
            policy_delay: config.policy_delay,
            draws: vec![0.0; config.replay.batch_rows * sizes.1],
            by_critics: BatchGradient::new("the critics' loss", critics.parameter_count()),
            by_actor: BatchGradient::new("the policy's loss", actor.network.parameter_count()),
            actor,
            critics,
        })
    }

    fn actor(&self) -> &Mlp<f32> {
        &self.actor.network
    }

    fn hold(&self) -> u64 {
        self.exploration.hold
    }

    fn decay(&self) -> Option<ExplorationDecay> {
        self.exploration.decay
    }

    fn explore(&self, row: usize, rows: usize, outputs: &[f32], draws: &[f64], action: &mut [f32]) {
        self.exploration.explore(row, rows, outputs, draws, action);
    }

    fn update(&mut self, batch: &Batch<f32>, seed: Seed, index: u64) -> Result<(), &'static str> {
        let mut draws = std::mem::take(&mut self.draws);
        draw_rows(seed, index, batch.rows(), &mut draws);
        let told = self.learn(batch, &draws, index);
        self.draws = draws;
        told.map(|_| ())
    }

    fn policy(&self, mean: Vec<f64>, variance: Vec<f64>) -> Result<Policy, TrainingError> {
        self.exploration.policy(&self.actor.network, mean, variance)
    }

    fn save(&self, checkpoint: &mut Checkpoint) {
        self.actor.save("policy", checkpoint);
        self.critics.save(checkpoint);
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.actor.load("policy", checkpoint)?;
        self.critics.load(checkpoint)
    }
}
