//! Lets an installed program find MuJoCo's library. Programs in `target` find it by the rpaths of `.cargo/config.toml`.

use std::env;
use std::path::{Path, PathBuf};

/// Set by `.cargo/config.toml`, or by a user who has a MuJoCo of their own.
const LINK_DIR: &str = "MUJOCO_DYNAMIC_LINK_DIR";

/// Where `cargo xtask mujoco` keeps its copy, from the user's data folder; xtask/src/mujoco.rs names it too.
const KEPT: &str = "mishandle/mujoco-3.17.0";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    for variable in [LINK_DIR, "XDG_DATA_HOME", "HOME"] {
        println!("cargo::rerun-if-env-changed={variable}");
    }
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let link_dir = env::var_os(LINK_DIR).map(PathBuf::from).and_then(|folder| folder.canonicalize().ok());
    let is_own = link_dir != package.join("../world/link").canonicalize().ok();
    let own = link_dir.filter(|_| is_own);
    // A package that installs the program as PREFIX/bin/mishandle can put the library into PREFIX/lib/mishandle.
    let beside = Some(PathBuf::from("$ORIGIN/../lib/mishandle"));
    let fetched = package.ancestors().nth(2).map(|root| root.join("target/mujoco/lib"));
    let folders =
        own.into_iter().chain(beside).chain(data_folder().map(|folder| folder.join(KEPT))).chain(fetched);
    for folder in folders {
        println!("cargo::rustc-link-arg-bins=-Wl,-rpath,{}", folder.display());
    }
}

/// The user's data folder, as the XDG Base Directory Specification defines it.
fn data_folder() -> Option<PathBuf> {
    let absolute = |name| env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    absolute("XDG_DATA_HOME").or_else(|| Some(absolute("HOME")?.join(".local/share")))
}
