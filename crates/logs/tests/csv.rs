//! CSV files: the dialects of other programs, and messages with lines.

use crate::names;
use crate::processor_time::processor_secs;
use std::io::{self, Read};

use mishandle_logs::{LogError, OpenLog, Options, Result, Samples, Signals};
use mishandle_results::Key;
use mishandle_stl::Formula;

fn samples_of(source: impl Read + 'static, signal: &str, options: &Options) -> Result<Samples> {
    let log = OpenLog::open_csv(Box::new(source), options)?;
    log.check_signals(&Formula::parse(&mishandle_stl::spelled(signal)).expect("a name"))?;
    log.read(&[signal])?.samples(options)
}

fn read(text: &[u8], signal: &str, options: &Options) -> Result<(Vec<f64>, Option<f64>)> {
    let samples = samples_of(io::Cursor::new(text.to_vec()), signal, options)?;
    let Signals::Even { trace, period, .. } = samples.signals else { panic!("samples are even") };
    Ok((trace.signal(signal).expect("the signal").to_vec(), period))
}

fn column(text: &str, name: &str) -> Vec<f64> {
    read(text.as_bytes(), name, &Options::default()).unwrap_or_else(|error| panic!("{text:?}: {error}")).0
}

#[track_caller]
fn check(text: &str, message: &str) {
    check_with(text, &Options::default(), message, None);
}

#[track_caller]
fn check_with(text: &str, options: &Options, message: &str, key: Option<Key>) {
    let error = read(text.as_bytes(), "d", options).expect_err("an error");
    assert!(error.to_string().contains(message), "{text:?}: {error}");
    if let Some(key) = key {
        assert!(names(&error, key), "{error}");
    }
    assert!(error.to_string().lines().count() <= 2, "{error}");
}

#[test]
fn line_ends_quotes_spaces_and_a_byte_order_mark_do_not_change_the_values() {
    for text in [
        "d\n1\n2.5\n",
        "d\n1\n2.5",
        "d\r\n1\r\n2.5\r\n",
        "\u{feff}d\n1\n2.5\n",
        "\"d\"\n\"1\"\n\"2.5\"\n",
        " d \n 1\n2.5 \n",
        "\nd\n1\n2.5\n",
        "d,\n\n1,\n\n2.5,\n\n",
        "e,d\n,1\ntext,2.5\n",
        "\"e\n,\",d\n\"a,\n\"\"b\"\"\",1\nc,2.5\n",
    ] {
        assert_eq!(column(text, "d"), [1.0, 2.5], "{text:?}");
    }
}

#[test]
fn dialects_of_other_programs_give_the_same_values() {
    for (text, source) in [
        ("time;d\r\n0;1\r\n0,5;2,5\r\n", "Excel with German settings"),
        ("sep=;\r\ntime;d\r\n0;1\r\n0,5;2,5\r\n", "Excel with a line for itself"),
        ("time\td\n0\t1\n0.5\t2.5\n", "tab-separated values"),
        (",time,d\n0,0.0,1.0\n1,0.5,2.5\n", "pandas.DataFrame.to_csv with its index"),
        ("# time d\n0.0e+00 1.0e+00\n5.0e-01 2.5e+00\n", "numpy.savetxt(header='time d')"),
        ("# written by rig 3\n# time,d\n0,1\n0.5,2.5\n", "numpy.savetxt(delimiter=',') with a comment"),
        ("% rig 3\ntime,d\n0,1\n% paused\n0.5,2.5\n", "MATLAB with comments"),
        ("  time   d\n   0   1\n 0.5 2.5\n", "columns of spaces"),
        ("time,d\n0,true\n0.5,2.5\n", "a truth value"),
        ("%time,d\n1700000000000000000,1\n1700000000500000000,2.5\n", "rostopic echo -p"),
        ("time,d\n2024-01-31T12:00:00.000Z,1\n2024-01-31T13:00:00.500+01:00,2.5\n", "RFC 3339"),
        ("time,d\n0 sec,1\n0.5 sec,2.5\n", "writetimetable of MATLAB"),
        ("time,d\n00:00:59.5,1\n00:01:00.0,2.5\n", "durations"),
    ] {
        let (values, period) = read(text.as_bytes(), "d", &Options::default())
            .unwrap_or_else(|error| panic!("{source}: {error}"));
        assert_eq!((values[1], values.len(), period), (2.5, 2, Some(0.5)), "{source}");
    }
    // "Unicode text" of Excel is UTF-16 with tabs.
    let unicode: Vec<u8> =
        "\u{feff}time\td\r\n0\t1\r\n0,5\t2,5\r\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let (values, period) = read(&unicode, "d", &Options::default()).expect("UTF-16");
    assert_eq!((values, period), (vec![1.0, 2.5], Some(0.5)));
}

