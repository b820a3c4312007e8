"""Kernels of :mod:`mishandle.gpu.cameras.renderer`: rays, shadows and colors of the crate
``mishandle-camera``. They repeat its arithmetic in the same order, without fused operations, so
that both draw the same bytes. ``rows.rs`` has the columns of their inputs."""

# The annotations of kernels are calls, which type checkers reject.
# mypy: ignore-errors
# pyright: basic

import warp as wp

from mishandle.gpu.cameras.columns import (
    AGO, AMBIENT_ABOVE, AMBIENT_BELOW, BODY, CAMERA_BODY, CAMERA_POSE, CASTS_SHADOWS, EMISSION,
    EXPONENT, FIRST, KIND, LAMP_COLOR, LENS, OPACITY, POSE, RAYS, RAY_COLUMNS, SAMPLES,
    SHADOW_DIRECTIONS, SHADOW_RAYS, SIZE, SKY_ABOVE, SKY_HORIZON, SPECULAR, STEP, TO_LAMP
)
from mishandle.gpu.cameras.forms import enter, enter_cloth, greater, normal_of, of_cloth, unit
from mishandle.gpu.cameras.materials import color_at

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

PLANE, CLOTH = wp.constant(1), wp.constant(7)
"""Kinds of shapes, of which 0 is none."""

CLOSE = wp.constant(5e-4)
"""Distance within which a surface casts no shadow, m."""

NEAR = wp.constant(1e-3)
"""Distance along the axis at which a corner of a box is no longer in front of the lens, m."""

LOOSE = wp.constant(1e-5)
"""Added to squares of radii of spheres around shapes for rounding, m²."""

NO_SHAPE = wp.constant(-1)

BLOCK = 128
"""Threads per block of :func:`shade`, of which a multiprocessor takes six: with fewer registers per
thread, more of them hide the time of square roots and divisions."""


@wp.struct
class Pose:
    position: wp.vec3
    x: wp.vec3
    y: wp.vec3
    z: wp.vec3


@wp.struct
class View:
    """The rays of an image: those of pixel (x, y) start at ``eye`` and go along ``forward + u(x)
    right + v(y) up``."""

    eye: wp.vec3
    right: wp.vec3
    up: wp.vec3
    forward: wp.vec3
    first: wp.vec2
    step: float


@wp.struct
class Placed:
    """A shape in the world, and the rays of the image in its frame."""

    pose: Pose
    origin: wp.vec3
    right: wp.vec3
    up: wp.vec3
    forward: wp.vec3
    size: wp.vec3
    kind: int
    is_opaque: int


@wp.func
def direction_of(pose: Pose, v: wp.vec3):
    return pose.x * v[0] + pose.y * v[1] + pose.z * v[2]


@wp.func
def local_direction(pose: Pose, v: wp.vec3):
    return wp.vec3(wp.dot(pose.x, v), wp.dot(pose.y, v), wp.dot(pose.z, v))


@wp.func
def local_point(pose: Pose, p: wp.vec3):
    return local_direction(pose, p - pose.position)


@wp.func
def inside(outer: Pose, inner: Pose):
    pose = Pose()
    pose.position = outer.position + direction_of(outer, inner.position)
    pose.x = direction_of(outer, inner.x)
    pose.y = direction_of(outer, inner.y)
    pose.z = direction_of(outer, inner.z)
    return pose


@wp.func
def vector(numbers: wp.array2d(dtype=float), row: int, column: int):
    return wp.vec3(numbers[row, column], numbers[row, column + 1], numbers[row, column + 2])


@wp.func
def vector3(numbers: wp.array3d(dtype=float), row: int, item: int, column: int):
    return wp.vec3(
        numbers[row, item, column], numbers[row, item, column + 1], numbers[row, item, column + 2]
    )


@wp.func
def pose3(numbers: wp.array3d(dtype=float), row: int, item: int, column: int):
    pose = Pose()
    pose.position = vector3(numbers, row, item, column)
    pose.x = vector3(numbers, row, item, column + 3)
    pose.y = vector3(numbers, row, item, column + 6)
    pose.z = vector3(numbers, row, item, column + 9)
    return pose


