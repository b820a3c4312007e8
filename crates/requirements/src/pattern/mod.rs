//! Requirements with names: their formula with parameters, their words, and traces that show them.

mod page;
mod table;
mod templates;

use mishandle_results::{
    Choice, FormulaExample, Key, ParameterKind, PatternParameter, Remedy, RequirementPattern,
};
use mishandle_stl::{Formula, TimeUnit, nearest};

use crate::error::{RequirementError, Result};
use crate::lanes::draw_shown;
use crate::tree::Tree;

pub use page::page;

/// A parameter of a pattern.
#[derive(Clone, Copy, Debug)]
pub struct Slot {
    /// Name.
    pub name: &'static str,
    /// Kind of its value.
    pub kind: ParameterKind,
    /// Value if it is not set.
    pub default: Option<&'static str>,
    /// Meaning.
    pub meaning: &'static str,
}

/// Traces that show what a pattern requires, with samples 1 s apart.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// Values of the parameters.
    pub settings: &'static [(&'static str, &'static str)],
    /// Names of the signals.
    pub signals: &'static [&'static str],
    /// Values of each signal of a trace that satisfies the formula.
    pub satisfies: &'static [&'static [f64]],
    /// Values of each signal of one that violates it.
    pub violates: &'static [&'static [f64]],
}

/// A requirement with a name.
#[derive(Clone, Copy, Debug)]
pub struct Pattern {
    /// Name.
    pub name: &'static str,
    /// The requirement in a sentence, with its parameters in braces.
    pub words: &'static str,
    /// Formula, with its parameters in braces.
    pub formula: &'static str,
    /// Parameters.
    pub slots: &'static [Slot],
    /// Where it comes from.
    pub source: &'static str,
    /// Traces that show it.
    pub shown: Shown,
}

/// Patterns with a heading of the reference page and what they have in common.
struct Family {
    title: &'static str,
    text: &'static str,
    patterns: &'static [Pattern],
}

const FAMILIES: &[Family] = &[
    Family {
        title: "General",
        text: "A window ends with the trace, if not before: what is due in it must have come, and what lasts must \
               have held so far.",
        patterns: table::GENERAL,
    },
    templates::SCOPES,
    templates::EARS_TEMPLATES,
    templates::FRET_TEMPLATES,
];

/// Returns all patterns.
pub fn patterns() -> impl Iterator<Item = &'static Pattern> {
    FAMILIES.iter().flat_map(|family| family.patterns)
}

/// Returns the pattern with this name.
///
/// # Errors
/// If no pattern has it.
pub fn pattern(name: &str) -> Result<&'static Pattern> {
    patterns().find(|pattern| pattern.name == name).ok_or_else(|| {
        let known: Vec<&str> = patterns().map(|pattern| pattern.name).collect();
        let hint = nearest(name, known.iter().copied()).map_or_else(
            || format!("choose from: {}", known.join(", ")),
            |near| format!("did you mean `{near}`?"),
        );
        RequirementError::Question(format!("there is no pattern `{name}`; {hint}"))
    })
}

impl Pattern {
    /// Returns the formula and the words with these values of the parameters.
    ///
    /// # Errors
    /// If a parameter is unknown, set twice, not set and without a default, or its value is of
    /// another kind.
    ///
    /// # Example
    /// ```
    /// use mishandle_requirements::pattern;
    /// let set = |name: &str, value: &str| (name.to_owned(), value.to_owned());
    /// let settings = [set("p", "x >= 1"), set("q", "y <= 0.1"), set("deadline", "2s")];
    /// let (formula, words) = pattern("response").unwrap().fill(&settings).unwrap();
    /// assert_eq!(formula, "always(x >= 1 implies eventually[0s:2s](y <= 0.1))");
    /// assert_eq!(words, "Whenever x >= 1 holds, y <= 0.1 holds at some time from then to 2s later.");
    /// ```
    pub fn fill(&self, settings: &[(String, String)]) -> Result<(String, String)> {
        let question = |text: String| RequirementError::Question(text);
        for (index, (name, _)) in settings.iter().enumerate() {
            if !self.slots.iter().any(|slot| slot.name == name) {
                let known: Vec<&str> = self.slots.iter().map(|slot| slot.name).collect();
                return Err(question(format!(
                    "the pattern {} has no parameter `{name}`; it has {}",
                    self.name,
                    known.join(", ")
                )));
            }
            if settings[..index].iter().any(|(earlier, _)| earlier == name) {
                return Err(question(format!("the parameter `{name}` is set twice")));
            }
        }
        let mut formula = String::new();
        let mut words = String::new();
        let mut values = Vec::new();
        for slot in self.slots {
            let given = settings.iter().find(|(name, _)| name == slot.name);
            let text = given.map(|(_, value)| value.trim()).or(slot.default).ok_or_else(|| {
                let example = Choice::Text(slot.example().to_owned());
                RequirementError::Lacking {
                    fact: format!(
                        "the pattern {} needs the parameter `{}`, {}",
                        self.name, slot.name, slot.meaning
                    ),
                    remedy: Remedy::set(Key::PARAMETER, Choice::Of(slot.name.to_owned(), Box::new(example))),
                }
            })?;
            values.push((slot.name, slot.checked(text)?, text));
        }
        for (template, to, has_formula) in
            [(self.formula, &mut formula, true), (self.words, &mut words, false)]
        {
            // A value may have braces of its own, so that each one is replaced where it stands.
            let mut rest = template;
            while let Some((before, after)) = rest.split_once('{') {
                to.push_str(before);
                let (name, after) = after.split_once('}').unwrap_or((after, ""));
                if let Some((_, inside, text)) = values.iter().find(|(known, ..)| *known == name) {
                    to.push_str(if has_formula { inside } else { text });
                }
                rest = after;
            }
            to.push_str(rest);
        }
        Ok((Formula::parse(&formula)?.to_string(), words))
    }

