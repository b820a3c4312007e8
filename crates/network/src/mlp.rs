//! The network: layer sizes, activations, parameters and their names.

use crate::NetworkError;
use crate::activation::Activation;
use crate::layer_norm::Norm;
use crate::matmul::{self, Lanes};
use crate::scalar::Scalar;

/// A multi-layer perceptron.
///
/// ```text
/// y₀ = input,  y_l = f_l(W_l y_(l−1) + b_l),  output = y_L
/// ```
///
/// `f_l` is the output activation for the last layer and the hidden activation for all others. All
/// parameters are in one flat vector, layer by layer: first the weight `[outputs, inputs]`,
/// row-major, then the bias `[outputs]`. This is the order of PyTorch's `Sequential` of `Linear`
/// layers.
///
/// [With layer normalization](Mlp::with_layer_norm) each hidden layer is standardized over its
/// outputs before the activation.
///
/// The parameters of a new network are zero. Set them with [`update`](Mlp::update),
/// [`set_tensors`](Mlp::set_tensors) or an initialization function.
///
/// # Example
/// ```
/// use mishandle_network::{Activation, Mlp, Workspace};
///
/// let mut network = Mlp::<f32>::new(&[2, 1], Activation::Elu, Activation::Identity)?;
/// network.update(|parameters| parameters.copy_from_slice(&[3.0, 4.0, 0.5])); // W = [3 4], b = 0.5
/// assert_eq!(network.forward(&[1.0, 1.0, 0.0, 2.0], &mut Workspace::default()), [7.5, 8.5]);
/// # Ok::<(), mishandle_network::NetworkError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Mlp<T> {
    sizes: Vec<usize>,
    hidden_activation: Activation,
    output_activation: Activation,
    layer_norm: bool,
    /// Gain and shift of each layer except the last; empty if there are none.
    pub(crate) norms: Vec<Norm<T>>,
    parameters: Vec<T>,
    pub(crate) shapes: Vec<LayerShape>,
    /// A copy of the parameters in the layout of the matrix products.
    pub(crate) packed: Vec<PackedLayer<T>>,
    /// Each layer's weight as second operand of the product that computes the gradient of its
    /// inputs.
    pub(crate) packed_for_inputs: Vec<Vec<Lanes<T>>>,
}

/// A named tensor of a network or of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor<'a, T> {
    /// `layers.0.weight`, `layers.0.bias`, `layers.1.weight`, …
    pub name: String,
    /// `[outputs, inputs]` of a weight, `[outputs]` of a bias.
    pub shape: Vec<usize>,
    /// The numbers, row-major.
    pub values: &'a [T],
}

/// The shape of a layer, and the offset of its parameters in the flat vector.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LayerShape {
    pub inputs: usize,
    pub outputs: usize,
    pub offset: usize,
}

impl LayerShape {
    pub(crate) fn weight_count(self) -> usize {
        self.inputs * self.outputs
    }

    /// Returns the layer's weight and bias in `flat`.
    pub(crate) fn split<T>(self, flat: &[T]) -> (&[T], &[T]) {
        flat[self.offset..][..self.weight_count() + self.outputs].split_at(self.weight_count())
    }

    /// Returns the layer's weight and bias in `flat`.
    pub(crate) fn split_mut<T>(self, flat: &mut [T]) -> (&mut [T], &mut [T]) {
        flat[self.offset..][..self.weight_count() + self.outputs].split_at_mut(self.weight_count())
    }
}

/// A layer's parameters in panels, as second operand of the product with its inputs.
#[derive(Debug, Clone, Default)]
pub(crate) struct PackedLayer<T> {
    /// The transposed weight, inputs x outputs.
    pub weight: Vec<Lanes<T>>,
    /// One row of outputs.
    pub bias: Vec<Lanes<T>>,
}

impl<T: Scalar> PackedLayer<T> {
    /// Copies the layer's parameters from `flat`, a vector in the layout of the network's
    /// parameters.
    pub(crate) fn pack(&mut self, shape: LayerShape, flat: &[T]) {
        let (weight, bias) = shape.split(flat);
        self.weight.resize(
            matmul::panels(shape.inputs) * matmul::WIDTH * matmul::panels(shape.outputs),
            Lanes::ZERO,
        );
        matmul::pack_transposed(weight, shape.inputs, &mut self.weight);
        matmul::resize(&mut self.bias, 1, shape.outputs);
        matmul::pack(bias, shape.outputs, 1, &mut self.bias);
    }
}