@wp.func
def pose2(numbers: wp.array2d(dtype=float), row: int, column: int):
    pose = Pose()
    pose.position = vector(numbers, row, column)
    pose.x = vector(numbers, row, column + 3)
    pose.y = vector(numbers, row, column + 6)
    pose.z = vector(numbers, row, column + 9)
    return pose


@wp.func
def body_pose(
    now: wp.array2d(dtype=float), before: wp.array2d(dtype=float), row: int, body: int, ago: float
):
    """Returns the pose of a body some time before a state, as a fraction of the time since the
    state before."""
    pose = pose2(now, row, 12 * body)
    if ago > 0.0:
        old = pose2(before, row, 12 * body)
        pose.position = pose.position + (old.position - pose.position) * ago
        pose.x = unit(pose.x + (old.x - pose.x) * ago)
        y = pose.y + (old.y - pose.y) * ago
        pose.y = unit(y - pose.x * wp.dot(pose.x, y))
        pose.z = wp.cross(pose.x, pose.y)
    return pose


@wp.kernel
def aim(
    now: wp.array2d(dtype=float), before: wp.array2d(dtype=float), cameras: wp.array3d(dtype=float),
    sights: wp.array(dtype=int), first_state: int, sample: int, views: wp.array(dtype=View)
) -> None:
    """Makes the rays of each image."""
    image = wp.tid()
    count = cameras.shape[1]
    state, camera = first_state + image // count, image % count
    sight = sights[state]
    ray = RAYS + RAY_COLUMNS * sample
    body = body_pose(
        now, before, state, int(cameras[sight, camera, CAMERA_BODY]),
        cameras[sight, camera, ray + AGO]
    )
    pose = inside(body, pose3(cameras, sight, camera, CAMERA_POSE))
    view = View()
    lens = ray + LENS
    view.eye = pose.position + (
        pose.x * cameras[sight, camera, lens] + pose.y * cameras[sight, camera, lens + 1]
    )
    view.right = pose.x
    view.up = pose.y
    view.forward = -pose.z
    view.first = wp.vec2(
        cameras[sight, camera, ray + FIRST], cameras[sight, camera, ray + FIRST + 1]
    )
    view.step = cameras[sight, camera, STEP]
    views[image] = view


@wp.func
def corner_of(middle: wp.vec3, x: wp.vec3, y: wp.vec3, z: wp.vec3, corner: int):
    p = wp.where((corner & 1) == 0, middle - x, middle + x)
    p = wp.where((corner & 2) == 0, p - y, p + y)
    return wp.where((corner & 4) == 0, p - z, p + z)


@wp.func
def in_view(view: View, v: wp.vec3):
    return wp.vec3(wp.dot(v, view.right), wp.dot(v, view.up), wp.dot(v, view.forward))


@wp.func
def bounds_of(view: View, pose: Pose, center: wp.vec3, half: wp.vec3, width: int, height: int):
    """Returns the pixels that a box may cover: first and last column and row. None are -1 and
    -2."""
    whole = wp.vec4i(0, width - 1, 0, height - 1)
    none = wp.vec4i(-1, -2, -1, -2)
    if not (wp.max(half) < wp.inf):
        return whole
    middle = in_view(view, pose.position + direction_of(pose, center) - view.eye)
    x = in_view(view, pose.x * half[0])
    y = in_view(view, pose.y * half[1])
    z = in_view(view, pose.z * half[2])
    low, high = wp.vec2(wp.inf, wp.inf), wp.vec2(-wp.inf, -wp.inf)
    behind = int(0)
    for corner in range(8):
        p = corner_of(middle, x, y, z, corner)
        if p[2] <= NEAR:
            behind += 1
        else:
            slope = wp.vec2(p[0] / p[2], p[1] / p[2])
            low, high = wp.min(low, slope), wp.max(high, slope)
    if behind == 8:
        return none
    # A box on both sides of the lens may cover anything.
    if behind > 0:
        return whole
    left = wp.floor((low[0] - view.first[0]) / view.step) - 1.0
    right = wp.ceil((high[0] - view.first[0]) / view.step) + 1.0
    top = wp.floor((view.first[1] - high[1]) / view.step) - 1.0
    bottom = wp.ceil((view.first[1] - low[1]) / view.step) + 1.0
    if right < 0.0 or bottom < 0.0 or left > float(width - 1) or top > float(height - 1):
        return none
    columns = wp.vec2i(int(wp.max(left, 0.0)), int(wp.min(right, float(width - 1))))
    rows = wp.vec2i(int(wp.max(top, 0.0)), int(wp.min(bottom, float(height - 1))))
    return wp.vec4i(columns[0], columns[1], rows[0], rows[1])


