//! Networks on another device than the CPU.

use crate::{Mlp, NetworkError};

/// Computes networks on another device than the CPU, such as a GPU.
pub trait NetworkDevice: Send + Sync {
    /// Makes a network of the layers of `network` for passes of up to `rows` rows.
    ///
    /// # Errors
    /// If the device is not available, or it cannot compute such a network.
    fn network(&self, network: &Mlp<f32>, rows: usize) -> Result<Box<dyn DeviceNetwork>, NetworkError>;
}

/// A network on a device. Its passes are those of [`Mlp::forward`] and [`Mlp::backward`], up to
/// rounding.
pub trait DeviceNetwork: Send {
    /// Returns the buffers.
    fn buffers(&mut self) -> DeviceBuffers<'_>;

    /// Computes the outputs from parameters and inputs.
    ///
    /// # Errors
    /// If the device fails.
    fn forward(&mut self) -> Result<(), NetworkError>;

    /// Computes the parameter gradient from the output gradient, at the parameters and inputs of
    /// the last forward pass.
    ///
    /// # Errors
    /// If the device fails.
    fn backward(&mut self) -> Result<(), NetworkError>;
}

/// Buffers of a network on a device. Those with rows are row-major and have the maximum number of
/// rows; a row whose output gradient is 0 does not contribute to the parameter gradient.
#[derive(Debug)]
pub struct DeviceBuffers<'a> {
    /// Parameters, in the layout of [`Mlp::parameters`].
    pub parameters: &'a mut [f32],
    /// Inputs, `[rows, input_size]`.
    pub inputs: &'a mut [f32],
    /// Outputs, `[rows, output_size]`.
    pub outputs: &'a mut [f32],
    /// Derivatives of the loss with respect to the outputs, `[rows, output_size]`.
    pub output_gradient: &'a mut [f32],
    /// Derivatives of the loss with respect to the parameters, in the layout of
    /// [`Mlp::parameters`].
    pub parameter_gradient: &'a mut [f32],
}
