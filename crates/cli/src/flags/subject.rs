//! The target of a command and its scenarios.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use mishandle::plan::{AxisSetting, axis_setting};
use mishandle::rollout::Noise;

use super::Keys;
use super::numbers::number;

/// Standard deviations of noise.
const NOISE: &str = "a number from 0 to 10, such as 0.5";

fn is_noise(std: f64) -> bool {
    (0.0..=Noise::MAX_STD).contains(&std)
}

/// Flags that define the target and its scenarios.
#[derive(Debug, Args)]
pub struct Subject {
    /// Name of a target, a task or toy/NAME, which `mishandle list targets` lists; or the path of a
    /// target file (.toml)
    pub target: Option<String>,
    /// Controller of a task: the path of a .safetensors or .onnx file, or the name of a shipped
    /// controller such as ppo or expert
    #[arg(long, value_name = "C")]
    pub controller: Option<String>,
    /// Guard of the controller (TOML): a monitored formula, and who acts when its robustness falls
    /// below a threshold (docs/guide/guard.md)
    #[arg(long, value_name = "FILE")]
    pub guard: Option<PathBuf>,
    /// Scenario space of the target, or several joined by + [default: the first one: starts of a
    /// task, scenarios of a target file; in margin: disturbance]
    #[arg(long, value_name = "NAME")]
    pub space: Option<String>,
    #[command(flatten)]
    pub axes: Axes,
    /// Standard deviation of the Gaussian noise on each action, added after clipping to [-1, 1];
    /// from 0 to 10 [default: 0]
    #[arg(long, value_name = "STD", allow_negative_numbers = true, value_parser = number(NOISE, is_noise))]
    pub action_noise: Option<f64>,
    #[command(flatten)]
    pub keys: Keys,
}

/// Flags of commands that also take a simulator's command and requirements.
#[derive(Debug, Args)]
pub struct Simulator {
    /// Command of a simulator that is a program, such as 'python3 my_simulator.py', instead of a
    /// target: it answers questions as lines of JSON (docs/reference/simulator_protocol.md)
    #[arg(long, value_name = "COMMAND", conflicts_with = "target")]
    pub command: Option<String>,
    /// Requirement with a name: the name of a formula of the target, or a text; repeat the flag for
    /// several. Each has a result of its own from the same simulations, and a search tries to
    /// violate any of them
    #[arg(long, value_name = "NAME=FORMULA", allow_hyphen_values = true, value_parser = named_formula)]
    pub requirement: Vec<(String, String)>,
}

/// Flags that set single axes.
#[derive(Debug, Args)]
pub struct Axes {
    /// Vary this axis only from LOW to HIGH, or within '[LOW, HIGH)' without HIGH, or fix it at a
    /// value or at a category; repeat the flag for several axes. An axis outside of the space is
    /// added to it
    #[arg(long, value_name = "NAME=LOW:HIGH|VALUE", allow_hyphen_values = true, value_parser = axis)]
    pub axis: Vec<(String, AxisSetting)>,
}

impl Axes {
    /// Returns the settings of axes, each of which may be given once.
    pub fn settings(&self) -> Result<BTreeMap<String, AxisSetting>> {
        let mut settings = BTreeMap::new();
        for (name, setting) in &self.axis {
            let earlier = settings.insert(name.clone(), setting.clone());
            ensure!(earlier.is_none(), "the axis {name} is set twice; give one --axis for it");
        }
        Ok(settings)
    }
}

/// Parses `NAME=FORMULA`; a name alone is that of a formula of the target.
pub fn named_formula(text: &str) -> std::result::Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, formula)) if !formula.trim().is_empty() && !formula.starts_with('=') => {
            Ok((name.trim().to_string(), formula.trim().to_string()))
        }
        None if !text.trim().is_empty() => Ok((text.trim().to_string(), text.trim().to_string())),
        _ => Err("expected a name and a formula, such as near='always(distance <= 0.1)'".to_string()),
    }
}

/// Parses `NAME=LOW:HIGH`, `NAME=[LOW, HIGH)` and `NAME=VALUE`.
fn axis(text: &str) -> std::result::Result<(String, AxisSetting), String> {
    let parsed =
        text.split_once('=').and_then(|(name, setting)| Some((name.to_string(), axis_setting(setting)?)));
    let expected =
        "expected the name of an axis and a range or a value, such as ball_x=0.2:0.3 or action_delay=2";
    parsed.ok_or_else(|| expected.to_string())
}
