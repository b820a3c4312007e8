"""Networks on an NVIDIA GPU, for the learner of ``mishandle train -k train.device=gpu``: forward
and backward passes of multilayer perceptrons.

The learner keeps parameters, losses and optimizer. It calls :meth:`WarpNetwork.forward` and
:meth:`WarpNetwork.backward` instead of the same passes on the CPU.
"""

# The annotations of kernels are calls, which type checkers reject.
# mypy: ignore-errors
# pyright: basic

from collections.abc import Sequence

from mishandle.gpu.batches import CPU_LOCK, find_device, wp

ROWS = wp.constant(64)
COLUMNS = wp.constant(32)
DEPTH = wp.constant(32)
"""Shape of the tiles of a matrix product: rows and columns of the result, and length of the inner
products."""

SPLITS = 16
"""Parts of a minibatch whose gradients are computed in parallel, and then added in a fixed
order."""

BLOCK = 64
"""Threads per tile."""

LEAKY_SLOPE = wp.constant(0.01)

OPTIONS = {"enable_backward": False, "enable_mathdx_gemm": False}
"""Warp's own products of tiles: those of cuBLASDx take more than a minute to compile."""


@wp.func
def elu(x: float) -> float:
    return wp.where(x > 0.0, x, wp.exp(x) - 1.0)


@wp.func
def elu_derivative(gradient: float, y: float) -> float:
    return gradient * wp.where(y > 0.0, 1.0, y + 1.0)


@wp.func
def tanh(x: float) -> float:
    return wp.tanh(x)


@wp.func
def tanh_derivative(gradient: float, y: float) -> float:
    return gradient * (1.0 - y * y)


@wp.func
def relu(x: float) -> float:
    return wp.max(x, 0.0)


@wp.func
def relu_derivative(gradient: float, y: float) -> float:
    return wp.where(y > 0.0, gradient, 0.0)


@wp.func
def leaky_relu(x: float) -> float:
    return wp.where(x > 0.0, x, LEAKY_SLOPE * x)


@wp.func
def leaky_relu_derivative(gradient: float, y: float) -> float:
    return wp.where(y > 0.0, gradient, LEAKY_SLOPE * gradient)


@wp.func
def identity(x: float) -> float:
    return x


ACTIVATIONS = {
    "elu": (elu, elu_derivative),
    "tanh": (tanh, tanh_derivative),
    "relu": (relu, relu_derivative),
    "leaky_relu": (leaky_relu, leaky_relu_derivative),
}
"""For each activation of hidden layers: y(x), and the gradient with respect to x from that with
respect to y, and y."""


