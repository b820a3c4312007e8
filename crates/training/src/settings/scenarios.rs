//! `[scenarios]`: the scenarios of training episodes.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::declare::settings;
use super::setting::{Constraint, FRACTION, constraint, kind, require};
use crate::TrainingError;

settings! {
    /// `[scenarios]`: the scenarios of the episodes. Without a space, only the starts are random.
    pub struct ScenarioSettings in "scenarios." {
        /// Scenario space from which episodes draw: the name of a space of the task, or several
        /// joined by `+`; or a mixture `{ "delay+sensing" = 3, events = 1 }` of spaces with
        /// weights, of which each episode draws one. Random starts always belong to it.
        pub space: Option<SpaceSetting> = None, MIXTURE;
        /// Share of the episodes without disturbances: only their starts are random.
        pub nominal: f64 = 0.0, FRACTION;
        /// Share of the episodes at corners of the space: each axis is at its lower or upper bound.
        pub corners: f64 = 0.0, FRACTION;
        /// Given scenarios: a table (`.csv`) with a column for each axis that it sets, and
        /// `weight`; or the failures of a run file, of a counterexample (`.json`) or of a folder of
        /// them. The other axes are nominal, and those of the start random.
        pub file: Option<String> = None;
        /// Share of the episodes with a scenario of the file.
        pub file_share: f64 = 0.0, FRACTION;
        /// Weights of the three validations in the choice of the best controller and in early
        /// stopping. A validation that does not exist has no weight.
        pub selection: SelectionWeights = SelectionWeights::default(), WEIGHTS;
        /// Curriculum: episodes draw from a share of the range of each axis around its nominal
        /// value, at first `start`. It grows by `step` up to 1, each time a validation over the
        /// present share has a success rate of at least `threshold`. Not set: the whole range.
        pub curriculum: Option<CurriculumSettings> = None, CURRICULUM;
        /// Axes with a narrower range or a fixed value. An axis outside of the space is added to
        /// it.
        #[serde(skip_serializing_if = "BTreeMap::is_empty")]
        pub axes: BTreeMap<String, AxisSetting> = BTreeMap::new();
    }
}

/// `scenarios.space`: a space, or a mixture of spaces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum SpaceSetting {
    /// Episodes draw values of all axes of this space.
    One(String),
    /// Episodes draw one of these spaces, with probabilities proportional to the weights, and
    /// values of its axes. The axes of the others are nominal.
    Mixture(BTreeMap<String, f64>),
}

impl SpaceSetting {
    /// Returns the name of the space that contains all axes.
    pub fn name(&self) -> String {
        match self {
            SpaceSetting::One(name) => name.clone(),
            SpaceSetting::Mixture(spaces) => spaces.keys().map(String::as_str).collect::<Vec<_>>().join("+"),
        }
    }
}

const MIXTURE: Constraint =
    constraint("the name of a space, or a table of names with weights above 0", |x| {
        !x.is_empty() && x.iter().all(|x| *x > 0.0 && x.is_finite())
    });

kind!(SpaceSetting, "a text or a table", x => match x {
    SpaceSetting::One(_) => None,
    SpaceSetting::Mixture(spaces) => Some(spaces.values().copied().collect()),
});

/// `scenarios.selection`: weights of the validations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SelectionWeights {
    /// Weight of random starts without disturbances.
    pub nominal: f64,
    /// Weight of random scenarios of the space.
    pub space: f64,
    /// Weight of corners of the space.
    pub corners: f64,
}

impl Default for SelectionWeights {
    fn default() -> SelectionWeights {
        SelectionWeights { nominal: 0.5, space: 0.5, corners: 0.0 }
    }
}

/// `scenarios.curriculum`: growth of the ranges from which episodes draw.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurriculumSettings {
    /// Share of the ranges at the start.
    pub start: f64,
    /// Growth of the share.
    pub step: f64,
    /// Success rate, on random scenarios within the share, at which it grows.
    pub threshold: f64,
}

impl CurriculumSettings {
    /// Returns the share after this number of growths.
    pub fn share(&self, growths: u64) -> f64 {
        let share = self.start + growths as f64 * self.step;
        // A sum of decimal numbers may be rounded down.
        if share > 1.0 - 1e-9 { 1.0 } else { share }
    }
}

const CURRICULUM: Constraint =
    constraint("{ start = A, step = B, threshold = C } with numbers from 0 to 1, B above 0", |x| {
        x.iter().all(|x| (0.0..=1.0).contains(x)) && x[1] > 0.0
    });

kind!(CurriculumSettings, "a table", x => Some(vec![x.start, x.step, x.threshold]));

const WEIGHTS: Constraint = constraint(
    "{ nominal = A, space = B, corners = C } with numbers of at least 0, one of them above 0",
    |x| x.iter().all(|x| *x >= 0.0 && x.is_finite()) && x.iter().any(|x| *x > 0.0),
);

kind!(SelectionWeights, "a table", x => Some(vec![x.nominal, x.space, x.corners]));
kind!(String, "a text", _x => None);
kind!(
    BTreeMap<String, AxisSetting>,
    "a table of numbers, categories, or ranges of two numbers, by the names of axes",
    _x => None
);

