//! Choices: units, zones, order, missing values, resampling, topics. What nobody stated is an error
//! that has the setting that decides.

use std::io::Cursor;

use crate::names;
use mishandle_logs::{
    Column, Duplicates, Interpolation, Log, Missing, NamedSamples, OpenLog, Options, Result, Samples,
    Sampling, Signals, Times, Topic, Unit,
};
use mishandle_results::Key;

fn samples(text: &str, signals: &[&str], options: &Options) -> Result<Samples> {
    OpenLog::open_csv(Box::new(Cursor::new(text.to_owned())), options)?.read(signals)?.samples(options)
}

fn values(text: &str, signals: &[&str], options: &Options) -> Vec<Vec<f64>> {
    match samples(text, signals, options).unwrap_or_else(|error| panic!("{text}: {error}")).signals {
        Signals::Even { trace, .. } => {
            signals.iter().map(|s| trace.signal(s).expect("read").to_vec()).collect()
        }
        Signals::Dense(found) => {
            let of = |name: &&str| {
                found.iter().find(|signal| signal.name() == *name).expect("read").values().to_vec()
            };
            signals.iter().map(of).collect()
        }
    }
}

#[track_caller]
fn asks(text: &str, options: &Options, key: Key, part: &str) {
    let error = samples(text, &["d"], options).expect_err("an undecided choice");
    assert!(names(&error, key), "{error}: {:?}", error.remedies());
    assert!(error.to_string().contains(part), "{error}");
}

fn resampled(interpolation: Interpolation, period: f64) -> Options {
    Options { sampling: Sampling::Resampled(interpolation), period: Some(period), ..Options::default() }
}

fn dense(interpolation: Interpolation) -> Options {
    Options { sampling: Sampling::Dense(interpolation), ..Options::default() }
}

const HOLD: Interpolation = Interpolation::Hold;
const LINEAR: Interpolation = Interpolation::Linear;

#[test]
fn a_unit_is_never_guessed() {
    let plain = Options::default();
    asks("time,d\n1700000000000000000,1\n", &plain, Key::LOG_TIME_UNIT, "line 2: `time` is 1.7e18");
    asks("time,d\n1700000000000,1\n", &plain, Key::LOG_TIME_UNIT, "looks like ms, us or ns");
    for name in ["timestamp_ns", "t [ms]", "time(us)", "header.stamp.nanosec"] {
        let options = Options { time: Some(name.to_owned()), ..Options::default() };
        asks(&format!("{name},d\n0,1\n1,1\n"), &options, Key::LOG_TIME_UNIT, "looks like");
        let stated = Options { time_unit: Some(Unit::Milliseconds), ..options };
        let found = samples(&format!("{name},d\n0,1\n20,1\n"), &["d"], &stated).expect("stated");
        assert!(matches!(found.signals, Signals::Even { period: Some(0.02), .. }), "{found:?}");
    }
    for name in ["TimeMS", "timestampMillis", "tMs"] {
        let options = Options { time: Some(name.to_owned()), ..Options::default() };
        asks(&format!("{name},d\n0,1\n5,1\n"), &options, Key::LOG_TIME_UNIT, "looks like milliseconds");
    }
    // However the numbers are written, and wherever the clock pauses or starts again.
    for times in ["0.0 100.0 200.0", "0 100 200", "0.25 33.5 66.9", "1e3 1.01e3 1.02e3", "0 10 20 0 10 20"] {
        let rows: String = times.split(' ').map(|time| format!("{time},1\n")).collect();
        asks(&format!("time,d\n{rows}"), &plain, Key::LOG_TIME_UNIT, "looks like ms, us or ns");
    }
    let pause = samples("time,d\n0,1\n0.1,1\n0.2,1\n3600.2,1\n3600.3,1\n", &["d"], &dense(HOLD));
    assert!(pause.is_ok(), "{pause:?}");
    asks("time,d\n2024-01-31 12:00:00,1\n", &plain, Key::LOG_UTC_OFFSET, "line 2");
    let error = samples("time,d\n1/2/2024 12:00,1\n", &["d"], &plain).expect_err("an ambiguous date");
    assert!(error.to_string().contains("line 2: `time` is `1/2/2024 12:00`; a time must be"), "{error}");
    let error = samples("time,d\n0,1\n2024-01-31T12:00:00Z,1\n", &["d"], &plain).expect_err("mixed times");
    assert!(
        error.to_string().contains("line 3: `time` is a date, but a number in the rows before"),
        "{error}"
    );
}

