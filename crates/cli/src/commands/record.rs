use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use mishandle::picture::CameraSettings;
use mishandle::record::{ArchiveSettings, RecordSettings};
use mishandle::{Plan, ResolvedPlan};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, control_flow};
use crate::show::progress::Bar;
use crate::show::{demonstrations, output};

/// Record demonstrations of a controller as a data set for imitation learning
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle record ball-balancing --controller expert --episodes 200 --out balancing
  mishandle record ball-balancing --controller expert --space starts+delay --successful --out delay
  mishandle record ball-balancing --controller expert --format npz --out arrays
  mishandle record ball-balancing --controller ppo --relabel expert --out dagger
  mishandle record ball-balancing --controller ppo --relabel expert --space starts+delay \\
    --archive better.harden/round-1/failures --out repair
  mishandle record ball-pushing --controller expert --cameras over,wrist --size 96x96 --out seen

The scenarios are the random ones of `mishandle evaluate` with the same target, space, seed and
number of episodes. Each control step is a frame: what the controller saw, and what it did before
noise and disturbances. The folder appears when it is complete.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    #[command(flatten)]
    pub simulator: flags::Simulator,
    /// Number of simulations [default: 100]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    pub episodes: Option<u64>,
    /// Format: lerobot (LeRobot data set, version 3.0) or npz (NumPy arrays in data.npz)
    #[arg(long, value_name = "NAME", default_value = "lerobot")]
    pub format: String,
    /// Record what this controller would do in each state, while --controller acts (DAgger):
    /// expert, another shipped controller, or a path
    #[arg(long, value_name = "NAME")]
    pub relabel: Option<String>,
    /// Draw a share of the scenarios from failures: those of a round of `harden`
    /// (round-N/failures), a run file, a counterexample, a folder of them, or a table (.csv)
    #[arg(long, value_name = "PATH")]
    pub archive: Option<PathBuf>,
    /// Share of the simulations with a scenario of the archive [default: 0.5]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, requires = "archive")]
    pub archive_share: Option<f64>,
    /// Record what these cameras see: over, wrist, or those of the target file
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub cameras: Vec<String>,
    /// Width and height of the images, pixels, each from 1 to 1024
    #[arg(long, value_name = "WxH", default_value = "64x64", requires = "cameras", value_parser = numbers::image_size)]
    pub size: [u16; 2],
    /// Keep only episodes that satisfy the success formula
    #[arg(long)]
    pub successful: bool,
    /// Folder of the data set; it must not exist
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
    #[command(flatten)]
    pub run: flags::Run,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let settings = RecordSettings {
        format: mishandle::record::format(&command.format)?,
        relabel: command.relabel.clone(),
        cameras: (!command.cameras.is_empty())
            .then(|| CameraSettings { names: command.cameras.clone(), size: command.size }),
        only_successful: command.successful,
        archive: command.archive.clone().map(|path| ArchiveSettings {
            path,
            share: command.archive_share.unwrap_or(ArchiveSettings::SHARE),
        }),
    };
    let mut planned =
        flags::planned("record", &command.subject, &command.run)?.simulator(&command.simulator)?;
    planned.number("--episodes", "evaluate.episodes", command.episodes)?;
    let resolved = ResolvedPlan::new(&planned.question("evaluate")?.0)?;
    let bar =
        Bar::new(resolved.plan.evaluate.as_ref().map_or(0, |evaluate| evaluate.episodes), "simulations");
    run::stop_on_signals(&bar)?;
    let mut done = 0;
    let found = mishandle::record::record(&resolved, &settings, &command.out, |simulations| {
        done = simulations;
        bar.set_position(simulations);
        control_flow()
    });
    bar.clear();
    let Some(found) = found? else {
        run::report_loss(done, "nothing is written");
        return Ok(ExitStatus::Interrupted);
    };
    if command.run.json {
        output::json(&found)?;
    } else {
        output::line(&demonstrations::text(&found))?;
    }
    Ok(ExitStatus::Done)
}
