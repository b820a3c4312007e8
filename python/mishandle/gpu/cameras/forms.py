"""Where rays enter the forms of shapes, and their normals, in their frames: ``form.rs`` and
``mesh.rs`` of the crate ``mishandle-camera`` as functions of kernels."""

# The annotations of kernels are calls, which type checkers reject.
# mypy: ignore-errors
# pyright: basic

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TINY = wp.constant(1e-20)
"""The least area of a direction across an axis, m²."""


@wp.func
def lesser(a: float, b: float):
    """Returns the lesser number, ``b`` if one is undefined."""
    return wp.where(a < b, a, b)


@wp.func
def greater(a: float, b: float):
    """Returns the greater number, ``b`` if one is undefined."""
    return wp.where(b < a, a, b)


@wp.func
def unit(v: wp.vec3):
    length = wp.sqrt(wp.dot(v, v))
    if length > 0.0:
        return v * (1.0 / length)
    return v


@wp.func
def enter_plane(size: wp.vec3, o: wp.vec3, d: wp.vec3):
    t = -o[2] / d[2]
    if (
        d[2] < 0.0 and 0.0 < o[2] and wp.abs(o[0] + t * d[0]) <= size[0]
        and wp.abs(o[1] + t * d[1]) <= size[1]
    ):
        return t
    return wp.inf


@wp.func
def enter_sphere(radius: float, o: wp.vec3, d: wp.vec3):
    square = wp.dot(d, d)
    middle = -wp.dot(o, d) / square
    p = o + d * middle
    rest = radius * radius - wp.dot(p, p)
    if rest < 0.0:
        return wp.inf
    t = middle - wp.sqrt(greater(rest, 0.0) / square)
    return wp.where(0.0 < t, t, wp.inf)


@wp.func
def slab(half: float, o: float, d: float):
    inverse = 1.0 / d
    a, b = (-half - o) * inverse, (half - o) * inverse
    return wp.vec2(lesser(a, b), greater(a, b))


@wp.func
def enter_box(half: wp.vec3, o: wp.vec3, d: wp.vec3):
    x, y, z = slab(half[0], o[0], d[0]), slab(half[1], o[1], d[1]), slab(half[2], o[2], d[2])
    t = greater(greater(x[0], y[0]), z[0])
    last = lesser(lesser(x[1], y[1]), z[1])
    return wp.where(t <= last and 0.0 < t, t, wp.inf)


@wp.func
def across(radius: float, o: wp.vec3, d: wp.vec3):
    """Returns where a ray meets the infinite cylinder around z: the middle, half the length inside,
    and the square of the radius minus that of the distance from the axis."""
    square = greater(d[0] * d[0] + d[1] * d[1], TINY)
    middle = -(o[0] * d[0] + o[1] * d[1]) / square
    x, y = o[0] + middle * d[0], o[1] + middle * d[1]
    rest = radius * radius - (x * x + y * y)
    return wp.vec3(middle, wp.sqrt(greater(rest, 0.0) / square), rest)


@wp.func
def enter_cylinder(radius: float, half: float, o: wp.vec3, d: wp.vec3):
    met = across(radius, o, d)
    ends = slab(half, o[2], d[2])
    t, last = greater(met[0] - met[1], ends[0]), lesser(met[0] + met[1], ends[1])
    return wp.where(t <= last and not (met[2] < 0.0) and 0.0 < t, t, wp.inf)


@wp.func
def enter_capsule(radius: float, half: float, o: wp.vec3, d: wp.vec3):
    met = across(radius, o, d)
    if met[2] < 0.0:
        return wp.inf
    side = met[0] - met[1]
    z = o[2] + side * d[2]
    if wp.abs(z) <= half:
        return wp.where(0.0 < side, side, wp.inf)
    # A ray that is beyond an end of the axis where it enters the cylinder enters by this cap.
    end = greater(lesser(z, half), -half)
    return enter_sphere(radius, wp.vec3(o[0], o[1], o[2] - end), d)


@wp.func
def divided(v: wp.vec3, by: wp.vec3):
    return wp.vec3(v[0] * (1.0 / by[0]), v[1] * (1.0 / by[1]), v[2] * (1.0 / by[2]))


