//! The build of this program: version, commit, compiler and platform.

use mishandle_store::BuildRecord;

/// Version of the program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Version of the program, with its git commit in parentheses: the output of `mishandle --version`.
pub const VERSION_AND_COMMIT: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("MISHANDLE_COMMIT"), ")");

/// CPU architecture. The text names a build without the instruction set of `.cargo/config.toml`.
const ARCHITECTURE: &str =
    if cfg!(all(target_arch = "x86_64", not(all(target_feature = "avx2", target_feature = "fma")))) {
        "x86_64 without avx2 and fma"
    } else {
        std::env::consts::ARCH
    };

/// Returns version, commit, compiler and platform of this program. A bit-identical replay needs the
/// same build.
pub fn build() -> BuildRecord {
    BuildRecord {
        program_version: VERSION.to_string(),
        git_commit: env!("MISHANDLE_COMMIT").to_string(),
        target: env!("MISHANDLE_TARGET").to_string(),
        rustc: env!("MISHANDLE_RUSTC").to_string(),
        architecture: ARCHITECTURE.to_string(),
    }
}