impl<T: Scalar> Mlp<T> {
    /// Creates a network with zero parameters. `sizes` has the number of inputs, then the number of
    /// outputs of each layer.
    ///
    /// # Errors
    /// [`NetworkError::Sizes`] if there are fewer than two sizes or a size is 0.
    pub fn new(
        sizes: &[usize],
        hidden_activation: Activation,
        output_activation: Activation,
    ) -> Result<Mlp<T>, NetworkError> {
        if sizes.len() < 2 || sizes.contains(&0) {
            return Err(NetworkError::Sizes { found: sizes.to_vec() });
        }
        let mut count = 0;
        let shapes: Vec<LayerShape> = sizes
            .windows(2)
            .map(|pair| {
                let shape = LayerShape { inputs: pair[0], outputs: pair[1], offset: count };
                count += shape.weight_count() + shape.outputs;
                shape
            })
            .collect();
        let mut network = Mlp {
            sizes: sizes.to_vec(),
            hidden_activation,
            output_activation,
            layer_norm: false,
            norms: Vec::new(),
            parameters: vec![T::ZERO; count],
            shapes: shapes.clone(),
            packed: shapes.iter().map(|_| PackedLayer::default()).collect(),
            packed_for_inputs: shapes
                .iter()
                .map(|shape| {
                    vec![
                        Lanes::ZERO;
                        matmul::panels(shape.outputs) * matmul::WIDTH * matmul::panels(shape.inputs)
                    ]
                })
                .collect(),
        };
        network.pack();
        Ok(network)
    }

    /// Adds layer normalization without parameters to every layer except the last.
    ///
    /// ```text
    /// z = W_l y_(l−1) + b_l,  y_l = f_l((z − mean(z)) / √(variance(z) + 1e-5))
    /// ```
    ///
    /// # Example
    /// ```
    /// use mishandle_network::{Activation, Mlp, Workspace};
    ///
    /// let mut network = Mlp::<f32>::new(&[1, 2, 1], Activation::Identity, Activation::Identity)?.with_layer_norm();
    /// network.update(|parameters| parameters.copy_from_slice(&[1.0, 3.0, 0.0, 0.0, 5.0, 1.0, 0.5]));
    /// // z = (x, 3 x) has mean 2 x and deviations -x and x, so it becomes (-1, 1) for every x > 0: -5 + 1 + 0.5.
    /// let outputs = network.forward(&[1.0, 100.0], &mut Workspace::default()).to_vec();
    /// assert!(outputs.iter().all(|y| (y + 3.5).abs() < 1e-4));
    /// # Ok::<(), mishandle_network::NetworkError>(())
    /// ```
    #[must_use]
    pub fn with_layer_norm(mut self) -> Mlp<T> {
        self.layer_norm = true;
        self
    }

    /// Adds layer normalization with a gain and a shift per output, as PyTorch's `LayerNorm`, to
    /// every layer except the last.
    ///
    /// ```text
    /// y_l = f_l(gain (z − mean(z)) / √(variance(z) + 1e-5) + shift)
    /// ```
    ///
    /// The gains are 1 and the shifts 0 until [`set_tensors`](Mlp::set_tensors) sets them, as
    /// `layers.0.norm.weight` and `layers.0.norm.bias`. They are not among the
    /// [`parameters`](Mlp::parameters), and the network is not trainable.
    ///
    /// # Example
    /// ```
    /// use mishandle_network::{Activation, Mlp, Tensor, Workspace};
    ///
    /// let mut network = Mlp::<f32>::new(&[1, 2, 1], Activation::Identity, Activation::Identity)?.with_affine_layer_norm();
    /// let tensor = |name: &str, shape: &[usize], values| Tensor { name: name.into(), shape: shape.to_vec(), values };
    /// network.set_tensors(&[
    ///     tensor("layers.0.weight", &[2, 1], &[1.0, 3.0]),
    ///     tensor("layers.0.bias", &[2], &[0.0, 0.0]),
    ///     tensor("layers.0.norm.weight", &[2], &[2.0, 10.0]),
    ///     tensor("layers.0.norm.bias", &[2], &[0.5, 0.0]),
    ///     tensor("layers.1.weight", &[1, 2], &[1.0, 1.0]),
    ///     tensor("layers.1.bias", &[1], &[0.0]),
    /// ])?;
    /// // (x, 3 x) becomes (-1, 1), then (-2 + 0.5, 10).
    /// assert!((network.forward(&[100.0], &mut Workspace::default())[0] - 8.5).abs() < 1e-4);
    /// # Ok::<(), mishandle_network::NetworkError>(())
    /// ```
    #[must_use]
    pub fn with_affine_layer_norm(mut self) -> Mlp<T> {
        self.layer_norm = true;
        let hidden = &self.sizes[1..self.layer_count()];
        let norm = |size: &usize| Norm { gain: vec![T::ONE; *size], shift: vec![T::ZERO; *size] };
        self.norms = hidden.iter().map(norm).collect();
        self
    }

