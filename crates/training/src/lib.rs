//! Training algorithms: environments in, controllers out.
//!
//! An algorithm is a folder and a line in the list [`ALGORITHMS`]. The modules:
//!
//! - `on_policy`: [`ppo`] and [`trpo`], and what both use: [`RolloutBuffer`], [`gae`], [`Critic`],
//!   minibatches;
//! - `off_policy`: [`sac`], [`td3`] and [`ddpg`], and what they use: [`replay_buffer`],
//!   action-value critics with target networks, the [`deterministic`] policy;
//! - `settings`: declaration, reading and bases of settings;
//! - `episodes`: parallel environments that restart their [`Episodes`] automatically;
//! - `privileged`: inputs of critics that the policy does not see;
//! - `learner`: the training loop, progress reports to an [`Observer`], validation, curriculum, and
//!   selection of the best policy;
//! - `checkpoint`: the state of a training run as a file;
//! - `parity`: tests that compare single updates with those of skrl.
//!
//! Training runs on the threads of the current rayon pool. The same environment, settings and seed
//! give the same controller, bit for bit, for any number of threads, resumed or not.

mod algorithm;
mod checkpoint;
mod episodes;
mod error;
pub mod gaussian;
mod inference;
mod initialization;
mod learner;
mod off_policy;
mod on_policy;
#[cfg(test)]
mod parity;
mod privileged;
mod registry;
mod settings;

pub use algorithm::AlgorithmSettings;
pub use checkpoint::{Checkpoint, CheckpointArray};
pub use episodes::{Boundary, EpisodeStatistics, Episodes, ScenarioDraw, ScenarioOrigin};
pub use error::TrainingError;
pub use initialization::Initialization;
pub use learner::origin::Origin;
pub use learner::progress::{
    Observer, PartValidation, Rates, TimeShares, TrainingControl, TrainingProgress, TrainingResult,
    Validation, format_duration,
};
pub use learner::selection::{BestPolicy, PolicySelection};
pub use off_policy::settings::{
    ActorSettings, ExplorationDecay, QCriticSettings, ReplayBufferSettings, UpdateUnit,
};
pub use off_policy::{ddpg, deterministic, replay_buffer, sac, td3};
pub use on_policy::critic::{Critic, value_loss};
pub use on_policy::minibatches::{MinibatchScheme, shuffle};
pub use on_policy::rollout_buffer::RolloutBuffer;
pub use on_policy::settings::{CriticSettings, ObservationMoments, PolicySettings, ValueMoments};
pub use on_policy::trpo::conjugate_gradient::conjugate_gradient;
pub use on_policy::{gae, ppo, trpo};
pub use registry::{ALGORITHMS, AlgorithmEntry};
pub use settings::{
    AxisSetting, BASES, BEST, Choice, CurriculumSettings, EpisodeSettings, RewardSettings, RunSettings,
    ScenarioSettings, SelectionWeights, Setting, SpaceSetting, TimeoutHandling, TomlSettings,
};
