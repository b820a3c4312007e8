//! Runs a random share of the units of collected results again.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::ResolvedPlan;
use mishandle::build::build;
use mishandle::rollout::Seed;
use mishandle_studies::paper::{Results, SampledUnit};
use mishandle_text::plural;
use rayon::prelude::*;
use serde::Serialize;

use super::named_commit;
use crate::command::{interrupt, message, print};

#[derive(Debug, Args)]
pub struct Verify {
    /// Folder of collected results
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Share of the units of each campaign to run again, at least one of each
    #[arg(long, value_name = "SHARE", default_value = "0.01", allow_negative_numbers = true, value_parser = share)]
    share: f64,
    /// Seed that chooses the units
    #[arg(long, value_name = "N", default_value = "0")]
    seed: u64,
    /// Run the units also if this program is of another commit than the digests
    #[arg(long)]
    any_commit: bool,
    /// If all units agree, name the commit of this program in the manifest
    #[arg(long, requires = "any_commit")]
    record: bool,
    /// Print one JSON document to stdout
    #[arg(long)]
    json: bool,
}

/// Parses a share of the units.
fn share(text: &str) -> Result<f64, String> {
    let share = text.parse().ok().filter(|share| *share > 0.0 && *share <= 1.0);
    share.ok_or_else(|| "expected a number above 0, up to 1".to_string())
}

/// Units of collected results, run again.
#[derive(Debug, Serialize)]
struct Verification {
    /// Commit at which the digests hold, from the manifest.
    commit: Option<String>,
    /// Commit of this program.
    program: String,
    share: f64,
    /// Seed that chose the units, as text: JSON numbers lose digits above 2⁵³ in most readers.
    seed: String,
    /// Number of units of the results.
    all_units: u64,
    /// Number of units that agree.
    agreeing: u64,
    /// The units that were run again.
    units: Vec<VerifiedUnit>,
}

/// A unit that was run again: a trial of a falsification, or a hundred simulations of an
/// evaluation.
#[derive(Debug, Serialize)]
struct VerifiedUnit {
    campaign: String,
    run: String,
    trial: u32,
    /// Number of the first simulation.
    first: u32,
    /// Number of simulations, as recorded.
    simulations: u32,
    /// Whether the rows have the recorded digest, and all counts are the same.
    agrees: bool,
    /// Each difference as text: name, recorded value, value of the new simulations.
    differences: Vec<String>,
}

pub fn run(command: &Verify) -> Result<ExitCode> {
    let folder = &command.folder;
    ensure!(
        Results::is_in(folder),
        "{} has no manifest.json of collected results; `studies reproduce collect` makes it",
        folder.display()
    );
    let mut results = Results::read(folder)?;
    let program = build().git_commit;
    check_commit(&results, &program, command)?;
    ensure!(
        !command.record || named_commit(&program).is_some(),
        "the commit of this program, {program}, does not name its sources; commit them and build again"
    );
    let sampled = results.sample(command.share, Seed(command.seed));
    ensure!(!sampled.is_empty(), "{} has no unit to run again", folder.display());
    interrupt::listen()?;
    let done = AtomicU64::new(0);
    let verified = sampled.par_iter().map(|unit| {
        if interrupt::requested() {
            return Ok(None);
        }
        let found = verify(unit, command.any_commit).with_context(|| name(unit))?;
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        message(&format!("{done} of {}: {}", sampled.len(), name(unit)));
        Ok(Some(found))
    });
    let verified: Vec<Option<VerifiedUnit>> = verified.collect::<Result<_>>()?;
    let units: Vec<VerifiedUnit> = verified.into_iter().flatten().collect();
    let is_interrupted = units.len() < sampled.len();
    let found = Verification {
        commit: results.commit.clone(),
        program: program.clone(),
        share: command.share,
        seed: command.seed.to_string(),
        all_units: results.campaigns.iter().flat_map(|c| &c.runs).map(|run| run.units.len() as u64).sum(),
        agreeing: units.iter().filter(|unit| unit.agrees).count() as u64,
        units,
    };
    show(&found, command.json)?;
    let verified = plural(found.units.len() as u64, "unit");
    if is_interrupted {
        message(&format!("interrupted; {verified} finished"));
        return Ok(ExitCode::from(interrupt::EXIT_CODE));
    }
    let differing = found.units.len() as u64 - found.agreeing;
    ensure!(differing == 0, "{differing} of {verified} differ from the results");
    if command.record {
        results.commit = Some(program);
        results.write_manifest(folder)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Refuses a program of another commit than that of the digests.
fn check_commit(results: &Results, program: &str, command: &Verify) -> Result<()> {
    let problem = match &results.commit {
        Some(commit) if commit == program => return Ok(()),
        Some(commit) => {
            format!("the digests hold at commit {commit}, and this program is of commit {program}")
        }
        None => "the manifest names no commit at which all digests hold".to_string(),
    };
    if command.any_commit {
        message(&format!("{problem}; --any-commit runs the units anyway"));
        return Ok(());
    }
    match &results.commit {
        Some(commit) => bail!("{problem}; build commit {commit}, or give --any-commit"),
        None => bail!("{problem}; give --any-commit"),
    }
}

/// Runs a unit again and compares it.
fn verify(sampled: &SampledUnit<'_>, any_commit: bool) -> Result<VerifiedUnit> {
    let SampledUnit { campaign, run, unit } = sampled;
    let resolved = ResolvedPlan::new(&run.plan)?;
    let facts = run.differences(&resolved);
    ensure!(any_commit || facts.is_empty(), "recorded by another program:\n  {}", facts.join("\n  "));
    let differences = match unit.run_again(&resolved)? {
        Some(again) => unit.differences(&again),
        None => vec!["the plan has no such unit".to_string()],
    };
    let agrees = differences.is_empty();
    // Other facts explain a difference. Alone, they are none.
    let facts = if agrees { Vec::new() } else { facts };
    Ok(VerifiedUnit {
        campaign: campaign.name.clone(),
        run: run.facts.name.clone(),
        trial: unit.trial,
        first: unit.first,
        simulations: unit.simulations,
        agrees,
        differences: differences.into_iter().chain(facts).collect(),
    })
}

fn name(sampled: &SampledUnit<'_>) -> String {
    let SampledUnit { campaign, run, unit } = sampled;
    format!("{}/{}, trial {}, simulation {}", campaign.name, run.facts.name, unit.trial, unit.first)
}

fn show(found: &Verification, as_json: bool) -> Result<()> {
    if as_json {
        return print(&serde_json::to_string_pretty(found)?);
    }
    let line = |unit: &VerifiedUnit| {
        let VerifiedUnit { campaign, run, trial, first, simulations, .. } = unit;
        let last = first.saturating_add(*simulations).saturating_sub(1);
        let result = if unit.agrees {
            "agrees".to_string()
        } else {
            format!("differs: {}", unit.differences.join("; "))
        };
        format!("{campaign}/{run}, trial {trial}, simulations {first} to {last}: {result}")
    };
    let simulations: u64 = found.units.iter().map(|unit| u64::from(unit.simulations)).sum();
    let summary = format!(
        "\n{} of {} ({}) agree to the bit. Seed {} chose them from {}.",
        found.agreeing,
        plural(found.units.len() as u64, "unit"),
        plural(simulations, "simulation"),
        found.seed,
        plural(found.all_units, "unit"),
    );
    print(&found.units.iter().map(line).chain([summary]).collect::<Vec<_>>().join("\n"))
}
