//! Bounds of the robustness over all continuations of a trace, by the definitions, with the sign of
//! each zero.

use mishandle_stl::Bounds;

use super::{COMPARISONS, Interval, Tree, ahead, behind, is_open, minus};

/// The least and the greatest value at each sample.
#[derive(Clone, Debug)]
struct Sides {
    low: Vec<f64>,
    high: Vec<f64>,
}

impl Sides {
    fn at(&self, t: usize) -> Bounds {
        Bounds { low: self.low[t], high: self.high[t] }
    }
}

fn min(x: f64, y: f64) -> f64 {
    if x.total_cmp(&y).is_le() { x } else { y }
}

fn max(x: f64, y: f64) -> f64 {
    -min(-x, -y)
}

fn least(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::INFINITY, min)
}

fn greatest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::NEG_INFINITY, max)
}

/// Returns the value of an operator on one sample; the sign of a zero is the verdict.
fn pointwise(name: &str, x: f64, y: f64) -> f64 {
    let both = |x, y| max(min(x, y), min(-x, -y));
    match name {
        "abs" => x.abs(),
        "not" => -x,
        "+" => x + y,
        "*" => x * y,
        "-" | ">=" => minus(x, y),
        "<=" => minus(y, x),
        "<" => -minus(x, y),
        ">" => -minus(y, x),
        "==" => 0.0 - minus(x, y).abs(),
        "!==" => -(0.0 - minus(x, y).abs()),
        "and" => min(x, y),
        "or" => max(x, y),
        "implies" => max(-x, y),
        "iff" => both(x, y),
        "xor" => -both(x, y),
        _ => unreachable!("{name}"),
    }
}

/// Returns the bounds of an operator on one sample.
fn pointwise_bounds(name: &str, x: Bounds, y: Bounds) -> Bounds {
    let not = |x: Bounds| Bounds { low: -x.high, high: -x.low };
    let both = |name, x: Bounds, y: Bounds| Bounds {
        low: pointwise(name, x.low, y.low),
        high: pointwise(name, x.high, y.high),
    };
    let iff = |x, y| both("or", both("and", x, y), both("and", not(x), not(y)));
    let is_known = |x: Bounds| x.low.to_bits() == x.high.to_bits();
    match name {
        "not" | "negate" => not(x),
        "and" | "or" => both(name, x, y),
        "implies" => both("or", not(x), y),
        "iff" => iff(x, y),
        "xor" => not(iff(x, y)),
        _ if is_known(x) && is_known(y) => exact(pointwise(name, x.low, y.low)),
        _ => Bounds::UNKNOWN,
    }
}

fn exact(value: f64) -> Bounds {
    Bounds { low: value, high: value }
}

impl Tree {
    /// Returns the bounds at time 0 over all continuations of the first `n` samples to one of these
    /// numbers of samples. The number counts as independent for each window without an end. `None`
    /// if no such trace decides the formula.
    pub fn bounds(&self, trace: &[Vec<f64>], n: usize, lengths: &[usize]) -> Option<Bounds> {
        let longest = lengths[lengths.len() - 1];
        self.is_decided(0, longest).then(|| self.sides(trace, n, lengths).at(0))
    }

    fn is_state(&self) -> bool {
        match self {
            Tree::Number(_) | Tree::Signal(_) => true,
            Tree::One(name, _, x) => ["abs", "-", "not"].contains(name) && x.is_state(),
            Tree::Two(name, window, x, y) => {
                let is_temporal = ["until", "release", "unless", "since"].contains(name);
                assert!(is_temporal || window.is_none());
                !is_temporal && x.is_state() && y.is_state()
            }
        }
    }

    fn state(&self, trace: &[Vec<f64>], t: usize) -> f64 {
        match self {
            Tree::Number(value) => *value,
            Tree::Signal(signal) => trace[*signal][t],
            Tree::One(name, _, x) if *name == "-" => -x.state(trace, t),
            Tree::One(name, _, x) => pointwise(name, x.state(trace, t), 0.0),
            Tree::Two(name, _, x, y) => pointwise(name, x.state(trace, t), y.state(trace, t)),
        }
    }

