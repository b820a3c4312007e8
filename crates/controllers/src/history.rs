//! The memory of a policy: its last observations and its own actions.

use mishandle_network::Normalizer;

/// The layout of a network's input with the last `length` observations and actions.
///
/// ```text
/// input  = (oₜ, memory)
/// memory = (oₜ₋₁, aₜ₋₁, oₜ₋₂, aₜ₋₂, …),   zeros before the start of the episode
/// ```
///
/// An observation is the one that the controller saw, an action the one that it answered, clipped
/// to [-1, 1]: before noise, delays and faults of the environment, which a controller cannot know.
/// A control step in which a fault pauses the controller adds nothing.
///
/// # Example
/// ```
/// use mishandle_controllers::History;
/// let history = History::new(2, 1, 1);
/// let mut memory = vec![0.0; history.memory_size()];
/// history.push(&mut memory, &[0.5], &[3.0]);
/// let mut input = vec![0.0; history.input_size()];
/// history.write_input(&[0.75], &memory, &mut input);
/// assert_eq!(input, [0.75, 0.5, 1.0, 0.0, 0.0]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct History {
    length: usize,
    observation_size: usize,
    action_size: usize,
}

impl History {
    /// Creates the layout for observations and actions of these sizes.
    pub fn new(length: usize, observation_size: usize, action_size: usize) -> History {
        History { length, observation_size, action_size }
    }

    /// Returns the number of control steps that the memory holds; 0 without a memory.
    pub fn length(self) -> usize {
        self.length
    }

    /// Returns the length of an observation.
    pub fn observation_size(self) -> usize {
        self.observation_size
    }

    /// Returns the length of an action.
    pub fn action_size(self) -> usize {
        self.action_size
    }

    /// Returns the number of numbers of the memory; the largest integer if they are more.
    pub fn memory_size(self) -> usize {
        self.length.saturating_mul(self.entry_size())
    }

    /// Returns the number of inputs of the network; the largest integer if they are more.
    pub fn input_size(self) -> usize {
        self.observation_size.saturating_add(self.memory_size())
    }

    /// Writes the input of the network: the observation, then the memory.
    ///
    /// # Panics
    /// If a length differs.
    pub fn write_input(self, observation: &[f32], memory: &[f64], input: &mut [f32]) {
        let (present, past) = input.split_at_mut(self.observation_size);
        present.copy_from_slice(observation);
        assert_eq!(past.len(), memory.len(), "length of the memory");
        past.iter_mut().zip(memory).for_each(|(input, number)| *input = *number as f32);
    }

    /// Adds an observation and the action that answered it to the memory, which forgets its oldest.
    ///
    /// # Panics
    /// If a length differs.
    pub fn push(self, memory: &mut [f64], observation: &[f32], action: &[f32]) {
        if self.length == 0 {
            return;
        }
        let answered = action.iter().map(|action| action.clamp(-1.0, 1.0));
        let entry = observation.iter().copied().chain(answered);
        remember(memory, self.entry_size(), entry.map(f64::from));
    }

    /// Returns a normalizer of whole inputs: each observation is normalized as the present one,
    /// actions stay as they are.
    #[must_use]
    pub fn normalizer(self, of_observations: Normalizer<f32>) -> Normalizer<f32> {
        of_observations.repeated(self.length, self.action_size)
    }

    fn entry_size(self) -> usize {
        self.observation_size.saturating_add(self.action_size)
    }
}

/// Adds an entry of `size` numbers to a memory of entries, the latest first, which forgets its
/// oldest. An empty memory stays empty.
///
/// # Panics
/// If the memory is not empty and shorter than an entry.
pub fn remember(memory: &mut [f64], size: usize, entry: impl Iterator<Item = f64>) {
    if memory.is_empty() {
        return;
    }
    memory.copy_within(..memory.len() - size, size);
    memory[..size].iter_mut().zip(entry).for_each(|(old, new)| *old = new);
}
