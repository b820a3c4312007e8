//! Sets the search paths with which an installed program finds MuJoCo's library. Programs in
//! `target` find it through the rpaths of `.cargo/config.toml`.

use std::env;
use std::path::{Path, PathBuf};

/// Set by `.cargo/config.toml`, or by a user with another copy of MuJoCo.
const LINK_DIR: &str = "MUJOCO_DYNAMIC_LINK_DIR";

/// Folder of the copy by `cargo xtask mujoco`, relative to the user's data folder. Must equal the
/// path in xtask/src/mujoco.rs.
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
    // For packages that install PREFIX/bin/mishandle and put the library into PREFIX/lib/mishandle.
    let beside = Some(PathBuf::from("$ORIGIN/../lib/mishandle"));
    let fetched = package.ancestors().nth(2).map(|root| root.join("target/mujoco/lib"));
    let folders =
        own.into_iter().chain(beside).chain(data_folder().map(|folder| folder.join(KEPT))).chain(fetched);
    for folder in folders {
        println!("cargo::rustc-link-arg-bins=-Wl,-rpath,{}", folder.display());
    }
}

/// Returns the user's data folder, as defined by the XDG Base Directory Specification.
fn data_folder() -> Option<PathBuf> {
    let absolute = |name| env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    absolute("XDG_DATA_HOME").or_else(|| Some(absolute("HOME")?.join(".local/share")))
}
