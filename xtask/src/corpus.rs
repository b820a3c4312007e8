//! The corpus of a fuzz target: one archive in Git, unpacked to a folder for libFuzzer.
//!
//! The archives are read and written by the programs `tar` and `gzip`, which every machine that
//! builds this repository has; crates for both would be the largest dependencies of xtask.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};

use crate::process::run;

/// Folder of the archives, from the root.
pub const CORPUS: &str = "fuzz/corpus";

/// Returns the path of a target's archive, from the root.
pub fn archive(target: &str) -> PathBuf {
    Path::new(CORPUS).join(format!("{target}.tar.gz"))
}

/// Unpacks the archive of a target to a folder, which keeps its other files. A target without an
/// archive has no corpus yet.
///
/// # Errors
/// If `tar` does not run, or the archive is damaged.
pub fn unpack(root: &Path, target: &str, folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let archive = root.join(archive(target));
    if !archive.is_file() {
        return Ok(());
    }
    run(Command::new("tar").arg("-xzf").arg(archive).arg("-C").arg(folder), &[0])
}

/// Packs the files of a folder to the archive of a target. The same files give the same archive: it
/// has sorted names and no times or owners.
///
/// # Errors
/// If the folder is empty, or `tar` is not GNU tar.
pub fn pack(root: &Path, target: &str, folder: &Path) -> Result<usize> {
    let files = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut names = files.map(|file| Ok(file?.file_name())).collect::<Result<Vec<_>>>()?;
    names.sort();
    ensure!(!names.is_empty(), "{} is empty", folder.display());
    let archive = root.join(archive(target));
    let tarred = archive.with_extension("new.tar");
    let packed = archive.with_extension("new");
    let mut tar = Command::new("tar");
    // The header of the format `ustar` has no time of access.
    tar.args(["--format=ustar", "--mtime=@0", "--owner=0", "--group=0", "--numeric-owner", "--mode=0644"]);
    run(tar.arg("-cf").arg(&tarred).arg("-C").arg(folder).arg("--").args(&names), &[0])?;
    let out = fs::File::create(&packed).with_context(|| packed.display().to_string())?;
    let input = fs::File::open(&tarred).with_context(|| tarred.display().to_string())?;
    // Without a name of a file it stores neither name nor time.
    run(
        Command::new("gzip").args(["-9", "-n", "-c"]).stdin(Stdio::from(input)).stdout(Stdio::from(out)),
        &[0],
    )?;
    fs::remove_file(&tarred).with_context(|| tarred.display().to_string())?;
    fs::rename(&packed, &archive).with_context(|| archive.display().to_string())?;
    Ok(names.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_files_give_the_same_archive_and_come_back() {
        let root = std::env::temp_dir().join(format!("mishandle-corpus-{}", std::process::id()));
        let first = root.join("first");
        let second = root.join("second");
        let back = root.join("back");
        fs::create_dir_all(root.join(CORPUS)).unwrap();
        let files: [(&str, &[u8]); 3] = [("a", b"\0\xff"), ("b", b""), ("-c", b"text")];
        // Written in opposite orders at different times.
        for (folder, reversed) in [(&first, false), (&second, true)] {
            fs::create_dir_all(folder).unwrap();
            let order: Vec<_> = if reversed { files.iter().rev().collect() } else { files.iter().collect() };
            order.iter().for_each(|(name, bytes)| fs::write(folder.join(name), bytes).unwrap());
        }
        let old = fs::File::open(second.join("a")).unwrap();
        old.set_modified(std::time::SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(1)).unwrap();
        let packed = |folder: &Path| {
            assert_eq!(pack(&root, "plan", folder).unwrap(), 3);
            fs::read(root.join(archive("plan"))).unwrap()
        };
        assert_eq!(packed(&first), packed(&second));
        unpack(&root, "plan", &back).unwrap();
        for (name, bytes) in files {
            assert_eq!(fs::read(back.join(name)).unwrap(), bytes, "{name}");
        }
        assert_eq!(fs::read_dir(root.join(CORPUS)).unwrap().count(), 1, "temporary files are left");
        unpack(&root, "new", &root.join("none")).unwrap();
        assert!(pack(&root, "none", &root.join("none")).unwrap_err().to_string().ends_with("is empty"));
        fs::remove_dir_all(&root).unwrap();
    }
}