    /// Returns what the formula with the settings of [`Pattern::shown`] says about its two traces.
    ///
    /// # Errors
    /// If the formula cannot be evaluated on them.
    pub fn examples(&self) -> Result<Vec<FormulaExample>> {
        let (formula, _) = self.fill(&self.shown_settings())?;
        draw_shown(&Formula::parse(&formula)?, &self.shown)
    }

    /// Returns the settings of [`Pattern::shown`].
    pub fn shown_settings(&self) -> Vec<(String, String)> {
        self.shown.settings.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect()
    }

    /// Returns the pattern as a document.
    pub fn result(&self) -> RequirementPattern {
        let parameter = |slot: &Slot| PatternParameter {
            name: slot.name.to_owned(),
            kind: slot.kind,
            default: slot.default.map(str::to_owned),
            meaning: slot.meaning.to_owned(),
        };
        RequirementPattern {
            name: self.name.to_owned(),
            summary: self.words.to_owned(),
            formula: self.formula.to_owned(),
            parameters: self.slots.iter().map(parameter).collect(),
            source: self.source.to_owned(),
        }
    }
}

impl Slot {
    fn example(&self) -> &'static str {
        match self.kind {
            ParameterKind::Condition => "x >= 1",
            ParameterKind::Signal => "x",
            ParameterKind::Number => "20",
            ParameterKind::Time => "2s",
        }
    }

    /// Returns the text as it stands in a formula, in parentheses if it has an operator.
    fn checked(&self, text: &str) -> Result<String> {
        let wrong = |expected: &str| {
            RequirementError::Question(format!(
                "the parameter `{}` is `{text}`; it must be {expected}, such as {}",
                self.name,
                self.example()
            ))
        };
        match self.kind {
            ParameterKind::Number => match text.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(text.to_owned()),
                _ => Err(wrong("a number")),
            },
            ParameterKind::Time => {
                let units = TimeUnit::ALL.map(TimeUnit::symbol);
                // `ms` before `s`.
                let unit = units.iter().filter(|unit| text.ends_with(**unit)).max_by_key(|unit| unit.len());
                let number = unit.map_or(text, |unit| &text[..text.len() - unit.len()]).trim();
                match number.parse::<f64>() {
                    Ok(value) if value.is_finite() && value >= 0.0 => {
                        Ok(format!("{number}{}", unit.copied().unwrap_or_default()))
                    }
                    _ => Err(wrong("a time with a unit (s, ms, us, ns), or a number of samples")),
                }
            }
            ParameterKind::Condition | ParameterKind::Signal => {
                let parsed = Formula::parse(text).map_err(|error| {
                    RequirementError::Question(format!("the parameter `{}` is `{text}`: {error}", self.name))
                })?;
                let tree = Tree::new(&parsed);
                let root = tree.nodes.len() - 1;
                let operator = tree.operator(root);
                if self.kind == ParameterKind::Signal && operator.is_some() && !tree.nodes[root].is_term {
                    return Err(wrong("a signal, or arithmetic with signals"));
                }
                // The printed text has no comments and no statements.
                let text = parsed.to_string();
                Ok(if operator.is_some() { format!("({text})") } else { text })
            }
        }
    }
}
