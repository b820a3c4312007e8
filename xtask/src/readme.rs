//! `cargo xtask readme`: runs the commands shown in the README and in pages of `docs`, and checks
//! their output. With `--update`, it writes the printed lines to the pages in place of the shown
//! ones, which brings their numbers up to date.
//!
//! In a code block marked `console`, a line that starts with `$ ` is a command (`\` at its end
//! continues it on the next line), and the lines below are its output. The blocks of a page run in
//! order, each command in its own shell, in a folder of the page, which is empty at first, with the
//! build of the tests on the path. Two pages run at a time. A command must exit with 0, unless a
//! comment directly above the block gives the code of each of its commands: `<!-- exit: 0 1 -->`.
//! The command must print every output line that the page shows, to stdout or stderr. Numbers and
//! the width of gaps are not compared; a page may leave lines out. A command that a page names as
//! the source of [figures](crate::figures) must print these numbers. A comment
//! `<!-- picture PATH: COMMAND -->`, which may have several lines, names a picture of the
//! repository: the command must write the same bytes to the file of that name in its folder.

mod picture;

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::Mutex;
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};

use crate::check::Extent;
use crate::figures::{is_printed, sourced};
use crate::process::{cargo, linted, run};

/// The longest first. Without `--all`, only the pages in [`USUAL`] run.
pub const PAGES: [&str; 22] = [
    "docs/guide/margin.md",
    "docs/guide/tour.md",
    "docs/guide/check.md",
    "README.md",
    "docs/guide/explain.md",
    "docs/guide/metamorphic.md",
    "docs/guide/faults.md",
    "docs/guide/record.md",
    "docs/guide/guard.md",
    "docs/reference/scenarios.md",
    "docs/guide/logs.md",
    "docs/guide/requirements.md",
    "docs/guide/online.md",
    "docs/guide/keep_going.md",
    "docs/guide/risk.md",
    "crates/tasks/src/ball_balancing/page.md",
    "crates/tasks/src/ball_catching/page.md",
    "crates/tasks/src/ball_pushing/page.md",
    "crates/tasks/src/cube_stacking/page.md",
    "crates/tasks/src/door_opening/page.md",
    "crates/tasks/src/peg_in_hole/page.md",
    "crates/tasks/src/point_reaching/page.md",
];
/// The pages of a first day, whose commands take seconds.
const USUAL: [&str; 3] = [FRONT_PAGE, "docs/guide/check.md", "docs/guide/logs.md"];
/// Number of pages that run at a time. Parts of a command use one core.
const AT_A_TIME: usize = 2;
/// Its commands that other pages show with the same output run there only.
const FRONT_PAGE: &str = "README.md";
/// Time limit for one command, s: long enough for a loaded machine.
const LIMIT_SECS: u32 = 600;
/// Exit code of `timeout` at the limit.
const TIMED_OUT: i32 = 124;

/// Commands that are shown but not run: their first words and the reason.
const SKIPPED: &[(&str, &str)] = &[
    ("git clone", "the repository is already there"),
    ("cd ", "the commands run in their own folder"),
    ("cargo xtask demo", "other steps run its parts"),
    ("cargo xtask test", "it runs this check"),
    ("cargo bench", "takes minutes"),
];

#[derive(Clone, Debug, Default, PartialEq)]
struct Shown {
    /// Line of its page, from 1.
    line: usize,
    command: String,
    exit: i32,
    /// Output lines that the page shows with their lines of the page, blank ones left out.
    output: Vec<(usize, String)>,
    /// Numbers of the page that the command prints, rounded.
    figures: Vec<String>,
    /// Path of the picture that the command makes.
    picture: Option<String>,
}

impl Shown {
    /// Returns whether a check of this command checks the other one, too.
    fn covers(&self, other: &Shown) -> bool {
        let has =
            |line: &str| self.output.iter().any(|(_, own)| without_numbers(own) == without_numbers(line));
        (&self.command, self.exit) == (&other.command, other.exit)
            && other.output.iter().all(|(_, line)| has(line))
            && other.figures.iter().all(|figure| self.figures.contains(figure))
            && other.picture.is_none()
    }
}

