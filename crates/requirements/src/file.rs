//! Files of requirements: identifiers, formulas, and the clauses of standards that ask for them.

use std::collections::BTreeMap;

use mishandle_results::Severity;
use mishandle_stl::{Formula, TimeUnit};
use serde::Deserialize;

use crate::error::{RequirementError, Result};

/// A file of requirements. Logs and targets read the same file.
///
/// # Example
/// ```
/// use mishandle_requirements::RequirementFile;
/// use mishandle_results::Severity;
/// let file = RequirementFile::from_toml(
///     r#"
///     [[requirement]]
///     name = "gentle"
///     formula = "always(force <= 20)"
///     clause = "ISO 10218-2:2025"
///     "#,
/// )
/// .unwrap();
/// assert_eq!(file.requirements[0].severity, Severity::Error);
/// assert_eq!(file.requirements[0].clauses, ["ISO 10218-2:2025"]);
/// assert!(RequirementFile::from_toml("[[requirement]]\nname = \"a\"\nfomula = \"x >= 0\"").is_err());
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct RequirementFile {
    /// Title of the reports about it.
    pub title: Option<String>,
    /// Note for the readers of the reports.
    pub notice: Option<String>,
    /// The requirements, in the order of the file.
    pub requirements: Vec<WrittenRequirement>,
    /// Units by the names of signals.
    pub units: BTreeMap<String, String>,
}

/// A requirement as a file states it. Its formula is not parsed yet: it can be the name of a
/// formula of a target.
#[derive(Clone, Debug, PartialEq)]
pub struct WrittenRequirement {
    /// Identifier.
    pub name: String,
    /// The requirement in words.
    pub text: Option<String>,
    /// The formula.
    pub formula: String,
    /// Severity of a violation.
    pub severity: Severity,
    /// Clauses of standards that ask for it.
    pub clauses: Vec<String>,
    /// Where the numbers of the formula come from.
    pub source: Option<String>,
    /// The unit of bounds without one; `None`: they count samples.
    pub unit: Option<TimeUnit>,
    /// How it is checked on a target.
    pub check: CheckRequest,
}

/// How a requirement is checked on a target. What is `None` has the value of the whole check.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CheckRequest {
    /// Scenario space.
    pub space: Option<String>,
    /// Number of random scenarios.
    pub episodes: Option<u64>,
    /// Number of searches for a counterexample.
    pub trials: Option<u32>,
    /// Largest number of simulations of each search.
    pub budget: Option<u32>,
    /// Largest failure rate. With it, random scenarios decide, and a single violation does not.
    pub max_failure_rate: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    title: Option<String>,
    notice: Option<String>,
    #[serde(default)]
    requirement: Vec<Entry>,
    #[serde(default)]
    units: BTreeMap<String, String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct Entry {
    name: String,
    #[serde(alias = "description")]
    text: Option<String>,
    formula: String,
    #[serde(default)]
    severity: Severity,
    #[serde(default)]
    clause: Clauses,
    source: Option<String>,
    unit: Option<String>,
    space: Option<String>,
    episodes: Option<u64>,
    trials: Option<u32>,
    budget: Option<u32>,
    max_failure_rate: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "expected a text or an array of texts")]
enum Clauses {
    One(String),
    Several(Vec<String>),
}

impl Default for Clauses {
    fn default() -> Clauses {
        Clauses::Several(Vec::new())
    }
}

impl RequirementFile {
    /// Parses a file.
    ///
    /// # Errors
    /// If the text is not TOML, has an unknown key or no requirement, two requirements have the
    /// same name, or a value is invalid.
    pub fn from_toml(text: &str) -> Result<RequirementFile> {
        let file: File = toml::from_str(text)
            .map_err(|error| RequirementError::Question(error.to_string().trim_end().to_string()))?;
        if file.requirement.is_empty() {
            return Err(RequirementError::Question("the file has no [[requirement]]".to_string()));
        }
        let mut requirements: Vec<WrittenRequirement> = Vec::new();
        for entry in file.requirement {
            let name = entry.name.clone();
            if requirements.iter().any(|known| known.name == name) {
                return Err(RequirementError::Question(format!("two requirements are named `{name}`")));
            }
            let found = entry.read();
            let with_name = |problem| RequirementError::Question(format!("requirement `{name}`: {problem}"));
            requirements.push(found.map_err(with_name)?);
        }
        Ok(RequirementFile { title: file.title, notice: file.notice, requirements, units: file.units })
    }
}

