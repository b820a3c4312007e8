//! The distributions that a policy of [SAC](crate::sac) may draw from.

use mishandle_network::{Mlp, Scalar, Workspace};

use crate::declare::choice;
use crate::drawn::Drawn;

choice! {
    /// Which Gaussian a policy draws from.
    pub enum Distribution {
        /// tanh of a Gaussian. The network gives μ of all actions, then h of all actions, of which σ is made.
        Squashed = "squashed",
        /// A Gaussian cut to [-1, 1]. The network gives μ of all actions; log σ are parameters beside it, the same
        /// whatever is seen.
        Clipped = "clipped",
    }
}

impl Distribution {
    /// Outputs of the network, for `actions` numbers of an action.
    pub fn outputs(self, actions: usize) -> usize {
        match self {
            Distribution::Squashed => 2 * actions,
            Distribution::Clipped => actions,
        }
    }

    /// Parameters beside the network.
    pub fn parameters(self, actions: usize) -> usize {
        match self {
            Distribution::Squashed => 0,
            Distribution::Clipped => actions,
        }
    }
}

/// π: what actions are drawn from.
#[derive(Clone, Copy, Debug)]
pub struct Actor<'a, T> {
    /// Which Gaussian it is.
    pub distribution: Distribution,
    /// Its network.
    pub network: &'a Mlp<T>,
    /// log σ of each action; none if the network gives it.
    pub log_std: &'a [T],
}

impl<T: Scalar> Actor<'_, T> {
    /// Numbers of an action.
    pub fn actions(&self) -> usize {
        match self.distribution {
            Distribution::Squashed => self.network.output_size() / 2,
            Distribution::Clipped => self.network.output_size(),
        }
    }

    /// A row's action from the outputs of the network and z.
    pub(super) fn drawn<'r>(
        &'r self,
        outputs: &'r [T],
        draws: &'r [f64],
    ) -> impl Iterator<Item = Drawn> + 'r {
        let (means, raw) = outputs.split_at(draws.len());
        let (spreads, draw): (_, fn(f64, f64, f64) -> Drawn) = match self.distribution {
            Distribution::Squashed => (raw, Drawn::squashed),
            Distribution::Clipped => (self.log_std, Drawn::clipped),
        };
        let rows = means.iter().zip(spreads).zip(draws);
        rows.map(move |((mean, spread), z)| draw(mean.to_f64(), spread.to_f64(), *z))
    }

    /// Draws the actions of all rows, for what they see and z.
    pub(super) fn draw(
        &self,
        observations: &[T],
        draws: &[f64],
        workspace: &mut Workspace<T>,
        drawn: &mut Vec<Drawn>,
        actions: &mut Vec<T>,
    ) {
        drawn.clear();
        actions.clear();
        let outputs = self.network.forward(observations, workspace).chunks_exact(self.network.output_size());
        for (outputs, draws) in outputs.zip(draws.chunks_exact(self.actions())) {
            for one in self.drawn(outputs, draws) {
                actions.push(T::from_f64(one.action));
                drawn.push(one);
            }
        }
    }
}
