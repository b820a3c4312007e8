//! Models that get the last observations and images, and not only the present ones.

use mishandle_controllers::remember;
use serde::{Deserialize, Serialize};

/// Number of bytes of an image that one number of the memory holds.
const PACKED: usize = 6;

/// The observations and images before the start of an episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Padding {
    /// Zeros and black images, as in the history of our own controllers.
    #[default]
    Zeros,
    /// Copies of the first ones.
    First,
}

/// The history of a model: the last `length` observations and images, with the present ones.
///
/// Its memory has a number that is 0 before the first control step, then the earlier observations
/// and the earlier images of each input, the latest first.
#[derive(Debug)]
pub(super) struct History {
    length: usize,
    padding: Padding,
    /// Numbers of an observation and bytes of each image that the memory holds; 0 for an input
    /// without a history.
    observation: usize,
    images: Vec<usize>,
}

impl History {
    pub(super) fn new(length: usize, padding: Padding, observation: usize, images: Vec<usize>) -> History {
        History { length, padding, observation, images }
    }

    /// Returns the length of the memory; the largest integer if it is more.
    pub(super) fn memory_size(&self) -> usize {
        let images = self.images.iter().map(|bytes| bytes.div_ceil(PACKED));
        let entries = images.fold(self.observation, usize::saturating_add);
        (self.length - 1).saturating_mul(entries).saturating_add(1)
    }

    /// Fills the memory with the first observation and images, if an episode starts with copies of
    /// them.
    pub(super) fn start<'a>(
        &self,
        memory: &mut [f64],
        observation: &(impl Iterator<Item = f32> + Clone),
        images: &(impl Iterator<Item = &'a [u8]> + Clone),
    ) {
        if memory[0] == 0.0 && self.padding == Padding::First {
            (1..self.length).for_each(|_| self.push(memory, observation.clone(), images.clone()));
        }
    }

    /// Adds the present observation and images to the memory, which forgets its oldest.
    pub(super) fn push<'a>(
        &self,
        memory: &mut [f64],
        observation: impl Iterator<Item = f32>,
        images: impl Iterator<Item = &'a [u8]>,
    ) {
        let Some((is_started, memory)) = memory.split_first_mut() else { return };
        *is_started = 1.0;
        let (own, mut rest) = memory.split_at_mut(self.entries(self.observation));
        remember(own, self.observation, observation.map(f64::from));
        for (bytes, image) in self.images.iter().zip(images) {
            let size = bytes.div_ceil(PACKED);
            let (own, others) = std::mem::take(&mut rest).split_at_mut(self.entries(size));
            rest = others;
            remember(own, size, image.chunks(PACKED).map(packed));
        }
    }

    /// Returns the numbers of the earlier observations, the oldest first.
    pub(super) fn observations(&self, memory: &[f64]) -> impl Iterator<Item = f32> {
        let own = &memory[1..][..self.entries(self.observation)];
        own.chunks(self.observation.max(1)).rev().flatten().map(|number| *number as f32)
    }

    /// Appends the bytes of the earlier images of an input, the oldest first.
    pub(super) fn write_images(&self, memory: &[f64], input: usize, bytes: &mut Vec<u8>) {
        let entries = |bytes: &usize| self.entries(bytes.div_ceil(PACKED));
        let before: usize = self.images[..input].iter().map(entries).sum();
        let count = self.images[input];
        let first = 1 + self.entries(self.observation) + before;
        for image in memory[first..][..entries(&count)].chunks(count.div_ceil(PACKED).max(1)).rev() {
            let unpacked =
                image.iter().flat_map(|number| (*number as u64).to_le_bytes().into_iter().take(PACKED));
            bytes.extend(unpacked.take(count));
        }
    }

    /// Returns the numbers of all earlier entries of this size.
    fn entries(&self, size: usize) -> usize {
        (self.length - 1) * size
    }
}

/// Returns bytes as an integer, which a number holds exactly.
fn packed(bytes: &[u8]) -> f64 {
    bytes.iter().rev().fold(0_u64, |number, byte| number << 8 | u64::from(*byte)) as f64
}
