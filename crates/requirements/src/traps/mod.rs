//! The known traps of formulas: what often means something else than its author thinks.

mod comparisons;
mod ends;
pub(crate) mod implications;
mod precedence;
mod predicates;
pub(crate) mod start;
mod windows;

use mishandle_results::{FormulaTrap, TrapSeverity};
use mishandle_stl::Formula;

use crate::describe::Context;
use crate::ranges;
use crate::tree::Tree;

/// Traps of the same name beyond this number are not listed.
const MAX_ALIKE: usize = 5;

/// The traps found so far.
pub(crate) struct Found<'a> {
    tree: &'a Tree<'a>,
    traps: Vec<FormulaTrap>,
    /// The node of each trap.
    nodes: Vec<usize>,
}

impl<'a> Found<'a> {
    fn new(tree: &'a Tree<'a>) -> Found<'a> {
        Found { tree, traps: Vec::new(), nodes: Vec::new() }
    }

    fn has_warning(&self, name: &str) -> bool {
        self.traps.iter().any(|trap| trap.name == name && trap.severity == TrapSeverity::Warning)
    }

    fn has_warning_at(&self, node: usize) -> bool {
        let mut all = self.traps.iter().zip(&self.nodes);
        all.any(|(trap, at)| *at == node && trap.severity == TrapSeverity::Warning)
    }

    /// Adds a trap at a node.
    fn warn(&mut self, name: &str, node: usize, why: String, instead: Option<String>) {
        self.add(name, TrapSeverity::Warning, node, why, instead);
    }

    /// Adds a trap that is often intended.
    fn note(&mut self, name: &str, node: usize, why: String, instead: Option<String>) {
        self.add(name, TrapSeverity::Note, node, why, instead);
    }

    fn add(&mut self, name: &str, severity: TrapSeverity, node: usize, why: String, instead: Option<String>) {
        if self.traps.iter().filter(|trap| trap.name == name).count() >= MAX_ALIKE {
            return;
        }
        let at = self.tree.at(node);
        self.nodes.push(node);
        self.traps.push(FormulaTrap {
            name: name.to_owned(),
            severity,
            line: at.map(|at| at.line as u64),
            column: at.map(|at| at.column as u64),
            formula: self.tree.text(node),
            why,
            instead,
        });
    }
}

/// Returns the traps of a formula that decides by the first sample what is meant of all: parts
/// without an operator over time, and operators over the past at the start. Empty for a very long
/// formula.
///
/// # Example
/// ```
/// use mishandle_requirements::start_traps;
/// use mishandle_stl::Formula;
/// let traps = start_traps(&Formula::parse("force <= 2").unwrap());
/// assert_eq!(traps[0].instead.as_deref(), Some("always(force <= 2), or eventually(force <= 2)"));
/// assert!(start_traps(&Formula::parse("always(force <= 2)").unwrap()).is_empty());
/// ```
pub fn start_traps(formula: &Formula) -> Vec<FormulaTrap> {
    let tree = Tree::new(formula);
    let mut found = Found::new(&tree);
    if tree.nodes.len() <= ranges::MAX_NODES {
        start::at_start(&tree, &mut found);
    }
    found.traps
}

/// Returns why a formula asks nothing of any trace; `None` if a trace may violate it.
///
/// # Example
/// ```
/// use mishandle_requirements::certainty;
/// use mishandle_stl::Formula;
/// assert!(certainty(&Formula::parse("always(force - force <= 2)").unwrap()).is_some());
/// assert!(certainty(&Formula::parse("always(force <= 2)").unwrap()).is_none());
/// ```
pub fn certainty(formula: &Formula) -> Option<&'static str> {
    let tree = Tree::new(formula);
    let analysis = ranges::analyze(&tree)?;
    let mut is_certain: Vec<bool> = Vec::with_capacity(tree.nodes.len());
    for (index, node) in tree.nodes.iter().enumerate() {
        let of = |operand: usize| is_certain[node.operands[operand]];
        is_certain.push(match tree.operator(index) {
            // What fails at no sample never fails.
            Some("always" | "historically") => of(0),
            Some("and") => of(0) && of(1),
            Some("or") => of(0) || of(1) || analysis.fails[index].is_empty(),
            _ => analysis.fails[index].is_empty(),
        });
    }
    is_certain.last()?.then_some("it holds whatever the values of its signals are")
}

/// Returns the traps in a formula.
pub(crate) fn find(tree: &Tree<'_>, context: &Context) -> Vec<FormulaTrap> {
    let mut found = Found::new(tree);
    let Some(analysis) = ranges::analyze(tree) else {
        // The text of each place would make the time quadratic.
        return vec![FormulaTrap {
            name: "too-long".to_owned(),
            severity: TrapSeverity::Warning,
            line: None,
            column: None,
            formula: String::new(),
            why: format!(
                "it has more than {} operators and operands, and is not checked for traps",
                ranges::MAX_NODES
            ),
            instead: Some("several requirements, each with a name".to_owned()),
        }];
    };
    precedence::find(tree, &mut found);
    start::find(tree, context, &mut found);
    ends::find(tree, context, &mut found);
    windows::find(tree, context, &mut found);
    implications::find(tree, context, &analysis, &mut found);
    comparisons::constant(tree, &analysis, &mut found);
    comparisons::equality(tree, context, &mut found);
    comparisons::chained(tree, &mut found);
    predicates::units(tree, context, &mut found);
    predicates::truth_values(tree, context, &mut found);
    predicates::flags_at_limits(tree, context, &mut found);
    predicates::unused(tree, &mut found);
    found.traps
}
