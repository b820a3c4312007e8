//! A training run.

use std::collections::BTreeMap;
use std::path::PathBuf;

use mishandle_training::AxisSetting;

use super::declare::plan_table;
use super::keys::Within;
use super::{CPU, GuardPlan};

plan_table! {
    /// A training run: the table `[train]`, and the fields without keys, which other tables and
    /// flags state.
    pub struct TrainPlan in "train" {
        /// Name of the task, or path of a target file.
        #[serde(skip)]
        pub task: String = String::new();
        /// Scenario space of the episodes; overrides the settings.
        #[serde(skip)]
        pub space: Option<String> = None;
        /// Axes with a narrower range or a fixed value; each overrides that of the settings.
        #[serde(skip)]
        pub axes: BTreeMap<String, AxisSetting> = BTreeMap::new();
        /// Guard under which the policy trains: the actions of the environment are those that leave
        /// the guard.
        #[serde(skip)]
        pub guard: Option<GuardPlan> = None;
        /// Random seed.
        #[serde(skip)]
        pub seed: u64 = 0;
        /// Name of the algorithm. Empty, which training does not accept: that of `from`, or ppo.
        #[serde(skip_serializing_if = "String::is_empty")]
        pub algorithm: String = String::new(), "a string, such as \"ppo\"";
        /// Controller from which training starts instead of random weights: a path, or the name of
        /// a shipped one. Only the critic learns at first. Without settings, those by which it was
        /// trained are used.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub from: Option<String> = None, "a string: a controller, such as \"ppo\"";
        /// Total number of environment steps; overrides the settings.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub steps: Option<u64> = None, "an integer from 1 to 10^12" => Within<1, 1_000_000_000_000>;
        /// Name of the reward: `shaped` or `original`, or `file` for that of a target file. Empty,
        /// which training does not accept: `shaped`, or `file`.
        #[serde(skip_serializing_if = "String::is_empty")]
        pub reward: String = String::new(), "\"shaped\" or \"original\"";
        /// Device of the physics of the training episodes: `cpu` (MuJoCo C) or `gpu` (MuJoCo Warp).
        /// Validations always use MuJoCo C. The setting `episodes.environments` is the number of
        /// worlds.
        pub device: String = CPU.to_string(), "\"cpu\" or \"gpu\"";
        /// Settings file, or name of a settings base. `None` and `best` mean the shipped settings
        /// of task and algorithm, or the algorithm's defaults if none are shipped.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub settings: Option<PathBuf> = None, "a string: the path of a file, or \"skrl-0.10\" or \"best\"";
        /// File of the best controller; the last controller and the checkpoint are written beside
        /// it.
        #[serde(skip)]
        pub out: PathBuf = PathBuf::new();
        /// CSV file of the learning curve, one row per iteration.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub csv: Option<PathBuf> = None, "a string: the path of a file";
        /// Folder of the TensorBoard event files.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub tensorboard: Option<PathBuf> = None, "a string: the path of a folder";
        /// Whether to resume from the checkpoint.
        #[serde(skip)]
        pub resume: bool = false;
    }
}
