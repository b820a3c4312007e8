//! Checks of the physics of counterexamples, as text.

use mishandle::falsification::physics_text;
use mishandle::results::PhysicsCheck;
use mishandle_text::plural;

/// Returns the finding in a table; `-` without a check.
pub fn word(check: Option<&PhysicsCheck>) -> &'static str {
    match check {
        Some(check) if check.depends_on_solver => "depends on the solver",
        Some(_) => "holds",
        None => "-",
    }
}

/// Returns the finding as a line.
pub fn text(check: &PhysicsCheck) -> String {
    format!("physics: {}", physics_text(check))
}

/// Counts the counterexamples that depend on the solver, on a new line; empty without one.
pub fn count_text<'a>(checks: impl Iterator<Item = &'a PhysicsCheck>) -> String {
    let depends: Vec<bool> = checks.map(|check| check.depends_on_solver).collect();
    match depends.iter().filter(|depends| **depends).count() {
        0 => String::new(),
        count => format!(
            "\n{count} of {} {} on the solver of the physics: no evidence about a real robot",
            plural(depends.len() as u64, "counterexample"),
            if count == 1 { "depends" } else { "depend" }
        ),
    }
}
