//! How many simulations an evaluation or a comparison takes, before any of them.

use std::path::Path;

use anyhow::{Result, bail};
use mishandle::evaluation::SizeSettings;
use mishandle::inspect::{Expected, SizeQuestion, sample_size};
use mishandle::plan::Until;
use mishandle::random::Seed;

use super::{ExitStatus, read};
use crate::flags::Planned;
use crate::show::{output, size};

/// Largest number of simulations without `--episodes`.
const EPISODES: u64 = 10_000;

/// Parses an expected success rate, or the path of a run that shows it.
pub fn expected(text: &str) -> Result<Expectation, String> {
    match text.parse::<f64>() {
        Ok(rate) if (0.0..=1.0).contains(&rate) => Ok(Expectation::Rate(rate)),
        Ok(_) => Err("expected a rate from 0 to 1, such as 0.95, or a run file".to_string()),
        Err(_) => Ok(Expectation::Run(text.to_string())),
    }
}

/// Expectation about one evaluation.
#[derive(Clone, Debug)]
pub enum Expectation {
    /// A success rate.
    Rate(f64),
    /// Path of a run that shows what to expect.
    Run(String),
}

/// Prints how many simulations an evaluation with one expectation takes, or how many pairs a
/// comparison with two.
pub fn show(expectations: &[Expectation], planned: Planned, as_json: bool) -> Result<ExitStatus> {
    let max = if planned.has("evaluate", "episodes") { None } else { Some(EPISODES) };
    let (plan, settings) = planned.without_target()?;
    let evaluate = plan.evaluate.unwrap_or_default();
    let chosen = settings.size;
    let open = |path: &String| read(Path::new(path), settings.engine.skip_check);
    let expected = match expectations {
        [Expectation::Rate(rate)] => Expected::Rate(*rate),
        [Expectation::Run(run)] => Expected::of_run(&open(run)?)?,
        [Expectation::Rate(first), Expectation::Rate(second)] => match chosen.both {
            Some(both) => Expected::Pairs([both, first - both, second - both, 1.0 - first - second + both]),
            None => Expected::independent(*first, *second),
        },
        [Expectation::Run(first), Expectation::Run(second)] => {
            Expected::of_pairs(&open(first)?, &open(second)?)?
        }
        _ => bail!("--expect has one value for each evaluation: two rates, or two run files"),
    };
    if matches!(expectations[0], Expectation::Run(_))
        && let Some(warning) = expected.warning()
    {
        output::message(&format!("warning: {warning}"));
    }
    let sizes = SizeSettings {
        max: max.unwrap_or(evaluate.episodes),
        batch: chosen.batch,
        replications: chosen.replications,
        seed: Seed(plan.seed),
    };
    let (until, margin) = match plan.compare {
        Some(compare) if expectations.len() == 2 => (Some(compare.until), compare.margin),
        _ => (evaluate.until, None),
    };
    let rate = if expectations.len() == 2 { None } else { evaluate.rate };
    let question = SizeQuestion { expected, until: until.unwrap_or(Until::Decided), rate, margin };
    let found = sample_size(&question, sizes)?;
    if as_json {
        output::json(&found)?;
    } else {
        output::line(&size::text(&found))?;
    }
    Ok(ExitStatus::Done)
}