#[test]
fn nanoseconds_stay_exact_at_an_epoch() {
    let options = Options { time_unit: Some(Unit::Nanoseconds), ..dense(HOLD) };
    let text = "time,d\n1700000000000000001,1\n1700000000000000002,2\n1700000000000000004,3\n";
    let found = samples(text, &["d"], &options).expect("nanoseconds");
    assert_eq!(found.origin_ns, Some(1_700_000_000_000_000_001));
    let Signals::Dense(signals) = found.signals else { panic!("dense") };
    assert_eq!(signals[0].times(), [0.0, 1e-9, 3e-9]);
    // The same instants in seconds with nine decimals, and as dates.
    for (unit, rows) in [
        (Some(Unit::Seconds), ["1700000000.000000001", "1700000000.000000002", "1700000000.000000004"]),
        (
            None,
            [
                "2023-11-14T22:13:20.000000001Z",
                "2023-11-14T22:13:20.000000002Z",
                "2023-11-14T23:13:20.000000004+01:00",
            ],
        ),
    ] {
        let text = format!("time,d\n{},1\n{},2\n{},3\n", rows[0], rows[1], rows[2]);
        let found =
            samples(&text, &["d"], &Options { time_unit: unit, ..options.clone() }).expect("exact times");
        let Signals::Dense(same) = found.signals else { panic!("dense") };
        assert_eq!(same, signals, "{rows:?}");
    }
    let times = Times::nanoseconds("stamp", &[i64::MAX - 2, i64::MAX - 1, i64::MAX]);
    assert_eq!(times.secs(), [0.0, 1e-9, 2e-9]);
    assert_eq!(times.period(None).expect("even times"), Some(1e-9));
}

#[test]
fn order_and_doubles_are_choices() {
    let plain = Options::default();
    asks("time,d\n0,1\n2,1\n1,1\n", &plain, Key::LOG_SORT, "does not increase: it is 2 and then 1 in line 4");
    asks(
        "time,d\n0,1\n1,1\n1,1\n",
        &plain,
        Key::LOG_DUPLICATES,
        "does not increase: it is 1 and then 1 in line 4",
    );
    asks("time,d\n0,1\n0.1,1\n0.3,1\n", &plain, Key::LOG_RESAMPLE, "steps from 0 to 0.1 in line 3");
    let sorted = Options { sort: true, ..Options::default() };
    assert_eq!(values("time,d\n2,3\n0,1\n1,2\n", &["d"], &sorted), [[1.0, 2.0, 3.0]]);
    let text = "time,d\n0,1\n1,2\n1,3\n1,4\n2,5\n";
    for (duplicates, expected) in [(Duplicates::First, [1.0, 2.0, 5.0]), (Duplicates::Last, [1.0, 4.0, 5.0])]
    {
        assert_eq!(values(text, &["d"], &Options { duplicates, ..Options::default() }), [expected]);
    }
}

