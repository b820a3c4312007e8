//! LeRobot data sets, read back with the reader of the crate `parquet`.

#![cfg(feature = "parquet")]
#![allow(clippy::unwrap_used)]

use std::fs::File;
use std::path::Path;

use mishandle_dataset::{Contents, Episode, Fact, Format, ImageColumn, VectorColumn};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::{Field, Row};
use serde_json::{Value, json};

/// Frames of the two episodes.
const FRAMES: [usize; 2] = [60, 41];

fn contents() -> Contents {
    let column = |name: &str, names: &[&str]| VectorColumn {
        name: name.to_string(),
        names: names.iter().map(ToString::to_string).collect(),
    };
    Contents {
        task: "Push the ball into the hole.".to_string(),
        robot: "panda".to_string(),
        dt: 0.05,
        vectors: vec![column("observation.state", &["x", "y"]), column("action", &["force"])],
        images: vec![ImageColumn { name: "observation.images.over".to_string(), width: 16, height: 8 }],
    }
}

/// Draws an image whose red channel has half of all values, whose green one is the frame, and whose
/// blue one is constant.
fn draw(column: usize, frame: usize, pixels: &mut [u8]) -> std::io::Result<()> {
    assert_eq!(column, 0);
    for (index, pixel) in pixels.chunks_exact_mut(3).enumerate() {
        pixel.copy_from_slice(&[(index + 128 * (frame % 2)) as u8, frame as u8, 7]);
    }
    Ok(())
}

/// Writes a data set whose observation x is 1, 2, … over all frames.
fn write(folder: &Path) {
    let mut writer = Format::LeRobot.writer(contents(), folder).unwrap();
    let mut first = 0;
    for (index, frames) in FRAMES.into_iter().enumerate() {
        let state = (0..frames).flat_map(|frame| [(first + frame + 1) as f32, -1.0]).collect();
        let action = (0..frames).map(|frame| frame as f32 / 8.0).collect();
        let facts = [
            ("seed".to_string(), Fact::Integer(u64::MAX - index as u64)),
            ("robustness".to_string(), Fact::Number(0.25)),
            ("end".to_string(), Fact::Text(format!("end {index}"))),
        ];
        let vectors = [state, action];
        let episode = Episode { frames, vectors: &vectors, is_success: index == 1, facts: &facts };
        writer.add(&episode, &mut draw).unwrap();
        first += frames;
    }
    writer.finish().unwrap();
}

fn reader(path: &Path) -> SerializedFileReader<File> {
    SerializedFileReader::new(File::open(path).unwrap()).unwrap()
}

fn rows(path: &Path) -> Vec<Row> {
    reader(path).get_row_iter(None).unwrap().map(Result::unwrap).collect()
}

fn document(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn field<'r>(row: &'r Row, name: &str) -> &'r Field {
    row.get_column_iter().find(|(column, _)| *column == name).unwrap().1
}

fn list(field: &Field) -> &[Field] {
    match field {
        Field::ListInternal(list) => list.elements(),
        other => panic!("expected a list, found {other}"),
    }
}

fn decoded(png: &[u8]) -> Vec<u8> {
    let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
    assert_eq!((reader.info().width, reader.info().height), (16, 8));
    let mut pixels = vec![0; 3 * 16 * 8];
    reader.next_frame(&mut pixels).unwrap();
    pixels
}

#[test]
fn each_frame_is_a_row_with_the_columns_of_the_features() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let path = folder.path().join("data/chunk-000/file-000.parquet");
    assert_eq!(reader(&path).num_row_groups(), 2, "one per episode");
    let rows = rows(&path);
    assert_eq!(rows.len(), 101);
    let info = document(&folder.path().join("meta/info.json"));
    let mut features: Vec<&String> = info["features"].as_object().unwrap().keys().collect();
    let mut names: Vec<&String> = rows[0].get_column_iter().map(|(name, _)| name).collect();
    features.sort();
    names.sort();
    assert_eq!(names, features);
    for (index, row) in rows.iter().enumerate() {
        let (episode, frame) = if index < 60 { (0, index) } else { (1, index - 60) };
        let state = list(field(row, "observation.state"));
        assert_eq!(state, [Field::Float(index as f32 + 1.0), Field::Float(-1.0)]);
        // One number is not a list.
        assert_eq!(*field(row, "action"), Field::Float(frame as f32 / 8.0));
        for (name, value) in [("index", index), ("episode_index", episode), ("frame_index", frame)] {
            assert_eq!(*field(row, name), Field::Long(value as i64), "{name}");
        }
        assert_eq!(*field(row, "task_index"), Field::Long(0));
        assert_eq!(*field(row, "timestamp"), Field::Float((frame as f64 / 20.0) as f32));
        let is_last = frame + 1 == FRAMES[episode];
        assert_eq!(*field(row, "next.done"), Field::Bool(is_last));
        assert_eq!(*field(row, "next.success"), Field::Bool(is_last && episode == 1));
        let Field::Group(image) = field(row, "observation.images.over") else { panic!("{row}") };
        assert_eq!(*field(image, "path"), Field::Null);
        let Field::Bytes(png) = field(image, "bytes") else { panic!("{image}") };
        let mut expected = vec![0; 3 * 16 * 8];
        draw(0, frame, &mut expected).unwrap();
        assert_eq!(decoded(png.data()), expected);
    }
}