@wp.func
def half_of(kind: int, size: wp.vec3):
    """Returns half the size of the box around a form, and the radius of the sphere around it."""
    half = size
    radius = wp.length(size)
    if kind == PLANE:
        half, radius = wp.vec3(size[0], size[1], 0.0), wp.inf
    elif kind == 2:
        half, radius = wp.vec3(size[0], size[0], size[0]), size[0]
    elif kind == 4:
        half, radius = wp.vec3(size[0], size[0], size[1] + size[0]), size[0] + size[1]
    elif kind == 5:
        half, radius = wp.vec3(size[0], size[0], size[1]), wp.sqrt(
            size[0] * size[0] + size[1] * size[1]
        )
    elif kind == 6:
        radius = wp.max(size)
    return half, radius


@wp.kernel
def place(
    now: wp.array2d(dtype=float), before: wp.array2d(dtype=float), shapes: wp.array3d(dtype=float),
    cameras: wp.array3d(dtype=float), sights: wp.array(dtype=int), lows: wp.array2d(dtype=wp.vec3),
    highs: wp.array2d(dtype=wp.vec3), views: wp.array(dtype=View), first_state: int, sample: int,
    width: int, height: int, placed: wp.array2d(dtype=Placed), bounds: wp.array2d(dtype=wp.vec4i),
    spheres: wp.array2d(dtype=wp.vec4), distances: wp.array2d(dtype=float)
) -> None:
    """Places each shape of each image."""
    image, index = wp.tid()
    count = cameras.shape[1]
    state, camera = first_state + image // count, image % count
    sight = sights[state]
    kind = int(shapes[sight, index, KIND])
    if kind == 0:
        bounds[image, index] = wp.vec4i(-1, -2, -1, -2)
        spheres[image, index] = wp.vec4(0.0, 0.0, 0.0, -1.0)
        return
    view = views[image]
    own = Placed()
    own.kind = kind
    own.size = vector3(shapes, sight, index, SIZE)
    own.is_opaque = wp.where(shapes[sight, index, OPACITY] >= 1.0, 1, 0)
    center = wp.vec3(0.0, 0.0, 0.0)
    half, radius = half_of(kind, own.size)
    if kind == CLOTH:
        own.pose = pose3(shapes, sight, index, POSE)
        low, high = lows[image, int(own.size[0])], highs[image, int(own.size[0])]
        center, half = (low + high) * 0.5, (high - low) * 0.5
        radius = wp.length(half)
    else:
        ago = cameras[sight, camera, RAYS + RAY_COLUMNS * sample + AGO]
        body = body_pose(now, before, state, int(shapes[sight, index, BODY]), ago)
        own.pose = inside(body, pose3(shapes, sight, index, POSE))
    own.origin = local_point(own.pose, view.eye)
    own.right = local_direction(own.pose, view.right)
    own.up = local_direction(own.pose, view.up)
    own.forward = local_direction(own.pose, view.forward)
    middle = own.pose.position + direction_of(own.pose, center)
    placed[image, index] = own
    bounds[image, index] = bounds_of(view, own.pose, center, half, width, height)
    square = radius * radius * 1.001 + LOOSE
    # Only opaque shapes cast shadows.
    spheres[image, index] = wp.vec4(
        middle[0], middle[1], middle[2], wp.where(own.is_opaque == 1, square, -1.0)
    )
    distances[image, index] = wp.dot(middle - view.eye, view.forward)


