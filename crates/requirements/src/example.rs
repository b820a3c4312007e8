//! A search for traces that satisfy and violate a formula: signals that are constant piece by
//! piece, changed one piece at a time.

use std::collections::BTreeSet;
use std::sync::Arc;

use mishandle_random::Sequence;
use mishandle_results::{ExampleKind, FormulaDescription, FormulaExample, FormulaTrap, TrapSeverity};
use mishandle_stl::{Clock, Formula, Monitor, SyntaxKind, Trace, is_satisfied, is_violated};

use crate::describe::Context;
use crate::lanes::{draw, with_values};
use crate::traps::{implications, start};
use crate::tree::{Tree, is_comparison};

/// Sampling periods of examples in seconds, if the period is unknown.
const PERIODS: [f64; 10] = [1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001];

/// The number of samples that a picture has at least.
const FEW: usize = 30;

/// Largest number of samples of an example.
const MOST: usize = 20_000;

/// Limits of the formulas that are searched.
const MAX_SIGNALS: usize = 20;
const MAX_NODES: usize = 300;

/// Operations of a search: evaluations times samples times nodes.
const WORK: usize = 40_000_000;

/// Largest number of pieces of a signal.
const PIECES: u64 = 6;

/// Changes without an improvement after which the search starts again.
const PATIENCE: u32 = 60;

/// Searches from which conditions that change are requested.
const SEEDS: u64 = 3;

/// Searches for a trace that satisfies the formula and for one that violates it. If possible, the
/// conditions of its implications and edges change in them, and what a trap is about: the part that
/// only the first sample decides differs at a later one. The verdict of
/// each is that of [`Monitor`]. Empty if the formula is too long, or needs too many samples.
pub fn find_examples(formula: &Formula, context: &Context) -> Vec<FormulaExample> {
    let Some(search) = Search::new(formula, context) else { return Vec::new() };
    let [satisfied, violated] = [false, true].map(|violates| {
        let goals = [Conditions::Change, Conditions::Hold, Conditions::Any];
        let mut goals = goals.into_iter().filter(|conditions| search.has(*conditions));
        goals.find_map(|conditions| {
            let seeds = if conditions == Conditions::Change { SEEDS } else { 1 };
            (0..seeds).find_map(|seed| search.run(Goal { violates, conditions, seed }))
        })
    });
    let named = [("satisfied", satisfied), ("violated", violated)];
    let drawn = named.into_iter().filter_map(|(name, trace)| {
        let trace = trace?;
        let drawn = draw(formula, ExampleKind::Found, name, &trace, search.clock).ok()?;
        Some(with_values(drawn, &trace, &formula.signals()))
    });
    drawn.collect()
}

/// Adds traces to the description of a formula, as [`find_examples`] finds them, and a note if they
/// only satisfy it, or only violate it.
pub fn add_examples(found: &mut FormulaDescription, formula: &Formula, context: &Context) {
    found.examples = find_examples(formula, context);
    let is_satisfied = |example: &FormulaExample| is_satisfied(example.robustness.0);
    let satisfied = found.examples.iter().filter(|example| is_satisfied(example)).count();
    let [verb, result] = match (satisfied, found.examples.len() - satisfied) {
        (1.., 0) => ["violates", "always holds, and asks nothing"],
        (0, 1..) => ["satisfies", "never holds"],
        _ => return,
    };
    found.traps.push(FormulaTrap {
        name: "one-sided".to_owned(),
        severity: TrapSeverity::Note,
        line: None,
        column: None,
        formula: found.formula.clone(),
        why: format!("a search found no trace that {verb} it; if no trace does, it {result}"),
        instead: None,
    });
}

/// Requirements on the conditions of implications.
#[derive(Clone, Copy, PartialEq)]
enum Conditions {
    /// Each one holds at some sample and fails at another one.
    Change,
    /// Each one holds at some sample.
    Hold,
    Any,
}

#[derive(Clone, Copy)]
struct Goal {
    violates: bool,
    conditions: Conditions,
    seed: u64,
}

struct Search<'a> {
    formula: &'a Formula,
    names: Arc<[String]>,
    /// Values that each signal tries.
    levels: Vec<Vec<f64>>,
    conditions: Vec<Formula>,
    clock: Clock,
    samples: usize,
    evaluations: usize,
}

/// A signal that is constant piece by piece: first sample and value of each piece.
type Pieces = Vec<(usize, f64)>;

