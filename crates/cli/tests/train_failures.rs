//! `mishandle train` with full disks, unwritable files and signals.

use std::process::{Child, Command, Output, Stdio};

use crate::bench::{Bench, SMALL, signal, text};
use crate::training::{ENDLESS, TRAIN, bench, count_lines, curve, start, wait_until};
use mishandle::controllers::ControllerFile;

/// Runs the program in a shell that limits files to `blocks` blocks of 512 bytes; larger writes are
/// errors.
fn with_small_files(bench: &Bench, blocks: u32, arguments: &str) -> Output {
    let program = env!("CARGO_BIN_EXE_mishandle");
    let limited = format!("ulimit -f {blocks}; exec '{program}' {arguments}");
    Command::new("sh").args(["-c", &limited]).current_dir(bench.path(".")).output().unwrap()
}

/// Returns the names of all files in the folder, without the settings.
fn files_in(bench: &Bench) -> Vec<String> {
    let names = std::fs::read_dir(bench.path(".")).unwrap();
    let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.filter(|name| name != "ppo.toml").collect();
    names.sort();
    names
}

#[test]
fn a_full_disk_leaves_complete_rows_and_both_controllers() {
    let bench = Bench::new();
    // Small networks and many short iterations, so that the curve becomes the largest file.
    bench.write(
        "ppo.toml",
        "rollout_steps = 2\nminibatch_size = 8\nepochs = 1\nepisodes.environments = 4\npolicy.hidden = [4]\n\
         critic.hidden = [4]\nrun.validation_interval = 1000\nrun.validation_episodes = 1\n",
    );
    let train = format!("{TRAIN} --steps 3200 --out a.safetensors --csv a.csv --tensorboard board");
    let output = with_small_files(&bench, 64, &train);
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{err}");
    // Each failure causes one warning, and both are reported at the end.
    for file in ["the curve a.csv: File too large", "the event file board/events"] {
        assert_eq!(err.matches(&format!("warning: cannot write {file}")).count(), 1, "{err}");
        assert_eq!(err.matches(&format!("cannot write {file}")).count(), 2, "{err}");
    }
    assert!(err.lines().last().unwrap().starts_with("error: cannot write the curve a.csv: "), "{err}");
    for name in ["a.safetensors", "a.last.safetensors"] {
        let training = ControllerFile::load(&bench.path(name)).unwrap().header.training;
        assert_eq!(training.environment_steps, 3200, "{name}");
    }
    let rows = curve(&bench, "a.csv").rows.len();
    assert!((50..400).contains(&rows), "{rows} rows are there");
    // The missing rows are lost, so the run can continue only with another curve file.
    let resume = format!("{TRAIN} --steps 3280 --out a.safetensors --resume --csv");
    bench.refuses(
        &format!("{resume} a.csv"),
        &["a.csv: it has no row for iteration 400", "choose another --csv"],
    );
    bench.check(&format!("{resume} rest.csv"), 0);
    assert_eq!(curve(&bench, "rest.csv").rows[0].iteration, 401);
}

#[test]
fn a_training_that_cannot_write_its_first_checkpoint_ends_and_leaves_no_files() {
    let bench = bench();
    let outputs = "--out runs/a.safetensors --csv curves/a.csv --tensorboard boards/a";
    // No space at all, and enough space for everything except a checkpoint.
    for (blocks, expected) in
        [(0, "cannot write the event file boards/a: "), (16, "cannot write the checkpoint ")]
    {
        let output = with_small_files(&bench, blocks, &format!("{TRAIN} {ENDLESS} {outputs}"));
        let err = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{err}");
        assert!(err.lines().last().unwrap().starts_with(&format!("error: {expected}")), "{err}");
        assert_eq!(files_in(&bench), [""; 0]);
    }
}

/// Starts the program with SIGXFSZ ignored, so that a write beyond a later file size limit is an
/// error.
fn start_limitable(bench: &Bench, arguments: &str) -> Child {
    let command = format!("trap '' XFSZ; exec '{}' {arguments}", env!("CARGO_BIN_EXE_mishandle"));
    let mut shell = Command::new("sh");
    shell.args(["-c", &command]).current_dir(bench.path(".")).stdout(Stdio::piped()).stderr(Stdio::piped());
    shell.spawn().unwrap()
}

/// Limits the size of files that a running process writes.
fn limit_file_size(child: &Child, bytes: u32) {
    let limit = [format!("--pid={}", child.id()), format!("--fsize={bytes}")];
    assert!(Command::new("prlimit").args(limit).status().unwrap().success());
}

