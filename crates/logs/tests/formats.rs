//! The same log in all formats gives the same samples, and damaged files end with a message.

use std::io::Write;
use std::path::{Path, PathBuf};

use crate::names;
use mishandle_logs::{Format, OpenLog, Options, Result, Samples, Signals, Source, Unit};
use mishandle_results::Key;

fn open(path: &Path, signals: &[&str], options: &Options) -> Result<Samples> {
    let source = Source { topic: None, path: path.to_owned() };
    OpenLog::open(&[source], options)?.read(signals)?.samples(options)
}

fn write(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("a file in a scratch folder");
    path
}

/// An array in version 1.0 of NumPy's format.
fn npy(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let mut header = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}");
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(data);
    bytes
}

/// A zip archive as `zipfile` of Python writes it for `numpy.savez` or `numpy.savez_compressed`.
fn npz(entries: &[(&str, Vec<u8>)], is_deflated: bool) -> Vec<u8> {
    let mut file = Vec::new();
    let mut directory = Vec::new();
    for (name, content) in entries {
        let stored = if is_deflated {
            let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::default());
            encoder.write_all(content).expect("memory");
            encoder.finish().expect("memory")
        } else {
            content.clone()
        };
        let method: u16 = if is_deflated { 8 } else { 0 };
        let mut common = Vec::new();
        common.extend([45, 0, 0, 0]);
        common.extend(method.to_le_bytes());
        common.extend([0; 8]);
        common.extend((stored.len() as u32).to_le_bytes());
        common.extend((content.len() as u32).to_le_bytes());
        common.extend((name.len() as u16).to_le_bytes());
        directory.extend(b"PK\x01\x02\x14\x00");
        directory.extend(&common);
        directory.extend([0; 12]);
        directory.extend((file.len() as u32).to_le_bytes());
        directory.extend(name.bytes());
        // numpy forces ZIP64 in the local header: an extra field of 20 bytes.
        file.extend(b"PK\x03\x04");
        file.extend(&common);
        file.extend(20_u16.to_le_bytes());
        file.extend(name.bytes());
        file.extend([1, 0, 16, 0]);
        file.extend([0; 16]);
        file.extend(stored);
    }
    let start = file.len() as u32;
    let size = directory.len() as u32;
    file.extend(&directory);
    file.extend(b"PK\x05\x06\0\0\0\0");
    file.extend((entries.len() as u16).to_le_bytes().repeat(2));
    file.extend(size.to_le_bytes());
    file.extend(start.to_le_bytes());
    file.extend([0, 0]);
    file
}

fn floats(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

#[cfg(feature = "parquet")]
const SNAPPY: parquet::basic::Compression = parquet::basic::Compression::SNAPPY;

#[cfg(feature = "parquet")]
fn parquet(path: &Path, compression: parquet::basic::Compression, times: &[f64], d: &[Option<f64>]) {
    use std::sync::Arc;

    use parquet::data_type::DoubleType;
    use parquet::file::properties::WriterProperties;
    use parquet::file::writer::SerializedFileWriter;
    use parquet::schema::parser::parse_message_type;

    let schema = parse_message_type(
        "message log { required double time; optional group pose { optional double d; } }",
    )
    .expect("a schema");
    let file = std::fs::File::create(path).expect("a file");
    let properties = WriterProperties::builder().set_compression(compression).build();
    let mut writer =
        SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties)).expect("a writer");
    let half = times.len() / 2;
    for rows in [0..half, half..times.len()] {
        let mut group = writer.next_row_group().expect("a group");
        let mut column = group.next_column().expect("time").expect("time");
        column.typed::<DoubleType>().write_batch(&times[rows.clone()], None, None).expect("times");
        column.close().expect("time");
        let mut column = group.next_column().expect("d").expect("d");
        let levels: Vec<i16> =
            d[rows.clone()].iter().map(|value| if value.is_some() { 2 } else { 1 }).collect();
        let values: Vec<f64> = d[rows].iter().flatten().copied().collect();
        column.typed::<DoubleType>().write_batch(&values, Some(&levels), None).expect("values");
        column.close().expect("d");
        group.close().expect("a group");
    }
    writer.close().expect("a file");
}

