//! The rectangles of DIRECT, grouped by size, and the choice of those that are divided next.

use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeMap, BinaryHeap};

use crate::Coordinate;

/// A side is divided at most this often: 3^-25 = 1e-12 of the box.
const MAX_DEPTH: u8 = 25;
/// Values within this distance are equal for the original method.
const EQUAL_VALUES: f64 = 1e-13;

/// The rectangles that partition the box, each with its center, the number of divisions of each
/// side and its value.
#[derive(Debug, Clone)]
pub(super) struct Rectangles {
    coordinates: Vec<Coordinate>,
    locally_biased: bool,
    centers: Vec<f64>,
    depths: Vec<u8>,
    values: Vec<f64>,
    /// Rectangles that can be divided, by the bits of their size; the one with the lowest value
    /// first.
    groups: BTreeMap<u64, BinaryHeap<Reverse<Entry>>>,
    n_entries: u64,
    lowest: f64,
    /// The largest finite value.
    highest: f64,
}

/// A rectangle in its group. Among equal values, the order is that of insertion.
#[derive(Debug, Clone, Copy)]
struct Entry {
    value: f64,
    order: u64,
    rectangle: usize,
}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        self.value.total_cmp(&other.value).then(self.order.cmp(&other.order))
    }
}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Entry {}

/// Returns 3^-k.
pub(super) fn third(k: u8) -> f64 {
    1.0 / 3f64.powi(k.into())
}

impl Rectangles {
    /// Creates the partition without a rectangle.
    pub(super) fn new(coordinates: &[Coordinate], locally_biased: bool) -> Self {
        Self {
            coordinates: coordinates.to_vec(),
            locally_biased,
            centers: Vec::new(),
            depths: Vec::new(),
            values: Vec::new(),
            groups: BTreeMap::new(),
            n_entries: 0,
            lowest: f64::INFINITY,
            highest: f64::NEG_INFINITY,
        }
    }

    /// Adds a rectangle with a value and returns its index. It is not in a group yet.
    pub(super) fn add(&mut self, center: &[f64], depths: &[u8], value: f64) -> usize {
        self.centers.extend_from_slice(center);
        self.depths.extend_from_slice(depths);
        self.values.push(value);
        self.lowest = self.lowest.min(value);
        if value < f64::INFINITY {
            self.highest = self.highest.max(value);
        }
        self.values.len() - 1
    }

    fn range(&self, rectangle: usize) -> std::ops::Range<usize> {
        let d = self.coordinates.len();
        rectangle * d..(rectangle + 1) * d
    }

    pub(super) fn center(&self, rectangle: usize) -> &[f64] {
        &self.centers[self.range(rectangle)]
    }

    pub(super) fn depths(&self, rectangle: usize) -> &[u8] {
        &self.depths[self.range(rectangle)]
    }

    /// Divides the side `k` of a rectangle.
    pub(super) fn shorten(&mut self, rectangle: usize, k: usize) {
        let range = self.range(rectangle);
        self.depths[range][k] += 1;
    }

    /// Returns the number of divisions of the longest divisible sides; `None` if no side is
    /// divisible. The sides of an integer or a category are divisible while they are longer than
    /// the interval of a level.
    fn longest(&self, rectangle: usize) -> Option<u8> {
        let sides = self.coordinates.iter().zip(self.depths(rectangle));
        let divisible = sides.filter(|(coordinate, depth)| {
            **depth < MAX_DEPTH
                && match coordinate {
                    Coordinate::Continuous => true,
                    Coordinate::Integer { levels } | Coordinate::Categorical { levels } => {
                        third(**depth) * *levels as f64 > 1.0
                    }
                }
        });
        divisible.map(|(_, depth)| *depth).min()
    }

    /// Returns the longest divisible sides.
    pub(super) fn longest_sides(&self, rectangle: usize) -> (u8, Vec<usize>) {
        let depth = self.longest(rectangle).unwrap_or(MAX_DEPTH);
        let is_longest = |k: &usize| self.depths(rectangle)[*k] == depth;
        (depth, (0..self.coordinates.len()).filter(is_longest).collect())
    }

    /// Puts a rectangle into the group of its size: half of its longest side or of its diagonal.
    pub(super) fn insert(&mut self, rectangle: usize) {
        let Some(depth) = self.longest(rectangle) else { return };
        let size = if self.locally_biased {
            third(depth)
        } else {
            let n = self.depths(rectangle).iter().filter(|k| **k == depth).count() as f64;
            let rest = self.coordinates.len() as f64 - n;
            0.5 * (n + rest / 9.0).sqrt() * third(depth)
        };
        let entry = Entry { value: self.values[rectangle], order: self.n_entries, rectangle };
        self.n_entries += 1;
        self.groups.entry(size.to_bits()).or_default().push(Reverse(entry));
    }

    /// Removes the potentially optimal rectangles from their groups and returns them: the lower
    /// right convex hull of (size, value), of which each could have the lowest value less `epsilon`
    /// times its absolute value.
    pub(super) fn take_potentially_optimal(&mut self, epsilon: f64) -> Vec<usize> {
        let chosen = self.potentially_optimal(epsilon);
        let mut first = Vec::new();
        let mut others = Vec::new();
        for size in chosen {
            let Some(group) = self.groups.get_mut(&size) else { continue };
            let Some(Reverse(best)) = group.pop() else { continue };
            first.push(best.rectangle);
            while !self.locally_biased
                && group.peek().is_some_and(|Reverse(next)| next.value - best.value <= EQUAL_VALUES)
            {
                others.extend(group.pop().map(|Reverse(next)| next.rectangle));
            }
            if group.is_empty() {
                self.groups.remove(&size);
            }
        }
        first.append(&mut others);
        first
    }

    /// Returns the sizes of the groups whose best rectangle is potentially optimal, largest first.
    fn potentially_optimal(&self, epsilon: f64) -> Vec<u64> {
        let best = |(size, group): (&u64, &BinaryHeap<Reverse<Entry>>)| {
            group.peek().map(|Reverse(entry)| (f64::from_bits(*size), self.finite(entry.value)))
        };
        let groups: Vec<(f64, f64)> = self.groups.iter().rev().filter_map(best).collect();
        let lowest = self.finite(self.lowest);
        let target = (lowest - epsilon * lowest.abs()).min(lowest);
        let mut chosen: Vec<(f64, f64)> = Vec::new();
        // From the smallest size, so that only smaller rectangles with a lower value are left on
        // the way.
        for (j, (size, value)) in groups.iter().enumerate().rev() {
            let slope = |(other, of_other): &(f64, f64)| (of_other - value) / (other - size);
            let least = groups[..j].iter().map(slope).fold(f64::INFINITY, f64::min);
            let most = chosen.iter().map(slope).fold(0.0, f64::max);
            if least > 0.0 && most <= least && value - least * size <= target {
                chosen.push((*size, *value));
            }
        }
        chosen.iter().rev().map(|(size, _)| size.to_bits()).collect()
    }

    /// Returns the value, or the largest finite value plus 1 for +∞, as Gablonsky's program.
    fn finite(&self, value: f64) -> f64 {
        match value {
            f64::INFINITY if self.highest == f64::NEG_INFINITY => 0.0,
            f64::INFINITY => self.highest + 1.0,
            value => value.max(f64::MIN),
        }
    }
}
