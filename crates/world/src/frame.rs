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