#[test]
fn comments_between_rows_are_skipped_and_no_row_is_one() {
    for text in [
        "time,d\n0,1\n# a pause\n0.5,2.5\n",
        "time,d\n0,1\n# paused at 3, then on\n0.5,2.5\n",
        "time,d\n0,1\n0.5,2.5\n# end of file\n",
        "time,d\n0,1\n#0.2,7\n0.5,2.5\n",
        "time,d\r\n0,1\r\n% pause\r\n0.5,2.5\r\n",
        "# rig \"3\"\ntime;d\n0;1\n  # it's \"on\n0,5;2,5\n",
        "time d\n0 1\n# a pause of two\n0.5 2.5\n",
    ] {
        let (values, period) = read(text.as_bytes(), "d", &Options::default())
            .unwrap_or_else(|error| panic!("{text:?}: {error}"));
        assert_eq!((values, period), (vec![1.0, 2.5], Some(0.5)), "{text:?}");
    }
    assert_eq!(column("d\n1\n# a pause\n2\n", "d"), [1.0, 2.0]);
    check("d\n1\n# a pause\n\n2\n", "line 4 is blank");
    // A first cell can start with the mark, and a quote can hide the rows after it.
    check("color,d\nred,1\n#ff0000,5\n", "line 3 starts with #, as a comment, but has the cells of a row");
    check(
        "time,d\n0,1\n# a,\"b\n1,5\n",
        "starts with #, as a comment, but a quote in it opens a cell of several lines",
    );
}

#[test]
fn a_message_has_the_instant_of_a_date_whatever_its_distance_from_the_first() {
    for secs in 1..60 {
        let text = format!("time,d\n2024-01-31T12:00:00Z,1\n2024-01-31T11:00:{secs:02}Z,2\n");
        // 1706702400 is 2024-01-31T12:00:00Z.
        check(&text, &format!("it is 1706702400 and then {} in", 1_706_698_800 + secs));
    }
}

/// A quote that is never closed would swallow the rows after it.
#[test]
fn an_open_quote_is_an_error_with_its_line() {
    check("time,d\n0,1\n1,\"2\n2,3\n", "line 3 has a quote (\") that is not closed");
    check("time,d\n0,1\n\n1,\"2\n2,3", "line 4 has a quote (\") that is not closed");
    check("time,d,note\r\n0,1,a\r\n1,2,\"b\r\n", "line 3 has a quote (\") that is not closed");
    assert_eq!(column("time,note,d\n0,\"a\n\",1\n1,\"\n\",\"2\"", "d"), [1.0, 2.0]);
    assert_eq!(column("time,d,note\n0,1,\"a\n\"\n1,2,\"b\n\"\n", "d"), [1.0, 2.0]);
}

#[test]
fn a_dialect_with_two_readings_is_an_error_that_names_the_setting() {
    let options = Options::default();
    check_with(
        "time,d;e\n0,1;2\n",
        &options,
        "separated by commas or by semicolons",
        Some(Key::LOG_DELIMITER),
    );
    let stated = Options { delimiter: Some(';'), ..Options::default() };
    assert_eq!(read(b"time,e;d\n0,1;2\n", "d", &stated).expect("stated").0, [2.0]);
    check_with(
        "e;d\n1;0.5\n1;1,234\n",
        &options,
        "line 3: `1,234` has a decimal comma",
        Some(Key::LOG_DECIMAL),
    );
    // With commas between cells, a decimal comma must be stated.
    check("e,d\n1,\"0,5\"\n", "line 2: `d` is `0,5`");
    let comma = Options { decimal_comma: Some(true), ..Options::default() };
    assert_eq!(read(b"e,d\n1,\"0,5\"\n", "d", &comma).expect("stated").0, [0.5]);
    check("0,1\n0.5,2\n", "line 1 has 2 numbers where the names of the signals must be");
}

#[test]
fn only_the_columns_that_are_read_must_be_numbers() {
    assert_eq!(column("a,d,time,e\n1,2,0,4\n5,6,0.5,x\n", "d"), [2.0, 6.0]);
    assert_eq!(column("time,d\n0,2\n0.5,6\n", "time"), [0.0, 0.5]);
    for text in ["d,,e\n1,,3\n", ",d\n0,1\n", "d,e,e\n1,2,3\n", "x,d,x,,\n,1,,,\n", "time,d,\n0,1,\n"] {
        assert_eq!(column(text, "d"), [1.0], "{text:?}");
    }
    // A column without a name can be read, too.
    assert_eq!(column(",d\n7,1\n", ""), [7.0]);
    assert_eq!(read(b"d,\xff\n1,2\n", "d", &Options::default()).expect("a name of bytes").0, [1.0]);
}

