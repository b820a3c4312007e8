//! `mishandle reproduce verify`: runs a random share of the units of collected results again.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::ResolvedPlan;
use mishandle::build::build;
use mishandle::results::{self, Verification, VerifiedUnit};
use mishandle::rollout::Seed;
use mishandle_paper::{Results, SampledUnit};
use mishandle_text::plural;
use rayon::prelude::*;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::interrupt;
use crate::run::{self, tables};
use crate::show::output;
use crate::show::progress::Bar;

#[derive(Debug, Args)]
pub struct Verify {
    /// Folder of collected results
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Share of the units of each campaign to run again, at least one of each
    #[arg(long, value_name = "SHARE", default_value = "0.01", allow_negative_numbers = true, value_parser = numbers::number("a number above 0, up to 1", |share| share > 0.0 && share <= 1.0))]
    pub share: f64,
    /// Seed that chooses the units
    #[arg(long, value_name = "N", default_value = "0", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(flags::SEEDS))]
    pub seed: u64,
    /// Run the units also if this program is of another commit than the digests
    #[arg(long)]
    pub any_commit: bool,
    /// If all units agree, name the commit of this program in the manifest
    #[arg(long, requires = "any_commit")]
    pub record: bool,
    /// Number of threads; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    pub threads: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

pub fn run(command: &Verify) -> Result<ExitStatus> {
    run::set_threads(command.threads)?;
    let folder = &command.folder;
    ensure!(
        Results::is_in(folder),
        "{} has no manifest.json of collected results; `mishandle reproduce collect` makes it",
        folder.display()
    );
    let mut results = Results::read(folder).map_err(tables::converted)?;
    let program = build().git_commit;
    check_commit(&results, &program, command)?;
    ensure!(
        !command.record || tables::named_commit(&program).is_some(),
        "the commit of this program, {program}, does not name its sources; commit them and build again"
    );
    let sampled = results.sample(command.share, Seed(command.seed));
    ensure!(!sampled.is_empty(), "{} has no unit to run again", folder.display());
    let bar = Bar::new(sampled.len() as u64, "units");
    run::stop_on_signals(&bar)?;
    let done = AtomicU64::new(0);
    let verified = sampled.par_iter().map(|sampled| {
        if interrupt::requested() {
            return Ok(None);
        }
        let found = verify(sampled, command.any_commit).with_context(|| name(sampled))?;
        bar.set_position(done.fetch_add(1, Ordering::Relaxed) + 1);
        Ok(Some(found))
    });
    let verified: Vec<Option<VerifiedUnit>> = verified.collect::<Result<_>>()?;
    bar.clear();
    let units: Vec<VerifiedUnit> = verified.into_iter().flatten().collect();
    let is_interrupted = units.len() < sampled.len();
    let found = Verification {
        commit: results.commit.clone(),
        program: program.clone(),
        share: command.share,
        seed: results::Seed(command.seed),
        all_units: results.campaigns.iter().flat_map(|c| &c.runs).map(|run| run.units.len() as u64).sum(),
        agreeing: units.iter().filter(|unit| unit.agrees).count() as u64,
        units,
    };
    show(&found, command.json)?;
    if is_interrupted {
        output::message(&format!("interrupted; {} finished", plural(found.units.len() as u64, "unit")));
        return Ok(ExitStatus::Interrupted);
    }
    let differing = found.units.len() as u64 - found.agreeing;
    ensure!(
        differing == 0,
        "{} of {} differ from the results",
        differing,
        plural(found.units.len() as u64, "unit")
    );
    if command.record {
        results.commit = Some(program);
        results.write_manifest(folder).map_err(tables::converted)?;
    }
    Ok(ExitStatus::Done)
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
        output::message(&format!("{problem}; --any-commit runs the units anyway"));
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
    let differences = match unit.run_again(&resolved).map_err(tables::converted)? {
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
        return output::json(found);
    }
    let header = ["run", "trial", "simulations", "result"].map(String::from).to_vec();
    let row = |unit: &VerifiedUnit| {
        let VerifiedUnit { campaign, run, trial, first, simulations, .. } = unit;
        let last = first.saturating_add(*simulations).saturating_sub(1);
        vec![
            format!("{campaign}/{run}"),
            trial.to_string(),
            format!("{first} to {last}"),
            if unit.agrees {
                "agrees".to_string()
            } else {
                format!("differs: {}", unit.differences.join("; "))
            },
        ]
    };
    let rows: Vec<Vec<String>> = std::iter::once(header).chain(found.units.iter().map(row)).collect();
    output::line(&output::table(&rows))?;
    let simulations: u64 = found.units.iter().map(|unit| u64::from(unit.simulations)).sum();
    output::line(&format!(
        "\n{} of {} ({}) agree to the bit. Seed {} chose them from {}.",
        found.agreeing,
        plural(found.units.len() as u64, "unit"),
        plural(simulations, "simulation"),
        found.seed.0,
        plural(found.all_units, "unit"),
    ))
}
