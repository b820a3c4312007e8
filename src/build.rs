use mishandle_store::BuildRecord;

/// Version of the program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The version, and in brackets the commit that the program was built from: `mishandle --version`.
pub const VERSION_AND_COMMIT: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("MISHANDLE_COMMIT"), ")");

/// The architecture; of a build without the instruction set of `.cargo/config.toml`, with a remark.
const ARCHITECTURE: &str =
    match cfg!(all(target_arch = "x86_64", not(all(target_feature = "avx2", target_feature = "fma")))) {
        true => "x86_64 without avx2 and fma",
        false => std::env::consts::ARCH,
    };

/// What the program was built from: what a record needs to be replayed to the same bits.
pub fn build() -> BuildRecord {
    BuildRecord {
        program_version: VERSION.to_string(),
        git_commit: env!("MISHANDLE_COMMIT").to_string(),
        target: env!("MISHANDLE_TARGET").to_string(),
        rustc: env!("MISHANDLE_RUSTC").to_string(),
        architecture: ARCHITECTURE.to_string(),
    }
}
