//! NumPy's files: arrays (`.npy`), also structured, and archives of them (`.npz`).

mod archive;
mod header;

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use archive::Archive;
use header::{Header, Kind};
use mishandle_text::{plural, visible};

use crate::cell::{Cell, Sinks};
use crate::error::{Result, content};
use crate::place::{Counted, Places};
use crate::table::Table;

/// A file of arrays whose headers were read.
pub(crate) struct NumpyTable {
    path: PathBuf,
    names: Vec<String>,
    columns: Vec<Column>,
    not_read: Vec<(String, String)>,
}

/// A column: a part of the elements of an array.
struct Column {
    /// The entry of the archive; `None` for a file with one array.
    entry: Option<String>,
    header: Header,
    /// The index in the fields of the element.
    field: usize,
    /// The element of each row.
    element: usize,
}

/// Largest number of columns of all arrays together.
const MAX_COLUMNS: usize = 1_000_000;

impl NumpyTable {
    /// Reads the headers of the arrays. 1-D arrays and fields of structured arrays are columns;
    /// a 2-D array `q` has the columns `q[0]`, `q[1]`, … Arrays that nobody reads may have any
    /// type, such as pickled objects, but not the times.
    pub(crate) fn open(path: &Path, time: &str) -> Result<NumpyTable> {
        let mut file = BufReader::new(File::open(path)?);
        let mut start = [0; 6];
        file.read_exact(&mut start).map_err(|_| content("the file is too short for a NumPy file"))?;
        let mut table = NumpyTable {
            path: path.to_owned(),
            names: Vec::new(),
            columns: Vec::new(),
            not_read: Vec::new(),
        };
        if start.starts_with(b"PK") {
            let mut archive = Archive::open(file)?;
            for name in archive.names() {
                let array = name.strip_suffix(".npy").unwrap_or(&name).to_owned();
                let header = Header::read(&mut archive.entry(&name)?)
                    .map_err(|error| content(format!("array `{}`: {error}", visible(&array))));
                match header {
                    Ok(header) => table.add(&array, Some(&name), &header, time)?,
                    Err(error) if array == time => return Err(error),
                    Err(error) => table.not_read.push((array, error.to_string())),
                }
            }
        } else {
            file.rewind()?;
            let header = Header::read(&mut file)?;
            table.add("", None, &header, time)?;
        }
        if table.names.is_empty() {
            return Err(content("the file has no array of numbers with one or two dimensions"));
        }
        Ok(table)
    }

    fn add(&mut self, array: &str, entry: Option<&str>, header: &Header, time: &str) -> Result<()> {
        let width = match header.shape[..] {
            [_] => None,
            [_, width] => Some(width),
            [] | [_, _, _, ..] => {
                let dimensions = plural(header.shape.len() as u64, "dimension");
                self.not_read.push((array.to_owned(), format!("it has {dimensions}")));
                return Ok(());
            }
        };
        for (index, field) in header.fields.iter().enumerate() {
            let name = match (array, field.name.as_str()) {
                (array, "") => array.to_owned(),
                ("", name) => name.to_owned(),
                (array, name) => format!("{array}/{name}"),
            };
            if field.kind == Kind::Other && name == time {
                return Err(content(format!(
                    "the times `{}` have a type that is not read; write numbers or datetime64[ns]",
                    visible(time)
                )));
            }
            if field.kind == Kind::Other {
                let reason = format!("its values have the type {}; write numbers", visible(&field.code));
                self.not_read.push((name, reason));
                continue;
            }
            if self.names.len() + width.unwrap_or(1) > MAX_COLUMNS {
                return Err(content(format!("the arrays have more than {MAX_COLUMNS} columns")));
            }
            for element in 0..width.unwrap_or(1) {
                self.names.push(match width {
                    Some(_) => format!("{name}[{element}]"),
                    None => name.clone(),
                });
                self.columns.push(Column {
                    entry: entry.map(str::to_owned),
                    header: header.clone(),
                    field: index,
                    element,
                });
            }
        }
        Ok(())
    }
}

impl Table for NumpyTable {
    fn names(&self) -> &[String] {
        &self.names
    }

    fn counted(&self) -> Counted {
        Counted::Rows
    }

    fn not_read(&self) -> &[(String, String)] {
        &self.not_read
    }

    fn read(self: Box<Self>, sinks: &mut Sinks) -> Result<()> {
        let mut rows: Option<(usize, usize)> = None;
        for (index, sink) in &mut sinks.columns {
            let column = &self.columns[*index];
            let count = column.header.shape[0];
            let (first, known) = *rows.get_or_insert((*index, count));
            if count != known {
                return Err(content(format!(
                    "`{}` has {count} rows, but `{}` has {known}; columns that are read together must have the same length",
                    visible(&self.names[*index]),
                    visible(&self.names[first])
                )));
            }
            let push = |cell: Cell<'_>, row: usize| sink.push(cell, row as u64 + 1);
            let file = BufReader::new(File::open(&self.path)?);
            let named = |error: crate::LogError| match error {
                crate::LogError::Io(error) => content(format!("`{}`: {error}", visible(&self.names[*index]))),
                error => error,
            };
            match &column.entry {
                Some(entry) => {
                    let mut archive = Archive::open(file)?;
                    column.read(archive.entry(entry)?, push).map_err(named)?;
                }
                None => column.read(file, push).map_err(named)?,
            }
        }
        sinks.places = Places::rows(rows.map_or(0, |(_, count)| count));
        Ok(())
    }
}

impl Column {
    /// Reads the cells of the column, first row first.
    fn read(&self, mut source: impl Read, mut push: impl FnMut(Cell<'_>, usize) -> Result<()>) -> Result<()> {
        Header::read(&mut source)?;
        let rows = self.header.shape[0];
        let width = self.header.shape.get(1).copied().unwrap_or(1);
        let field = &self.header.fields[self.field];
        let size = self.header.item_bytes;
        let is_columns = self.header.is_fortran && width > 1;
        // Bytes before the first cell, and between two of the column.
        let (before, step) =
            if is_columns { ((self.element * rows) as u64 * size as u64, size) } else { (0, size * width) };
        let skipped = std::io::copy(&mut source.by_ref().take(before), &mut std::io::sink())?;
        if skipped < before {
            return Err(truncated());
        }
        let at = field.offset + if is_columns { 0 } else { self.element * size };
        let mut block = vec![0; step];
        let mut source = BufReader::with_capacity(1 << 16, source);
        for row in 0..rows {
            source.read_exact(&mut block).map_err(|error| match error.kind() {
                std::io::ErrorKind::UnexpectedEof => truncated(),
                _ => error.into(),
            })?;
            push(field.cell(&block[at..]).ok_or_else(truncated)?, row)?;
        }
        Ok(())
    }
}

fn truncated() -> crate::LogError {
    content("the file ends before the last row; it was truncated")
}
