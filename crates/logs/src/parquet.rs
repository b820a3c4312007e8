//! Parquet files.

use std::fs::File;
use std::path::Path;

use mishandle_text::visible;
use parquet::basic::{ConvertedType, LogicalType, TimeUnit, Type as PhysicalType};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};

use crate::cell::{Cell, Sink, Sinks};
use crate::error::{LogError, Result, content};
use crate::place::{Counted, Places};
use crate::table::Table;

/// Number of rows that are in memory at a time.
const BATCH: usize = 1 << 13;

/// A Parquet file whose metadata was read.
pub(crate) struct ParquetTable {
    reader: SerializedFileReader<File>,
    names: Vec<String>,
    /// The leaf of the schema, and the meaning of its values, for each column.
    columns: Vec<(usize, Meaning)>,
}

/// The meaning of the integers of a column.
#[derive(Clone, Copy)]
enum Meaning {
    /// Numbers.
    Plain,
    /// Unsigned 64-bit numbers.
    Unsigned,
    /// Times in units of this many attoseconds, with this last digit.
    Time(i128, i32),
}

impl ParquetTable {
    pub(crate) fn open(path: &Path) -> Result<ParquetTable> {
        let reader = SerializedFileReader::new(File::open(path)?).map_err(damaged)?;
        let (mut names, mut columns) = (Vec::new(), Vec::new());
        let schema = reader.metadata().file_metadata().schema_descr();
        for (leaf, column) in schema.columns().iter().enumerate() {
            if let Some(meaning) = Meaning::of(column).filter(|_| column.max_rep_level() == 0) {
                names.push(column.path().parts().join("/"));
                columns.push((leaf, meaning));
            }
        }
        Ok(ParquetTable { reader, names, columns })
    }
}

impl Meaning {
    /// Returns the meaning of a column's values; `None` for other types than numbers, times and
    /// text.
    fn of(column: &parquet::schema::types::ColumnDescriptor) -> Option<Meaning> {
        let unit = |unit: &TimeUnit| match unit {
            TimeUnit::MILLIS => Meaning::Time(10_i128.pow(15), -3),
            TimeUnit::MICROS => Meaning::Time(10_i128.pow(12), -6),
            TimeUnit::NANOS => Meaning::Time(10_i128.pow(9), -9),
        };
        let is_supported =
            !matches!(column.physical_type(), PhysicalType::INT96 | PhysicalType::FIXED_LEN_BYTE_ARRAY);
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
            Meaning::Plain => Cell::Integer(value.into()),
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

    fn read(self: Box<Self>, sinks: &mut Sinks) -> Result<()> {
        let mut rows = 0;
        for group in 0..self.reader.num_row_groups() {
            let group = self.reader.get_row_group(group).map_err(damaged)?;
            let count = usize::try_from(group.metadata().num_rows())
                .map_err(|_| damaged_text("a size is negative"))?;
            for (column, sink) in &mut sinks.columns {
                let (leaf, meaning) = self.columns[*column];
                let chunk = group.metadata().column(leaf);
                let start = chunk.dictionary_page_offset().unwrap_or(0).min(chunk.data_page_offset());
                if start < 0 || chunk.compressed_size() < 0 {
                    return Err(damaged_text("a size is negative"));
                }
                let reader = group.get_column_reader(leaf).map_err(damaged)?;
                let read = read_column(reader, meaning, sink, rows as u64)?;
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
fn read_column(reader: ColumnReader, meaning: Meaning, sink: &mut Sink, before: u64) -> Result<usize> {
    match reader {
        ColumnReader::BoolColumnReader(reader) => {
            read_typed(reader, sink, before, |value| Cell::Integer((*value).into()))
        }
        ColumnReader::Int32ColumnReader(reader) => {
            let unsigned = matches!(meaning, Meaning::Unsigned);
            read_typed(reader, sink, before, |value| match unsigned {
                true => Cell::Integer(value.cast_unsigned().into()),
                false => meaning.cell((*value).into()),
            })
        }
        ColumnReader::Int64ColumnReader(reader) => {
            read_typed(reader, sink, before, |value| meaning.cell(*value))
        }
        ColumnReader::FloatColumnReader(reader) => {
            read_typed(reader, sink, before, |value| Cell::Single(*value))
        }
        ColumnReader::DoubleColumnReader(reader) => {
            read_typed(reader, sink, before, |value| Cell::Number(*value))
        }
        ColumnReader::ByteArrayColumnReader(reader) => read_typed(reader, sink, before, |value| {
            Cell::Text(std::str::from_utf8(value.data()).unwrap_or("\u{fffd}").trim())
        }),
        _ => Err(damaged_text("a column has another type than the schema")),
    }
}

fn read_typed<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    sink: &mut Sink,
    before: u64,
    cell: impl Fn(&T::T) -> Cell<'_>,
) -> Result<usize> {
    let (mut levels, mut values) = (Vec::new(), Vec::new());
    let mut rows = 0;
    loop {
        levels.clear();
        values.clear();
        let (count, _, _) =
            reader.read_records(BATCH, Some(&mut levels), None, &mut values).map_err(damaged)?;
        if count == 0 {
            return Ok(rows);
        }
        // Without nulls, a required column has no levels.
        let deepest = levels.iter().copied().max().unwrap_or(0);
        let mut found = values.iter();
        let has_nulls = values.len() < count;
        for row in 0..count {
            let is_value = !has_nulls || (!values.is_empty() && levels.get(row) == Some(&deepest));
            let next = if is_value { found.next() } else { None };
            sink.push(next.map_or(Cell::Missing, &cell), before + (rows + row) as u64 + 1)?;
        }
        rows += count;
    }
}

fn damaged(error: ParquetError) -> LogError {
    match error {
        ParquetError::NYI(message) | ParquetError::General(message) if message.contains("feature") => {
            content(format!(
                "the file has a compression that this program lacks: {message}; write it with Snappy"
            ))
        }
        error => damaged_text(&error.to_string()),
    }
}

fn damaged_text(reason: &str) -> LogError {
    content(format!("the Parquet file is damaged or not complete: {reason}"))
}
