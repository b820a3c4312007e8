//! Signatures in the format of `ssh-keygen -Y`: OpenSSH's PROTOCOL.sshsig.

use std::path::Path;

use mishandle::files::read_text_bounded;
use mishandle::results::EvidenceSigner;
use ssh_key::encoding::pem::PemLabel;
use ssh_key::encoding::{Decode, DecodePem, Reader};
use ssh_key::public::KeyData;
use ssh_key::{Algorithm, HashAlg, LineEnding, PrivateKey, PublicKey, SshSig};

use crate::error::EvidenceError;
use crate::layout::SUMS;
use crate::signers::Signers;

/// Purpose of the signatures. A signature for another purpose, such as a Git commit, does not
/// count.
pub const NAMESPACE: &str = "mishandle-evidence";

/// Status of a signature that does not count.
pub(crate) const WRONG: &str = "wrong";

/// Status of a signature that only `ssh-keygen` can check.
const UNSUPPORTED: &str = "unsupported";

/// Largest size of a key or a signature, in bytes.
pub(crate) const MAX_SIZE: u64 = 1 << 16;

/// A private key.
#[derive(Debug)]
pub struct Key(PrivateKey);

impl Key {
    /// Reads an Ed25519 key of `ssh-keygen` without a passphrase.
    ///
    /// # Errors
    /// If the file is something else. The message says how `ssh-keygen` signs with another key.
    pub fn read(path: &Path) -> Result<Key, EvidenceError> {
        let text = read_text_bounded(path, MAX_SIZE).map_err(EvidenceError::file(path))?;
        let problem = |problem: String| EvidenceError::Key { path: path.to_path_buf(), problem };
        if text.parse::<PublicKey>().is_ok() {
            return Err(problem("it is a public key; name the private key, without .pub".to_string()));
        }
        let key = PrivateKey::from_openssh(&text).map_err(|error| {
            problem(format!("it is not a private key of OpenSSH ({error}); ssh-keygen -t ed25519 makes one"))
        })?;
        let advice = format!(
            "write the folder without a key, then sign it with: ssh-keygen -Y sign -f KEY -n {NAMESPACE} DIR/{SUMS}"
        );
        if key.is_encrypted() {
            return Err(problem(format!(
                "it is protected by a passphrase, which this program does not ask for; {advice}"
            )));
        }
        match key.algorithm() {
            Algorithm::Ed25519 => Ok(Key(key)),
            other => Err(problem(format!(
                "it is a key of {other}, and this program signs with ssh-ed25519; {advice}"
            ))),
        }
    }

    /// Signs bytes. The same key and bytes give the same signature.
    ///
    /// # Errors
    /// If the library refuses the key.
    pub(crate) fn sign(&self, bytes: &[u8]) -> Result<String, ssh_key::Error> {
        self.0.sign(NAMESPACE, HashAlg::Sha512, bytes)?.to_pem(LineEnding::LF)
    }

    /// Returns what a reader sees of the key.
    pub(crate) fn signer(&self) -> EvidenceSigner {
        signer(self.0.public_key().key_data(), Vec::new())
    }
}

/// Finding about a signature.
#[derive(Debug)]
pub(crate) struct Checked {
    /// `trusted`, `valid`, `missing`, `wrong` or `unsupported`.
    pub status: &'static str,
    pub signer: Option<EvidenceSigner>,
    pub problem: Option<String>,
}

/// Checks the text of a signature of `bytes`; `None` if the folder has none.
pub(crate) fn check(bytes: &[u8], pem: Option<&str>, signers: &Signers) -> Checked {
    let checked = |status, signer, problem: Option<String>| Checked { status, signer, problem };
    let Some(pem) = pem else {
        let problem = signers.is_some().then(|| "the folder is not signed".to_string());
        return checked("missing", None, problem);
    };
    let found = match SshSig::from_pem(pem) {
        Ok(found) => found,
        // The library reads no key of ECDSA.
        Err(error) => {
            return match SignedBy::decode_pem(pem) {
                Ok(SignedBy(algorithm)) => checked(UNSUPPORTED, None, Some(unsupported(&algorithm))),
                Err(_) => checked(WRONG, None, Some(format!("the signature cannot be read: {error}"))),
            };
        }
    };
    let (key, allowed) = (found.public_key(), signers.of(found.public_key()));
    let principals = allowed.as_ref().cloned().unwrap_or_default();
    let named = Some(signer(key, principals));
    if found.namespace() != NAMESPACE {
        let problem = format!("the signature is for {:?}, not for {NAMESPACE:?}", found.namespace());
        return checked(WRONG, named, Some(problem));
    }
    if !matches!(key, KeyData::Ed25519(_) | KeyData::SkEd25519(_)) {
        return checked(UNSUPPORTED, named, Some(unsupported(key.algorithm().as_str())));
    }
    if PublicKey::from(key.clone()).verify(NAMESPACE, bytes, &found).is_err() {
        return checked(WRONG, named, Some(format!("the signature does not fit {SUMS}")));
    }
    match (signers, allowed) {
        (Signers::Unknown, _) => checked("valid", named, None),
        (_, Ok(_)) => checked("trusted", named, None),
        (_, Err(problem)) => checked(WRONG, named, Some(problem)),
    }
}

fn unsupported(algorithm: &str) -> String {
    format!(
        "this program cannot check a signature of {algorithm}; check it with ssh-keygen -Y verify, as README.md says"
    )
}

/// Name of the key's algorithm in a signature whose key the library does not know. It must be one
/// that the library knows by name: other bytes are not a signature.
struct SignedBy(String);

impl PemLabel for SignedBy {
    const PEM_LABEL: &'static str = "SSH SIGNATURE";
}

impl Decode for SignedBy {
    type Error = ssh_key::Error;

    /// Reads the blob of PROTOCOL.sshsig up to the name in its public key.
    fn decode(reader: &mut impl Reader) -> Result<SignedBy, ssh_key::Error> {
        let mut magic = [0; 6];
        reader.read(&mut magic)?;
        let (version, _) = (u32::decode(reader)?, u32::decode(reader)?);
        let name = String::decode(reader)?;
        let is_known = name.contains("ecdsa") && Algorithm::new(&name).is_ok();
        if &magic != b"SSHSIG" || version != 1 || !is_known {
            return Err(ssh_key::Error::FormatEncoding);
        }
        while reader.remaining_len() > 0 {
            u8::decode(reader)?;
        }
        Ok(SignedBy(name))
    }
}

fn signer(key: &KeyData, principals: Vec<String>) -> EvidenceSigner {
    EvidenceSigner {
        algorithm: key.algorithm().to_string(),
        fingerprint: key.fingerprint(HashAlg::Sha256).to_string(),
        principals,
    }
}
