//! The platforms of the program, with the library of MuJoCo for each.

use anyhow::{Context, Result};

/// A platform.
pub struct Platform {
    /// Name in the names of archives.
    pub name: &'static str,
    /// Operating system and architecture as the standard library names them.
    host: [&'static str; 2],
    /// File of MuJoCo's library, and the name by which a linker finds it.
    pub library: &'static str,
    pub link: &'static str,
    /// SHA-256 of the library; all wheels of this version for the platform contain the same bytes.
    pub sha256: &'static str,
    /// Option of pip that selects the wheel of MuJoCo.
    pub wheel: &'static str,
    /// Whether its build was run. The others are prepared: hashes are those of the wheels on PyPI,
    /// but nobody has built and tested the program there.
    pub was_run: bool,
}

const PLATFORMS: &[Platform] = &[
    Platform {
        name: "x86_64-linux",
        host: ["linux", "x86_64"],
        library: "libmujoco.so.3.17.0",
        link: "libmujoco.so",
        sha256: "23496b023ee80fb61ab71167e94bc649f9941710fde96b18bb8204fb332523ad",
        wheel: "--platform=manylinux_2_28_x86_64",
        was_run: true,
    },
    Platform {
        name: "aarch64-linux",
        host: ["linux", "aarch64"],
        library: "libmujoco.so.3.17.0",
        link: "libmujoco.so",
        sha256: "e2edd0204fb9229f75f332a4fcd1a32345bb9f90651dc0fddfa20ec0670db789",
        wheel: "--platform=manylinux_2_28_aarch64",
        was_run: false,
    },
    Platform {
        name: "aarch64-macos",
        host: ["macos", "aarch64"],
        library: "libmujoco.3.17.0.dylib",
        link: "libmujoco.dylib",
        sha256: "454d51fa639100018579716bd68e61285e9b53c9241b029680d82dec95bc8d53",
        wheel: "--platform=macosx_11_0_arm64",
        was_run: false,
    },
];

/// Returns the platform of this machine.
///
/// # Errors
/// If the program does not support it.
pub fn present() -> Result<&'static Platform> {
    let host = [std::env::consts::OS, std::env::consts::ARCH];
    PLATFORMS.iter().find(|platform| platform.host == host).with_context(|| {
        let names: Vec<&str> = PLATFORMS.iter().map(|platform| platform.name).collect();
        format!("{} on {} is not supported; supported are {}", host[1], host[0], names.join(", "))
    })
}