#[test]
fn an_interrupted_training_that_cannot_write_resumes_from_its_last_checkpoint() {
    let bench = bench();
    bench.write("ppo.toml", &format!("{SMALL}run.checkpoint_interval = 5\n"));
    let child = start_limitable(&bench, &format!("{TRAIN} {ENDLESS} --out a.safetensors --csv a.csv"));
    wait_until("a checkpoint", || bench.path("a.safetensors.checkpoint").exists());
    // Enough space for the curve, but not for a controller or a checkpoint.
    limit_file_size(&child, 16 << 10);
    let rows = count_lines(&bench.path("a.csv"));
    wait_until("20 more rows", || count_lines(&bench.path("a.csv")) > rows + 20);
    signal(&child, "INT");
    let output = child.wait_with_output().unwrap();
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{err}");
    let warned = "warning: cannot write the checkpoint a.safetensors.checkpoint: File too large";
    assert_eq!(err.matches(warned).count(), 1, "{err}");
    for file in ["controller a.safetensors", "controller a.last.safetensors", "checkpoint a.safetensors."] {
        assert!(err.contains(&format!("error: cannot write the {file}")), "{err}");
    }
    assert!(err.contains("the steps since the last checkpoint are lost"), "{err}");
    let resume = err.lines().find_map(|line| line.strip_prefix("Resume with: mishandle ")).unwrap();
    let done = count_lines(&bench.path("a.csv")) as u64 - 1;
    bench.check(&resume.replace(ENDLESS, &format!("--steps {}", 256 * done)), 0);
    assert_eq!(curve(&bench, "a.csv").rows.len() as u64, done);
    let files = ["a.csv", "a.last.safetensors", "a.safetensors", "a.safetensors.checkpoint"];
    assert_eq!(files_in(&bench), files);
}

#[test]
fn resuming_writes_controllers_that_could_not_be_written() {
    let bench = bench();
    let files = ["a.safetensors", "a.last.safetensors"];
    let child = start(&bench, &format!("{TRAIN} --steps 51200 --out a.safetensors"));
    wait_until("a checkpoint", || bench.path("a.safetensors.checkpoint").exists());
    // A folder with the name of a file keeps the file from being written.
    files.iter().for_each(|file| std::fs::create_dir(bench.path(file)).unwrap());
    let output = child.wait_with_output().unwrap();
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{err}");
    assert_eq!(err.matches("error: ").count(), 1, "{err}");
    assert!(
        err.contains("cannot write the controller a.safetensors: expected a regular file, found a directory"),
        "{err}"
    );
    let resume = err
        .lines()
        .find_map(|line| line.trim_start().strip_prefix("Resume once the file can be written: mishandle "));
    files.iter().for_each(|file| std::fs::remove_dir(bench.path(file)).unwrap());
    assert_eq!(bench.json(&format!("{} --json", resume.unwrap()), 0)["environment_steps"], 51200);
    // The best controller by validation may be older than the last one.
    let steps =
        files.map(|name| ControllerFile::load(&bench.path(name)).unwrap().header.training.environment_steps);
    assert!(steps[0] <= 51200 && steps[1] == 51200, "{steps:?}");
}

#[test]
fn sighup_saves_a_training_unless_it_is_ignored() {
    let bench = bench();
    let train = format!("{TRAIN} {ENDLESS} --csv");
    let child = start(&bench, &format!("{train} a.csv --out a.safetensors"));
    wait_until("a row", || count_lines(&bench.path("a.csv")) > 1);
    // Shell and system both send SIGHUP.
    signal(&child, "HUP");
    signal(&child, "HUP");
    let output = child.wait_with_output().unwrap();
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{err}");
    assert!(err.contains("Resume with: ") && bench.path("a.last.safetensors").exists(), "{err}");
    // The first log lines appear immediately.
    let first_lines = "training point-reaching by ppo, seed 7, to a.safetensors: 0 of 100000000 environment steps done\n\
                  0.00M of 100M steps, ";
    assert!(err.starts_with(first_lines), "{err}");
    let program = env!("CARGO_BIN_EXE_mishandle");
    let ignoring = format!("trap '' HUP; exec '{program}' {train} b.csv --out b.safetensors");
    let mut shell = Command::new("sh");
    let shell = shell.args(["-c", &ignoring]).current_dir(bench.path("."));
    let mut child = shell.stderr(Stdio::null()).spawn().unwrap();
    wait_until("a row", || count_lines(&bench.path("b.csv")) > 1);
    signal(&child, "HUP");
    let rows = count_lines(&bench.path("b.csv"));
    wait_until("rows after SIGHUP", || count_lines(&bench.path("b.csv")) > rows + 20);
    signal(&child, "TERM");
    assert_eq!(child.wait().unwrap().code(), Some(130));
}

#[test]
fn output_files_are_locked_and_must_be_distinct() {
    let bench = bench();
    let child = start(&bench, &format!("{TRAIN} {ENDLESS} --out a.safetensors --csv a.csv"));
    wait_until("a row", || count_lines(&bench.path("a.csv")) > 1);
    for (flags, expected) in [
        ("--out a.last.safetensors", "another training run is writing a.last.safetensors; wait"),
        (
            "--out b.safetensors --csv a.last.safetensors",
            "another training run is writing a.last.safetensors; wait",
        ),
        ("--out b.safetensors --csv b.safetensors", "is the path of both the best controller and the curve"),
        ("--out b.safetensors --csv ./b.safetensors.checkpoint --resume", "the checkpoint and the curve"),
        ("--out b.safetensors --tensorboard b.last.safetensors", "the last controller and the event files"),
    ] {
        bench.refuses(&format!("{TRAIN} {flags}"), &[expected]);
    }
    signal(&child, "INT");
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(130));
    let all = ["a.csv", "a.last.safetensors", "a.safetensors", "a.safetensors.checkpoint"];
    assert_eq!(files_in(&bench), all);
}
