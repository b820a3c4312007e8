//! A reference evaluator by the definitions, in quadratic time, and random formulas for it. It
//! shares no code with the crate: it has its own trees, which it writes as text in any of the
//! allowed spellings.

mod bounds;

/// SplitMix64.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Returns a whole number below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    pub fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len())]
    }

    /// Returns a multiple of 1/4 in [-5, 5], so that ties are common.
    pub fn value(&mut self) -> f64 {
        self.below(41) as f64 / 4.0 - 5.0
    }

    pub fn column(&mut self, n: usize) -> Vec<f64> {
        (0..n).map(|_| self.value()).collect()
    }
}

/// A window in samples; without an end it extends to the end (or start) of the trace.
pub type Interval = Option<(usize, usize)>;

#[derive(Clone, Debug)]
pub enum Tree {
    Number(f64),
    Signal(usize),
    One(&'static str, Interval, Box<Tree>),
    Two(&'static str, Interval, Box<Tree>, Box<Tree>),
}

pub const NAMES: [&str; 3] = ["a", "b", "c_1"];

const ARITHMETIC_ONE: [&str; 2] = ["abs", "-"];
const ARITHMETIC_TWO: [&str; 3] = ["+", "-", "*"];
const COMPARISONS: [&str; 6] = ["<=", ">=", "<", ">", "==", "!=="];
pub const ONE: [&str; 7] = ["not", "next", "prev", "s_next", "s_prev", "rise", "fall"];
pub const TWO: [&str; 5] = ["and", "or", "implies", "iff", "xor"];
pub const TIMED_ONE: [&str; 4] = ["always", "eventually", "historically", "once"];
pub const TIMED_TWO: [&str; 4] = ["until", "release", "unless", "since"];

/// Returns all spellings of an operator, including its name.
fn spellings(name: &'static str) -> &'static [&'static str] {
    match name {
        "not" => &["not ", "!"],
        "and" => &["and", "&"],
        "or" => &["or", "|"],
        "implies" => &["implies", "->"],
        "iff" => &["iff", "<->"],
        "always" => &["always", "G"],
        "eventually" => &["eventually", "F"],
        "historically" => &["historically", "H"],
        "once" => &["once", "O"],
        "next" => &["next ", "X "],
        "prev" => &["prev ", "Y "],
        "s_next" => &["s_next ", "sX "],
        "s_prev" => &["s_prev ", "sY "],
        "until" => &["until", "U"],
        "unless" => &["unless", "W"],
        "release" => &["release", "R"],
        "since" => &["since", "S"],
        "!==" => &["!==", "!="],
        _ => std::slice::from_ref(match name {
            "rise" => &"rise",
            "fall" => &"fall",
            "abs" => &"abs",
            "<=" => &"<=",
            ">=" => &">=",
            "<" => &"<",
            ">" => &">",
            "==" => &"==",
            "xor" => &"xor",
            "+" => &"+",
            "-" => &"-",
            "*" => &"*",
            _ => unreachable!("{name}"),
        }),
    }
}

impl Tree {
    /// Returns a random formula of about `size` operators for traces of about `n` samples.
    pub fn random(random: &mut Random, size: usize, n: usize) -> Tree {
        if size == 0 {
            return match random.below(8) {
                0 => Tree::Signal(random.below(NAMES.len())),
                1 => Tree::Number(random.pick(&[f64::INFINITY, f64::NEG_INFINITY, 1.5])),
                _ => {
                    let x = Tree::arithmetic(random, 1);
                    let y = Tree::arithmetic(random, 0);
                    Tree::Two(random.pick(&COMPARISONS), None, Box::new(x), Box::new(y))
                }
            };
        }
        let sub = |random: &mut Random, size| Box::new(Tree::random(random, size, n));
        match random.below(10) {
            0 | 1 => Tree::One(random.pick(&ONE), None, sub(random, size - 1)),
            2..=4 => Tree::One(random.pick(&TIMED_ONE), interval(random, n), sub(random, size - 1)),
            kind => {
                let left = random.below(size);
                let x = sub(random, left);
                let y = sub(random, size - 1 - left);
                match kind {
                    5 | 6 => Tree::Two(random.pick(&TWO), None, x, y),
                    7 => Tree::Two(random.pick(&COMPARISONS), None, x, y),
                    _ => Tree::Two(random.pick(&TIMED_TWO), interval(random, n), x, y),
                }
            }
        }
    }

    /// Returns a random formula that reads a signal.
    pub fn reading(random: &mut Random, size: usize, n: usize) -> Tree {
        loop {
            let tree = Tree::random(random, size, n);
            if tree.reads() {
                return tree;
            }
        }
    }

    fn reads(&self) -> bool {
        match self {
            Tree::Number(_) => false,
            Tree::Signal(_) => true,
            Tree::One(_, _, x) => x.reads(),
            Tree::Two(_, _, x, y) => x.reads() || y.reads(),
        }
    }

    /// Arithmetic over signals and numbers.
    fn arithmetic(random: &mut Random, size: usize) -> Tree {
        match random.below(if size == 0 { 2 } else { 5 }) {
            0 => Tree::Signal(random.below(NAMES.len())),
            1 => Tree::Number(random.value()),
            2 => Tree::One(random.pick(&ARITHMETIC_ONE), None, Box::new(Tree::arithmetic(random, size - 1))),
            _ => {
                let x = Tree::arithmetic(random, size - 1);
                let y = Tree::arithmetic(random, size - 1);
                Tree::Two(random.pick(&ARITHMETIC_TWO), None, Box::new(x), Box::new(y))
            }
        }
    }

    /// Returns the formula as text, in random spellings, every operand in parentheses.
    pub fn write(&self, random: &mut Random) -> String {
        match self {
            Tree::Number(f64::INFINITY) => "true".to_owned(),
            Tree::Number(f64::NEG_INFINITY) => "false".to_owned(),
            Tree::Number(value) => value.to_string(),
            Tree::Signal(signal) => NAMES[*signal].to_owned(),
            Tree::One(name, window, x) => {
                format!(
                    "{}{}({})",
                    random.pick(spellings(name)),
                    write_interval(*window, random),
                    x.write(random)
                )
            }
            Tree::Two(name, window, x, y) => {
                let x = x.write(random);
                let y = y.write(random);
                format!("({x}) {}{} ({y})", random.pick(spellings(name)), write_interval(*window, random))
            }
        }
    }

    /// Returns the sub-formulas in the documented order: the root first, then those of the left
    /// operand, then of the right.
    pub fn subformulas(&self) -> Vec<&Tree> {
        self.listed(true)
    }

    fn listed(&self, in_formula: bool) -> Vec<&Tree> {
        let of = |name: &str| -> (bool, bool) {
            let is_term = ARITHMETIC_ONE.contains(&name) || ARITHMETIC_TWO.contains(&name);
            (!is_term, !is_term && !COMPARISONS.contains(&name))
        };
        let (is_formula, operands, has_formulas): (bool, Vec<&Tree>, bool) = match self {
            Tree::Number(_) | Tree::Signal(_) => (false, vec![], false),
            Tree::One(name, _, x) => (of(name).0, vec![x], of(name).1),
            Tree::Two(name, _, x, y) => (of(name).0, vec![x, y], of(name).1),
        };
        let own = (in_formula || is_formula).then_some(self);
        own.into_iter().chain(operands.into_iter().flat_map(|x| x.listed(has_formulas))).collect()
    }

    /// Returns `(always p) or (p until q)` for `p unless q` without an end.
    fn expanded(&self) -> Option<Tree> {
        let Tree::Two("unless", window, x, y) = self else { return None };
        let held = Box::new(Tree::One("always", None, x.clone()));
        let until = Box::new(Tree::Two("until", *window, x.clone(), y.clone()));
        is_open(*window).then_some(Tree::Two("or", None, held, until))
    }

    /// Offsets from t of the earliest and the latest sample that the value at t depends on; an
    /// unbounded window counts with its first sample only. The offsets enclose 0, since an operator
    /// at t is evaluated at a sample of the trace.
    pub fn offsets(&self) -> (i64, i64) {
        if let Some(expanded) = self.expanded() {
            return expanded.offsets();
        }
        let reached = |x: &Tree, from: i64, to: i64| {
            let (low, high) = x.offsets();
            (low.min(0) + from.min(to), high.max(0) + from.max(to))
        };
        let (low, high) = match self {
            Tree::Number(_) | Tree::Signal(_) => (0, 0),
            Tree::One(name, window, x) => {
                let (begin, end) = ends(*window);
                match *name {
                    "always" | "eventually" => reached(x, begin, end),
                    "historically" | "once" => reached(x, -begin, -end),
                    "next" | "s_next" => reached(x, 1, 1),
                    "prev" | "s_prev" => reached(x, -1, -1),
                    "rise" | "fall" => reached(x, -1, 0),
                    _ => reached(x, 0, 0),
                }
            }
            Tree::Two(name, window, x, y) => {
                let (begin, end) = ends(*window);
                let both = |(a, b): (i64, i64), (c, d): (i64, i64)| (a.min(c), b.max(d));
                match *name {
                    // At t itself only the right operand matters.
                    "until" | "release" | "since" if *window == Some((0, 0)) => reached(y, 0, 0),
                    "until" | "release" => both(reached(x, 0, (end - 1).max(0)), reached(y, begin, end)),
                    "unless" => both(reached(x, 0, end), reached(y, begin, end)),
                    "since" => both(reached(x, 0, -(end - 1).max(0)), reached(y, -begin, -end)),
                    _ => both(reached(x, 0, 0), reached(y, 0, 0)),
                }
            }
        };
        (low.min(0), high.max(0))
    }

    /// Returns whether the first `end` samples decide the formula at t: no window ahead with an end
    /// is cut, and every window without an end has a first sample.
    pub fn is_decided(&self, t: usize, end: usize) -> bool {
        t + (self.offsets().1 as usize) < end
    }

    /// Returns the value at t that the first `end` samples of the trace decide, from the
    /// definitions. A window without an end contains the samples at which the operands that it
    /// reads are decided. The trace may be longer.
    pub fn decide(&self, trace: &[Vec<f64>], t: usize, end: usize) -> f64 {
        assert!(self.is_decided(t, end), "{self:?} reads beyond sample {end} at {t}");
        if let Some(expanded) = self.expanded() {
            return expanded.decide(trace, t, end);
        }
        // The values of an operand at these samples; the others are NaN.
        let values = |x: &Tree, steps: &mut dyn Iterator<Item = usize>| {
            let mut values = vec![f64::NAN; end];
            steps.for_each(|s| values[s] = x.decide(trace, s, end));
            values
        };
        match self {
            Tree::Number(value) => *value,
            Tree::Signal(signal) => trace[*signal][t],
            Tree::One(name, window, x) => match *name {
                "always" | "eventually" => {
                    let steps: Vec<usize> = ahead(t, *window, end)
                        .take_while(|s| !is_open(*window) || x.is_decided(*s, end))
                        .collect();
                    let values = steps.into_iter().map(|s| x.decide(trace, s, end));
                    if *name == "always" { least(values) } else { greatest(values) }
                }
                "historically" => least(behind(t, *window).map(|s| x.decide(trace, s, end))),
                "once" => greatest(behind(t, *window).map(|s| x.decide(trace, s, end))),
                "next" | "s_next" => x.decide(trace, t + 1, end),
                "prev" | "s_prev" => one(name, None, &values(x, &mut (t.saturating_sub(1)..t)))[t],
                "rise" | "fall" => one(name, None, &values(x, &mut (t.saturating_sub(1)..=t)))[t],
                _ => one(name, None, &[x.decide(trace, t, end)])[0],
            },
            Tree::Two(name, window, x, y) => match *name {
                "until" | "release" | "unless" => {
                    // Up to which sample `until` and `release` read the left operand, and `unless`.
                    let left = |s: usize| t..s + usize::from(*name == "unless");
                    let is_whole = |s: &usize| {
                        !is_open(*window) || (y.is_decided(*s, end) && left(*s).all(|r| x.is_decided(r, end)))
                    };
                    let steps: Vec<usize> = ahead(t, *window, end).take_while(is_whole).collect();
                    let last = steps[steps.len() - 1];
                    let p = values(x, &mut left(last));
                    let q = values(y, &mut steps.into_iter());
                    two(name, *window, &p[..=last], &q[..=last])[t]
                }
                "since" => {
                    let first = behind(t, *window).next().unwrap_or(t);
                    let p = values(x, &mut (first + 1..=t));
                    let q = values(y, &mut behind(t, *window));
                    two(name, *window, &p, &q)[t]
                }
                _ => two(name, None, &[x.decide(trace, t, end)], &[y.decide(trace, t, end)])[0],
            },
        }
    }

    /// Returns whether every window of the formula is bounded.
    pub fn is_bounded(&self) -> bool {
        let has_end = |name: &str, window: Interval| {
            let is_timed = TIMED_ONE.contains(&name) || TIMED_TWO.contains(&name);
            !is_timed || window.is_some_and(|(_, end)| end != usize::MAX)
        };
        match self {
            Tree::Number(_) | Tree::Signal(_) => true,
            Tree::One(name, window, x) => has_end(name, *window) && x.is_bounded(),
            Tree::Two(name, window, x, y) => has_end(name, *window) && x.is_bounded() && y.is_bounded(),
        }
    }

    /// Returns the robustness at every sample, from the definitions.
    pub fn evaluate(&self, trace: &[Vec<f64>]) -> Vec<f64> {
        let n = trace[0].len();
        match self {
            Tree::Number(value) => vec![*value; n],
            Tree::Signal(signal) => trace[*signal].clone(),
            Tree::One(name, window, x) => one(name, *window, &x.evaluate(trace)),
            Tree::Two(name, window, x, y) => two(name, *window, &x.evaluate(trace), &y.evaluate(trace)),
        }
    }
}

impl Tree {
    /// Returns whether the formula holds at every sample, from the definitions of Boolean logic.
    /// Only the sides of a comparison are numbers; a bare number holds if it is not negative.
    pub fn holds(&self, trace: &[Vec<f64>]) -> Vec<bool> {
        let n = trace[0].len();
        match self {
            Tree::Number(_) | Tree::Signal(_) => self.evaluate(trace).iter().map(|x| *x >= 0.0).collect(),
            Tree::One(name, window, x) => {
                let x = x.holds(trace);
                let before = |t: usize, value: bool| if t == 0 { value } else { x[t - 1] };
                let after = |t: usize, value: bool| if t + 1 == n { value } else { x[t + 1] };
                let value = |t: usize| match *name {
                    "not" => !x[t],
                    "always" => ahead(t, *window, n).all(|s| x[s]),
                    "eventually" => ahead(t, *window, n).any(|s| x[s]),
                    "historically" => behind(t, *window).all(|s| x[s]),
                    "once" => behind(t, *window).any(|s| x[s]),
                    "next" => after(t, true),
                    "s_next" => after(t, false),
                    "prev" => before(t, true),
                    "s_prev" => before(t, false),
                    "rise" => !before(t, false) && x[t],
                    "fall" => before(t, true) && !x[t],
                    _ => unreachable!("{name}"),
                };
                (0..n).map(value).collect()
            }
            Tree::Two(name, window, x, y) if COMPARISONS.contains(name) => {
                let x = x.evaluate(trace);
                let y = y.evaluate(trace);
                let value = |t: usize| match *name {
                    "<=" => x[t] <= y[t],
                    ">=" => x[t] >= y[t],
                    "<" => x[t] < y[t],
                    ">" => x[t] > y[t],
                    "==" => x[t] == y[t],
                    "!==" => x[t] != y[t],
                    _ => unreachable!("{name} {window:?}"),
                };
                (0..n).map(value).collect()
            }
            Tree::Two(name, window, x, y) => {
                let x = x.holds(trace);
                let y = y.holds(trace);
                let held = |from: usize, to: usize| x[from..to].iter().all(|x| *x);
                let until = |t: usize| ahead(t, *window, n).any(|s| y[s] && held(t, s));
                let value = |t: usize| match *name {
                    "and" => x[t] && y[t],
                    "or" => x[t] || y[t],
                    "implies" => !x[t] || y[t],
                    "iff" => x[t] == y[t],
                    "xor" => x[t] != y[t],
                    "until" => until(t),
                    "release" => ahead(t, *window, n).all(|s| y[s] || x[t..s].iter().any(|x| *x)),
                    "unless" => {
                        let end = window.map_or(usize::MAX, |(_, end)| end);
                        ahead(t, Some((0, end)), n).all(|s| x[s]) || until(t)
                    }
                    "since" => behind(t, *window).any(|s| y[s] && held(s + 1, t + 1)),
                    _ => unreachable!("{name}"),
                };
                (0..n).map(value).collect()
            }
        }
    }
}

/// Formulas in dense time, whose bounds are seconds.
impl Tree {
    /// Returns whether an operator reads the next or the previous sample, which dense time lacks.
    pub fn has_neighbors(&self) -> bool {
        match self {
            Tree::Number(_) | Tree::Signal(_) => false,
            Tree::One(name, _, x) => (ONE.contains(name) && *name != "not") || x.has_neighbors(),
            Tree::Two(_, _, x, y) => x.has_neighbors() || y.has_neighbors(),
        }
    }

    /// Returns the formula with all bounds multiplied by a factor.
    pub fn scaled(&self, factor: usize) -> Tree {
        let window = |bounds: &Interval| {
            bounds.map(|(begin, end)| (begin * factor, if end == usize::MAX { end } else { end * factor }))
        };
        let sub = |tree: &Tree| Box::new(tree.scaled(factor));
        match self {
            Tree::Number(_) | Tree::Signal(_) => self.clone(),
            Tree::One(name, bounds, x) => Tree::One(name, window(bounds), sub(x)),
            Tree::Two(name, bounds, x, y) => Tree::Two(name, window(bounds), sub(x), sub(y)),
        }
    }

    /// Returns the discrete-time formula for a grid of this number of samples per second. In dense
    /// time `until` and its relatives need their left operand when the right one holds, too.
    pub fn on_grid(&self, per_second: usize) -> Tree {
        fn closed(tree: Tree) -> Tree {
            match tree {
                Tree::Number(_) | Tree::Signal(_) => tree,
                Tree::One(name, window, x) => Tree::One(name, window, Box::new(closed(*x))),
                Tree::Two(name, window, x, y) => {
                    let x = Box::new(closed(*x));
                    let y = Box::new(closed(*y));
                    let right = match name {
                        "until" | "since" | "unless" => Box::new(Tree::Two("and", None, x.clone(), y)),
                        "release" => Box::new(Tree::Two("or", None, x.clone(), y)),
                        _ => y,
                    };
                    Tree::Two(name, window, x, right)
                }
            }
        }
        closed(self.scaled(per_second))
    }
}

/// Begin and end of a window; the end of an unbounded window is its begin.
fn ends(window: Interval) -> (i64, i64) {
    let (begin, end) = window.unwrap_or((0, usize::MAX));
    (begin as i64, if end == usize::MAX { begin } else { end } as i64)
}

fn is_open(window: Interval) -> bool {
    window.is_none_or(|(_, end)| end == usize::MAX)
}

/// Returns a random interval: none, a point, one inside the trace, across its end, or beyond it.
fn interval(random: &mut Random, n: usize) -> Interval {
    let begin = match random.below(4) {
        0 => 0,
        1 => random.below(3),
        2 => random.below(n),
        _ => random.below(2 * n),
    };
    match random.below(6) {
        0 => None,
        1 => Some((begin, begin)),
        2 => Some((begin, begin + n)),
        3 => Some((begin, usize::MAX)),
        _ => Some((begin, begin + random.below(n))),
    }
}

fn write_interval(interval: Interval, random: &mut Random) -> String {
    let Some((begin, end)) = interval else { return String::new() };
    let separator = random.pick(&[":", ",", " , ", " : "]);
    if end == usize::MAX { format!("[{begin}{separator}inf]") } else { format!("[{begin}{separator}{end}]") }
}

fn least(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::INFINITY, f64::min)
}

fn greatest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::NEG_INFINITY, f64::max)
}

