//! The graph of an online monitor: the distinct sub-formulas of its formulas, operands first.

use crate::clock::{Clock, Window};
use crate::error::MonitorError;
use crate::formula::{Formula, Node as FormulaNode};
use crate::operator::Operator;
use crate::program::{columns, undecided};
use crate::subformula::Reach;
use std::collections::HashMap;

/// The operation of a node.
#[derive(Clone, Copy, Debug)]
pub(super) enum Kind {
    Constant(f64),
    /// A signal, by its column.
    Signal(usize),
    Apply(Operator, Window),
}

/// A sub-formula.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub kind: Kind,
    /// The same twice for a unary operator.
    pub operands: [usize; 2],
    /// Whether the value at a sample depends on that sample only.
    pub is_state: bool,
    pub reach: Reach,
    /// As in [`Instruction`](crate::program::Instruction).
    pub undecided: usize,
    /// The number of unknown samples after which the bounds no longer change from sample to sample.
    pub slack: usize,
    /// The last sample that the values of the formulas at time 0 read.
    pub need: usize,
    /// The number of last exact values that other nodes read.
    pub keep: usize,
    /// The number of first exact values that other nodes read.
    pub head: usize,
    /// Whether it is a formula or an operand of a node that is not a state formula.
    pub is_read: bool,
    /// Whether the bounds at a sample without exact value are the extremum of the exact operands in
    /// the window, and unknown on the other side: the window contains an unknown sample.
    pub is_direct: bool,
    /// The first sample read, if the node has wider bounds at later samples and only one operator
    /// reads it, which takes the extremum over samples.
    pub folded: Option<usize>,
}

impl Node {
    pub fn operator(&self) -> Option<(Operator, Window)> {
        match self.kind {
            Kind::Apply(operator, window) => Some((operator, window)),
            _ => None,
        }
    }

    /// Returns the number of exact values after `samples` samples.
    pub fn exact(&self, samples: usize) -> usize {
        if self.reach.is_unbounded { 0 } else { self.reach.decided(samples) }
    }

    /// Returns whether the value at time 0 accumulates exact operands: only time 0 reads the node,
    /// or its window has no end.
    pub fn accumulates(&self) -> bool {
        self.operator().is_some_and(|(operator, window)| match operator {
            // These equal their right operand.
            Operator::Until | Operator::Release if window.end == 0 => false,
            Operator::Always
            | Operator::Eventually
            | Operator::Until
            | Operator::Release
            | Operator::Unless => self.need == 0 || window.is_unbounded(),
            _ => false,
        })
    }
}

/// The nodes, and those of the formulas.
#[derive(Clone, Debug)]
pub(super) struct Graph {
    pub nodes: Vec<Node>,
    pub roots: Vec<usize>,
    /// The columns and names of the signals that the formulas read.
    pub columns: Vec<(usize, String)>,
    /// The nodes by what they compute, while the graph is built.
    known: HashMap<Key, usize>,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Key {
    Constant(u64),
    Signal(usize),
    Apply(Operator, Window, [usize; 2]),
}

impl Graph {
    pub fn new(formulas: &[Formula], names: &[String], clock: &Clock) -> Result<Graph, MonitorError> {
        clock.check()?;
        let mut graph =
            Graph { nodes: Vec::new(), roots: Vec::new(), columns: Vec::new(), known: HashMap::new() };
        for formula in formulas {
            let columns = columns(formula, names)?;
            let mut stack = Vec::new();
            for (node, is_bare) in formula.nodes.iter().zip(formula.bare_numbers()) {
                let mut id = match *node {
                    FormulaNode::Constant(value) => {
                        graph.leaf(Kind::Constant(value), Key::Constant(value.to_bits()))
                    }
                    FormulaNode::Signal(signal) => {
                        let column = columns[signal as usize].0;
                        graph.leaf(Kind::Signal(column), Key::Signal(column))
                    }
                    FormulaNode::Apply(operator, interval) => {
                        let window = clock.window(operator.name(), interval)?;
                        let own: Vec<usize> = stack.split_off(stack.len() - operator.arity());
                        graph.apply(operator, window, [own[0], own[own.len() - 1]])
                    }
                };
                if is_bare {
                    // The robustness of `x` is that of `x >= 0`, in which the sign of a zero is the
                    // verdict.
                    let zero = graph.leaf(Kind::Constant(0.0), Key::Constant(0.0_f64.to_bits()));
                    id = graph.apply(Operator::GreaterOrEqual, Window::UNBOUNDED, [id, zero]);
                }
                stack.push(id);
            }
            graph.roots.extend(stack.pop());
            for column in columns {
                if !graph.columns.contains(&column) {
                    graph.columns.push(column);
                }
            }
        }
        graph.known = HashMap::new();
        graph.find_needs();
        graph.find_memory();
        graph.find_monotone();
        Ok(graph)
    }