    /// Returns the number of inputs, then the number of outputs of each layer.
    pub fn sizes(&self) -> &[usize] {
        &self.sizes
    }

    /// Returns the number of inputs.
    pub fn input_size(&self) -> usize {
        self.sizes[0]
    }

    /// Returns the number of outputs.
    pub fn output_size(&self) -> usize {
        self.sizes[self.layer_count()]
    }

    /// Returns the activation of all layers except the last.
    pub fn hidden_activation(&self) -> Activation {
        self.hidden_activation
    }

    /// Returns the activation of the last layer.
    pub fn output_activation(&self) -> Activation {
        self.output_activation
    }

    /// Returns whether the network has layer normalization.
    pub fn has_layer_norm(&self) -> bool {
        self.layer_norm
    }

    /// Returns whether layer normalization has gains and shifts.
    pub fn has_affine_layer_norm(&self) -> bool {
        !self.norms.is_empty()
    }

    /// Returns whether gradients can be computed: not with activations that are not
    /// [trainable](Activation::is_trainable), nor with gains of layers.
    pub fn is_trainable(&self) -> bool {
        self.norms.is_empty()
            && self.hidden_activation.is_trainable()
            && self.output_activation.is_trainable()
    }

    /// Returns the number of parameters.
    pub fn parameter_count(&self) -> usize {
        self.parameters.len()
    }

    /// Returns all parameters: layer by layer, the weight `[outputs, inputs]`, row-major, and then
    /// the bias.
    pub fn parameters(&self) -> &[T] {
        &self.parameters
    }

    /// Calls `change` with the parameters, and returns its result.
    ///
    /// Afterwards the parameters are copied into the layout of the matrix products, which takes
    /// about 1 ns per parameter.
    pub fn update<R>(&mut self, change: impl FnOnce(&mut [T]) -> R) -> R {
        let result = change(&mut self.parameters);
        self.pack();
        result
    }

    /// Returns the network with `count` more inputs after its own, whose weights are 0.
    ///
    /// # Example
    /// ```
    /// use mishandle_network::{Activation, Mlp};
    /// let mut network = Mlp::<f32>::new(&[1, 2], Activation::Elu, Activation::Identity)?;
    /// network.update(|parameters| parameters.copy_from_slice(&[3.0, 4.0, 0.5, 0.25]));
    /// assert_eq!(network.with_more_inputs(1).parameters(), [3.0, 0.0, 4.0, 0.0, 0.5, 0.25]);
    /// # Ok::<(), mishandle_network::NetworkError>(())
    /// ```
    #[must_use]
    pub fn with_more_inputs(&self, count: usize) -> Mlp<T> {
        let mut sizes = self.sizes.clone();
        sizes[0] += count;
        let wider = Mlp::new(&sizes, self.hidden_activation, self.output_activation);
        let mut wider = wider.expect("the sizes of a network are positive");
        (wider.layer_norm, wider.norms) = (self.layer_norm, self.norms.clone());
        let (weights, rest) = self.parameters.split_at(self.shapes[0].weight_count());
        wider.update(|parameters| {
            let (wide, others) = parameters.split_at_mut(parameters.len() - rest.len());
            let rows = wide.chunks_exact_mut(sizes[0]).zip(weights.chunks_exact(self.sizes[0]));
            rows.for_each(|(wide, row)| wide[..row.len()].copy_from_slice(row));
            others.copy_from_slice(rest);
        });
        wider
    }

