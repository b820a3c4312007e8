//! A fault in one simulation: its effect on each observation or action.

use std::sync::Arc;

use super::kind::{FaultKind, Fill, Side};
use super::life_cycle::LifeCycle;
use super::parameter::Parameter;
use super::site::FaultSite;
use crate::delay::{DelayLine, Lateness};
use crate::memory::Memory;
use crate::real::Real;
use crate::{Seed, Stream};

/// A fault of a scenario, with what it remembers.
#[derive(Debug)]
pub(crate) struct ActiveFault {
    site: Arc<FaultSite>,
    kind: FaultKind,
    life: LifeCycle,
    /// Entries of the channel.
    entries: Vec<usize>,
    /// Exchanged entries, each with the entry of its value.
    exchanged: Vec<(usize, usize)>,
    fill: Fill,
    /// The number that belongs to the kind: offset, level, step, probability, loss or limit.
    magnitude: f64,
    burst: usize,
    lateness: Lateness,
    seed: Seed,
    /// Last value of each entry of the channel that passed.
    held: Vec<f64>,
    line: DelayLine,
}

impl ActiveFault {
    /// Returns the fault with these parameters; `None` if it has no effect.
    pub(crate) fn new(
        site: Arc<FaultSite>,
        values: &[f64; Parameter::COUNT],
        seed: Seed,
    ) -> Option<ActiveFault> {
        use Parameter as P;
        let value = |parameter: Parameter| values[parameter as usize];
        let description = site.kinds().nth(value(P::Kind) as usize)?;
        let kind = description.kind;
        let recovery = if description.recovers() { value(P::Recovery) } else { 0.0 };
        let life = LifeCycle::from_seconds(value(P::Onset), value(P::Duration), recovery, site.control_dt);
        let magnitude = description.parameters.iter().copied().find(|parameter| parameter.is_magnitude());
        let is_nominal = magnitude.is_some_and(|parameter| parameter.is_nominal(value(parameter)));
        if kind == FaultKind::None || life.duration == 0 || is_nominal {
            return None;
        }
        let has_channel = description.parameters.contains(&P::Channel);
        let entries = if has_channel {
            site.entries(value(P::Channel) as usize)
        } else {
            (0..site.ranges.len()).collect()
        };
        let exchanged = match kind {
            FaultKind::Swap => site.exchanged(value(P::Channel) as usize, value(P::Partner) as usize),
            _ => Vec::new(),
        };
        let magnitude = magnitude.map_or(0.0, value);
        let jitter = if kind == FaultKind::ClockJitter { magnitude as usize } else { 0 };
        let held = match site.side {
            Side::Sensing => Vec::new(),
            // Before the first command, the robot has none.
            Side::Actuation => entries.iter().map(|entry| site.neutral(*entry)).collect(),
        };
        Some(ActiveFault {
            kind,
            life,
            entries,
            exchanged,
            fill: site.fills().get(value(P::Filling) as usize).map_or(Fill::Last, |(fill, _)| *fill),
            magnitude,
            burst: value(P::Burst).max(1.0) as usize,
            lateness: Lateness { jitter, ..Lateness::default() },
            seed,
            held,
            line: DelayLine::default(),
            site,
        })
    }

    pub(crate) fn site(&self) -> &FaultSite {
        &self.site
    }

    /// Saves or restores what depends on earlier control steps.
    pub(crate) fn visit_memory(&mut self, memory: &mut dyn Memory) {
        memory.numbers(&mut self.held);
        self.line.visit_memory(memory);
    }

    /// Returns whether a fault pauses the controller in a control step.
    pub(crate) fn is_pausing(&self, step: usize) -> bool {
        self.is_pause() && self.life.is_whole(step)
    }

    /// Returns whether the fault pauses the controller in any control step.
    pub(crate) fn is_pause(&self) -> bool {
        self.kind == FaultKind::Pause
    }

    /// Replaces the entries of the channel in control step `step`. The steps must come in order.
    /// Returns whether the fault acts in this step.
    pub(crate) fn apply<T: Real>(&mut self, step: usize, values: &mut [T]) -> bool {
        let share = self.life.share(step);
        let is_whole = self.life.is_whole(step);
        match self.kind {
            FaultKind::None | FaultKind::Pause => return false,
            FaultKind::Freeze | FaultKind::Hold => self.hold(share > 0.0, share, values),
            FaultKind::Dropout => self.lose(is_whole, values),
            FaultKind::BurstLoss | FaultKind::CommandLoss => {
                let is_lost = is_whole && self.is_in_burst(step);
                self.lose(is_lost, values);
                return is_lost;
            }
            FaultKind::Swap if is_whole => {
                self.held.clear();
                self.held.extend(self.exchanged.iter().map(|(_, from)| values[*from].to_f64()));
                for ((to, _), held) in self.exchanged.iter().zip(&self.held) {
                    values[*to] = T::nearest(*held);
                }
            }
            FaultKind::ClockJitter => return self.delay(step, is_whole, values),
            _ if share > 0.0 => self.compute(step, share, values),
            _ => {}
        }
        share > 0.0
    }

