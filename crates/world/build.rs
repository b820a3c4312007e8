//! Tells the linker where MuJoCo's library is, and stops the build with one line when it is not there.
//!
//! `mujoco-rs` looks for a `libmujoco.so` too, in a build script that may run long before this one, and panics without
//! it. So `.cargo/config.toml` shows it the folder `link`, which always has one: a linker script that names the real
//! library. What is left to check is checked here.

use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// Set by `.cargo/config.toml` to the folder `link`, unless the user names a folder of their own.
const LINK_DIR: &str = "MUJOCO_DYNAMIC_LINK_DIR";
const LIBRARY: &str = "libmujoco.so.3.17.0";

fn main() -> io::Result<()> {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed={LINK_DIR}");
    if env::var_os(LINK_DIR).is_none_or(|folder| Path::new(&folder) != package.join("link")) {
        return Ok(()); // a MuJoCo of the user's own, which `mujoco-rs` checks and links
    }
    let library = package.join("../../target/mujoco/lib").join(LIBRARY);
    println!("cargo::rerun-if-changed={}", library.display());
    if !library.is_file() {
        println!(
            "cargo::error=MuJoCo's library is not in target/mujoco/lib; fetch it with `cargo xtask mujoco`"
        );
        return Ok(());
    }
    link(&library, &env::var_os("OUT_DIR").map(PathBuf::from).unwrap_or_default())
}

/// Makes the library known by a link in the build's own output: what lies there, and no folder beside it, cargo adds to
/// the run-time search path of the tests that have no rpath, which are those in the documentation.
fn link(library: &Path, out: &Path) -> io::Result<()> {
    let place = out.join(LIBRARY);
    if place.is_symlink() {
        fs::remove_file(&place)?;
    }
    symlink(library, place)?;
    println!("cargo::rustc-link-search=native={}", out.display());
    Ok(())
}
