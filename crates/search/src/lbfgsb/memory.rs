//! The limited-memory model of curvature: B = θI - W M Wᵀ.

use std::collections::VecDeque;

use super::dense::{Square, dot};

/// The last few pairs of steps s and changes of gradient y, and what is derived from them.
///
/// With S and Y holding the pairs as columns, oldest first, D the diagonal and L the strictly lower triangle of SᵀY:
///
/// ```text
/// B = θI - W M Wᵀ,   W = [Y  θS],   M = [-D  Lᵀ; L  θSᵀS]⁻¹,   θ = yᵀy / yᵀs of the newest pair
/// T = θSᵀS + L D⁻¹ Lᵀ = JJᵀ
/// ```
///
/// # Reference
/// Byrd, Lu, Nocedal and Zhu, "A limited memory algorithm for bound constrained optimization", SIAM J. Sci. Comput.
/// 16, 1995, section 3.
#[derive(Debug, Clone)]
pub(super) struct Memory {
    capacity: usize,
    pub(super) s: VecDeque<Vec<f64>>,
    pub(super) y: VecDeque<Vec<f64>>,
    /// The rows of the lower triangle of SᵀY and of SᵀS.
    sy: VecDeque<VecDeque<f64>>,
    ss: VecDeque<VecDeque<f64>>,
    pub(super) theta: f64,
    /// Jᵀ, in the upper triangle.
    factor: Square,
    has_new_pair: bool,
    has_dropped_pair: bool,
}

impl Memory {
    /// An empty memory, B = I, for `capacity` pairs.
    pub(super) fn new(capacity: usize) -> Self {
        Self {
            capacity,
            s: VecDeque::new(),
            y: VecDeque::new(),
            sy: VecDeque::new(),
            ss: VecDeque::new(),
            theta: 1.0,
            factor: Square::default(),
            has_new_pair: false,
            has_dropped_pair: false,
        }
    }

    /// The number of pairs held.
    pub(super) fn len(&self) -> usize {
        self.s.len()
    }

    /// Forgets all pairs: B = I again.
    pub(super) fn clear(&mut self) {
        *self = Self::new(self.capacity);
    }

    /// Whether the last iteration added a pair.
    pub(super) fn has_new_pair(&self) -> bool {
        self.has_new_pair
    }

    /// Whether a pair has had to make room since the memory was empty.
    pub(super) fn has_dropped_pair(&self) -> bool {
        self.has_dropped_pair
    }

    /// Notes that an iteration added no pair.
    pub(super) fn keep(&mut self) {
        self.has_new_pair = false;
    }

    /// Adds a pair, with sᵀs and yᵀs as the caller has them; `None`, and an empty memory, if T is not positive
    /// definite.
    pub(super) fn push(&mut self, s: Vec<f64>, y: Vec<f64>, ss: f64, ys: f64) -> Option<()> {
        self.has_new_pair = true;
        if self.len() == self.capacity {
            self.has_dropped_pair = true;
            self.s.pop_front();
            self.y.pop_front();
            for lower_triangle in [&mut self.sy, &mut self.ss] {
                lower_triangle.pop_front();
                for row in lower_triangle {
                    row.pop_front();
                }
            }
        }
        self.theta = dot(&y, &y) / ys;
        self.sy.push_back(self.y.iter().map(|old| dot(&s, old)).chain([ys]).collect());
        self.ss.push_back(self.s.iter().map(|old| dot(old, &s)).chain([ss]).collect());
        self.s.push_back(s);
        self.y.push_back(y);
        let done = self.factorise();
        if done.is_none() {
            self.clear();
        }
        done
    }

    fn factorise(&mut self) -> Option<()> {
        let n = self.len();
        self.factor = Square::zero(n);
        for i in 0..n {
            for j in i..n {
                let sum: f64 = (0..i).map(|k| self.sy[i][k] * self.sy[j][k] / self.sy[k][k]).sum();
                self.factor.set(i, j, sum + self.theta * self.ss[j][i]);
            }
        }
        self.factor.factorise(0..n)
    }

    /// yᵀs of pair `i`: an entry of D.
    pub(super) fn curvature(&self, i: usize) -> f64 {
        self.sy[i][i]
    }

    /// Row `i` of W: the coordinate `i` of every y, then of every θs.
    pub(super) fn row(&self, i: usize) -> Vec<f64> {
        let (y, s) = (self.y.iter(), self.s.iter());
        y.map(|y| y[i]).chain(s.map(|s| self.theta * s[i])).collect()
    }

    /// M v, by the two triangular systems that hold M⁻¹ in factors.
    ///
    /// ```text
    /// [D^½  0; -L D^-½  J] p = v,   [-D^½  D^-½ Lᵀ; 0  Jᵀ] q = p
    /// ```
    pub(super) fn middle(&self, v: &[f64]) -> Vec<f64> {
        let n = self.len();
        let (first, second) = v.split_at(n);
        let mut lower: Vec<f64> = (0..n)
            .map(|i| second[i] + (0..i).map(|k| self.sy[i][k] * first[k] / self.sy[k][k]).sum::<f64>())
            .collect();
        self.factor.solve_transposed(&mut lower);
        self.factor.solve(&mut lower);
        let upper = (0..n).map(|i| {
            let sum: f64 = (i + 1..n).map(|k| self.sy[k][i] * lower[k]).sum();
            (sum - first[i]) / self.sy[i][i]
        });
        let upper: Vec<f64> = upper.collect();
        upper.into_iter().chain(lower).collect()
    }
}
