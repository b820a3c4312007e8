//! Settings of relations between pairs of scenarios.

use std::collections::BTreeMap;

use mishandle_falsification::{MetamorphicSettings, OutputRelation};
use serde::{Deserialize, Serialize};

use super::declare::plan_table;
use super::keys;

plan_table! {
    /// Settings of relations between pairs of scenarios: the table `[metamorphic]` of a plan.
    pub struct MetamorphicPlan in "metamorphic" {
        /// Requirement: the name of a formula of the target, or the text of a formula. `None`
        /// selects the target's first formula.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub formula: Option<String> = None, keys::FORMULA;
        /// Number of source cases.
        pub pairs: u64 = MetamorphicSettings::DEFAULT_PAIRS, "an integer from 1 to 1000000";
        /// Batch size: number of simulations run at once. Results do not depend on it.
        pub batch: u32 = mishandle_rollout::DEFAULT_BATCH_SIZE as u32, keys::BATCH;
        /// The relations by name: the tables `[metamorphic.relations.NAME]`.
        #[serde(skip_serializing_if = "BTreeMap::is_empty")]
        pub relations: BTreeMap<String, RelationPlan> = BTreeMap::new(),
            "a table of relations, as [metamorphic.relations.NAME]" => toml::Table;
    }
}

/// A metamorphic relation, in names and texts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct RelationPlan {
    /// The relation of the two results, such as `same-verdict` or `not-worse:0.05`.
    pub holds: String,
    /// The changes of axes by name, such as `+0.02`, `*0.8` or `=0.3`.
    pub change: BTreeMap<String, String>,
}

impl Default for RelationPlan {
    fn default() -> Self {
        RelationPlan { holds: OutputRelation::SameVerdict.to_string(), change: BTreeMap::new() }
    }
}
