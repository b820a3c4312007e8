//! Training algorithms: environments in, controllers out.
//!
//! An algorithm is a folder and a line in the list [`ALGORITHMS`]: its settings, its loss, what it does in an iteration. What algorithms share stands beside them: rows of
//! never-ending [`Episodes`], the choice of the best policy, checkpoints, and what an [`Observer`] is told; for [`ppo`]
//! and [`trpo`] a rollout's [`Buffer`], [`gae`], a [`gaussian`] policy and a [`Critic`]; for [`sac`], [`td3`] and
//! [`ddpg`] a [`replay`], critics of actions, and a [`drawn`] or [`deterministic`] action.
//!
//! Everything runs on the threads of the current rayon pool. The same environment, settings and seed give the same
//! controller to the bit for any number of threads, resumed or not.

mod acting;
mod action_value;
mod actor_critic;
mod agent;
mod algorithm;
mod batch;
mod batch_gradient;
mod buffer;
mod checkpoint;
mod conjugate_gradient;
mod critic;
pub mod ddpg;
mod declare;
pub mod deterministic;
mod distribution;
pub mod drawn;
mod episodes;
mod error;
pub mod gae;
pub mod gaussian;
mod initialization;
mod learner;
mod listing;
mod memory;
mod minibatches;
mod off_policy;
mod off_policy_config;
mod off_policy_settings;
mod on_policy;
mod on_policy_settings;
pub mod ppo;
mod presets;
mod progress;
mod reading;
mod registry;
pub mod replay;
pub mod sac;
mod selection;
mod setting;
mod settings;
#[cfg(test)]
mod skrl_on_policy;
#[cfg(test)]
mod skrl_updates;
pub mod td3;
pub mod trpo;
mod twin_critics;

pub use algorithm::Config;
pub use buffer::{Buffer, shuffle};
pub use checkpoint::{Checkpoint, Numbers};
pub use conjugate_gradient::conjugate_gradient;
pub use critic::{Critic, value_loss};
pub use episodes::{Boundary, EpisodeStatistics, Episodes};
pub use error::TrainingError;
pub use initialization::Initialization;
pub use memory::MemoryNeed;
pub use minibatches::Division;
pub use off_policy_settings::{
    ActionValueSettings, ActorSettings, ExplorationDecay, ReplaySettings, UpdateCount,
};
pub use on_policy_settings::{CriticSettings, ObservationMoments, PolicySettings, ValueMoments};
pub use presets::{BEST, PRESETS};
pub use progress::{Flow, Observer, Progress, Shares, Trained, Validation, clock};
pub use registry::{ALGORITHMS, AlgorithmEntry};
pub use selection::{Best, Selection};
pub use setting::{Choice, Setting};
pub use settings::{EpisodeSettings, RunSettings, Settings, TimeLimits};