#[test]
fn a_row_without_end_is_an_error() {
    let error = |source: Box<dyn Read>| samples_of(source, "d", &Options::default()).expect_err("an error");
    let zeros = error(Box::new(io::repeat(0))).to_string();
    assert!(zeros.contains("more than 16 MiB"), "{zeros}");
    // A quoted cell contains any number of lines.
    let quoted = error(Box::new("d\n1\n\"".as_bytes().chain(io::repeat(b'\n')))).to_string();
    assert!(quoted.contains("more than 16 MiB"), "{quoted}");
    let comments = error(Box::new(io::repeat(b'#'))).to_string();
    assert!(comments.contains("more than 16 MiB"), "{comments}");
    // The header and the first row together may be longer, and so may many rows.
    let wide = "a".repeat(9 << 20);
    assert_eq!(column(&format!("d,{wide}\n1,{wide}\n"), "d"), [1.0]);
    let long = format!("d\n{}", "1234567890.5\n".repeat(2_000_000));
    assert_eq!(column(&long, "d").len(), 2_000_000);
}

#[test]
fn malformed_files_are_errors_with_their_line() {
    check("", "the file is empty");
    check("# a comment\n", "comments, but no samples");
    check("d\n", "no samples");
    check("d\n1\nx\n", "line 3: `d` is `x`; it must be a number such as 0.25");
    // A quoted cell may contain line ends.
    check("e,d\n\"a\nb\",1\nc,x\n", "line 4: `d` is `x`");
    check("d,e\n\n", "no samples");
    check("d,e\n1,2\n3\n", "line 3 has 1 cell, but the header has 2 names");
    check("d\n1,2\n", "line 2 has 2 cells, but the header has 1 name;");
    for text in [
        "d,\n\n\n1,\n\nx,\n",
        "d,\n\n\n1,\n\nx,",
        "\nd,\n\n1,\n\nx,\n",
        "d,\r\n\r\n\r\n1,\r\n\r\nx,\r\n",
        "d\n1\n2\n3\n4\nx",
        "# a\n# b\nd,e\n# c\n1,2\nx,2\n",
    ] {
        check(text, "line 6: `d` is `x`; it must be a number");
    }
    check("d\n1\n \n2\n", "line 3: `d` is ``");
    check("d\n1\n\"\"\n2\n", "line 3: `d` is ``");
    check("time,d\n0,1\n\n\n\nnan,1\n", "line 6: `time` is `nan`");
    check("time,d\r\n0,1\r\n\r\n\r\n\r\n1\r\n", "line 6 has 1 cell, but the header has 2 names");
    check(&format!("d\n{}x\n", "1".repeat(300)), "...`; it must be");
}

#[test]
fn a_column_that_is_read_has_a_name_of_its_own() {
    check("d,e,d\n1,2,3\n", "two columns are named `d`: 1 and 3; rename one");
    check("time,d,time\n1,2,3\n", "two columns are named `time`: 1 and 3");
    let error = read(b"d,,\n1,2,3\n", "", &Options::default()).expect_err("two columns");
    assert!(error.to_string().contains("two columns are named ``: 2 and 3"), "{error}");
    let error = read(b"d,gr\xf6\xdfe\n1,2\n", "größe", &Options::default()).expect_err("Latin-1");
    assert!(
        error.to_string().contains("the name of column 2 is not UTF-8 text; save the file as UTF-8"),
        "{error}"
    );
    assert!(matches!(read(b"d\n1\n", "x", &Options::default()), Err(LogError::Formula(_))));
}

#[test]
fn a_blank_line_of_a_log_with_one_column_is_a_missing_sample() {
    for text in ["d\n\n1\n", "d\r\n\r\n1\r\n", "d\n\n\n1", "d\r\n\r\n"] {
        check(text, "line 2 is blank, so `d` lacks a number");
    }
    for text in ["d\n1\n\n2\n", "d\n1\n\n", "d\r\n1\r\n\r\n2", "d\r\n1\r\n\r\n", "d\n1\n\n\n2\n"] {
        check(text, "line 3 is blank, so `d` lacks a number there; write one, or remove the line");
    }
}

#[test]
fn many_columns_are_read_in_linear_time() {
    let header: Vec<String> = (0..1_000_000).map(|i| format!("s{i}")).collect();
    let row = vec!["1.5"; 1_000_000].join(",");
    let text = format!("{}\n{row}\n{row}\n", header.join(","));
    let started = processor_secs();
    assert_eq!(column(&text, "s999999"), [1.5, 1.5]);
    // Comparing all pairs of names takes 500 billion comparisons.
    assert!(processor_secs() - started < 20.0, "{} s", processor_secs() - started);
}

#[test]
fn bytes_that_are_no_text_end_with_a_message() {
    for text in [
        &b"\0\0\0\0"[..],
        b"d\n\0\n",
        b"d,e\n1,\0\0\xff\n",
        b"\xff\xfe",
        b"\xff\xfed",
        b"\"",
        b"sep=",
        b"%",
        b"\r",
    ] {
        if let Err(error) = read(text, "d", &Options::default()) {
            assert!(!error.to_string().contains('\0'), "{error:?}");
        }
    }
}
