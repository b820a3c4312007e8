//! `mishandle evidence`: folders of runs that others verify, also with OpenSSH and coreutils alone,
//! and what a changed or hostile folder does.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::bench::{Bench, has_ssh_keygen, keygen, text};
use mishandle::store::{IfExists, RunFile, RunWriter, TrialSummary};

/// Makes an evidence folder of a toy and of a task whose controller is a file.
fn evidence() -> Bench {
    let bench = runs();
    bench.check("evidence toy.sqlite task.sqlite --out ev", 0);
    bench
}

/// Makes two keys and a signed evidence folder; `None` without `ssh-keygen`.
fn signed() -> Option<Bench> {
    if !has_ssh_keygen() {
        return None;
    }
    let bench = runs();
    for name in ["key", "other"] {
        keygen(&bench, &["-q", "-t", "ed25519", "-N", "", "-C", name, "-f", name], "");
    }
    let public = fs::read_to_string(bench.path("key.pub")).unwrap();
    bench.write("signers", &format!("# keys\nme@example.org namespaces=\"mishandle-*\" {public}"));
    bench.check("evidence toy.sqlite task.sqlite --out ev --key key", 0);
    Some(bench)
}

/// Makes the runs of a toy and of a task whose controller is a file.
fn runs() -> Bench {
    let bench = Bench::new();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../controllers/point-reaching/ppo.safetensors");
    fs::copy(root, bench.path("mine.safetensors")).unwrap();
    bench.check("falsify toy/sphere-2d --trials 2 --budget 30 --seed 2 --out toy.sqlite", 1);
    bench.check("evaluate point-reaching --controller ./mine.safetensors --episodes 4 --out task.sqlite", 0);
    bench
}

/// Returns the files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

/// Copies a folder.
fn copy(from: &Path, to: &Path) {
    for file in files(from) {
        let place = to.join(file.strip_prefix(from).unwrap());
        fs::create_dir_all(place.parent().unwrap()).unwrap();
        fs::copy(file, place).unwrap();
    }
}

#[test]
fn a_folder_is_verified_by_this_program_and_by_openssh_and_coreutils_alone() {
    let Some(bench) = signed() else { return };
    let found = bench.json("evidence --verify ev --allowed-signers signers -k evidence.replay=1 --json", 0);
    assert_eq!((&found["signature"], &found["is_verified"]), (&"trusted".into(), &true.into()));
    assert_eq!(found["signer"]["principals"][0], "me@example.org");
    for run in found["runs"].as_array().unwrap() {
        assert_eq!(run["replayed"].as_array().unwrap().len() as u64, run["chosen"].as_u64().unwrap());
        assert!(run["chosen"].as_u64() >= run["simulations"].as_u64());
    }
    let signature = ["-n", "mishandle-evidence", "-s", "ev/SHA256SUMS.sig"];
    let verify = ["-Y", "verify", "-f", "signers", "-I", "me@example.org"];
    keygen(&bench, &[&verify[..], &signature].concat(), "ev/SHA256SUMS");
    let mut sums = Command::new("sha256sum");
    sums.args(["--check", "--strict", "SHA256SUMS"]).current_dir(bench.path("ev"));
    let sums = sums.output().unwrap();
    assert!(sums.status.success(), "{}", text(&sums.stdout));
    // No path of this machine is in a text of the folder.
    let home = bench.path("").to_string_lossy().into_owned();
    for file in files(&bench.path("ev")).iter().filter(|path| path.extension().is_none_or(|e| e != "sqlite"))
    {
        let bytes = fs::read(file).unwrap();
        assert!(!String::from_utf8_lossy(&bytes).contains(home.trim_end_matches('/')), "{}", file.display());
    }
    // The verification writes nothing, and the same runs give the same bytes.
    bench.check("evidence toy.sqlite task.sqlite --out again --key key", 0);
    let [first, second] = ["ev", "again"].map(|name| files(&bench.path(name)));
    assert_eq!(first.len(), second.len());
    for file in &first {
        let same = bench.path("again").join(file.strip_prefix(bench.path("ev")).unwrap());
        assert_eq!(fs::read(file).unwrap(), fs::read(same).unwrap(), "{}", file.display());
    }
    // The folder needs neither the controller's old place nor the present folder.
    fs::remove_file(bench.path("mine.safetensors")).unwrap();
    fs::rename(bench.path("ev"), bench.path("moved")).unwrap();
    bench.check("evidence --verify moved --public-key key.pub -k evidence.replay=1", 0);
}