impl<'a> Search<'a> {
    fn new(formula: &'a Formula, context: &Context) -> Option<Search<'a>> {
        let tree = Tree::new(formula);
        let names: Arc<[String]> = formula.signals().into_iter().map(str::to_owned).collect();
        if names.len() > MAX_SIGNALS || tree.nodes.len() > MAX_NODES {
            return None;
        }
        let needed = |clock: Clock| Some(Monitor::new(formula, &names, clock).ok()?.needed_samples());
        let with_period = |period: f64| Context { period: Some(period), ..context.clone() }.clock();
        let clock = match context.period {
            Some(_) => context.clock(),
            None if formula.needs_period(context.unit.is_some()) => {
                let fits = |period: &f64| needed(with_period(*period)).is_some();
                let is_fine =
                    |period: &f64| needed(with_period(*period)).is_some_and(|samples| samples >= FEW);
                let period = PERIODS.iter().find(|period| is_fine(period));
                with_period(*period.or_else(|| PERIODS.iter().find(|period| fits(period)))?)
            }
            None => Clock::unknown(),
        };
        let needed = needed(clock)?;
        let is_open = Monitor::new(formula, &names, clock).ok()?.horizon().is_none();
        // A window without an end contains some samples more than its operands need.
        let samples = if is_open { needed.saturating_mul(2).max(2 * FEW) } else { needed.max(FEW) };
        if samples > MOST {
            return None;
        }
        let antecedents = tree.antecedents().map(|node| formula.at_node(node));
        let of_traps = start::shown(&tree).into_iter().chain(implications::shown(&tree));
        let conditions = antecedents.chain(edges(&tree)).chain(of_traps).collect();
        let levels = names.iter().map(|name| levels(&tree, name)).collect();
        let evaluations = (WORK / (samples * tree.nodes.len())).clamp(50, 6000);
        Some(Search { formula, names, levels, conditions, clock, samples, evaluations })
    }

    /// Returns whether the requirement on conditions differs from none.
    fn has(&self, conditions: Conditions) -> bool {
        conditions == Conditions::Any || !self.conditions.is_empty()
    }

    fn trace(&self, signals: &[Pieces]) -> Trace {
        let column = |pieces: &Pieces| {
            let mut values = Vec::with_capacity(self.samples);
            for (index, (_, value)) in pieces.iter().enumerate() {
                let end = pieces.get(index + 1).map_or(self.samples, |next| next.0);
                values.resize(end.max(values.len()), *value);
            }
            values
        };
        if signals.is_empty() {
            let mut trace = Trace::new(Arc::clone(&self.names));
            (0..self.samples).for_each(|_| trace.push(&[]));
            trace
        } else {
            Trace::from_columns(Arc::clone(&self.names), signals.iter().map(column).collect())
        }
    }

    /// Returns how far a trace is from the goal: not negative, with the sign of a verdict, if it is
    /// reached.
    fn value(&self, monitors: &mut [Monitor], goal: Goal, trace: &Trace) -> f64 {
        let Some((formula, conditions)) = monitors.split_first_mut() else { return f64::NAN };
        let Ok(robustness) = formula.robustness(trace) else { return f64::NEG_INFINITY };
        // A window that is cut at the end would make a poor example.
        let decided = formula.decided_robustness(trace).ok().flatten().unwrap_or(robustness);
        let mut least = if goal.violates { -robustness.max(decided) } else { robustness.min(decided) };
        for condition in conditions.iter_mut().filter(|_| goal.conditions != Conditions::Any) {
            let Ok(values) = condition.robustness_signal(trace) else { return f64::NEG_INFINITY };
            let ends = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
                (low.min(*value), high.max(*value))
            });
            least = least.min(ends.1);
            if goal.conditions == Conditions::Change {
                least = least.min(-ends.0);
            }
        }
        least
    }

    fn run(&self, goal: Goal) -> Option<Trace> {
        let formulas = std::iter::once(self.formula).chain(&self.conditions);
        let monitors: Result<Vec<Monitor>, _> =
            formulas.map(|formula| Monitor::new(formula, &self.names, self.clock)).collect();
        let mut monitors = monitors.ok()?;
        let mut random = Sequence::new(goal.seed, u64::from(goal.violates));
        // A robustness of 0 has a verdict, too, but says less.
        let is_clear = |value: f64| value > 0.0;
        // A negated robustness keeps the sign of a zero, a minimum of several numbers may not.
        let is_reached = |value: f64| match (goal.conditions, goal.violates) {
            (Conditions::Any, true) => is_violated(-value),
            (Conditions::Any, false) => is_satisfied(value),
            _ => is_clear(value),
        };
        let mut reached = None;
        let mut current: Vec<Pieces> = self.levels.iter().map(|levels| vec![(0, levels[0])]).collect();
        let mut best = self.value(&mut monitors, goal, &self.trace(&current));
        let mut stale = 0;
        for _ in 0..self.evaluations {
            if is_clear(best) {
                self.simplify(&mut monitors, goal, &mut current, &is_clear);
                return Some(self.trace(&current));
            }
            if reached.is_none() && is_reached(best) {
                reached = Some(current.clone());
            }
            if stale > PATIENCE {
                current = self.levels.iter().map(|levels| vec![(0, pick(levels, &mut random))]).collect();
                best = self.value(&mut monitors, goal, &self.trace(&current));
                stale = 0;
            }
            let mut next = current.clone();
            self.change(&mut next, &mut random);
            let value = self.value(&mut monitors, goal, &self.trace(&next));
            // Changes on a plateau are kept, too: a minimum does not show what others improve.
            stale = if value > best { 0 } else { stale + 1 };
            if value >= best {
                (current, best) = (next, value);
            }
        }
        let mut reached = reached?;
        self.simplify(&mut monitors, goal, &mut reached, &is_reached);
        Some(self.trace(&reached))
    }

    /// Changes one signal: the value of a piece, where it starts, or the number of pieces.
    fn change(&self, signals: &mut [Pieces], random: &mut Sequence) {
        let signal = random.below(signals.len() as u64) as usize;
        let Some(pieces) = signals.get_mut(signal) else { return };
        let piece = random.below(pieces.len() as u64) as usize;
        let sample = random.below(self.samples as u64) as usize;
        let value = pick(&self.levels[signal], random);
        match random.below(4) {
            0 if (pieces.len() as u64) < PIECES => pieces.push((sample, value)),
            1 if piece > 0 => pieces[piece].0 = sample,
            2 if piece > 0 => drop(pieces.remove(piece)),
            _ => pieces[piece].1 = value,
        }
        pieces[1..].sort_by_key(|piece| piece.0);
    }

    /// Removes the pieces without which the goal is still reached.
    fn simplify(
        &self,
        monitors: &mut [Monitor],
        goal: Goal,
        signals: &mut [Pieces],
        is_reached: &impl Fn(f64) -> bool,
    ) {
        for signal in 0..signals.len() {
            for piece in (0..signals[signal].len()).rev() {
                if signals[signal].len() == 1 {
                    break;
                }
                let removed = signals[signal].remove(piece);
                let first = signals[signal][0];
                signals[signal][0].0 = 0;
                if !is_reached(self.value(monitors, goal, &self.trace(signals))) {
                    signals[signal][0] = first;
                    signals[signal].insert(piece, removed);
                }
            }
        }
    }
}

