//! The limited-memory approximation of the Hessian: B = θI - W M Wᵀ.

use std::collections::VecDeque;

use super::dense::{SquareMatrix, dot};

/// The last correction pairs, steps s and gradient changes y, and quantities derived from them.
///
/// S and Y have the pairs as columns, oldest first. D is the diagonal and L the strictly lower
/// triangle of SᵀY.
///
/// ```text
/// B = θI - W M Wᵀ,   W = [Y  θS],   M = [-D  Lᵀ; L  θSᵀS]⁻¹,   θ = yᵀy / yᵀs of the newest pair
/// T = θSᵀS + L D⁻¹ Lᵀ = JJᵀ
/// ```
///
/// # Reference
/// Byrd, Lu, Nocedal and Zhu, "A limited memory algorithm for bound constrained optimization", SIAM
/// J. Sci. Comput. 16, 1995, section 3.
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
    factor: SquareMatrix,
    has_new_pair: bool,
    has_dropped_pair: bool,
}

impl Memory {
    /// Creates an empty memory for `capacity` pairs: B = I.
    pub(super) fn new(capacity: usize) -> Self {
        Self {
            capacity,
            s: VecDeque::new(),
            y: VecDeque::new(),
            sy: VecDeque::new(),
            ss: VecDeque::new(),
            theta: 1.0,
            factor: SquareMatrix::default(),
            has_new_pair: false,
            has_dropped_pair: false,
        }
    }

    /// Returns the number of pairs.
    pub(super) fn len(&self) -> usize {
        self.s.len()
    }

    /// Removes all pairs: B = I.
    pub(super) fn clear(&mut self) {
        *self = Self::new(self.capacity);
    }

    /// Returns whether the last iteration added a pair.
    pub(super) fn has_new_pair(&self) -> bool {
        self.has_new_pair
    }

    /// Returns whether a pair was dropped since the memory was empty.
    pub(super) fn has_dropped_pair(&self) -> bool {
        self.has_dropped_pair
    }

    /// Records that an iteration added no pair.
    pub(super) fn skip_pair(&mut self) {
        self.has_new_pair = false;
    }

    /// Adds a pair, given sᵀs and yᵀs. If T is not positive definite, clears the memory and returns
    /// `None`.
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
        let done = self.factorize();
        if done.is_none() {
            self.clear();
        }
        done
    }

    fn factorize(&mut self) -> Option<()> {
        let n = self.len();
        self.factor = SquareMatrix::zero(n);
        for i in 0..n {
            for j in i..n {
                let sum: f64 = (0..i).map(|k| self.sy[i][k] * self.sy[j][k] / self.sy[k][k]).sum();
                self.factor.set(i, j, sum + self.theta * self.ss[j][i]);
            }
        }
        self.factor.factorize(0..n)
    }

    /// Returns yᵀs of pair `i`, an entry of D.
    pub(super) fn curvature(&self, i: usize) -> f64 {
        self.sy[i][i]
    }

    /// Returns row `i` of W: coordinate `i` of every y, then of every θs.
    pub(super) fn row(&self, i: usize) -> Vec<f64> {
        let y = self.y.iter();
        let s = self.s.iter();
        y.map(|y| y[i]).chain(s.map(|s| self.theta * s[i])).collect()
    }

    /// Returns M v, by solving two triangular systems with the factors of M⁻¹.
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
