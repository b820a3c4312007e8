use super::kind::{Description, FaultKind, Side};

/// Entries of an observation or action that fail together.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Name in scenarios.
    pub name: String,
    /// Indices of its entries.
    pub entries: Vec<usize>,
}

/// The place of a fault: the observation or the action of an environment, and their channels.
#[derive(Clone, Debug, PartialEq)]
pub struct FaultSite {
    /// Observation or action.
    pub side: Side,
    /// Name of the axis of its kind. Those of the other parameters begin with it.
    pub name: String,
    /// Number of the fault, from 0, among those of its side. Overlapping faults are applied in the
    /// order of their numbers.
    pub number: u32,
    /// Channels. If there is more than one, a scenario can also choose all of them, which is the
    /// nominal choice.
    pub channels: Vec<Channel>,
    /// Range of each entry.
    pub ranges: Vec<[f64; 2]>,
    /// Whether the entries are real numbers, with which a fault can compute.
    pub has_numbers: bool,
    /// Duration of a control step, s.
    pub control_dt: f64,
    /// Number of control steps of an episode.
    pub episode_steps: usize,
}

impl FaultSite {
    /// Returns the kinds of faults that are possible here. The number of a kind in a scenario is
    /// its index.
    pub fn kinds(&self) -> impl Iterator<Item = &'static Description> {
        let has_numbers = self.has_numbers;
        let has_pair = self.has_whole();
        self.side.kinds().iter().filter(move |kind| {
            (has_numbers || !kind.needs_numbers) && (has_pair || kind.kind != FaultKind::Swap)
        })
    }

    /// Returns whether a scenario can choose all channels together.
    fn has_whole(&self) -> bool {
        self.channels.len() > 1
    }

    /// Returns the names of the choices of a channel.
    pub(crate) fn choices(&self) -> Vec<&str> {
        let whole = self.has_whole().then_some("all");
        whole.into_iter().chain(self.channels.iter().map(|channel| channel.name.as_str())).collect()
    }

    /// Returns the names of the choices of the channel with which one is exchanged.
    pub(crate) fn partners(&self) -> Vec<&str> {
        std::iter::once("next").chain(self.channels.iter().map(|channel| channel.name.as_str())).collect()
    }

    /// Returns the entries of a choice of a channel.
    pub(crate) fn entries(&self, choice: usize) -> Vec<usize> {
        match choice.checked_sub(usize::from(self.has_whole())) {
            Some(index) => self.channels[index].entries.clone(),
            None => (0..self.ranges.len()).collect(),
        }
    }

    /// Returns the entries that get the value of another one if a channel is exchanged with a
    /// partner, each with the entry of its value. All channels together are shifted by one entry.
    pub(crate) fn exchanged(&self, choice: usize, partner: usize) -> Vec<(usize, usize)> {
        let Some(first) = choice.checked_sub(usize::from(self.has_whole())) else {
            let count = self.ranges.len();
            return (0..count).map(|entry| (entry, (entry + 1) % count)).collect();
        };
        let second = partner.checked_sub(1).unwrap_or((first + 1) % self.channels.len());
        let a = &self.channels[first].entries;
        let b = &self.channels[second].entries;
        let pairs = a.iter().zip(b).filter(|(a, b)| a != b);
        pairs.flat_map(|(a, b)| [(*a, *b), (*b, *a)]).collect()
    }

    /// Returns the center and half the length of the range of an entry.
    pub(crate) fn center_and_half(&self, entry: usize) -> (f64, f64) {
        let [low, high] = self.ranges[entry];
        (0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low)
    }

    /// Returns the action without an effect: the value of the range that is nearest to 0.
    pub(crate) fn neutral(&self, entry: usize) -> f64 {
        let [low, high] = self.ranges[entry];
        0.0_f64.clamp(low, high)
    }
}