#[test]
fn missing_values_are_choices() {
    for cell in ["", "NaN", "null", "None", "abc", "inf", "-", "NA"] {
        let text = format!("time,d\n0,1\n1,{cell}\n2,3\n");
        asks(&text, &Options::default(), Key::LOG_MISSING, &format!("line 3: `d` is `{cell}`"));
        let hold = Options { missing: Missing::Hold, ..Options::default() };
        assert_eq!(values(&text, &["d"], &hold), [[1.0, 1.0, 3.0]]);
        // Without the row, the samples are not even.
        let drop = Options { missing: Missing::Drop, ..Options::default() };
        assert_eq!(values(&text, &["d"], &drop), [[1.0, 3.0]]);
        let linear = Options { missing: Missing::Drop, ..resampled(LINEAR, 1.0) };
        assert_eq!(values(&text, &["d"], &linear), [[1.0, 2.0, 3.0]]);
    }
    let hold = Options { missing: Missing::Hold, ..Options::default() };
    asks("time,d\n0,\n1,2\n", &hold, Key::LOG_MISSING, "line 2: `d` has no earlier value to hold");
    let error = samples("time,d\n0,\n1,\n", &["d"], &hold).expect_err("no number");
    assert!(error.to_string().contains("`d` has no number in any row"), "{error}");
    asks(
        "time,d\n0,1\n,1\n",
        &Options::default(),
        Key::LOG_MISSING,
        "line 3: `time` is ``; every row needs a finite time",
    );
}

#[test]
fn rows_of_topics_with_blanks_are_resampled_together() {
    let text = "time,a,b\n0,1,\n0.5,,10\n1,2,\n1.5,,20\n2,3,\n2.5,,30\n";
    let options = Options { missing: Missing::Drop, ..resampled(HOLD, 0.5) };
    // b starts at 0.5 s; a is held until the end.
    assert_eq!(
        values(text, &["a", "b"], &options),
        [[1.0, 2.0, 2.0, 3.0, 3.0], [10.0, 10.0, 20.0, 20.0, 30.0]]
    );
    let linear = Options { missing: Missing::Drop, ..resampled(LINEAR, 0.5) };
    assert_eq!(values(text, &["a", "b"], &linear), [[1.5, 2.0, 2.5, 3.0], [10.0, 15.0, 20.0, 25.0]]);
}

#[test]
fn a_column_can_name_the_topic_of_each_row() {
    let text = "time,topic,x,y\n0.00,arm,1,\n0.01,/hand,,5\n1.00,arm,2,\n1.01,/hand,,6\n2.00,arm,3,\n";
    let options = Options { topic_column: Some("topic".to_owned()), ..resampled(HOLD, 1.0) };
    assert_eq!(values(text, &["arm/x", "/hand/y"], &options), [[1.0, 2.0], [5.0, 6.0]]);
    let even = Options { topic_column: Some("topic".to_owned()), ..Options::default() };
    assert_eq!(values(text, &["arm/x"], &even), [[1.0, 2.0, 3.0]]);
    let both = samples(text, &["arm/x", "/hand/y"], &even).expect_err("two rates");
    assert!(names(&both, Key::LOG_RESAMPLE), "{both}");
    let lacks = samples(text, &["arm/y"], &even).expect_err("blanks");
    assert!(lacks.to_string().contains("line 2: `arm/y` has no number"), "{lacks}");
    let unknown = samples(text, &["leg/x"], &even).expect_err("no such topic");
    assert!(unknown.to_string().contains("topics `arm`, `/hand`"), "{unknown}");
}

#[test]
fn resampling_even_samples_at_their_period_changes_nothing() {
    for rate in [3.0, 10.0, 24.0, 29.97, 30.0, 1000.0] {
        for write in [
            |time: f64| format!("{time:.4}"),
            |time: f64| time.to_string(),
            |time: f64| (time as f32).to_string(),
            |time: f64| format!("{:.6}", 1.7e9 + time),
        ] {
            let rows = (0..500).map(|i| format!("{},{}", write(f64::from(i) / rate), (i * 37) % 101));
            let text = format!("time,d\n{}\n", rows.collect::<Vec<_>>().join("\n"));
            let Ok(even) = samples(&text, &["d"], &Options::default()) else { continue };
            let Signals::Even { trace, period, .. } = even.signals else { panic!("even") };
            for interpolation in [HOLD, LINEAR] {
                let again = values(&text, &["d"], &resampled(interpolation, period.expect("times")));
                assert_eq!(again[0], trace.signal("d").expect("read"), "{rate} {interpolation:?}");
            }
        }
    }
}

