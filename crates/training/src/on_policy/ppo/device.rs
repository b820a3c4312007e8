//! PPO's gradient with the passes of both networks on another device. The losses are those of the
//! CPU.

use mishandle_network::{CHUNK_ROWS, DeviceNetwork, Mlp, NetworkDevice, NetworkError};
use rayon::prelude::*;

use super::loss::{METRICS, Minibatch};

/// Policy and critic on a device.
pub(super) struct DeviceNetworks {
    policy: Box<dyn DeviceNetwork>,
    critic: Box<dyn DeviceNetwork>,
}

impl DeviceNetworks {
    /// Makes both networks for minibatches of up to `rows` rows.
    pub fn new(
        device: &dyn NetworkDevice,
        policy: &Mlp<f32>,
        critic: &Mlp<f32>,
        rows: usize,
    ) -> Result<DeviceNetworks, NetworkError> {
        Ok(DeviceNetworks { policy: device.network(policy, rows)?, critic: device.network(critic, rows)? })
    }

    /// Sets `gradient` to the gradient and the metrics of a minibatch, in the layout of
    /// [`add_gradient`](Minibatch::add_gradient).
    pub fn gradient(&mut self, minibatch: &Minibatch<'_>, gradient: &mut [f32]) -> Result<(), NetworkError> {
        let DeviceNetworks { policy, critic } = self;
        write_inputs(minibatch, &mut **policy, &mut **critic);
        let (of_policy, of_critic) = rayon::join(|| policy.forward(), || critic.forward());
        of_policy.and(of_critic)?;
        let actions = minibatch.policy.output_size();
        let sums = write_losses(minibatch, &mut **policy, &mut **critic);
        let (of_policy, of_critic) = rayon::join(|| policy.backward(), || critic.backward());
        of_policy.and(of_critic)?;

        let (policy_gradient, rest) = gradient.split_at_mut(minibatch.policy.parameter_count());
        let (log_std_gradient, rest) = rest.split_at_mut(actions);
        let (critic_gradient, metrics) = rest.split_at_mut(minibatch.critic.parameter_count());
        policy_gradient.copy_from_slice(policy.buffers().parameter_gradient);
        critic_gradient.copy_from_slice(critic.buffers().parameter_gradient);
        log_std_gradient.copy_from_slice(&sums[..actions]);
        metrics.copy_from_slice(&sums[actions..]);
        Ok(())
    }
}

/// Writes parameters and inputs.
fn write_inputs(minibatch: &Minibatch<'_>, policy: &mut dyn DeviceNetwork, critic: &mut dyn DeviceNetwork) {
    let columns = minibatch.policy.input_size();
    let of_critic = minibatch.critic.input_size();
    let policy = policy.buffers();
    let critic = critic.buffers();
    policy.parameters.copy_from_slice(minibatch.policy.parameters());
    critic.parameters.copy_from_slice(minibatch.critic.parameters());
    minibatch
        .rows
        .par_chunks(CHUNK_ROWS)
        .zip(policy.inputs.par_chunks_mut(CHUNK_ROWS * columns))
        .zip(critic.inputs.par_chunks_mut(CHUNK_ROWS * of_critic))
        .for_each(|((rows, of_policy), critic_inputs)| {
            let of_policy = &mut of_policy[..rows.len() * columns];
            minibatch.fill_inputs(rows, of_policy);
            minibatch.fill_critic_inputs(rows, of_policy, &mut critic_inputs[..rows.len() * of_critic]);
        });
}

/// Writes the derivatives of the losses with respect to the outputs. Returns those with respect to
/// log σ, and the metrics.
fn write_losses(
    minibatch: &Minibatch<'_>,
    policy: &mut dyn DeviceNetwork,
    critic: &mut dyn DeviceNetwork,
) -> Vec<f32> {
    let actions = minibatch.policy.output_size();
    let policy = policy.buffers();
    let critic = critic.buffers();
    let count = minibatch.rows.len();
    // The last minibatch of an epoch may be smaller.
    policy.output_gradient[count * actions..].fill(0.0);
    critic.output_gradient[count..].fill(0.0);
    let chunks = minibatch
        .rows
        .par_chunks(CHUNK_ROWS)
        .zip(policy.outputs[..count * actions].par_chunks(CHUNK_ROWS * actions))
        .zip(policy.output_gradient[..count * actions].par_chunks_mut(CHUNK_ROWS * actions))
        .zip(critic.outputs[..count].par_chunks(CHUNK_ROWS))
        .zip(critic.output_gradient[..count].par_chunks_mut(CHUNK_ROWS));
    let sums: Vec<Vec<f32>> = chunks
        .map(|((((rows, means), mean_gradient), values), value_gradient)| {
            let mut sums = vec![0.0; actions + METRICS.len()];
            let (log_std_gradient, metrics) = sums.split_at_mut(actions);
            minibatch.add_policy_loss(rows, means, mean_gradient, log_std_gradient, metrics);
            minibatch.add_critic_loss(rows, values, value_gradient, metrics);
            sums
        })
        .collect();
    // In the order of the rows, so that the number of threads does not change the bits.
    let mut total = vec![0.0; actions + METRICS.len()];
    for sums in sums {
        total.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
    }
    total
}
