//! Whether a device screens the simulations.

use anyhow::{Result, ensure};
use clap::Args;

use super::numbers::integer;

/// Flags of screening.
#[derive(Debug, Args)]
pub struct Screening {
    /// Screen the simulations first: gpu (thousands of worlds of MuJoCo Warp on a GPU; MuJoCo C repeats the flagged
    /// simulations and an audit sample of the others, and only these count), or none [default: none]
    #[arg(long, value_name = "DEVICE")]
    pub screening: Option<Screener>,
    /// With --screening gpu: number of worlds on the GPU [default: 16384]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(1..=1_048_576))]
    pub rows: Option<u32>,
    /// With --screening gpu: share of the simulations that are not flagged in the audit sample, above 0 and up to 1
    /// [default: 0.1]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, value_parser = share)]
    pub confirm: Option<f64>,
}

impl Screening {
    /// Returns whether a GPU screens the simulations.
    pub fn is_gpu(&self) -> bool {
        self.screening == Some(Screener::Gpu)
    }

    /// Returns the number of worlds.
    pub fn rows(&self) -> u32 {
        self.rows.unwrap_or(16_384)
    }

    /// Returns the share of the audit sample.
    pub fn confirm(&self) -> f64 {
        self.confirm.unwrap_or(0.1)
    }

    /// Checks that no flag is without effect.
    pub fn check(&self) -> Result<()> {
        ensure!(
            self.is_gpu() || (self.rows.is_none() && self.confirm.is_none()),
            "--rows and --confirm need --screening gpu"
        );
        Ok(())
    }
}

/// What screens the simulations.
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
