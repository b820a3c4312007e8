//! The numbers that a proposal for sequences sees of a simulation, and their sums over its control
//! steps.

use mishandle_random::{Seed, Stream};
use mishandle_rollout::{Seen, Steerable, SteeredAxis, Steering};
use mishandle_stl::is_violated;

use crate::sequence_proposal::SequenceProposal;
use crate::{Draw, Scenarios};

/// Largest number of columns, those whose values in a pilot follow the robustness most.
const MOST_COLUMNS: usize = 8;

/// Number of functions of time: Legendre polynomials of degrees 0 to 2.
const TIMES: usize = 3;

/// Number of features of a column x: x, its product with time, and what it is beyond the bends on
/// both sides. Before a rare excursion, a process waits near its mean, so that the best disturbance
/// is 0 there.
const PER_COLUMN: usize = 4;
const BEND: f64 = 2.0;

/// Columns whose means in the episodes have a larger correlation count as the same.
const SAME: f64 = 0.9999;

/// Largest absolute value of a column, in standard deviations of the pilot. A policy is linear, and
/// beyond what it was fitted to, it must not grow without a limit.
const LARGEST: f64 = 12.0;

/// One number of the observation or one signal, standardized by mean and standard deviation of the
/// pilot.
#[derive(Clone, Debug, PartialEq)]
struct Column {
    /// Index in the observation followed by the signals.
    index: usize,
    mean: f64,
    scale: f64,
}

/// A free axis that can be steered.
#[derive(Clone, Debug, PartialEq)]
struct Slot {
    axis: usize,
    /// Index of its latent number.
    latent: usize,
    channel: usize,
}

/// The steered axes of a space, and the layout of the sums that a simulation has: for each group of
/// channels that begin in the same control steps their number and Σ f fᵀ, then for each channel Σ z
/// f and Σ z², then the chosen latent numbers z. The features f are the same for all channels.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Layout {
    columns: Vec<Column>,
    slots: Vec<Slot>,
    /// Number of the slot of each axis of the space that has one.
    slot_of: Vec<Option<usize>>,
    /// Indices of the latent numbers of the other free axes.
    pub(crate) others: Vec<usize>,
    /// Group of each channel.
    groups: Vec<usize>,
    group_count: usize,
    seen: usize,
    episode_steps: usize,
}

impl Layout {
    /// Makes the layout without columns.
    pub(crate) fn new(steerable: &Steerable, scenarios: &Scenarios) -> Layout {
        let latent = |axis: usize| scenarios.free().iter().position(|own| *own == axis);
        let mut channels: Vec<(usize, Vec<usize>)> = Vec::new();
        let mut slots = Vec::new();
        for SteeredAxis { axis, step, channel } in &steerable.axes {
            let Some(latent) = latent(*axis).filter(|_| scenarios.is_independent(*axis)) else {
                continue;
            };
            let number = channels.iter().position(|(own, _)| own == channel).unwrap_or_else(|| {
                channels.push((*channel, Vec::new()));
                channels.len() - 1
            });
            channels[number].1.push(*step);
            slots.push(Slot { axis: *axis, latent, channel: number });
        }
        let mut timings: Vec<&Vec<usize>> = Vec::new();
        let group = |(_, steps)| {
            timings.iter().position(|own| *own == steps).unwrap_or_else(|| {
                timings.push(steps);
                timings.len() - 1
            })
        };
        let groups: Vec<usize> = channels.iter().map(|(number, steps)| (number, steps)).map(group).collect();
        let mut slot_of = vec![None; scenarios.axes().count()];
        slots.iter().enumerate().for_each(|(number, slot)| slot_of[slot.axis] = Some(number));
        let is_other = |latent: &usize| slots.iter().all(|slot: &Slot| slot.latent != *latent);
        Layout {
            columns: Vec::new(),
            others: (0..scenarios.dimension()).filter(is_other).collect(),
            group_count: timings.len(),
            slots,
            slot_of,
            groups,
            seen: steerable.observation_size + steerable.signals,
            episode_steps: steerable.episode_steps,
        }
    }

