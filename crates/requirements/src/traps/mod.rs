//! The known traps of formulas: what often means something else than its author thinks.

mod comparisons;
mod implications;
mod precedence;
mod predicates;
mod windows;

use mishandle_results::{FormulaTrap, TrapSeverity};

use crate::describe::Context;
use crate::ranges;
use crate::tree::Tree;

/// Traps of the same name beyond this number are not listed.
const MAX_ALIKE: usize = 5;

/// The traps found so far.
pub(crate) struct Found<'a> {
    tree: &'a Tree<'a>,
    traps: Vec<FormulaTrap>,
}

impl Found<'_> {
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

/// Returns the traps in a formula.
pub(crate) fn find(tree: &Tree<'_>, context: &Context) -> Vec<FormulaTrap> {
    let mut found = Found { tree, traps: Vec::new() };
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
