use mishandle_store::Build;

/// Version of the program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The version, and in brackets the commit that the program was built from: `mishandle --version`.
pub const VERSION_AND_COMMIT: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("MISHANDLE_COMMIT"), ")");

/// What the program was built from: what a record needs to be replayed to the same bits.
pub fn build() -> Build {
    Build {
        program_version: VERSION.to_string(),
        git_commit: env!("MISHANDLE_COMMIT").to_string(),
        target: env!("MISHANDLE_TARGET").to_string(),
        rustc: env!("MISHANDLE_RUSTC").to_string(),
        mujoco_version: mishandle_world::mujoco_version(),
        architecture: std::env::consts::ARCH.to_string(),
    }
}