#[test]
fn a_log_in_all_formats_gives_the_same_samples() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let times: Vec<f64> = (0..301).map(|i| f64::from(i) / 30.0).collect();
    let d: Vec<f64> = (0..301).map(|i| f64::from(i * 7919 % 1000) / 997.0).collect();
    let rows = || times.iter().zip(&d);
    let csv: String = rows().map(|(time, d)| format!("{time},{d},text\n")).collect();
    let swapped: String = rows().map(|(time, d)| format!("text;{d};{time}\n").replace('.', ",")).collect();
    let json: String = rows()
        .map(|(time, d)| format!("{{\"pose\":{{\"d\":{d},\"name\":\"x\"}},\"time\":{time}}}\n"))
        .collect();
    let pairs: Vec<u8> = rows().flat_map(|(time, d)| floats(&[*time, *d])).collect();
    let arrays = [
        ("pose/d.npy", npy("'<f8'", "(301,)", &floats(&d))),
        ("other.npy", npy("'<f8'", "(2, 2)", &floats(&[0.0; 4]))),
        ("pickle.npy", npy("'|O'", "(1,)", b"....")),
        ("time.npy", npy("'<f8'", "(301,)", &floats(&times))),
    ];
    let mut files = vec![
        write(folder.path(), "a.csv", format!("time,pose/d,name\n{csv}").as_bytes()),
        write(folder.path(), "b.csv", format!("name;pose/d;time\n{swapped}").as_bytes()),
        write(folder.path(), "a.jsonl", json.as_bytes()),
        write(folder.path(), "log", json.as_bytes()),
        write(folder.path(), "a.npz", &npz(&arrays, false)),
        write(folder.path(), "b.npz", &npz(&arrays, true)),
        write(folder.path(), "a.npy", &npy("[('time', '<f8'), ('pose', [('d', '<f8')])]", "(301,)", &pairs)),
    ];
    if cfg!(feature = "parquet") {
        files.push(folder.path().join("a.parquet"));
        #[cfg(feature = "parquet")]
        parquet(&files[files.len() - 1], SNAPPY, &times, &d.iter().map(|d| Some(*d)).collect::<Vec<_>>());
    }
    for path in files {
        let found =
            open(&path, &["pose/d"], &Options::default()).unwrap_or_else(|error| panic!("{path:?}: {error}"));
        let Signals::Even { trace, period, .. } = found.signals else { panic!("even") };
        assert_eq!(trace.signal("pose/d").expect("read"), d, "{path:?}");
        assert_eq!(period, Some(1.0 / 30.0), "{path:?}");
    }
}

#[test]
fn integers_and_dates_of_binary_formats_are_exact() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let stamps: Vec<u8> = (0..3_i64).flat_map(|i| (1_700_000_000_000_000_000 + i).to_le_bytes()).collect();
    let arrays = |descr| {
        vec![
            ("time.npy", npy(descr, "(3,)", &stamps)),
            ("d.npy", npy("'>i2'", "(3,)", &[0, 1, 0, 2, 255, 255])),
        ]
    };
    let period = |found: Samples| match found.signals {
        Signals::Even { trace, period, .. } => (trace.signal("d").expect("read").to_vec(), period),
        Signals::Dense(_) => panic!("even"),
    };
    let dates = write(folder.path(), "dates.npz", &npz(&arrays("'<M8[ns]'"), true));
    let found = open(&dates, &["d"], &Options::default()).expect("dates");
    assert_eq!(period(found), (vec![1.0, 2.0, -1.0], Some(1e-9)));
    let integers = write(folder.path(), "integers.npz", &npz(&arrays("'<i8'"), true));
    let error = open(&integers, &["d"], &Options::default()).expect_err("no unit");
    assert!(names(&error, Key::LOG_TIME_UNIT), "{error}");
    assert!(error.to_string().starts_with("row 1: `time`"), "{error}");
    let unit = Options { time_unit: Some(Unit::Nanoseconds), ..Options::default() };
    assert_eq!(period(open(&integers, &["d"], &unit).expect("ns")).1, Some(1e-9));
    let json = "{\"time\":1700000000000000000,\"d\":1}\n{\"time\":1700000000000000001,\"d\":2}\n";
    let json = write(folder.path(), "integers.jsonl", json.as_bytes());
    assert_eq!(period(open(&json, &["d"], &unit).expect("ns")).1, Some(1e-9));
}

