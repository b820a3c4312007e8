use std::fs;
use std::io::{Error, ErrorKind, Result};
use std::path::Path;

/// Checks that a path names something other than a symbolic link. A link in an untrusted folder
/// may lead to any file of the user.
///
/// # Errors
/// `InvalidInput` for a symbolic link, or the error of the system if there is nothing.
pub fn refuse_link(path: &Path) -> Result<()> {
    if path.symlink_metadata()?.is_symlink() { Err(refused("")) } else { Ok(()) }
}

fn refused(name: &str) -> Error {
    let message = format!("{name}it is a symbolic link; put a copy in its place");
    Error::new(ErrorKind::InvalidInput, message)
}

/// Checks that a folder and the folders in it contain no symbolic links. The folder itself may be
/// one, because the user names it.
///
/// # Errors
/// `InvalidInput`, with the name of the first link, or an error of the system.
pub fn refuse_links_in(folder: &Path) -> Result<()> {
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(&next)? {
            let entry = entry?;
            // Of the entry: a temporary file of another process may be gone by now.
            let path = entry.path();
            let kind = entry.file_type()?;
            if kind.is_symlink() {
                let name = path.strip_prefix(folder).unwrap_or(&path);
                return Err(refused(&format!("{}: ", name.display())));
            }
            if kind.is_dir() {
                folders.push(path);
            }
        }
    }
    Ok(())
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn a_link_is_refused_at_any_depth_but_not_as_the_name_of_the_folder() {
        let home = tempfile::tempdir().unwrap();
        let path = |name: &str| home.path().join(name);
        fs::create_dir_all(path("a/b/c")).unwrap();
        fs::write(path("a/b/c/file"), "").unwrap();
        symlink(path("a"), path("link")).unwrap();
        refuse_links_in(&path("link")).unwrap();
        refuse_link(&path("a/b/c/file")).unwrap();
        for (target, link) in [("a/b/c/file", "a/x"), ("a", "a/b/loop"), ("missing", "a/b/c/dangling")] {
            symlink(path(target), path(link)).unwrap();
            assert!(refuse_link(&path(link)).is_err(), "{link}");
            let error = refuse_links_in(&path("a")).unwrap_err();
            let name = link.strip_prefix("a/").unwrap();
            let expected = format!("{name}: it is a symbolic link; put a copy in its place");
            assert_eq!((error.kind(), error.to_string()), (ErrorKind::InvalidInput, expected));
            fs::remove_file(path(link)).unwrap();
        }
        assert_eq!(refuse_link(&path("missing")).unwrap_err().kind(), ErrorKind::NotFound);
        assert_eq!(refuse_links_in(&path("missing")).unwrap_err().kind(), ErrorKind::NotFound);
    }
}