/// The setting of an axis: in the table `[axes]` of a plan, in `[scenarios.axes]` of training, and
/// by the flag `--axis`.
///
/// # Example
/// ```
/// use mishandle_training::{AlgorithmSettings, AxisSetting};
/// let text = "[scenarios.axes]\nball_x = [0.2, 0.3]\naction_delay = 2\n";
/// let settings = AlgorithmSettings::from_toml("ppo", text).unwrap()?;
/// assert_eq!(settings.scenarios().axes["ball_x"], AxisSetting::Range([0.2, 0.3]));
/// assert_eq!(settings.scenarios().axes["action_delay"], AxisSetting::Value(2.0));
/// # Ok::<(), mishandle_training::TrainingError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum AxisSetting {
    /// The axis has this value in every scenario.
    Value(f64),
    /// The values are between these bounds.
    Range([f64; 2]),
    /// The axis has the category with this name in every scenario, or the text is an
    /// [`Interval`](mishandle_rollout::Interval): `[0, 1)` excludes 1.
    Text(String),
}

impl ScenarioSettings {
    /// Returns whether episodes draw more than random starts.
    pub fn is_used(&self) -> bool {
        self.space.is_some() || !self.axes.is_empty() || self.file.is_some() || self.corners > 0.0
    }

    /// Checks that the shares fit each other.
    ///
    /// # Errors
    /// If their sum is above 1, or a share or a file has no counterpart.
    pub(crate) fn check_shares(&self) -> Result<(), TrainingError> {
        let sum = self.nominal + self.corners + self.file_share;
        let expected = "a share that leaves the sum with `scenarios.nominal` and `scenarios.file_share` \
                        at 1 or less";
        // The sum of shares that a user writes as decimal numbers may be rounded up.
        require("scenarios.corners", expected, self.corners, sum <= 1.0 + 1e-9)?;
        let expected = "above 0 if and only if `scenarios.file` names a file";
        require(
            "scenarios.file_share",
            expected,
            self.file_share,
            self.file.is_some() == (self.file_share > 0.0),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ALGORITHMS;

    #[test]
    fn a_table_is_read_and_written_by_every_algorithm() {
        let text = "[scenarios]\nspace = \"starts+delay\"\nnominal = 0.25\ncorners = 0.1\n\
                    [scenarios.axes]\naction_delay = [0, 2]\npush = 1\nkind = \"bias\"\n";
        for entry in ALGORITHMS {
            let settings = (entry.from_toml)(text).unwrap();
            let scenarios = settings.scenarios();
            assert_eq!(scenarios.space, Some(SpaceSetting::One("starts+delay".to_string())));
            assert_eq!(scenarios.nominal, 0.25);
            assert_eq!(scenarios.axes["action_delay"], AxisSetting::Range([0.0, 2.0]));
            assert_eq!(scenarios.axes["push"], AxisSetting::Value(1.0));
            assert_eq!(scenarios.axes["kind"], AxisSetting::Text("bias".to_string()));
            for written in [settings.to_toml(), settings.listing()] {
                assert_eq!((entry.from_toml)(&written).unwrap(), settings, "{}", entry.name);
            }
            assert!(!(entry.default)().scenarios().is_used());
        }
    }

    #[test]
    fn contradictory_shares_are_errors() {
        for (text, part) in [
            ("nominal = 0.6\ncorners = 0.5", "leaves the sum"),
            ("nominal = 1.1", "a number from 0 to 1"),
            ("corners = -0.1", "a number from 0 to 1"),
            ("nominal = nan", "a number from 0 to 1"),
            ("file_share = 0.1", "if and only if"),
            ("file = \"a.csv\"", "if and only if"),
            ("selection = { nominal = 0, space = 0, corners = 0 }", "above 0"),
            ("selection = { nominal = 1, space = nan, corners = 0 }", "at least 0"),
            ("curriculum = { start = 0.1, step = 0, threshold = 0.9 }", "B above 0"),
            ("curriculum = { start = 0.1, step = 0.1, threshold = 90 }", "from 0 to 1"),
            ("space = 3", "the name of a space, or a table of names"),
            ("axes = 3", "a table"),
        ] {
            for entry in ALGORITHMS {
                let error = (entry.from_toml)(&format!("[scenarios]\n{text}")).unwrap_err().to_string();
                assert!(error.contains(part), "{text}: {error}");
            }
        }
        let sum = "[scenarios]\nnominal = 0.7\ncorners = 0.2\nfile = \"a.csv\"\nfile_share = 0.1";
        assert!((ALGORITHMS[0].from_toml)(sum).is_ok(), "the rounded sum is above 1");
    }

    #[test]
    fn a_curriculum_grows_to_the_whole_range() {
        for entry in ALGORITHMS {
            let text = "scenarios.curriculum = { start = 0.1, step = 0.3, threshold = 0.9 }";
            let settings = (entry.from_toml)(text).unwrap();
            for written in [settings.to_toml(), settings.listing()] {
                assert_eq!((entry.from_toml)(&written).unwrap(), settings, "{}", entry.name);
            }
            let curriculum = settings.scenarios().curriculum.unwrap();
            assert_eq!([0, 1, 3, 4].map(|growths| curriculum.share(growths)), [0.1, 0.4, 1.0, 1.0]);
            assert_eq!((entry.default)().scenarios().curriculum, None);
        }
    }
}
