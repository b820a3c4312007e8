//! The time of each step of `cargo xtask test`, and its share of the CPU time that the budget file
//! states.

use std::fmt::Write;

use anyhow::{Context, Result};

/// The budget: a line for each step with its shares of the CPU time, percent, in `cargo xtask test`
/// and with `--all`.
pub const FILE: &str = "xtask/budget.txt";

/// A step that takes this many times its share gets a warning.
const TOLERANCE: f64 = 2.0;

/// Steps with a smaller share of all CPU time get no warning, percent.
const SMALLEST: f64 = 1.0;

/// Clock ticks per second in `/proc`, on every architecture of Linux that MuJoCo supports.
const TICKS: f64 = 100.0;

/// Time of a step.
pub struct Time {
    pub step: &'static str,
    pub wall_secs: f64,
    /// CPU time with that of all child processes.
    pub cpu_secs: f64,
}

/// Returns the CPU time of this process and of its children that have ended, s; 0 where a process
/// cannot read it.
pub fn cpu_secs() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name in parentheses may contain spaces. Later fields are user and system time of the
    // process, then the same of its children.
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    let ticks: f64 =
        after_name.split_whitespace().skip(11).take(4).filter_map(|text| text.parse::<f64>().ok()).sum();
    ticks / TICKS
}

/// Returns the table that ends a run, with a warning for each step over its budget.
///
/// # Errors
/// If the budget has no line with two numbers for a step.
pub fn table(budget: &str, is_all: bool, times: &[Time]) -> Result<String> {
    let mut text = format!("{:<14} {:>9} {:>9} {:>7} {:>7}\n", "step", "wall s", "CPU s", "share", "budget");
    let cpu: f64 = times.iter().map(|time| time.cpu_secs).sum();
    let wall: f64 = times.iter().map(|time| time.wall_secs).sum();
    for Time { step, wall_secs, cpu_secs } in times {
        let allowed = share(budget, step, is_all)?;
        let share = 100.0 * cpu_secs / cpu.max(1e-9);
        let is_over = share > (TOLERANCE * allowed).max(SMALLEST);
        let warning = if is_over { "  WARNING: more than twice its budget" } else { "" };
        let _ = writeln!(
            text,
            "{step:<14} {wall_secs:>9.1} {cpu_secs:>9.1} {share:>5.1} % {allowed:>5} %{warning}"
        );
    }
    let _ = writeln!(text, "{:<14} {wall:>9.1} {cpu:>9.1}", "all passed");
    Ok(text)
}

/// Checks that the budget has every step.
///
/// # Errors
/// As [`table`].
pub fn check<'a>(budget: &str, steps: impl IntoIterator<Item = &'a str>) -> Result<()> {
    steps.into_iter().try_for_each(|step| share(budget, step, true).map(|_| ()))
}

/// Returns the share of a step, percent.
fn share(budget: &str, step: &str, is_all: bool) -> Result<f64> {
    let lines = budget.lines().filter(|line| !line.starts_with('#'));
    let numbers = |line: &str| {
        line.strip_prefix(step)
            .filter(|rest| rest.starts_with(' '))
            .map(|rest| rest.split_whitespace().collect::<Vec<_>>().join(" "))
    };
    let found = lines.filter_map(numbers).find_map(|rest| {
        let (usual, all) = rest.split_once(' ')?;
        if is_all { all } else { usual }.parse().ok()
    });
    found.with_context(|| format!("{FILE} has no line `{step} SHARE SHARE`"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const BUDGET: &str = "# comment\nbuild 40 20\ndoc tests 5 3\ntests 55 77\n";

    fn time(step: &'static str, cpu_secs: f64) -> Time {
        Time { step, wall_secs: 1.0, cpu_secs }
    }

    #[test]
    fn a_step_over_twice_its_share_is_warned_about() {
        let times = [time("build", 30.0), time("doc tests", 30.0), time("tests", 40.0)];
        let text = table(BUDGET, false, &times).unwrap();
        let warned: Vec<_> = text.lines().filter(|line| line.contains("WARNING")).collect();
        assert_eq!(warned.len(), 1, "{text}");
        assert!(warned[0].starts_with("doc tests"), "{text}");
        assert!(text.ends_with("all passed           3.0     100.0\n"), "{text}");
    }

    #[test]
    fn a_step_without_a_budget_is_an_error() {
        let error = table(BUDGET, true, &[time("python", 1.0)]).unwrap_err();
        assert_eq!(error.to_string(), "xtask/budget.txt has no line `python SHARE SHARE`");
    }

    #[test]
    fn the_time_of_a_child_counts() {
        let before = cpu_secs();
        let busy = "i=0; while [ $i -lt 200000 ]; do i=$((i+1)); done";
        assert!(std::process::Command::new("sh").args(["-c", busy]).status().unwrap().success());
        assert!(cpu_secs() > before);
    }
}