    /// Chooses the columns from the sums of pilot simulations: those whose mean or mean square in
    /// the episode is most correlated with the robustness.
    pub(crate) fn with_columns(self, pilot: &[(f64, Vec<f64>)]) -> Layout {
        let usable: Vec<(f64, f64, &[f64])> = pilot
            .iter()
            .filter(|(rho, sums)| rho.is_finite() && sums[0] > 0.0)
            .map(|(rho, sums)| (*rho, sums[0], &sums[1..]))
            .collect();
        let count: f64 = usable.iter().map(|(_, count, _)| count).sum();
        let mut found: Vec<(f64, Column)> = Vec::new();
        let mean_of = |index: usize| usable.iter().map(move |(_, count, sums)| sums[index] / count);
        for index in 0..self.seen {
            let total = |at: usize| usable.iter().map(|(_, _, sums)| sums[at]).sum::<f64>();
            let mean = total(2 * index) / count;
            let variance = total(2 * index + 1) / count - mean * mean;
            // A constant has rounding errors instead of a variance.
            if !variance.is_finite() || variance <= 1e-10 * (mean * mean).max(1e-10) {
                continue;
            }
            let robustness = usable.iter().map(|(rho, _, _)| *rho);
            let score = |at: usize| correlation(robustness.clone().zip(mean_of(at))).abs();
            let score = score(2 * index).max(score(2 * index + 1));
            found.push((score, Column { index, mean, scale: variance.sqrt() }));
        }
        found.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        let mut columns: Vec<Column> = Vec::new();
        for (_, column) in found {
            // A signal is often in the observation, too.
            let is_same = |own: &Column| {
                let pairs = mean_of(2 * own.index).zip(mean_of(2 * column.index));
                correlation(pairs).abs() > SAME
            };
            if columns.len() < MOST_COLUMNS && !columns.iter().any(is_same) {
                columns.push(column);
            }
        }
        Layout { columns, ..self }
    }

    /// Returns whether an axis can be steered.
    pub(crate) fn has_slots(&self) -> bool {
        !self.slots.is_empty()
    }

    /// Returns the number of features.
    pub(crate) fn features(&self) -> usize {
        TIMES + PER_COLUMN * self.columns.len()
    }

    /// Returns the group of each channel.
    pub(crate) fn groups(&self) -> &[usize] {
        &self.groups
    }

    /// Returns the number of groups.
    pub(crate) fn group_count(&self) -> usize {
        self.group_count
    }

    /// Returns the sums at the last step that decided the robustness, from the memory of a fit.
    pub(crate) fn decided<'a>(&self, memory: &'a [f64], robustness: f64) -> &'a [f64] {
        let rest = &memory[self.sums() + self.slots.len()..];
        // Either nothing was decided before the end, or the last sample decided more.
        if rest[0] == 0.0 || drop_of(robustness) > rest[0] { &memory[..self.sums()] } else { &rest[1..] }
    }

    fn group_size(&self) -> usize {
        1 + packed(self.features())
    }

    fn channel_size(&self) -> usize {
        self.features() + 1
    }

    /// Returns the number of sums, which do not include the latent numbers.
    pub(crate) fn sums(&self) -> usize {
        self.group_count * self.group_size() + self.groups.len() * self.channel_size()
    }

    /// Returns the number of draws of a group and the lower triangle of Σ f fᵀ, by rows.
    pub(crate) fn of_group<'a>(&self, sums: &'a [f64], group: usize) -> (f64, &'a [f64]) {
        let own = &sums[group * self.group_size()..][..self.group_size()];
        (own[0], &own[1..])
    }

    /// Returns Σ z f and Σ z² of a channel.
    pub(crate) fn of_channel<'a>(&self, sums: &'a [f64], channel: usize) -> (&'a [f64], f64) {
        let first = self.group_count * self.group_size() + channel * self.channel_size();
        let own = &sums[first..][..self.channel_size()];
        (&own[..self.features()], own[self.features()])
    }

    /// Sets the latent numbers that were chosen. Those of axes that did not begin keep theirs.
    pub(crate) fn complete(&self, draw: &mut Draw, memory: &[f64]) {
        for (slot, z) in self.slots.iter().zip(&memory[self.sums()..][..self.slots.len()]) {
            if *z != 0.0 {
                draw.latent[slot.latent] = *z;
            }
        }
    }

    /// Writes the features of a control step.
    fn write(&self, seen: &Seen<'_>, features: &mut Vec<f64>) {
        let t = 2.0 * seen.step as f64 / self.episode_steps.max(2) as f64 - 1.0;
        let times = [1.0, t, 1.5 * t * t - 0.5];
        features.clear();
        features.extend(times);
        for Column { index, mean, scale } in &self.columns {
            let size = seen.observation.len();
            let value =
                if *index < size { f64::from(seen.observation[*index]) } else { seen.signals[*index - size] };
            let x = ((value - mean) / scale).clamp(-LARGEST, LARGEST);
            // The controller may see NaN.
            let x = if x.is_nan() { 0.0 } else { x };
            features.extend([x, t * x, (x - BEND).max(0.0), (-x - BEND).max(0.0)]);
        }
    }
}

/// Returns the number of entries of the lower triangle of a matrix.
pub(crate) fn packed(n: usize) -> usize {
    n * (n + 1) / 2
}

/// Returns the correlation of pairs; 0 if one of the two does not vary.
fn correlation(pairs: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let n = pairs.clone().count() as f64;
    let (a, b) = pairs.clone().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let mut xx = 0.0;
    let mut yy = 0.0;
    let mut xy = 0.0;
    for (x, y) in pairs {
        xx += (x - a) * (x - a);
        yy += (y - b) * (y - b);
        xy += (x - a) * (y - b);
    }
    if xx > 0.0 && yy > 0.0 { xy / (xx * yy).sqrt() } else { 0.0 }
}

