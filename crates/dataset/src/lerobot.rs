//! LeRobot data sets of version 3.0.
//!
//! Numbers and PNG images of frames are in `data/chunk-*/file-*.parquet`, one row group per
//! episode; `meta` describes them. There are no videos, so that images lose nothing.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use parquet::data_type::ByteArray;
use parquet::file::metadata::KeyValue;
use serde_json::{Map, Value, json};

use crate::statistics::{ImageCounts, Statistics};
use crate::table::{Column, Columns, Table};
use crate::{Contents, Draw, Episode, Fact, Writer, frames_per_second};

/// Version of the format.
const VERSION: &str = "v3.0";

/// Size from which on the next episode begins a new file, MB.
const FILE_SIZE: usize = 100;

/// Number of files in a folder.
const FILES: usize = 1000;

/// Columns that every data set has after its own, with their types.
const EVERY: [(&str, &str); 7] = [
    ("next.success", "bool"),
    ("next.done", "bool"),
    ("timestamp", "float32"),
    ("frame_index", "int64"),
    ("episode_index", "int64"),
    ("index", "int64"),
    ("task_index", "int64"),
];

/// A written episode.
struct Written {
    frames: usize,
    /// Number of its file, from 0 over all folders.
    file: usize,
    is_success: bool,
    facts: Vec<(String, Fact)>,
    /// Statistics of its frames, by feature.
    statistics: Vec<(String, Statistics)>,
}

/// Writes a data set. The numbers of all frames stay in memory for the statistics, images do not.
pub(crate) struct LeRobotWriter {
    contents: Contents,
    rate: u32,
    folder: PathBuf,
    table: Option<Table>,
    file: usize,
    vectors: Vec<Vec<f32>>,
    images: Vec<ImageCounts>,
    episodes: Vec<Written>,
}

impl LeRobotWriter {
    pub(crate) fn new(contents: Contents, folder: &Path) -> io::Result<LeRobotWriter> {
        let rate = frames_per_second(contents.dt).ok_or_else(|| {
            let rate = 1.0 / contents.dt;
            io::Error::other(format!("LeRobot needs a whole number of frames per second, not {rate}"))
        })?;
        Ok(LeRobotWriter {
            rate,
            folder: folder.to_path_buf(),
            table: None,
            file: 0,
            vectors: vec![Vec::new(); contents.vectors.len()],
            images: contents.images.iter().map(|_| ImageCounts::NONE).collect(),
            contents,
            episodes: Vec::new(),
        })
    }

    fn frames(&self) -> usize {
        self.episodes.iter().map(|episode| episode.frames).sum()
    }

    /// Returns the values of the columns [`EVERY`] of an episode.
    fn every(&self, index: usize, first: usize, frames: usize, is_success: bool) -> [Vec<f64>; 7] {
        let of = |value: &dyn Fn(usize) -> f64| (0..frames).map(value).collect();
        let is_last = |frame: usize| frame + 1 == frames;
        [
            of(&|frame| f64::from(is_last(frame) && is_success)),
            of(&|frame| f64::from(is_last(frame))),
            of(&|frame| f64::from((frame as f64 / f64::from(self.rate)) as f32)),
            of(&|frame| frame as f64),
            of(&|_| index as f64),
            of(&|frame| (first + frame) as f64),
            of(&|_| 0.0),
        ]
    }

    fn path(&self, of: &str, file: usize) -> io::Result<PathBuf> {
        let folder = self.folder.join(of).join(format!("chunk-{:03}", file / FILES));
        fs::create_dir_all(&folder)?;
        Ok(folder.join(format!("file-{:03}.parquet", file % FILES)))
    }

    fn information(&self) -> Value {
        let mut features = Map::new();
        for column in &self.contents.vectors {
            let shape = [column.names.len()];
            let feature = json!({"dtype": "float32", "shape": shape, "names": column.names});
            features.insert(column.name.clone(), feature);
        }
        for column in &self.contents.images {
            let shape = [column.height, column.width, 3];
            let names = ["height", "width", "channels"];
            let feature = json!({"dtype": "image", "shape": shape, "names": names});
            features.insert(column.name.clone(), feature);
        }
        for (name, kind) in EVERY {
            features.insert(name.to_string(), json!({"dtype": kind, "shape": [1], "names": null}));
        }
        json!({
            "codebase_version": VERSION,
            "robot_type": self.contents.robot,
            "total_episodes": self.episodes.len(),
            "total_frames": self.frames(),
            "total_tasks": 1,
            "chunks_size": FILES,
            "data_files_size_in_mb": FILE_SIZE,
            "video_files_size_in_mb": 200,
            "fps": self.rate,
            "splits": {"train": format!("0:{}", self.episodes.len())},
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": null,
            "features": features,
        })
    }

