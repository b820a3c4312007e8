//! Memory use does not grow with the number of simulations: writing, reading and upgrading a run takes less memory than
//! its file takes on disk.
#![allow(clippy::unwrap_used)] // clippy does not count helper functions as tests
#![cfg(target_os = "linux")] // where a process can read its peak memory

mod sample;

use mishandle_store::{IfExists, RunFile, RunWriter, export_csv};
use sample::{header, record, version_1};

#[test]
fn a_run_needs_less_memory_than_its_file_size() {
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

    let (peak, size) = (peak_bytes(), path.metadata().unwrap().len());
    assert!(peak < size / 2, "{peak} bytes of memory for a file of {size} bytes");

    // An upgrade takes little more.
    let (_folder, old_path) = version_1::copy();
    let row = |number| version_1::Row {
        trial: 3,
        number,
        seed: number.into(),
        unit_point: vec![0.25, 0.75],
        initial_configuration: [f64::from(number), 0.1],
        robustness: Some(0.5),
        ended: ("horizon", None),
        steps: 300,
        verdicts: [Some(0.5), None],
        trace_digest: Some(number.into()),
    };
    version_1::add(&old_path, (1..=simulations).map(row));
    let old_size = old_path.metadata().unwrap().len();
    let upgraded = RunFile::open(&old_path).unwrap();
    assert_eq!(upgraded.last_simulation_number(3).unwrap(), simulations);

    let peak = peak_bytes();
    assert!(peak < old_size, "{peak} bytes of memory for an older file of {old_size} bytes");

    // The lists of version 1 have no limit in the file; each is checked before the next one is read.
    let (_folder, wide_path) = version_1::copy();
    let wide = |number| version_1::Row { unit_point: vec![0.5; 900_000], ..row(number) };
    for number in 1..=20 {
        version_1::add(&wide_path, std::iter::once(wide(number)));
    }
    let error = RunFile::open(&wide_path).unwrap_err().to_string();
    assert!(error.contains("its unit point has 900000 elements"), "{error}");
    let (peak, size) = (peak_bytes(), wide_path.metadata().unwrap().len());
    assert!(peak < size / 2, "{peak} bytes of memory for an older file of {size} bytes");
}

fn peak_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB"));
    peak.unwrap().parse::<u64>().unwrap() * 1024
}