/// Builds the program, then runs every command of the pages of this extent.
///
/// # Errors
/// The first command that differs from its page, with its line.
pub fn check(root: &Path, extent: Extent) -> Result<()> {
    build(root)?;
    let chosen: Vec<&str> =
        PAGES.into_iter().filter(|page| extent == Extent::All || USUAL.contains(page)).collect();
    let others = chosen.iter().filter(|page| **page != FRONT_PAGE).map(|page| shown(root, page));
    let others = others.collect::<Result<Vec<_>>>()?.concat();
    let pages = Mutex::new(chosen.iter());
    let next = || pages.lock().ok().and_then(|mut pages| pages.next());
    std::thread::scope(|scope| {
        let check_pages = || {
            while let Some(page) = next() {
                let elsewhere = if *page == FRONT_PAGE { &others[..] } else { &[] };
                if let Err(error) = check_page(root, page, elsewhere, false) {
                    while next().is_some() {}
                    return Err(error);
                }
            }
            Ok(())
        };
        let threads: Vec<_> = (0..AT_A_TIME).map(|_| scope.spawn(check_pages)).collect();
        threads.into_iter().try_for_each(|thread| thread.join().unwrap_or_else(|_| bail!("a panic")))
    })
}

/// Does the same as [`check`] and, with `--update`, writes the printed lines to the pages.
///
/// # Errors
/// As for [`check`], or for other arguments. Pages before the one that differs are updated.
pub fn check_or_update(root: &Path, arguments: &[String]) -> Result<()> {
    match arguments {
        [] => check(root, Extent::All),
        [update] if update == "--update" => {
            build(root)?;
            PAGES.iter().try_for_each(|page| update_page(root, page))
        }
        _ => bail!("`cargo xtask readme` takes no argument but --update"),
    }
}

/// Builds the program as the tests do, so that nothing is compiled again after them.
///
/// # Errors
/// If the build fails.
pub fn build(root: &Path) -> Result<()> {
    run(linted(&mut cargo(root, &["build", "--workspace", "--bins"])), &[0])
}

fn update_page(root: &Path, page: &str) -> Result<()> {
    let printed = check_page(root, page, &[], true)?;
    let path = root.join(page);
    let text = fs::read_to_string(&path).with_context(|| format!("cannot read {page}"))?;
    fs::write(&path, replace_lines(&text, &printed)).with_context(|| format!("cannot write {page}"))
}

/// Replaces lines of a text, numbered from 1.
fn replace_lines(text: &str, new: &[(usize, String)]) -> String {
    let mut lines: Vec<&str> = text.lines().collect();
    for (number, line) in new {
        lines[number - 1] = line;
    }
    lines.join("\n") + "\n"
}

/// Returns what a page shows.
fn shown(root: &Path, page: &str) -> Result<Vec<Shown>> {
    let text = fs::read_to_string(root.join(page)).with_context(|| format!("cannot read {page}"))?;
    commands(&text).with_context(|| page.to_string())
}

/// Runs the commands of a page, except those that are shown `elsewhere`, too. Returns what they
/// printed in place of each shown line, with its line of the page. An update replaces pictures.
fn check_page(root: &Path, page: &str, elsewhere: &[Shown], is_update: bool) -> Result<Vec<(usize, String)>> {
    let shown = shown(root, page)?;
    // An empty folder, so that files of an earlier run cannot interfere.
    let folder = root.join("target/readme").join(page.replace('/', "-"));
    if folder.exists() {
        fs::remove_dir_all(&folder).with_context(|| format!("cannot empty {}", folder.display()))?;
    }
    fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let mut printed = Vec::new();
    for shown in &shown {
        let place = format!("{page}:{}: `{}`", shown.line, shown.command);
        if let Some((_, reason)) = SKIPPED.iter().find(|(start, _)| shown.command.starts_with(start)) {
            eprintln!("{place}: not run, {reason}");
            continue;
        }
        if elsewhere.iter().any(|other| other.covers(shown)) {
            eprintln!("{place}: not run, another page shows it, too");
            continue;
        }
        let started = Instant::now();
        printed.extend(try_out(root, &folder, shown).with_context(|| place.clone())?);
        if let Some(picture) = &shown.picture {
            picture::compare(root, &folder, picture, is_update).with_context(|| place.clone())?;
        }
        eprintln!("{place}: as shown, {:.1} s", started.elapsed().as_secs_f64());
    }
    Ok(printed)
}

/// Returns the commands of all blocks marked `console`, in order, then those that are sources.
fn commands(text: &str) -> Result<Vec<Shown>> {
    let mut found = Vec::new();
    let mut lines = (1..).zip(text.lines()).peekable();
    let mut above = "";
    while let Some((number, line)) = lines.next() {
        if line.trim() != "```console" {
            // A blank line between the comment and its block is allowed: Markdown needs it.
            above = if line.trim().is_empty() { above } else { line };
            continue;
        }
        let mut block: Vec<(usize, &str)> = Vec::new();
        while let Some(inside) = lines.next_if(|(_, line)| line.trim() != "```") {
            block.push(inside);
        }
        found.extend(commands_of_block(number, &block, above)?);
        lines.next();
        above = "";
    }
    found.extend(sourced(text).into_iter().filter_map(|part| {
        let command = part.command()?.to_owned();
        Some(Shown { line: part.line, command, figures: part.figures, ..Shown::default() })
    }));
    found.extend(picture::commands(text));
    Ok(found)
}

