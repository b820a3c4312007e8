//! Signatures of evidence: what `ssh-keygen` signs and what this program signs is the same, with
//! each kind of key, and no file of a folder reaches `ssh-keygen` as something else.

use std::fs::{self, Permissions};
use std::os::unix::fs::{PermissionsExt, symlink};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::bench::{Bench, has_ssh_keygen, keygen, signal, text};
use crate::training::wait_until;

const SIGNATURE: &str = "ev/SHA256SUMS.sig";

/// Makes a run and its folder without a signature.
fn evidence() -> Bench {
    let bench = Bench::new();
    bench.check("falsify toy/sphere-2d --trials 2 --budget 30 --seed 2 --out toy.sqlite", 1);
    bench.check("evidence toy.sqlite --out ev", 0);
    bench
}

/// Adds a key of a kind, with its name.
fn key(bench: &Bench, kind: &str, passphrase: &str) -> String {
    keygen(bench, &["-q", "-t", kind, "-N", passphrase, "-C", kind, "-f", kind], "");
    fs::read_to_string(bench.path(&format!("{kind}.pub"))).unwrap()
}

/// Signs the folder without this program.
fn sign_by_hand(bench: &Bench, key: &str) {
    let _ = fs::remove_file(bench.path(SIGNATURE));
    keygen(bench, &["-q", "-Y", "sign", "-f", key, "-n", "mishandle-evidence", "ev/SHA256SUMS"], "");
}

#[test]
fn each_kind_of_key_signs_and_is_verified_with_and_without_this_program() {
    if !has_ssh_keygen() {
        return;
    }
    let bench = evidence();
    // Lines that nobody can read void no other, and any blanks separate the parts of a line.
    let mut signers = "# keys\ngarbage\nyou ecdsa-sha2-nistp256 AAAA\n".to_string();
    let kinds = ["ed25519", "rsa", "ecdsa"];
    for kind in kinds {
        signers += &format!("{kind}@example.org,{kind}\t{}", key(&bench, kind, "").replacen(' ', "\t", 1));
    }
    bench.write("signers", &signers);
    let names = ["ED25519", "RSA", "ECDSA"];
    for (kind, name) in kinds.into_iter().zip(names) {
        sign_by_hand(&bench, kind);
        let found = bench.json("evidence --verify ev --allowed-signers signers --json", 0);
        assert_eq!((&found["signature"], &found["signer"]["algorithm"]), (&"trusted".into(), &name.into()));
        let principals = serde_json::json!([format!("{kind}@example.org"), kind]);
        assert_eq!(found["signer"]["principals"], principals);
        let fingerprint = found["signer"]["fingerprint"].as_str().unwrap();
        assert!(keygen(&bench, &["-l", "-f", &format!("{kind}.pub")], "").contains(fingerprint));
        bench.check(&format!("evidence --verify ev --public-key {kind}.pub"), 0);
        for other in kinds.into_iter().filter(|other| *other != kind) {
            let found = bench.json(&format!("evidence --verify ev --public-key {other}.pub --json"), 1);
            assert!(found["problems"][0].as_str().unwrap().contains("by another key"), "{found}");
        }
        let out = format!("signed-{kind}");
        let signed = bench.json(&format!("evidence toy.sqlite --out {out} --key {kind} --json"), 0);
        assert_eq!(signed["signer"]["fingerprint"], fingerprint);
        let signature = format!("{out}/SHA256SUMS.sig");
        let list = format!("{out}/SHA256SUMS");
        let verify = ["-Y", "verify", "-f", "signers", "-I", kind, "-n", "mishandle-evidence", "-s"];
        keygen(&bench, &[&verify[..], &[&signature]].concat(), &list);
        bench.check(&format!("evidence --verify {out} --allowed-signers signers"), 0);
    }
}

#[test]
fn a_key_with_a_passphrase_signs_with_an_agent_and_is_an_error_without() {
    if !has_ssh_keygen() {
        return;
    }
    let bench = evidence();
    key(&bench, "ed25519", "secret");
    let arguments = "evidence toy.sqlite --out new --key ed25519";
    let mut command = bench.command(arguments);
    let output = command.env_remove("SSH_AUTH_SOCK").stdin(Stdio::null()).output().unwrap();
    let error = text(&output.stderr);
    assert!(output.status.code() == Some(2) && error.contains("`ssh-add`"), "{error}");
    assert!(error.contains("ssh-keygen -Y sign -f KEY") && !bench.path("new").exists(), "{error}");
    // The agent has the key itself; the file stays protected.
    fs::copy(bench.path("ed25519"), bench.path("open")).unwrap();
    keygen(&bench, &["-q", "-p", "-P", "secret", "-N", "", "-f", "open"], "");
    let script = "ssh-add -q open && rm open && exec \"$0\" \"$@\"";
    let mut agent = Command::new("ssh-agent");
    agent.args(["sh", "-c", script, env!("CARGO_BIN_EXE_mishandle")]).args(arguments.split(' '));
    let output = agent.current_dir(bench.path("")).output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    bench.check("evidence --verify new --public-key ed25519.pub", 0);
}

