"""Columns of the rows of :mod:`mishandle.gpu.cameras.renderer`, which ``rows.rs`` of the crate
``mishandle-camera`` writes. A vector has three columns, a pose twelve."""

# Warp has no types.
# mypy: ignore-errors
# pyright: basic

import warp as wp

KIND, BODY, SIZE, POSE, PATTERN, COLORS, SCALE, SEED, OPACITY, SPECULAR, EXPONENT, EMISSION = (
    wp.constant(column) for column in (0, 1, 2, 5, 17, 18, 24, 25, 26, 27, 28, 29)
)
"""Columns of a shape: its frame is that of its body, and ``COLORS`` are two."""

SHAPE_COLUMNS = 30

TO_LAMP, LAMP_COLOR, SHADOW_RAYS, CASTS_SHADOWS, SHADOW_DIRECTIONS = (
    wp.constant(column) for column in (0, 3, 6, 7, 8)
)
"""Columns of a lamp. Without shadow rays it is off."""

LAMP_COLUMNS = 32

AMBIENT_ABOVE, AMBIENT_BELOW, SKY_ABOVE, SKY_HORIZON = (
    wp.constant(column) for column in (0, 3, 6, 9)
)

SKY_COLUMNS = 12

CAMERA_BODY, CAMERA_POSE, STEP, SAMPLES, SHUTTER, VIGNETTE, PATCH, PATCH_COLOR = (
    wp.constant(column) for column in (0, 1, 13, 14, 15, 16, 17, 21)
)
PASSES, WEIGHT, FACTORS, READ, SHOT, DEAD_ROWS, COARSENESS = (
    wp.constant(column) for column in (24, 25, 26, 29, 30, 31, 33)
)
"""Columns of a camera. ``PATCH`` and ``DEAD_ROWS`` are first pixels and those after the last."""

RAYS, RAY_COLUMNS = wp.constant(34), wp.constant(5)
"""The columns of the first ray of a camera, and of each of eight."""

LENS, FIRST, AGO = (wp.constant(column) for column in (0, 2, 4))
"""Columns of a ray: its place on the lens, its slopes at the first pixel, and its time before the
state as a fraction of a control step."""

CAMERA_COLUMNS = 74
