"""Colors of materials and random numbers as functions of kernels: ``material.rs`` of the crate
``mishandle-camera`` and ``philox.rs`` of ``mishandle-random``."""

# The annotations of kernels are calls, which type checkers reject.
# mypy: ignore-errors
# pyright: basic

import warp as wp

from mishandle.gpu.cameras.columns import COLORS, PATTERN, SCALE, SEED

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FIRST_MULTIPLIER, SECOND_MULTIPLIER = wp.constant(wp.uint64(0xD2511F53)), wp.constant(
    wp.uint64(0xCD9E8D57)
)
FIRST_INCREMENT, SECOND_INCREMENT = wp.constant(wp.uint32(0x9E3779B9)), wp.constant(
    wp.uint32(0xBB67AE85)
)
LOW_HALF = wp.constant(wp.uint64(0xFFFFFFFF))

Words = wp.types.vector(length=4, dtype=wp.uint32)


@wp.func
def philox(a: wp.uint32, b: wp.uint32, c: wp.uint32, d: wp.uint32, low: wp.uint32, high: wp.uint32):
    """Returns one block of Philox4x32-10 from a counter and a key."""
    words = Words(a, b, c, d)
    key, other = low, high
    for _round in range(10):
        p = FIRST_MULTIPLIER * wp.uint64(words[0])
        q = SECOND_MULTIPLIER * wp.uint64(words[2])
        words = Words(
            wp.uint32(q >> wp.uint64(32)) ^ words[1] ^ key, wp.uint32(q & LOW_HALF),
            wp.uint32(p >> wp.uint64(32)) ^ words[3] ^ other, wp.uint32(p & LOW_HALF)
        )
        key = key + FIRST_INCREMENT
        other = other + SECOND_INCREMENT
    return words


@wp.func
def whole_hash(x: int, y: int, z: int, seed: wp.uint32):
    """Returns the random number of a whole point, from 0 to 1."""
    zero = wp.uint32(0)
    words = philox(wp.uint32(x), wp.uint32(y), wp.uint32(z), zero, seed, zero)
    return float(words[0] >> wp.uint32(8)) / 16777216.0


@wp.func
def mix(a: float, b: float, t: float):
    return a + t * (b - a)


@wp.func
def ease(t: float):
    return t * t * (3.0 - 2.0 * t)


@wp.func
def lattice(px: float, py: float, pz: float, seed: wp.uint32):
    """Returns a smooth random number from 0 to 1: values at whole points, interpolated."""
    bx, by, bz = wp.floor(px), wp.floor(py), wp.floor(pz)
    x, y, z = int(bx), int(by), int(bz)
    s, t, u = ease(px - bx), ease(py - by), ease(pz - bz)
    a = mix(whole_hash(x, y, z, seed), whole_hash(x + 1, y, z, seed), s)
    b = mix(whole_hash(x, y + 1, z, seed), whole_hash(x + 1, y + 1, z, seed), s)
    c = mix(whole_hash(x, y, z + 1, seed), whole_hash(x + 1, y, z + 1, seed), s)
    d = mix(whole_hash(x, y + 1, z + 1, seed), whole_hash(x + 1, y + 1, z + 1, seed), s)
    return mix(mix(a, b, t), mix(c, d, t), u)


@wp.func
def spots(x: float, y: float, z: float, seed: wp.uint32):
    """Returns random spots from 0 to 1: three octaves of :func:`lattice`."""
    first = lattice(x, y, z, seed)
    second = lattice(x * 2.03, y * 2.03, z * 2.03, seed + wp.uint32(1))
    third = lattice(x * 4.01, y * 4.01, z * 4.01, seed + wp.uint32(2))
    sum = (4.0 * first + 2.0 * second + third) / 7.0
    return wp.clamp(2.2 * (sum - 0.5) + 0.5, 0.0, 1.0)


@wp.func
def wood(x: float, y: float, z: float, seed: wp.uint32):
    bend = 2.0 * lattice(0.15 * x, 0.5 * y, 0.5 * z, seed)
    across, along = y - 9.5, z + 5.2
    ring = wp.sqrt(across * across + along * along) + bend
    part = ring - wp.floor(ring)
    return wp.where(part < 0.8, part * part * 1.5625, 5.0 * (1.0 - part))


@wp.func
def color_at(shapes: wp.array3d(dtype=float), sight: int, shape: int, p: wp.vec3):
    """Returns the color of a shape at a point in its frame, m."""
    first = wp.vec3(
        shapes[sight, shape, COLORS], shapes[sight, shape, COLORS + 1],
        shapes[sight, shape, COLORS + 2]
    )
    pattern = int(shapes[sight, shape, PATTERN])
    if pattern == 0:
        return first
    size = shapes[sight, shape, SCALE]
    seed = wp.uint32(int(shapes[sight, shape, SEED]))
    x, y, z = p[0] / size, p[1] / size, p[2] / size
    share = float(0.0)
    if pattern == 1:
        # A face of a box through 0 lies inside cells, not between them.
        cell = int(wp.floor(x + 0.25)) + int(wp.floor(y + 0.25)) + int(wp.floor(z + 0.25))
        share = float(cell & 1)
    elif pattern == 2:
        share = spots(x, y, z, seed)
    else:
        share = wood(x, y, z, seed)
    second = wp.vec3(
        shapes[sight, shape, COLORS + 3], shapes[sight, shape, COLORS + 4],
        shapes[sight, shape, COLORS + 5]
    )
    return first + (second - first) * share
