//! Signatures in the format of OpenSSH's PROTOCOL.sshsig. `ssh-keygen -Y` makes and checks them.
//!
//! `ssh-keygen` is started without a shell and in the root folder, with fixed options, absolute
//! paths and a time limit. The list of hashes is its standard input, so what it checks is what this
//! program has read.

use std::io::ErrorKind;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf, absolute};
use std::time::Duration;

use mishandle::files::{limits, read_text_bounded};
use mishandle::results::EvidenceSigner;
use mishandle_simulators::process::{Failure, Output, Peer, Program};

use crate::error::EvidenceError;
use crate::layout::{SIGNATURE, SUMS};
use crate::sums::Watch;

/// Purpose of the signatures. A signature for another purpose, such as a Git commit, does not
/// count.
pub const NAMESPACE: &str = "mishandle-evidence";

/// Status of a signature that does not count.
pub(crate) const WRONG: &str = "wrong";

/// Status of a folder without a signature.
pub(crate) const MISSING: &str = "missing";

/// Exit code of `ssh-keygen -Y` for a signature or a signer that it refuses. A mistake in its
/// arguments is 1.
const REFUSED: i32 = 255;

/// Most names of a key that are checked.
const MAX_NAMES: usize = 16;

/// Status of a signature that `ssh-keygen` could not check.
pub(crate) const UNCHECKED: &str = "unchecked";

/// Largest size of a public key or a signature, in bytes.
pub(crate) const MAX_SIZE: u64 = 1 << 16;

/// Last line of a signature. `ssh-keygen` reads nothing after it.
const END: &str = "-----END SSH SIGNATURE-----\n";

/// Problem of a file that is not a public key.
const NO_PUBLIC_KEY: &str = "it is not a public key of OpenSSH; expected a file such as id_ed25519.pub";

/// Time limit of `ssh-keygen`: a person may have to confirm in an agent.
const LIMIT: Duration = Duration::from_secs(60);

/// A key that signs.
#[derive(Debug)]
pub struct Key(PathBuf);

impl Key {
    /// Checks that `ssh-keygen` signs with a key, by a signature that is not kept.
    ///
    /// # Errors
    /// If it does not sign. The message says what to do about a passphrase.
    pub fn new(path: &Path) -> Result<Key, EvidenceError> {
        let key = Key(path.to_path_buf());
        key.sign(b"", &mut || ControlFlow::Continue(()))?;
        Ok(key)
    }

    /// Signs bytes.
    pub(crate) fn sign(&self, bytes: &[u8], watch: Watch<'_>) -> Result<String, EvidenceError> {
        // With this passphrase, `ssh-keygen` does not ask for another one. An agent needs none.
        let path = text(&self.0)?;
        let output = keygen(&["-P", "", "-Y", "sign", "-n", NAMESPACE, "-f", &path], bytes, watch)?;
        match output.code {
            Some(0) => Ok(output.stdout),
            _ => Err(self.refusal(&said(&output))),
        }
    }

    /// Returns the error of a key that `ssh-keygen` does not sign with.
    fn refusal(&self, said: &str) -> EvidenceError {
        let found = match read_text_bounded(&self.0, MAX_SIZE) {
            Ok(text) => KeyFile::of(&text),
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::PermissionDenied) => {
                return EvidenceError::file(&self.0)(error);
            }
            Err(_) => KeyFile::Other,
        };
        self.problem(match found {
            KeyFile::Private => format!(
                "ssh-keygen does not sign with it: {said}; a key with a passphrase signs after `ssh-add`, and any key afterwards: \
                 write the folder without a key, then use ssh-keygen -Y sign -f KEY -n {NAMESPACE} DIR/{SUMS}"
            ),
            KeyFile::Public(_) => format!(
                "it is a public key, and ssh-keygen does not sign with it: {said}; name the private key, or add it to an agent \
                 with `ssh-add`"
            ),
            // `ssh-keygen` looks for other files then, and names them.
            KeyFile::Signers | KeyFile::Other => {
                "it is not a private key; expected a file such as ~/.ssh/id_ed25519, which `ssh-keygen -t ed25519` makes"
                    .to_string()
            }
        })
    }

    /// Returns what a reader sees of the key that signed bytes.
    pub(crate) fn signer(
        &self,
        bytes: &[u8],
        signature: &Path,
        watch: Watch<'_>,
    ) -> Result<EvidenceSigner, EvidenceError> {
        signer(bytes, &text(signature)?, watch)?.map_err(|problem| self.problem(problem))
    }

    fn problem(&self, problem: String) -> EvidenceError {
        EvidenceError::Key { path: self.0.clone(), problem }
    }
}

/// The keys whose signatures count.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Signers {
    /// Nobody said which. A signature then says that one key signed all, but not whose it is.
    #[default]
    Unknown,
    /// The key in a file of `ssh-keygen` that ends in .pub.
    Key(PathBuf),
    /// The keys with names in a file of allowed signers, section ALLOWED SIGNERS of ssh-keygen(1).
    Allowed(PathBuf),
}

