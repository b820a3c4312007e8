"""Kernels of :mod:`mishandle.gpu.cameras.renderer`: what lens, sensor and processing do, as
``develop.rs`` and ``compression.rs`` of the crate ``mishandle-camera``."""

# The annotations of kernels are calls, which type checkers reject.
# mypy: ignore-errors
# pyright: basic

import numpy as np
import warp as wp

from mishandle.gpu.cameras.columns import (
    COARSENESS, DEAD_ROWS, FACTORS, PASSES, PATCH, PATCH_COLOR, READ, SAMPLES, SHOT, VIGNETTE,
    WEIGHT
)
from mishandle.gpu.cameras.materials import LOW_HALF, philox

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

CHILD, CAMERA_NOISE = wp.constant(6), wp.constant(14)
"""Streams of random numbers, as in ``seed.rs``."""

DEVIATION = wp.constant(float(np.float32(1.0) / np.float32(209.02153)))
"""The reciprocal of the standard deviation of a sum of eight random bytes."""


@wp.func
def edge(index: int, count: int):
    return wp.min(index, count - 1)


@wp.kernel
def cover(
    cameras: wp.array3d(dtype=float), sights: wp.array(dtype=int), first_state: int, width: int,
    height: int, light: wp.array2d(dtype=wp.vec3)
) -> None:
    """Takes the mean of the rays, darkens the corners and draws the patch."""
    image, pixel = wp.tid()
    sight, camera = sights[first_state + image // cameras.shape[1]], image % cameras.shape[1]
    row, column = pixel // width, pixel % width
    color = light[image, pixel]
    samples = cameras[sight, camera, SAMPLES]
    if samples > 1.0:
        color = color * (1.0 / samples)
    x = float(2 * column + 1) / float(width) - 1.0
    y = float(2 * row + 1) / float(height) - 1.0
    # The square of the distance from the center is 2 at the corners.
    color = color * wp.max(1.0 - cameras[sight, camera, VIGNETTE] * 0.5 * (x * x + y * y), 0.0)
    if (
        column >= int(cameras[sight, camera, PATCH])
        and column < int(cameras[sight, camera, PATCH + 1])
    ):
        if (
            row >= int(cameras[sight, camera, PATCH + 2])
            and row < int(cameras[sight, camera, PATCH + 3])
        ):
            first = PATCH_COLOR
            color = wp.vec3(
                cameras[sight, camera, first], cameras[sight, camera, first + 1],
                cameras[sight, camera, first + 2]
            )
    light[image, pixel] = color


@wp.kernel
def blur(
    cameras: wp.array3d(dtype=float), sights: wp.array(dtype=int), first_state: int, width: int,
    height: int, done: int, is_vertical: int, light: wp.array2d(dtype=wp.vec3),
    out: wp.array2d(dtype=wp.vec3)
) -> None:
    """Blurs by one pass of three pixels, unless an image has no more passes than are done."""
    image, pixel = wp.tid()
    sight, camera = sights[first_state + image // cameras.shape[1]], image % cameras.shape[1]
    color = light[image, pixel]
    if float(done) < cameras[sight, camera, PASSES]:
        row, column = pixel // width, pixel % width
        before = row * width + wp.max(column - 1, 0)
        after = row * width + edge(column + 1, width)
        if is_vertical == 1:
            before = wp.max(row - 1, 0) * width + column
            after = edge(row + 1, height) * width + column
        change = (light[image, before] - color) + (light[image, after] - color)
        color = color + change * cameras[sight, camera, WEIGHT]
    out[image, pixel] = color


@wp.func
def byte_sum(word: wp.uint32):
    mask = wp.uint32(255)
    low = (word & mask) + ((word >> wp.uint32(8)) & mask)
    return low + ((word >> wp.uint32(16)) & mask) + (word >> wp.uint32(24))


@wp.func
def with_noise(
    value: float, number: int, step: wp.uint64, low: wp.uint32, high: wp.uint32, read: float,
    shot: float
):
    """Adds the noise of a number of an image: one of two of its block, with mean 0 and variance 1
    for a factor of 1."""
    a, b = wp.uint32(step & LOW_HALF), wp.uint32(step >> wp.uint64(32))
    words = philox(wp.uint32(number // 2), wp.uint32(CAMERA_NOISE), a, b, low, high)
    sum = byte_sum(words[0]) + byte_sum(words[1])
    if (number & 1) == 1:
        sum = byte_sum(words[2]) + byte_sum(words[3])
    normal = (float(sum) - 1020.0) * DEVIATION
    # Light above white saturates the sensor.
    return wp.min(value, 1.0) + wp.sqrt(read + shot * wp.clamp(value, 0.0, 1.0)) * normal


@wp.kernel
def sense(
    cameras: wp.array3d(dtype=float), sights: wp.array(dtype=int),
    camera_numbers: wp.array(dtype=int), seeds: wp.array(dtype=wp.uint64),
    steps: wp.array(dtype=wp.uint64), first_state: int, width: int, light: wp.array2d(dtype=wp.vec3)
) -> None:
    """Scales brightness and colors, adds the noise and cuts the dead rows."""
    image, pixel = wp.tid()
    state, camera = first_state + image // cameras.shape[1], image % cameras.shape[1]
    sight = sights[state]
    color = light[image, pixel]
    color = wp.vec3(
        color[0] * cameras[sight, camera, FACTORS], color[1] * cameras[sight, camera, FACTORS + 1],
        color[2] * cameras[sight, camera, FACTORS + 2]
    )
    read, shot = cameras[sight, camera, READ], cameras[sight, camera, SHOT]
    if read != 0.0 or shot != 0.0:
        zero = wp.uint32(0)
        a, b = wp.uint32(seeds[state] & LOW_HALF), wp.uint32(seeds[state] >> wp.uint64(32))
        # Two cameras of one simulation have seeds of their own.
        key = philox(zero, wp.uint32(CHILD), wp.uint32(camera_numbers[camera]), zero, a, b)
        pixels = light.shape[1]
        color = wp.vec3(
            with_noise(color[0], pixel, steps[state], key[0], key[1], read, shot),
            with_noise(color[1], pixels + pixel, steps[state], key[0], key[1], read, shot),
            with_noise(color[2], 2 * pixels + pixel, steps[state], key[0], key[1], read, shot),
        )
    row = pixel // width
    if (
        row >= int(cameras[sight, camera, DEAD_ROWS])
        and row < int(cameras[sight, camera, DEAD_ROWS + 1])
    ):
        color = wp.vec3(0.0, 0.0, 0.0)
    light[image, pixel] = color


@wp.kernel
def separate(
    light: wp.array2d(dtype=wp.vec3), width: int, height: int, planes: wp.array4d(dtype=float)
) -> None:
    """Writes brightness and colors in planes of whole blocks. Pixels beyond the image repeat those
    at its edge."""
    image, row, column = wp.tid()
    color = light[image, edge(row, height) * width + edge(column, width)]
    r = 255.0 * wp.clamp(color[0], 0.0, 1.0)
    g = 255.0 * wp.clamp(color[1], 0.0, 1.0)
    b = 255.0 * wp.clamp(color[2], 0.0, 1.0)
    y = 0.299 * r + 0.587 * g + 0.114 * b
    planes[image, 0, row, column] = y - 128.0
    planes[image, 1, row, column] = (b - y) / 1.772
    planes[image, 2, row, column] = (r - y) / 1.402


@wp.kernel
def transform(
    table: wp.array2d(dtype=float), planes: wp.array4d(dtype=float), columns: int,
    out: wp.array4d(dtype=float)
) -> None:
    """Writes the transposed product of the rows of each block and those of a table."""
    image, plane, place = wp.tid()
    row, column = place // columns, place % columns
    top, left = row - row % 8, column - column % 8
    sum = float(0.0)
    for k in range(8):
        sum = sum + table[row % 8, k] * planes[image, plane, top + column % 8, left + k]
    out[image, plane, row, column] = sum


@wp.kernel
def quantize(
    cameras: wp.array3d(dtype=float), sights: wp.array(dtype=int), first_state: int,
    steps: wp.array3d(dtype=float), columns: int, planes: wp.array4d(dtype=float)
) -> None:
    """Rounds coefficients to multiples of their steps."""
    image, plane, place = wp.tid()
    sight, camera = sights[first_state + image // cameras.shape[1]], image % cameras.shape[1]
    row, column = place // columns, place % columns
    own = steps[wp.min(plane, 1), row % 8, column % 8]
    step = wp.clamp(own * cameras[sight, camera, COARSENESS], 1.0, 255.0)
    planes[image, plane, row, column] = wp.floor(
        planes[image, plane, row, column] / step + 0.5
    ) * step


@wp.kernel
def join(
    cameras: wp.array3d(dtype=float), sights: wp.array(dtype=int), first_state: int, width: int,
    planes: wp.array4d(dtype=float), light: wp.array2d(dtype=wp.vec3)
) -> None:
    """Writes the colors of the planes into images that are compressed."""
    image, pixel = wp.tid()
    sight, camera = sights[first_state + image // cameras.shape[1]], image % cameras.shape[1]
    if not (cameras[sight, camera, COARSENESS] > 0.0):
        return
    row, column = pixel // width, pixel % width
    y = planes[image, 0, row, column] + 128.0
    r, b = 1.402 * planes[image, 2, row, column], 1.772 * planes[image, 1, row, column]
    g = y - (0.299 * r + 0.114 * b) / 0.587
    light[image, pixel] = wp.vec3((y + r) / 255.0, g / 255.0, (y + b) / 255.0)


@wp.func
def byte(value: float):
    return wp.uint8(int(wp.clamp(value * 255.0 + 0.5, 0.0, 255.0)))


@wp.kernel
def write(
    light: wp.array2d(dtype=wp.vec3), first_image: int, images: wp.array3d(dtype=wp.uint8)
) -> None:
    """Writes the bytes of the brightness of each pixel."""
    image, pixel = wp.tid()
    color = light[image, pixel]
    images[first_image + image, pixel, 0] = byte(color[0])
    images[first_image + image, pixel, 1] = byte(color[1])
    images[first_image + image, pixel, 2] = byte(color[2])