#[test]
fn jitter_is_resampled_and_gaps_need_a_tolerance() {
    let text = "time,d\n0,0\n0.11,1.1\n0.19,1.9\n0.3,3\n0.55,5.5\n";
    assert_eq!(values(text, &["d"], &resampled(HOLD, 0.1)), [[0.0, 0.0, 1.9, 3.0, 3.0, 3.0]]);
    let linear = values(text, &["d"], &resampled(LINEAR, 0.1));
    for (row, value) in linear[0].iter().enumerate() {
        assert!((value - row as f64).abs() < 1e-12, "{linear:?}");
    }
    let bounded = Options { tolerance: Some(0.2), ..resampled(HOLD, 0.1) };
    let long = samples(text, &["d"], &bounded).expect_err("a gap").to_string();
    assert!(long.contains(" s before line 6, longer than the tolerance of 0.2 s"), "{long}");
    let even = Options { tolerance: Some(1.0), ..Options::default() };
    asks(text, &even, Key::LOG_DENSE, "that resampling or dense time bridges");
    asks(text, &Options { period: None, ..resampled(HOLD, 0.1) }, Key::LOG_PERIOD, "resampling needs");
    asks("d\n1\n2\n", &resampled(HOLD, 0.1), Key::LOG_TIME, "need the times of the samples");
    let seconds = Options { time_unit: Some(Unit::Seconds), ..resampled(HOLD, 1e-3) };
    asks("time,d\n0,1\n1e10,2\n", &seconds, Key::LOG_PERIOD, "the period must be longer");
}

#[test]
fn topics_with_different_times_share_their_common_time() {
    let topic = |name: &str, times: &[i64], values: &[f64]| {
        let column = Column { name: format!("{name}/v"), values: values.to_vec() };
        Topic::new(Some(name.to_owned()), Some(Times::nanoseconds("stamp", times)), vec![column])
    };
    let epoch = 1_700_000_000_000_000_000;
    let half = 500_000_000;
    let log = || {
        let a = topic("a", &[epoch, epoch + 2 * half, epoch + 4 * half], &[0.0, 1.0, 2.0]);
        let b = topic("b", &[epoch + half, epoch + 3 * half], &[5.0, 7.0]);
        [
            Log { topics: vec![a.clone(), b.clone()], likely_time: None },
            Log { topics: vec![b, a], likely_time: None },
        ]
    };
    for log in log() {
        let found = log.clone().samples(&dense(LINEAR)).expect("dense");
        let Signals::Dense(mut signals) = found.signals else { panic!("dense") };
        signals.sort_by(|a, b| a.name().cmp(b.name()));
        assert_eq!((signals[0].times(), signals[0].values()), (&[0.5, 1.0, 1.5][..], &[0.5, 1.0, 1.5][..]));
        assert_eq!((signals[1].times(), signals[1].values()), (&[0.5, 1.5][..], &[5.0, 7.0][..]));
        let found = log.clone().samples(&dense(HOLD)).expect("dense");
        let Signals::Dense(mut signals) = found.signals else { panic!("dense") };
        signals.sort_by(|a, b| a.name().cmp(b.name()));
        assert_eq!((signals[0].times(), signals[0].values()), (&[0.5, 1.0, 2.0][..], &[0.0, 1.0, 2.0][..]));
        assert_eq!((signals[1].times(), signals[1].values()), (&[0.5, 1.5, 2.0][..], &[5.0, 7.0, 7.0][..]));
        let error = log.samples(&Options::default()).expect_err("two rates");
        assert!(names(&error, Key::LOG_RESAMPLE), "{error}");
    }
    let apart = Log {
        topics: vec![topic("a", &[0, 1], &[0.0, 1.0]), topic("b", &[5, 6], &[0.0, 1.0])],
        likely_time: None,
    };
    assert!(apart.samples(&dense(LINEAR)).expect_err("apart").to_string().contains("no time in common"));
}

