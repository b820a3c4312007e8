//! `cargo xtask book`: builds the documentation as HTML with search, in `target/book`, and checks
//! its links.
//!
//! `docs/README.md` is the contents page; its lists give the chapters and their order. [`pages`]
//! copies the chapters to `target/book-src`, mdBook makes HTML of them, and [`html`] checks every
//! local link of the result. A link to a source file leads to the file of the clone.

mod html;
mod pages;

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::process::{cargo, output, run};
use crate::reference;

/// Version of mdBook. Other versions may give headings other anchors.
const VERSION: &str = "0.5.4";
/// mdBook after its installation, from the root.
const MDBOOK: &str = "target/tools/bin/mdbook";
/// Folder of the prepared Markdown files, from the root.
const SOURCE: &str = "target/book-src";
/// Folder of the HTML files, from the root.
const BOOK: &str = "target/book";

const CONFIGURATION: &str = "\
[book]
title = \"Mishandle\"
language = \"en\"
src = \"src\"

[output.html]
input-404 = \"\"
no-section-label = true

[output.html.print]
enable = false
";

/// Builds the book. The first run installs mdBook into `target/tools`, which downloads and compiles
/// it.
///
/// # Errors
/// If mdBook cannot be installed, or a link of the book is broken.
pub fn build(root: &Path) -> Result<()> {
    install(root)?;
    for folder in [SOURCE, BOOK] {
        let folder = root.join(folder);
        if folder.exists() {
            fs::remove_dir_all(&folder).with_context(|| format!("cannot empty {}", folder.display()))?;
        }
    }
    reference::write(root)?;
    let pages = pages::prepare(root, &root.join(SOURCE).join("src"))?;
    fs::write(root.join(SOURCE).join("book.toml"), CONFIGURATION).context(SOURCE)?;
    let book = root.join(BOOK);
    run(
        Command::new(root.join(MDBOOK)).args(["build", SOURCE, "--dest-dir"]).arg(&book).current_dir(root),
        &[0],
    )?;
    let broken = html::broken_links(&book)?;
    for link in &broken {
        eprintln!("{link}");
    }
    ensure!(broken.is_empty(), "{} links of the book are broken", broken.len());
    eprintln!("{pages} pages: {BOOK}/index.html");
    Ok(())
}

fn install(root: &Path) -> Result<()> {
    let program = root.join(MDBOOK);
    if program.is_file()
        && output(Command::new(&program).arg("--version"))?.trim() == format!("mdbook v{VERSION}")
    {
        return Ok(());
    }
    eprintln!("installing mdBook {VERSION} into target/tools, which takes minutes");
    let arguments = ["install", "mdbook", "--version", VERSION, "--locked", "--root", "target/tools"];
    run(&mut cargo(root, &arguments), &[0])
}