impl Signers {
    /// Reads the file, if any, and checks what it is.
    fn read(&self) -> Result<Option<String>, EvidenceError> {
        let (path, limit) = match self {
            Signers::Unknown => return Ok(None),
            Signers::Key(path) => (path, MAX_SIZE),
            Signers::Allowed(path) => (path, limits::RESULT),
        };
        let text = read_text_bounded(path, limit).map_err(EvidenceError::file(path))?;
        let problem = match (self, KeyFile::of(&text)) {
            (Signers::Key(_), KeyFile::Public(1)) => return Ok(Some(text)),
            (Signers::Key(_), KeyFile::Public(_)) => {
                "it has several public keys; expected one, such as id_ed25519.pub; a file of allowed signers has a line \
                 `NAME KEY` for each of several keys"
            }
            (Signers::Key(_), KeyFile::Private) => {
                "it is a private key; expected its public key, such as id_ed25519.pub"
            }
            (Signers::Key(_), KeyFile::Signers) => {
                "it is a file of allowed signers, not a public key such as id_ed25519.pub; name it as the allowed signers"
            }
            (Signers::Key(_), KeyFile::Other) => NO_PUBLIC_KEY,
            (_, KeyFile::Public(_)) => {
                "it is a public key, not a file with a line `NAME KEY` for each allowed signer; name it as the public key"
            }
            (_, KeyFile::Private) => {
                "it is a private key; expected a file with a line `NAME KEY` for each allowed signer"
            }
            // `ssh-keygen` finds no signer in it, also if it is empty.
            (_, KeyFile::Signers | KeyFile::Other) => return Ok(Some(text)),
        };
        Err(EvidenceError::Key { path: path.clone(), problem: problem.to_string() })
    }
}

/// Kind of a file that should have keys.
#[derive(Debug, PartialEq, Eq)]
enum KeyFile {
    /// A private key.
    Private,
    /// This many public keys, one a line.
    Public(usize),
    /// Public keys with names before them.
    Signers,
    /// No key.
    Other,
}

impl KeyFile {
    /// Returns what a text has.
    fn of(text: &str) -> KeyFile {
        if text.contains("PRIVATE KEY-----") {
            return KeyFile::Private;
        }
        // `TYPE KEY COMMENT` is a public key. `NAMES OPTIONS TYPE KEY COMMENT` allows a signer.
        let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
        let place = |line: &str| line.split_whitespace().position(|word| word.starts_with("AAAA"));
        let places: Vec<Option<usize>> = lines.map(place).collect();
        match places.iter().filter(|place| **place == Some(1)).count() {
            count @ 1.. if count == places.len() => KeyFile::Public(count),
            _ if places.iter().any(|place| place.is_some_and(|place| place > 1)) => KeyFile::Signers,
            _ => KeyFile::Other,
        }
    }
}

/// Finding about a signature.
#[derive(Debug)]
pub(crate) struct Checked {
    /// `trusted`, `valid`, `missing`, `wrong` or `unchecked`.
    pub status: &'static str,
    pub signer: Option<EvidenceSigner>,
    /// Why it does not count, or was not checked.
    pub problem: Option<String>,
}

/// Checks the signature of `bytes`, a file and its text; `None` if the folder has none.
///
/// # Errors
/// If a file of `signers` cannot be read or is something else, or `watch` stops it.
pub(crate) fn check(
    bytes: &[u8],
    signature: Option<(&Path, &str)>,
    signers: &Signers,
    watch: Watch<'_>,
) -> Result<Checked, EvidenceError> {
    match find(bytes, signature, signers, watch) {
        Err(EvidenceError::Keygen { problem }) => {
            let problem = Some(format!("the signature is not checked: {problem}"));
            Ok(Checked { status: UNCHECKED, signer: None, problem })
        }
        found => found,
    }
}