#[test]
fn one_changed_byte_of_any_file_is_found() {
    let Some(bench) = signed() else { return };
    for file in files(&bench.path("ev")) {
        let bytes = fs::read(&file).unwrap();
        for at in [0, bytes.len() / 2, bytes.len() - 1] {
            let mut changed = bytes.clone();
            changed[at] ^= 1;
            fs::write(&file, &changed).unwrap();
            let out = bench.check("evidence --verify ev --allowed-signers signers -k evidence.replay=0", 1);
            assert!(out.contains("NOT VERIFIED"), "{} {at}: {out}", file.display());
        }
        fs::write(&file, bytes).unwrap();
    }
    bench.check("evidence --verify ev --allowed-signers signers -k evidence.replay=0", 0);
}

#[test]
fn a_forger_with_another_key_or_without_one_is_found() {
    let Some(bench) = signed() else { return };
    // All hashes fit, but the key is another one.
    bench.check("evidence toy.sqlite --out forged --key other", 0);
    for trust in ["--allowed-signers signers", "--public-key key.pub"] {
        let found = bench.json(&format!("evidence --verify forged {trust} --json"), 1);
        assert_eq!((&found["signature"], found["runs"].as_array().unwrap().len()), (&"wrong".into(), 0));
    }
    assert_eq!(bench.json("evidence --verify forged --json", 0)["signature"], "valid");
    // A signature of the same key for another purpose.
    keygen(&bench, &["-q", "-Y", "sign", "-f", "key", "-n", "git", "forged/SHA256SUMS"], "");
    let moved = bench.path("forged/SHA256SUMS.sig");
    bench.check("evidence --verify forged --public-key key.pub", 1);
    // The signature that OpenSSH makes is that of this program.
    fs::remove_file(&moved).unwrap();
    assert_eq!(bench.json("evidence --verify forged --json", 0)["signature"], "missing");
    bench.check("evidence --verify forged --public-key key.pub", 1);
    keygen(&bench, &["-q", "-Y", "sign", "-f", "key", "-n", "mishandle-evidence", "forged/SHA256SUMS"], "");
    bench.check("evidence --verify forged --public-key key.pub", 0);
    // The option of the line allows other namespaces only.
    let public = fs::read_to_string(bench.path("key.pub")).unwrap();
    for options in ["namespaces=\"git\"", "valid-before=\"20200101\"", "cert-authority"] {
        bench.write("narrow", &format!("me {options} {public}"));
        bench.check("evidence --verify forged --allowed-signers narrow", 1);
    }
}

#[test]
fn a_forged_result_with_right_hashes_is_found_by_its_replay() {
    let bench = evidence();
    // All hashes of the run file fit, but the failures pass.
    let run = RunFile::open(bench.path("toy.sqlite")).unwrap();
    let mut forged = RunWriter::create(bench.path("forged.sqlite"), run.header(), IfExists::Refuse).unwrap();
    for TrialSummary { trial, .. } in run.trials().unwrap() {
        forged.start_trial(trial.number, trial.seed).unwrap();
        forged.end_trial(trial.number, trial.status).unwrap();
    }
    for simulation in run.simulations() {
        let found = simulation.unwrap();
        let mut simulation = run.simulation(found.trial, found.number).unwrap();
        simulation.robustness = Some(1.0);
        forged.record(&[simulation]).unwrap();
    }
    forged.close().unwrap();
    bench.check("evidence forged.sqlite --out forged", 0);
    let found = bench.json("evidence --verify forged -k evidence.replay=0.01 --seed 1 --json", 1);
    assert_eq!(found["problems"].as_array().unwrap().len(), 0);
    assert!(!found["runs"][0]["replayed"][0]["differences"].as_array().unwrap().is_empty(), "{found}");
}

