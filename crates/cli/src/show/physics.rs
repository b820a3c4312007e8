//! Checks of the physics of counterexamples, as text.

use mishandle::falsification::physics_text;
use mishandle::results::PhysicsCheck;

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