/// Opens a log as the program does, which checks the names first.
fn open_checked(path: &Path, signal: &str) -> Result<Samples> {
    let source = Source { topic: None, path: path.to_owned() };
    let log = OpenLog::open(&[source], &Options::default())?;
    log.check_signals(&mishandle_stl::Formula::parse(&mishandle_stl::spelled(signal)).expect("a name"))?;
    log.read(&[signal])?.samples(&Options::default())
}

#[test]
fn numbers_of_16_bits_are_read_and_other_types_are_named() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    // 0, -2 and 3 in 16 bits.
    let halves = [0x00, 0x00, 0x00, 0xc0, 0x00, 0x42];
    let arrays = [
        ("x.npy", npy("'<f2'", "(3,)", &halves)),
        ("text.npy", npy("'<U1'", "(3,)", &[48, 0, 0, 0, 48, 0, 0, 0, 51, 0, 0, 0])),
        ("complex.npy", npy("'<c16'", "(3, 1)", &[0; 48])),
        ("image.npy", npy("'<f8'", "(1, 2, 3)", &[0; 48])),
    ];
    let path = write(folder.path(), "half.npz", &npz(&arrays, false));
    let found = open_checked(&path, "x").expect("numbers of 16 bits");
    let Signals::Even { trace, .. } = found.signals else { panic!("even") };
    assert_eq!(trace.signal("x").expect("read"), [0.0, -2.0, 3.0]);
    for (signal, part) in [
        ("text", "the column `text` is not read: its values have the type <U1; write numbers"),
        ("complex[0]", "the column `complex` is not read: its values have the type <c16"),
        ("image", "the column `image` is not read: it has 3 dimensions"),
        ("other", "signal `other` is not in the trace"),
    ] {
        let error = open_checked(&path, signal).expect_err("not read").to_string();
        assert!(error.starts_with(part), "{error}");
    }
}

#[test]
#[cfg(feature = "parquet")]
fn numbers_of_16_bits_in_parquet_are_read_and_decimals_are_named() {
    use parquet::data_type::{FixedLenByteArrayType, Int64Type};
    use parquet::file::writer::SerializedFileWriter;
    use parquet::schema::parser::parse_message_type;

    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("half.parquet");
    let schema = "message log { required fixed_len_byte_array(2) x (FLOAT16); required int64 price (DECIMAL(10, 2)); }";
    let schema = std::sync::Arc::new(parse_message_type(schema).expect("a schema"));
    let file = std::fs::File::create(&path).expect("a file");
    let mut writer = SerializedFileWriter::new(file, schema, std::sync::Arc::default()).expect("a writer");
    let mut group = writer.next_row_group().expect("a group");
    let mut column = group.next_column().expect("x").expect("x");
    let values: Vec<_> = [[0x00, 0x00], [0x00, 0xc0], [0x00, 0x42]]
        .into_iter()
        .map(|bytes: [u8; 2]| parquet::data_type::FixedLenByteArray::from(bytes.to_vec()))
        .collect();
    column.typed::<FixedLenByteArrayType>().write_batch(&values, None, None).expect("values");
    column.close().expect("x");
    let mut column = group.next_column().expect("price").expect("price");
    column.typed::<Int64Type>().write_batch(&[1, 2, 3], None, None).expect("values");
    column.close().expect("price");
    group.close().expect("a group");
    writer.close().expect("a file");
    let found = open_checked(&path, "x").expect("numbers of 16 bits");
    let Signals::Even { trace, .. } = found.signals else { panic!("even") };
    assert_eq!(trace.signal("x").expect("read"), [0.0, -2.0, 3.0]);
    let error = open_checked(&path, "price").expect_err("decimals").to_string();
    assert!(error.starts_with("the column `price` is not read: its values have the type DECIMAL"), "{error}");
}