/// `x - y`, and 0 for equal infinities.
fn minus(x: f64, y: f64) -> f64 {
    if x == y { 0.0 } else { x - y }
}

/// Samples in `[t + begin, t + end]`, truncated at the end of a trace of `n` samples.
fn ahead(t: usize, interval: Interval, n: usize) -> impl Iterator<Item = usize> {
    let (begin, end) = interval.unwrap_or((0, usize::MAX));
    (0..n).filter(move |s| *s >= t && s - t >= begin && s - t <= end)
}

/// Samples in `[t - end, t - begin]`, truncated at the start.
fn behind(t: usize, interval: Interval) -> impl Iterator<Item = usize> {
    let (begin, end) = interval.unwrap_or((0, usize::MAX));
    (0..=t).filter(move |s| t - s >= begin && t - s <= end)
}

fn one(name: &str, window: Interval, x: &[f64]) -> Vec<f64> {
    let n = x.len();
    let before = |t: usize, value: f64| if t == 0 { value } else { x[t - 1] };
    let after = |t: usize, value: f64| if t + 1 == n { value } else { x[t + 1] };
    let value = |t: usize| match name {
        "-" | "not" => -x[t],
        "abs" => x[t].abs(),
        "always" => least(ahead(t, window, n).map(|s| x[s])),
        "eventually" => greatest(ahead(t, window, n).map(|s| x[s])),
        "historically" => least(behind(t, window).map(|s| x[s])),
        "once" => greatest(behind(t, window).map(|s| x[s])),
        "next" => after(t, f64::INFINITY),
        "s_next" => after(t, f64::NEG_INFINITY),
        "prev" => before(t, f64::INFINITY),
        "s_prev" => before(t, f64::NEG_INFINITY),
        "rise" => f64::min(-before(t, f64::NEG_INFINITY), x[t]),
        "fall" => f64::min(before(t, f64::INFINITY), -x[t]),
        _ => unreachable!("{name}"),
    };
    (0..n).map(value).collect()
}

