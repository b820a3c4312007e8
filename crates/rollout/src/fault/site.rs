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
    /// Channels. The first is the nominal one.
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
        let (has_numbers, has_pair) = (self.has_numbers, self.channels.len() > 1);
        self.side.kinds().iter().filter(move |kind| {
            (has_numbers || !kind.needs_numbers) && (has_pair || kind.kind != FaultKind::Swap)
        })
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
