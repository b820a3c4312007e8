//! End-to-end tests of pictures and videos. Without OpenGL, they only check the error message.

#![cfg(feature = "render")]

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::bench::signal;

/// A fake encoder that stores 180 frames of 32 x 24 pixels as the data of an MP4 file. Their box
/// has 414,728 bytes.
const STORES: &str = "#!/bin/sh
[ \"$1\" = -version ] && exit
for last; do :; done
{ printf '\\0\\0\\0\\010ftyp\\0\\0\\0\\010moov\\0\\006\\124\\010mdat'; cat; } > \"$last\"
";
/// A slow fake encoder for frames of 32 x 24 pixels. It creates the file `started` when it starts.
const SLOW: &str = "#!/bin/sh
[ \"$1\" = -version ] && exit
touch started
while head -c 2304 > frame; do sleep 0.05; done
";
/// A fake encoder that fails.
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

    /// Runs the program, which must succeed.
    #[track_caller]
    fn check(&self, arguments: &str) {
        let output = self.command(arguments).output().unwrap();
        assert!(output.status.success(), "{arguments}: {}", stderr(&output));
    }

    /// Runs the program, which must fail with a message that contains `parts`, and create no file.
    /// Returns the message.
    #[track_caller]
    fn refuses(&self, command: &mut Command, parts: &[&str]) -> String {
        let before = self.files();
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{command:?}: {}", stderr(&output));
        for part in parts {
            assert!(
                stderr(&output).contains(part),
                "{command:?} does not print `{part}`: {}",
                stderr(&output)
            );
        }
        assert_eq!(self.files(), before, "{command:?} created a file");
        stderr(&output)
    }

    fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> =
            std::fs::read_dir(self.folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        files
    }

    /// Returns whether this machine can render. If it cannot, the program must name the missing
    /// packages.
    fn can_render(&self) -> bool {
        let output = self.command("render point-reaching --size 16x16 --out probe.png").output().unwrap();
        assert!(output.status.success() || stderr(&output).contains("libegl1"), "{}", stderr(&output));
        output.status.success()
    }

    /// Creates a folder that contains only an `ffmpeg` with the content `script`.
    fn encoder(&self, name: &str, script: &str) -> PathBuf {
        let folder = self.path(name);
        std::fs::create_dir(&folder).unwrap();
        let program = folder.join("ffmpeg");
        std::fs::write(&program, script).unwrap();
        std::fs::set_permissions(&program, PermissionsExt::from_mode(0o755)).unwrap();
        folder
    }
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Returns width and height from the header of a PNG file.
fn size(path: &Path) -> (u32, u32) {
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(&bytes[..8], b"\x89PNG\r\n\x1a\n");
    let number = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
    (number(16), number(20))
}

#[test]
fn an_initial_state_is_rendered_and_overwritten_only_with_force() {
    let bench = Bench::new();
    if !bench.can_render() {
        return;
    }
    bench.check("render point-reaching --at 0.4,-0.3,0.5 --size 160x120 --out left.png");
    bench.check("render point-reaching --at 0.4,0.3,0.5 --size 160x120 --out right.png");
    assert_eq!(size(&bench.path("left.png")), (160, 120));
    let bytes = |name: &str| std::fs::read(bench.path(name)).unwrap();
    assert_ne!(bytes("left.png"), bytes("right.png"), "the target has another position");
    bench.refuses(
        &mut bench.command("render point-reaching --out left.png"),
        &["left.png exists already", "--force"],
    );
    bench.check("render point-reaching --size 160x120 --camera top,close --out cameras.png");
    assert_eq!(size(&bench.path("cameras.png")), (320, 120));
    bench.check("render point-reaching --at 0.4,0.3,0.5 --size 160x120 --out left.png --force");
    assert_eq!(bytes("left.png"), bytes("right.png"));
}

#[test]
fn without_a_driver_the_error_names_the_packages() {
    let bench = Bench::new();
    let without_driver = |mut command: Command| {
        command.env("__EGL_VENDOR_LIBRARY_DIRS", "/nonexistent").env("LIBGL_DRIVERS_PATH", "/nonexistent");
        command
    };
    let mut command = without_driver(bench.command("render point-reaching --out start.png"));
    let packages = ["error: cannot render without a display", "apt install libegl1 libgl1-mesa-dri"];
    bench.refuses(&mut command, &packages);
    // For a run, the error comes before the simulation.
    bench.check("evaluate point-reaching --controller expert --episodes 1 --out run.sqlite");
    let mut command = without_driver(bench.command("render run.sqlite --out strip.png"));
    let error = bench.refuses(&mut command, &packages);
    assert!(!error.contains("control steps"), "it simulated without need: {error}");
    // The images of the target's own cameras need no driver.
    let seen =
        "render run.sqlite --camera wrist,over -k render.image-size=[32,20] --size 32x20 --out seen.png";
    let output = without_driver(bench.command(seen)).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    // Six frames in two rows, each with two images.
    assert_eq!(size(&bench.path("seen.png")), (6 * 32, 2 * 20));
}

#[test]
fn an_episode_is_rendered_as_a_video_or_a_filmstrip() {
    let bench = Bench::new();
    bench.check("evaluate point-reaching --controller expert --episodes 2 --out run.sqlite");
    if !bench.can_render() {
        return;
    }
    bench.check("render run.sqlite --simulation 2 --size 32x24 --out strip.png");
    assert_eq!(size(&bench.path("strip.png")), (3 * 32, 2 * 24));

    let reach = "render run.sqlite --out event.png -k render.event";
    bench.refuses(&mut bench.command(&format!("{reach}=release")), &["nothing is released"]);
    bench.refuses(&mut bench.command(&format!("{reach}=contact")), &["no contact"]);

    let render =
        || bench.command("render run.sqlite --simulation 2 --size 32x24 -k render.fast=true --out video.mp4");
    let nothing = bench.path("nothing");
    let error = bench.refuses(render().env("PATH", &nothing), &["`ffmpeg`", "apt install ffmpeg"]);
    assert!(!error.contains("control steps"), "it simulated without need: {error}");
    let fails = bench.encoder("fails", FAILS);
    bench.refuses(render().env("PATH", format!("{}:/usr/bin:/bin", fails.display())), &["no encoder"]);
    let stores = bench.encoder("stores", STORES);
    let output = render().env("PATH", format!("{}:/usr/bin:/bin", stores.display())).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    // Samples 0, 2, 4 ... 300 with three bytes per pixel, after the headers of three boxes. The
    // even decisive sample is held for 29 frames more.
    assert_eq!(std::fs::metadata(bench.path("video.mp4")).unwrap().len(), 24 + 180 * 32 * 24 * 3);
}

#[test]
fn an_interrupted_video_leaves_no_file() {
    let bench = Bench::new();
    bench.check("evaluate point-reaching --controller expert --episodes 1 --out run.sqlite");
    if !bench.can_render() {
        return;
    }
    let slow = bench.encoder("slow", SLOW);
    let mut command = bench.command("render run.sqlite --size 32x24 -k render.fast=true --out video.mp4");
    command.env("PATH", format!("{}:/usr/bin:/bin", slow.display())).stderr(Stdio::piped());
    let child = command.spawn().unwrap();
    let start = Instant::now();
    while !bench.path("frame").exists() {
        assert!(start.elapsed() < Duration::from_secs(600));
        std::thread::sleep(Duration::from_millis(5));
    }
    signal(&child, "INT");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    assert!(stderr(&output).ends_with("interrupted; nothing was written\n"), "{}", stderr(&output));
    let expected = ["frame", "probe.png", "run.sqlite", "slow", "started"].map(|name| bench.path(name));
    assert_eq!(bench.files(), expected);
}

#[test]
fn invalid_arguments_of_render_are_errors() {
    let bench = Bench::new();
    for (arguments, parts) in [
        ("point-reching --out a.png", ["no task `point-reching`", "did you mean `point-reaching`?"]),
        ("point-reaching --out a.jpg", ["a.jpg", ".png"]),
        ("point-reaching --out a.mp4", ["a single picture", "name a run file"]),
        ("point-reaching --out no/a.png", ["cannot write no/a.png", "there is no folder no\n"]),
        ("point-reaching --at 0.5,0 --out a.png", ["number of values in the scenario is 2", "target_z"]),
        (
            "point-reaching --at -0.5,0,0.5 --out a.png",
            ["target_x is -0.5 m, outside the initial box", "from 0.3 to 0.7 m"],
        ),
        ("--out a.png", ["<TARGET|RUN|FILE.json>", "error"]),
        ("point-reaching --at 0.5,0,nan --out a.png", ["target_z", "NaN"]),
        ("point-reaching --size 33x20 --out a.png", ["33x20", "even"]),
        ("point-reaching --size 5000x20 --out a.png", ["5000x20", "4096"]),
        ("missing.sqlite --out a.png", ["missing.sqlite", "error"]),
        (
            "door-opening --camera sde --out a.png",
            ["no camera named `sde`", "auto, front, left, right, back, top, close, view"],
        ),
        ("door-opening --camera auto,top --size 3000x20 --out a.png", ["2 views of 3000 pixels", "4096"]),
        ("door-opening --camera overs --out a.png", ["no camera named `overs`", "view, over, wrist"]),
        (
            "door-opening -k render.image-size=[8,8] --out a.png",
            ["render.image-size has no effect", "such as over"],
        ),
        (
            "door-opening --camera over -k render.image-size=[90,90] --size 80x90 --out a.png",
            ["do not fit", "80x90"],
        ),
        ("run.sqlite -k render.around=0 --out a.mp4", ["render.around", "above 0"]),
        ("run.sqlite --speed 1000 --out a.mp4", ["--speed", "from 0.01 to 100"]),
    ] {
        bench.refuses(&mut bench.command(&format!("render {arguments}")), &parts);
    }
}

/// A cart that drives away at 4 m/s, with a lamp of its own.
const CART: &str = r#"<mujoco>
  <worldbody>
    <light pos="0 0 3"/>
    <body name="cart" pos="3 0 0.2">
      <joint name="drive" type="slide" axis="1 0 0"/>
      <geom type="box" size="0.2 0.1 0.1" mass="1"/>
      <geom type="sphere" size="0.1" pos="0 0 0.2" contype="0" conaffinity="0" mass="0" rgba="0.8 0.2 0.1 1"/>
    </body>
  </worldbody>
  <actuator><velocity name="motor" joint="drive" kv="100"/></actuator>
</mujoco>
<!-- the end -->
"#;

const CART_FILE: &str = r#"
format = 1
name = "cart"
model.file = "cart.xml"
control = { period = 0.1, steps = 20 }
start = { drive = "place" }
observation.place = "qpos('drive')"
policy = { expression = "4 + 0 * place", actions = 1, action = "action" }
signals.place = { value = "qpos('drive')[0]", unit = "m" }
axes.place = { range = [-0.5, 0.5], unit = "m" }
formulas.near = "always(place <= 3)"
"#;

#[test]
fn a_robot_of_a_file_has_pictures_of_its_start_of_its_runs_and_in_its_page() {
    let bench = Bench::new();
    std::fs::write(bench.path("cart.xml"), CART).unwrap();
    std::fs::write(bench.path("cart.toml"), CART_FILE).unwrap();
    bench.check("evaluate cart.toml --space starts --episodes 2 --out run.sqlite");
    bench.check("report run.sqlite --out page.html");
    let page = std::fs::read_to_string(bench.path("page.html")).unwrap();
    assert!(page.contains("<img src=\"data:image/png;base64,") && page.contains("Film of the scene"));
    assert!(page.contains("mishandle render run.sqlite"), "the page says how to draw it again");
    if !bench.can_render() {
        return;
    }
    bench.check("render cart.toml --size 160x120 --camera auto,close --out start.png");
    bench.check("render cart.toml --at 0.5 --size 160x120 --camera auto,close --out moved.png");
    assert_eq!(size(&bench.path("start.png")), (320, 120));
    bench.check("render run.sqlite --simulation 2 --size 160x120 --out strip.png");
    assert_eq!(size(&bench.path("strip.png")).0, 3 * 160);
    // A target without a scene has no pictures, and the reason is said.
    bench.check("evaluate toy/sphere-2d --episodes 2 --out toy.sqlite");
    bench.refuses(&mut bench.command("render toy.sqlite --out toy.png"), &["toy/sphere-2d", "no scene"]);
}