fn two(name: &str, window: Interval, x: &[f64], y: &[f64]) -> Vec<f64> {
    let n = x.len();
    let until =
        |t: usize| greatest(ahead(t, window, n).map(|s| f64::min(y[s], least(x[t..s].iter().copied()))));
    let value = |t: usize| match name {
        "+" => x[t] + y[t],
        "-" | ">=" | ">" => minus(x[t], y[t]),
        "*" => x[t] * y[t],
        "<=" | "<" => minus(y[t], x[t]),
        "==" => -minus(x[t], y[t]).abs(),
        "!==" => minus(x[t], y[t]).abs(),
        "iff" => f64::max(f64::min(x[t], y[t]), f64::min(-x[t], -y[t])),
        "xor" => f64::max(f64::min(x[t], -y[t]), f64::min(-x[t], y[t])),
        "and" => f64::min(x[t], y[t]),
        "or" => f64::max(x[t], y[t]),
        "implies" => f64::max(-x[t], y[t]),
        "until" => until(t),
        "release" => least(ahead(t, window, n).map(|s| f64::max(y[s], greatest(x[t..s].iter().copied())))),
        "unless" => {
            let end = window.map_or(usize::MAX, |(_, end)| end);
            f64::max(least(ahead(t, Some((0, end)), n).map(|s| x[s])), until(t))
        }
        "since" => greatest(behind(t, window).map(|s| f64::min(y[s], least(x[s + 1..=t].iter().copied())))),
        _ => unreachable!("{name}"),
    };
    (0..n).map(value).collect()
}
