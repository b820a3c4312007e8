//! Multi-layer perceptrons on the CPU: forward and backward passes, Jacobian-vector products, the
//! optimizer Adam, and running normalizers of observations.
//!
//! A network is an [`Mlp`]: layer sizes, two activations and one flat vector of parameters. Passes
//! run in a [`Workspace`] that the caller owns and reuses, so repeated passes do not allocate.
//! [`ChunkPool`] distributes a batch over threads.
//!
//! Results are reproducible bit for bit on one build and architecture:
//!
//! - the result of a row does not depend on the other rows of the batch;
//! - a sum over a batch depends on the chunk size but not on the number of threads.
//!
//! The crate generates no random numbers: the caller passes them to the initialization functions.
//! It has no policies, no losses and no file formats.
//!
//! # Example
//! ```
//! use mishandle_network::{Activation, Adam, Mlp, Workspace};
//!
//! let mut network = Mlp::<f32>::new(&[1, 1], Activation::Elu, Activation::Identity)?;
//! let (mut workspace, mut adam) = (Workspace::default(), Adam::new(network.parameter_count(), 0.1));
//! let (inputs, targets) = ([0.0, 1.0, 2.0], [1.0, 3.0, 5.0]); // three rows of y = 2 x + 1
//! for _ in 0..400 {
//!     let outputs = network.forward(&inputs, &mut workspace);
//!     let error: Vec<f32> = outputs.iter().zip(targets).map(|(y, t)| y - t).collect();
//!     let mut gradient = vec![0.0; network.parameter_count()];
//!     network.backward(&error, &mut workspace, Some(&mut gradient), None);
//!     network.update(|parameters| adam.step(parameters, &gradient));
//! }
//! assert!((network.forward(&[3.0], &mut workspace)[0] - 7.0).abs() < 1e-2);
//! # Ok::<(), mishandle_network::NetworkError>(())
//! ```

mod activation;
mod adam;
mod chunks;
mod device;
pub mod elementary;
mod initialization;
mod layer_norm;
mod matmul;
mod mlp;
mod normalizer;
mod propagation;
mod scalar;

pub use activation::{Activation, LEAKY_SLOPE};
pub use adam::{Adam, clip_norm};
pub use chunks::{CHUNK_ROWS, ChunkPool};
pub use device::{DeviceBuffers, DeviceNetwork, NetworkDevice};
pub use mlp::{Mlp, Tensor};
pub use normalizer::{Moments, Normalizer, RunningNormalizer};
pub use propagation::Workspace;
pub use scalar::Scalar;

/// The error of creating a network, an optimizer or a normalizer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// Invalid layer sizes.
    #[error("the layer sizes are {found:?}; expected at least an input and an output size, each at least 1")]
    Sizes {
        /// The given sizes.
        found: Vec<usize>,
    },
    /// A failure of another device, or a network that it cannot compute.
    #[error("{reason}")]
    Device {
        /// Reason.
        reason: String,
    },
    /// An unknown name of an activation.
    #[error(
        "activation `{found}` is not known; known activations: elu, tanh, relu, leaky_relu, silu, gelu, identity"
    )]
    UnknownActivation {
        /// The given name.
        found: String,
    },
    /// A vector of the wrong length.
    #[error("`{what}` has {found} numbers; expected {expected}")]
    Length {
        /// The name of the vector.
        what: String,
        /// The expected length.
        expected: usize,
        /// The given length.
        found: usize,
    },
    /// A missing tensor.
    #[error("tensor `{expected}` is missing; given tensors: {}", given.join(", "))]
    MissingTensor {
        /// The name of the tensor.
        expected: String,
        /// The names of the given tensors.
        given: Vec<String>,
    },
    /// A tensor that the network does not have, or a duplicate.
    #[error("unexpected tensor `{found}`; this network has, once each: {}", known.join(", "))]
    UnexpectedTensor {
        /// The name of the tensor.
        found: String,
        /// The names of the network's tensors.
        known: Vec<String>,
    },
    /// A tensor of the wrong shape.
    #[error(
        "tensor `{name}` must have the shape {expected:?}, found the shape {found:?} with {numbers} numbers"
    )]
    Shape {
        /// The tensor's name.
        name: String,
        /// The expected shape.
        expected: Vec<usize>,
        /// The given shape.
        found: Vec<usize>,
        /// The number of given numbers.
        numbers: usize,
    },
    /// A number that is NaN, infinite or out of its range.
    #[error("number {index} of `{what}` is {found}; it must be {expected}")]
    Number {
        /// The name of the vector.
        what: String,
        /// The allowed range.
        expected: &'static str,
        /// The index of the number, from 0.
        index: usize,
        /// The number.
        found: f64,
    },
}