    /// Returns the bounds at all samples of the longest trace; those at samples that are not
    /// decided have no meaning.
    fn sides(&self, trace: &[Vec<f64>], n: usize, lengths: &[usize]) -> Sides {
        if let Some(expanded) = self.expanded() {
            return expanded.sides(trace, n, lengths);
        }
        let longest = lengths[lengths.len() - 1];
        let of = |values: Vec<Bounds>| {
            let (low, high) = values.into_iter().map(|bounds| (bounds.low, bounds.high)).unzip();
            Sides { low, high }
        };
        if self.is_state() {
            let known = |t| if t < n { exact(self.state(trace, t)) } else { Bounds::UNKNOWN };
            return of((0..longest).map(known).collect());
        }
        let (name, window, operands) = match self {
            Tree::One(name, window, x) => (*name, *window, [x, x]),
            Tree::Two(name, window, x, y) => (*name, *window, [x, y]),
            _ => unreachable!("is a state formula"),
        };
        let is_timed =
            ["always", "eventually", "historically", "once", "until", "release", "unless", "since"]
                .contains(&name);
        let is_pointwise = !is_timed && !["next", "s_next", "prev", "s_prev", "rise", "fall"].contains(&name);
        let [x, y] = operands.map(|operand| match **operand {
            // A number is known at all samples.
            Tree::Number(value) if is_pointwise => of(vec![exact(value); longest]),
            _ => operand.sides(trace, n, lengths),
        });
        let bounds = |t: usize| {
            if !self.is_decided(t, longest) {
                return Bounds::UNKNOWN;
            }
            if is_pointwise {
                let name = if name == "-" && matches!(self, Tree::One(..)) { "negate" } else { name };
                return pointwise_bounds(name, x.at(t), y.at(t));
            }
            let before = |start: f64| if t == 0 { exact(start) } else { x.at(t - 1) };
            match name {
                "rise" => {
                    return pointwise_bounds(
                        "and",
                        pointwise_bounds("not", before(f64::NEG_INFINITY), Bounds::UNKNOWN),
                        x.at(t),
                    );
                }
                "fall" => {
                    return pointwise_bounds(
                        "and",
                        before(f64::INFINITY),
                        pointwise_bounds("not", x.at(t), Bounds::UNKNOWN),
                    );
                }
                "next" | "s_next" => return x.at(t + 1),
                "prev" => return before(f64::INFINITY),
                "s_prev" => return before(f64::NEG_INFINITY),
                _ => {}
            }
            let mut ends =
                lengths.iter().filter(|end| self.is_decided(t, **end)).copied().collect::<Vec<_>>();
            if !is_open(window) {
                ends = vec![longest];
            }
            let side = |x: &[f64], y: &[f64]| -> Vec<f64> {
                ends.iter()
                    .map(|end| monotone(name, window, operands.map(|it| &**it), x, y, t, *end))
                    .collect()
            };
            Bounds {
                low: least(side(&x.low, &y.low).into_iter()),
                high: greatest(side(&x.high, &y.high).into_iter()),
            }
        };
        of((0..longest).map(bounds).collect())
    }
}

/// Returns the value at t of an operator with a window on a trace of `end` samples.
fn monotone(
    name: &str,
    window: Interval,
    operands: [&Tree; 2],
    x: &[f64],
    y: &[f64],
    t: usize,
    end: usize,
) -> f64 {
    assert!(!COMPARISONS.contains(&name));
    let [first, last] = operands;
    // Up to which sample `until` and `release` read the left operand, and `unless`.
    let left = |s: usize| t..s + usize::from(name == "unless");
    let is_binary = matches!(name, "until" | "release" | "unless");
    let is_whole = |s: &usize| {
        !is_open(window)
            || (last.is_decided(*s, end) && (!is_binary || left(*s).all(|r| first.is_decided(r, end))))
    };
    let steps: Vec<usize> = ahead(t, window, end).take_while(is_whole).collect();
    let past: Vec<usize> = behind(t, window).collect();
    let until = |s: usize| min(y[s], least(x[t..s].iter().copied()));
    match name {
        "always" => least(steps.into_iter().map(|s| x[s])),
        "eventually" => greatest(steps.into_iter().map(|s| x[s])),
        "historically" => least(past.into_iter().map(|s| x[s])),
        "once" => greatest(past.into_iter().map(|s| x[s])),
        "until" => greatest(steps.into_iter().map(until)),
        "release" => least(steps.into_iter().map(|s| max(y[s], greatest(x[t..s].iter().copied())))),
        "unless" => {
            let held = t..=steps[steps.len() - 1];
            max(least(held.map(|s| x[s])), greatest(steps.into_iter().map(until)))
        }
        "since" => greatest(past.into_iter().map(|s| min(y[s], least(x[s + 1..=t].iter().copied())))),
        _ => unreachable!("{name}"),
    }
}