@wp.func
def is_shaded(
    p: wp.vec3, light: wp.vec3, itself: int, image: int, placed: wp.array2d(dtype=Placed),
    spheres: wp.array2d(dtype=wp.vec4), cloth_vertices: wp.array2d(dtype=wp.vec3),
    lows: wp.array2d(dtype=wp.vec3), highs: wp.array2d(dtype=wp.vec3),
    triangles: wp.array2d(dtype=int), nodes: wp.array2d(dtype=int)
):
    """Returns whether a shape is between a point of shape ``itself`` and a lamp in a direction."""
    for index in range(spheres.shape[1]):
        sphere = spheres[image, index]
        from_point = wp.vec3(sphere[0], sphere[1], sphere[2]) - p
        ahead = wp.dot(from_point, light)
        square = wp.dot(from_point, from_point)
        # The sphere is not behind the point, and the ray comes near its center.
        if square - ahead * ahead <= sphere[3] and (ahead >= 0.0 or square <= sphere[3]):
            kind = placed[image, index].kind
            if index != itself or kind == CLOTH:
                pose = placed[image, index].pose
                size = placed[image, index].size
                o = local_point(pose, p)
                d = local_direction(pose, light)
                t = float(wp.inf)
                if kind == CLOTH:
                    found, which = enter_cloth(
                        size, o, d, CLOSE, wp.inf, image, cloth_vertices, lows, highs, triangles,
                        nodes
                    )
                    t = found
                # Light that leaves a plane does not enter it.
                elif kind != PLANE or d[2] < 0.0:
                    t = enter(kind, size, o, d)
                if CLOSE < t and t < wp.inf:
                    return 1
    return 0


@wp.func
def power(base: float, exponent: int):
    out = float(1.0)
    factor = float(base)
    left = int(exponent)
    while left > 0:
        if (left & 1) == 1:
            out = out * factor
        factor = factor * factor
        left = left >> 1
    return out


@wp.func
def multiply(a: wp.vec3, b: wp.vec3):
    return wp.vec3(a[0] * b[0], a[1] * b[1], a[2] * b[2])


@wp.func
def emitted(
    shapes: wp.array3d(dtype=float), sky: wp.array2d(dtype=float), sight: int, index: int,
    normal: wp.vec3
):
    """Returns the light of a white surface without lamps."""
    up = 0.5 + 0.5 * normal[2]
    above, below = vector(sky, sight, AMBIENT_ABOVE), vector(sky, sight, AMBIENT_BELOW)
    glow = shapes[sight, index, EMISSION]
    mixed = below + (above - below) * up
    return wp.vec3(mixed[0] + glow, mixed[1] + glow, mixed[2] + glow)


@wp.func
def highlight(
    shapes: wp.array3d(dtype=float), sight: int, index: int, normal: wp.vec3, to_lamp: wp.vec3,
    to_eye: wp.vec3
):
    specular = shapes[sight, index, SPECULAR]
    if specular > 0.0:
        half = unit(to_lamp + to_eye)
        cosine = greater(wp.dot(normal, half), 0.0)
        return specular * power(cosine, int(shapes[sight, index, EXPONENT]))
    return 0.0


