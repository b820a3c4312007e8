//! Where simulations are screened.

use anyhow::{Result, ensure};
use clap::Args;

use super::numbers::integer;

/// Where simulations are screened.
#[derive(Debug, Args)]
pub struct Screen {
    /// Physics engine of the simulations: cpu (MuJoCo C), or gpu (MuJoCo Warp; MuJoCo C repeats every violation and a random
    /// sample of the others, and only these count) [default: cpu]
    #[arg(long, value_name = "NAME")]
    pub backend: Option<Backend>,
    /// With --backend gpu: number of worlds on the GPU [default: 16384]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(1..=1_048_576))]
    pub rows: Option<u32>,
    /// With --backend gpu: share of the simulations without a violation that MuJoCo C repeats, above 0 and up to 1
    /// [default: 0.1]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, value_parser = share)]
    pub confirm: Option<f64>,
}

impl Screen {
    /// Returns whether a GPU screens the simulations.
    pub fn is_gpu(&self) -> bool {
        self.backend == Some(Backend::Gpu)
    }

    /// Returns the number of worlds.
    pub fn rows(&self) -> u32 {
        self.rows.unwrap_or(16_384)
    }

    /// Returns the share of the simulations without a violation that MuJoCo C repeats.
    pub fn confirm(&self) -> f64 {
        self.confirm.unwrap_or(0.1)
    }

    /// Checks that no flag is without effect.
    pub fn check(&self) -> Result<()> {
        ensure!(
            self.is_gpu() || (self.rows.is_none() && self.confirm.is_none()),
            "--rows and --confirm need --backend gpu"
        );
        Ok(())
    }
}

/// Physics engine of the simulations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Backend {
    /// MuJoCo C
    Cpu,
    /// MuJoCo Warp
    Gpu,
}

/// Parses a share above 0.
fn share(text: &str) -> Result<f64, String> {
    let number: Option<f64> = text.parse().ok();
    let expected = || "expected a number above 0 and up to 1, such as 0.1".to_string();
    number.filter(|share| *share > 0.0 && *share <= 1.0).ok_or_else(expected)
}