#[test]
fn hostile_folders_open_nothing_outside_and_end_at_once() {
    let bench = evidence();
    bench.write("secret", "secret");
    let fresh = |name: &str| {
        let folder = bench.path(name);
        copy(&bench.path("ev"), &folder);
        folder
    };
    let links = fresh("links");
    fs::remove_file(links.join("README.md")).unwrap();
    symlink(bench.path("secret"), links.join("README.md")).unwrap();
    symlink("/", links.join("root")).unwrap();
    let out = bench.check("evidence --verify links", 1);
    assert!(out.contains("README.md: it is a link") && out.contains("root: it is a link"), "{out}");
    let extra = fresh("extra");
    fs::write(extra.join("runs/c.sqlite-wal"), "").unwrap();
    assert!(bench.check("evidence --verify extra", 1).contains("runs/c.sqlite-wal: the file is not listed"));
    fs::remove_file(extra.join("runs/c.sqlite-wal")).unwrap();
    fs::remove_file(extra.join("pages/toy.html")).unwrap();
    assert!(bench.check("evidence --verify extra", 1).contains("pages/toy.html: the file is missing"));
    let fifo = fresh("fifo");
    assert!(Command::new("mkfifo").arg(fifo.join("pipe")).status().unwrap().success());
    bench.check("evidence --verify fifo", 1);
    for (name, line) in [("outside", "../secret"), ("absolute", "/etc/passwd"), ("twice", "README.md")] {
        let folder = fresh(name);
        let list = fs::read_to_string(folder.join("SHA256SUMS")).unwrap();
        fs::write(folder.join("SHA256SUMS"), format!("{list}{}  {line}\n", "0".repeat(64))).unwrap();
        assert!(bench.check(&format!("evidence --verify {name}"), 1).contains("of SHA256SUMS"));
    }
    for (name, file) in
        [("sums", "SHA256SUMS"), ("signature", "SHA256SUMS.sig"), ("manifest", "manifest.json")]
    {
        let path = fresh(name).join(file);
        fs::File::create(path).unwrap().set_len(1 << 40).unwrap();
        if file != "manifest.json" {
            bench.check(&format!("evidence --verify {name}"), 1);
        }
    }
}

#[test]
fn a_program_of_a_folder_is_never_started() {
    let bench = Bench::new();
    let client = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../clients/python");
    for file in ["mishandle_simulator.py", "tank.py"] {
        fs::copy(client.join(file), bench.path(file)).unwrap();
    }
    let mut falsify = bench.command("falsify --budget 3 --trials 1 --out p.sqlite");
    let output = falsify.args(["--command", "python3 tank.py"]).output().unwrap();
    assert!(bench.path("p.sqlite").exists(), "{}", text(&output.stderr));
    bench.check("evidence p.sqlite --out ev", 0);
    let mut verify = bench.command("evidence --verify ev -k evidence.replay=1 --json");
    let output = verify.env("MISHANDLE_ALLOW_PROGRAMS", "1").output().unwrap();
    let found = text(&output.stdout);
    // Nothing differs, but nothing was replayed.
    assert!(output.status.code() == Some(1) && found.contains("no program is started"), "{found}");
    let found: serde_json::Value = serde_json::from_str(&found).unwrap();
    assert_eq!((found["problems"].as_array().unwrap().len(), &found["is_verified"]), (0, &false.into()));
    // The manifest has the reason that the verification states, which replays nothing.
    assert!(
        bench.check("evidence --verify ev -k evidence.replay=0", 0).contains("No simulation was replayed")
    );
}

/// A simulator that leaves a trace of its start.
const STARTED: &str = r#"
import json, sys
open("started", "a").write("started\n")
AXES = [{"name": name, "low": 0, "high": 1, "nominal": 0.5, "kind": kind}
        for name, kind in (("x", "start"), ("k", "model"))]
HELLO = {"protocol": 1, "name": "s", "control_dt": 1.0, "steps": 1, "axes": AXES, "seeded": SEEDED,
         "signals": [{"name": "m"}], "formulas": [{"name": "success", "text": "always(m >= 0)"}]}
for line in sys.stdin:
    q = json.loads(line)
    answer = HELLO if q["type"] == "hello" else {"trace": {"m": [1.0, 0.9 - q["scenario"]["x"]]}}
    print(json.dumps({"id": q["id"], **answer}), flush=True)
"#;

