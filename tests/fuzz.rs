//! The laws of the fuzz targets for the corpus in the archives of `fuzz/corpus` and for random
//! changes of it. Nothing is instrumented here, so that this costs seconds; `cargo xtask fuzz`
//! searches for inputs that reach new code.
#![allow(clippy::unwrap_used)] // clippy does not count helper functions as tests

#[path = "../fuzz/src/bytes.rs"]
mod bytes;
#[path = "../fuzz/src/checkpoint.rs"]
mod checkpoint;
#[path = "../fuzz/src/controller.rs"]
mod controller;
#[path = "../fuzz/src/counterexample.rs"]
mod counterexample;
#[path = "../fuzz/src/csv.rs"]
mod csv;
#[path = "../fuzz/src/curve.rs"]
mod curve;
#[path = "../fuzz/src/formula.rs"]
mod formula;
#[path = "../fuzz/src/mjcf.rs"]
mod mjcf;
#[path = "../fuzz/src/monitor.rs"]
mod monitor;
#[path = "../fuzz/src/onnx.rs"]
mod onnx;
#[path = "../fuzz/src/plan.rs"]
mod plan;
#[path = "../fuzz/src/run.rs"]
mod run;
#[path = "../fuzz/src/run_file.rs"]
mod run_file;
#[path = "../fuzz/src/scratch.rs"]
mod scratch;
#[path = "../fuzz/src/settings.rs"]
mod settings;
#[path = "../fuzz/src/torch.rs"]
mod torch;
#[path = "../fuzz/src/trace_blob.rs"]
mod trace_blob;

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use mishandle::random::Sequence;

/// Duration of the random changes of each target.
const DURATION: Duration = Duration::from_secs(2);

/// Longest time of one input.
const LIMIT: Duration = Duration::from_secs(1);

/// Writes the input to a file if its law is broken.
struct Input<'a> {
    target: &'a str,
    bytes: &'a [u8],
}

impl Drop for Input<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/fuzz/crashes").join(self.target);
            let path = folder.join("test");
            let written = std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&path, self.bytes));
            eprintln!("the input that breaks the law ({written:?}): {}", path.display());
        }
    }
}

/// Checks one input and its time. On a busy machine, any input can take a second once.
fn check_input(target: &str, check: fn(&[u8]), bytes: &[u8]) {
    let input = Input { target, bytes };
    let takes = || {
        let started = Instant::now();
        check(input.bytes);
        started.elapsed()
    };
    assert!((0..3).any(|_| takes() < LIMIT), "an input of {target} takes longer than {LIMIT:?}");
}

fn check_target(target: &str, check: fn(&[u8]), seeds: fn() -> Vec<Vec<u8>>) {
    let archive = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fuzz/corpus/{target}.tar.gz"));
    let folder = tempfile::tempdir().unwrap();
    let unpacked = Command::new("tar").arg("-xzf").arg(&archive).arg("-C").arg(folder.path()).status();
    assert!(unpacked.expect("the program `tar`").success(), "{}", archive.display());
    let mut files: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|file| file.unwrap().path()).collect();
    files.sort();
    assert!(!files.is_empty());
    let corpus = files.iter().map(|path| std::fs::read(path).unwrap());
    let pool: Vec<Vec<u8>> = seeds().into_iter().chain(corpus).collect();
    pool.iter().for_each(|bytes| check_input(target, check, bytes));

    let mut random = Sequence::new(1, 0);
    let started = Instant::now();
    while started.elapsed() < DURATION {
        let input = changed(&pool, &mut random);
        check_input(target, check, &input);
    }
}

/// Returns an input of the pool with up to four changes.
fn changed(pool: &[Vec<u8>], random: &mut Sequence) -> Vec<u8> {
    let mut input = pool[below(random, pool.len())].clone();
    for _ in 0..1 + below(random, 4) {
        let at = below(random, input.len() + 1);
        let to = at + below(random, input.len() - at + 1).min(16);
        match below(random, 6) {
            0 => input.insert(at, random.bits() as u8),
            1 => drop(input.drain(at..to)),
            2 => input.extend_from_within(at..to),
            3 => {
                let other = &pool[below(random, pool.len())];
                input.truncate(at);
                input.extend(&other[below(random, other.len() + 1)..]);
            }
            4 if at < input.len() => input[at] ^= 1 << below(random, 8),
            _ if at < input.len() => input[at] = random.bits() as u8,
            _ => {}
        }
    }
    input
}

fn below(random: &mut Sequence, n: usize) -> usize {
    random.below(n as u64) as usize
}

#[test]
fn checkpoints() {
    check_target("checkpoint", checkpoint::check, checkpoint::seeds);
}

#[test]
fn controllers() {
    check_target("controller", controller::check, controller::seeds);
}

#[test]
fn counterexamples() {
    check_target("counterexample", counterexample::check, counterexample::seeds);
}

#[test]
fn csv_logs() {
    check_target("csv", csv::check, csv::seeds);
}

#[test]
fn learning_curves() {
    check_target("curve", curve::check, curve::seeds);
}

#[test]
fn formulas() {
    check_target("formula", formula::check, formula::seeds);
}

#[test]
fn models_of_robots() {
    check_target("mjcf", mjcf::check, mjcf::seeds);
}

#[test]
fn monitors() {
    check_target("monitor", monitor::check, monitor::seeds);
}

#[test]
fn onnx_models() {
    check_target("onnx", onnx::check, onnx::seeds);
}

#[test]
fn plans() {
    check_target("plan", plan::check, plan::seeds);
}

#[test]
fn run_files() {
    check_target("run_file", run_file::check, run_file::seeds);
}

#[test]
fn training_settings() {
    check_target("settings", settings::check, settings::seeds);
}

#[test]
fn torch_checkpoints() {
    check_target("torch", torch::check, torch::seeds);
}

#[test]
fn trace_blobs() {
    check_target("trace_blob", trace_blob::check, trace_blob::seeds);
}
