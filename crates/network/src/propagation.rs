//! Forward pass, backward pass (reverse-mode differentiation) and Jacobian-vector products (forward
//! mode).

use crate::matmul::{self, Epilogue, Lanes};
use crate::mlp::{Mlp, PackedLayer};
use crate::scalar::Scalar;

/// The memory of passes, reused from call to call.
///
/// It contains the values of every layer after [`Mlp::forward`], which [`Mlp::backward`] and
/// [`Mlp::tangent`] read. Use one workspace per network: then memory is allocated only when the
/// number of rows exceeds all previous ones.
#[derive(Debug, Clone, Default)]
pub struct Workspace<T> {
    rows: usize,
    /// The input, then the output of each layer.
    values: Vec<Vec<Lanes<T>>>,
    /// For each layer with layer normalization: its standardized values and the scale of each row.
    standardized: Vec<Standardized<T>>,
    /// The gradient or the tangent of the current layer and of the next one to be computed.
    derivatives: [Vec<Lanes<T>>; 2],
    /// The parameter direction of a Jacobian-vector product, layer by layer.
    direction: Vec<PackedLayer<T>>,
    /// One row of zeros, as wide as the widest layer.
    zeros: Vec<Lanes<T>>,
    outputs: Vec<T>,
    output_tangents: Vec<T>,
}

#[derive(Debug, Clone, Default)]
struct Standardized<T> {
    values: Vec<Lanes<T>>,
    scales: Vec<T>,
}

impl<T: Scalar> Workspace<T> {
    /// Returns the number of rows of the last forward pass.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Returns the outputs of the last forward pass, `[rows, output_size]`.
    pub fn outputs(&self) -> &[T] {
        &self.outputs
    }

    fn prepare(&mut self, network: &Mlp<T>, rows: usize) {
        let sizes = network.sizes();
        self.rows = rows;
        self.values.resize_with(sizes.len(), Vec::new);
        for (values, size) in self.values.iter_mut().zip(sizes) {
            matmul::resize(values, rows, *size);
        }
        self.standardized.resize_with(network.layer_count(), Standardized::default);
        let widest = sizes.iter().copied().max().unwrap_or(0);
        matmul::resize(&mut self.zeros, 1, widest);
        self.outputs.resize(rows * network.output_size(), T::ZERO);
    }

    /// Returns whether the sizes match a forward pass of `network`.
    fn fits(&self, network: &Mlp<T>) -> bool {
        let sizes = network.sizes();
        self.values.len() == sizes.len()
            && self.values.iter().zip(sizes).all(|(v, size)| v.len() == self.rows * matmul::panels(*size))
    }
}