    /// Returns the node of a signal or constant.
    fn leaf(&mut self, kind: Kind, key: Key) -> usize {
        match self.known.get(&key) {
            Some(id) => *id,
            None => self.add(kind, key, [0, 0]),
        }
    }

    /// Returns the node of an operator. `p unless q` without an end is `(always p) or (p until q)`.
    fn apply(&mut self, operator: Operator, window: Window, operands: [usize; 2]) -> usize {
        if operator == Operator::Unless && window.is_unbounded() {
            let held = self.apply(Operator::Always, Window::UNBOUNDED, [operands[0]; 2]);
            let until = self.apply(Operator::Until, window, operands);
            return self.apply(Operator::Or, Window::UNBOUNDED, [held, until]);
        }
        let key = Key::Apply(operator, window, operands);
        match self.known.get(&key) {
            Some(id) => *id,
            None => self.add(Kind::Apply(operator, window), key, operands),
        }
    }

    fn add(&mut self, kind: Kind, key: Key, operands: [usize; 2]) -> usize {
        let mut node = Node {
            kind,
            operands,
            is_state: true,
            reach: Reach::default(),
            undecided: 0,
            slack: 0,
            need: 0,
            keep: 1,
            head: 0,
            is_read: false,
            is_direct: false,
            folded: None,
        };
        if let Kind::Apply(operator, window) = kind {
            let [first, last] = operands.map(|operand| &self.nodes[operand]);
            node.is_state = !operator.is_temporal() && first.is_state && last.is_state;
            node.reach = Reach::of(operator, window, first.reach, last.reach);
            node.undecided = undecided(operator, window, first.reach, last.reach, node.reach);
            let own = match operator {
                Operator::Historically | Operator::Once | Operator::Since => {
                    let end = if window.is_unbounded() { window.begin } else { window.end };
                    end.saturating_add(2)
                }
                Operator::Previous | Operator::StrongPrevious | Operator::Rise | Operator::Fall => 1,
                _ => 0,
            };
            node.slack = first.slack.max(last.slack).saturating_add(own);
        }
        self.nodes.push(node);
        let id = self.nodes.len() - 1;
        self.known.insert(key, id);
        id
    }

    /// Returns the nodes that are not state formulas among a node and its operands, operands first.
    pub fn parts(&self, root: usize) -> Vec<usize> {
        let mut is_part = vec![false; self.nodes.len()];
        is_part[root] = true;
        for id in (0..=root).rev().filter(|id| !self.nodes[*id].is_state) {
            if is_part[id] {
                self.nodes[id].operands.iter().for_each(|operand| is_part[*operand] = true);
            }
        }
        (0..=root).filter(|id| is_part[*id] && !self.nodes[*id].is_state).collect()
    }

    /// Finds the last samples that the formulas at time 0 read. Consumers come after operands.
    fn find_needs(&mut self) {
        let mut needs: Vec<Option<usize>> = vec![None; self.nodes.len()];
        self.roots.iter().for_each(|root| needs[*root] = Some(0));
        for id in (0..self.nodes.len()).rev() {
            let Some(need) = needs[id] else { continue };
            self.nodes[id].need = need;
            let Some((operator, window)) = self.nodes[id].operator() else { continue };
            let begin = window.begin;
            let end = window.end;
            let [first, last] = match operator {
                Operator::Always | Operator::Eventually | Operator::Unless => [need.saturating_add(end); 2],
                Operator::Until | Operator::Release => {
                    [need.saturating_add(end.saturating_sub(1)), need.saturating_add(end)]
                }
                Operator::Historically | Operator::Once => [need.saturating_sub(begin); 2],
                Operator::Since => [need, need.saturating_sub(begin)],
                Operator::Next | Operator::StrongNext => [need.saturating_add(1); 2],
                _ => [need; 2],
            };
            let operands = self.nodes[id].operands;
            for (operand, need) in operands.into_iter().zip([first, last]) {
                needs[operand] = Some(needs[operand].map_or(need, |known| known.max(need)));
            }
        }
    }