/// The page of any question depends on the run alone, whatever may be started.
#[test]
fn pages_need_no_program_and_evidence_verifies_without_one() {
    for seeded in ["False", "True"] {
        let bench = Bench::new();
        bench.write("s.py", &STARTED.replace("SEEDED", seeded));
        let relation = "[metamorphic]\npairs = 5\n[metamorphic.relations.r]\nchange = { k = '+0.1' }\n";
        bench.write("m.toml", &format!("target = \"process:python3 s.py\"\n{relation}"));
        let allowed = |arguments: &str| {
            let mut command = bench.command(arguments);
            let output = command.env("MISHANDLE_ALLOW_PROGRAMS", "1").output().unwrap();
            (output.status.code(), text(&output.stdout), text(&output.stderr))
        };
        for (name, question) in [
            ("evaluate", "evaluate --command 'python3 s.py' --episodes 20"),
            ("falsify", "falsify --command 'python3 s.py' --trials 1 --budget 20"),
            ("margin", "margin --command 'python3 s.py' --budget 60"),
            ("risk", "risk --command 'python3 s.py' --simulations 300"),
            ("metamorphic", "run m.toml"),
        ] {
            let (_, _, err) = allowed(&format!("{question} --out {name}.sqlite"));
            assert!(bench.path(&format!("{name}.sqlite")).exists(), "{name}: {err}");
            // The program is there when one page is made, and allowed.
            let (code, _, err) = allowed(&format!("evidence {name}.sqlite --out here-{name}"));
            assert_eq!(code, Some(0), "{name}: {err}");
            fs::remove_file(bench.path("started")).unwrap();
            bench.check(&format!("evidence {name}.sqlite --out {name}"), 0);
            let page = |folder: &str| fs::read(bench.path(&format!("{folder}/pages/{name}.html"))).unwrap();
            assert!(page(name) == page(&format!("here-{name}")), "{name}");
            assert!(!text(&page(name)).contains("answer is missing"), "{name}");
            let (_, out, err) = allowed(&format!("evidence --verify {name} -k evidence.replay=0 --json"));
            let found: serde_json::Value = serde_json::from_str(&out).expect(&err);
            assert_eq!(found["problems"].as_array().map(Vec::len), Some(0), "{name}: {out}");
            let report = format!("report {name}.sqlite -k report.simulations=false --out {name}.html");
            assert_eq!(allowed(&report).0, Some(0), "{name}");
            assert_eq!(allowed(&format!("compare {name}.sqlite {name}.sqlite --exact")).0, Some(0), "{name}");
            assert!(!bench.path("started").exists(), "{name} starts the program");
            // The next question starts it.
            bench.write("started", "");
        }
    }
}

#[test]
fn mistakes_are_errors_and_leave_nothing() {
    let bench = evidence();
    for (arguments, part) in [
        ("evidence toy.sqlite --out ev", "exists already"),
        ("evidence missing.sqlite --out new", "missing.sqlite"),
        ("evidence mine.safetensors --out new", "mine.safetensors"),
        ("evidence --verify missing", "not a folder of evidence"),
        ("evidence --verify ev --public-key missing", "missing"),
        ("evidence --verify ev --allowed-signers mine.safetensors", "UTF-8"),
        ("evidence --verify ev -k evidence.replay=2", "0 to 1"),
    ] {
        let output = bench.run(arguments);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments}\n{error}");
        assert!(error.contains(part), "{arguments}\n{error}");
        assert!(!bench.path("new").exists(), "{arguments}");
    }
    // Only a folder of evidence is replaced.
    fs::create_dir(bench.path("mine")).unwrap();
    bench.write("mine/thesis.tex", "years");
    assert_eq!(bench.run("evidence toy.sqlite --out mine --force").status.code(), Some(2));
    assert!(bench.path("mine/thesis.tex").exists());
    bench.check("evidence toy.sqlite --out ev --force", 0);
    assert!(!bench.path("ev/runs/task.sqlite").exists());
    bench.check("evidence --verify ev", 0);
    // Nothing of temporary folders is left.
    let names = fs::read_dir(bench.path("")).unwrap().map(|entry| entry.unwrap().file_name());
    assert!(names.into_iter().all(|name| !name.to_string_lossy().contains(".part")));
}
