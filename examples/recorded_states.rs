//! Replays the first simulations of a run file and writes their states to stdout, for a simulation
//! in MuJoCo's Python.
//!
//! ```text
//! mishandle evaluate peg-in-hole --controller ppo --episodes 20 --seed 1 --out run.sqlite
//! cargo run --release --example recorded_states -- run.sqlite 20 > states.f64
//! ```
//!
//! The output consists of 64-bit floating-point numbers, little-endian: 301 states per simulation,
//! each with MuJoCo's integration state and the targets of the nine joints.
//! `experiments/tasks/physics.py` reads it.

use std::io::Write;

use mishandle::picture::replay_states;
use mishandle::store::RunFile;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, count] = arguments.as_slice() else {
        return Err("expected a run file and a number of simulations".into());
    };
    let run = RunFile::open(path)?;
    let mut out = std::io::BufWriter::new(std::io::stdout().lock());
    for number in 1..=count.parse()? {
        let (_, trajectory) = replay_states(&run, 1, number, None)?;
        for number in trajectory.states.iter().flatten() {
            out.write_all(&number.to_le_bytes())?;
        }
    }
    out.flush()?;
    Ok(())
}
