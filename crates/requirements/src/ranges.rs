//! Which combinations of values can satisfy a formula at one sample: unions of boxes over linear
//! terms. Everything that is not a comparison of linear terms is assumed to be possible.

use std::collections::BTreeMap;

use mishandle_stl::SyntaxKind;

use crate::tree::{Tree, is_comparison};

/// Largest number of boxes; more are replaced by one without limits.
const MAX_BOXES: usize = 16;

/// Largest number of nodes of a formula whose values are analyzed.
pub(crate) const MAX_NODES: usize = 2000;

/// A set of numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Range {
    low: f64,
    high: f64,
    low_is_open: bool,
    high_is_open: bool,
}

impl Range {
    const ALL: Range =
        Range { low: f64::NEG_INFINITY, high: f64::INFINITY, low_is_open: false, high_is_open: false };

    fn is_empty(self) -> bool {
        self.low > self.high || self.low == self.high && (self.low_is_open || self.high_is_open)
    }

    fn and(self, other: Range) -> Range {
        let (low, low_is_open) = match self.low.total_cmp(&other.low) {
            std::cmp::Ordering::Less => (other.low, other.low_is_open),
            std::cmp::Ordering::Greater => (self.low, self.low_is_open),
            std::cmp::Ordering::Equal => (self.low, self.low_is_open || other.low_is_open),
        };
        let (high, high_is_open) = match self.high.total_cmp(&other.high) {
            std::cmp::Ordering::Less => (self.high, self.high_is_open),
            std::cmp::Ordering::Greater => (other.high, other.high_is_open),
            std::cmp::Ordering::Equal => (self.high, self.high_is_open || other.high_is_open),
        };
        Range { low, high, low_is_open, high_is_open }
    }
}

/// Ranges of linear terms, by their text; others are not limited.
type Box = BTreeMap<String, Range>;

/// A union of boxes: which values are possible.
#[derive(Clone, Debug)]
pub(crate) struct Possible(Vec<Box>);

impl Possible {
    fn all() -> Possible {
        Possible(vec![Box::new()])
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    fn or(&self, other: &Possible) -> Possible {
        if self.0.iter().chain(&other.0).any(Box::is_empty) {
            return Possible::all();
        }
        if self.0.len() + other.0.len() > MAX_BOXES {
            return Possible::all();
        }
        Possible(self.0.iter().chain(&other.0).cloned().collect())
    }

    pub fn and(&self, other: &Possible) -> Possible {
        if self.0.len() * other.0.len() > MAX_BOXES {
            // Each one alone is still an upper bound.
            return if self.0.len() <= other.0.len() { self.clone() } else { other.clone() };
        }
        let both = |a: &Box, b: &Box| {
            let mut both = a.clone();
            for (term, range) in b {
                let found = both.entry(term.clone()).or_insert(Range::ALL);
                *found = found.and(*range);
                if found.is_empty() {
                    return None;
                }
            }
            Some(both)
        };
        Possible(self.0.iter().flat_map(|a| other.0.iter().filter_map(move |b| both(a, b))).collect())
    }

    fn of(term: &str, ranges: &[Range]) -> Possible {
        let limit = term_limit(term);
        let ranges = ranges.iter().map(|range| range.and(limit)).filter(|range| !range.is_empty());
        Possible(ranges.map(|range| Box::from([(term.to_owned(), range)])).collect())
    }

    fn certain(holds: bool) -> Possible {
        if holds { Possible::all() } else { Possible(Vec::new()) }
    }
}

/// Returns the values that a term can have at all.
fn term_limit(term: &str) -> Range {
    let is_nonnegative = ["abs(", "sqrt(", "exp("].iter().any(|head| term.starts_with(head));
    // The text of a single call: its first parenthesis ends at the end.
    let mut depth = 0;
    let ends_early = term.char_indices().any(|(at, c)| {
        depth += i32::from(c == '(') - i32::from(c == ')');
        c == ')' && depth == 0 && at + 1 < term.len()
    });
    if is_nonnegative && !ends_early { Range { low: 0.0, ..Range::ALL } } else { Range::ALL }
}

/// A linear combination of terms: coefficients by the text of the term, and a constant.
#[derive(Clone, Debug, Default)]
struct Linear {
    terms: BTreeMap<String, f64>,
    constant: f64,
}

impl Linear {
    fn plus(&self, other: &Linear, factor: f64) -> Linear {
        let mut sum = self.clone();
        for (term, coefficient) in &other.terms {
            *sum.terms.entry(term.clone()).or_default() += factor * coefficient;
        }
        sum.terms.retain(|_, coefficient| *coefficient != 0.0);
        sum.constant += factor * other.constant;
        sum
    }

