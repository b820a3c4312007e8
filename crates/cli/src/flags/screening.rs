//! Where simulations are screened.

use anyhow::{Result, ensure};
use clap::Args;
use mishandle::plan::ScreeningPlan;

use super::numbers::integer;

/// Where simulations are screened.
#[derive(Debug, Args)]
pub struct Screen {
    /// Physics engine of the simulations: cpu (MuJoCo C), or gpu (MuJoCo Warp; MuJoCo C repeats every violation and a random
    /// sample of the others, and only these count) [default: cpu]
    #[arg(long, value_name = "NAME", conflicts_with = "resume")]
    pub backend: Option<Backend>,
    /// With --backend gpu: number of worlds on the GPU [default: 16384]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(1..=1_048_576))]
    #[arg(conflicts_with = "resume")]
    pub rows: Option<u32>,
    /// With --backend gpu: share of the simulations without a violation that MuJoCo C repeats, above 0 and up to 1
    /// [default: 0.1]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, value_parser = share, conflicts_with = "resume")]
    pub confirm: Option<f64>,
}

impl Screen {
    /// Returns the screening of a plan with the values of the flags.
    pub fn plan(&self, planned: Option<ScreeningPlan>) -> Result<Option<ScreeningPlan>> {
        let planned = match self.backend {
            None => planned,
            Some(Backend::Cpu) => None,
            Some(Backend::Gpu) => Some(planned.unwrap_or_default()),
        };
        ensure!(
            planned.is_some() || (self.rows.is_none() && self.confirm.is_none()),
            "--rows and --confirm need --backend gpu"
        );
        Ok(planned.map(|planned| ScreeningPlan {
            rows: self.rows.unwrap_or(planned.rows),
            confirm: self.confirm.unwrap_or(planned.confirm),
            ..planned
        }))
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
