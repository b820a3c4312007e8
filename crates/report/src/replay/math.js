// Vectors are arrays of 3 numbers, quaternions w x y z, matrices 16 numbers by columns. z is up.
const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const norm = (a) => Math.hypot(a[0], a[1], a[2]);
const unit = (a) => scale(a, 1 / (norm(a) || 1));
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

/** Returns the matrix of a position and a quaternion, which may have any length but 0. */
function poseMatrix(p, [w, x, y, z]) {
  const s = 2 / (w * w + x * x + y * y + z * z || 1);
  return [1 - s * (y * y + z * z), s * (x * y + w * z), s * (x * z - w * y), 0,
    s * (x * y - w * z), 1 - s * (x * x + z * z), s * (y * z + w * x), 0,
    s * (x * z + w * y), s * (y * z - w * x), 1 - s * (x * x + y * y), 0, ...p, 1];
}

/** Returns the matrix of a frame at `p` whose z axis has this direction. */
function alongMatrix(p, z) {
  const axis = unit(z);
  const x = unit(cross(Math.abs(axis[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0], axis));
  return [...x, 0, ...cross(axis, x), 0, ...axis, 0, ...p, 1];
}

function multiply(a, b) {
  const out = new Float32Array(16);
  for (let i = 0; i < 16; i++) {
    for (let k = 0; k < 4; k++) out[i] += a[4 * k + (i % 4)] * b[i - (i % 4) + k];
  }
  return out;
}

/** Returns the matrix from the world to a camera at `eye` with axes to the right, upwards and backwards. */
function lookMatrix(eye, [x, y, z]) {
  return [x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, -dot(x, eye), -dot(y, eye), -dot(z, eye), 1];
}

function perspective(fovy, aspect, near, far) {
  const f = 1 / Math.tan(fovy / 2);
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
}
const scaleMatrix = (x, y, z) => [x, 0, 0, 0, 0, y, 0, 0, 0, 0, z, 0, 0, 0, 0, 1];