    fn times(&self, factor: f64) -> Linear {
        Linear::default().plus(self, factor)
    }
}

/// For each node the values for which it can hold at a sample, and those for which it can fail.
pub(crate) struct Analysis {
    pub holds: Vec<Possible>,
    pub fails: Vec<Possible>,
}

/// Analyzes a formula of at most [`MAX_NODES`] nodes.
pub(crate) fn analyze(tree: &Tree<'_>) -> Option<Analysis> {
    if tree.nodes.len() > MAX_NODES {
        return None;
    }
    let linear = linear_terms(tree);
    let mut found = Analysis { holds: Vec::new(), fails: Vec::new() };
    for (index, node) in tree.nodes.iter().enumerate() {
        let operand = |n: usize| node.operands[n];
        let (holds, fails) = match node.kind {
            SyntaxKind::Operator(name) if is_comparison(name) => {
                compared(name, &linear[operand(0)], &linear[operand(1)])
            }
            SyntaxKind::Operator("not") => (found.fails[operand(0)].clone(), found.holds[operand(0)].clone()),
            SyntaxKind::Operator(name @ ("and" | "or" | "implies")) => {
                let [a, b] = [operand(0), operand(1)];
                let holds = &found.holds;
                let fails = &found.fails;
                match name {
                    "and" => (holds[a].and(&holds[b]), fails[a].or(&fails[b])),
                    "or" => (holds[a].or(&holds[b]), fails[a].and(&fails[b])),
                    _ => (fails[a].or(&holds[b]), holds[a].and(&fails[b])),
                }
            }
            SyntaxKind::Operator(_) if !node.is_term => (Possible::all(), Possible::all()),
            // A number or a signal alone holds from 0 on.
            _ => compared(">=", &linear[index], &Linear::default()),
        };
        found.holds.push(holds);
        found.fails.push(fails);
    }
    Some(found)
}

/// Returns each node as a linear combination.
fn linear_terms(tree: &Tree<'_>) -> Vec<Linear> {
    let mut linear: Vec<Linear> = Vec::with_capacity(tree.nodes.len());
    for (index, node) in tree.nodes.iter().enumerate() {
        let of = |n: usize| &linear[node.operands[n]];
        let opaque = || Linear { terms: BTreeMap::from([(tree.text(index), 1.0)]), constant: 0.0 };
        let number = |n: usize| of(n).terms.is_empty().then(|| of(n).constant);
        let found = match node.kind {
            SyntaxKind::Number(value) => Linear { constant: value, ..Linear::default() },
            SyntaxKind::Operator("+") => of(0).plus(of(1), 1.0),
            SyntaxKind::Operator("-") if node.operands.len() == 2 => of(0).plus(of(1), -1.0),
            SyntaxKind::Operator("-") => of(0).times(-1.0),
            SyntaxKind::Operator("*") => match (number(0), number(1)) {
                (Some(factor), _) => of(1).times(factor),
                (None, Some(factor)) => of(0).times(factor),
                _ => opaque(),
            },
            SyntaxKind::Operator("/") => match number(1) {
                Some(divisor) if divisor != 0.0 => of(0).times(1.0 / divisor),
                _ => opaque(),
            },
            SyntaxKind::Operator("abs") => match number(0) {
                Some(value) => Linear { constant: value.abs(), ..Linear::default() },
                None => opaque(),
            },
            // A formula that is not compared is never read as a number.
            SyntaxKind::Operator(_) if !node.is_term && !is_compared(tree, index) => Linear::default(),
            _ => opaque(),
        };
        linear.push(found);
    }
    linear
}

/// Returns whether the node is an operand of a comparison or of arithmetic.
fn is_compared(tree: &Tree<'_>, node: usize) -> bool {
    let is_number =
        |parent: usize| tree.nodes[parent].is_term || tree.operator(parent).is_some_and(is_comparison);
    tree.parents[node].is_some_and(is_number)
}

/// Returns for which values `a` compared with `b` can hold and fail.
fn compared(operator: &str, a: &Linear, b: &Linear) -> (Possible, Possible) {
    let difference = a.plus(b, -1.0);
    let Some((first, scale)) = difference.terms.iter().next() else {
        let value = difference.constant;
        if value.is_nan() {
            return (Possible::all(), Possible::all());
        }
        let holds = match operator {
            "<=" => value <= 0.0,
            ">=" => value >= 0.0,
            "<" => value < 0.0,
            ">" => value > 0.0,
            "==" => value == 0.0,
            _ => value != 0.0,
        };
        return (Possible::certain(holds), Possible::certain(!holds));
    };
    let scale = *scale;
    let key = match difference.terms.len() {
        1 => first.clone(),
        _ => {
            let parts = difference.terms.iter().map(|(term, factor)| format!("{} {term}", factor / scale));
            parts.collect::<Vec<_>>().join(" + ")
        }
    };
    let limit = -difference.constant / scale;
    if !limit.is_finite() {
        return (Possible::all(), Possible::all());
    }
    // A product or quotient is rounded: a range is then a little wider.
    // Powers of two are exact.
    let is_exact = scale.to_bits() & ((1 << 52) - 1) == 0;
    let slack = if is_exact { 0.0 } else { 1e-12 * limit.abs() };
    let at_most =
        |is_open| Range { high: limit + slack, high_is_open: is_open && slack == 0.0, ..Range::ALL };
    let at_least = |is_open| Range { low: limit - slack, low_is_open: is_open && slack == 0.0, ..Range::ALL };
    let equal = at_most(false).and(at_least(false));
    let is_flipped = scale < 0.0;
    let (holds, fails) = match operator {
        "<=" if is_flipped => (vec![at_least(false)], vec![at_most(true)]),
        ">=" if is_flipped => (vec![at_most(false)], vec![at_least(true)]),
        "<" if is_flipped => (vec![at_least(true)], vec![at_most(false)]),
        ">" if is_flipped => (vec![at_most(true)], vec![at_least(false)]),
        "<=" => (vec![at_most(false)], vec![at_least(true)]),
        ">=" => (vec![at_least(false)], vec![at_most(true)]),
        "<" => (vec![at_most(true)], vec![at_least(false)]),
        ">" => (vec![at_least(true)], vec![at_most(false)]),
        "==" => (vec![equal], vec![at_most(true), at_least(true)]),
        _ => (vec![at_most(true), at_least(true)], vec![equal]),
    };
    // |t| <= c is -c <= t <= c, so that it can contradict a comparison of t.
    let inside = key.strip_prefix("abs(").and_then(|rest| rest.strip_suffix(')'));
    let is_call = inside.is_some() && term_limit(&key) != Range::ALL;
    let possible = |ranges: &[Range]| match inside.filter(|_| is_call) {
        Some(inside) => {
            let mirrored = |range: &Range| {
                let limited = range.and(Range { low: 0.0, ..Range::ALL });
                if limited.is_empty() {
                    return vec![];
                }
                let negative = Range {
                    low: -limited.high,
                    high: -limited.low,
                    low_is_open: limited.high_is_open,
                    high_is_open: limited.low_is_open,
                };
                if limited.low == 0.0 && !limited.low_is_open {
                    vec![Range { low: negative.low, low_is_open: negative.low_is_open, ..limited }]
                } else {
                    vec![negative, limited]
                }
            };
            Possible::of(inside, &ranges.iter().flat_map(mirrored).collect::<Vec<_>>())
        }
        None => Possible::of(&key, ranges),
    };
    (possible(&holds), possible(&fails))
}
