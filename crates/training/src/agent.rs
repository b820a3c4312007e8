//! What an off-policy algorithm has of its own.

use mishandle_controllers::Policy;
use mishandle_network::Mlp;
use mishandle_rollout::Seed;

use crate::batch::Batch;
use crate::{
    ActionValueSettings, ActorSettings, Checkpoint, EpisodeSettings, ExplorationDecay, ReplaySettings,
    RunSettings, TrainingError,
};

/// The child that the weights of network `index` are drawn from.
pub(crate) fn weights(seed: Seed, index: u64) -> Seed {
    seed.child(16 + index)
}

/// What acts while it learns.
pub(crate) trait Explorer: Sync {
    /// The network that is acted with.
    fn network(&self) -> &Mlp<f32>;

    /// For how many control steps a row keeps the random numbers that it explores with.
    fn hold(&self) -> u64;

    /// How these numbers fall in the beginning, if they do.
    fn decay(&self) -> Option<ExplorationDecay> {
        None
    }

    /// The action that row `row` of `rows` explores with: from the network's outputs and standard normal numbers.
    fn explore(&self, row: usize, rows: usize, outputs: &[f32], draws: &[f64], action: &mut [f32]);

    /// The policy so far, for observations of these moments.
    ///
    /// # Errors
    /// If weights are not finite.
    fn policy(&self, mean: Vec<f64>, variance: Vec<f64>) -> Result<Policy, TrainingError>;
}

/// What learns from batches.
pub(crate) trait Agent: Sized + 'static {
    /// Its settings.
    type Config: Shared;

    /// What acts.
    type Explorer: Explorer;

    /// The networks before anything is learned, for observations and actions of these sizes.
    ///
    /// # Errors
    /// If networks of these sizes cannot be made.
    fn new(sizes: (usize, usize), config: &Self::Config, seed: Seed) -> Result<Self, TrainingError>;

    /// What acts, as it is now.
    fn explorer(&self) -> &Self::Explorer;

    /// One update from a batch; `index` counts them, and `seed` is for random numbers of its own.
    ///
    /// # Errors
    /// What is not finite.
    fn update(&mut self, batch: &Batch<f32>, seed: Seed, index: u64) -> Result<(), &'static str>;

    /// Entropy of the policy in the last update, if it has one.
    fn entropy(&self) -> Option<f64> {
        None
    }

    /// Puts all that its future depends on into a checkpoint.
    fn save(&self, checkpoint: &mut Checkpoint);

    /// Goes on where a checkpoint was taken.
    ///
    /// # Errors
    /// If the checkpoint holds networks of other sizes.
    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError>;
}

/// Settings of an off-policy algorithm.
pub(crate) trait Shared {
    /// Those that it shares with the others.
    fn setup(&self) -> Setup<'_>;
}

/// Settings that an off-policy algorithm shares with the others.
pub(crate) struct Setup<'a> {
    pub gamma: f64,
    pub steps_per_iteration: usize,
    pub run: &'a RunSettings,
    pub episodes: &'a EpisodeSettings,
    pub replay: &'a ReplaySettings,
    pub policy: &'a ActorSettings,
    pub critic: &'a ActionValueSettings,
}
