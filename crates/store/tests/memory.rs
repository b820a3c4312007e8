//! Memory use does not grow with the number of simulations: writing and reading a run takes less
//! memory than its file takes on disk.

#![cfg(target_os = "linux")] // where a process can read its peak memory

use crate::own_process::own_process;
use crate::sample::{header, record};
use mishandle_store::{IfExists, RunFile, RunWriter, export_csv};

#[test]
fn a_run_needs_less_memory_than_its_file_size() {
    own_process("memory::a_run_needs_less_memory_than_its_file_size", || {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        let mut writer = RunWriter::create(&path, &header(), IfExists::Refuse).unwrap();
        let simulations = 120_000;
        writer.start_trial(1, 0).unwrap();
        for first in (1..=simulations).step_by(500) {
            writer.record(&(first..first + 500).map(|number| record(1, number)).collect::<Vec<_>>()).unwrap();
        }
        writer.close().unwrap();
        let run = RunFile::open(&path).unwrap();
        assert_eq!(run.simulations().filter(Result::is_ok).count(), simulations as usize);
        run.content_digest().unwrap();
        export_csv(&run, &mut std::io::sink()).unwrap();

        let peak = peak_bytes();
        let size = path.metadata().unwrap().len();
        assert!(peak < size / 2, "{peak} bytes of memory for a file of {size} bytes");
    });
}

fn peak_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB"));
    peak.unwrap().parse::<u64>().unwrap() * 1024
}
