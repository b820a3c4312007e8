use mishandle_rollout::Seed;

use super::config::Td3Config;
use super::loss::{CriticLoss, CriticScratch, Smoothing};
use crate::agent::{Agent, weights};
use crate::batch::Batch;
use crate::batch_gradient::BatchGradient;
use crate::deterministic::{DeterministicActor, PolicyLoss, PolicyScratch};
use crate::off_policy::draw_rows;
use crate::twin_critics::TwinCritics;
use crate::{Checkpoint, TrainingError};

pub(crate) struct Td3 {
    tau: f64,
    pub actor: DeterministicActor,
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
        let Td3 { actor: DeterministicActor { followed: actor, .. }, critics, by_critics, by_actor, .. } =
            self;
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
    type Explorer = DeterministicActor;

    fn new(sizes: (usize, usize), config: &Td3Config, seed: Seed) -> Result<Td3, TrainingError> {
        let actor = DeterministicActor::new(sizes, &config.policy, config.exploration(), weights(seed, 0))?;
        let critics = TwinCritics::new(sizes, &config.critic, seed)?;
        Ok(Td3 {
            tau: config.tau,
            smoothing: Smoothing { std: config.smoothing_std, clip: config.smoothing_clip },
            policy_delay: config.policy_delay,
            draws: vec![0.0; config.replay.batch_rows * sizes.1],
            by_critics: BatchGradient::new("the critics' loss", critics.parameter_count()),
            by_actor: BatchGradient::new("the policy's loss", actor.followed.network.parameter_count()),
            actor,
            critics,
        })
    }

    fn explorer(&self) -> &DeterministicActor {
        &self.actor
    }

    fn update(&mut self, batch: &Batch<f32>, seed: Seed, index: u64) -> Result<(), &'static str> {
        let mut draws = std::mem::take(&mut self.draws);
        draw_rows(seed, index, batch.rows(), &mut draws);
        let told = self.learn(batch, &draws, index);
        self.draws = draws;
        told.map(|_| ())
    }

    fn save(&self, checkpoint: &mut Checkpoint) {
        self.actor.followed.save("policy", checkpoint);
        self.critics.save(checkpoint);
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.actor.followed.load("policy", checkpoint)?;
        self.critics.load(checkpoint)
    }
}
