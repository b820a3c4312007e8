use crate::Seed;

/// Something that turns observations into actions: a shared description, from which each thread takes an [`ControllerWorker`].
pub trait Controller: Send + Sync {
    /// Length of the observations it takes.
    fn observation_size(&self) -> usize;
    /// Number of actions it gives.
    fn action_size(&self) -> usize;
    /// Length of the memory it keeps for each simulation; 0 if it keeps none.
    fn state_size(&self) -> usize {
        0
    }
    /// What one thread needs to act.
    fn worker(&self) -> Box<dyn ControllerWorker>;
}

/// What one thread needs to act for any number of simulations at once.
///
/// A row's actions never depend on the other rows, nor on how many there are.
pub trait ControllerWorker: Send {
    /// Writes the memory of a new simulation; its random draws come from [`Stream::Policy`](crate::Stream::Policy)
    /// of `seed`.
    fn reset(&mut self, _state: &mut [f64], _seed: Seed) {}

    /// Writes the actions of `rows` simulations, row after row, from their `observations` and their memory `states`.
    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]);
}
