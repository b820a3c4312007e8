//! The functions of the language.

use std::f64::consts::TAU;

/// A function of one, two or three numbers, applied to each number of its arguments, or of whole
/// vectors.
#[derive(Clone, Copy)]
pub(crate) enum Function {
    Map1(fn(f64) -> f64),
    Map2(fn(f64, f64) -> f64),
    Map3(fn(f64, f64, f64) -> f64),
    /// Reduces a vector to one number.
    Fold(Fold),
    /// Sizes of the arguments, size of the result (0: a number), and the function. A number is an
    /// argument of size 1.
    Whole(&'static [usize], usize, fn(&[&[f64]], &mut [f64])),
    /// The product of two vectors of the same length.
    Dot,
    /// The number of numbers of a vector.
    Length,
}

/// A reduction of a vector to one number.
#[derive(Clone, Copy)]
pub(crate) struct Fold {
    pub first: Start,
    pub next: fn(f64, f64) -> f64,
    pub last: fn(f64, f64) -> f64,
}

/// Value of a reduction before the first number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Start {
    /// 0.
    Zero,
    /// 1.
    One,
    /// The first number itself, and 0 without any.
    Itself,
}

impl Fold {
    /// Makes a reduction of numbers.
    pub(crate) fn start(self) -> Folding {
        Folding { fold: self, value: f64::from(u8::from(self.first == Start::One)), count: 0.0 }
    }
}

/// A reduction of the numbers so far.
pub(crate) struct Folding {
    fold: Fold,
    value: f64,
    count: f64,
}

impl Folding {
    pub(crate) fn push(&mut self, number: f64) {
        let is_first = self.count == 0.0 && self.fold.first == Start::Itself;
        self.value = if is_first { number } else { (self.fold.next)(self.value, number) };
        self.count += 1.0;
    }

    pub(crate) fn value(&self) -> f64 {
        (self.fold.last)(self.value, self.count)
    }
}

const fn fold(first: Start, next: fn(f64, f64) -> f64) -> Function {
    Function::Fold(Fold { first, next, last: |value, _| value })
}

fn truth(holds: bool) -> f64 {
    f64::from(u8::from(holds))
}

fn is_true(value: f64) -> bool {
    value != 0.0
}

/// The largest of two numbers; NaN if one is.
fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// The smallest of two numbers; NaN if one is.
fn smaller(a: f64, b: f64) -> f64 {
    if a.is_nan() || a < b { a } else { b }
}

