use mishandle_controllers::Policy;
use mishandle_rollout::Seed;

use super::loss::{CriticLoss, CriticScratch, TargetSmoothing};
use super::settings::Td3Settings;
use crate::off_policy::action_value::Sizes;
use crate::off_policy::agent::{Agent, weight_seed};
use crate::off_policy::batch_gradient::BatchGradient;
use crate::off_policy::deterministic::{DeterministicActor, PolicyLoss, PolicyScratch};
use crate::off_policy::sample_noise;
use crate::off_policy::transitions::TransitionBatch;
use crate::off_policy::twin_critics::TwinCritics;
use crate::{Checkpoint, TrainingError};

pub(crate) struct Td3 {
    tau: f64,
    pub actor: DeterministicActor,
    pub critics: TwinCritics,
    smoothing: TargetSmoothing,
    policy_delay: u64,
    noise: Vec<f64>,
    pub critics_gradient: BatchGradient<CriticScratch<f32>>,
    pub actor_gradient: BatchGradient<PolicyScratch<f32>>,
}

impl Td3 {
    /// Performs update `index` with the smoothing noise z; returns the losses of the critics and of
    /// the policy, if this update includes the policy.
    ///
    /// # Errors
    /// If a loss is NaN or infinite; returns its name.
    pub fn train_batch(
        &mut self,
        batch: &TransitionBatch<f32>,
        noise: &[f64],
        index: u64,
        learns_policy: bool,
    ) -> Result<(f32, Option<f32>), &'static str> {
        let Td3 {
            actor: DeterministicActor { policy: actor, .. },
            critics,
            critics_gradient,
            actor_gradient,
            ..
        } = self;
        let loss = CriticLoss {
            batch,
            noise,
            smoothing: self.smoothing,
            target_actor: &actor.target,
            critics: critics.networks(),
            target_critics: critics.targets(),
        };
        let (gradient, critic_loss) = critics_gradient
            .compute(batch.rows(), |rows, scratch, gradient| loss.add_gradient(rows, scratch, gradient))?;
        critics.step(gradient);
        if !(index + 1).is_multiple_of(self.policy_delay) {
            return Ok((critic_loss, None));
        }
        if !learns_policy {
            critics.soft_update(self.tau);
            return Ok((critic_loss, None));
        }

        let loss = PolicyLoss { batch, actor: &actor.network, critic: critics.networks()[0] };
        let (gradient, policy_loss) = actor_gradient
            .compute(batch.rows(), |rows, scratch, gradient| loss.add_gradient(rows, scratch, gradient))?;
        actor.step(gradient);

        critics.soft_update(self.tau);
        actor.soft_update(self.tau);
        Ok((critic_loss, Some(policy_loss)))
    }
}

impl Agent for Td3 {
    type Settings = Td3Settings;
    type BehaviorPolicy = DeterministicActor;

    fn new(sizes: Sizes, settings: &Td3Settings, seed: Seed) -> Result<Td3, TrainingError> {
        let actor =
            DeterministicActor::new(sizes, &settings.policy, settings.exploration(), weight_seed(seed, 0))?;
        let critics = TwinCritics::new(sizes, &settings.critic, seed)?;
        Ok(Td3 {
            tau: settings.tau,
            smoothing: TargetSmoothing { std: settings.smoothing_std, clip: settings.smoothing_clip },
            policy_delay: settings.policy_delay,
            noise: vec![0.0; settings.replay.batch_size * sizes.action],
            critics_gradient: BatchGradient::new("the critics' loss", critics.parameter_count()),
            actor_gradient: BatchGradient::new("the policy's loss", actor.policy.network.parameter_count()),
            actor,
            critics,
        })
    }

    fn behavior_policy(&self) -> &DeterministicActor {
        &self.actor
    }

    fn start_from(&mut self, policy: &Policy) -> Result<(), TrainingError> {
        self.actor.start_from(policy);
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
        sample_noise(seed, index, batch.rows(), &mut noise);
        let trained = self.train_batch(batch, &noise, index, learns_policy);
        self.noise = noise;
        trained.map(|_| ())
    }

    fn save(&self, checkpoint: &mut Checkpoint) {
        self.actor.policy.save("policy", checkpoint);
        self.critics.save(checkpoint);
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.actor.policy.load("policy", checkpoint)?;
        self.critics.load(checkpoint)
    }
}
