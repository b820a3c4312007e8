//! A model of a disk: which files a power cut can leave.
//!
//! Assumptions, which are weaker than what common file systems promise:
//! - A sync of a file makes all its earlier writes and truncations durable.
//! - Later ones are lost or kept, each on its own, in any combination. A kept write can be torn:
//!   each of its sectors of 512 bytes is old or new.
//! - Creations and removals of files become durable in their order, and at the latest when the
//!   folder is synced. SQLite syncs the folder with the first sync of a new journal or log. Until
//!   then, a power cut undoes the last of them.
//! - The folder itself is on the disk.

use std::collections::BTreeMap;
use std::path::Path;

use mishandle_random::Sequence;

const SECTOR: usize = 512;

/// End of the name of a write-ahead log.
const LOG: &str = "-wal";

/// Number of a file. A file that is removed and created again gets a new one.
pub type FileId = u32;

#[derive(Debug, Clone)]
enum Event {
    Create { name: String, id: FileId },
    Remove { name: String, syncs_folder: bool },
    Change { id: FileId, change: Change },
    Sync { id: FileId, syncs_folder: bool },
    Mark,
}

#[derive(Debug, Clone)]
enum Change {
    Write { offset: usize, bytes: Vec<u8> },
    Truncate { size: usize },
}

/// The calls that changed files, in order.
#[derive(Debug, Default)]
pub struct Disk {
    events: Vec<Event>,
    /// The files at the start by name.
    initial: BTreeMap<String, (FileId, Vec<u8>)>,
    names: BTreeMap<String, FileId>,
    files: FileId,
}

impl Disk {
    /// Records that a file was opened; `before` is its content before, if it existed.
    pub fn open(&mut self, name: &str, before: Option<&[u8]>) -> FileId {
        if let Some(&id) = self.names.get(name) {
            return id;
        }
        let id = self.files;
        self.files += 1;
        self.names.insert(name.into(), id);
        match before {
            // An empty file was created a moment before, without SQLite.
            None | Some([]) => self.events.push(Event::Create { name: name.into(), id }),
            Some(content) => {
                self.initial.insert(name.into(), (id, content.into()));
            }
        }
        id
    }

    pub fn remove(&mut self, name: &str, syncs_folder: bool) {
        self.names.remove(name);
        self.events.push(Event::Remove { name: name.into(), syncs_folder });
    }

    pub fn write(&mut self, id: FileId, offset: usize, bytes: &[u8]) {
        self.events.push(Event::Change { id, change: Change::Write { offset, bytes: bytes.into() } });
    }

    pub fn truncate(&mut self, id: FileId, size: usize) {
        self.events.push(Event::Change { id, change: Change::Truncate { size } });
    }

    pub fn sync(&mut self, id: FileId, syncs_folder: bool) {
        self.events.push(Event::Sync { id, syncs_folder });
    }

    pub fn mark(&mut self) {
        self.events.push(Event::Mark);
    }

    /// Calls `visit` with the state of the disk at the start and after each event.
    pub fn replay(&self, mut visit: impl FnMut(&State)) {
        let mut state = State::default();
        for (name, (id, content)) in &self.initial {
            state.durable_names.insert(name.clone(), *id);
            state.files.insert(*id, File { durable: content.clone(), pending: vec![] });
            if name.ends_with(LOG) {
                state.log = Some(*id);
            }
        }
        visit(&state);
        for event in &self.events {
            state.apply(event);
            visit(&state);
        }
    }
}

#[derive(Debug, Default)]
struct File {
    durable: Vec<u8>,
    /// Changes since the last sync.
    pending: Vec<Change>,
}

/// A disk at the moment of a power cut.
#[derive(Debug, Default)]
pub struct State {
    files: BTreeMap<FileId, File>,
    durable_names: BTreeMap<String, FileId>,
    /// Creations (`Some`) and removals since the last sync of the folder.
    pending_names: Vec<(String, Option<FileId>)>,
    /// The present write-ahead log.
    log: Option<FileId>,
    /// Number of calls so far.
    pub events: usize,
    /// Number of marks so far.
    pub marks: usize,
    /// Number of marks before the last sync of the log.
    pub durable_marks: usize,
}

/// The part of the unsynced changes that a power cut keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kept {
    Nothing,
    Everything,
    /// A random subset.
    Random(u64),
}

/// The files after a power cut, by name.
pub type Image = BTreeMap<String, Vec<u8>>;

