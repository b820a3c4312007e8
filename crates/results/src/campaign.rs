use serde::Serialize;

use crate::Answer;

/// A grid of runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Campaign {
    /// Path of the folder.
    pub folder: String,
    /// Whether all runs are complete; `false` after an interruption, exit code 130.
    pub is_complete: bool,
    /// The finished runs.
    pub runs: Vec<CampaignRun>,
}

/// A finished run of a campaign.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CampaignRun {
    /// Name of the run, and of its file, or of the folder of its hardening, without extension.
    pub name: String,
    /// Kind of the run: `evaluate`, `falsify`, `margin`, `metamorphic`, `risk` or `harden`.
    pub kind: String,
    /// The result. The command of that name, if there is one, prints it with `schema`.
    pub result: Answer,
}
