//! The target of a command and its scenarios.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use mishandle::Plan;
use mishandle::plan::AxisSetting;
use mishandle::rollout::{Interval, Noise};

use super::numbers::{integer, number};

/// Standard deviations of noise.
const NOISE: &str = "a number from 0 to 10, such as 0.5";

fn is_noise(std: f64) -> bool {
    (0.0..=Noise::MAX_STD).contains(&std)
}

/// Flags that define the target and its scenarios.
#[derive(Debug, Args)]
pub struct Subject {
    /// Name of a target, a task or toy/NAME, which `mishandle targets` lists; or the path of a
    /// target file (.toml)
    pub target: Option<String>,
    /// Command of a simulator that is a program, such as 'python3 my_simulator.py', instead of a
    /// target: it answers questions as lines of JSON (docs/reference/simulator_protocol.md)
    #[arg(long, value_name = "COMMAND", conflicts_with = "target")]
    pub command: Option<String>,
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
    /// Requirement with a name: the name of a formula of the target, or a text; repeat the flag for
    /// several. Each has a result of its own from the same simulations, and a search tries to
    /// violate any of them
    #[arg(long, value_name = "NAME=FORMULA", allow_hyphen_values = true, value_parser = named_formula)]
    pub requirement: Vec<(String, String)>,
    /// Batch size: number of simulations run at once [default: 64]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(Plan::BATCH))]
    pub batch: Option<u32>,
    /// Task preset: initial box and formulas of the benchmark's `paper` or of its `code` [default:
    /// paper]
    #[arg(long)]
    pub preset: Option<String>,
    /// Standard deviation of the Gaussian noise on each action, added after clipping to [-1, 1];
    /// from 0 to 10 [default: 0]
    #[arg(long, value_name = "STD", allow_negative_numbers = true, value_parser = number(NOISE, is_noise))]
    pub action_noise: Option<f64>,
    /// Standard deviation of the Gaussian noise on each observation, from 0 to 10 [default: 0]
    #[arg(long, value_name = "STD", allow_negative_numbers = true, value_parser = number(NOISE, is_noise))]
    pub observation_noise: Option<f64>,
    /// Sample actions from the policy instead of taking the mean action
    #[arg(long)]
    pub stochastic: bool,
    /// Read a plan (TOML); other flags override it
    #[arg(long, value_name = "FILE")]
    pub plan: Option<PathBuf>,
}

/// Flags that set single axes.
#[derive(Debug, Args)]
pub struct Axes {
    /// Vary this axis only from LOW to HIGH, or within '[LOW, HIGH)' without HIGH; repeat the flag
    /// for several axes. An axis outside of the space is added to it
    #[arg(long, value_name = "NAME=LOW:HIGH", allow_hyphen_values = true, value_parser = axis_range)]
    pub axis: Vec<(String, AxisSetting)>,
    /// Fix this axis at a value, or at a category; repeat the flag for several axes. It may be
    /// outside of the space
    #[arg(long, value_name = "NAME=VALUE", allow_hyphen_values = true, value_parser = axis_value)]
    pub set: Vec<(String, AxisSetting)>,
}

impl Axes {
    /// Returns the settings of axes, each of which may be given once.
    pub fn settings(&self) -> Result<BTreeMap<String, AxisSetting>> {
        let mut settings = BTreeMap::new();
        for (name, setting) in self.axis.iter().chain(&self.set) {
            let earlier = settings.insert(name.clone(), setting.clone());
            ensure!(earlier.is_none(), "the axis {name} is set twice; give one --axis or one --set for it");
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

/// Parses `NAME=LOW:HIGH` and `NAME=[LOW, HIGH)`.
fn axis_range(text: &str) -> std::result::Result<(String, AxisSetting), String> {
    let parsed = text.split_once('=').and_then(|(name, range)| {
        if range.parse::<Interval>().is_ok() {
            return Some((name.to_string(), AxisSetting::Text(range.to_string())));
        }
        let (low, high) = range.split_once(':')?;
        Some((name.to_string(), AxisSetting::Range([low.parse().ok()?, high.parse().ok()?])))
    });
    let expected = "expected the name of an axis and two numbers with decimal points, such as ball_x=0.2:0.3";
    parsed.ok_or_else(|| expected.to_string())
}

/// Parses `NAME=VALUE`.
fn axis_value(text: &str) -> std::result::Result<(String, AxisSetting), String> {
    let (name, value) = text
        .split_once('=')
        .filter(|(_, value)| !value.is_empty())
        .ok_or("expected the name of an axis and a value, such as action_delay=2")?;
    let is_number = |text: &str| text.parse::<f64>().is_ok();
    let is_range = value.split_once(':').is_some_and(|(low, high)| is_number(low) && is_number(high));
    if is_range || value.parse::<Interval>().is_ok() {
        return Err(format!("expected one value, found a range; give --axis {name}={value}"));
    }
    // `nan` is the name of a category of lost samples, and no axis has it as a number.
    let number = value.parse::<f64>().ok().filter(|number| number.is_finite());
    let setting = number.map_or_else(|| AxisSetting::Text(value.to_string()), AxisSetting::Value);
    Ok((name.to_string(), setting))
}
