//! Settings of the check of requirements.

use mishandle_results::Severity;

use super::declare::plan_table;
use super::keys::{self, Within};
use super::{DEFAULT_BATCH_SIZE, FalsifyPlan};

plan_table! {
    /// How the requirements of a file are checked: the table `[check]`.
    pub struct CheckSettings in "check" {
        /// Number of random scenarios. `None`: as the requirement says, or 100.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub episodes: Option<u64> = None, keys::EPISODES => Within<1, 1_000_000_000>;
        /// Number of searches for each requirement. `None`: as the requirement says, or 1.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub trials: Option<u32> = None, keys::BUDGET => Within<1, 1_000_000>;
        /// Largest number of simulations of a search. `None`: as the requirement says, or 300.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub budget: Option<u32> = None, keys::BUDGET => Within<1, 1_000_000>;
        /// Name of the search.
        pub search: String = FalsifyPlan::default().search, "a string, such as \"nelder-mead\"";
        /// Batch size: number of simulations run at once.
        pub batch: u32 = DEFAULT_BATCH_SIZE as u32, keys::BATCH => Within<1, 65_536>;
        /// Least severity of a violation that fails.
        pub fail_on: Severity = Severity::Error, "\"critical\", \"error\" or \"warning\"";
        /// Accept requirements whose signals the target lacks. Without it, they are an error.
        pub allow_inapplicable: bool = false, keys::BOOLEAN;
    }
}