#[test]
fn keys_and_signers_that_are_something_else_are_errors_and_leave_nothing() {
    if !has_ssh_keygen() {
        return;
    }
    let bench = evidence();
    let public = key(&bench, "ed25519", "");
    bench.write("signers", &format!("me {public}"));
    bench.write("two.pub", &format!("{public}{public}"));
    bench.write("alone.pub", &public);
    bench.write("notes", "no key\n");
    sign_by_hand(&bench, "ed25519");
    for (arguments, part) in [
        ("evidence toy.sqlite --out new --key signers", "it is not a private key"),
        ("evidence toy.sqlite --out new --key toy.sqlite", "it is not a private key"),
        ("evidence toy.sqlite --out new --key alone.pub", "it is a public key"),
        ("evidence toy.sqlite --out new --key missing", "No such file"),
        ("evidence toy.sqlite --out new --key .", "it is not a private key"),
        ("evidence --verify ev --public-key ed25519", "it is a private key"),
        ("evidence --verify ev --public-key signers", "name it as the allowed signers"),
        ("evidence --verify ev --public-key two.pub", "it has several public keys"),
        ("evidence --verify ev --public-key notes", "it is not a public key"),
        ("evidence --verify ev --public-key missing", "missing"),
        ("evidence --verify ev --allowed-signers missing", "missing"),
        ("evidence --verify ev --allowed-signers ed25519.pub", "name it as the public key"),
        ("evidence --verify ev --allowed-signers ed25519", "it is a private key"),
        ("evidence --verify ev --allowed-signers /dev/zero", "/dev/zero"),
    ] {
        bench.refuses(arguments, &[part]);
        assert!(!bench.path("new").exists(), "{arguments}");
    }
    let out = bench.check("evidence --verify ev --allowed-signers notes", 1);
    assert!(out.contains("none of the allowed signers"), "{out}");
}

#[test]
fn a_signature_is_not_checked_without_ssh_keygen() {
    let bench = evidence();
    bench.write(SIGNATURE, "-----BEGIN SSH SIGNATURE-----\nU1NIU0lH\n-----END SSH SIGNATURE-----\n");
    bench.write("key.pub", "ssh-ed25519 AAAA me\n");
    bench.write("signers", "me ssh-ed25519 AAAA\n");
    let path = bench.path("empty");
    fs::create_dir(&path).unwrap();
    for trust in ["", "--public-key key.pub", "--allowed-signers signers"] {
        let mut command = bench.command(&format!("evidence --verify ev {trust} --json"));
        let output = command.env("PATH", &path).output().unwrap();
        let found: serde_json::Value = serde_json::from_str(&text(&output.stdout)).unwrap();
        assert_eq!((output.status.code(), &found["signature"]), (Some(1), &"unchecked".into()));
        assert_eq!((&found["problems"], &found["is_verified"]), (&serde_json::json!([]), &false.into()));
        let unverified = found["unverified"][0].as_str().unwrap();
        assert!(unverified.contains("not checked") && unverified.contains("openssh-client"), "{unverified}");
        // The rest is verified all the same.
        assert!(!found["runs"][0]["replayed"].as_array().unwrap().is_empty(), "{found}");
    }
    let output = bench.command("evidence --verify ev").env("PATH", &path).output().unwrap();
    assert!(text(&output.stdout).contains("signature: not checked"), "{output:?}");
    let output =
        bench.command("evidence toy.sqlite --out new --key key").env("PATH", &path).output().unwrap();
    assert!(output.status.code() == Some(2) && text(&output.stderr).contains("openssh-client"), "{output:?}");
    assert!(!bench.path("new").exists());
}