fn commands_of_block(number: usize, block: &[(usize, &str)], above: &str) -> Result<Vec<Shown>> {
    let mut found: Vec<Shown> = Vec::new();
    let mut goes_on = false;
    for (line, text) in block {
        let last = found.last_mut();
        if goes_on && let Some(last) = last {
            goes_on = text.ends_with('\\');
            last.command += " ";
            last.command += text.trim_end_matches('\\').trim_start_matches("> ").trim();
        } else if let Some(command) = text.strip_prefix("$ ") {
            goes_on = command.ends_with('\\');
            let command = command.trim_end_matches('\\').trim().to_owned();
            found.push(Shown { line: *line, command, ..Shown::default() });
        } else if let Some(last) = last
            && !text.trim().is_empty()
        {
            last.output.push((*line, (*text).to_owned()));
        }
    }
    if let Some(codes) = above.trim().strip_prefix("<!-- exit:").and_then(|rest| rest.strip_suffix("-->")) {
        let codes: Vec<i32> =
            codes.split_whitespace().map(str::parse).collect::<Result<_, _>>().with_context(|| {
                format!("line {number}: the exit codes above the block, `{codes}`, are not numbers")
            })?;
        ensure!(
            codes.len() == found.len(),
            "line {number}: the block has {} commands and {} exit codes above it",
            found.len(),
            codes.len()
        );
        for (shown, code) in found.iter_mut().zip(codes) {
            shown.exit = code;
        }
    }
    Ok(found)
}

/// Runs a command in `folder`, with the repository's programs, controllers and settings. Returns
/// what it printed in place of each shown line, with its line of the page.
fn try_out(root: &Path, folder: &Path, shown: &Shown) -> Result<Vec<(usize, String)>> {
    let old = std::env::var_os("PATH").unwrap_or_default();
    let path =
        std::env::join_paths([root.join("target/debug")].into_iter().chain(std::env::split_paths(&old)))?;
    let output = Command::new("timeout")
        .args(["--kill-after=5", &LIMIT_SECS.to_string(), "bash", "-c", &shown.command])
        .current_dir(folder)
        .env("PATH", path)
        .env("MISHANDLE_HOME", root)
        .output()
        .context("cannot run it")?;
    let written =
        format!("{}\n{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    match output.status.code() {
        Some(TIMED_OUT) => bail!("it takes more than {LIMIT_SECS} s"),
        code if code != Some(shown.exit) => {
            bail!(
                "{}, not exit code {} as shown; it printed:\n{}",
                output.status,
                shown.exit,
                written.trim()
            );
        }
        _ => {}
    }
    if let Some(figure) = shown.figures.iter().find(|figure| !is_printed(figure, &written)) {
        bail!("the page shows {figure}, which the command does not print; it printed:\n{}", written.trim());
    }
    let mut lines: Vec<&str> = written.lines().map(str::trim_end).collect();
    let mut printed = Vec::new();
    for (number, line) in &shown.output {
        let Some(found) = lines.iter().position(|printed| without_numbers(printed) == without_numbers(line))
        else {
            bail!(
                "the page shows a line that the command does not print:\n{line}\nit printed:\n{}",
                written.trim()
            );
        };
        // Lines can differ in numbers only, so each printed line stands for one shown line.
        printed.push((*number, lines.remove(found).to_owned()));
    }
    Ok(printed)
}

/// Replaces each number (sign, digits, point, exponent) with `#` and each gap with one space.
fn without_numbers(line: &str) -> String {
    let mut out = String::new();
    let mut rest = line.trim();
    while let Some(first) = rest.chars().next() {
        let length = number_length(rest);
        if length > 0 {
            out.push('#');
        } else if !(first.is_whitespace() && out.ends_with(' ')) {
            out.push(if first.is_whitespace() { ' ' } else { first });
        }
        rest = &rest[length.max(first.len_utf8())..];
    }
    out
}

