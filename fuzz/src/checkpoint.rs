//! Checkpoints of training runs.

use mishandle::controllers::write_checksum;
use mishandle::training::Checkpoint;

use crate::scratch::Scratch;

/// Checks that a checkpoint that is read and written reads as the same checkpoint, bit for bit.
/// Each input is read as it is, and with its checksum corrected.
pub fn check(bytes: &[u8]) {
    let scratch = Scratch::new();
    check_file(&scratch, bytes);
    let mut corrected = bytes.to_vec();
    write_checksum(&mut corrected);
    if corrected != bytes {
        check_file(&scratch, &corrected);
    }
}

fn check_file(scratch: &Scratch, bytes: &[u8]) {
    let Ok(checkpoint) = Checkpoint::load(&scratch.file("input", bytes)) else { return };
    let written = bytes_of(scratch, &checkpoint);
    let again = Checkpoint::load(&scratch.path("written")).expect("a written checkpoint is read");
    assert_eq!((again.seed(), again.settings()), (checkpoint.seed(), checkpoint.settings()));
    assert_eq!(bytes_of(scratch, &again), written);
}

fn bytes_of(scratch: &Scratch, checkpoint: &Checkpoint) -> Vec<u8> {
    let path = scratch.path("written");
    checkpoint.save(&path).expect("a checkpoint is written");
    std::fs::read(path).expect("the file was written")
}

pub fn seeds() -> Vec<Vec<u8>> {
    let scratch = Scratch::new();
    let empty = Checkpoint::new("ppo", "toy", 3, "gamma = 0.9");
    let mut full = Checkpoint::new("sac", "point-reaching", u64::MAX, "");
    full.put("a", vec![f64::from_bits(0x7FF8_0000_0000_0123), 5e-324, 0.1]);
    full.put("b", vec![f32::MIN_POSITIVE / 2.0, 0.1]);
    full.put("c", vec![u64::MAX]);
    full.put("d", Vec::<f64>::new());
    vec![bytes_of(&scratch, &empty), bytes_of(&scratch, &full)]
}
