//! Training when files cannot be written and signals come.

#![allow(clippy::unwrap_used)]

mod bench;
mod training;

use std::process::{Command, Output, Stdio};

use bench::{Bench, SMALL, signal, text};
use mishandle::controllers::ControllerFile;
use training::{ENDLESS, TRAIN, begin, bench, curve, lines_of, wait_until};

/// Runs the program in a shell that lets no file grow beyond `blocks` of 512 bytes, and lets the program see that as an
/// error.
fn with_small_files(bench: &Bench, blocks: u32, arguments: &str) -> Output {
    let program = env!("CARGO_BIN_EXE_mishandle");
    let limited = format!("trap '' XFSZ; ulimit -f {blocks}; exec {program} {arguments}");
    Command::new("sh").args(["-c", &limited]).current_dir(bench.path(".")).output().unwrap()
}

/// Names of all that is in the folder, but the settings.
fn left(bench: &Bench) -> Vec<String> {
    let names = std::fs::read_dir(bench.path(".")).unwrap();
    let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.filter(|name| name != "ppo.toml").collect();
    names.sort();
    names
}

#[test]
fn a_full_disk_leaves_whole_rows_and_both_controllers() {
    let bench = Bench::new();
    // Small networks and many short iterations: the curve outgrows every other file.
    bench.write(
        "ppo.toml",
        "rollout_steps = 2\nminibatch_rows = 8\nepochs = 1\nepisodes.environments = 4\npolicy.hidden = [4]\n\
         critic.hidden = [4]\nrun.validation_every = 1000\nrun.validation_episodes = 1\n",
    );
    let train = format!("{TRAIN} --steps 3200 --out a.safetensors --csv a.csv --tensorboard board");
    let output = with_small_files(&bench, 64, &train);
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{err}");
    // Each is told once as soon as it happens, and both in the end.
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
    // The rest of the curve is lost: it cannot go on in the same file, but in another.
    let resume = format!("{TRAIN} --steps 3280 --out a.safetensors --resume --csv");
    bench.refuses(
        &format!("{resume} a.csv"),
        &["a.csv: it has no row of iteration 400", "give another --csv"],
    );
    bench.check(&format!("{resume} rest.csv"), 0);
    assert_eq!(curve(&bench, "rest.csv").rows[0].iteration, 401);
}

#[test]
fn a_training_that_can_save_nothing_ends_at_once_and_leaves_nothing() {
    let bench = bench();
    let places = "--out runs/a.safetensors --csv curves/a.csv --tensorboard boards/a";
    // Without a byte for a file, and with enough for all but a checkpoint.
    for (blocks, told) in
        [(0, "cannot write the event file boards/a: "), (16, "cannot write the checkpoint ")]
    {
        let output = with_small_files(&bench, blocks, &format!("{TRAIN} {ENDLESS} {places}"));
        let err = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{err}");
        assert!(err.lines().last().unwrap().starts_with(&format!("error: {told}")), "{err}");
        assert_eq!(left(&bench), [""; 0]);
    }
}

/// Folders where files are to be written first: nothing can be written there.
fn block(bench: &Bench, files: &[&str]) {
    for file in files {
        // The training may be writing just now.
        wait_until("room", || std::fs::create_dir(bench.path(&format!("{file}.partial"))).is_ok());
    }
}

fn unblock(bench: &Bench, files: &[&str]) {
    files.iter().for_each(|file| std::fs::remove_dir(bench.path(&format!("{file}.partial"))).unwrap());
}

#[test]
fn an_interrupted_training_that_cannot_save_goes_on_from_its_last_checkpoint() {
    let bench = bench();
    bench.write("ppo.toml", &format!("{SMALL}run.checkpoint_every = 5\n"));
    let child = begin(&bench, &format!("{TRAIN} {ENDLESS} --out a.safetensors --csv a.csv"));
    wait_until("a checkpoint", || bench.path("a.safetensors.checkpoint").exists());
    let files = ["a.safetensors", "a.last.safetensors", "a.safetensors.checkpoint"];
    block(&bench, &files);
    let rows = lines_of(&bench.path("a.csv"));
    wait_until("tens of rows more", || lines_of(&bench.path("a.csv")) > rows + 50);
    signal(&child, "INT");
    let output = child.wait_with_output().unwrap();
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{err}");
    let warned = "warning: cannot write the checkpoint a.safetensors.checkpoint: Is a directory";
    assert_eq!(err.matches(warned).count(), 1, "{err}");
    for file in ["controller a.safetensors", "controller a.last.safetensors", "checkpoint a.safetensors."] {
        assert!(err.contains(&format!("error: cannot write the {file}")), "{err}");
    }
    assert!(err.contains("what was learned since the last checkpoint is lost"), "{err}");
    let again = err.lines().find_map(|line| line.strip_prefix("Carry on: mishandle ")).unwrap();
    unblock(&bench, &files);
    let done = lines_of(&bench.path("a.csv")) as u64 - 1;
    // What a killed training left half written is no harm.
    bench.write("a.safetensors.checkpoint.partial", "half");
    bench.check(&again.replace(ENDLESS, &format!("--steps {}", 256 * done)), 0);
    assert_eq!(curve(&bench, "a.csv").rows.len() as u64, done);
    assert_eq!(left(&bench), ["a.csv", files[1], files[0], files[2]]);
}

