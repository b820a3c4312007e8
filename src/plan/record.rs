//! Settings of demonstrations.

use std::path::PathBuf;

use super::declare::plan_table;
use super::keys::{self, ImageSize, Share};

plan_table! {
    /// How demonstrations are recorded, besides the evaluation whose scenarios they have: the table
    /// `[record]`.
    pub struct RecordSettings in "record" {
        /// Format of the data set: `lerobot` (LeRobot data set, version 3.0) or `npz` (NumPy arrays
        /// in data.npz).
        pub format: String = "lerobot".to_string(), "\"lerobot\" or \"npz\"";
        /// Controller whose action in each state is the action of the data set, by its name or its
        /// path, while the plan's controller acts (DAgger). `None`: the action of the controller
        /// that acts.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub relabel: Option<String> = None, "a string: a controller, such as \"expert\"";
        /// Cameras whose images are recorded. Empty: no images.
        pub camera: Vec<String> = Vec::new(), "a list of strings, such as [\"over\", \"wrist\"]";
        /// Width and height of the images, pixels.
        pub size: [u16; 2] = [64, 64], "two integers from 1 to 1024, such as [64, 64]" => ImageSize;
        /// Failures whose scenarios replace some of the random ones: the folder of the failures of
        /// a hardening's round, a table of scenarios, a run file, a counterexample, or a folder of
        /// counterexamples. `None`: all scenarios are random.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub archive: Option<PathBuf> = None, "a string: the path of a file or of a folder";
        /// Share of the simulations with a scenario of the archive.
        pub archive_share: f64 = 0.5, keys::SHARE => Share;
        /// Keep only episodes that satisfy the success formula.
        pub successful: bool = false, keys::BOOLEAN;
    }
}
