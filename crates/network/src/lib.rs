//! Multi-layer perceptrons: forward, backward, tangents, Adam, running normalisers.
//!
//! A network is an [`Mlp`]: sizes, two activations and one flat vector of parameters. Passes run in a [`Workspace`] that
//! the caller owns and reuses, so a pass in a loop allocates nothing. [`ChunkPool`] spreads a batch over threads.
//!
//! Two laws hold, bit for bit, on one build and architecture:
//!
//! - a row's result never depends on how many rows are computed with it;
//! - a sum over a batch depends on the size of its chunks and never on the number of threads.
//!
//! The crate draws no random numbers: initialisers are given theirs. It knows no policies, no losses and no files.
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
pub mod elementary;
mod initialization;
mod lanes;
mod layer_norm;
mod mlp;
mod normalizer;
mod pass;
mod scalar;

pub use activation::Activation;
pub use adam::{Adam, clip_norm};
pub use chunks::{CHUNK_ROWS, ChunkPool};
pub use mlp::{Mlp, Tensor};
pub use normalizer::{Moments, Normalizer, RunningNormalizer};
pub use pass::Workspace;
pub use scalar::Scalar;

/// Why a network, its optimiser or its normaliser cannot be made from what was given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// The sizes do not describe a network.
    #[error("a network needs an input and an output size, all sizes at least 1; found {found:?}")]
    Sizes {
        /// The sizes as given.
        found: Vec<usize>,
    },
    /// A name that is no activation.
    #[error("activation `{found}` is not known; known are: elu, tanh, relu, identity")]
    UnknownActivation {
        /// The name as given.
        found: String,
    },
    /// A vector whose length does not fit.
    #[error("`{what}` needs {wanted} numbers, found {found}")]
    Length {
        /// What the numbers are.
        what: String,
        /// How many there should be.
        wanted: usize,
        /// How many there are.
        found: usize,
    },
    /// A tensor that the network has and the given ones lack.
    #[error("tensor `{wanted}` is missing; given are: {}", given.join(", "))]
    MissingTensor {
        /// The name looked for.
        wanted: String,
        /// The names given.
        given: Vec<String>,
    },
    /// A tensor that the network does not have, or one given twice.
    #[error("tensor `{found}` does not belong here; this network holds, once each: {}", known.join(", "))]
    UnexpectedTensor {
        /// The name given.
        found: String,
        /// The names of the network's tensors.
        known: Vec<String>,
    },
    /// A tensor of another shape.
    #[error(
        "tensor `{name}` needs the shape {wanted:?} and as many numbers, found {found:?} and {numbers} numbers"
    )]
    Shape {
        /// The tensor's name.
        name: String,
        /// The shape of the network's tensor.
        wanted: Vec<usize>,
        /// The shape given.
        found: Vec<usize>,
        /// How many numbers were given.
        numbers: usize,
    },
    /// A number that is NaN, infinite or out of its range.
    #[error("`{what}` must be {wanted}; number {index} is {found}")]
    Number {
        /// What the number belongs to.
        what: String,
        /// What it should be.
        wanted: &'static str,
        /// Its place, counted from 0.
        index: usize,
        /// The number found.
        found: f64,
    },
}
