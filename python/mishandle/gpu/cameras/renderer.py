"""Images of cameras by ray casting on a GPU: launches the kernels of the crate
``mishandle-camera``'s arithmetic. It knows arrays and no task;
:class:`mishandle.gpu.cameras.task_cameras.Cameras` gives it those of a task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from mishandle.gpu.extra import load

if TYPE_CHECKING:
    from numpy.typing import NDArray

wp, columns, forms, kernels, effects = load(
    *(f"mishandle.gpu.cameras.{name}" for name in ("columns", "forms", "kernels", "effects"))
)

PIXELS = 1 << 25
"""Pixels that are rendered at a time: 4 bytes for each of three colors, twice."""

WARP_PIXELS = (8, 4)
"""Columns and rows of the pixels of a warp."""


@dataclass(frozen=True)
class Poses:
    """Bodies of states on the device, 12 numbers each, and vertices of cloths, three numbers each:
    a row per state."""

    bodies: Any
    vertices: Any

    def __len__(self) -> int:
        return int(self.bodies.shape[0])


@dataclass(frozen=True)
class Sights:
    """What cameras see in scenarios, on the device: a row per scenario. ``over`` are the shapes
    that are not opaque; the numbers say what must be launched."""

    shapes: Any
    lamps: Any
    sky: Any
    cameras: Any
    over: Any
    samples: int
    passes: int
    is_compressed: bool
    needs_before: bool

    def __len__(self) -> int:
        return int(self.shapes.shape[0])


@dataclass
class _Buffers:
    """Arrays of the images that are rendered at a time."""

    images: int = 0
    arrays: dict[str, Any] = field(default_factory=dict)


class Renderer:
    """Renders images of the cameras with these numbers, which choose the noise of each, at a size
    (width, height) in pixels. ``cloths`` are triangles, nodes, and bodies and places of vertices;
    ``tables`` are those of the compression."""

    def __init__(
        self, device: Any, size: tuple[int, int], camera_numbers: list[int],
        cloths: tuple[
            NDArray[np.uint32], NDArray[np.uint32], NDArray[np.uint32], NDArray[np.float32]
        ],
        tables: NDArray[np.float32], pixels: int = PIXELS
    ) -> None:
        self.device = device
        self.width, self.height = size
        self.cameras = len(camera_numbers)
        self._chunk = max(1, pixels // (self.cameras * self.width * self.height))
        triangles, nodes, bodies, places = cloths
        with wp.ScopedDevice(device):
            self._camera_numbers = wp.array(camera_numbers, dtype=int)
            self._triangles = wp.array(triangles.astype(np.int32).reshape(-1, 3), dtype=int, ndim=2)
            self._nodes = wp.array(nodes.astype(np.int32).reshape(-1, 4), dtype=int, ndim=2)
            self._vertex_bodies = wp.array(bodies.astype(np.int32), dtype=int)
            self._places = wp.array(places.reshape(-1, 3), dtype=wp.vec3)
            first, around = _triangles_around(triangles, len(bodies))
            self._first, self._around = wp.array(first, dtype=int), wp.array(around, dtype=int)
            cosines, *steps = tables
            self._cosines = wp.array(cosines, dtype=float, ndim=2)
            self._back = wp.array(np.ascontiguousarray(cosines.T), dtype=float, ndim=2)
            self._steps = wp.array(np.stack(steps), dtype=float, ndim=3)
        self._buffers = _Buffers()

    def poses(self, bodies: NDArray[np.float32], vertices: NDArray[np.float32]) -> Poses:
        """Copies poses to the device."""
        with wp.ScopedDevice(self.device):
            return Poses(
                wp.array(bodies, dtype=float, ndim=2), wp.array(vertices, dtype=float, ndim=2)
            )

    def poses_of_worlds(self, positions: Any, quaternions: Any) -> Poses:
        """Returns the poses of bodies on the device, as MuJoCo Warp has them (``xpos`` and
        ``xquat`` of its data)."""
        rows, count = positions.shape
        vertices = self._places.shape[0]
        with wp.ScopedDevice(self.device):
            poses = Poses(
                wp.empty((rows, 12 * count), dtype=float),
                wp.empty((rows, 3 * vertices), dtype=float)
            )
            wp.launch(
                kernels.read_bodies, (rows, count), inputs=[positions, quaternions],
                outputs=[poses.bodies]
            )
            if vertices > 0:
                inputs = [poses.bodies, self._vertex_bodies, self._places]
                wp.launch(
                    kernels.read_vertices, (rows, vertices), inputs=inputs, outputs=[poses.vertices]
                )
        return poses

    def sights(self, rows: Mapping[str, NDArray[np.float32]]) -> Sights:
        """Copies rows of scenarios to the device: ``shapes``, ``lamps``, ``sky`` and
        ``cameras``."""
        count = len(rows["sky"])
        shapes = rows["shapes"].reshape(count, -1, columns.SHAPE_COLUMNS)
        lamps = rows["lamps"].reshape(count, -1, columns.LAMP_COLUMNS)
        cameras = rows["cameras"].reshape(count, self.cameras, columns.CAMERA_COLUMNS)
        sky = rows["sky"].reshape(count, columns.SKY_COLUMNS)
        is_drawn = shapes[:, :, columns.KIND] > 0
        opacity = shapes[:, :, columns.OPACITY]
        # Distractors that no scenario has come last.
        drawn = np.flatnonzero(is_drawn.any(axis=0))
        shapes = shapes[:, : drawn[-1] + 1 if drawn.size > 0 else 0]
        over = np.flatnonzero((is_drawn & (opacity < 1)).any(axis=0))
        with wp.ScopedDevice(self.device):
            return Sights(
                shapes=wp.array(np.ascontiguousarray(shapes), dtype=float, ndim=3),
                lamps=wp.array(lamps, dtype=float, ndim=3), sky=wp.array(sky, dtype=float, ndim=2),
                cameras=wp.array(cameras, dtype=float, ndim=3),
                over=wp.array(over.astype(np.int32), dtype=int),
                samples=int(cameras[:, :, columns.SAMPLES].max(initial=1)),
                passes=int(cameras[:, :, columns.PASSES].max(initial=0)),
                is_compressed=bool((cameras[:, :, columns.COARSENESS] > 0).any()),
                needs_before=bool((cameras[:, :, columns.SHUTTER] > 0).any())
            )

    def render(
        self, poses: Poses, sights: Sights, rows: Any, seeds: Any, steps: Any,
        before: Poses | None = None
    ) -> Any:
        """Renders each camera of each state: bytes of the shape (states * cameras, height, width,
        3) on the device, the cameras of a state one after the other. ``rows`` are the rows of
        ``sights`` of the states, ``seeds`` and ``steps`` choose the noise, and ``before`` are the
        states one control step ago."""
        states, pixels = len(poses), self.width * self.height
        with wp.ScopedDevice(self.device):
            out = wp.empty((states * self.cameras, pixels, 3), dtype=wp.uint8)
            for first in range(0, states, self._chunk):
                count = min(self._chunk, states - first) * self.cameras
                arrays = self._arrays(min(self._chunk, states) * self.cameras, sights)
                self._cast(arrays, first, count, poses, before or poses, sights, rows)
                light = self._develop(arrays, first, count, sights, rows, seeds, steps)
                wp.launch(
                    effects.write, (count, pixels), inputs=[light, first * self.cameras],
                    outputs=[out]
                )
        return out.reshape((states * self.cameras, self.height, self.width, 3))

    def _arrays(self, images: int, sights: Sights) -> dict[str, Any]:
        """Returns arrays for this many images, which stay for the next call."""
        if self._buffers.images < images:
            self._buffers = _Buffers(images)
        images, pixels, shapes = (
            self._buffers.images, self.width * self.height, sights.shapes.shape[1]
        )
        vertices, nodes = self._places.shape[0], self._nodes.shape[0]
        blocks = (images, 3, _whole_blocks(self.height), _whole_blocks(self.width))
        required: dict[str, tuple[tuple[int, ...], Any, bool]] = {
            "views": ((images,), kernels.View, True),
            "placed": ((images, shapes), kernels.Placed, True),
            "bounds": ((images, shapes), wp.vec4i, True),
            "spheres": ((images, shapes), wp.vec4, True),
            "distances": ((images, shapes), float, True),
            "vertices": ((images, vertices), wp.vec3, True),
            "normals": ((images, vertices), wp.vec3, True),
            "lows": ((images, nodes), wp.vec3, True),
            "highs": ((images, nodes), wp.vec3, True),
            "light": ((images, pixels), wp.vec3, True),
            "blurred": ((images, pixels), wp.vec3, sights.passes > 0),
            "planes": (blocks, float, sights.is_compressed),
            "coefficients": (blocks, float, sights.is_compressed),
        }
        arrays = self._buffers.arrays
        for name, (shape, dtype, is_needed) in required.items():
            if is_needed and (name not in arrays or arrays[name].shape != shape):
                arrays[name] = wp.empty(shape, dtype=dtype)
        return arrays

    def _cast(
        self, arrays: dict[str, Any], first: int, count: int, poses: Poses, before: Poses,
        sights: Sights, rows: Any
    ) -> None:
        """Computes the light of each pixel."""
        lows, highs = arrays["lows"], arrays["highs"]
        cloth = [arrays["vertices"], arrays["normals"], lows, highs, self._triangles, self._nodes]
        across, down = -(-self.width // WARP_PIXELS[0]), -(-self.height // WARP_PIXELS[1])
        threads = across * down * WARP_PIXELS[0] * WARP_PIXELS[1]
        size = [self.width, self.height]
        for sample in range(sights.samples):
            self._move_cloths(arrays, first, count, sample, poses, before, sights, rows)
            inputs = [poses.bodies, before.bodies, sights.cameras, rows, first, sample]
            wp.launch(kernels.aim, count, inputs=inputs, outputs=[arrays["views"]])
            inputs = [
                poses.bodies, before.bodies, sights.shapes, sights.cameras, rows, lows, highs,
                arrays["views"], first, sample, *size
            ]
            placed = [arrays[name] for name in ("placed", "bounds", "spheres", "distances")]
            wp.launch(kernels.place, (count, sights.shapes.shape[1]), inputs=inputs, outputs=placed)
            inputs = [
                sights.shapes, sights.lamps, sights.sky, sights.cameras, rows, arrays["views"],
                *placed, sights.over, *cloth
            ]
            inputs += [first, sample, *size]
            wp.launch(
                kernels.shade, (count, threads), inputs=inputs, outputs=[arrays["light"]],
                block_dim=kernels.BLOCK
            )

    def _move_cloths(
        self, arrays: dict[str, Any], first: int, count: int, sample: int, poses: Poses,
        before: Poses, sights: Sights, rows: Any
    ) -> None:
        vertices, nodes = self._places.shape[0], self._nodes.shape[0]
        if vertices == 0:
            return
        column = columns.RAYS + columns.RAY_COLUMNS * sample + columns.AGO
        inputs = [poses.vertices, before.vertices, sights.cameras, rows, first, column]
        wp.launch(
            forms.move_vertices, (count, vertices), inputs=inputs, outputs=[arrays["vertices"]]
        )
        inputs = [arrays["vertices"], self._triangles, self._nodes]
        wp.launch(
            forms.fit_boxes, (count, nodes), inputs=inputs,
            outputs=[arrays["lows"], arrays["highs"]]
        )
        inputs = [arrays["vertices"], self._triangles, self._first, self._around]
        wp.launch(forms.fit_normals, (count, vertices), inputs=inputs, outputs=[arrays["normals"]])

    def _develop(
        self, arrays: dict[str, Any], first: int, count: int, sights: Sights, rows: Any, seeds: Any,
        steps: Any
    ) -> Any:
        """Applies the effects to the light of each pixel, and returns the array that has it
        then."""
        light, of_images = arrays["light"], [sights.cameras, rows]
        dim = (count, self.width * self.height)
        wp.launch(effects.cover, dim, inputs=[*of_images, first, self.width, self.height, light])
        for done in range(sights.passes):
            for is_vertical, source, target in (
                (0, light, arrays["blurred"]), (1, arrays["blurred"], light)
            ):
                inputs = [*of_images, first, self.width, self.height, done, is_vertical, source]
                wp.launch(effects.blur, dim, inputs=inputs, outputs=[target])
        inputs = [*of_images, self._camera_numbers, seeds, steps, first, self.width, light]
        wp.launch(effects.sense, dim, inputs=inputs)
        if sights.is_compressed:
            self._compress(arrays, first, count, sights, rows)
        return light

    def _compress(
        self, arrays: dict[str, Any], first: int, count: int, sights: Sights, rows: Any
    ) -> None:
        light, planes, other = arrays["light"], arrays["planes"], arrays["coefficients"]
        down, across = planes.shape[2:]
        wp.launch(
            effects.separate, (count, down, across), inputs=[light, self.width, self.height],
            outputs=[planes]
        )
        dim = (count, 3, down * across)
        for table in (self._cosines, self._back):
            wp.launch(effects.transform, dim, inputs=[table, planes, across], outputs=[other])
            wp.launch(effects.transform, dim, inputs=[table, other, across], outputs=[planes])
            if table is self._cosines:
                inputs = [sights.cameras, rows, first, self._steps, across, planes]
                wp.launch(effects.quantize, dim, inputs=inputs)
        inputs = [sights.cameras, rows, first, self.width, planes]
        wp.launch(effects.join, (count, self.width * self.height), inputs=inputs, outputs=[light])


def _whole_blocks(side: int) -> int:
    return -(-side // 8) * 8


def _triangles_around(
    triangles: NDArray[np.uint32], vertices: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Returns the triangles around each vertex in their order, one vertex after the other, and
    where those of each vertex begin."""
    corners = triangles.reshape(-1).astype(np.int64)
    order = np.argsort(corners, kind="stable")
    first = np.searchsorted(corners[order], np.arange(vertices + 1))
    return first.astype(np.int32), (order // 3).astype(np.int32)
