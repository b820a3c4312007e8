//! Keys that may sign: a public key, or a file of allowed signers, section ALLOWED SIGNERS of
//! ssh-keygen(1).

use std::path::Path;

use mishandle::files::{limits, read_text_bounded};
use ssh_key::PublicKey;
use ssh_key::public::KeyData;

use crate::error::EvidenceError;
use crate::signature::{MAX_SIZE, NAMESPACE};

/// The keys whose signatures count.
#[derive(Clone, Debug, Default)]
pub enum Signers {
    /// Nobody said which. A signature then says that one key signed all, but not whose it is.
    #[default]
    Unknown,
    /// One key.
    Key(Box<PublicKey>),
    /// Keys with names.
    Allowed(AllowedSigners),
}

/// A file of allowed signers.
#[derive(Clone, Debug)]
pub struct AllowedSigners {
    signers: Vec<AllowedSigner>,
    /// Numbers of the lines whose keys this program cannot read, such as those of ECDSA.
    unread: Vec<usize>,
}

/// A line of a file of allowed signers.
#[derive(Clone, Debug)]
pub struct AllowedSigner {
    principals: String,
    key: PublicKey,
    /// Why the line does not allow a signature of evidence.
    refusal: Option<String>,
}

impl Signers {
    /// Reads a public key of `ssh-keygen`, a file ending in .pub.
    ///
    /// # Errors
    /// If the file is something else.
    pub fn public_key(path: &Path) -> Result<Signers, EvidenceError> {
        let text = read_text_bounded(path, MAX_SIZE).map_err(EvidenceError::file(path))?;
        match text.trim().parse() {
            Ok(key) => Ok(Signers::Key(Box::new(key))),
            Err(_) if text.trim().starts_with("ecdsa-") || text.trim().starts_with("sk-ecdsa-") => {
                let problem =
                    "this program cannot check signatures of ECDSA; use ssh-keygen -Y verify".to_string();
                Err(EvidenceError::Key { path: path.to_path_buf(), problem })
            }
            Err(error) => {
                let problem = format!("it is not a public key of OpenSSH ({error}), such as id_ed25519.pub");
                Err(EvidenceError::Key { path: path.to_path_buf(), problem })
            }
        }
    }

    /// Reads a file of allowed signers. Lines with keys that this program cannot read allow nobody,
    /// as for `ssh-keygen`.
    ///
    /// # Errors
    /// If the file cannot be read, or it has lines and none of them is readable.
    pub fn allowed(path: &Path) -> Result<Signers, EvidenceError> {
        let text = read_text_bounded(path, limits::RESULT).map_err(EvidenceError::file(path))?;
        let is_entry = |line: &&str| !line.is_empty() && !line.starts_with('#');
        let (mut signers, mut unread) = (Vec::new(), Vec::new());
        for (index, line) in text.lines().map(str::trim).enumerate().filter(|(_, line)| is_entry(line)) {
            match entry(line) {
                Some(signer) => signers.push(signer),
                None => unread.push(index + 1),
            }
        }
        match unread.first() {
            Some(first) if signers.is_empty() => {
                let problem = format!(
                    "line {first} is not that of an allowed signer with a key that this program checks: NAMES [OPTIONS] KEY"
                );
                Err(EvidenceError::Key { path: path.to_path_buf(), problem })
            }
            _ => Ok(Signers::Allowed(AllowedSigners { signers, unread })),
        }
    }

    /// Returns whether keys are given.
    pub(crate) fn is_some(&self) -> bool {
        !matches!(self, Signers::Unknown)
    }

    /// Returns the names of a key.
    ///
    /// # Errors
    /// Why the key may not sign.
    pub(crate) fn of(&self, key: &KeyData) -> Result<Vec<String>, String> {
        match self {
            Signers::Unknown => Ok(Vec::new()),
            Signers::Key(known) if known.key_data() == key => Ok(Vec::new()),
            Signers::Key(_) => Err("the signature is that of another key".to_string()),
            Signers::Allowed(known) => {
                let of_key: Vec<_> =
                    known.signers.iter().filter(|known| known.key.key_data() == key).collect();
                let allowed: Vec<String> = of_key
                    .iter()
                    .filter(|known| known.refusal.is_none())
                    .map(|known| known.principals.clone())
                    .collect();
                let refusal = of_key.iter().find_map(|known| known.refusal.clone());
                match allowed.is_empty() {
                    false => Ok(allowed),
                    true => Err(refusal.unwrap_or_else(|| known.stranger())),
                }
            }
        }
    }
}

impl AllowedSigners {
    /// Says that a key is none of them.
    fn stranger(&self) -> String {
        let text = "the key of the signature is none of the allowed signers".to_string();
        match self.unread.as_slice() {
            [] => text,
            [line] => format!("{text}; line {line} has a key that this program cannot read"),
            lines => {
                let lines: Vec<String> = lines.iter().map(usize::to_string).collect();
                format!("{text}; lines {} have keys that this program cannot read", lines.join(", "))
            }
        }
    }
}