#[test]
fn an_interruption_does_not_wait_for_ssh_keygen() {
    let bench = evidence();
    bench.write(SIGNATURE, "-----BEGIN SSH SIGNATURE-----\nU1NIU0lH\n-----END SSH SIGNATURE-----\n");
    fs::create_dir(bench.path("hanging")).unwrap();
    bench.write("hanging/ssh-keygen", "#!/bin/sh\n: > \"${0%/*}/started\"\nexec sleep 60\n");
    fs::set_permissions(bench.path("hanging/ssh-keygen"), Permissions::from_mode(0o755)).unwrap();
    let path = format!("{}:{}", bench.path("hanging").display(), std::env::var("PATH").unwrap());
    let mut command = bench.command("evidence --verify ev --json");
    let child = command.env("PATH", path).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    wait_until("ssh-keygen starts", || bench.path("hanging/started").exists());
    let start = Instant::now();
    signal(&child, "INT");
    let output = child.wait_with_output().unwrap();
    // It takes 0.3 s; a busy machine may need more.
    assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
    let found = text(&output.stdout);
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{found}\n{error}");
    let found: serde_json::Value = serde_json::from_str(&found).unwrap();
    assert_eq!((&found["signature"], &found["is_complete"]), (&"unchecked".into(), &false.into()));
    assert!(error.contains("interrupted: not all was verified"), "{error}");
}

#[test]
fn a_hostile_folder_opens_no_other_file_asks_nothing_and_ends_at_once() {
    if !has_ssh_keygen() {
        return;
    }
    let bench = evidence();
    let public = key(&bench, "ed25519", "");
    bench.write("signers", &format!("me {public}"));
    sign_by_hand(&bench, "ed25519");
    let signature = bench.path(SIGNATURE);
    let good = fs::read_to_string(&signature).unwrap();
    bench.write("good", &good);
    let verify = || bench.json("evidence --verify ev --allowed-signers signers --json", 1);
    // No name of the folder is an option.
    for name in ["-P", "--", "-f\nx", " a;touch b", "%d"] {
        fs::rename(bench.path("ev"), bench.path(name)).unwrap();
        bench.check(&format!("evidence --verify './{name}' --allowed-signers signers"), 0);
        fs::rename(bench.path(name), bench.path("ev")).unwrap();
    }
    // A link is not followed, also to a signature that fits.
    fs::remove_file(&signature).unwrap();
    symlink(bench.path("good"), &signature).unwrap();
    assert_eq!(verify()["signature"], "wrong");
    // A pipe would wait for a writer, a device has no end.
    fs::remove_file(&signature).unwrap();
    assert!(Command::new("mkfifo").arg(&signature).status().unwrap().success());
    assert_eq!(verify()["signature"], "wrong");
    fs::remove_file(&signature).unwrap();
    fs::create_dir(&signature).unwrap();
    assert_eq!(verify()["signature"], "wrong");
    fs::remove_dir(&signature).unwrap();
    let end = "-----END SSH SIGNATURE-----\n";
    for text in [
        "",
        end,
        &format!("{good}{good}"),
        &format!("{good} "),
        &good.replace("-----BEGIN SSH SIGNATURE-----", "-----BEGIN OPENSSH PRIVATE KEY-----"),
        &fs::read_to_string(bench.path("ed25519")).unwrap(),
        &format!("-----BEGIN SSH SIGNATURE-----\n{}\n{end}", "A".repeat(60_000)),
        &good.replace('\n', "\u{1b}]0;title\u{7}\n"),
    ] {
        fs::write(&signature, text).unwrap();
        let found = verify();
        assert_eq!(
            (&found["signature"], &found["runs"]),
            (&"wrong".into(), &serde_json::json!([])),
            "{text}"
        );
    }
    fs::write(&signature, &good).unwrap();
    // Signers with names as options and patterns, and very many of them.
    let many = (0..100_000).map(|number| format!("n{number}")).collect::<Vec<_>>().join(",");
    for (name, code) in [("-f", 0), ("!me,you", 0), ("*", 0), ("!*", 1), (many.as_str(), 0)] {
        bench.write("signers", &format!("{name} {public}"));
        bench.check("evidence --verify ev --allowed-signers signers", code);
    }
}

/// A name of the key counts only with the options of its own line.
#[test]
fn only_names_that_may_sign_are_named() {
    if !has_ssh_keygen() {
        return;
    }
    let bench = evidence();
    let public = key(&bench, "ed25519", "").trim().to_string();
    sign_by_hand(&bench, "ed25519");
    let verify = |signers: &str, code| {
        bench.write("signers", signers);
        bench.json("evidence --verify ev --allowed-signers signers --json", code)
    };
    for names in ["release,ci", "ci,release"] {
        let found =
            verify(&format!("{names} namespaces=\"git\" {public}\nrelease {public}\nsome {public}\n"), 0);
        assert_eq!(found["signer"]["principals"], serde_json::json!(["release"]), "{names}");
    }
    let found = verify(&format!("release,ci namespaces=\"git\" {public}\n"), 1);
    assert_eq!(found["signature"], "wrong");
    assert!(found["problems"].to_string().contains("may not sign evidence"), "{found}");
}