    /// Returns the parameters by name: `layers.0.weight`, `layers.0.bias`, `layers.1.weight`, …
    /// After the bias of a layer follow its gain `layers.0.norm.weight` and its shift
    /// `layers.0.norm.bias`, if it has them.
    pub fn tensors(&self) -> Vec<Tensor<'_, T>> {
        let mut tensors = Vec::new();
        for (l, shape) in self.shapes.iter().enumerate() {
            let (weight, bias) = shape.split(&self.parameters);
            let mut add = |name: &str, shape: Vec<usize>, values| {
                tensors.push(Tensor { name: format!("layers.{l}.{name}"), shape, values });
            };
            add("weight", vec![shape.outputs, shape.inputs], weight);
            add("bias", vec![shape.outputs], bias);
            if let Some(Norm { gain, shift }) = self.norms.get(l) {
                add("norm.weight", vec![shape.outputs], gain);
                add("norm.bias", vec![shape.outputs], shift);
            }
        }
        tensors
    }

    /// Sets all parameters from tensors in any order.
    ///
    /// # Errors
    /// If a tensor is missing, unexpected, given twice or of the wrong shape, or contains NaN or
    /// infinity. The network is then unchanged.
    ///
    /// # Example
    /// ```
    /// use mishandle_network::{Activation, Mlp};
    /// let mut source = Mlp::<f32>::new(&[3, 2, 1], Activation::Elu, Activation::Identity)?;
    /// source.update(|parameters| parameters.fill(0.5));
    /// let mut copy = Mlp::new(source.sizes(), Activation::Elu, Activation::Identity)?;
    /// copy.set_tensors(&source.tensors())?;
    /// assert_eq!(copy.parameters(), source.parameters());
    /// assert!(copy.set_tensors(&source.tensors()[1..]).is_err());
    /// # Ok::<(), mishandle_network::NetworkError>(())
    /// ```
    pub fn set_tensors(&mut self, tensors: &[Tensor<'_, T>]) -> Result<(), NetworkError> {
        let own = self.tensors();
        let known = || own.iter().map(|tensor| tensor.name.clone()).collect();
        for (i, tensor) in tensors.iter().enumerate() {
            let is_duplicate = tensors[..i].iter().any(|earlier| earlier.name == tensor.name);
            if is_duplicate || own.iter().all(|expected| expected.name != tensor.name) {
                return Err(NetworkError::UnexpectedTensor { found: tensor.name.clone(), known: known() });
            }
        }
        let mut parameters = Vec::with_capacity(self.parameters.len());
        let mut norms = Vec::new();
        for expected in &own {
            let Some(tensor) = tensors.iter().find(|tensor| tensor.name == expected.name) else {
                let given = tensors.iter().map(|tensor| tensor.name.clone()).collect();
                return Err(NetworkError::MissingTensor { expected: expected.name.clone(), given });
            };
            if tensor.shape != expected.shape || tensor.values.len() != expected.values.len() {
                return Err(NetworkError::Shape {
                    name: tensor.name.clone(),
                    expected: expected.shape.clone(),
                    found: tensor.shape.clone(),
                    numbers: tensor.values.len(),
                });
            }
            if let Some((index, value)) =
                tensor.values.iter().enumerate().find(|(_, v)| !v.to_f64().is_finite())
            {
                return Err(NetworkError::Number {
                    what: tensor.name.clone(),
                    expected: "finite",
                    index,
                    found: value.to_f64(),
                });
            }
            if expected.name.contains(".norm.") {
                norms.push(tensor.values.to_vec());
            } else {
                parameters.extend_from_slice(tensor.values);
            }
        }
        let mut norms = norms.into_iter();
        for norm in &mut self.norms {
            if let (Some(gain), Some(shift)) = (norms.next(), norms.next()) {
                *norm = Norm { gain, shift };
            }
        }
        self.update(|own| own.copy_from_slice(&parameters));
        Ok(())
    }

    pub(crate) fn layer_count(&self) -> usize {
        self.sizes.len() - 1
    }

    /// Returns the activation of layer `l`, counted from 0.
    pub(crate) fn activation(&self, l: usize) -> Activation {
        if l + 1 == self.layer_count() { self.output_activation } else { self.hidden_activation }
    }

    /// Returns whether layer `l`, counted from 0, has layer normalization.
    pub(crate) fn is_standardized(&self, l: usize) -> bool {
        self.layer_norm && l + 1 < self.layer_count()
    }

    fn pack(&mut self) {
        for (l, shape) in self.shapes.iter().enumerate() {
            self.packed[l].pack(*shape, &self.parameters);
            let padded = matmul::panels(shape.outputs) * matmul::WIDTH;
            matmul::pack(
                shape.split(&self.parameters).0,
                shape.inputs,
                padded,
                &mut self.packed_for_inputs[l],
            );
        }
    }
}