/// Parses a line.
fn entry(line: &str) -> Option<AllowedSigner> {
    let (principals, rest) = word(line)?;
    let signer =
        |key: PublicKey, refusal| AllowedSigner { principals: principals.replace('"', ""), key, refusal };
    if let Some(key) = key(rest) {
        return Some(signer(key, None));
    }
    let (options, rest) = word(rest)?;
    Some(signer(key(rest)?, refusal(options)))
}

/// Parses a key, whose parts any blanks separate.
fn key(text: &str) -> Option<PublicKey> {
    text.split_whitespace().collect::<Vec<_>>().join(" ").parse().ok()
}

/// Splits off the first word. A space in quotes does not end it.
fn word(text: &str) -> Option<(&str, &str)> {
    let mut is_quoted = false;
    let end = text.find(|c: char| {
        is_quoted ^= c == '"';
        c.is_whitespace() && !is_quoted
    })?;
    Some((&text[..end], text[end..].trim_start()))
}

/// Returns why a line with these options does not allow a signature of evidence. Options that this
/// program does not know allow nothing.
fn refusal(options: &str) -> Option<String> {
    let mut is_quoted = false;
    let options = options.split(|c: char| {
        is_quoted ^= c == '"';
        c == ',' && !is_quoted
    });
    options.into_iter().find_map(|option| {
        let (name, value) = option.split_once('=').unwrap_or((option, ""));
        match name.to_ascii_lowercase().as_str() {
            "namespaces" if is_in(value.trim_matches('"'), NAMESPACE) => None,
            "namespaces" => Some(format!("the key is allowed for {value} only, not for {NAMESPACE}")),
            _ => Some(format!(
                "the line of the key has the option {name:?}, which this program does not check; check the signature with \
                 ssh-keygen -Y verify"
            )),
        }
    })
}

/// Returns whether a list of patterns, as ssh_config(5) has them, contains a text.
fn is_in(patterns: &str, text: &str) -> bool {
    let is_match = |pattern: &str| matches(pattern.as_bytes(), text.as_bytes());
    let excluded = patterns.split(',').filter_map(|pattern| pattern.strip_prefix('!'));
    !excluded.into_iter().any(is_match) && patterns.split(',').any(is_match)
}

/// Matches a pattern with `*` and `?`. The last star takes one more character after each mismatch,
/// which is enough.
fn matches(pattern: &[u8], text: &[u8]) -> bool {
    let (mut p, mut t, mut star) = (0, 0, None);
    while t < text.len() {
        match pattern.get(p) {
            Some(b'*') => {
                star = Some((p, t));
                p += 1;
            }
            Some(&c) if c == b'?' || c == text[t] => (p, t) = (p + 1, t + 1),
            _ => {
                let Some((at, from)) = star else { return false };
                star = Some((at, from + 1));
                (p, t) = (at + 1, from + 1);
            }
        }
    }
    pattern[p..].iter().all(|c| *c == b'*')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_those_of_ssh_config() {
        for (patterns, expected) in
            [("mishandle-evidence", true), ("git,mishandle-*", true), ("*", true), ("m?shandle*e", true)]
                .into_iter()
                .chain([
                    ("git", false),
                    ("*,!mishandle-*", false),
                    ("mishandle", false),
                    ("", false),
                    ("*x*", false),
                ])
        {
            assert_eq!(is_in(patterns, NAMESPACE), expected, "{patterns}");
        }
    }

    const KEY: &str = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAILM+rvN+ot98qgEN796jTiQfZfG1KaT0PtFDJ/XFSqti";

    #[test]
    fn any_blanks_separate_the_parts_of_a_line() {
        for line in [format!("me {KEY} comment"), format!("me\t{}", KEY.replace(' ', "\t"))] {
            assert!(entry(&line).is_some_and(|entry| entry.refusal.is_none()), "{line}");
        }
        let narrow = format!("me\tnamespaces=\"git\"\t{KEY}");
        assert!(entry(&narrow).is_some_and(|entry| entry.refusal.is_some()));
        assert!(entry(KEY).is_none() && entry("me garbage").is_none());
    }

    #[test]
    fn a_line_that_cannot_be_read_does_not_void_the_others() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("signers");
        let read = |text: &str| {
            std::fs::write(&path, text).expect("a file");
            Signers::allowed(&path)
        };
        let known = key(KEY).expect("a key");
        let unread = "you ecdsa-sha2-nistp256 AAAAE2VjZHNhLXNoYTItbmlzdHAyNTY=\ngarbage\n";
        let signers = read(&format!("{unread}me {KEY}\n")).expect("signers");
        assert_eq!(signers.of(known.key_data()), Ok(vec!["me".to_string()]));
        assert!(read(unread).is_err());
        assert!(read("# nobody\n").is_ok());
    }

    #[test]
    fn options_that_are_not_checked_allow_nothing() {
        assert_eq!(refusal("namespaces=\"git,mishandle-evidence\""), None);
        for options in ["namespaces=\"git\"", "cert-authority", "valid-before=\"20200101\"", "unknown", ""] {
            assert!(refusal(options).is_some(), "{options}");
        }
    }
}
