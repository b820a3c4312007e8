//! Pictures and films, from outside. Where there is no OpenGL, what is checked is that the program says so.

#![cfg(feature = "render")]
#![allow(clippy::unwrap_used)]

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// What stands in for the encoder: it keeps what it is sent.
const KEEPS: &str = "#!/bin/sh\n[ \"$1\" = -version ] && exit\nfor last; do :; done\ncat > \"$last\"\n";
/// It says through a file that it has begun, and takes its time over each picture of 32 x 24 pixels.
const SLOW: &str = "#!/bin/sh
[ \"$1\" = -version ] && exit
touch begun
while head -c 2304 > picture; do sleep 0.05; done
";
const FAILS: &str = "#!/bin/sh\necho 'no encoder' >&2\nexit 3\n";

struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Bench {
        Bench { folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mishandle"));
        command.args(arguments.split_whitespace()).current_dir(self.folder.path());
        command
    }

    /// Runs the program, which has to end well.
    #[track_caller]
    fn check(&self, arguments: &str) {
        let output = self.command(arguments).output().unwrap();
        assert!(output.status.success(), "{arguments}: {}", said(&output));
    }

    /// Runs the program, which has to refuse with these words and leave nothing behind. Returns all that it said.
    #[track_caller]
    fn refuses(&self, command: &mut Command, parts: &[&str]) -> String {
        let before = self.files();
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{command:?}: {}", said(&output));
        for part in parts {
            assert!(said(&output).contains(part), "{command:?} does not say `{part}`: {}", said(&output));
        }
        assert_eq!(self.files(), before, "{command:?} left something");
        said(&output)
    }

    fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> =
            std::fs::read_dir(self.folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        files
    }

    /// Whether pictures can be drawn on this machine; where they cannot, the program names what it takes.
    fn can_draw(&self) -> bool {
        let output = self.command("render point-reaching --size 16x16 --out probe.png").output().unwrap();
        assert!(output.status.success() || said(&output).contains("libegl1"), "{}", said(&output));
        output.status.success()
    }

    /// A folder with nothing but an `ffmpeg` that does what `script` says.
    fn encoder(&self, name: &str, script: &str) -> PathBuf {
        let folder = self.path(name);
        std::fs::create_dir(&folder).unwrap();
        let program = folder.join("ffmpeg");
        std::fs::write(&program, script).unwrap();
        std::fs::set_permissions(&program, PermissionsExt::from_mode(0o755)).unwrap();
        folder
    }
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Width and height in a PNG's header.
fn size(path: &Path) -> (u32, u32) {
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(&bytes[..8], b"\x89PNG\r\n\x1a\n");
    let number = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
    (number(16), number(20))
}

#[test]
fn a_start_is_drawn_and_written_over_only_by_force() {
    let bench = Bench::new();
    if !bench.can_draw() {
        return;
    }
    bench.check("render point-reaching --at 0.4,-0.3,0.5 --size 160x120 --out left.png");
    bench.check("render point-reaching --at 0.4,0.3,0.5 --size 160x120 --out right.png");
    assert_eq!(size(&bench.path("left.png")), (160, 120));
    let bytes = |name: &str| std::fs::read(bench.path(name)).unwrap();
    assert_ne!(bytes("left.png"), bytes("right.png"), "the target is elsewhere");
    bench.refuses(
        &mut bench.command("render point-reaching --out left.png"),
        &["left.png exists already", "--force"],
    );
    bench.check("render point-reaching --at 0.4,0.3,0.5 --size 160x120 --out left.png --force");
    assert_eq!(bytes("left.png"), bytes("right.png"));
}

#[test]
fn without_a_driver_the_packages_are_named() {
    let bench = Bench::new();
    let without_driver = |mut command: Command| {
        command.env("__EGL_VENDOR_LIBRARY_DIRS", "/nonexistent").env("LIBGL_DRIVERS_PATH", "/nonexistent");
        command
    };
    let mut command = without_driver(bench.command("render point-reaching --out start.png"));
    let packages = ["error: cannot render without a display", "apt install libegl1 libgl1-mesa-dri"];
    bench.refuses(&mut command, &packages);
    // Of a run, before it is run again.
    bench.check("evaluate point-reaching --controller expert --episodes 1 --out run.sqlite");
    let mut command = without_driver(bench.command("render --run run.sqlite --out strip.png"));
    let said = bench.refuses(&mut command, &packages);
    assert!(!said.contains("control steps"), "it simulated for nothing: {said}");
}

#[test]
fn an_episode_becomes_a_film_or_a_filmstrip() {
    let bench = Bench::new();
    bench.check("evaluate point-reaching --controller expert --episodes 2 --out run.sqlite");
    if !bench.can_draw() {
        return;
    }
    bench.check("render --run run.sqlite --simulation 2 --size 32x24 --out strip.png");
    assert_eq!(size(&bench.path("strip.png")), (3 * 32, 2 * 24));

    let film = || bench.command("render --run run.sqlite --simulation 2 --size 32x24 --out film.mp4");
    let nothing = bench.path("nothing");
    let said_without = bench.refuses(film().env("PATH", &nothing), &["`ffmpeg`", "apt install ffmpeg"]);
    assert!(!said_without.contains("control steps"), "it simulated for nothing: {said_without}");
    let fails = bench.encoder("fails", FAILS);
    bench.refuses(film().env("PATH", format!("{}:/usr/bin:/bin", fails.display())), &["no encoder"]);
    let keeps = bench.encoder("keeps", KEEPS);
    let output = film().env("PATH", format!("{}:/usr/bin:/bin", keeps.display())).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    // Samples 0, 2, 4 ... 300: 151 pictures of three bytes a pixel.
    assert_eq!(std::fs::metadata(bench.path("film.mp4")).unwrap().len(), 151 * 32 * 24 * 3);
}

#[test]
fn an_interrupted_film_leaves_nothing() {
    let bench = Bench::new();
    bench.check("evaluate point-reaching --controller expert --episodes 1 --out run.sqlite");
    if !bench.can_draw() {
        return;
    }
    let slow = bench.encoder("slow", SLOW);
    let mut command = bench.command("render --run run.sqlite --size 32x24 --out film.mp4");
    command.env("PATH", format!("{}:/usr/bin:/bin", slow.display())).stderr(Stdio::piped());
    let child = command.spawn().unwrap();
    let start = Instant::now();
    while !bench.path("begun").exists() {
        assert!(start.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(5));
    }
    Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", said(&output));
    assert!(said(&output).ends_with("interrupted; nothing was written\n"), "{}", said(&output));
    let expected = ["begun", "picture", "probe.png", "run.sqlite", "slow"].map(|name| bench.path(name));
    assert_eq!(bench.files(), expected);
}

#[test]
fn what_cannot_be_drawn_is_said() {
    let bench = Bench::new();
    for (arguments, parts) in [
        ("point-reching --out a.png", ["no task `point-reching`", "did you mean `point-reaching`?"]),
        ("point-reaching --out a.jpg", ["a.jpg", ".png"]),
        ("point-reaching --out a.mp4", ["one picture", "--run"]),
        ("point-reaching --out no/a.png", ["cannot write no/a.png", "there is no folder no\n"]),
        ("point-reaching --at 0.5,0 --out a.png", ["2 values", "target_z"]),
        (
            "point-reaching --at -0.5,0,0.5 --out a.png",
            ["target_x is -0.5 m, outside the initial box", "from 0.3 to 0.7 m"],
        ),
        ("--out a.png", ["give a TASK, or --run RUN", "error"]),
        ("point-reaching --at 0.5,0,nan --out a.png", ["target_z", "NaN"]),
        ("point-reaching --size 33x20 --out a.png", ["33x20", "even"]),
        ("point-reaching --size 5000x20 --out a.png", ["5000x20", "4096"]),
        ("--run missing.sqlite --out a.png", ["missing.sqlite", "error"]),
    ] {
        bench.refuses(&mut bench.command(&format!("render {arguments}")), &parts);
    }
}