/// Looks at simulations without choosing anything. It remembers the number of samples and for each
/// number seen its sum and that of its squares.
pub(crate) struct Pilot {
    /// Number of numbers seen.
    seen: usize,
}

impl Pilot {
    pub(crate) fn new(layout: &Layout) -> Pilot {
        Pilot { seen: layout.seen }
    }
}

impl Steering for Pilot {
    fn memory_size(&self) -> usize {
        1 + 2 * self.seen
    }

    fn steer(&self, seen: Seen<'_>, _: &[SteeredAxis], memory: &mut [f64], _: &mut [f64]) {
        memory[0] += 1.0;
        let observed = seen.observation.iter().map(|x| f64::from(*x)).chain(seen.signals.iter().copied());
        for (value, sums) in observed.zip(memory[1..].chunks_exact_mut(2)) {
            sums[0] += value;
            sums[1] += value * value;
        }
    }
}

/// Where the latent numbers of a steered simulation are from.
pub(crate) enum Choice<'a> {
    /// A proposal draws them.
    Proposal(&'a SequenceProposal),
    /// They are given, and so are the values of the requests. Seeds identify the draws.
    Given(&'a [Draw]),
}

/// Chooses the disturbances of simulations and remembers the sums of [`Layout`].
pub(crate) struct Chooser<'a> {
    pub(crate) layout: &'a Layout,
    pub(crate) scenarios: &'a Scenarios,
    pub(crate) choice: Choice<'a>,
    /// Whether it also remembers the sums at the last step that decided the robustness. A fit needs
    /// them: a process that has come as close to a failure as it will get needs no disturbance.
    pub(crate) is_fit: bool,
}

impl Steering for Chooser<'_> {
    fn memory_size(&self) -> usize {
        let decided = if self.is_fit { 1 + self.layout.sums() } else { 0 };
        self.layout.sums() + self.layout.slots.len() + decided
    }

    fn steer(&self, seen: Seen<'_>, axes: &[SteeredAxis], memory: &mut [f64], values: &mut [f64]) {
        let layout = self.layout;
        let is_violated = is_violated(seen.bound);
        let (sums, rest) = memory.split_at_mut(layout.sums());
        let (chosen, decided) = rest.split_at_mut(layout.slots.len());
        // The memory begins with 0, which stands for a bound that is not finite.
        if let Some((drop, decided)) = decided.split_first_mut()
            && drop_of(seen.bound) > *drop
        {
            *drop = drop_of(seen.bound);
            decided.copy_from_slice(sums);
        }
        let mut features = Vec::with_capacity(layout.features());
        layout.write(&seen, &mut features);
        let mut noise = vec![0.0; axes.len()];
        seen.seed.normals(Stream::Steering, seen.step as u64, &mut noise);
        let mut counted = vec![false; layout.group_count];
        for ((axis, value), noise) in axes.iter().zip(values).zip(noise) {
            let Some(number) = layout.slot_of.get(axis.axis).copied().flatten() else { continue };
            let Slot { channel, latent, .. } = layout.slots[number];
            let z = match &self.choice {
                Choice::Given(draws) => {
                    draws.iter().find(|draw| draw.seed == seen.seed).map_or(0.0, |draw| draw.latent[latent])
                }
                // What follows a violation does not matter, so it has the weight 1.
                Choice::Proposal(_) if is_violated => noise,
                Choice::Proposal(proposal) => proposal.chosen(seen.seed, channel, &features, noise),
            };
            chosen[number] = z;
            if let Choice::Proposal(_) = self.choice {
                *value = self.scenarios.value(axis.axis, z);
            }
            if is_violated {
                continue;
            }
            let group_size = layout.group_size();
            let channel_size = layout.channel_size();
            let group = layout.groups[channel];
            if !std::mem::replace(&mut counted[group], true) {
                let own = &mut sums[group * group_size..][..group_size];
                own[0] += 1.0;
                let mut products = own[1..].iter_mut();
                for (i, a) in features.iter().enumerate() {
                    features[..=i].iter().zip(products.by_ref()).for_each(|(b, sum)| *sum += a * b);
                }
            }
            let first = layout.group_count * group_size + channel * channel_size;
            let own = &mut sums[first..][..channel_size];
            own.iter_mut().zip(&features).for_each(|(sum, f)| *sum += z * f);
            own[features.len()] += z * z;
        }
    }
}

/// Returns a positive number that rises when a finite bound falls, and 0 for one that is not
/// finite.
pub(crate) fn drop_of(bound: f64) -> f64 {
    if bound.is_finite() { std::f64::consts::FRAC_PI_2 - bound.atan() } else { 0.0 }
}

/// Returns a uniform number that decides which component of a proposal a simulation has.
pub(crate) fn choice_of(seed: Seed) -> f64 {
    seed.uniform(Stream::Steering, u64::MAX, 0)
}