#[test]
fn seconds_and_nanoseconds_are_one_time_in_all_formats() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let integers =
        |values: [i64; 3]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let rows = [(10, 900_000_000), (11, 100_000_000), (11, 300_000_000)];
    let json: String = rows
        .iter()
        .map(|(sec, nanosec)| format!("{{\"stamp\":{{\"sec\":{sec},\"nanosec\":{nanosec}}},\"d\":1}}\n"))
        .collect();
    let csv: String = rows.iter().map(|(sec, nanosec)| format!("{sec};{nanosec};1\n")).collect();
    let arrays = [
        ("stamp/sec.npy", npy("'<i8'", "(3,)", &integers(rows.map(|row| row.0)))),
        ("stamp/nanosec.npy", npy("'<i8'", "(3,)", &integers(rows.map(|row| row.1)))),
        ("d.npy", npy("'<f8'", "(3,)", &floats(&[1.0; 3]))),
    ];
    let files = [
        write(folder.path(), "a.jsonl", json.as_bytes()),
        write(folder.path(), "a.csv", format!("stamp/sec;stamp/nanosec;d\n{csv}").as_bytes()),
        write(folder.path(), "a.npz", &npz(&arrays, true)),
    ];
    for path in files {
        let options = Options { time: Some("stamp/sec".to_owned()), ..Options::default() };
        let found = open(&path, &["d"], &options).unwrap_or_else(|error| panic!("{path:?}: {error}"));
        let Signals::Even { period, start, .. } = found.signals else { panic!("even") };
        assert_eq!((start, period), (10.9, Some(0.2)), "{path:?}");
    }
}

#[test]
#[cfg(feature = "parquet")]
fn nulls_of_parquet_are_missing_values() {
    use mishandle_logs::Missing;
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("a.parquet");
    parquet(&path, SNAPPY, &[0.0, 1.0, 2.0, 3.0], &[Some(1.0), None, None, Some(4.0)]);
    let error = open(&path, &["pose/d"], &Options::default()).expect_err("nulls");
    assert!(error.to_string().starts_with("row 2: `pose/d` is ``"), "{error}");
    let hold = Options { missing: Missing::Hold, ..Options::default() };
    let found = open(&path, &["pose/d"], &hold).expect("held");
    assert_eq!(found.missing, 2);
    let Signals::Even { trace, .. } = found.signals else { panic!("even") };
    assert_eq!(trace.signal("pose/d").expect("read"), [1.0, 1.0, 1.0, 4.0]);
}