    /// Returns the statistics of frames, by feature.
    fn statistics(
        &self,
        vectors: &[Vec<f32>],
        images: &[ImageCounts],
        every: &[Vec<f64>; 7],
    ) -> Vec<(String, Statistics)> {
        let Contents { vectors: columns, images: drawn, .. } = &self.contents;
        let of_vectors = columns.iter().zip(vectors).map(|(column, values)| {
            (column.name.clone(), Statistics::of_vectors(values, column.names.len()))
        });
        let of_images = drawn.iter().zip(images);
        let of_images = of_images.map(|(column, counts)| (column.name.clone(), counts.statistics()));
        let of_every = EVERY.iter().zip(every);
        let of_every = of_every.map(|((name, _), values)| (name.to_string(), Statistics::of_column(values)));
        of_vectors.chain(of_images).chain(of_every).collect()
    }

    /// Returns the statistics of all frames, as LeRobot's file has them.
    fn all_statistics(&self) -> Value {
        let mut every: [Vec<f64>; 7] = Default::default();
        let mut first = 0;
        for (index, Written { frames, is_success, .. }) in self.episodes.iter().enumerate() {
            let values = self.every(index, first, *frames, *is_success);
            every.iter_mut().zip(values).for_each(|(all, values)| all.extend(values));
            first += frames;
        }
        let statistics = self.statistics(&self.vectors, &self.images, &every);
        Value::Object(statistics.iter().map(|(name, found)| (name.clone(), found.document())).collect())
    }

    fn episode_columns(&self) -> Columns<'static> {
        let integers = |value: &dyn Fn(usize, &Written) -> usize| {
            let values = self.episodes.iter().enumerate();
            Column::Integers(values.map(|(index, episode)| value(index, episode) as i64).collect())
        };
        let starts: Vec<usize> = self
            .episodes
            .iter()
            .scan(0, |end, episode| {
                *end += episode.frames;
                Some(*end - episode.frames)
            })
            .collect();
        let tasks = vec![ByteArray::from(self.contents.task.as_str()); self.episodes.len()];
        let mut columns = vec![
            ("episode_index".to_string(), integers(&|index, _| index)),
            ("tasks".to_string(), Column::TextLists(tasks)),
            ("length".to_string(), integers(&|_, episode| episode.frames)),
            ("data/chunk_index".to_string(), integers(&|_, episode| episode.file / FILES)),
            ("data/file_index".to_string(), integers(&|_, episode| episode.file % FILES)),
            ("dataset_from_index".to_string(), integers(&|index, _| starts[index])),
            ("dataset_to_index".to_string(), integers(&|index, episode| starts[index] + episode.frames)),
            ("meta/episodes/chunk_index".to_string(), integers(&|_, _| 0)),
            ("meta/episodes/file_index".to_string(), integers(&|_, _| 0)),
            (
                "success".to_string(),
                Column::Flags(self.episodes.iter().map(|episode| episode.is_success).collect()),
            ),
        ];
        let names = self.episodes.first().map_or(&[][..], |episode| &episode.facts);
        columns.extend(names.iter().enumerate().map(|(place, (name, first))| {
            let facts = self.episodes.iter().map(|episode| &episode.facts[place].1);
            (name.clone(), fact_column(first, facts))
        }));
        columns.extend(self.statistics_columns());
        columns
    }

    /// Returns the statistics of each episode, which LeRobot's tools merge.
    fn statistics_columns(&self) -> Columns<'static> {
        let mut columns = Vec::new();
        let features = self.episodes.first().map_or(&[][..], |episode| &episode.statistics);
        for (place, (feature, first)) in features.iter().enumerate() {
            let of_episodes = || self.episodes.iter().map(|episode| &episode.statistics[place].1);
            for (statistic, (name, values)) in first.values().enumerate() {
                let all = of_episodes().filter_map(|found| found.values().nth(statistic));
                let all = all.flat_map(|(_, values)| values).collect();
                columns.push((format!("stats/{feature}/{name}"), Column::DoubleLists(all, values.len())));
            }
            let counts = of_episodes().map(|found| found.count() as i64).collect();
            columns.push((format!("stats/{feature}/count"), Column::IntegerLists(counts)));
        }
        columns
    }

    /// Writes the table of tasks: one row, whose index in pandas is the text.
    fn write_tasks(&self) -> io::Result<()> {
        let columns = vec![
            ("task_index".to_string(), Column::Integers(vec![0])),
            ("task".to_string(), Column::Texts(vec![ByteArray::from(self.contents.task.as_str())])),
        ];
        let column = |name: &str, kind: &str, numpy: &str| {
            json!({
                "name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": null,
            })
        };
        let pandas = json!({
            "index_columns": ["task"],
            "column_indexes": [{
                "name": null, "field_name": null, "pandas_type": "unicode", "numpy_type": "object",
                "metadata": {"encoding": "UTF-8"},
            }],
            "columns": [column("task_index", "int64", "int64"), column("task", "unicode", "object")],
            "creator": {"library": "mishandle", "version": env!("CARGO_PKG_VERSION")},
            "pandas_version": "2.0.0",
        });
        let metadata = KeyValue::new("pandas".to_string(), pandas.to_string());
        let mut table = Table::create(&self.folder.join("meta/tasks.parquet"), &columns, Some(metadata))?;
        table.write(&columns)?;
        table.close()
    }
}

