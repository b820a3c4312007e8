//! Logs in memory: the same times and verdicts as those of files with the same numbers.

use std::io::Cursor;

use crate::names;
use mishandle_logs::{Column, Log, Missing, OpenLog, Options, TimeValues, Times, Topic, Unit, tell_apart};
use mishandle_results::Key;

fn read_all(text: &str, options: &Options) -> (Log, Vec<(String, String)>) {
    let opened = OpenLog::open_csv(Box::new(Cursor::new(text.to_owned())), options).expect("a table");
    let (log, left_out) = opened.read_all().expect("rows");
    (log, left_out.into_iter().collect())
}

#[test]
fn nanoseconds_come_back_and_have_the_period_of_decimals() {
    // Thirds of a second with three decimals: even up to their rounding.
    let texts = ["0", "0.033", "0.067", "0.1", "0.133", "0.167", "0.2"];
    let csv = format!("time,d\n{}", texts.map(|time| format!("{time},1\n")).concat());
    let (log, _) = read_all(&csv, &Options::default());
    let times = log.topics[0].times.as_ref().expect("times");
    let found = times.to_nanoseconds().expect("nanoseconds");
    assert_eq!(found, [0, 33, 67, 100, 133, 167, 200].map(|ms| ms * 1_000_000));
    let again = Times::nanoseconds("time", &found);
    assert_eq!(again.secs(), times.secs());
    assert_eq!(again.period(None).expect("even"), Some(1.0 / 30.0));
    for times in
        [vec![i64::MAX - 5, i64::MAX], vec![i64::MIN + 1, i64::MIN + 2], vec![1_764_000_000_123_456_789]]
    {
        assert_eq!(Times::nanoseconds("time", &times).to_nanoseconds().expect("nanoseconds"), times);
    }
}

#[test]
fn values_in_memory_are_read_as_those_of_a_file() {
    let options = Options { time_unit: Some(Unit::Milliseconds), ..Options::default() };
    let (log, _) = read_all("time,d\n10,1\n30,1\n50,1\n", &options);
    let expected = log.topics[0].times.as_ref().expect("times").to_nanoseconds().expect("nanoseconds");
    let texts = ["10", "30", "50"].map(String::from);
    for values in [
        TimeValues::Numbers(&[10.0, 30.0, 50.0]),
        TimeValues::Integers(&[10, 30, 50]),
        TimeValues::Instants(&[10_000_000, 30_000_000, 50_000_000]),
        TimeValues::Texts(&texts),
    ] {
        let found = Times::of_values("time", values, &options).expect("times");
        assert_eq!(found.to_nanoseconds().expect("nanoseconds"), expected, "{values:?}");
    }
    for (values, options, key) in [
        (TimeValues::Numbers(&[1e12]), Options::default(), Key::LOG_TIME_UNIT),
        (TimeValues::Numbers(&[f64::NAN]), Options::default(), Key::LOG_MISSING),
        (TimeValues::Instants(&[i64::MIN]), Options::default(), Key::LOG_MISSING),
    ] {
        let error = Times::of_values("time", values, &options).expect_err("undecided");
        assert!(names(&error, key), "{values:?}");
    }
    let column = |values: &[f64]| Column { name: "d".to_owned(), values: values.to_vec() };
    let times = || Some(Times::nanoseconds("time", &[0, 1]));
    let error = Topic::of_values(None, times(), vec![column(&[1.0])]).expect_err("another length");
    assert!(error.to_string().contains("`d` has 1 values, but the topic has 2 rows"), "{error}");
    let topic = Topic::of_values(None, times(), vec![column(&[1.0, f64::INFINITY])]).expect("a topic");
    let error = Log { topics: vec![topic], likely_time: None }.samples(&Options::default());
    assert!(names(&error.expect_err("no number"), Key::LOG_MISSING));
}

#[test]
fn a_whole_table_has_its_numbers_and_says_what_is_left_out() {
    let text = "time,a,name,a,b\n0,1,x,1,1\n1,2,y,2,\n";
    let (log, left_out) = read_all(text, &Options::default());
    let names: Vec<&str> = log.topics[0].columns.iter().map(|column| column.name.as_str()).collect();
    assert_eq!(names, ["b"]);
    assert!(log.topics[0].columns[0].values[1].is_nan());
    let reason = |name: &str| left_out.iter().find(|(column, _)| column == name).map(|(_, reason)| &**reason);
    assert_eq!(reason("name"), Some("it has no numbers"));
    assert_eq!(reason("a"), Some("two columns have its name"));
    // Every row needs a time, also where values may be missing.
    let options = Options { missing: Missing::Hold, ..Options::default() };
    let opened = OpenLog::open_csv(Box::new(Cursor::new("time,a\n,1\n")), &options).expect("a table");
    assert!(opened.read_all().expect_err("no time").to_string().contains("every row needs a finite time"));
}

#[test]
fn logs_of_one_name_are_numbered() {
    let mut names = ["a", "b", "a", "a (1)"].map(String::from);
    tell_apart(&mut names);
    assert_eq!(names[1], "b");
    let mut distinct = names.to_vec();
    distinct.sort();
    distinct.dedup();
    assert_eq!(distinct.len(), 4, "{names:?}");
    assert!(names[2].starts_with("a ("), "{names:?}");
}