#[test]
fn damaged_and_hostile_files_end_with_a_message() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let arrays = [
        ("time.npy", npy("'<f8'", "(3,)", &floats(&[0.0, 1.0, 2.0]))),
        ("d.npy", npy("'<f8'", "(3,)", &floats(&[0.0; 3]))),
    ];
    let mut whole =
        vec![("npz", npz(&arrays, true)), ("npz", npz(&arrays, false)), ("npy", arrays[0].1.clone())];
    #[cfg(feature = "parquet")]
    {
        let path = folder.path().join("whole.parquet");
        parquet(&path, SNAPPY, &[0.0, 1.0, 2.0], &[Some(1.0), None, Some(2.0)]);
        whole.push(("parquet", std::fs::read(path).expect("written above")));
    }
    for (ending, bytes) in whole {
        let name = format!("a.{ending}");
        for length in 0..bytes.len() {
            let path = write(folder.path(), &name, &bytes[..length]);
            let error = open(&path, &["d", "time"], &Options::default());
            assert!(error.is_err() || length > 0, "{name} of {length} bytes");
        }
        for at in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 0x55;
            let path = write(folder.path(), &name, &changed);
            // A changed number is not noticed; anything else is an error.
            let _result = open(&path, &["d", "time"], &Options::default());
        }
    }
    // A header that promises more rows than the file has takes no memory.
    let short = write(folder.path(), "a.npy", &npy("[('d', '<f8')]", "(99999999999,)", &[0; 16]));
    let error = open(&short, &["d"], &Options::default()).expect_err("truncated");
    assert!(error.to_string().contains("ends before the last row"), "{error}");
    // An entry that inflates to a thousand times its size is read up to the limit of the header.
    let bomb = npz(&[("d.npy", npy("'<f8'", "(2,)", &vec![0; 50_000_000]))], true);
    let bomb = write(folder.path(), "bomb.npz", &bomb);
    assert!(open(&bomb, &["d"], &Options::default()).is_ok());
    for (name, bytes, part) in [
        ("a.mcap", &b"\x89MCAP0\r\n"[..], "only the Python package reads"),
        ("a.bag", b"#ROSBAG V2.0\n", "only the Python package reads"),
        ("a.db3", b"SQLite format 3\0", "only the Python package reads"),
        ("a.csv.gz", &[0x1f, 0x8b, 8, 0], "gunzip"),
        ("a.json", b"[{\"d\":1}]", "one object per line"),
        ("a.npz", b"PK", "too short"),
    ] {
        let error = open(&write(folder.path(), name, bytes), &["d"], &Options::default()).expect_err(name);
        assert!(error.to_string().contains(part), "{name}: {error}");
    }
    let csv = write(folder.path(), "data.bin", b"d\n1\n");
    let options = Options { format: Some(Format::JsonLines), ..Options::default() };
    assert!(open(&csv, &["d"], &options).is_err());
    assert!(open(&csv, &["d"], &Options::default()).is_ok());
}

#[test]
fn files_are_topics_of_one_log() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let source = |topic: &str, text: &str| Source {
        topic: Some(topic.to_owned()),
        path: write(folder.path(), &format!("{}.csv", topic.replace('/', "_")), text.as_bytes()),
    };
    let arm = source("arm", "time,q\n0,1\n1,2\n");
    let hand = source("/hand", "time,q\n0,5\n1,6\n");
    let late = source("late", "time,q\n0.5,5\n1.5,6\n");
    let read = |sources: &[Source], signals: &[&str]| {
        OpenLog::open(sources, &Options::default())?.read(signals)?.samples(&Options::default())
    };
    for sources in [[arm.clone(), hand.clone()], [hand, arm.clone()]] {
        let found = read(&sources, &["arm/q", "/hand/q"]).expect("equal times");
        let Signals::Even { trace, .. } = found.signals else { panic!("even") };
        assert_eq!(trace.signal("arm/q").expect("read"), [1.0, 2.0]);
        assert_eq!(trace.signal("/hand/q").expect("read"), [5.0, 6.0]);
    }
    let error = read(&[arm, late], &["arm/q", "late/q"]).expect_err("other times");
    assert!(error.to_string().contains("the topics `arm` and `late` have different times"), "{error}");
}