impl Entry {
    fn read(self) -> std::result::Result<WrittenRequirement, String> {
        let unit = self.unit.as_deref().map(|text| {
            time_unit(text).ok_or_else(|| {
                let known = TimeUnit::ALL.map(TimeUnit::symbol).join(", ");
                format!("unit is `{text}`; it must be one of {known}")
            })
        });
        let is_rate = |rate: f64| rate > 0.0 && rate < 1.0;
        if let Some(rate) = self.max_failure_rate.filter(|rate| !is_rate(*rate)) {
            return Err(format!(
                "max-failure-rate is {rate}; it must be above 0 and below 1: simulations cannot show that a rate is 0, and no \
                 rate is above 1"
            ));
        }
        if self.max_failure_rate.is_some() && (self.trials.is_some() || self.budget.is_some()) {
            let searches = "trials and budget are those of a search for one counterexample";
            return Err(format!(
                "{searches}; leave them out with max-failure-rate, which random scenarios decide"
            ));
        }
        Ok(WrittenRequirement {
            name: self.name,
            text: self.text,
            formula: self.formula,
            severity: self.severity,
            clauses: match self.clause {
                Clauses::One(clause) => vec![clause],
                Clauses::Several(clauses) => clauses,
            },
            source: self.source,
            unit: unit.transpose()?,
            check: CheckRequest {
                space: self.space,
                episodes: self.episodes,
                trials: self.trials,
                budget: self.budget,
                max_failure_rate: self.max_failure_rate,
            },
        })
    }
}

impl WrittenRequirement {
    /// Returns the formula as text in which all bounds have their unit; the name of a formula of a
    /// target stays as it is.
    pub fn timed_formula(&self) -> String {
        match (Formula::parse(&self.formula), self.unit) {
            (Ok(formula), Some(unit)) => formula.with_unit(unit).to_string(),
            _ => self.formula.clone(),
        }
    }
}

/// Returns the unit with a symbol, such as `ms`.
pub fn time_unit(symbol: &str) -> Option<TimeUnit> {
    TimeUnit::ALL.into_iter().find(|unit| unit.symbol() == symbol)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(keys: &str) -> Result<WrittenRequirement> {
        let text = format!("[[requirement]]\nname = \"a\"\nformula = \"always[0:0.5](x >= 0)\"\n{keys}");
        RequirementFile::from_toml(&text).map(|mut file| file.requirements.remove(0))
    }

    #[test]
    fn a_description_is_the_text_and_a_clause_can_be_several() {
        let found = read("description = \"words\"\nclause = [\"A 1\", \"B 2\"]").expect("valid");
        assert_eq!(found.text.as_deref(), Some("words"));
        assert_eq!(found.clauses, ["A 1", "B 2"]);
    }

    #[test]
    fn bounds_get_the_unit_of_the_requirement() {
        assert_eq!(read("unit = \"s\"").expect("valid").timed_formula(), "always[0s:0.5s](x >= 0)");
        assert_eq!(read("").expect("valid").timed_formula(), "always[0:0.5](x >= 0)");
    }

    #[test]
    fn mistakes_name_the_requirement_and_what_is_allowed() {
        for (keys, expected) in [
            ("unit = \"min\"", "requirement `a`: unit is `min`; it must be one of s, ms, us, ns"),
            ("max-failure-rate = 0.0", "above 0"),
            ("max-failure-rate = 1", "max-failure-rate is 1; it must be above 0 and below 1"),
            ("max-failure-rate = nan", "above 0"),
            ("max-failure-rate = 0.1\nbudget = 5", "leave them out"),
            ("severity = \"fatal\"", "critical"),
            ("clause = 5", "expected a text or an array of texts"),
            ("id = \"b\"", "unknown field `id`"),
        ] {
            let error = read(keys).expect_err(keys).to_string();
            assert!(error.contains(expected), "{keys}: {error}");
        }
    }
}
