//! Compares the size of the repository with `xtask/ratchet.txt`: a change that makes it larger says
//! so there, and its commit says why.

use std::collections::BTreeMap;

use super::{Problem, Tree};

const FILE: &str = "xtask/ratchet.txt";

/// Numbers by name, in the order of the file.
type Counts = BTreeMap<String, usize>;

/// Returns the number of each line of the file that is no longer right.
pub fn check(tree: &Tree) -> Vec<Problem> {
    let Some(file) = tree.file(FILE) else {
        return vec![problem(1, format!("is missing; it has these lines:\n{}", text(&counts(tree))))];
    };
    let counts = counts(tree);
    let mut problems = Vec::new();
    let mut names = Vec::new();
    for (line, written) in (1..).zip(file.text.lines()).filter(|(_, text)| !text.starts_with('#')) {
        let Some((name, limit)) = entry(written) else {
            problems.push(problem(line, format!("`{written}` is not a name and a number")));
            continue;
        };
        names.push(name);
        match counts.get(name) {
            // The program counts its commands and flags in a test of `cli`.
            None if name == "commands" || name == "flags" => {}
            None => problems.push(problem(line, format!("nothing is called `{name}`; remove the line"))),
            Some(count) if *count > limit => problems.push(problem(
                line,
                format!("{name}: {count}, more than {limit}; make it smaller, or write {count} and the reason in the commit"),
            )),
            Some(count) if count + slack(limit) < limit => {
                problems.push(problem(line, format!("{name}: {count} is less than {limit}; write {count}")));
            }
            Some(_) => {}
        }
    }
    let is_missing = |name: &&String| !names.contains(&name.as_str());
    let missing = counts.keys().filter(is_missing).map(|name| problem(1, format!("`{name}` is missing")));
    problems.extend(missing);
    problems
}

/// How far a number may stay behind what it counts: a deletion need not touch the file.
fn slack(limit: usize) -> usize {
    limit / 50 + 2
}

fn entry(line: &str) -> Option<(&str, usize)> {
    let (name, number) = line.rsplit_once(' ')?;
    Some((name, number.parse().ok()?))
}

fn problem(line: usize, what: String) -> Problem {
    Problem { path: FILE.into(), line, what }
}

fn text(counts: &Counts) -> String {
    counts.iter().map(|(name, count)| format!("{name} {count}\n")).collect()
}

/// Lines and words are stated in steps of this many, so that few changes touch the file.
const STEP: usize = 100;

/// Counts lines of sources and of tests per package, words of Markdown per folder, public names,
/// and megabytes.
fn counts(tree: &Tree) -> Counts {
    let mut counts = Counts::new();
    let mut bytes = 0;
    for file in &tree.files {
        bytes += file.size;
        let (folder, kind) = match file.path.rsplit_once('.') {
            Some((_, "rs")) => (package(&file.path), "Rust"),
            Some((_, "py")) => (package(&file.path), "Python"),
            Some((_, "md")) => {
                let folder = file.path.rsplit_once('/').map_or("top", |(folder, _)| folder);
                let words = file.text.split_whitespace().count();
                let two = folder.splitn(3, '/').take(2).collect::<Vec<_>>().join("/");
                *counts.entry(format!("words of {two}")).or_default() += words;
                continue;
            }
            _ => continue,
        };
        let part = if is_test(&file.path) { " tests" } else { "" };
        *counts.entry(format!("{kind} of {folder}{part}")).or_default() += file.text.lines().count();
        let public = match kind {
            "Rust" if part.is_empty() => file.text.lines().filter(|line| is_public(line)).count(),
            _ => 0,
        };
        *counts.entry("public names of Rust".into()).or_default() += public;
    }
    if let Some(face) = tree.file("python/mishandle/__init__.py") {
        let exported = face.text.lines().skip_while(|line| !line.starts_with("__all__")).skip(1);
        let exported = exported.take_while(|line| !line.starts_with(']')).count();
        counts.insert("public names of Python".into(), exported);
    }
    for (_, count) in
        counts.iter_mut().filter(|(name, _)| name.contains(" of ") && !name.starts_with("public"))
    {
        *count = count.next_multiple_of(STEP);
    }
    counts.insert("megabytes".into(), bytes.div_ceil(1_000_000));
    counts
}

/// Returns the folder of the package that has a file.
fn package(path: &str) -> &str {
    let mut ends = path.match_indices('/').map(|(at, _)| at);
    let first = ends.next().unwrap_or(0);
    match &path[..first] {
        "crates" => &path[..ends.next().unwrap_or(first)],
        "" | "benches" | "examples" | "src" | "tests" => "mishandle",
        folder => folder,
    }
}

fn is_test(path: &str) -> bool {
    path.split('/').any(|folder| folder == "tests")
}

fn is_public(line: &str) -> bool {
    let rest = line.trim_start().strip_prefix("pub ");
    let words = ["fn ", "const ", "static ", "struct ", "enum ", "trait ", "type ", "unsafe ", "mod "];
    rest.is_some_and(|rest| words.iter().any(|word| rest.starts_with(word)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(ratchet: &str) -> Vec<String> {
        let tree = Tree::of(&[
            (FILE, ratchet),
            ("README.md", "three words here\n"),
            ("src/lib.rs", "pub fn a() {}\nfn b() {}\n"),
            ("tests/a.rs", "fn c() {}\n"),
        ]);
        check(&tree).iter().map(ToString::to_string).collect()
    }

    const RIGHT: &str = "# sizes\nRust of mishandle 100\nRust of mishandle tests 100\nmegabytes 1\npublic names of Rust 1\nwords of top 100\n";

    #[test]
    fn a_number_that_grew_is_found() {
        assert_eq!(found(RIGHT), [] as [&str; 0]);
        let grown = RIGHT.replace("mishandle 100", "mishandle 99");
        let what = "more than 99; make it smaller, or write 100 and the reason in the commit";
        assert_eq!(found(&grown), [format!("{FILE}:2: Rust of mishandle: 100, {what}")]);
    }

    #[test]
    fn a_number_that_shrank_is_written_again() {
        let shrunk = RIGHT.replace("mishandle 100", "mishandle 300");
        assert_eq!(found(&shrunk), [format!("{FILE}:2: Rust of mishandle: 100 is less than 300; write 100")]);
        assert_eq!(found(&RIGHT.replace("mishandle 100", "mishandle 102")), [] as [&str; 0]);
    }

    #[test]
    fn each_line_has_a_number_of_something() {
        assert_eq!(found(&RIGHT.replace("megabytes 1\n", "")), [format!("{FILE}:1: `megabytes` is missing")]);
        let unknown = RIGHT.to_owned() + "Rust of nothing 1\nflags 80\na\n";
        let problems = [
            format!("{FILE}:7: nothing is called `Rust of nothing`; remove the line"),
            format!("{FILE}:9: `a` is not a name and a number"),
        ];
        assert_eq!(found(&unknown), problems);
    }
}
