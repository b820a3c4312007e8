//! Policy inference for all rows of a control step.

use std::borrow::Cow;

use mishandle_controllers::{History, Policy};
use mishandle_network::{ChunkPool, Mlp, Moments, Normalizer, RunningNormalizer, Workspace};
use mishandle_rollout::EnvironmentSpec;

use crate::TrainingError;
use crate::settings::setting::require;

/// Rows per inference task: few, so that all threads get some.
pub(crate) const INFERENCE_ROWS: usize = 64;

/// Returns the normalizer of observations before the first update.
pub(crate) fn observation_normalizer(
    spec: &EnvironmentSpec,
    normalizes: bool,
    std_floor: f64,
) -> RunningNormalizer {
    let normalizer = RunningNormalizer::new(spec.observation_size);
    if normalizes { normalizer.with_floor(std_floor) } else { normalizer }
}

/// Replaces the moments of a normalizer by those of a policy. Its floor remains.
///
/// # Errors
/// Never; the policy has the moments of its inputs.
pub(crate) fn restore_normalizer(
    normalizer: &mut RunningNormalizer,
    policy: &Policy,
) -> Result<(), TrainingError> {
    let moments = Moments::resume(1.0, policy.mean().to_vec(), policy.variance().to_vec())?;
    Ok(normalizer.restore(moments)?)
}

/// Largest number of weights between the inputs and the first layer of a policy with a history.
const MAX_INPUT_WEIGHTS: usize = 10_000_000;

/// Returns the history of a policy with these hidden layers.
///
/// # Errors
/// If its controller file could be larger than the limit for reading it. The weights between hidden
/// layers have a limit of their own.
pub(crate) fn policy_history(
    spec: &EnvironmentSpec,
    length: usize,
    hidden: &[usize],
) -> Result<History, TrainingError> {
    let history = History::new(length, spec.observation_size, spec.action_size);
    let weights = history.input_size().saturating_mul(hidden.first().copied().unwrap_or(spec.action_size));
    let expected = "so short that the first layer of the policy has at most 10^7 weights";
    require("policy.history", expected, length as f64, length == 0 || weights <= MAX_INPUT_WEIGHTS)?;
    Ok(history)
}

/// Returns the first `count` columns of the rows of a matrix with `columns` columns.
pub(crate) fn first_columns(rows: &[f32], columns: usize, count: usize) -> Cow<'_, [f32]> {
    if count == columns {
        return Cow::Borrowed(rows);
    }
    Cow::Owned(rows.chunks_exact(columns).flat_map(|row| &row[..count]).copied().collect())
}

/// Network outputs and random numbers from which the actions of a control step are sampled.
pub(crate) struct BatchInference {
    pool: ChunkPool<f32, (Vec<f32>, Workspace<f32>)>,
    /// Network outputs, `[rows, outputs]`.
    pub outputs: Vec<f32>,
    /// Standard normal exploration noise, `[rows, action_size]`.
    pub noise: Vec<f64>,
}

impl BatchInference {
    /// Allocates memory for `rows` rows and a network with `outputs` outputs.
    pub fn new(rows: usize, outputs: usize, action_size: usize) -> BatchInference {
        BatchInference {
            pool: ChunkPool::new(INFERENCE_ROWS),
            outputs: vec![0.0; rows * outputs],
            noise: vec![0.0; rows * action_size],
        }
    }

    /// Computes the network outputs for the inputs of all rows, which `normalizer` normalizes.
    pub fn infer(&mut self, network: &Mlp<f32>, normalizer: &Normalizer<f32>, observations: &[f32]) {
        let columns = network.input_size();
        self.pool.map(
            observations.len() / columns,
            &mut self.outputs,
            |rows, (inputs, workspace), outputs| {
                inputs.clear();
                inputs.extend_from_slice(&observations[rows.start * columns..rows.end * columns]);
                normalizer.normalize(inputs);
                outputs.copy_from_slice(network.forward(inputs, workspace));
            },
        );
    }
}