fn find(
    bytes: &[u8],
    signature: Option<(&Path, &str)>,
    signers: &Signers,
    watch: Watch<'_>,
) -> Result<Checked, EvidenceError> {
    // A wrong file is a mistake of the caller, whatever the folder has.
    let trusted = signers.read()?;
    let Some((signature, pem)) = signature else {
        let problem = trusted.map(|_| "the folder is not signed".to_string());
        return Ok(Checked { status: MISSING, signer: None, problem });
    };
    let wrong = |signer, problem| Ok(Checked { status: WRONG, signer, problem: Some(problem) });
    if pem.split_once(END).is_none_or(|(_, rest)| !rest.is_empty()) {
        return wrong(None, format!("{SIGNATURE} does not end as a signature does"));
    }
    let signature = text(signature)?;
    let mut signer = match signer(bytes, &signature, watch)? {
        Ok(signer) => signer,
        Err(problem) => return wrong(None, problem),
    };
    let mut status = "trusted";
    match signers {
        Signers::Unknown => status = "valid",
        Signers::Key(path) => {
            if fingerprint(path, &trusted.unwrap_or_default(), watch)? != signer.fingerprint {
                return wrong(Some(signer), "the signature is by another key".to_string());
            }
        }
        Signers::Allowed(path) => {
            let allowed = text(path)?;
            let found = keygen(&["-Y", "find-principals", "-f", &allowed, "-s", &signature], b"", watch)?;
            if !matches!(found.code, Some(0 | REFUSED)) {
                return Err(no_result(&found));
            }
            // A name that begins with `!` excludes. Each name has options and limits of its own.
            let names = found.stdout.lines().filter(|name| !name.starts_with('!')).take(MAX_NAMES);
            let mut verified = Vec::new();
            let mut refusal = None;
            for name in names {
                let verify = ["-Y", "verify", "-f", &allowed, "-I", name, "-n", NAMESPACE, "-s", &signature];
                let output = keygen(&verify, bytes, watch)?;
                match output.code {
                    Some(0) => verified.push(name.to_string()),
                    Some(REFUSED) => refusal = refusal.or(Some(said(&output))),
                    _ => return Err(no_result(&output)),
                }
            }
            signer.principals = verified;
            if signer.principals.is_empty() {
                let problem = match refusal {
                    Some(refusal) => {
                        format!("the key of the signature may not sign evidence: {refusal}")
                    }
                    None => {
                        format!("the key of the signature is none of the allowed signers: {}", said(&found))
                    }
                };
                return wrong(Some(signer), problem);
            }
        }
    }
    Ok(Checked { status, signer: Some(signer), problem: None })
}

/// Returns the key of a signature that fits, or why it does not fit.
fn signer(
    bytes: &[u8],
    signature: &str,
    watch: Watch<'_>,
) -> Result<Result<EvidenceSigner, String>, EvidenceError> {
    let output = keygen(&["-Y", "check-novalidate", "-n", NAMESPACE, "-s", signature], bytes, watch)?;
    // Good "mishandle-evidence" signature with ED25519 key SHA256:...
    let key =
        output.stdout.trim().rsplit_once(" signature with ").and_then(|(_, key)| key.split_once(" key "));
    match (output.code, key) {
        (Some(0), Some((algorithm, fingerprint))) => Ok(Ok(EvidenceSigner {
            algorithm: algorithm.to_string(),
            fingerprint: fingerprint.to_string(),
            principals: Vec::new(),
        })),
        (Some(REFUSED), _) => Ok(Err(format!("the signature of {SUMS} is wrong: {}", said(&output)))),
        _ => Err(no_result(&output)),
    }
}

/// Returns the fingerprint of a public key, the text of a file.
fn fingerprint(path: &Path, text: &str, watch: Watch<'_>) -> Result<String, EvidenceError> {
    let output = keygen(&["-l", "-E", "sha256", "-f", "-"], text.as_bytes(), watch)?;
    match output.stdout.split_whitespace().nth(1) {
        Some(fingerprint) if output.code == Some(0) => Ok(fingerprint.to_string()),
        _ => Err(EvidenceError::Key { path: path.to_path_buf(), problem: NO_PUBLIC_KEY.to_string() }),
    }
}

/// Runs `ssh-keygen` with standard input.
///
/// # Errors
/// [`Keygen`](EvidenceError::Keygen) if it gives no result, and
/// [`Interrupted`](EvidenceError::Interrupted) if `watch` stops it.
fn keygen(arguments: &[&str], input: &[u8], watch: Watch<'_>) -> Result<Output, EvidenceError> {
    let words = std::iter::once("ssh-keygen").chain(arguments.iter().copied()).map(str::to_string).collect();
    let program = Program { words, folder: "/".into() };
    let output = Peer::start(&program).and_then(|peer| peer.finish(input, LIMIT, watch));
    output.map_err(|failure| match failure {
        Failure::Interrupted => EvidenceError::Interrupted,
        Failure::Start { source, .. } if source.kind() == ErrorKind::NotFound => EvidenceError::Keygen {
            problem:
                "the program `ssh-keygen` is not on PATH (on Debian and Ubuntu: apt install openssh-client)"
                    .to_string(),
        },
        failure => EvidenceError::Keygen { problem: format!("ssh-keygen: {failure}") },
    })
}

/// The error of a program that neither accepts nor refuses: it crashed, or is too old for `-Y`.
fn no_result(output: &Output) -> EvidenceError {
    let code = output.code.map_or("a signal".to_string(), |code| format!("exit code {code}"));
    EvidenceError::Keygen { problem: format!("ssh-keygen ended with {code}: {}", said(output)) }
}

/// Returns a path as an argument: it begins with `/`, so it is neither an option nor `-`.
fn text(path: &Path) -> Result<String, EvidenceError> {
    let path = absolute(path).map_err(EvidenceError::file(path))?;
    path.into_os_string().into_string().map_err(|path| EvidenceError::Keygen {
        problem: format!("ssh-keygen gets no path that is not UTF-8: {}", path.display()),
    })
}

/// Returns the standard error of `ssh-keygen` on one line, without the frames of its warnings.
fn said(output: &Output) -> String {
    let lines =
        output.stderr.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('@'));
    lines.collect::<Vec<_>>().join("; ")
}