fn pick(levels: &[f64], random: &mut Sequence) -> f64 {
    levels[random.below(levels.len() as u64) as usize]
}

/// Returns for each `rise` and `fall` the formula of a change between two samples: at the first
/// one, they hold without a change.
fn edges(tree: &Tree<'_>) -> Vec<Formula> {
    let edge = |node: usize| {
        let operand = *tree.nodes[node].operands.first()?;
        let text = tree.text(operand);
        match tree.operator(node)? {
            "rise" => Formula::parse(&format!("(s_prev (not ({text}))) and ({text})")).ok(),
            "fall" => Formula::parse(&format!("(s_prev ({text})) and (not ({text}))")).ok(),
            _ => None,
        }
    };
    (0..tree.nodes.len()).filter_map(edge).collect()
}

/// Returns values around those with which the formula compares a signal.
fn levels(tree: &Tree<'_>, signal: &str) -> Vec<f64> {
    // The numbers below each node, and whether the signal is there.
    let mut numbers: Vec<Vec<f64>> = Vec::with_capacity(tree.nodes.len());
    let mut reads = Vec::with_capacity(tree.nodes.len());
    let mut found: Vec<f64> = vec![0.0];
    for (index, node) in tree.nodes.iter().enumerate() {
        let mut own: Vec<f64> = tree.number(index).filter(|number| number.is_finite()).into_iter().collect();
        for operand in &node.operands {
            own.extend(std::mem::take(&mut numbers[*operand]));
        }
        let is_read = node.kind == SyntaxKind::Signal(signal) || node.operands.iter().any(|n| reads[*n]);
        if tree.operator(index).is_some_and(is_comparison) {
            if is_read {
                found.extend(own.iter().flat_map(|c| {
                    let step = if *c == 0.0 { 1.0 } else { 0.2 * c.abs() };
                    [*c, c - step, c + step, -c]
                }));
            }
            own.clear();
        }
        numbers.push(own);
        reads.push(is_read && !tree.operator(index).is_some_and(is_comparison));
    }
    found.extend([1.0, -1.0]);
    let mut seen = BTreeSet::new();
    found.retain(|value| value.is_finite() && seen.insert(value.to_bits()));
    found.truncate(32);
    found
}
