//! Logs in all formats, as read by the command `monitor`.

use std::process::ExitCode;

use crate::bytes::Bytes;
use crate::scratch::Scratch;

/// Flags of the command; the first byte of an input picks one set.
const FLAGS: [&[&str]; 8] = [
    &[],
    &["-klog.missing=drop", "-klog.duplicates=last", "-klog.sort=true"],
    &["-klog.resample=hold", "-klog.period=0.1", "-klog.missing=hold"],
    &["-klog.resample=linear", "-klog.period=0.1", "-klog.tolerance=5", "-klog.missing=drop"],
    &["-klog.dense=hold", "-klog.missing=drop"],
    &["-klog.dense=linear", "-klog.duplicates=first"],
    &["-klog.topic-column=topic", "-klog.dense=hold"],
    &["-klog.time=t", "-klog.time-unit=ns", "-klog.utc-offset=Z"],
];

/// Formats; the second byte picks one.
const FORMATS: [&[&str]; 5] = [
    &[],
    &["-klog.format=csv"],
    &["-klog.format=jsonl"],
    &["-klog.format=numpy"],
    &["-klog.format=parquet"],
];

/// Checks the law: every log ends with one of the documented exit codes, with every set of flags.
pub fn check(bytes: &[u8]) {
    let mut bytes = Bytes(bytes);
    let flags = bytes.pick(&FLAGS);
let format = bytes.pick(&FORMATS);
    let scratch = Scratch::new();
    let path = scratch.file("log", bytes.0);
    let path = path.to_str().expect("a path in UTF-8");
    let formula = "always[0:3](force >= 0) or eventually(force <= 2)";
    let arguments = [&["mishandle", "monitor", "--formula", formula, path], flags, format].concat();
    let found = mishandle_cli::run_with(arguments.into_iter().map(Into::into));
    assert!((0..3).any(|code| found == ExitCode::from(code)), "{found:?}");
}

pub fn seeds() -> Vec<Vec<u8>> {
    let files: [&[u8]; 9] = [
        b"time;force\n0,5;1\n0,6;2\n",
        b"# time force\n0 1\n0.1 2\n",
        b"t,force\n1700000000000000000,1\n1700000000100000000,nan\n",
        b"time,force,topic\n2024-01-31T12:00:00Z,1,a\n2024-01-31T12:00:01Z,2,a\n",
        b"{\"time\":0,\"force\":1}\n{\"time\":0.1,\"force\":[2,3]}\n",
        include_bytes!("../../crates/logs/tests/data/numpy.npz"),
        include_bytes!("../../crates/logs/tests/data/numpy_compressed.npz"),
        include_bytes!("../../crates/logs/tests/data/polars.parquet"),
        include_bytes!("../../crates/logs/tests/data/pyarrow_gzip.parquet"),
    ];
    let with = |(number, file): (u8, &[u8])| [&[number % 8, 0], file].concat();
    (0..).zip(files).map(with).collect()
}
