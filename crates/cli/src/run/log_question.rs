//! Questions about logs: which formulas they meet.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use mishandle::stl::Formula;
use mishandle_logs::{Options, Source};

use super::logs::{self, Asked, ReadLog, Requirement};
use crate::flags::LogQuestion;

/// Returns the files of each log.
pub fn sources(question: &LogQuestion, paths: &[PathBuf]) -> Result<Vec<Vec<Source>>> {
    let sources = question.log.logs(paths)?;
    logs::check_stdin(&sources)?;
    Ok(sources)
}

/// Formulas that are asked of logs, and how these are read.
pub struct Requested {
    pub requirements: Vec<Requirement>,
    /// The formula of each requirement.
    pub formulas: Vec<Formula>,
    pub options: Options,
}

/// Parses the formulas of all flags; an error may have a hint about the first log.
pub fn requested(question: &LogQuestion, sources: &[Vec<Source>]) -> Result<Requested> {
    let requirements = requirements(question)?;
    let options = question.log.options();
    let formulas = logs::formulas(&requirements, &sources[0], &options)?;
    Ok(Requested { requirements, formulas, options })
}

/// Reads each log and gives its verdicts to `each`, in the order of the flags.
pub fn ask(
    question: &LogQuestion,
    sources: &[Vec<Source>],
    mut each: impl FnMut(&ReadLog, Vec<Asked>) -> Result<()>,
) -> Result<()> {
    let Requested { requirements, formulas, options } = requested(question, sources)?;
    for source in sources {
        let log = logs::read(source, &formulas, &options)?;
        let asked = requirements.iter().zip(&formulas).map(|(requirement, formula)| {
            let evaluation = requirement.evaluation(question.strict_horizon);
            let verdict = log.verdict(requirement, formula, &evaluation)?;
            Ok(Asked { formula: formula.clone(), units: requirement.units.clone(), evaluation, verdict })
        });
        let asked = asked.collect::<Result<_>>().with_context(|| format!("trace {}", log.name))?;
        each(&log, asked)?;
    }
    Ok(())
}

/// Returns the formulas of all flags.
fn requirements(question: &LogQuestion) -> Result<Vec<Requirement>> {
    let unit = question.unit.as_deref().map(|text| logs::time_unit(text, "--unit")).transpose()?;
    let plain = |name: Option<&String>, text: &String| Requirement {
        name: name.cloned(),
        text: text.clone(),
        is_error: true,
        unit,
        description: None,
        units: logs::Units::new(),
    };
    let mut found: Vec<Requirement> = question.formula.iter().map(|text| plain(None, text)).collect();
    found.extend(question.requirement.iter().map(|(name, text)| plain(Some(name), text)));
    if let Some(path) = &question.formulas {
        found.extend(logs::requirements(path, unit)?);
    }
    ensure!(
        !found.is_empty(),
        "there is no formula: give --formula FORMULA, --requirement NAME=FORMULA, or --formulas FILE"
    );
    Ok(found)
}