#[test]
fn the_folder_meta_says_where_episodes_are_and_what_is_known_of_them() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let meta = folder.path().join("meta");
    let info = document(&meta.join("info.json"));
    assert_eq!(info["codebase_version"], "v3.0");
    assert_eq!([&info["fps"], &info["total_episodes"], &info["total_frames"]], [20, 2, 101]);
    assert_eq!(info["splits"]["train"], "0:2");
    assert_eq!(info["features"]["observation.images.over"]["shape"], json!([8, 16, 3]));
    let episodes = rows(&meta.join("episodes/chunk-000/file-000.parquet"));
    assert_eq!(episodes.len(), 2);
    for (index, (row, [from, to])) in episodes.iter().zip([[0, 60], [60, 101]]).enumerate() {
        assert_eq!(*field(row, "length"), Field::Long(to - from));
        assert_eq!(*field(row, "dataset_from_index"), Field::Long(from));
        assert_eq!(*field(row, "dataset_to_index"), Field::Long(to));
        assert_eq!(*field(row, "data/file_index"), Field::Long(0));
        assert_eq!(*field(row, "success"), Field::Bool(index == 1));
        assert_eq!(*field(row, "seed"), Field::ULong(u64::MAX - index as u64));
        assert_eq!(*field(row, "robustness"), Field::Double(0.25));
        assert_eq!(*field(row, "end"), Field::Str(format!("end {index}")));
        assert_eq!(list(field(row, "tasks")), [Field::Str(contents().task)]);
        // The numbers from + 1 to `to`.
        let statistic = |name: &str| list(field(row, &format!("stats/observation.state/{name}")));
        assert_eq!(statistic("min"), [Field::Double(from as f64 + 1.0), Field::Double(-1.0)]);
        assert_eq!(statistic("max"), [Field::Double(to as f64), Field::Double(-1.0)]);
        assert_eq!(statistic("q50")[0], Field::Double((from + to + 1) as f64 / 2.0));
        assert_eq!(statistic("count"), [Field::Long(to - from)]);
        assert_eq!(list(field(row, "stats/observation.images.over/max")).len(), 3);
    }
    let tasks = meta.join("tasks.parquet");
    assert_eq!(*field(&rows(&tasks)[0], "task"), Field::Str(contents().task));
    let tasks = reader(&tasks);
    let metadata = tasks.metadata().file_metadata().key_value_metadata().unwrap();
    let pandas = metadata.iter().find(|entry| entry.key == "pandas").unwrap();
    // Otherwise, pandas would not make the text the index.
    let pandas: Value = serde_json::from_str(pandas.value.as_ref().unwrap()).unwrap();
    assert_eq!(pandas["index_columns"], json!(["task"]));
    assert_eq!(std::fs::read_dir(meta).unwrap().count(), 4, "episodes, info, stats, tasks");
}

/// The numbers 1 to 101 have statistics in closed form.
#[test]
fn statistics_are_those_of_all_frames() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let statistics = document(&folder.path().join("meta/stats.json"));
    let state = &statistics["observation.state"];
    let number = |name: &str, index: usize| state[name][index].as_f64().unwrap();
    let quantiles = [("q01", 2.0), ("q10", 11.0), ("q50", 51.0), ("q90", 91.0), ("q99", 100.0)];
    for (name, expected) in [("min", 1.0), ("max", 101.0), ("mean", 51.0)].into_iter().chain(quantiles) {
        assert!((number(name, 0) - expected).abs() < 1e-12, "{name}: {}", number(name, 0));
        assert_eq!(number(name, 1), -1.0, "{name}");
    }
    // The variance of the uniform distribution of n integers is (n² - 1) / 12.
    assert!((number("std", 0).powi(2) - (101.0 * 101.0 - 1.0) / 12.0).abs() < 1e-9);
    assert_eq!(number("std", 1), 0.0);
    assert_eq!(state["count"], json!([101]));
    let image = &statistics["observation.images.over"];
    let channel = |name: &str, index: usize| image[name][index][0][0].as_f64().unwrap();
    // Red has all values, blue one.
    assert_eq!([channel("min", 0), channel("max", 0)], [0.0, 1.0]);
    for name in ["min", "max", "mean", "q01", "q50", "q99"] {
        assert!((channel(name, 2) - 7.0 / 255.0).abs() < 1e-12, "{name}");
    }
    assert_eq!(image["count"], json!([101]));
}

#[test]
fn a_fractional_rate_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let error = Format::LeRobot.writer(Contents { dt: 0.03, ..contents() }, folder.path()).err().unwrap();
    assert!(error.to_string().contains("whole number of frames per second"), "{error}");
}
