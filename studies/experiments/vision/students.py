"""Policies that see, and their form as ONNX controllers.

`Student` has a spatial softmax for each camera and returns one action. `ChunkStudent` returns the actions of the next
control steps by attention over image patches, as in ACT (Zhao et al., RSS 2023), but without its variational encoder:
the expert is deterministic, so there is no style to encode.
"""

import json

import numpy as np
import onnx
import torch
from torch import nn

PROPRIOCEPTION = ["joint_positions", "joint_velocities"]
PROPRIOCEPTION_SIZE = 18
ACTIONS = 9


def to_unit(image):
    """Turns bytes [N, height, width, 3], as the program gives them, into numbers from -1 to 1, channels first."""
    return image.permute(0, 3, 1, 2).float() / 127.5 - 1


class Eye(nn.Module):
    """Points in an image: a spatial softmax of each channel (Levine et al., JMLR 2016), and means."""

    def __init__(self, size, channels):
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(3, channels, 5, stride=2, padding=2), nn.ReLU(),
            nn.Conv2d(channels, channels, 3, padding=1), nn.ReLU(),
            nn.Conv2d(channels, channels, 3, padding=1),
        )
        self.temperature = nn.Parameter(torch.ones(channels, 1))
        line = torch.linspace(-1, 1, size // 2)
        y, x = torch.meshgrid(line, line, indexing="ij")
        self.register_buffer("places", torch.stack([x.flatten(), y.flatten()], 1))

    def forward(self, image):
        found = self.layers(to_unit(image)).flatten(2)
        weights = torch.softmax(found * self.temperature, 2)
        return torch.cat([(weights @ self.places).flatten(1), (weights * found).sum(2)], 1)


class Student(nn.Module):
    chunk = 1

    def __init__(self, options, state_size, statistics):
        super().__init__()
        cameras = options.cameras.split(",")
        self.eyes = nn.ModuleList(Eye(options.size, options.channels) for _ in cameras)
        features = 3 * options.channels * len(cameras) + PROPRIOCEPTION_SIZE
        wide = options.hidden
        self.trunk = nn.Sequential(nn.Linear(features, wide), nn.ReLU())
        self.auxiliary = nn.Linear(wide, state_size)
        self.head = nn.Sequential(
            nn.Linear(wide + state_size + PROPRIOCEPTION_SIZE, wide), nn.ReLU(),
            nn.Linear(wide, wide), nn.ReLU(), nn.Linear(wide, ACTIONS),
        )
        self.register_buffer("mean", statistics[0][:PROPRIOCEPTION_SIZE].clone())
        self.register_buffer("scale", statistics[1][:PROPRIOCEPTION_SIZE].clone())

    def all(self, proprioception, *images):
        """Returns the actions [N, 1, 9] and the estimate of the rest of the observation, normalized."""
        body = (proprioception - self.mean) / self.scale
        seen = [eye(image) for eye, image in zip(self.eyes, images)]
        trunk = self.trunk(torch.cat([*seen, body], 1))
        state = self.auxiliary(trunk)
        return self.head(torch.cat([trunk, state, body], 1))[:, None], state

    def forward(self, proprioception, *images):
        return self.all(proprioception, *images)[0][:, 0]


class Attention(nn.Module):
    """Multi-head attention of one set of tokens to another, and a perceptron, both with a skip connection."""

    def __init__(self, wide, heads):
        super().__init__()
        self.heads = heads
        self.before, self.between = nn.LayerNorm(wide), nn.LayerNorm(wide)
        self.query, self.key, self.value, self.join = (nn.Linear(wide, wide) for _ in range(4))
        self.perceptron = nn.Sequential(nn.Linear(wide, 2 * wide), nn.ReLU(), nn.Linear(2 * wide, wide))

    def split(self, tokens):
        return tokens.reshape(tokens.shape[0], tokens.shape[1], self.heads, -1).transpose(1, 2)

    def forward(self, tokens, memory=None):
        own = self.before(tokens)
        memory = own if memory is None else memory
        query, key, value = self.split(self.query(own)), self.split(self.key(memory)), self.split(self.value(memory))
        weights = torch.softmax(query @ key.transpose(2, 3) / query.shape[-1] ** 0.5, 3)
        tokens = tokens + self.join((weights @ value).transpose(1, 2).flatten(2))
        return tokens + self.perceptron(self.between(tokens))


class ChunkStudent(nn.Module):
    def __init__(self, options, state_size, statistics):
        super().__init__()
        cameras = options.cameras.split(",")
        self.chunk, wide, heads = options.chunk, 96, 4
        self.eyes = nn.ModuleList(
            nn.Sequential(
                nn.Conv2d(3, 32, 5, stride=2, padding=2), nn.ReLU(),
                nn.Conv2d(32, 64, 3, stride=2, padding=1), nn.ReLU(),
                nn.Conv2d(64, wide, 3, stride=2, padding=1),
            )
            for _ in cameras
        )
        patches = (options.size // 8) ** 2
        self.places = nn.Parameter(0.02 * torch.randn(1, patches * len(cameras) + 1, wide))
        self.body = nn.Linear(PROPRIOCEPTION_SIZE, wide)
        self.encoder = nn.ModuleList(Attention(wide, heads) for _ in range(2))
        self.steps = nn.Parameter(0.02 * torch.randn(1, self.chunk, wide))
        self.decoder = nn.ModuleList(Attention(wide, heads) for _ in range(2))
        self.last = nn.LayerNorm(wide)
        self.head = nn.Linear(wide, ACTIONS)
        self.auxiliary = nn.Linear(wide, state_size)
        self.register_buffer("mean", statistics[0][:PROPRIOCEPTION_SIZE].clone())
        self.register_buffer("scale", statistics[1][:PROPRIOCEPTION_SIZE].clone())

    def all(self, proprioception, *images):
        """Returns the actions [N, chunk, 9] and the estimate of the rest of the observation, normalized."""
        body = self.body((proprioception - self.mean) / self.scale)[:, None]
        seen = [eye(to_unit(image)).flatten(2).transpose(1, 2) for eye, image in zip(self.eyes, images)]
        tokens = torch.cat([*seen, body], 1) + self.places
        for layer in self.encoder:
            tokens = layer(tokens)
        steps = self.steps + body
        for layer in self.decoder:
            steps = layer(steps, tokens)
        return self.head(self.last(steps)), self.auxiliary(tokens.mean(1))

    def forward(self, proprioception, *images):
        return self.all(proprioception, *images)[0]


def make(options, state_size, statistics):
    kind = ChunkStudent if options.chunk > 1 else Student
    return kind(options, state_size, statistics)


def export(student, options, path):
    """Writes the student as a controller: its metadata says what it gets."""
    cameras = options.cameras.split(",")
    size = options.size
    joints = torch.zeros(1, PROPRIOCEPTION_SIZE)
    images = [torch.zeros(1, size, size, 3, dtype=torch.uint8) for _ in cameras]
    copy = make(options, student.auxiliary.out_features, (student.mean.cpu(), student.scale.cpu()))
    copy.load_state_dict({key: value.cpu() for key, value in student.state_dict().items()})
    description = {
        "mishandle.task": options.task,
        "mishandle.observation": "proprioception",
        "mishandle.parts": json.dumps(PROPRIOCEPTION),
        "mishandle.images": json.dumps([[camera, camera] for camera in cameras]),
        "mishandle.action": "action",
    }
    if options.chunk > 1:
        description["mishandle.chunk"] = json.dumps({"ensemble": options.decay})
    torch.onnx.export(
        copy.eval(), (joints, *images), str(path), input_names=["proprioception", *cameras], output_names=["action"],
        opset_version=17, dynamo=False,
    )
    model = onnx.load(path)
    onnx.helper.set_model_props(model, description)
    onnx.save(model, path)


def weights_of(path):
    """Returns the weights of an exported `Student` by their names."""
    found = onnx.load(path).graph.initializer
    return {tensor.name: torch.from_numpy(np.array(onnx.numpy_helper.to_array(tensor))) for tensor in found}


def load(student, path):
    """Gives a student the weights of an exported one of the same sizes."""
    found = weights_of(path)
    own = student.state_dict()
    # Cameras share what is the same: the exporter writes equal constants once.
    for key in own:
        if key not in found and key.endswith(".places"):
            found[key] = own[key]
    missing = sorted(set(own) - set(found))
    if missing:
        raise SystemExit(f"{path} lacks {', '.join(missing)}: only one-action students of the same sizes continue")
    student.load_state_dict({key: found[key] for key in own})