@wp.kernel(launch_bounds=(BLOCK, 6))
def shade(
    shapes: wp.array3d(dtype=float), lamps: wp.array3d(dtype=float), sky: wp.array2d(dtype=float),
    cameras: wp.array3d(dtype=float), sights: wp.array(dtype=int), views: wp.array(dtype=View),
    placed: wp.array2d(dtype=Placed), bounds: wp.array2d(dtype=wp.vec4i),
    spheres: wp.array2d(dtype=wp.vec4), distances: wp.array2d(dtype=float),
    over: wp.array(dtype=int), cloth_vertices: wp.array2d(dtype=wp.vec3),
    cloth_normals: wp.array2d(dtype=wp.vec3), lows: wp.array2d(dtype=wp.vec3),
    highs: wp.array2d(dtype=wp.vec3), triangles: wp.array2d(dtype=int),
    nodes: wp.array2d(dtype=int), first_state: int, sample: int, width: int, height: int,
    light: wp.array2d(dtype=wp.vec3)
) -> None:
    """Computes the light of each pixel for one ray, and adds it to that of the rays before."""
    image, thread = wp.tid()
    # The 32 threads of a warp have a rectangle of 8 x 4 pixels.
    tile, lane = thread // 32, thread % 32
    tiles = (width + 7) // 8
    column, row = (tile % tiles) * 8 + lane % 8, (tile // tiles) * 4 + lane // 8
    if column >= width or row >= height:
        return
    count = cameras.shape[1]
    sight, camera = sights[first_state + image // count], image % count
    if sample >= int(cameras[sight, camera, SAMPLES]):
        return
    view = views[image]
    u, v = view.first[0] + float(column) * view.step, view.first[1] - float(row) * view.step
    depth = float(wp.inf)
    shape = int(NO_SHAPE)
    triangle = int(0)
    for index in range(bounds.shape[1]):
        box = bounds[image, index]
        if column >= box[0] and column <= box[1] and row >= box[2] and row <= box[3]:
            if placed[image, index].is_opaque == 1:
                kind = placed[image, index].kind
                size = placed[image, index].size
                o = placed[image, index].origin
                start = placed[image, index].forward + placed[image, index].up * v
                d = start + placed[image, index].right * u
                t = float(wp.inf)
                if kind == CLOTH:
                    found, which = enter_cloth(
                        size, o, d, 0.0, depth, image, cloth_vertices, lows, highs, triangles, nodes
                    )
                    t = found
                    if t < depth:
                        triangle = which
                else:
                    t = enter(kind, size, o, d)
                if t < depth:
                    depth, shape = t, index
    direction = view.forward + (view.right * u + view.up * v)
    color = wp.vec3(0.0, 0.0, 0.0)
    to_eye = direction * (-1.0 / wp.sqrt(wp.dot(direction, direction)))
    if shape == NO_SHAPE:
        up = greater(direction[2] / wp.sqrt(wp.dot(direction, direction)), 0.0)
        above, horizon = vector(sky, sight, SKY_ABOVE), vector(sky, sight, SKY_HORIZON)
        color = horizon + (above - horizon) * up
    else:
        p = view.eye + direction * depth
        pose = placed[image, shape].pose
        at = local_point(pose, p)
        kind = placed[image, shape].kind
        normal = wp.vec3(0.0, 0.0, 0.0)
        if kind == CLOTH:
            normal = direction_of(
                pose, of_cloth(image, triangle, at, cloth_vertices, cloth_normals, triangles)
            )
            if wp.dot(normal, direction) > 0.0:
                normal = -normal
        else:
            normal = direction_of(pose, normal_of(kind, placed[image, shape].size, at))
        diffuse, shine = emitted(shapes, sky, sight, shape, normal), wp.vec3(0.0, 0.0, 0.0)
        for lamp in range(lamps.shape[1]):
            rays = int(lamps[sight, lamp, SHADOW_RAYS])
            to_lamp = vector3(lamps, sight, lamp, TO_LAMP)
            cosine = wp.dot(normal, to_lamp)
            lit = float(0.0)
            if cosine > 0.0 and rays > 0:
                for ray in range(rays):
                    toward = vector3(lamps, sight, lamp, SHADOW_DIRECTIONS + 3 * ray)
                    if wp.dot(normal, toward) > 0.0:
                        shaded = int(0)
                        if lamps[sight, lamp, CASTS_SHADOWS] > 0.0:
                            shaded = is_shaded(
                                p, toward, shape, image, placed, spheres, cloth_vertices, lows,
                                highs, triangles, nodes
                            )
                        if shaded == 0:
                            lit += 1.0
                if rays > 1:
                    lit = lit * (1.0 / float(rays))
                cosine = cosine * lit
                if cosine > 0.0:
                    lamp_color = vector3(lamps, sight, lamp, LAMP_COLOR)
                    diffuse = diffuse + lamp_color * cosine
                    shine = shine + lamp_color * (
                        highlight(shapes, sight, shape, normal, to_lamp, to_eye) * lit
                    )
        color = multiply(color_at(shapes, sight, shape, at), diffuse) + shine
    # Shapes that are not opaque are drawn over the others, the farthest one first.
    last, last_place = float(wp.inf), int(-1)
    for _layer in range(over.shape[0]):
        next, next_place = float(-wp.inf), int(-1)
        for place in range(over.shape[0]):
            distance = distances[image, over[place]]
            is_left = distance < last or (distance == last and place > last_place)
            if is_left and distance > next:
                next, next_place = distance, place
        last, last_place = next, next_place
        if next_place >= 0:
            index = over[next_place]
            box = bounds[image, index]
            if column >= box[0] and column <= box[1] and row >= box[2] and row <= box[3]:
                kind = placed[image, index].kind
                size = placed[image, index].size
                o = placed[image, index].origin
                start = placed[image, index].forward + placed[image, index].up * v
                d = start + placed[image, index].right * u
                t = float(wp.inf)
                which = int(0)
                if kind == CLOTH:
                    found, hit = enter_cloth(
                        size, o, d, 0.0, wp.inf, image, cloth_vertices, lows, highs, triangles,
                        nodes
                    )
                    t, which = found, hit
                else:
                    t = enter(kind, size, o, d)
                if t < depth:
                    p = view.eye + direction * t
                    pose = placed[image, index].pose
                    at = local_point(pose, p)
                    normal = wp.vec3(0.0, 0.0, 0.0)
                    if kind == CLOTH:
                        normal = direction_of(
                            pose,
                            of_cloth(image, which, at, cloth_vertices, cloth_normals, triangles)
                        )
                        if wp.dot(normal, direction) > 0.0:
                            normal = -normal
                    else:
                        normal = direction_of(pose, normal_of(kind, size, at))
                    diffuse, shine = emitted(shapes, sky, sight, index, normal), wp.vec3(
                        0.0, 0.0, 0.0
                    )
                    for lamp in range(lamps.shape[1]):
                        to_lamp = vector3(lamps, sight, lamp, TO_LAMP)
                        cosine = wp.dot(normal, to_lamp)
                        if cosine > 0.0 and lamps[sight, lamp, SHADOW_RAYS] > 0.0:
                            lamp_color = vector3(lamps, sight, lamp, LAMP_COLOR)
                            diffuse = diffuse + lamp_color * cosine
                            shine = shine + lamp_color * highlight(
                                shapes, sight, index, normal, to_lamp, to_eye
                            )
                    front = multiply(color_at(shapes, sight, index, at), diffuse) + shine
                    color = color + (front - color) * shapes[sight, index, OPACITY]
    pixel = row * width + column
    if sample == 0:
        light[image, pixel] = color
    else:
        light[image, pixel] = light[image, pixel] + color


@wp.kernel
def read_bodies(
    positions: wp.array2d(dtype=wp.vec3), quaternions: wp.array2d(dtype=wp.quat),
    bodies: wp.array2d(dtype=float)
) -> None:
    """Writes the pose of each body of MuJoCo Warp, whose quaternions have their real part first."""
    row, body = wp.tid()
    p, q = positions[row, body], quaternions[row, body]
    w, x, y, z = q[0], q[1], q[2], q[3]
    first = wp.vec3(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y))
    second = wp.vec3(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x))
    third = wp.vec3(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
    for i in range(3):
        bodies[row, 12 * body + i] = p[i]
        bodies[row, 12 * body + 3 + i] = first[i]
        bodies[row, 12 * body + 6 + i] = second[i]
        bodies[row, 12 * body + 9 + i] = third[i]


@wp.kernel
def read_vertices(
    bodies: wp.array2d(dtype=float), vertex_bodies: wp.array(dtype=int),
    places: wp.array(dtype=wp.vec3), vertices: wp.array2d(dtype=float)
) -> None:
    """Writes the vertices of cloths, which move with bodies."""
    row, vertex = wp.tid()
    pose = pose2(bodies, row, 12 * vertex_bodies[vertex])
    p = pose.position + direction_of(pose, places[vertex])
    for i in range(3):
        vertices[row, 3 * vertex + i] = p[i]
