use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use mishandle::evaluation::SizeSettings;
use mishandle::inspect::{Expected, SizeQuestion, sample_size};
use mishandle::plan::Until;
use mishandle::random::Seed;

use crate::exit_status::ExitStatus;
use crate::flags;
use crate::flags::numbers::{integer, number};
use crate::run;
use crate::show::{output, size};

const RATE: &str = "a rate from 0 to 1, such as 0.95";

fn is_rate(rate: f64) -> bool {
    (0.0..=1.0).contains(&rate)
}

/// Show how many simulations an evaluation or a comparison takes, before any of them
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle size --expect 0.97 --until width=0.04
  mishandle size --expect 0.97 --until decided --rate 0.95
  mishandle size --expect 0.90 --against 0.94 --until decided
  mishandle size --pilot old.sqlite new.sqlite --until decided --margin 0.02

It simulates no target: the number that is fixed beforehand is computed, and the rule that stops by
itself is simulated on random verdicts. A number that is fixed beforehand is enough with a
probability of 90 %: the usual test decides, or the usual interval is as narrow as asked.")]
pub struct Arguments {
    /// Expected success rate; in a comparison, that of A
    #[arg(long, value_name = "RATE", value_parser = number(RATE, is_rate), required_unless_present = "pilot")]
    pub expect: Option<f64>,
    /// Expected success rate of B: asks about pairs
    #[arg(long, value_name = "RATE", value_parser = number(RATE, is_rate), requires = "expect")]
    pub against: Option<f64>,
    /// Expected share of pairs in which both succeed [default: the product of both rates, which
    /// takes the most pairs]
    #[arg(long, value_name = "SHARE", value_parser = number(RATE, is_rate), requires = "against")]
    pub both: Option<f64>,
    /// Run file of an evaluation that shows what to expect, or two of them for pairs
    #[arg(long, value_name = "RUN", num_args = 1..=2, conflicts_with = "expect")]
    pub pilot: Vec<PathBuf>,
    /// The rule: decided, or width=W
    #[arg(long, value_name = "RULE", default_value = "decided")]
    pub until: Until,
    /// The success rate that decided decides about, such as 0.95
    #[arg(long, value_name = "R", value_parser = number(RATE, is_rate))]
    pub rate: Option<f64>,
    /// The largest difference that counts as none, such as 0.02
    #[arg(long, value_name = "D", value_parser = number("a number above 0", |margin| margin > 0.0 && margin.is_finite()))]
    pub margin: Option<f64>,
    /// Largest number of simulations, or of pairs
    #[arg(long, value_name = "N", default_value = "10000", value_parser = integer::<u64>(1..=SizeSettings::LARGEST))]
    pub episodes: u64,
    /// Number of simulations, or of pairs, between two looks
    #[arg(long, value_name = "N", default_value = "64", value_parser = integer::<u64>(mishandle::Plan::BATCH))]
    pub batch: u64,
    /// Number of replications of the rule
    #[arg(long, value_name = "N", default_value = "1000", value_parser = integer::<u64>(1..=100_000))]
    pub replications: u64,
    /// Random seed of the replications, from 0 to 2^64 - 1
    #[arg(long, value_name = "N", default_value = "0", value_parser = integer::<u64>(flags::SEEDS))]
    pub seed: u64,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let expected = match (command.expect, command.against, &command.pilot[..]) {
        (Some(first), Some(second), _) => match command.both {
            Some(both) => Expected::Pairs([both, first - both, second - both, 1.0 - first - second + both]),
            None => Expected::independent(first, second),
        },
        (Some(rate), None, _) => Expected::Rate(rate),
        (None, _, [one]) => Expected::of_run(&run::read(one, false)?)?,
        (None, _, [first, second]) => {
            Expected::of_pairs(&run::read(first, false)?, &run::read(second, false)?)?
        }
        _ => bail!("give --expect RATE, or --pilot RUN"),
    };
    if !command.pilot.is_empty()
        && let Some(warning) = expected.warning()
    {
        output::message(&format!("warning: {warning}"));
    }
    let Arguments { until, rate, margin, .. } = *command;
    let settings = SizeSettings {
        max: command.episodes,
        batch: command.batch,
        replications: command.replications,
        seed: Seed(command.seed),
    };
    let found = sample_size(&SizeQuestion { expected, until, rate, margin }, settings)?;
    if command.json {
        output::json(&found)?;
    } else {
        output::line(&size::text(&found))?;
    }
    Ok(ExitStatus::Done)
}
