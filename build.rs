//! Passes commit, target triple and compiler to the program, which stores them in run files and
//! controllers. Embeds the shipped controllers and training settings, so that an installed program
//! needs no clone.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs, io};

/// Sources of the program. A change in another file, such as a documentation page, does not mark
/// the commit as changed.
const SOURCES: [&str; 5] = ["build.rs", "Cargo.toml", "Cargo.lock", "src", "crates"];

/// Folders with a subfolder for each task, and the extensions of the files that are embedded.
const EMBEDDED: [(&str, &[&str]); 2] =
    [("controllers", &["safetensors", "onnx"]), ("controllers/training", &["toml"])];

fn main() -> io::Result<()> {
    // `git status` must run again after every change of a source.
    for file in SOURCES {
        println!("cargo::rerun-if-changed={file}");
    }
    if let Some(folder) = output("git", &["rev-parse", "--git-dir"]) {
        println!("cargo::rerun-if-changed={folder}/HEAD");
        println!("cargo::rerun-if-changed={folder}/index");
    }
    let commit = output("git", &["rev-parse", "--short=12", "HEAD"]).unwrap_or_else(|| "unknown".to_string());
    // Without this option, `git status` writes the index, after which the next build runs this
    // again and compiles every crate above.
    let status = ["--no-optional-locks", "status", "--porcelain", "--untracked-files=no", "--"];
    let status = [&status[..], &SOURCES[..]].concat();
    let changed = output("git", &status).is_some_and(|s| !s.is_empty());
    println!("cargo::rustc-env=MISHANDLE_COMMIT={commit}{}", if changed { "-changed" } else { "" });
    let rustc = env::var("RUSTC").ok().and_then(|rustc| output(&rustc, &["--version"]));
    println!("cargo::rustc-env=MISHANDLE_RUSTC={}", rustc.unwrap_or_default());
    println!("cargo::rustc-env=MISHANDLE_TARGET={}", env::var("TARGET").unwrap_or_default());
    embed()?;
    warn_of_features();
    Ok(())
}

/// Writes the list of embedded files as Rust source: paths relative to the repository, sorted, each
/// with its content.
fn embed() -> io::Result<()> {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let mut files = Vec::new();
    for (folder, extensions) in EMBEDDED {
        for task in entries(&root.join(folder))?.into_iter().filter(|path| path.is_dir()) {
            let found: Vec<PathBuf> = entries(&task)?
                .into_iter()
                .filter(|path| {
                    extensions.iter().any(|known| path.extension().is_some_and(|found| found == *known))
                })
                .collect();
            if !found.is_empty() {
                println!("cargo::rerun-if-changed={}", task.display());
            }
            files.extend(found);
        }
    }
    let lines = files.iter().map(|path| {
        let name = path.strip_prefix(&root).unwrap_or(path);
        format!("    ({name:?}, include_bytes!({path:?}).as_slice()),\n")
    });
    let list: String = lines.collect();
    fs::write(
        Path::new(&env::var_os("OUT_DIR").unwrap_or_default()).join("embedded.rs"),
        format!("&[\n{list}]\n"),
    )
}

/// Returns the entries of a folder in alphabetical order. Returns no entries if the folder does not
/// exist.
fn entries(folder: &Path) -> io::Result<Vec<PathBuf>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut paths: Vec<PathBuf> =
        fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<io::Result<_>>()?;
    paths.sort();
    Ok(paths)
}

/// Warns if `.cargo/config.toml` was not read, as in a crate outside the workspace. The results
/// have the same bits, but the matrix kernels run without vector instructions.
fn warn_of_features() {
    let features = env::var("CARGO_CFG_TARGET_FEATURE").unwrap_or_default();
    let has = |name| features.split(',').any(|feature| feature == name);
    if env::var("CARGO_CFG_TARGET_ARCH").is_ok_and(|arch| arch == "x86_64") && !(has("avx2") && has("fma")) {
        println!(
            "cargo::warning=Mishandle is built without `-C target-cpu=x86-64-v3`, so networks run many times slower; \
             docs/guide/library.md explains how to set it"
        );
    }
}

fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_string())
}
