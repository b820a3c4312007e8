//! Data sets as plain arrays: one NumPy archive.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::archive::Archive;
use crate::{Contents, Draw, Episode, Fact, Writer};

/// Name of the archive.
const FILE: &str = "data.npz";

/// Writes `data.npz`. Numbers stay in memory until the end, images are in files of their own.
pub(crate) struct ArrayWriter {
    contents: Contents,
    folder: PathBuf,
    vectors: Vec<Vec<u8>>,
    images: Vec<(PathBuf, BufWriter<File>)>,
    lengths: Vec<usize>,
    success: Vec<u8>,
    facts: Vec<(String, Vec<Fact>)>,
}

impl ArrayWriter {
    pub(crate) fn new(contents: Contents, folder: &Path) -> io::Result<ArrayWriter> {
        let file = |index: usize| {
            let path = folder.join(format!("images-{index}.part"));
            Ok((path.clone(), BufWriter::new(File::create_new(path)?)))
        };
        Ok(ArrayWriter {
            vectors: vec![Vec::new(); contents.vectors.len()],
            images: (0..contents.images.len()).map(file).collect::<io::Result<_>>()?,
            contents,
            folder: folder.to_path_buf(),
            lengths: Vec::new(),
            success: Vec::new(),
            facts: Vec::new(),
        })
    }
}

impl Writer for ArrayWriter {
    fn add(&mut self, episode: &Episode<'_>, draw: Draw<'_>) -> io::Result<()> {
        for (bytes, values) in self.vectors.iter_mut().zip(episode.vectors) {
            values.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
        }
        for (column, (_, file)) in self.images.iter_mut().enumerate() {
            let mut image = vec![0; self.contents.images[column].bytes()];
            for frame in 0..episode.frames {
                draw(column, frame, &mut image)?;
                file.write_all(&image)?;
            }
        }
        self.lengths.push(episode.frames);
        self.success.push(u8::from(episode.is_success));
        if self.facts.is_empty() {
            self.facts = episode.facts.iter().map(|(name, _)| (name.clone(), Vec::new())).collect();
        }
        for ((_, values), (_, fact)) in self.facts.iter_mut().zip(episode.facts) {
            values.push(fact.clone());
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> io::Result<()> {
        let mut archive = Archive::create(&self.folder.join(FILE))?;
        let frames = self.lengths.iter().sum::<usize>();
        let episodes = self.lengths.len();
        for (column, bytes) in self.contents.vectors.iter().zip(&self.vectors) {
            let shape = [frames, column.names.len()];
            archive.add(&column.name, "<f4", &shape, &mut bytes.as_slice())?;
            texts(&mut archive, &format!("{}.names", column.name), &column.names)?;
        }
        for (column, (path, mut file)) in self.contents.images.iter().zip(self.images) {
            file.flush()?;
            drop(file);
            let shape = [frames, column.height as usize, column.width as usize, 3];
            archive.add(&column.name, "|u1", &shape, &mut BufReader::new(File::open(&path)?))?;
            std::fs::remove_file(path)?;
        }
        let of_frames = |value: fn(usize, usize) -> i64| -> Vec<u8> {
            let frames = |(episode, length): (usize, &usize)| (0..*length).map(move |frame| (episode, frame));
            let all = self.lengths.iter().enumerate().flat_map(frames);
            all.flat_map(|(episode, frame)| value(episode, frame).to_le_bytes()).collect()
        };
        let episode_index = of_frames(|episode, _| episode as i64);
        archive.add("episode_index", "<i8", &[frames], &mut episode_index.as_slice())?;
        let frame_index = of_frames(|_, frame| frame as i64);
        archive.add("frame_index", "<i8", &[frames], &mut frame_index.as_slice())?;
        // Episode k has the frames from starts[k] to starts[k + 1].
        let ends = self.lengths.iter().scan(0, |end, length| {
            *end += *length as i64;
            Some(*end)
        });
        let starts: Vec<u8> = std::iter::once(0).chain(ends).flat_map(i64::to_le_bytes).collect();
        archive.add("episode_starts", "<i8", &[episodes + 1], &mut starts.as_slice())?;
        archive.add("dt", "<f8", &[], &mut self.contents.dt.to_le_bytes().as_slice())?;
        archive.add("success", "|b1", &[episodes], &mut self.success.as_slice())?;
        for (name, values) in &self.facts {
            add_facts(&mut archive, name, values)?;
        }
        texts(&mut archive, "task", std::slice::from_ref(&self.contents.task))?;
        archive.finish()
    }
}

/// Adds an array with one fact per episode. Its type is that of the first one.
fn add_facts(archive: &mut Archive, name: &str, values: &[Fact]) -> io::Result<()> {
    let text = |fact: &Fact| match fact {
        Fact::Text(text) => text.clone(),
        Fact::Integer(_) | Fact::Number(_) => String::new(),
    };
    let bytes = |fact: &Fact| match fact {
        Fact::Integer(value) => value.to_le_bytes(),
        Fact::Number(value) => value.to_le_bytes(),
        Fact::Text(_) => [0; 8],
    };
    let kind = match values.first() {
        Some(Fact::Text(_)) => {
            return texts(archive, name, &values.iter().map(text).collect::<Vec<_>>());
        }
        Some(Fact::Integer(_)) => "<u8",
        _ => "<f8",
    };
    let data: Vec<u8> = values.iter().flat_map(bytes).collect();
    archive.add(name, kind, &[values.len()], &mut data.as_slice())
}

/// Adds an array of texts: NumPy's type `U`, in which each text has the length of the longest one
/// in UTF-32.
fn texts(archive: &mut Archive, name: &str, texts: &[String]) -> io::Result<()> {
    let longest = texts.iter().map(|text| text.chars().count()).max().unwrap_or(0).max(1);
    let padded = texts.iter().flat_map(|text| text.chars().chain(std::iter::repeat('\0')).take(longest));
    let data: Vec<u8> = padded.flat_map(|character| u32::from(character).to_le_bytes()).collect();
    archive.add(name, &format!("<U{longest}"), &[texts.len()], &mut data.as_slice())
}
