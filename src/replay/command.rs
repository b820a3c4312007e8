use std::path::Path;

use mishandle_text::shell_quote;

use crate::resolve::is_python;

/// Returns the command that replays a simulation of the run file at `path`, or for a system that is
/// written in Python the call in Python, with the system, the formula and the space of the run.
///
/// # Example
/// ```
/// use mishandle::replay::replay_command;
/// let command = replay_command("task", "my run.sqlite".as_ref(), 2, 17);
/// assert_eq!(command, "mishandle replay 'my run.sqlite' --trial 2 --simulation 17");
/// let call = replay_command("python", "a.sqlite".as_ref(), 1, 3);
/// assert_eq!(call, "mishandle.replay(\"a.sqlite\", system, formula, space, trial=1, number=3)");
/// ```
pub fn replay_command(target_kind: &str, path: &Path, trial: u32, number: u32) -> String {
    let path = path.to_string_lossy();
    if is_python(target_kind) {
        format!(
            "mishandle.replay({}, system, formula, space, trial={trial}, number={number})",
            python_text(&path)
        )
    } else {
        format!("mishandle replay {} --trial {trial} --simulation {number}", shell_quote(&path))
    }
}

/// Quotes a text for Python.
fn python_text(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => quoted.push_str(&format!("\\U{:08x}", u32::from(c))),
            c => quoted.push(c),
        }
    }
    quoted + "\""
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn python_restores_the_quoted_text() {
        for text in ["a.sqlite", "two words", "it's \"b\"", "a\nb\u{1b}", "C:\\x\\n", "größe", "{0}"] {
            let script = format!("import sys; sys.stdout.write({})", python_text(text));
            let output =
                std::process::Command::new("python3").args(["-X", "utf8", "-c", &script]).output().unwrap();
            assert_eq!(String::from_utf8(output.stdout).unwrap(), text, "{script}");
        }
    }
}