#[test]
fn controllers_that_cannot_be_written_come_with_the_next_resumption() {
    let bench = bench();
    let files = ["a.safetensors", "a.last.safetensors"];
    block(&bench, &files);
    let output = bench.run(&format!("{TRAIN} --out a.safetensors"));
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{err}");
    assert_eq!(err.matches("error: ").count(), 1, "{err}");
    assert!(err.contains("cannot write the controller a.safetensors: Is a directory"), "{err}");
    let again = err.lines().find_map(|line| line.strip_prefix("Carry on once it can be written: mishandle "));
    unblock(&bench, &files);
    assert_eq!(bench.json(&format!("{} --json", again.unwrap()), 0)["environment_steps"], 2048);
    for name in files {
        let training = ControllerFile::load(&bench.path(name)).unwrap().header.training;
        assert_eq!(training.environment_steps, 2048, "{name}");
    }
}

#[test]
fn a_training_whose_terminal_goes_is_saved_unless_it_is_to_outlive_it() {
    let bench = bench();
    let train = format!("{TRAIN} {ENDLESS} --csv");
    let child = begin(&bench, &format!("{train} a.csv --out a.safetensors"));
    wait_until("a row", || lines_of(&bench.path("a.csv")) > 1);
    // The shell and the system each send one.
    signal(&child, "HUP");
    signal(&child, "HUP");
    let output = child.wait_with_output().unwrap();
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{err}");
    assert!(err.contains("Carry on: ") && bench.path("a.last.safetensors").exists(), "{err}");
    // The first lines come at once, though nobody watches.
    let begins = "training point-reaching by ppo, seed 7, to a.safetensors: 0 of 100000000 environment steps done\n\
                  0.00M of 100M steps, ";
    assert!(err.starts_with(begins), "{err}");
    let program = env!("CARGO_BIN_EXE_mishandle");
    let outliving = format!("trap '' HUP; exec {program} {train} b.csv --out b.safetensors");
    let mut shell = Command::new("sh");
    let shell = shell.args(["-c", &outliving]).current_dir(bench.path("."));
    let mut child = shell.stderr(Stdio::null()).spawn().unwrap();
    wait_until("a row", || lines_of(&bench.path("b.csv")) > 1);
    signal(&child, "HUP");
    let rows = lines_of(&bench.path("b.csv"));
    wait_until("rows after SIGHUP", || lines_of(&bench.path("b.csv")) > rows + 20);
    signal(&child, "TERM");
    assert_eq!(child.wait().unwrap().code(), Some(130));
}

#[test]
fn all_files_of_a_training_are_kept_from_others_and_from_each_other() {
    let bench = bench();
    let child = begin(&bench, &format!("{TRAIN} {ENDLESS} --out a.safetensors --csv a.csv"));
    wait_until("a row", || lines_of(&bench.path("a.csv")) > 1);
    for (flags, told) in [
        ("--out a.last.safetensors", "another training run is writing a.last.safetensors; wait"),
        (
            "--out b.safetensors --csv a.last.safetensors",
            "another training run is writing a.last.safetensors; wait",
        ),
        ("--out b.safetensors --csv b.safetensors", "would hold both the best controller and the curve"),
        ("--out b.safetensors --csv ./b.safetensors.checkpoint --resume", "the checkpoint and the curve"),
        ("--out b.safetensors --tensorboard b.last.safetensors", "the last controller and the event files"),
    ] {
        bench.refuses(&format!("{TRAIN} {flags}"), &[told]);
    }
    signal(&child, "INT");
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(130));
    let all = ["a.csv", "a.last.safetensors", "a.safetensors", "a.safetensors.checkpoint"];
    assert_eq!(left(&bench), all);
}