#[test]
fn files_that_the_tools_of_users_wrote_give_the_samples_that_they_were_given() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let mut files: Vec<_> =
        std::fs::read_dir(&data).expect("files").map(|entry| entry.expect("a file").path()).collect();
    let is_log = |path: &PathBuf| path.extension().is_some_and(|ending| ending != "py");
    files.retain(|path| {
        is_log(path)
            && (cfg!(feature = "parquet") || path.extension().is_none_or(|ending| ending != "parquet"))
    });
    files.sort();
    assert!(files.len() >= 9, "{files:?}");
    for path in files {
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        let has_lists =
            ["polars", "pyarrow", "numpy.npz", "numpy_c"].iter().any(|tool| name.starts_with(tool));
        let signals: &[&str] = if has_lists { &["force", "q[1]", "q[0]"] } else { &["force"] };
        let found =
            open(&path, signals, &Options::default()).unwrap_or_else(|error| panic!("{name}: {error}"));
        let Signals::Even { trace, period: Some(period), .. } = found.signals else { panic!("{name}") };
        assert!((period - 0.1).abs() < 1e-12, "{name}: {period}");
        assert_eq!(trace.signal("force").expect("read"), [0.5, 1.5, 2.5, 1.0], "{name}");
        if has_lists {
            assert_eq!(trace.signal("q[0]").expect("read"), [1.0, 2.0, 3.0, 4.0], "{name}");
            assert_eq!(trace.signal("q[1]").expect("read"), [-1.0, -2.0, -3.0, -4.0], "{name}");
        }
        if name.starts_with("pyarrow") {
            open(&path, &["pose/position/x"], &Options::default())
                .unwrap_or_else(|error| panic!("{name}: {error}"));
        }
    }
}

#[cfg(feature = "parquet")]
#[test]
fn lists_of_other_lengths_have_missing_elements() {
    use std::sync::Arc;

    use mishandle_logs::Missing;
    use parquet::data_type::{DoubleType, Int64Type};
    use parquet::file::writer::SerializedFileWriter;
    use parquet::schema::parser::parse_message_type;

    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("a.parquet");
    let schema = "message log { required int64 n; optional group q (LIST) { repeated group list { optional double element; } } }";
    let schema = parse_message_type(schema).expect("a schema");
    let file = std::fs::File::create(&path).expect("a file");
    let mut writer = SerializedFileWriter::new(file, Arc::new(schema), Arc::default()).expect("a writer");
    let mut group = writer.next_row_group().expect("a group");
    let mut column = group.next_column().expect("n").expect("n");
    column.typed::<Int64Type>().write_batch(&[1, 2, 3, 4, 5], None, None).expect("values");
    column.close().expect("n");
    let mut column = group.next_column().expect("q").expect("q");
    // [1, 2], [], null, [3], [null, 4]
    let definitions = [3, 3, 1, 0, 3, 2, 3];
    let repetitions = [0, 1, 0, 0, 0, 0, 1];
    let values = [1.0, 2.0, 3.0, 4.0];
    column
        .typed::<DoubleType>()
        .write_batch(&values, Some(&definitions), Some(&repetitions))
        .expect("values");
    column.close().expect("q");
    group.close().expect("a group");
    writer.close().expect("a file");
    let hold = Options { missing: Missing::Hold, ..Options::default() };
    let found = open(&path, &["n", "q[0]"], &hold).expect("held");
    assert_eq!(found.missing, 3);
    let Signals::Even { trace, .. } = found.signals else { panic!("even") };
    assert_eq!(trace.signal("q[0]").expect("read"), [1.0, 1.0, 1.0, 3.0, 3.0]);
    let drop = Options { missing: Missing::Drop, ..Options::default() };
    let found = open(&path, &["n", "q[1]"], &drop).expect("dropped");
    let Signals::Even { trace, .. } = found.signals else { panic!("even") };
    assert_eq!(trace.signal("n").expect("read"), [1.0, 5.0]);
    assert_eq!(trace.signal("q[1]").expect("read"), [2.0, 4.0]);
    let error = open(&path, &["q[2]"], &Options::default()).expect_err("two elements");
    assert!(error.to_string().contains("q[2]"), "{error}");
}