    /// Sets each entry to a function of its value.
    fn compute<T: Real>(&self, step: usize, share: f64, values: &mut [T]) {
        for entry in self.entries.iter().copied() {
            let (center, half) = self.site.center_and_half(entry);
            let [low, high] = self.site.ranges[entry];
            let neutral = self.site.neutral(entry);
            let x = values[entry].to_f64();
            let m = self.magnitude;
            let elapsed = self.life.elapsed(step);
            let faulty = match self.kind {
                FaultKind::Stuck => between(x, center + m * half, share),
                FaultKind::Bias => x + share * m * half,
                FaultKind::Ramp => x + share * elapsed * m * half,
                // The first control step has the whole offset.
                FaultKind::Spike => {
                    let steps = self.life.duration as f64;
                    x + (1.0 - elapsed + 1.0 / steps) * m * half
                }
                FaultKind::Quantization => {
                    let quantum = m * half;
                    let rounded = if quantum > 0.0 { (x / quantum).round() * quantum } else { x };
                    between(x, rounded, share)
                }
                FaultKind::AuthorityLoss => neutral + (1.0 - share * m) * (x - neutral),
                FaultKind::SignFlip => (neutral - (x - neutral)).clamp(low, high),
                FaultKind::Saturation => {
                    let limit = 1.0 - share * (1.0 - m);
                    x.clamp(neutral + limit * (low - neutral), neutral + limit * (high - neutral))
                }
                _ => x,
            };
            // With the precision of actions and observations everywhere, so that an environment in
            // Python, which has single precision, gets the same number.
            values[entry] = T::nearest(f64::from(faulty as f32));
        }
    }

    /// Holds the last values before the fault, of which `share` is left.
    fn hold<T: Real>(&mut self, is_held: bool, share: f64, values: &mut [T]) {
        if !is_held || self.held.is_empty() {
            self.keep(values);
        }
        if !is_held {
            return;
        }
        for (entry, held) in self.entries.iter().zip(&self.held) {
            values[*entry] = T::nearest(between(values[*entry].to_f64(), *held, share));
        }
    }

    /// Replaces lost values by their fill.
    fn lose<T: Real>(&mut self, is_lost: bool, values: &mut [T]) {
        if !is_lost || self.held.is_empty() {
            self.keep(values);
        }
        if !is_lost {
            return;
        }
        for (entry, held) in self.entries.iter().zip(&self.held) {
            values[*entry] = T::nearest(match self.fill {
                Fill::Last => *held,
                Fill::Zero => 0.0,
                Fill::NotANumber => f64::NAN,
            });
        }
    }

    fn keep<T: Real>(&mut self, values: &[T]) {
        self.held.clear();
        self.held.extend(self.entries.iter().map(|entry| values[*entry].to_f64()));
    }

    /// Shows values of earlier control steps during the fault.
    fn delay<T: Real>(&mut self, step: usize, is_whole: bool, values: &mut [T]) -> bool {
        self.line.push(&self.lateness, values.iter().map(|value| value.to_f64()));
        let arrival = if is_whole {
            self.lateness.arrival(step, self.seed, Stream::Fault, self.draw())
        } else {
            Some(step)
        };
        let entries = self.entries.iter().copied();
        match self.line.show(arrival) {
            Some(shown) => values.iter_mut().zip(shown).for_each(|(value, x)| *value = T::nearest(*x)),
            // Before the first command, the robot has none.
            None => entries.for_each(|entry| values[entry] = T::nearest(self.site.neutral(entry))),
        }
        is_whole
    }

    /// Returns whether a burst of losses that started during the fault lasts.
    fn is_in_burst(&self, step: usize) -> bool {
        let first = (step + 1).saturating_sub(self.burst).max(self.life.onset);
        (first..=step)
            .any(|start| self.seed.uniform(Stream::Fault, start as u64, self.draw()) < self.magnitude)
    }

    /// Returns the index of the random numbers of this fault in their stream.
    fn draw(&self) -> u32 {
        2 * self.site.number + u32::from(self.site.side == Side::Actuation)
    }
}

/// Returns the value between `from` (share 0) and `to` (share 1). Both ends are exact.
fn between(from: f64, to: f64, share: f64) -> f64 {
    if share >= 1.0 { to } else { from + share * (to - from) }
}
