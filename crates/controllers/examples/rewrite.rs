//! Rewrites controller files in the current format without changing any number:
//! `cargo run -p mishandle-controllers --example rewrite -- controllers/*/*.safetensors`

use std::path::PathBuf;

use mishandle_controllers::{ControllerError, ControllerFile};

fn main() -> Result<(), ControllerError> {
    for path in std::env::args_os().skip(1).map(PathBuf::from) {
        ControllerFile::load(&path)?.save(&path)?;
    }
    Ok(())
}
