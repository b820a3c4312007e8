//! Points, vectors and rotations as plain arrays; quaternions are (w, x, y, z).

/// Returns `a - b`.
pub fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Returns `a + b`.
pub fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Returns `a` times the scalar `s`.
pub fn scale(a: [f64; 3], s: f64) -> [f64; 3] {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// Returns the dot product.
pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns the cross product.
pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns the Euclidean norm.
pub fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// Returns the Euclidean norm of the horizontal components.
pub fn norm_xy(a: [f64; 3]) -> f64 {
    a[0].hypot(a[1])
}

/// Returns `v` rotated by the unit quaternion `q`.
///
/// # Example
/// ```
/// use mishandle_world::frame::rotate;
/// let half = std::f64::consts::FRAC_1_SQRT_2; // a quarter turn about z takes x to y
/// let y = rotate([half, 0.0, 0.0, half], [1.0, 0.0, 0.0]);
/// assert!((y[1] - 1.0).abs() < 1e-15 && y[0].abs() < 1e-15);
/// ```
pub fn rotate(q: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let u = [q[1], q[2], q[3]];
    let t = scale(cross(u, v), 2.0);
    add(add(v, scale(t, q[0])), cross(u, t))
}

/// Returns `v` rotated by the inverse of the unit quaternion `q`.
pub fn rotate_back(q: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    rotate([q[0], -q[1], -q[2], -q[3]], v)
}

/// Returns the product of two quaternions: the rotation by `b`, then by `a`.
///
/// # Example
/// ```
/// use mishandle_world::frame::{multiply, rotate};
/// let half = std::f64::consts::FRAC_1_SQRT_2; // a quarter turn about z, twice
/// let turned = multiply([half, 0.0, 0.0, half], [half, 0.0, 0.0, half]);
/// assert!((rotate(turned, [1.0, 0.0, 0.0])[0] + 1.0).abs() < 1e-15);
/// ```
pub fn multiply(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    let [w, x, y, z] = a;
    [
        w * b[0] - x * b[1] - y * b[2] - z * b[3],
        w * b[1] + x * b[0] + y * b[3] - z * b[2],
        w * b[2] - x * b[3] + y * b[0] + z * b[1],
        w * b[3] + x * b[2] - y * b[1] + z * b[0],
    ]
}

/// Returns the inverse of a unit quaternion.
pub fn inverse([w, x, y, z]: [f64; 4]) -> [f64; 4] {
    [w, -x, -y, -z]
}