#[test]
fn a_clock_that_starts_again_is_several_logs() {
    let runs = |text: &str, options: &Options| {
        let log = OpenLog::open_csv(Box::new(Cursor::new(text.to_owned())), options)?.read(&["d"])?;
        log.samples_of_runs(options)
    };
    let found = |text: &str, options: &Options| -> Vec<(String, Vec<f64>)> {
        let found = runs(text, options).unwrap_or_else(|error| panic!("{text}: {error}"));
        let named = NamedSamples::of_runs("a.csv", found).into_iter();
        let shown = |log: NamedSamples| match log.samples.signals {
            Signals::Even { trace, .. } => (log.name, trace.signal("d").expect("read").to_vec()),
            Signals::Dense(signals) => (log.name, signals[0].values().to_vec()),
        };
        named.map(shown).collect()
    };
    // The second run violates d <= 2. Sorted, and with one row of each time, it is gone.
    let text = "time,d\n0,1\n1,1\n2,1\n# restarted\n0,9\n1,1\n2,1\n";
    let duplicates = Duplicates::First;
    for options in [
        Options::default(),
        Options { sort: true, duplicates, ..Options::default() },
        Options { sort: true, duplicates: Duplicates::Last, ..dense(HOLD) },
        Options { sort: true, duplicates, ..resampled(HOLD, 1.0) },
    ] {
        let expected = [
            ("a.csv: run 1 of 2, line 2 to line 4".to_owned(), vec![1.0, 1.0, 1.0]),
            ("a.csv: run 2 of 2, line 6 to line 8".to_owned(), vec![9.0, 1.0, 1.0]),
        ];
        assert_eq!(found(text, &options), expected, "{options:?}");
    }
    let error = samples(text, &["d"], &Options::default()).expect_err("two runs");
    assert!(error.to_string().contains("start again in line 6: the log is 2 runs"), "{error}");
    let uneven = runs("time,d\n0,1\n1,1\n2,1\n0,1\n1,1\n1.2,1\n", &Options::default());
    let uneven = uneven.expect_err("uneven").to_string();
    assert!(uneven.starts_with("run 2 of 2, line 5 to line 7: samples must be evenly spaced"), "{uneven}");
    // The second run starts in the middle of the first one, and its first row violates d <= 2.
    let row = |(time, d): (i32, i32)| format!("{time},{d}\n");
    let first = (0..=10).map(|time| (time, 1));
    let second = (5..=12).map(|time| (time, if time == 5 { 9 } else { 1 }));
    let text = format!("time,d\n{}", first.chain(second).map(row).collect::<String>());
    let seconds = [vec![1.0; 11], [&[9.0][..], &[1.0; 7]].concat()];
    for options in
        [Options::default(), Options { sort: true, duplicates: Duplicates::Last, ..Options::default() }]
    {
        let values = found(&text, &options).into_iter().map(|(_, values)| values);
        assert!(values.eq(seconds.clone()), "{options:?}");
    }
    // One run has the name of the log; a late row is not a run, and with rows in the wrong order
    // nothing says which it is.
    assert_eq!(found("time,d\n0,1\n1,2\n", &Options::default())[0].0, "a.csv");
    let sorted = Options { sort: true, ..Options::default() };
    assert_eq!(found("time,d\n0,1\n2,3\n1,2\n3,4\n", &sorted)[0].1, [1.0, 2.0, 3.0, 4.0]);
    let part = "if its clock starts again there, cut the log into two";
    asks("time,d\n10,1\n11,1\n0,1\n1,1\n", &Options::default(), Key::LOG_SORT, part);
    assert_eq!(found("time,d\n10,1\n11,1\n0,1\n1,1\n2,1\n", &Options::default()).len(), 2);
    // Topics have as many runs.
    let topics = "time,topic,d\n0,a,1\n1,a,1\n0,b,1\n1,b,1\n0,a,1\n1,a,1\n";
    let by_topic = Options { topic_column: Some("topic".to_owned()), ..dense(HOLD) };
    let open = |text: &str, signals: &[&str]| {
        let log = OpenLog::open_csv(Box::new(Cursor::new(text.to_owned())), &by_topic)?.read(signals)?;
        log.samples_of_runs(&by_topic)
    };
    assert_eq!(open(topics, &["a/d"]).expect("two runs").len(), 2);
    let error = open(topics, &["a/d", "b/d"]).expect_err("other runs").to_string();
    assert!(error.contains("the topic `a` are 2 runs, which start again in line 6; "), "{error}");
    let both = open(&format!("{topics}0,b,1\n1,b,1\n"), &["a/d", "b/d"]).expect("two runs");
    assert_eq!(both.len(), 2);
}