/// Returns the length in bytes of the number at the start of a text; 0 if it starts with none.
fn number_length(text: &str) -> usize {
    let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
    let sign = usize::from(text.starts_with(['-', '+']));
    let whole = digits(&text[sign..]);
    if whole == 0 {
        return 0;
    }
    let mut length = sign + whole;
    while text[length..].starts_with(['.', ',']) && digits(&text[length + 1..]) > 0 {
        length += 1 + digits(&text[length + 1..]);
    }
    if text[length..].starts_with(['e', 'E']) {
        let sign = usize::from(text[length + 1..].starts_with(['-', '+']));
        let exponent = digits(&text[length + 1 + sign..]);
        length += if exponent > 0 { 1 + sign + exponent } else { 0 };
    }
    length
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The output is on the lines below the command.
    fn shown(line: usize, command: &str, exit: i32, output: &[&str]) -> Shown {
        let output = (line + 1..).zip(output.iter().map(|line| (*line).to_owned())).collect();
        Shown { line, command: command.into(), exit, output, ..Shown::default() }
    }

    #[test]
    fn only_console_blocks_hold_commands() {
        let text = "```sh\n$ no\n```\n\n<!-- exit: 0 1 -->\n\n```console\n$ one\nout\nmore\n$ two \\\n    --long\n```\n$ no\n";
        let expected = vec![shown(8, "one", 0, &["out", "more"]), shown(11, "two --long", 1, &[])];
        assert_eq!(commands(text).unwrap(), expected);
    }

    #[test]
    fn an_update_replaces_shown_lines_in_order_and_keeps_the_others() {
        let page = "text\n```console\n$ printf 'a 1\\nb\\na 22\\na 3\\n'\na 7\nb\na 8\n```\nend\n";
        let root = std::env::temp_dir();
        let printed = try_out(&root, &root, &commands(page).unwrap()[0]).unwrap();
        let expected = page.replace("a 7", "a 1").replace("a 8", "a 22");
        assert_eq!(replace_lines(page, &printed), expected);
    }

    #[test]
    fn a_command_covers_the_same_one_with_fewer_lines() {
        let long = shown(1, "run", 1, &["falsified 2", "took 3 s"]);
        assert!(long.covers(&shown(7, "run", 1, &["took 4 s"])) && long.covers(&shown(7, "run", 1, &[])));
        for other in [("run", 1, "other"), ("run", 0, "took 3 s"), ("run it", 1, "took 3 s")] {
            assert!(!long.covers(&shown(7, other.0, other.1, &[other.2])), "{other:?}");
        }
    }

    #[test]
    fn exit_codes_belong_to_the_block_below_them_and_match_its_commands() {
        let two = commands("<!-- exit: 1 -->\n```console\n$ a\n```\ntext\n```console\n$ b\n```\n").unwrap();
        assert_eq!(two.iter().map(|shown| shown.exit).collect::<Vec<_>>(), [1, 0]);
        let error = commands("<!-- exit: 1 -->\n```console\n$ a\n$ b\n```\n").unwrap_err();
        assert_eq!(error.to_string(), "line 2: the block has 2 commands and 1 exit codes above it");
    }

    #[test]
    fn numbers_and_gaps_are_not_compared_but_words_are() {
        for (line, expected) in [
            ("falsified 27 of 30  trials", "falsified # of # trials"),
            ("rho -0.031 (1.5e-7)", "rho # (#)"),
            ("1,000.5 s, x1 and v2.0.", "# s, x# and v#."),
            ("| a |  3 |", "| a | # |"),
            ("3 e, 3e, -e", "# e, #e, -e"),
            ("ρ = −3 µm", "ρ = −# µm"),
        ] {
            assert_eq!(without_numbers(line), expected, "{line}");
        }
    }

    #[test]
    fn exit_code_and_every_shown_line_are_compared() {
        let root = std::env::temp_dir();
        let error = |command: &str, exit, output: &[&str]| {
            try_out(&root, &root, &shown(1, command, exit, output)).err().map(|error| error.to_string())
        };
        assert_eq!(error("echo took 3 s >&2; echo b; exit 1", 1, &["took 12.5 s", "b"]), None);
        assert!(error("exit 1", 0, &[]).unwrap().contains("exit status: 1, not exit code 0"));
        assert!(error("echo held", 0, &["held", "falsified"]).unwrap().contains("\nfalsified\n"));
    }

    #[test]
    fn figures_are_compared_with_the_output_of_their_source() {
        let page = "| a | measured |\n|---|---|\n| 3.5 and 40 % | `mishandle evaluate a` |\n";
        let mut found = commands(page).unwrap();
        assert_eq!((found.len(), found[0].line, &found[0].command[..]), (1, 3, "mishandle evaluate a"));
        let root = std::env::temp_dir();
        found[0].command = "echo rates 3.46 % and 40.0 %".into();
        assert!(try_out(&root, &root, &found[0]).is_ok());
        found[0].command = "echo rates 3.44 % and 40.0 %".into();
        let error = try_out(&root, &root, &found[0]).unwrap_err().to_string();
        assert!(error.starts_with("the page shows 3.5, which the command does not print"), "{error}");
    }
}
