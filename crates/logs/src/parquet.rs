//! Parquet files.

use std::fs::File;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use mishandle_text::visible;
use parquet::basic::{ConvertedType, LogicalType, TimeUnit, Type as PhysicalType};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, RowGroupReader, SerializedFileReader};
use parquet::schema::types::ColumnDescriptor;

use crate::cell::{Cell, Sink, Sinks};
use crate::error::{LogError, Result, content};
use crate::half::half;
use crate::place::{Counted, Places};
use crate::table::Table;

/// Number of rows that are in memory at a time.
const BATCH: usize = 1 << 13;

/// Number of first rows whose lists say how many columns a list has.
const HEAD: usize = 1000;

/// Largest number of columns.
const MAX_COLUMNS: usize = 1_000_000;

/// A Parquet file whose metadata was read.
pub(crate) struct ParquetTable {
    reader: SerializedFileReader<File>,
    names: Vec<String>,
    columns: Vec<Leaf>,
    not_read: Vec<(String, String)>,
}

/// A column: a leaf of the schema, or an element of its lists.
#[derive(Clone, Copy)]
struct Leaf {
    leaf: usize,
    meaning: Meaning,
    /// The number of the element; 0 without lists.
    element: usize,
    /// Definition level of values that are not missing.
    present: i16,
}

/// The meaning of the integers of a column.
#[derive(Clone, Copy)]
enum Meaning {
    /// Numbers.
    Plain,
    /// Unsigned 64-bit numbers.
    Unsigned,
    /// Numbers of 16 bits.
    Half,
    /// Times in units of this many attoseconds, with this last digit.
    Time(i128, i32),
}

impl ParquetTable {
    /// Reads the metadata. A column with this name of times must have a type that is read.
    pub(crate) fn open(path: &Path, time: &str) -> Result<ParquetTable> {
        let reader = SerializedFileReader::new(File::open(path)?).map_err(damaged)?;
        let mut names = Vec::new();
        let mut columns = Vec::new();
        let mut not_read = Vec::new();
        let schema = reader.metadata().file_metadata().schema_descr();
        for (leaf, column) in schema.columns().iter().enumerate() {
            let parts = column.path().parts();
            let Some(meaning) = Meaning::of(column) else {
                if parts.join("/") == time {
                    return Err(content(format!(
                        "the times `{}` are of the type {}, which is not read; write a timestamp or a number",
                        visible(time),
                        type_text(column)
                    )));
                }
                let reason = format!("its values have the type {}; write numbers", type_text(column));
                not_read.push((list_name(parts), reason));
                continue;
            };
            let first = Leaf { leaf, meaning, element: 0, present: column.max_def_level() };
            match column.max_rep_level() {
                0 => {
                    names.push(parts.join("/"));
                    columns.push(first);
                }
                1 => {
                    let longest = || longest_list(&reader, first);
                    let longest = catch_unwind(AssertUnwindSafe(longest))
                        .unwrap_or_else(|_| Err(damaged_text("its decoder failed")))?;
                    for element in 0..longest {
                        names.push(element_name(parts, element));
                        columns.push(Leaf { element, ..first });
                    }
                }
                _ => not_read.push((list_name(parts), "it has lists of lists".to_owned())),
            }
            if columns.len() > MAX_COLUMNS {
                return Err(content(format!("the file has more than {MAX_COLUMNS} columns")));
            }
        }
        Ok(ParquetTable { reader, names, columns, not_read })
    }
}

/// Returns the name of an element of a list, such as `state[0]` or `points[0]/x`. A list has two
/// levels of its own in the schema, such as `state.list.element`, or none.
fn element_name(parts: &[String], element: usize) -> String {
    match parts.iter().position(|part| part == "list" || part == "bag") {
        Some(level) if level > 0 => {
            let name = format!("{}[{element}]", parts[..level].join("/"));
            [&[name], parts.get(level + 2..).unwrap_or_default()].concat().join("/")
        }
        _ => format!("{}[{element}]", parts.join("/")),
    }
}

/// Returns the name of a column without its elements.
fn list_name(parts: &[String]) -> String {
    let level = parts.iter().position(|part| part == "list" || part == "bag").filter(|level| *level > 0);
    parts[..level.unwrap_or(parts.len())].join("/")
}

/// Returns the type of a column for a message.
fn type_text(column: &ColumnDescriptor) -> String {
    match (column.logical_type_ref(), column.converted_type()) {
        (Some(LogicalType::Decimal { .. }), _) | (_, ConvertedType::DECIMAL) => "DECIMAL".to_owned(),
        _ => column.physical_type().to_string(),
    }
}