#[test]
fn seconds_and_nanoseconds_in_two_columns_are_one_time() {
    let text = "header.stamp.sec,header.stamp.nanosec,d\n10,900000000,0\n11,100000000,3\n12,100000000,0\n";
    for time in ["header.stamp.sec", "header.stamp.nanosec", "header.stamp"] {
        let options = Options { time: Some(time.to_owned()), ..dense(HOLD) };
        let found = samples(text, &["d"], &options).expect("times");
        let Signals::Dense(signals) = found.signals else { panic!("dense") };
        // The decimals that are written, to the bit.
        assert_eq!(signals[0].times(), [10.9, 11.1, 12.1], "{time}");
    }
    let far = text.replace("\n1", "\n170000000");
    let options = Options { time: Some("header.stamp".to_owned()), ..dense(HOLD) };
    let found = samples(&far, &["d"], &options).expect("times");
    assert_eq!(found.origin_ns, Some(1_700_000_000_900_000_000));
    let Signals::Dense(signals) = found.signals else { panic!("dense") };
    assert_eq!(signals[0].times(), [0.0, 0.2, 1.2]);
    let milliseconds = Options { time_unit: Some(Unit::Milliseconds), ..options.clone() };
    asks(text, &milliseconds, Key::LOG_TIME_UNIT, "seconds and nanoseconds in two columns");
    for (row, part) in [
        (
            "10,1000000000,0",
            "line 2: `header.stamp.nanosec` is `1000000000`; what comes after whole seconds are integers from 0 to 999999999",
        ),
        ("10.5,0,0", "line 2: `header.stamp.sec` is 10.5; seconds with a rest in another column"),
        ("10,,0", "line 2: `header.stamp.nanosec` is ``"),
    ] {
        let text = format!("header.stamp.sec,header.stamp.nanosec,d\n{row}\n");
        let error = samples(&text, &["d"], &options).expect_err("no time").to_string();
        assert!(error.contains(part), "{error}");
    }
    // A time of some hours, or of a clock of the world, is as exact as one of the first seconds.
    for start in [0_u64, 3_601, 1_700_000_000] {
        let row = |row: u64| format!("{},{},0\n", start + row, 999_999_999 - row);
        let rows: String = (0..5_000).map(row).collect();
        let text = format!("header.stamp.sec,header.stamp.nanosec,d\n{rows}");
        let found = samples(&text, &["d"], &options).expect("times");
        let first = if found.origin_ns.is_some() { 0.0 } else { start as f64 + 0.999_999_999 };
        let Signals::Dense(signals) = found.signals else { panic!("dense") };
        for (row, time) in signals[0].times().iter().enumerate() {
            let expected = first + row as f64 * 0.999_999_999;
            assert!((time - expected).abs() <= 1e-11 * expected.max(1.0), "{start} {row}: {time}");
        }
    }
    // A row without a time is left out with the others.
    let dropped = Options { missing: Missing::Drop, ..options };
    let rows = text.replace("\n10,900000000,0", "\n10,,0");
    let found = samples(&rows, &["d"], &dropped).expect("times");
    let Signals::Dense(signals) = found.signals else { panic!("dense") };
    assert_eq!(signals[0].times(), [11.1, 12.1]);
}
