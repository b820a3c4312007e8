"""Writes cases.json: PyTorch's results for small networks, in double precision.

    python3 -m venv venv && venv/bin/pip install -r requirements.txt && venv/bin/python make.py

Run it in this folder. Numbers are rounded to twelve digits, so that the file does not depend on the order of PyTorch's sums.
"""

import json
import warnings

warnings.filterwarnings("ignore", message=".*NumPy.*")
import torch
from torch import nn

ACTIVATIONS = {"elu": nn.ELU, "tanh": nn.Tanh, "relu": nn.ReLU, "identity": nn.Identity}
NETWORKS = [
    ([5, 17, 3], "elu", "identity"),
    ([5, 17, 3], "tanh", "tanh"),
    ([5, 17, 3], "relu", "identity"),
    ([7, 20, 16, 4], "elu", "tanh"),
    ([2, 3], "elu", "elu"),
]
ROWS = 9
ADAM_STEPS = 3
LEARNING_RATE = 0.01
MAX_NORM = 0.5


def numbers(tensor):
    return [float(f"{x:.12g}") for x in tensor.detach().flatten().tolist()]


def random(generator, *shape):
    """Numbers that f32 represents exactly, so that both precisions start from the same values."""
    return torch.randn(*shape, generator=generator, dtype=torch.float32).double()


def flat(tensors):
    return torch.cat([tensor.flatten() for tensor in tensors])


def build(sizes, hidden, output):
    layers = []
    for i, (inputs, outputs) in enumerate(zip(sizes, sizes[1:])):
        last = i + 2 == len(sizes)
        layers += [nn.Linear(inputs, outputs).double(), ACTIVATIONS[output if last else hidden]()]
    return nn.Sequential(*layers)


def split(vector, parameters):
    parts = vector.split([parameter.numel() for parameter in parameters.values()])
    return {name: part.view_as(parameters[name]) for name, part in zip(parameters, parts)}


def network_case(sizes, hidden, output, generator):
    network = build(sizes, hidden, output)
    named = dict(network.named_parameters())
    with torch.no_grad():
        for parameter in named.values():
            parameter.copy_(random(generator, *parameter.shape) * 0.5)
            parameter.copy_(parameter.float().double())
    inputs = (random(generator, ROWS, sizes[0]) * 2).requires_grad_()
    output_gradient = random(generator, ROWS, sizes[-1])
    parameter_direction = random(generator, sum(p.numel() for p in named.values()))
    input_direction = random(generator, ROWS, sizes[0])
    case = {
        "sizes": sizes,
        "hidden_activation": hidden,
        "output_activation": output,
        "parameters": numbers(flat(named.values())),
        "inputs": numbers(inputs),
        "output_gradient": numbers(output_gradient),
        "parameter_direction": numbers(parameter_direction),
        "input_direction": numbers(input_direction),
    }

    outputs = network(inputs)
    gradients = torch.autograd.grad(outputs, [inputs, *named.values()], output_gradient)
    case["outputs"] = numbers(outputs)
    case["input_gradient"] = numbers(gradients[0])
    case["parameter_gradient"] = numbers(flat(gradients[1:]))

    _, tangent = torch.func.jvp(
        lambda parameters, x: torch.func.functional_call(network, parameters, (x,)),
        (named, inputs),
        (split(parameter_direction, named), input_direction),
    )
    case["tangent"] = numbers(tangent)

    # Steps on the mean of (y - target)^2, with the output gradient as target.
    adam = torch.optim.Adam(network.parameters(), lr=LEARNING_RATE)
    norms = []
    for _ in range(ADAM_STEPS):
        adam.zero_grad()
        nn.functional.mse_loss(network(inputs.detach()), output_gradient).backward()
        norms.append(nn.utils.clip_grad_norm_(network.parameters(), MAX_NORM))
        adam.step()
    case["gradient_norms"] = numbers(torch.stack(norms))
    case["parameters_after_adam"] = numbers(flat(network.parameters()))
    return case


def orthogonal_case(rows, columns, gain, seed):
    normal = torch.empty(rows, columns, dtype=torch.float64).normal_(0, 1, generator=torch.Generator().manual_seed(seed))
    generator = torch.Generator().manual_seed(seed)
    weight = nn.init.orthogonal_(torch.empty(rows, columns, dtype=torch.float64), gain, generator=generator)
    return {"rows": rows, "columns": columns, "gain": gain, "normal": numbers(normal), "weight": numbers(weight)}


def main():
    generator = torch.Generator().manual_seed(1)
    document = {
        "made_by": f"PyTorch {torch.__version__.split('+')[0]}",
        "learning_rate": LEARNING_RATE,
        "max_norm": MAX_NORM,
        "networks": [network_case(*network, generator) for network in NETWORKS],
        "orthogonal": [orthogonal_case(6, 4, 0.5, 1), orthogonal_case(4, 6, 1.0, 2), orthogonal_case(5, 5, 2.0, 3)],
    }
    with open("cases.json", "w", encoding="utf-8") as file:
        json.dump(document, file, separators=(",", ":"))
        file.write("\n")


if __name__ == "__main__":
    main()