impl State {
    fn apply(&mut self, event: &Event) {
        self.events += 1;
        match event {
            Event::Create { name, id } => {
                self.files.insert(*id, File::default());
                if name.ends_with(LOG) {
                    self.log = Some(*id);
                }
                self.pending_names.push((name.clone(), Some(*id)));
            }
            Event::Remove { name, syncs_folder } => {
                if name.ends_with(LOG) {
                    self.log = None;
                }
                self.pending_names.push((name.clone(), None));
                if *syncs_folder {
                    self.sync_folder();
                }
            }
            Event::Change { id, change } => {
                if let Some(file) = self.files.get_mut(id) {
                    file.pending.push(change.clone());
                }
            }
            Event::Sync { id, syncs_folder } => {
                if let Some(file) = self.files.get_mut(id) {
                    let pending = std::mem::take(&mut file.pending);
                    pending.iter().for_each(|change| change.apply(&mut file.durable));
                }
                if *syncs_folder {
                    self.sync_folder();
                }
                if self.log == Some(*id) {
                    self.durable_marks = self.marks;
                }
            }
            Event::Mark => {
                self.marks += 1;
                let log = self.log.and_then(|id| self.files.get(&id));
                let is_write = |change: &Change| matches!(change, Change::Write { .. });
                // SQLite removes a log after it has synced it and the file.
                if log.is_none_or(|log| !log.pending.iter().any(is_write)) {
                    self.durable_marks = self.marks;
                }
            }
        }
    }

    fn sync_folder(&mut self) {
        let pending = std::mem::take(&mut self.pending_names);
        pending.iter().for_each(|(name, id)| rename(&mut self.durable_names, name, *id));
    }

    /// Returns the files that a power cut leaves.
    pub fn cut(&self, kept: Kept) -> Image {
        let mut random = Sequence::new(if let Kept::Random(seed) = kept { seed } else { 0 }, 0);
        let mut names = self.durable_names.clone();
        let kept_names = match kept {
            Kept::Nothing => 0,
            Kept::Everything => self.pending_names.len(),
            Kept::Random(_) => random.below(self.pending_names.len() as u64 + 1) as usize,
        };
        self.pending_names[..kept_names].iter().for_each(|(name, id)| rename(&mut names, name, *id));
        names
            .into_iter()
            .filter_map(|(name, id)| Some((name, self.files.get(&id)?.cut(kept, &mut random))))
            .collect()
    }
}

fn rename(names: &mut BTreeMap<String, FileId>, name: &str, id: Option<FileId>) {
    match id {
        Some(id) => names.insert(name.to_string(), id),
        None => names.remove(name),
    };
}

impl File {
    fn cut(&self, kept: Kept, random: &mut Sequence) -> Vec<u8> {
        let mut content = self.durable.clone();
        // A random subset is nothing or everything for some files, so that the files differ in age.
        let share = match kept {
            Kept::Nothing => Share::None,
            Kept::Everything => Share::All,
            Kept::Random(_) => {
                [Share::None, Share::All, Share::AllButLast, Share::Some][random.below(4) as usize]
            }
        };
        for (number, change) in self.pending.iter().enumerate() {
            let is_last = number + 1 == self.pending.len();
            match (share, random.below(3)) {
                (Share::None, _) | (Share::Some, 0) => {}
                (Share::Some, 1) => change.tear(&mut content, random),
                (Share::AllButLast, _) if is_last => change.tear(&mut content, random),
                _ => change.apply(&mut content),
            }
        }
        content
    }
}

/// Which unsynced changes of a file are kept.
#[derive(Debug, Clone, Copy)]
enum Share {
    None,
    All,
    /// All, but the last is torn.
    AllButLast,
    /// Each is lost, torn or kept.
    Some,
}

impl Change {
    fn apply(&self, content: &mut Vec<u8>) {
        match self {
            Change::Write { offset, bytes } => {
                content.resize(content.len().max(offset + bytes.len()), 0);
                content[*offset..offset + bytes.len()].copy_from_slice(bytes);
            }
            Change::Truncate { size } => content.truncate(*size),
        }
    }

    /// Applies each sector of a write or not.
    fn tear(&self, content: &mut Vec<u8>, random: &mut Sequence) {
        let Change::Write { offset, bytes } = self else { return };
        let end = offset + bytes.len();
        let mut start = *offset;
        while start < end {
            let next = (start / SECTOR + 1) * SECTOR;
            let next = next.min(end);
            if random.below(2) == 0 {
                let bytes = bytes[start - offset..next - offset].to_vec();
                Change::Write { offset: start, bytes }.apply(content);
            }
            start = next;
        }
    }
}

/// Writes the files of an image into `folder`, in place of the ones there.
pub fn write(image: &Image, folder: &Path) {
    for old in std::fs::read_dir(folder).unwrap() {
        std::fs::remove_file(old.unwrap().path()).unwrap();
    }
    for (name, content) in image {
        std::fs::write(folder.join(Path::new(name).file_name().unwrap()), content).unwrap();
    }
}
