// Triangles of shapes: for each corner its position and its normal, 6 numbers.

const AROUND = 32;

/** Returns a surface of revolution. A profile has rows of radius, height and their normal. */
function lathe(profiles) {
  const out = [];
  const corner = ([r, z, nr, nz], step) => {
    const angle = (2 * Math.PI * step) / AROUND;
    const [x, y] = [Math.cos(angle), Math.sin(angle)];
    out.push(r * x, r * y, z, nr * x, nr * y, nz);
  };
  for (const profile of profiles) {
    for (let row = 0; row + 1 < profile.length; row++) {
      const [low, high] = [profile[row], profile[row + 1]];
      for (let step = 0; step < AROUND; step++) {
        for (const [at, turn] of [[low, 0], [low, 1], [high, 1], [low, 0], [high, 1], [high, 0]]) corner(at, step + turn);
      }
    }
  }
  return out;
}

/** Returns the profile of a ball's part between two angles from below, moved up by `z`. */
function arc(radius, from, to, z) {
  return Array.from({ length: 13 }, (_, i) => {
    const angle = from + ((to - from) * i) / 12;
    const [r, h] = [Math.sin(angle), -Math.cos(angle)];
    return [radius * r, z + radius * h, r, h];
  });
}

const disk = (radius, z, normal) =>
  normal < 0 ? [[0, z, 0, -1], [radius, z, 0, -1]] : [[radius, z, 0, 1], [0, z, 0, 1]];
const wall = (radius, half) => [[radius, -half, 1, 0], [radius, half, 1, 0]];

const SQUARE = [[-1, -1], [1, -1], [1, 1], [-1, -1], [1, 1], [-1, 1]];

function box() {
  const out = [];
  for (let side = 0; side < 6; side++) {
    const turned = (v) => [0, 1, 2].map((i) => v[(i + side) % 3] * (side < 3 ? 1 : -1));
    for (const [u, v] of SQUARE) out.push(...turned([u, v, 1]), ...turned([0, 0, 1]));
  }
  return out;
}

/** Returns the corners of triangles. A normal is the mean of the triangles that meet there with a smaller angle. */
function mesh(vertices, triangles, smoothest) {
  const at = (vertex) => [vertices[3 * vertex], vertices[3 * vertex + 1], vertices[3 * vertex + 2]];
  const meet = new Map();
  const faces = [];
  for (let i = 0; i < triangles.length; i += 3) {
    const corners = [triangles[i], triangles[i + 1], triangles[i + 2]];
    const [a, b, c] = corners.map(at);
    const area = cross(sub(b, a), sub(c, a));
    const face = { corners, area, normal: unit(area) };
    faces.push(face);
    corners.forEach((vertex) => meet.set(vertex, [...(meet.get(vertex) ?? []), face]));
  }
  const out = [];
  for (const { corners, normal } of faces) {
    for (const vertex of corners) {
      const near = meet.get(vertex).filter((other) => dot(other.normal, normal) > smoothest);
      out.push(...at(vertex), ...unit(near.reduce((sum, other) => add(sum, other.area), [0, 0, 0])));
    }
  }
  return out;
}

/** Returns corners and scale of a shape of a scene. */
function solid(shape, meshes) {
  const [a, b, c] = shape.size;
  const sphere = () => lathe([arc(1, 0, Math.PI, 0)]);
  switch (shape.kind) {
    case "plane": return { corners: SQUARE.flatMap(([x, y]) => [x, y, 0, 0, 0, 1]), scale: [200, 200, 1] };
    case "sphere": return { corners: sphere(), scale: [a, a, a] };
    case "ellipsoid": return { corners: sphere(), scale: [a, b, c] };
    case "box": return { corners: box(), scale: [a, b, c] };
    case "cylinder": return { corners: lathe([disk(1, -1, -1), wall(1, 1), disk(1, 1, 1)]), scale: [a, a, b] };
    case "capsule": return { corners: lathe([arc(a, 0, Math.PI / 2, -b), wall(a, b), arc(a, Math.PI / 2, Math.PI, b)]), scale: [1, 1, 1] };
    default: return { corners: mesh(...meshes[shape.mesh], 0.8), scale: [1, 1, 1] };
  }
}

/** Returns an arrow of length 1 along z: a thin shaft, and a tip. */
function arrow() {
  return lathe([[[0, 0, 0, -1], [0.035, 0, 0, -1]], [[0.035, 0, 1, 0], [0.035, 0.72, 1, 0]],
    [[0.035, 0.72, 0, -1], [0.09, 0.72, 0, -1]], [[0.09, 0.72, 0.95, 0.3], [0, 1, 0.95, 0.3]]]);
}