impl<T: Scalar> Mlp<T> {
    /// Runs a forward pass: `inputs` is `[rows, input_size]`, the result `[rows, output_size]`,
    /// both row-major.
    ///
    /// The outputs of a row do not depend on the other rows, bit for bit.
    ///
    /// # Panics
    /// If the length of `inputs` is not a multiple of the input size.
    pub fn forward<'w>(&self, inputs: &[T], workspace: &'w mut Workspace<T>) -> &'w [T] {
        let columns = self.input_size();
        assert!(
            inputs.len().is_multiple_of(columns),
            "expected a multiple of {columns} inputs, found {}",
            inputs.len()
        );
        let rows = inputs.len() / columns;
        workspace.prepare(self, rows);
        if rows == 0 {
            return &workspace.outputs;
        }
        matmul::pack(inputs, columns, rows, &mut workspace.values[0]);
        for (l, layer) in self.packed.iter().enumerate() {
            let (before, after) = workspace.values.split_at_mut(l + 1);
            let activation = self.activation(l);
            let after = &mut after[0];
            let is_standardized = self.is_standardized(l);
            let epilogue = if is_standardized { Epilogue::None } else { Epilogue::Activate(activation) };
            T::product(rows, &before[l], &layer.weight, Some(&layer.bias), after, epilogue);
            if is_standardized {
                let Standardized { values, scales } = &mut workspace.standardized[l];
                scales.resize(rows, T::ZERO);
                T::standardize(self.shapes[l].outputs, after, scales);
                values.clone_from(after);
                if let Some(norm) = self.norms.get(l) {
                    norm.apply(rows, after);
                }
                T::activate(activation, after);
            }
        }
        matmul::unpack(&workspace.values[self.layer_count()], self.output_size(), &mut workspace.outputs);
        &workspace.outputs
    }

    /// Runs a backward pass at the rows of the last forward pass, for a loss ℓ that is a function
    /// of the outputs.
    ///
    /// ```text
    /// parameter_gradient += Σ_rows (∂output/∂parameters)ᵀ ∂ℓ/∂output
    /// input_gradient = (∂output/∂input)ᵀ ∂ℓ/∂output, for each row
    /// ```
    ///
    /// `output_gradient` is ∂ℓ/∂output, `[rows, output_size]`. The gradient is added to
    /// `parameter_gradient`, which has the layout of [`parameters`](Mlp::parameters).
    /// `input_gradient`, `[rows, input_size]`, is overwritten.
    ///
    /// # Panics
    /// If `workspace` does not contain a forward pass of this network, a length is wrong, or the
    /// network is not [trainable](Mlp::is_trainable).
    ///
    /// # Example
    /// ```
    /// use mishandle_network::{Activation, Mlp, Workspace};
    /// let mut network = Mlp::<f64>::new(&[2, 1], Activation::Elu, Activation::Identity)?;
    /// network.update(|parameters| parameters.copy_from_slice(&[3.0, 4.0, 0.5]));
    /// let mut workspace = Workspace::default();
    /// network.forward(&[1.0, 2.0], &mut workspace);
    /// let (mut gradient, mut input_gradient) = ([0.0; 3], [0.0; 2]);
    /// network.backward(&[10.0], &mut workspace, Some(&mut gradient), Some(&mut input_gradient));
    /// assert_eq!(gradient, [10.0, 20.0, 10.0]); // 10 x, 10
    /// assert_eq!(input_gradient, [30.0, 40.0]); // 10 W
    /// # Ok::<(), mishandle_network::NetworkError>(())
    /// ```
    pub fn backward(
        &self,
        output_gradient: &[T],
        workspace: &mut Workspace<T>,
        mut parameter_gradient: Option<&mut [T]>,
        input_gradient: Option<&mut [T]>,
    ) {
        let rows = workspace.rows;
        assert!(workspace.fits(self), "the workspace contains no forward pass of this network");
        assert!(
            self.is_trainable(),
            "networks with silu or gelu are not trained, nor those with gains of layers"
        );
        check_length("output gradient", output_gradient.len(), rows * self.output_size());
        if let Some(gradient) = &parameter_gradient {
            check_length("parameter gradient", gradient.len(), self.parameter_count());
        }
        if let Some(gradient) = &input_gradient {
            check_length("input gradient", gradient.len(), rows * self.input_size());
        }
        if rows == 0 {
            return;
        }
        let Workspace { values, standardized, derivatives: [gradient, next], zeros, .. } = workspace;
        matmul::resize(gradient, rows, self.output_size());
        matmul::pack(output_gradient, self.output_size(), rows, gradient);
        T::times_derivative(self.output_activation(), &values[self.layer_count()], gradient);
        for (l, shape) in self.shapes.iter().enumerate().rev() {
            if let Some(flat) = parameter_gradient.as_deref_mut() {
                let (weight, bias) = shape.split_mut(flat);
                T::add_transposed_product(rows, gradient, shape.outputs, &values[l], shape.inputs, weight);
                matmul::add_row_sum(rows, gradient, bias);
            }
            if l == 0 && input_gradient.is_none() {
                return;
            }
            let epilogue = if l == 0 {
                Epilogue::None
            } else {
                Epilogue::TimesDerivative(self.hidden_activation(), &values[l])
            };
            matmul::resize(next, rows, shape.inputs);
            let start = &zeros[..matmul::panels(shape.inputs)];
            T::product(rows, gradient, &self.packed_for_inputs[l], Some(start), next, epilogue);
            if l > 0 && self.is_standardized(l - 1) {
                let Standardized { values, scales } = &standardized[l - 1];
                T::times_standardize_derivative(shape.inputs, values, scales, next);
            }
            std::mem::swap(gradient, next);
        }
        if let Some(to) = input_gradient {
            matmul::unpack(gradient, self.input_size(), to);
        }
    }

    /// Computes the Jacobian-vector product at the rows of the last forward pass: the directional
    /// derivative of the outputs.
    ///
    /// ```text
    /// tangent = (∂output/∂parameters) parameter_direction + (∂output/∂input) input_direction
    /// ```
    ///
    /// `parameter_direction` has the layout of [`parameters`](Mlp::parameters), `input_direction`
    /// is `[rows, input_size]`. An absent direction is zero. The result is `[rows, output_size]`.
    /// It is exact, not a finite difference. The workspace keeps the forward pass, so `backward`
    /// may follow.
    ///
    /// # Panics
    /// If `workspace` does not contain a forward pass of this network, a length is wrong, or the
    /// network is not [trainable](Mlp::is_trainable).
    ///
    /// # Example
    /// ```
    /// use mishandle_network::{Activation, Mlp, Workspace};
    /// let mut network = Mlp::<f64>::new(&[1, 1], Activation::Elu, Activation::Tanh)?;
    /// let mut workspace = Workspace::default();
    /// network.forward(&[2.0], &mut workspace); // tanh(0 · 2 + 0) = 0, where tanh′ = 1
    /// assert_eq!(network.tangent(Some(&[3.0, 1.0]), None, &mut workspace), [7.0]); // 3 · 2 + 1
    /// # Ok::<(), mishandle_network::NetworkError>(())
    /// ```
    pub fn tangent<'w>(
        &self,
        parameter_direction: Option<&[T]>,
        input_direction: Option<&[T]>,
        workspace: &'w mut Workspace<T>,
    ) -> &'w [T] {
        let rows = workspace.rows;
        assert!(workspace.fits(self), "the workspace contains no forward pass of this network");
        assert!(
            self.is_trainable(),
            "networks with silu or gelu are not trained, nor those with gains of layers"
        );
        let Workspace {
            values,
            standardized,
            derivatives: [tangent, next],
            direction,
            zeros,
            output_tangents,
            ..
        } = workspace;
        output_tangents.clear();
        output_tangents.resize(rows * self.output_size(), T::ZERO);
        if let Some(flat) = parameter_direction {
            check_length("parameter direction", flat.len(), self.parameter_count());
            direction.resize_with(self.layer_count(), PackedLayer::default);
            for (layer, shape) in direction.iter_mut().zip(&self.shapes) {
                layer.pack(*shape, flat);
            }
        }
        if let Some(rows_of_direction) = input_direction {
            check_length("input direction", rows_of_direction.len(), rows * self.input_size());
            matmul::resize(tangent, rows, self.input_size());
            matmul::pack(rows_of_direction, self.input_size(), rows.max(1), tangent);
        }
        if rows == 0 || (parameter_direction.is_none() && input_direction.is_none()) {
            return output_tangents;
        }
        for (l, shape) in self.shapes.iter().enumerate() {
            matmul::resize(next, rows, shape.outputs);
            let is_standardized = self.is_standardized(l);
            let epilogue = if is_standardized {
                Epilogue::None
            } else {
                Epilogue::TimesDerivative(self.activation(l), &values[l + 1])
            };
            let inputs_move = l > 0 || input_direction.is_some();
            let mut start = Some(&zeros[..matmul::panels(shape.outputs)]);
            if parameter_direction.is_some() {
                let PackedLayer { weight, bias } = &direction[l];
                let epilogue = if inputs_move { Epilogue::None } else { epilogue };
                T::product(rows, &values[l], weight, Some(bias), next, epilogue);
                start = None;
            }
            if inputs_move {
                T::product(rows, tangent, &self.packed[l].weight, start, next, epilogue);
            }
            if is_standardized {
                let Standardized { values: at, scales } = &standardized[l];
                T::times_standardize_derivative(shape.outputs, at, scales, next);
                T::times_derivative(self.activation(l), &values[l + 1], next);
            }
            std::mem::swap(tangent, next);
        }
        matmul::unpack(tangent, self.output_size(), output_tangents);
        output_tangents
    }
}

#[track_caller]
fn check_length(what: &str, found: usize, expected: usize) {
    assert!(found == expected, "expected a {what} of {expected} numbers, found {found}");
}