@wp.func
def enter(kind: int, size: wp.vec3, o: wp.vec3, d: wp.vec3):
    """Returns where a ray enters a form that is not made of triangles, infinity if it does not."""
    t = float(wp.inf)
    if kind == 4:
        t = enter_capsule(size[0], size[1], o, d)
    elif kind == 3:
        t = enter_box(size, o, d)
    elif kind == 5:
        t = enter_cylinder(size[0], size[1], o, d)
    elif kind == 1:
        t = enter_plane(size, o, d)
    elif kind == 2:
        t = enter_sphere(size[0], o, d)
    elif kind == 6:
        t = enter_sphere(1.0, divided(o, size), divided(d, size))
    return t


@wp.func
def outwards(component: float):
    return wp.where(component < 0.0, -1.0, 1.0)


@wp.func
def normal_of(kind: int, size: wp.vec3, p: wp.vec3):
    """Returns the normal at a point of the surface of a form that is not made of triangles."""
    normal = wp.vec3(0.0, 0.0, 1.0)
    if kind == 2:
        normal = wp.vec3(p[0] / size[0], p[1] / size[0], p[2] / size[0])
    elif kind == 3:
        x, y, z = wp.abs(p[0]) - size[0], wp.abs(p[1]) - size[1], wp.abs(p[2]) - size[2]
        normal = wp.vec3(outwards(p[0]), 0.0, 0.0)
        most = x
        if y > most:
            normal, most = wp.vec3(0.0, outwards(p[1]), 0.0), y
        if z > most:
            normal = wp.vec3(0.0, 0.0, outwards(p[2]))
    elif kind == 4:
        center = wp.where(p[2] > size[1], size[1], greater(p[2], -size[1]))
        normal = wp.vec3(p[0] / size[0], p[1] / size[0], (p[2] - center) / size[0])
    elif kind == 5:
        from_axis = wp.sqrt(p[0] * p[0] + p[1] * p[1])
        if wp.abs(p[2]) - size[1] > from_axis - size[0]:
            normal = wp.vec3(0.0, 0.0, outwards(p[2]))
        else:
            normal = wp.vec3(p[0] / from_axis, p[1] / from_axis, 0.0)
    elif kind == 6:
        normal = unit(
            wp.vec3(
                p[0] / (size[0] * size[0]), p[1] / (size[1] * size[1]), p[2] / (size[2] * size[2])
            )
        )
    return normal


@wp.func
def meets(low: wp.vec3, high: wp.vec3, o: wp.vec3, inverse: wp.vec3, most: float):
    """Returns whether a ray meets a box before ``most``."""
    first, last = float(0.0), float(most)
    for i in range(3):
        a, b = (low[i] - o[i]) * inverse[i], (high[i] - o[i]) * inverse[i]
        first = greater(lesser(a, b), first)
        last = lesser(greater(a, b), last)
    # A box that a ray touches may be missed by rounding, so it is a little larger.
    return first <= last * 1.000001 + 1e-6


@wp.func
def enter_triangle(a: wp.vec3, b: wp.vec3, c: wp.vec3, o: wp.vec3, d: wp.vec3):
    """Returns where a ray meets a triangle, also behind its origin."""
    p, q, r = a - o, b - o, c - o
    u, v, w = wp.dot(d, wp.cross(q, r)), wp.dot(d, wp.cross(r, p)), wp.dot(d, wp.cross(p, q))
    normal = wp.cross(b - a, c - a)
    t = wp.dot(normal, p) / wp.dot(normal, d)
    is_inside = 0.0 <= lesser(lesser(u, v), w) or greater(greater(u, v), w) <= 0.0
    return wp.where(is_inside, t, wp.inf)