/// Returns the length of the longest list of a leaf in the first rows.
fn longest_list(reader: &SerializedFileReader<File>, leaf: Leaf) -> Result<usize> {
    let mut longest = 0;
    let mut rows = 0;
    for group in 0..reader.num_row_groups() {
        let group = reader.get_row_group(group).map_err(damaged)?;
        rows += visit(&*group, leaf, HEAD - rows, &mut |_, element, cell| {
            if !matches!(cell, Cell::Missing) {
                longest = longest.max(element + 1);
            }
            Ok(())
        })?;
        if rows >= HEAD || longest > MAX_COLUMNS {
            break;
        }
    }
    Ok(longest)
}

impl Meaning {
    /// Returns the meaning of a column's values; `None` for other types than numbers, times and
    /// text.
    fn of(column: &ColumnDescriptor) -> Option<Meaning> {
        let unit = |unit: &TimeUnit| match unit {
            TimeUnit::MILLIS => Meaning::Time(10_i128.pow(15), -3),
            TimeUnit::MICROS => Meaning::Time(10_i128.pow(12), -6),
            TimeUnit::NANOS => Meaning::Time(10_i128.pow(9), -9),
        };
        let is_supported =
            !matches!(column.physical_type(), PhysicalType::INT96 | PhysicalType::FIXED_LEN_BYTE_ARRAY);
        if let Some(LogicalType::Float16) = column.logical_type_ref() {
            return Some(Meaning::Half);
        }
        let found = match (column.logical_type_ref(), column.converted_type()) {
            (Some(LogicalType::Timestamp(time) | LogicalType::Time(time)), _) => unit(&time.unit),
            (_, ConvertedType::TIMESTAMP_MILLIS | ConvertedType::TIME_MILLIS) => unit(&TimeUnit::MILLIS),
            (_, ConvertedType::TIMESTAMP_MICROS | ConvertedType::TIME_MICROS) => unit(&TimeUnit::MICROS),
            (_, ConvertedType::DATE) => Meaning::Time(86_400 * 10_i128.pow(18), 5),
            (_, ConvertedType::DECIMAL) => return None,
            (_, ConvertedType::UINT_64 | ConvertedType::UINT_32) => Meaning::Unsigned,
            _ => Meaning::Plain,
        };
        is_supported.then_some(found)
    }

    fn cell(self, value: i64) -> Cell<'static> {
        match self {
            Meaning::Plain | Meaning::Half => Cell::Integer(value.into()),
            Meaning::Unsigned => Cell::Integer(value.cast_unsigned().into()),
            Meaning::Time(unit, last_digit) => Cell::Time(i128::from(value) * unit, last_digit),
        }
    }
}

impl Table for ParquetTable {
    fn names(&self) -> &[String] {
        &self.names
    }

    fn counted(&self) -> Counted {
        Counted::Rows
    }

    fn not_read(&self) -> &[(String, String)] {
        &self.not_read
    }

    /// A damaged file can make the decoder panic.
    fn read(self: Box<Self>, sinks: &mut Sinks) -> Result<()> {
        let read = || self.read_groups(sinks);
        catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| Err(damaged_text("its decoder failed")))
    }
}

impl ParquetTable {
    fn read_groups(&self, sinks: &mut Sinks) -> Result<()> {
        let mut rows = 0;
        for group in 0..self.reader.num_row_groups() {
            let group = self.reader.get_row_group(group).map_err(damaged)?;
            let count = usize::try_from(group.metadata().num_rows())
                .map_err(|_| damaged_text("a size is negative"))?;
            for (column, sink) in &mut sinks.columns {
                let read = read_column(&*group, self.columns[*column], sink, rows as u64)?;
                if read != count {
                    return Err(damaged_text(&format!(
                        "`{}` has too few values",
                        visible(&self.names[*column])
                    )));
                }
            }
            rows += count;
        }
        sinks.places = Places::rows(rows);
        Ok(())
    }
}

/// Reads a column of a row group and returns its number of rows.
fn read_column(group: &dyn RowGroupReader, leaf: Leaf, sink: &mut Sink, before: u64) -> Result<usize> {
    let mut pushed = 0;
    let mut push = |row: usize, cell: Cell<'_>| sink.push(cell, before + row as u64 + 1);
    let rows = visit(group, leaf, usize::MAX, &mut |row, element, cell| {
        if element == leaf.element {
            // Rows whose list is too short.
            (pushed..row).try_for_each(|row| push(row, Cell::Missing))?;
            push(row, cell)?;
            pushed = row + 1;
        }
        Ok(())
    })?;
    (pushed..rows).try_for_each(|row| push(row, Cell::Missing))?;
    Ok(rows)
}

