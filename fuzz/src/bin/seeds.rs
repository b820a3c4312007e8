//! Writes the seeds of a target to a folder: `seeds TARGET FOLDER`.

use libfuzzer_sys as _;
use std::path::PathBuf; // the coverage counters of the instrumented code

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let [target, folder] =
        std::env::args().skip(1).collect::<Vec<_>>().try_into().map_err(|_| "usage: seeds TARGET FOLDER")?;
    let (_, seeds) =
        mishandle_fuzz::SEEDS.iter().find(|(name, _)| *name == target).ok_or("unknown target")?;
    for (number, bytes) in seeds().iter().enumerate() {
        std::fs::write(PathBuf::from(&folder).join(number.to_string()), bytes)?;
    }
    Ok(())
}