@wp.func
def enter_cloth(
    size: wp.vec3, o: wp.vec3, d: wp.vec3, least: float, most: float, image: int,
    vertices: wp.array2d(dtype=wp.vec3), lows: wp.array2d(dtype=wp.vec3),
    highs: wp.array2d(dtype=wp.vec3), triangles: wp.array2d(dtype=int), nodes: wp.array2d(dtype=int)
):
    """Returns where a ray first meets a triangle of the nodes from ``size[0]`` to ``size[1]`` after
    ``least`` and before ``most``, and which."""
    inverse = wp.vec3(1.0 / d[0], 1.0 / d[1], 1.0 / d[2])
    first, hit = float(most), int(0)
    node, end = int(size[0]), int(size[1])
    while node < end:
        if meets(lows[image, node], highs[image, node], o, inverse, first):
            if nodes[node, 3] == 1:
                for triangle in range(nodes[node, 0], nodes[node, 1]):
                    a = vertices[image, triangles[triangle, 0]]
                    b = vertices[image, triangles[triangle, 1]]
                    c = vertices[image, triangles[triangle, 2]]
                    t = enter_triangle(a, b, c, o, d)
                    if t > least and t < first:
                        first, hit = t, triangle
            node = node + 1
        else:
            node = nodes[node, 2]
    return first, hit


@wp.func
def of_cloth(
    image: int, triangle: int, p: wp.vec3, vertices: wp.array2d(dtype=wp.vec3),
    normals: wp.array2d(dtype=wp.vec3), triangles: wp.array2d(dtype=int)
):
    """Returns the normal of a triangle at a point of it."""
    i, j, k = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
    a, b, c = vertices[image, i], vertices[image, j], vertices[image, k]
    flat = wp.cross(b - a, c - a)
    # Areas of the parts opposite to the corners, along the normal.
    of_a = wp.dot(flat, wp.cross(b - p, c - p))
    of_b = wp.dot(flat, wp.cross(c - p, a - p))
    of_c = wp.dot(flat, wp.cross(a - p, b - p))
    return unit((normals[image, i] * of_a + normals[image, j] * of_b) + normals[image, k] * of_c)


@wp.kernel
def move_vertices(
    now: wp.array2d(dtype=float), before: wp.array2d(dtype=float), cameras: wp.array3d(dtype=float),
    sights: wp.array(dtype=int), first_state: int, ago_column: int,
    vertices: wp.array2d(dtype=wp.vec3)
) -> None:
    image, vertex = wp.tid()
    count = cameras.shape[1]
    state, camera = first_state + image // count, image % count
    column = 3 * vertex
    p = wp.vec3(now[state, column], now[state, column + 1], now[state, column + 2])
    ago = cameras[sights[state], camera, ago_column]
    if ago > 0.0:
        old = wp.vec3(before[state, column], before[state, column + 1], before[state, column + 2])
        p = p + (old - p) * ago
    vertices[image, vertex] = p


@wp.kernel
def fit_boxes(
    vertices: wp.array2d(dtype=wp.vec3), triangles: wp.array2d(dtype=int),
    nodes: wp.array2d(dtype=int), lows: wp.array2d(dtype=wp.vec3), highs: wp.array2d(dtype=wp.vec3)
) -> None:
    """Fits the box of each node to the vertices of its triangles."""
    image, node = wp.tid()
    low = wp.vec3(wp.inf, wp.inf, wp.inf)
    high = wp.vec3(-wp.inf, -wp.inf, -wp.inf)
    for triangle in range(nodes[node, 0], nodes[node, 1]):
        for corner in range(3):
            p = vertices[image, triangles[triangle, corner]]
            low, high = wp.min(low, p), wp.max(high, p)
    lows[image, node] = low
    highs[image, node] = high


@wp.kernel
def fit_normals(
    vertices: wp.array2d(dtype=wp.vec3), triangles: wp.array2d(dtype=int),
    first_of: wp.array(dtype=int), around: wp.array(dtype=int), normals: wp.array2d(dtype=wp.vec3)
) -> None:
    """Adds up the normals of the triangles around each vertex, which ``around`` has from
    ``first_of[vertex]`` on."""
    image, vertex = wp.tid()
    sum = wp.vec3(0.0, 0.0, 0.0)
    for place in range(first_of[vertex], first_of[vertex + 1]):
        triangle = around[place]
        a = vertices[image, triangles[triangle, 0]]
        b = vertices[image, triangles[triangle, 1]]
        c = vertices[image, triangles[triangle, 2]]
        sum = sum + wp.cross(b - a, c - a)
    normals[image, vertex] = unit(sum)
