//! Lets the module find MuJoCo's library from wherever pip put it: where `cargo xtask mujoco` did.

use std::path::Path;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let library = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/mujoco/lib");
    println!("cargo::rustc-link-arg-cdylib=-Wl,-rpath,{}", library.display());
}
