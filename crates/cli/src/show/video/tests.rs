use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;

use super::*;

/// A folder with a fake encoder.
struct Bench {
    folder: tempfile::TempDir,
}

/// An MP4 file: the boxes `ftyp`, `moov` and `mdat`, the last with its size in 64 bits.
const MP4: &str = r"\0\0\0\010ftyp\0\0\0\010moov\0\0\0\01mdat\0\0\0\0\0\0\0\024data";

impl Bench {
    /// Encodes 100 frames of 2304 bytes with a shell script in place of ffmpeg.
    fn encode(script: &str, patience: Duration) -> (Bench, Result<()>) {
        let bench = Bench { folder: tempfile::tempdir().unwrap() };
        let program = bench.folder.path().join("ffmpeg");
        std::fs::write(&program, format!("#!/bin/sh\nfor last; do :; done\n{script}\n")).unwrap();
        std::fs::set_permissions(&program, PermissionsExt::from_mode(0o755)).unwrap();
        let result = bench.run(program.to_str().unwrap(), patience);
        (bench, result)
    }

    fn run(&self, program: &str, patience: Duration) -> Result<()> {
        let file = AtomicFile::create_new(&self.video())?;
        let size = (32, 24);
        let mut video = Video::start_with(program, patience, file, size, 30.0)?;
        for _ in 0..100 {
            assert!(video.push_frame(&[7; 2304])?.is_continue());
        }
        assert!(video.finish()?.is_continue());
        Ok(())
    }

    fn video(&self) -> PathBuf {
        self.folder.path().join("video.mp4")
    }

    /// Checks that the script fails with a message that contains `part`, and leaves only itself.
    #[track_caller]
    fn refuses(script: &str, part: &str) {
        let (bench, result) = Bench::encode(script, Duration::from_secs(3));
        let message = format!("{:#}", result.unwrap_err());
        assert!(message.contains(part), "{script}: {message}");
        assert!(message.len() < 2 * MESSAGE_BYTES, "{script}: {} bytes", message.len());
        assert_eq!(std::fs::read_dir(bench.folder.path()).unwrap().count(), 1, "{script} left a file");
    }
}

#[test]
fn a_complete_video_gets_its_name_whatever_the_encoder_prints() {
    // Ten megabytes on stderr before, while and after it reads.
    let noise = "head -c 10000000 /dev/zero | tr '\\0' x >&2";
    let script = format!(
        "{noise}\nhead -c 2304 > /dev/null\n{noise}\nprintf '{MP4}' > \"$last\"; cat > /dev/null\n{noise}"
    );
    let (bench, result) = Bench::encode(&script, PATIENCE);
    result.unwrap();
    assert_eq!(std::fs::read(bench.video()).unwrap().len(), 36);
    assert_eq!(std::fs::read_dir(bench.folder.path()).unwrap().count(), 2);
}

#[test]
fn an_encoder_that_fails_or_is_killed_leaves_no_file() {
    let write = format!("printf '{MP4}' > \"$last\"");
    Bench::refuses("echo no encoder >&2; exit 3", "exit status: 3: no encoder");
    Bench::refuses(&format!("{write}; cat > /dev/null; exit 1"), "exit status: 1");
    Bench::refuses(&format!("{write}; cat > /dev/null; kill -KILL $$"), "signal: 9");
    Bench::refuses(&format!("{write}; kill -TERM $$"), "signal: 15");
    Bench::refuses("head -c 1000000 /dev/zero | tr '\\0' x >&2; exit 1", "exit status: 1: xxx");
}

#[test]
fn an_encoder_that_ends_before_the_last_frame_leaves_no_file() {
    Bench::refuses(&format!("printf '{MP4}' > \"$last\"; head -c 5000 > /dev/null"), "before the last");
    Bench::refuses("exec < /dev/null; exit 0", "before the last");
}

#[test]
fn an_encoder_that_writes_nothing_or_a_part_leaves_no_file() {
    let complete = 36;
    Bench::refuses("cat > /dev/null", "the file is empty");
    Bench::refuses("cat > \"$last\"", "bytes are not a whole MP4 file");
    for length in 1..complete {
        let script = format!("cat > /dev/null; printf '{MP4}' | head -c {length} > \"$last\"");
        Bench::refuses(&script, "did not write a complete video: its ");
    }
}

#[test]
fn an_encoder_that_hangs_is_stopped_with_its_children() {
    let write = format!("printf '{MP4}' > \"$last\"");
    Bench::refuses(&format!("{write}; cat > /dev/null; sleep 1000"), "did not end for 3 s and was stopped");
    Bench::refuses("sleep 1000", "took no data for 3 s and was stopped");
    // It closes its input, but does not end.
    Bench::refuses("exec < /dev/null; sleep 1000", "did not end for 3 s");
    // It ignores every signal that can be ignored, and its child holds its standard error.
    Bench::refuses("trap '' TERM INT HUP PIPE; sleep 1000 & sleep 1000", "took no data");
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("ffmpeg");
    std::fs::write(&program, "#!/bin/sh\nexec sleep 1000\n").unwrap();
    std::fs::set_permissions(&program, PermissionsExt::from_mode(0o755)).unwrap();
    let error = check(program.to_str().unwrap(), Duration::from_millis(100)).unwrap_err();
    assert_eq!(error.to_string(), "`ffmpeg -version` did not end within 0.1 s");
}

#[test]
fn an_encoder_cannot_write_to_another_file_through_the_name_of_the_temporary_file() {
    let swap = format!(
        "cd \"$(dirname \"$0\")\"; echo precious > target; rm .mishandle-*; ln -s target .mishandle-x.part\n\
         cat > /dev/null; printf '{MP4}' > \"$last\""
    );
    let (bench, result) = Bench::encode(&swap, PATIENCE);
    assert!(result.is_err());
    assert_eq!(std::fs::read(bench.folder.path().join("target")).unwrap(), b"precious\n");
    assert!(!bench.video().exists());
}
