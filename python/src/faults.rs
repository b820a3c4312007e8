//! Faults and delays between an environment and a policy in Python.

use std::collections::BTreeMap;

use mishandle::rollout::fault::{Channel, FaultSite, Side};
use mishandle::rollout::{ActiveInterface, Disturbance, Interface, Scenario, Seed, Space, delays};
use numpy::PyReadwriteArray1;
use pyo3::prelude::*;

use crate::raised;
use crate::target::{SPACE, axes_text};

/// The numbers of an observation or action: the channels by name, the range of each number, and
/// whether they are real numbers.
pub(crate) type Layout = (Vec<(String, Vec<usize>)>, Vec<[f64; 2]>, bool);

/// Returns the layout of a place of faults.
pub(crate) fn layout(site: &FaultSite) -> Layout {
    let channels = site.channels.iter().map(|channel| (channel.name.clone(), channel.entries.clone()));
    (channels.collect(), site.ranges.clone(), site.has_numbers)
}

/// Faults of one environment: their axes, and their effect on each episode.
#[pyclass(frozen, module = "mishandle._native")]
pub struct Faults {
    space: Space,
    interface: Interface,
    random_axes: Vec<String>,
}

#[pymethods]
impl Faults {
    /// Makes `count` faults of the observation and of the action, each if it is given, and delays.
    #[new]
    #[pyo3(signature = (*, observation, action, count, has_delays, control_dt, episode_steps))]
    fn new(
        observation: Option<Layout>,
        action: Option<Layout>,
        count: u32,
        has_delays: bool,
        control_dt: f64,
        episode_steps: usize,
    ) -> PyResult<Self> {
        let action_size = action.as_ref().map_or(0, |(_, ranges, _)| ranges.len());
        let sides =
            [(Side::Sensing, "sensor_fault", observation), (Side::Actuation, "actuator_fault", action)];
        let mut disturbances: Vec<Disturbance> = if has_delays { delays() } else { Vec::new() };
        for (side, name, layout) in sides {
            let Some((channels, ranges, has_numbers)) = layout else { continue };
            let channel = |(name, entries): &(String, Vec<usize>)| Channel {
                name: name.clone(),
                entries: entries.clone(),
            };
            for number in 0..count {
                let name = match number {
                    0 => name.to_string(),
                    _ => format!("{name}_{}", number + 1),
                };
                let site = FaultSite {
                    side,
                    name,
                    number,
                    channels: channels.iter().map(channel).collect(),
                    ranges: ranges.clone(),
                    has_numbers,
                    control_dt,
                    episode_steps,
                };
                disturbances.extend(site.disturbances());
            }
        }
        let axes = disturbances.iter().map(|disturbance| disturbance.axis.clone()).collect();
        let space = Space::new(SPACE, axes).map_err(raised)?;
        let interface = Interface::new(&space, &disturbances, action_size).map_err(raised)?;
        let random_axes = disturbances.iter().filter(|d| d.effect.is_random()).map(|d| d.axis.name.clone());
        Ok(Faults { space, interface, random_axes: random_axes.collect() })
    }

    /// The axes.
    #[getter]
    fn axes(&self) -> PyResult<String> {
        axes_text(self.space.axes())
    }

    /// Names of the axes that make an episode depend on its seed.
    #[getter]
    fn random_axes(&self) -> Vec<String> {
        self.random_axes.clone()
    }

    /// Starts an episode with some values by name, the others nominal; `None` without a
    /// disturbance.
    fn start(&self, values: BTreeMap<String, f64>, seed: u64) -> Option<ActiveFaults> {
        let axes = self.space.axes().iter();
        let value = |axis: &mishandle::rollout::Axis| values.get(&axis.name).copied().or(axis.nominal);
        let scenario = self.space.canonical(Scenario::new(axes.map(value).collect()));
        let is_nominal = scenario.is_same(&self.space.nominal());
        (!is_nominal).then(|| ActiveFaults(self.interface.start(&scenario, Seed(seed))))
    }
}

/// The faults of one episode. Control steps count from 0, each with its observation and then its
/// action.
#[pyclass(module = "mishandle._native")]
pub struct ActiveFaults(ActiveInterface);

#[pymethods]
impl ActiveFaults {
    /// Replaces the observation of a control step by the one that the policy sees.
    fn observe(&mut self, step: usize, mut observation: PyReadwriteArray1<'_, f64>) -> PyResult<()> {
        self.0.observe(step, observation.as_slice_mut()?);
        Ok(())
    }

    /// Returns whether a fault pauses the policy in a control step.
    fn is_paused(&self, step: usize) -> bool {
        self.0.is_paused(step)
    }

    /// Returns whether a fault pauses the policy in any control step.
    fn has_pause(&self) -> bool {
        self.0.has_pause()
    }

    /// Replaces the action of a control step, within its range, by the one that the environment
    /// gets. Returns whether it may differ.
    fn act(&mut self, step: usize, mut action: PyReadwriteArray1<'_, f64>) -> PyResult<bool> {
        Ok(self.0.act(step, action.as_slice_mut()?))
    }
}
