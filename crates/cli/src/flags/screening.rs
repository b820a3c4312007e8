//! Whether a device screens the simulations.

use anyhow::{Result, ensure};
use clap::Args;
use mishandle::plan::ScreeningPlan;

use super::numbers::integer;

/// Flags of screening.
#[derive(Debug, Args)]
pub struct Screening {
    /// Screen the simulations first: gpu (thousands of worlds of MuJoCo Warp on a GPU; MuJoCo C
    /// repeats the flagged simulations and an audit sample of the rest, and only these count), or
    /// none [default: none]
    #[arg(long, value_name = "DEVICE", conflicts_with = "resume")]
    pub screening: Option<Screener>,
    /// With --screening gpu: number of worlds on the GPU [default: 16384]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(1..=1_048_576))]
    #[arg(conflicts_with = "resume")]
    pub rows: Option<u32>,
    /// With --screening gpu: share of the simulations that are not flagged in the audit sample,
    /// above 0 and up to 1 [default: 0.1]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, value_parser = share, conflicts_with = "resume")]
    pub confirm: Option<f64>,
}

impl Screening {
    /// Returns the screening of a plan with the values of the flags.
    pub fn plan(&self, planned: Option<ScreeningPlan>) -> Result<Option<ScreeningPlan>> {
        let planned = match self.screening {
            None => planned,
            Some(Screener::None) => None,
            Some(Screener::Gpu) => Some(planned.unwrap_or_default()),
        };
        ensure!(
            planned.is_some() || (self.rows.is_none() && self.confirm.is_none()),
            "--rows and --confirm need --screening gpu"
        );
        Ok(planned.map(|planned| ScreeningPlan {
            rows: self.rows.unwrap_or(planned.rows),
            confirm: self.confirm.unwrap_or(planned.confirm),
            ..planned
        }))
    }
}

/// Device that screens the simulations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Screener {
    /// Nothing: MuJoCo C runs each simulation
    None,
    /// MuJoCo Warp on an NVIDIA GPU
    Gpu,
}

/// Parses a share above 0.
fn share(text: &str) -> Result<f64, String> {
    let number: Option<f64> = text.parse().ok();
    let expected = || "expected a number above 0 and up to 1, such as 0.1".to_string();
    number.filter(|share| *share > 0.0 && *share <= 1.0).ok_or_else(expected)
}
