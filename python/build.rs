//! Sets the search path of the module to the folder into which `cargo xtask mujoco` puts MuJoCo's
//! library.

use std::path::Path;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let library = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/mujoco/lib");
    println!("cargo::rustc-link-arg-cdylib=-Wl,-rpath,{}", library.display());
}