def layer_kernel(activation):
    """Makes a kernel that computes y = activation(x Wᵀ + b)."""

    @wp.kernel(module="unique", module_options=OPTIONS)
    def layer(
        x: wp.array2d(dtype=float), weight: wp.array2d(dtype=float), bias: wp.array(dtype=float),
        y: wp.array2d(dtype=float)
    ) -> None:
        i, j = wp.tid()
        total = wp.tile_zeros(shape=(ROWS, COLUMNS), dtype=float)
        for k in range((x.shape[1] + DEPTH - 1) // DEPTH):
            left = wp.tile_load(x, shape=(ROWS, DEPTH), offset=(i * ROWS, k * DEPTH))
            right = wp.tile_load(weight, shape=(COLUMNS, DEPTH), offset=(j * COLUMNS, k * DEPTH))
            wp.tile_matmul(left, wp.tile_transpose(right), total)
        row = wp.tile_load(bias, shape=COLUMNS, offset=j * COLUMNS)
        z = total + wp.tile_broadcast(row, shape=(ROWS, COLUMNS))
        wp.tile_store(y, wp.tile_map(wp.static(activation), z), offset=(i * ROWS, j * COLUMNS))

    return layer


def input_gradient_kernel(derivative):
    """Makes a kernel that computes the gradient before the previous layer's activation:
    derivative(gradient W, y)."""

    @wp.kernel(module="unique", module_options=OPTIONS)
    def input_gradient(
        gradient: wp.array2d(dtype=float), weight: wp.array2d(dtype=float),
        y: wp.array2d(dtype=float), before: wp.array2d(dtype=float)
    ) -> None:
        i, j = wp.tid()
        total = wp.tile_zeros(shape=(ROWS, COLUMNS), dtype=float)
        for k in range((weight.shape[0] + DEPTH - 1) // DEPTH):
            left = wp.tile_load(gradient, shape=(ROWS, DEPTH), offset=(i * ROWS, k * DEPTH))
            right = wp.tile_load(weight, shape=(DEPTH, COLUMNS), offset=(k * DEPTH, j * COLUMNS))
            wp.tile_matmul(left, right, total)
        values = wp.tile_load(y, shape=(ROWS, COLUMNS), offset=(i * ROWS, j * COLUMNS))
        wp.tile_store(
            before, wp.tile_map(wp.static(derivative), total, values),
            offset=(i * ROWS, j * COLUMNS)
        )

    return input_gradient


@wp.kernel(module="unique", module_options=OPTIONS)
def weight_gradient(
    gradient: wp.array2d(dtype=float), x: wp.array2d(dtype=float), tiles: int, stride: int,
    partial: wp.array2d(dtype=float)
) -> None:
    """Computes gradientᵀ x over the ``tiles`` row tiles of each part; the result of a part has
    ``stride`` rows."""
    part, i, j = wp.tid()
    total = wp.tile_zeros(shape=(COLUMNS, COLUMNS), dtype=float)
    for k in range(tiles):
        row = (part * tiles + k) * ROWS
        left = wp.tile_load(gradient, shape=(ROWS, COLUMNS), offset=(row, i * COLUMNS))
        right = wp.tile_load(x, shape=(ROWS, COLUMNS), offset=(row, j * COLUMNS))
        wp.tile_matmul(wp.tile_transpose(left), right, total)
    wp.tile_store(partial, total, offset=(part * stride + i * COLUMNS, j * COLUMNS))


@wp.kernel(module="unique", module_options=OPTIONS)
def bias_gradient(
    gradient: wp.array2d(dtype=float), rows: int, partial: wp.array2d(dtype=float)
) -> None:
    """Adds up the ``rows`` rows of each part."""
    part, column = wp.tid()
    total = float(0.0)
    for row in range(part * rows, wp.min((part + 1) * rows, gradient.shape[0])):
        total += gradient[row, column]
    partial[part, column] = total


@wp.kernel(module="unique", module_options=OPTIONS)
def add_parts(
    partial: wp.array2d(dtype=float), parts: int, stride: int, total: wp.array2d(dtype=float)
) -> None:
    row, column = wp.tid()
    value = float(0.0)
    for part in range(parts):
        value += partial[part * stride + row, column]
    total[row, column] = value


_layers: dict = {}


def _kernels(name: str):
    """Returns the kernels of an activation; each is made once."""
    if name not in _layers:
        forward, derivative = ACTIVATIONS[name]
        _layers[name] = (layer_kernel(forward), input_gradient_kernel(derivative))
    return _layers[name]


_output_layer = layer_kernel(identity)


class WarpNetwork:
    """A multilayer perceptron whose output layer has no activation.

    Arguments: the number of inputs, then the number of outputs of each layer; the activation of the
    hidden layers; the number of rows of a pass; and the device.
    """

    def __init__(
        self, sizes: Sequence[int], activation: str, rows: int, name: str | None = None
    ) -> None:
        self._device = find_device(name)
        self._sizes, self._rows = list(sizes), rows
        self._layer, self._input_gradient = _kernels(activation)
        self._is_cuda = self._device.is_cuda
        with wp.ScopedDevice(self._device):
            self._allocate()
            self._record()

    def _allocate(self) -> None:
        rows, sizes = self._rows, self._sizes
        layers = list(zip(sizes[:-1], sizes[1:]))
        parameters = sum(outputs * (inputs + 1) for inputs, outputs in layers)
        shapes = {
            "parameters": parameters,
            "inputs": rows * sizes[0],
            "outputs": rows * sizes[-1],
            "output_gradient": rows * sizes[-1],
            "parameter_gradient": parameters,
        }
        self._host = {
            name: wp.zeros(size, dtype=float, device="cpu", pinned=self._is_cuda)
            for name, size in shapes.items()
        }
        # On the CPU, the kernels read and write the host's buffers.
        self._there = {
            name: wp.zeros(size, dtype=float) if self._is_cuda else self._host[name]
            for name, size in shapes.items()
        }
        there = self._there
        hidden = [wp.zeros((rows, size), dtype=float) for size in sizes[1:-1]]
        self._values = [
            there["inputs"].reshape((rows, sizes[0])), *hidden,
            there["outputs"].reshape((rows, sizes[-1]))
        ]
        # The gradients before the activations of each layer.
        self._gradients = [wp.zeros((rows, size), dtype=float) for size in sizes[1:-1]]
        self._gradients.append(there["output_gradient"].reshape((rows, sizes[-1])))
        self._weights, self._biases, self._weight_gradients, self._bias_gradients = [], [], [], []
        offset = 0
        for inputs, outputs in layers:
            end = offset + inputs * outputs
            for source, weights, biases in (
                ("parameters", self._weights, self._biases),
                ("parameter_gradient", self._weight_gradients, self._bias_gradients),
            ):
                weights.append(there[source][offset:end].reshape((outputs, inputs)))
                biases.append(there[source][end : end + outputs])
            offset = end + outputs
        self._tiles = max(1, -(-rows // (SPLITS * int(ROWS))))
        self._parts = -(-rows // (self._tiles * int(ROWS)))
        self._strides = [_tiles(outputs) * int(COLUMNS) for outputs in sizes[1:]]
        widest = max(sizes[:-1])
        self._partial_weights = wp.zeros((self._parts * max(self._strides), widest), dtype=float)
        self._partial_biases = wp.zeros((self._parts, max(sizes[1:])), dtype=float)

    def _record(self) -> None:
        """Records both passes as CUDA graphs, after a first run that compiles the kernels."""
        self._graphs, self._stream = {}, None
        if not self._is_cuda:
            return
        self._stream = wp.Stream(self._device)
        with wp.ScopedStream(self._stream):
            for name, run in (("forward", self._forward), ("backward", self._backward)):
                run()
                wp.synchronize_stream(self._stream)
                with wp.ScopedCapture(stream=self._stream, force_module_load=False) as capture:
                    run()
                self._graphs[name] = capture.graph

    def _forward(self) -> None:
        self._copy_in("parameters", "inputs")
        last = len(self._weights) - 1
        for index, (weight, bias) in enumerate(zip(self._weights, self._biases)):
            x, y = self._values[index : index + 2]
            self._launch(
                _output_layer if index == last else self._layer,
                (_tiles(self._rows, int(ROWS)), _tiles(weight.shape[0])), [x, weight, bias, y]
            )
        self._copy_out("outputs")

    def _backward(self) -> None:
        self._copy_in("output_gradient")
        for index in range(len(self._weights) - 1, -1, -1):
            weight, gradient, x = self._weights[index], self._gradients[index], self._values[index]
            outputs, inputs = weight.shape
            stride = self._strides[index]
            partial = wp.array(
                ptr=self._partial_weights.ptr, dtype=float, shape=(self._parts * stride, inputs),
                device=self._device
            )
            tiles = (self._parts, _tiles(outputs), _tiles(inputs))
            self._launch(weight_gradient, tiles, [gradient, x, self._tiles, stride, partial])
            wp.launch(
                add_parts, (outputs, inputs),
                [partial, self._parts, stride, self._weight_gradients[index]]
            )
            rows = self._tiles * int(ROWS)
            wp.launch(bias_gradient, (self._parts, outputs), [gradient, rows, self._partial_biases])
            total = self._bias_gradients[index].reshape((1, outputs))
            wp.launch(add_parts, (1, outputs), [self._partial_biases, self._parts, 1, total])
            if index > 0:
                self._launch(
                    self._input_gradient, (_tiles(self._rows, int(ROWS)), _tiles(inputs)),
                    [gradient, weight, x, self._gradients[index - 1]]
                )
        self._copy_out("parameter_gradient")

    def _launch(self, kernel, dim: tuple[int, ...], inputs: list) -> None:
        wp.launch_tiled(kernel, dim=dim, inputs=inputs, block_dim=BLOCK)

    def _copy_in(self, *names: str) -> None:
        if self._is_cuda:
            for name in names:
                wp.copy(self._there[name], self._host[name])

    def _copy_out(self, name: str) -> None:
        if self._is_cuda:
            wp.copy(self._host[name], self._there[name])

    def buffers(self) -> dict[str, tuple[int, int]]:
        """Returns the address and the number of elements (32-bit floats) of each buffer of the
        host:

        - ``parameters``: weights ``[outputs, inputs]`` and biases of the layers, one layer after
          another
        - ``inputs``, ``outputs``: of :meth:`forward`, row-major
        - ``output_gradient``, ``parameter_gradient``: of :meth:`backward`
        """
        return {name: (int(buffer.ptr), int(buffer.size)) for name, buffer in self._host.items()}

    def forward(self) -> None:
        """Computes ``outputs`` from ``parameters`` and ``inputs``."""
        self._run("forward", self._forward)

    def backward(self) -> None:
        """Computes ``parameter_gradient`` from ``output_gradient``, at the inputs and parameters of
        the last forward pass."""
        self._run("backward", self._backward)

    def _run(self, name: str, run) -> None:
        if not self._is_cuda:
            with CPU_LOCK, wp.ScopedDevice(self._device):
                run()
            return
        wp.capture_launch(self._graphs[name], stream=self._stream)
        wp.synchronize_stream(self._stream)


def _tiles(size: int, tile: int = int(COLUMNS)) -> int:
    return -(-size // tile)
