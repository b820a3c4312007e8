//! Recorded logs, as read by the command `monitor`.

use std::process::ExitCode;

use crate::scratch::Scratch;

/// The period of the command line, s. A log with a column `time` may have another one.
const PERIOD: &str = "log.period=0.1";

/// Checks the laws:
/// - every log ends with one of the documented exit codes;
/// - a log without quotes and without a column `time`, of finite numbers only, gets the verdict
///   that a parser of three lines gives it.
pub fn check(bytes: &[u8]) {
    let scratch = Scratch::new();
    let path = scratch.file("log.csv", bytes);
    let path = path.to_str().expect("a path in UTF-8");
    let formula = "always(x >= 0)";
    let arguments = ["mishandle", "monitor", "-k", PERIOD, "--formula", formula, path];
    let found = mishandle_cli::run_with(arguments.map(Into::into));
    assert!((0..3).any(|code| found == ExitCode::from(code)), "{found:?}");
    if let Some(minimum) = plain_minimum(bytes) {
        assert_eq!(found, ExitCode::from(u8::from(minimum < 0.0)), "the minimum is {minimum}");
    }
}

/// Returns the minimum of the column `x` of a plain log; `None` if the log is not plain.
fn plain_minimum(bytes: &[u8]) -> Option<f64> {
    let is_plain = |byte: &u8| matches!(byte, b'0'..=b'9' | b'a'..=b'z' | b'-' | b'.' | b',' | b'\n');
    let text = std::str::from_utf8(bytes).ok().filter(|text| text.bytes().all(|byte| is_plain(&byte)))?;
    let mut rows = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let names = rows.next()?;
    let is_unique = (0..names.len()).all(|i| !names[i].is_empty() && !names[..i].contains(&names[i]));
    let column =
        names.iter().position(|name| *name == "x").filter(|_| is_unique && !names.contains(&"time"))?;
    let values = rows.map(|cells| {
        let numbers = cells.iter().map(|cell| cell.parse::<f64>().ok().filter(|x| x.is_finite()));
        let numbers: Vec<f64> = numbers.collect::<Option<_>>()?;
        (numbers.len() == names.len()).then(|| numbers[column])
    });
    let values: Vec<f64> = values.collect::<Option<_>>()?;
    values.into_iter().reduce(f64::min)
}

pub fn seeds() -> Vec<Vec<u8>> {
    [
        "x\n1\n0.5\n-2\n",
        "time,x\n0,1\n0.1,2\n0.2,-3\n",
        "\u{feff}time,x\r\n0,1\r\n0.1,2",
        "a,x,b\n1,2e3,3\n4,-5.5,inf\n",
        "\"x\", \"y \"\"z\"\"\"\n 1 ,\"2\"\n",
        "x,x\n1,2\n",
        "x\n\n1\nnan\n",
        "x,y\n1\n",
        "time,x\n0,1\ninf,2\n",
    ]
    .map(|text| text.as_bytes().to_vec())
    .into()
}
