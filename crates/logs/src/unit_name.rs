//! Units in the names of columns with times: `t_ms`, `TimeMS`, `timestampMillis`, `time(us)`.

/// Words for units other than seconds.
const UNITS: [(&[&str], &str); 4] = [
    (&["ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecs", "nanosecond", "nanoseconds"], "nanoseconds"),
    (
        &[
            "us",
            "µs",
            "μs",
            "usec",
            "usecs",
            "micros",
            "microsec",
            "microsecs",
            "microsecond",
            "microseconds",
        ],
        "microseconds",
    ),
    (
        &["ms", "msec", "msecs", "millis", "millisec", "millisecs", "millisecond", "milliseconds"],
        "milliseconds",
    ),
    (
        &["min", "mins", "minute", "minutes", "h", "hr", "hrs", "hour", "hours", "day", "days"],
        "minutes or more",
    ),
];

/// Words for times to which a unit is appended: `timems`, `tms`.
const TIMES: [&str; 8] = ["t", "ts", "time", "times", "timestamp", "stamp", "clock", "elapsed"];

/// Returns the unit other than seconds that the name of a column contains.
pub(crate) fn unit_in(name: &str) -> Option<&'static str> {
    let parts = name.split(|c: char| !c.is_alphanumeric()).filter(|part| !part.is_empty());
    parts.into_iter().find_map(|part| {
        // `nSecs` is a word, and `tMs` is two.
        unit_of(part).or_else(|| words(part).into_iter().find_map(unit_of))
    })
}

fn unit_of(word: &str) -> Option<&'static str> {
    let word = word.to_lowercase();
    let is_unit = |text: &str| UNITS.iter().find(|(words, _)| words.contains(&text)).map(|(_, unit)| *unit);
    let rests = TIMES.iter().filter_map(|time| word.strip_prefix(time)).filter(|rest| rest.len() > 1);
    is_unit(&word).or_else(|| rests.into_iter().find_map(is_unit))
}

/// Returns the words of a name in camel case: `TimeMSec` is `Time` and `MSec`.
fn words(name: &str) -> Vec<&str> {
    let mut starts = vec![0];
    let mut is_lower = false;
    for (at, letter) in name.char_indices() {
        if letter.is_uppercase() && is_lower {
            starts.push(at);
        }
        is_lower = !letter.is_uppercase();
    }
    let ends = starts[1..].iter().copied().chain([name.len()]);
    starts.iter().zip(ends).map(|(start, end)| &name[*start..end]).collect()
}

#[cfg(test)]
mod tests {
    use super::unit_in;

    #[test]
    fn a_unit_is_found_however_the_name_is_written() {
        for (unit, names) in [
            (
                Some("milliseconds"),
                &[
                    "t_ms",
                    "TimeMS",
                    "timestampMillis",
                    "tMs",
                    "timems",
                    "TIMEMS",
                    "time [ms]",
                    "Time(ms)",
                    "timeMSec",
                    "timeMsecs",
                    "elapsedMilliseconds",
                    "meta.stampMs",
                    "GPSTimeMS",
                    "millis",
                    "Zeit in ms",
                ][..],
            ),
            (Some("microseconds"), &["TimeUS", "timestamp_us", "t(µs)", "tUs", "timeMicros", "usec"]),
            (Some("nanoseconds"), &["header.stamp.nanosec", "timeNs", "nSecs", "timestampNanos", "tns"]),
            (Some("minutes or more"), &["time_min", "elapsedHours", "t [h]", "Minutes"]),
            (
                None,
                &[
                    "time",
                    "t",
                    "ts",
                    "Time",
                    "times",
                    "stamp",
                    "timestamp",
                    "timeSec",
                    "t_s",
                    "time (s)",
                    "seconds",
                    "bus",
                    "status_time",
                    "systems",
                    "clock",
                    "Timestamp",
                    "th",
                    "nonce",
                ],
            ),
        ] {
            for name in names {
                assert_eq!(unit_in(name), unit, "{name}");
            }
        }
    }
}