fn smoothstep(x: f64) -> f64 {
    let x = smaller(larger(x, 0.0), 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// The remainder with the sign of the divisor, as in Python.
fn modulo(a: f64, b: f64) -> f64 {
    let rest = a % b;
    if rest != 0.0 && (rest < 0.0) != (b < 0.0) { rest + b } else { rest }
}

/// An angle between -π and π.
fn wrap_angle(angle: f64) -> f64 {
    let wrapped = modulo(angle + TAU / 2.0, TAU) - TAU / 2.0;
    if wrapped == -TAU / 2.0 && angle > 0.0 { TAU / 2.0 } else { wrapped }
}

/// Quaternion (w, x, y, z) of a roll about x, then a pitch about y, then a yaw about z, all about
/// fixed axes.
fn quat_euler(arguments: &[&[f64]], out: &mut [f64]) {
    let half = |i: usize| arguments[i][0] / 2.0;
    let (sr, cr) = half(0).sin_cos();
    let (sp, cp) = half(1).sin_cos();
    let (sy, cy) = half(2).sin_cos();
    out.copy_from_slice(&[
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]);
}

/// Roll, pitch and yaw of a quaternion.
fn euler(arguments: &[&[f64]], out: &mut [f64]) {
    let [w, x, y, z] = [0, 1, 2, 3].map(|i| arguments[0][i]);
    out[0] = (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y));
    out[1] = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin();
    out[2] = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
}

fn quat_multiply(arguments: &[&[f64]], out: &mut [f64]) {
    let [w, x, y, z] = [0, 1, 2, 3].map(|i| arguments[0][i]);
    let [a, b, c, d] = [0, 1, 2, 3].map(|i| arguments[1][i]);
    out.copy_from_slice(&[
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    ]);
}

fn cross_of(a: &[f64], b: &[f64]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Rotates a vector by a unit quaternion with this sign of its vector part.
fn rotated(q: &[f64], sign: f64, v: &[f64], out: &mut [f64]) {
    let u = [sign * q[1], sign * q[2], sign * q[3]];
    let t = cross_of(&u, v).map(|t| 2.0 * t);
    let s = cross_of(&u, &t);
    for i in 0..3 {
        out[i] = v[i] + q[0] * t[i] + s[i];
    }
}

/// A function with its description.
pub(crate) struct Entry {
    pub name: &'static str,
    /// Arguments, as the documentation shows them; empty for operators.
    pub arguments: &'static str,
    pub meaning: &'static str,
    pub function: Function,
}

const fn entry(
    name: &'static str,
    arguments: &'static str,
    function: Function,
    meaning: &'static str,
) -> Entry {
    Entry { name, arguments, meaning, function }
}

use Function::{Dot, Length, Map1, Map2, Map3, Whole};

/// All functions. `max` and `min` of one argument are reductions: see [`find`].
pub(crate) static FUNCTIONS: &[Entry] = &[
    entry("+", "", Map2(|a, b| a + b), "sum"),
    entry("-", "", Map2(|a, b| a - b), "difference"),
    entry("*", "", Map2(|a, b| a * b), "product"),
    entry("/", "", Map2(|a, b| a / b), "quotient"),
    entry("%", "", Map2(modulo), "remainder with the sign of the divisor"),
    entry("**", "", Map2(f64::powf), "power"),
    entry("negative", "", Map1(|a| -a), "negative"),
    entry("<", "", Map2(|a, b| truth(a < b)), "1 if less, otherwise 0"),
    entry("<=", "", Map2(|a, b| truth(a <= b)), "1 if at most, otherwise 0"),
    entry(">", "", Map2(|a, b| truth(a > b)), "1 if greater, otherwise 0"),
    entry(">=", "", Map2(|a, b| truth(a >= b)), "1 if at least, otherwise 0"),
    entry("==", "", Map2(|a, b| truth(a == b)), "1 if equal, otherwise 0"),
    entry("!=", "", Map2(|a, b| truth(a != b)), "1 if different, otherwise 0"),
    entry("and", "", Map2(|a, b| truth(is_true(a) && is_true(b))), "1 if both are not 0"),
    entry("or", "", Map2(|a, b| truth(is_true(a) || is_true(b))), "1 if one is not 0"),
    entry("not", "", Map1(|a| truth(!is_true(a))), "1 if it is 0"),
    entry(
        "where",
        "c, a, b",
        Map3(|c, a, b| if is_true(c) { a } else { b }),
        "a where c is not 0, otherwise b",
    ),
    entry("abs", "x", Map1(f64::abs), "absolute value"),
    entry("sqrt", "x", Map1(f64::sqrt), "square root"),
    entry("exp", "x", Map1(f64::exp), "exponential"),
    entry("log", "x", Map1(f64::ln), "natural logarithm"),
    entry("sin", "x", Map1(f64::sin), "sine"),
    entry("cos", "x", Map1(f64::cos), "cosine"),
    entry("tan", "x", Map1(f64::tan), "tangent"),
    entry("asin", "x", Map1(f64::asin), "inverse sine"),
    entry("acos", "x", Map1(f64::acos), "inverse cosine"),
    entry("atan", "x", Map1(f64::atan), "inverse tangent"),
    entry("tanh", "x", Map1(f64::tanh), "hyperbolic tangent"),
    entry("floor", "x", Map1(f64::floor), "largest integer that is not greater"),
    entry("ceil", "x", Map1(f64::ceil), "smallest integer that is not less"),
    entry("round", "x", Map1(f64::round_ties_even), "nearest integer, the even one of two"),
    entry("sign", "x", Map1(|x| if x == 0.0 { 0.0 } else { x.signum() }), "-1, 0 or 1"),
    entry("smoothstep", "x", Map1(smoothstep), "x²(3 - 2x) of x clipped to [0, 1]"),
    entry("wrap_angle", "x", Map1(wrap_angle), "angle between -π and π"),
    entry("atan2", "y, x", Map2(f64::atan2), "angle of the point (x, y)"),
    entry("hypot", "x, y", Map2(f64::hypot), "length of the vector (x, y)"),
    entry(
        "clip",
        "x, low, high",
        Map3(|x, low, high| smaller(larger(x, low), high)),
        "x, but at least low and at most high",
    ),
    entry("max", "a, b", Map2(larger), "the larger one; of one vector, its largest number"),
    entry("min", "a, b", Map2(smaller), "the smaller one; of one vector, its smallest number"),
    entry("sum", "v", fold(Start::Zero, |a, b| a + b), "sum of the numbers"),
    entry("product", "v", fold(Start::One, |a, b| a * b), "product of the numbers"),
    entry(
        "mean",
        "v",
        Function::Fold(Fold { first: Start::Zero, next: |a, b| a + b, last: |sum, n| sum / n }),
        "mean of the numbers",
    ),
    entry(
        "norm",
        "v",
        Function::Fold(Fold { first: Start::Zero, next: |a, b| a + b * b, last: |sum, _| sum.sqrt() }),
        "length of the vector",
    ),
    entry("any", "v", fold(Start::Zero, |a, b| truth(is_true(a) || is_true(b))), "1 if a number is not 0"),
    entry("all", "v", fold(Start::One, |a, b| truth(is_true(a) && is_true(b))), "1 if no number is 0"),
    entry("len", "v", Length, "number of numbers"),
    entry("dot", "a, b", Dot, "sum of the products of the numbers"),
    entry(
        "cross",
        "a, b",
        Whole(&[3, 3], 3, |a, out| out.copy_from_slice(&cross_of(a[0], a[1]))),
        "cross product",
    ),
    entry(
        "coordinates",
        "x, y, z, v",
        Whole(&[3, 3, 3, 3], 3, |a, out| {
            (0..3).for_each(|axis| out[axis] = (0..3).map(|i| a[axis][i] * a[3][i]).sum());
        }),
        "coordinates of the vector v along the axes x, y and z",
    ),
    entry(
        "quat_euler",
        "roll, pitch, yaw",
        Whole(&[1, 1, 1], 4, quat_euler),
        "quaternion (w, x, y, z) of rotations about the fixed axes x, then y, then z",
    ),
    entry(
        "quat_multiply",
        "p, q",
        Whole(&[4, 4], 4, quat_multiply),
        "product of two quaternions: first q, then p",
    ),
    entry(
        "quat_inverse",
        "q",
        Whole(&[4], 4, |a, out| out.copy_from_slice(&[a[0][0], -a[0][1], -a[0][2], -a[0][3]])),
        "inverse of a unit quaternion",
    ),
    entry("euler", "q", Whole(&[4], 3, euler), "roll, pitch and yaw of a unit quaternion"),
    entry(
        "rotate",
        "q, v",
        Whole(&[4, 3], 3, |a, out| rotated(a[0], 1.0, a[1], out)),
        "vector rotated by a unit quaternion",
    ),
    entry(
        "rotate_inverse",
        "q, v",
        Whole(&[4, 3], 3, |a, out| rotated(a[0], -1.0, a[1], out)),
        "vector rotated by the inverse of a unit quaternion",
    ),
];

/// Returns the function with a name and a number of arguments.
pub(crate) fn find(name: &str, arguments: usize) -> Option<Function> {
    match (name, arguments) {
        ("max", 1) => Some(fold(Start::Itself, larger)),
        ("min", 1) => Some(fold(Start::Itself, smaller)),
        _ => FUNCTIONS.iter().find(|entry| entry.name == name).map(|entry| entry.function),
    }
}