impl Writer for LeRobotWriter {
    fn add(&mut self, episode: &Episode<'_>, draw: Draw<'_>) -> io::Result<()> {
        let index = self.episodes.len();
        let first = self.frames();
        let mut columns: Columns<'_> = Vec::new();
        for (column, values) in self.contents.vectors.iter().zip(episode.vectors) {
            let values = match column.names.len() {
                // LeRobot reads a vector of one number as a number.
                1 => Column::Floats(values.clone()),
                size => Column::Vectors(values, size),
            };
            columns.push((column.name.clone(), values));
        }
        let mut images = Vec::new();
        for (place, column) in self.contents.images.iter().enumerate() {
            let mut counts = ImageCounts::NONE;
            let mut pixels = vec![0; column.bytes()];
            let mut files = Vec::with_capacity(episode.frames);
            for frame in 0..episode.frames {
                draw(place, frame, &mut pixels)?;
                counts.add(&pixels);
                files.push(ByteArray::from(png(column.width, column.height, &pixels)?));
            }
            columns.push((column.name.clone(), Column::Images(files)));
            images.push(counts);
        }
        let every = self.every(index, first, episode.frames, episode.is_success);
        for ((name, kind), values) in EVERY.iter().zip(&every) {
            let column = match *kind {
                "bool" => Column::Flags(values.iter().map(|value| *value > 0.0).collect()),
                "float32" => Column::Floats(values.iter().map(|value| *value as f32).collect()),
                _ => Column::Integers(values.iter().map(|value| *value as i64).collect()),
            };
            columns.push(((*name).to_string(), column));
        }
        if self.table.as_ref().is_some_and(|table| table.size() >= FILE_SIZE << 20) {
            self.table.take().map_or(Ok(()), Table::close)?;
            self.file += 1;
        }
        let mut table = match self.table.take() {
            Some(table) => table,
            None => Table::create(&self.path("data", self.file)?, &columns, None)?,
        };
        table.write(&columns)?;
        self.table = Some(table);
        for (all, values) in self.vectors.iter_mut().zip(episode.vectors) {
            all.extend(values);
        }
        self.images.iter_mut().zip(&images).for_each(|(all, counts)| all.merge(counts));
        let statistics = self.statistics(episode.vectors, &images, &every);
        let Episode { frames, is_success, facts, .. } = *episode;
        let facts = facts.to_vec();
        self.episodes.push(Written { frames, file: self.file, is_success, facts, statistics });
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.table.take().map_or(Ok(()), Table::close)?;
        let columns = self.episode_columns();
        let mut table = Table::create(&self.path("meta/episodes", 0)?, &columns, None)?;
        table.write(&columns)?;
        table.close()?;
        self.write_tasks()?;
        let meta = self.folder.join("meta");
        fs::write(meta.join("stats.json"), format!("{:#}\n", self.all_statistics()))?;
        fs::write(meta.join("info.json"), format!("{:#}\n", self.information()))
    }
}

/// Returns the column of a fact of all episodes. Its type is that of the first one.
fn fact_column<'f>(first: &Fact, facts: impl Iterator<Item = &'f Fact>) -> Column<'static> {
    let number = |fact: &Fact| match fact {
        Fact::Number(number) => *number,
        Fact::Integer(_) | Fact::Text(_) => f64::NAN,
    };
    let integer = |fact: &Fact| match fact {
        Fact::Integer(value) => value.cast_signed(),
        Fact::Number(_) | Fact::Text(_) => 0,
    };
    let text = |fact: &Fact| match fact {
        Fact::Text(text) => ByteArray::from(text.as_str()),
        Fact::Integer(_) | Fact::Number(_) => ByteArray::new(),
    };
    match first {
        Fact::Number(_) => Column::Doubles(facts.map(number).collect()),
        Fact::Integer(_) => Column::Unsigned(facts.map(integer).collect()),
        Fact::Text(_) => Column::Texts(facts.map(text).collect()),
    }
}

fn png(width: u32, height: u32, pixels: &[u8]) -> io::Result<Vec<u8>> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(pixels));
    written.map_err(io::Error::other)?;
    Ok(file)
}
