use serde::Serialize;

use crate::Subject;

/// A data set of recorded episodes.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Demonstrations {
    /// Target, controller that acts, space and seed.
    #[serde(flatten)]
    pub subject: Subject,
    /// Folder of the data set.
    pub folder: String,
    /// Its format: `lerobot` or `npz`.
    pub format: String,
    /// Controller whose action in each state is recorded, by its name or its path; `null` if it is
    /// the one that acts.
    pub relabel: Option<String>,
    /// Failures from which scenarios were drawn: the path of a file or folder; left out without
    /// them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub archive: Option<String>,
    /// Number of simulations with a scenario of the archive.
    pub archived: u64,
    /// Number of simulations.
    pub simulations: u64,
    /// Number of episodes in the data set.
    pub episodes: u64,
    /// Number of frames of all episodes: one per control step.
    pub frames: u64,
    /// Number of episodes that satisfy the success formula.
    pub successes: u64,
    /// Number of simulations that are not in the data set: without a control step, or without
    /// success if only successful episodes are kept.
    pub left_out: u64,
    /// Size of all files, bytes.
    pub bytes: u64,
}