    /// Finds the exact values that must be kept.
    fn find_memory(&mut self) {
        for root in self.roots.clone() {
            self.nodes[root].head = self.nodes[root].head.max(1);
            self.nodes[root].is_read = true;
        }
        for id in 0..self.nodes.len() {
            let node = self.nodes[id].clone();
            let Some((operator, window)) = node.operator().filter(|_| !node.is_state) else {
                continue;
            };
            let [first, last] = node.operands.map(|operand| self.nodes[operand].reach.ahead);
            let has_exact = node.operands.iter().all(|operand| !self.nodes[*operand].reach.is_unbounded);
            // An operand is read from this many samples before the first sample without exact
            // value.
            let before = match operator {
                // The deque has the extrema.
                Operator::Always | Operator::Eventually => None,
                Operator::Historically | Operator::Once | Operator::Since => {
                    Some(if window.is_unbounded() { window.begin } else { window.end })
                }
                Operator::Previous | Operator::StrongPrevious | Operator::Rise | Operator::Fall => Some(1),
                _ => Some(0),
            };
            for operand in node.operands {
                let read = &mut self.nodes[operand];
                read.is_read = true;
                let ahead = if node.reach.is_unbounded { first.max(last) } else { node.reach.ahead };
                if let Some(before) = before {
                    let lag = ahead.saturating_add(before).saturating_add(1).saturating_sub(read.reach.ahead);
                    read.keep = read.keep.max(lag);
                }
                if node.reach.is_unbounded {
                    let head = if node.accumulates() && has_exact {
                        node.need.saturating_add(window.begin)
                    } else {
                        read.need.saturating_add(1)
                    };
                    read.head = read.head.max(head);
                }
            }
        }
    }

    /// Finds the nodes whose bounds are wider at later samples. Their extrema are at the ends.
    fn find_monotone(&mut self) {
        let mut readers = vec![Vec::new(); self.nodes.len()];
        for root in &self.roots {
            readers[*root].push(None);
        }
        let mut widens = vec![false; self.nodes.len()];
        for id in 0..self.nodes.len() {
            let node = &self.nodes[id];
            let of_state = node.operands.iter().all(|operand| self.nodes[*operand].is_state);
            let is_direct = match node.operator() {
                Some((Operator::Always | Operator::Eventually, window)) => {
                    !window.is_unbounded() && node.need > 0 && of_state
                }
                Some((Operator::Once | Operator::Historically, window)) => {
                    !window.is_unbounded() && window.begin == 0 && of_state
                }
                _ => false,
            };
            let is_pointwise = node.operator().is_some_and(|(operator, _)| !operator.is_temporal());
            let same = |operand: &usize| {
                let reach = self.nodes[*operand].reach;
                widens[*operand] && reach.ahead == node.reach.ahead && !reach.is_unbounded
            };
            widens[id] = node.is_state || is_direct || (is_pointwise && node.operands.iter().all(same));
            for operand in node.operands {
                if !node.is_state && readers[operand].last() != Some(&Some(id)) {
                    readers[operand].push(Some(id));
                }
            }
            self.nodes[id].is_direct = is_direct;
        }
        for id in (0..self.nodes.len()).rev() {
            let node = &self.nodes[id];
            let [Some(reader)] = readers[id][..] else { continue };
            if node.is_state || node.is_direct || !widens[id] {
                continue;
            }
            let reader = &self.nodes[reader];
            self.nodes[id].folded = match reader.operator() {
                Some((Operator::Always | Operator::Eventually, window)) => {
                    (reader.need == 0).then_some(window.begin)
                }
                Some((operator, _)) if !operator.is_temporal() => reader.folded,
                _ => None,
            };
        }
    }
}
