//! `cargo xtask tidy`: checks that the compiler does not make. Each reads a [`Tree`] and returns
//! problems.

mod crates;
mod figures;
mod imports;
mod links;
mod programs;
mod prose;
mod python;
mod ratchet;
mod rooms;
mod rules;
mod sizes;
mod tuples;
mod width;
mod words;

use std::fmt;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::process::{cargo, output};

/// The files that git tracks. It leaves out what users keep in their clone, such as runs and logs.
struct Tree {
    files: Vec<File>,
}

struct File {
    /// From the root, with `/`.
    path: String,
    /// Empty for a file that is not text.
    text: String,
    /// Bytes.
    size: usize,
}

#[derive(Debug, PartialEq)]
struct Problem {
    path: String,
    /// From 1.
    line: usize,
    what: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.path, self.line, self.what)
    }
}

impl Tree {
    fn read(root: &Path) -> Result<Tree> {
        let names = output(Command::new("git").args(["ls-files", "-z"]).current_dir(root))?;
        let mut files: Vec<File> = names
            .split_terminator('\0')
            .filter(|name| root.join(name).is_file()) // git lists a deleted file until the deletion is staged
            .map(|name| {
                let bytes = std::fs::read(root.join(name))?;
                let size = bytes.len();
                let text = String::from_utf8(bytes).unwrap_or_default();
                Ok(File { path: name.to_owned(), text, size })
            })
            .collect::<Result<_>>()?;
        files.sort_by(|a, b| a.path.cmp(&b.path));
        Ok(Tree { files })
    }

    fn file(&self, path: &str) -> Option<&File> {
        self.files.iter().find(|file| file.path == path)
    }

    fn has_folder(&self, path: &str) -> bool {
        self.files.iter().any(|file| file.path.strip_prefix(path).is_some_and(|rest| rest.starts_with('/')))
    }

    /// For tests: a tree of these files.
    #[cfg(test)]
    fn of(files: &[(&str, &str)]) -> Tree {
        let file = |(path, text): &(&str, &str)| File {
            path: (*path).into(),
            text: (*text).into(),
            size: text.len(),
        };
        Tree { files: files.iter().map(file).collect() }
    }
}

/// Runs every check on the repository.
///
/// # Errors
/// Says how many problems there are, after a line for each.
pub fn check(root: &Path) -> Result<()> {
    let tree = Tree::read(root)?;
    let metadata = output(&mut cargo(root, &["metadata", "--no-deps", "--format-version=1"]))?;
    let packages = crates::packages(&metadata)?;
    let found = [
        crates::check(&tree, &packages),
        figures::check(&tree),
        rooms::check(&tree),
        rules::check(&tree),
        links::check(&tree),
        programs::check(&tree),
        prose::check(&tree),
        python::check(&tree),
        sizes::check(&tree),
        tuples::check(&tree),
        width::check(&tree),
        words::check(&tree),
        ratchet::check(&tree),
    ];
    let problems = found.into_iter().flatten().collect::<Vec<_>>();
    for problem in &problems {
        eprintln!("{problem}");
    }
    check_fuzz_lock(root)?;
    match problems.len() {
        0 => {
            eprintln!("{} files and {} crates are tidy", tree.files.len(), packages.len());
            Ok(())
        }
        1 => bail!("1 thing is not tidy"),
        n => bail!("{n} things are not tidy"),
    }
}

/// Checks that the lock file of the fuzz targets has the dependencies of the crates. Cargo would
/// change it in a build.
///
/// # Errors
/// If it is out of date.
fn check_fuzz_lock(root: &Path) -> Result<()> {
    let arguments = ["metadata", "--locked", "--format-version=1", "--manifest-path=fuzz/Cargo.toml"];
    output(&mut cargo(root, &arguments)).map(|_| ()).context(
        "cannot read fuzz/Cargo.lock; if it is out of date, run `cargo update --workspace --manifest-path fuzz/Cargo.toml`",
    )
}