/// Gets the row, the number of the element in its list, and the cell.
type Visitor<'a> = &'a mut dyn FnMut(usize, usize, Cell<'_>) -> Result<()>;

/// Gives all values of the first rows of a leaf to `each`, and returns the number of these rows. An
/// empty list is a missing element.
fn visit(group: &dyn RowGroupReader, leaf: Leaf, limit: usize, each: Visitor<'_>) -> Result<usize> {
    let chunk = group.metadata().column(leaf.leaf);
    let start = chunk.dictionary_page_offset().unwrap_or(0).min(chunk.data_page_offset());
    if start < 0 || chunk.compressed_size() < 0 {
        return Err(damaged_text("a size is negative"));
    }
    let meaning = leaf.meaning;
    match group.get_column_reader(leaf.leaf).map_err(damaged)? {
        ColumnReader::BoolColumnReader(reader) => {
            visit_typed(reader, leaf, limit, each, |value| Cell::Integer((*value).into()))
        }
        ColumnReader::Int32ColumnReader(reader) => {
            let unsigned = matches!(meaning, Meaning::Unsigned);
            visit_typed(reader, leaf, limit, each, |value| {
                if unsigned {
                    Cell::Integer(value.cast_unsigned().into())
                } else {
                    meaning.cell((*value).into())
                }
            })
        }
        ColumnReader::Int64ColumnReader(reader) => {
            visit_typed(reader, leaf, limit, each, |value| meaning.cell(*value))
        }
        ColumnReader::FloatColumnReader(reader) => {
            visit_typed(reader, leaf, limit, each, |value| Cell::Single(*value))
        }
        ColumnReader::DoubleColumnReader(reader) => {
            visit_typed(reader, leaf, limit, each, |value| Cell::Number(*value))
        }
        ColumnReader::FixedLenByteArrayColumnReader(reader) => {
            visit_typed(reader, leaf, limit, each, |value| match *value.data() {
                [low, high] => Cell::Number(half(u16::from_le_bytes([low, high]))),
                _ => Cell::Missing,
            })
        }
        ColumnReader::ByteArrayColumnReader(reader) => visit_typed(reader, leaf, limit, each, |value| {
            Cell::Text(std::str::from_utf8(value.data()).unwrap_or("\u{fffd}").trim())
        }),
        _ => Err(damaged_text("a column has another type than the schema")),
    }
}

fn visit_typed<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    leaf: Leaf,
    limit: usize,
    each: Visitor<'_>,
    cell: impl Fn(&T::T) -> Cell<'_>,
) -> Result<usize> {
    let mut definitions = Vec::new();
    let mut repetitions = Vec::new();
    let mut values = Vec::new();
    let mut rows = 0;
    while rows < limit {
        definitions.clear();
        repetitions.clear();
        values.clear();
        let batch = BATCH.min(limit - rows);
        let (count, _, levels) = reader
            .read_records(batch, Some(&mut definitions), Some(&mut repetitions), &mut values)
            .map_err(damaged)?;
        if count == 0 {
            break;
        }
        let mut found = values.iter();
        let mut row = rows;
        let mut element = 0;
        for level in 0..levels {
            // Without lists and without optional groups, a column has no levels.
            let continues = repetitions.get(level).is_some_and(|repetition| *repetition > 0);
            element = if continues { element + 1 } else { 0 };
            row += usize::from(!continues && level > 0);
            let is_present = definitions.get(level).is_none_or(|definition| *definition == leaf.present);
            let next = if is_present { found.next() } else { None };
            each(row, element, next.map_or(Cell::Missing, &cell))?;
        }
        rows += count;
    }
    Ok(rows)
}

fn damaged(error: ParquetError) -> LogError {
    match error {
        ParquetError::NYI(message) | ParquetError::General(message) if message.contains("feature") => {
            content(format!(
                "the file has a compression that this program lacks: {message}; write it with Snappy or Zstd"
            ))
        }
        error => damaged_text(&error.to_string()),
    }
}

fn damaged_text(reason: &str) -> LogError {
    content(format!("the Parquet file is damaged or not complete: {reason}"))
}
