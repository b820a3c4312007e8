//! Parquet files of columns, in the types that LeRobot reads.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as PhysicalType};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{ColumnPath, Type, TypePtr};

type Result<T> = std::result::Result<T, ParquetError>;

/// A column of a row group.
pub(crate) enum Column<'a> {
    Integers(Vec<i64>),
    /// Integers without a sign, by the same bits.
    Unsigned(Vec<i64>),
    Floats(Vec<f32>),
    Doubles(Vec<f64>),
    Flags(Vec<bool>),
    Texts(Vec<ByteArray>),
    /// A list with one text in each row.
    TextLists(Vec<ByteArray>),
    /// Lists with one integer in each row.
    IntegerLists(Vec<i64>),
    /// Lists of this many numbers.
    DoubleLists(Vec<f64>, usize),
    /// The same in single precision.
    Vectors(&'a [f32], usize),
    /// PNG files, in the type of the feature `Image` of Hugging Face's `datasets`.
    Images(Vec<ByteArray>),
}

/// Columns by name.
pub(crate) type Columns<'a> = Vec<(String, Column<'a>)>;

/// A Parquet file that is written. Each call of [`write`](Table::write) makes a row group.
pub(crate) struct Table(SerializedFileWriter<BufWriter<File>>);

impl Table {
    /// Creates a file for rows with columns of the types of `columns`.
    pub(crate) fn create(
        path: &Path,
        columns: &Columns<'_>,
        metadata: Option<KeyValue>,
    ) -> io::Result<Table> {
        let mut properties = WriterProperties::builder()
            .set_compression(Compression::LZ4_RAW)
            .set_key_value_metadata(metadata.map(|entry| vec![entry]));
        // PNG files are compressed, and no two are equal.
        for (name, _) in columns.iter().filter(|(_, column)| matches!(column, Column::Images(_))) {
            let path = ColumnPath::new(vec![name.clone(), "bytes".to_string()]);
            properties = properties.set_column_compression(path.clone(), Compression::UNCOMPRESSED);
            properties = properties.set_column_dictionary_enabled(path, false);
        }
        let fields = columns.iter().map(|(name, column)| column.field(name)).collect::<Result<_>>();
        let schema = fields.and_then(|fields| Type::group_type_builder("schema").with_fields(fields).build());
        let schema = Arc::new(schema.map_err(io::Error::other)?);
        let file = BufWriter::new(File::create_new(path)?);
        let writer = SerializedFileWriter::new(file, schema, Arc::new(properties.build()));
        Ok(Table(writer.map_err(io::Error::other)?))
    }

    /// Writes a row group.
    pub(crate) fn write(&mut self, columns: &Columns<'_>) -> io::Result<()> {
        let mut write = || {
            let mut group = self.0.next_row_group()?;
            columns.iter().try_for_each(|(_, column)| column.write(&mut group))?;
            group.close().map(drop)
        };
        write().map_err(io::Error::other)
    }

    /// Returns the size of the file so far, bytes.
    pub(crate) fn size(&self) -> usize {
        self.0.bytes_written()
    }

    pub(crate) fn close(self) -> io::Result<()> {
        self.0.close().map(drop).map_err(io::Error::other)
    }
}

impl Column<'_> {
    fn field(&self, name: &str) -> Result<TypePtr> {
        match self {
            Column::Integers(_) => leaf(name, PhysicalType::INT64, None),
            Column::Unsigned(_) => leaf(name, PhysicalType::INT64, Some(LogicalType::integer(64, false))),
            Column::Floats(_) => leaf(name, PhysicalType::FLOAT, None),
            Column::Doubles(_) => leaf(name, PhysicalType::DOUBLE, None),
            Column::Flags(_) => leaf(name, PhysicalType::BOOLEAN, None),
            Column::Texts(_) => leaf(name, PhysicalType::BYTE_ARRAY, Some(LogicalType::String)),
            Column::TextLists(_) => {
                list(name, leaf("element", PhysicalType::BYTE_ARRAY, Some(LogicalType::String))?)
            }
            Column::IntegerLists(_) => list(name, leaf("element", PhysicalType::INT64, None)?),
            Column::DoubleLists(..) => list(name, leaf("element", PhysicalType::DOUBLE, None)?),
            Column::Vectors(..) => list(name, leaf("element", PhysicalType::FLOAT, None)?),
            Column::Images(_) => {
                let bytes = leaf("bytes", PhysicalType::BYTE_ARRAY, None)?;
                let path = leaf("path", PhysicalType::BYTE_ARRAY, Some(LogicalType::String))?;
                let group = Type::group_type_builder(name).with_repetition(Repetition::OPTIONAL);
                Ok(Arc::new(group.with_fields(vec![bytes, path]).build()?))
            }
        }
    }

    fn write<W: io::Write + Send>(&self, group: &mut SerializedRowGroupWriter<'_, W>) -> Result<()> {
        match self {
            Column::Integers(values) | Column::Unsigned(values) => write::<Int64Type, W>(group, values, 1),
            Column::Floats(values) => write::<FloatType, W>(group, values, 1),
            Column::Doubles(values) => write::<DoubleType, W>(group, values, 1),
            Column::Flags(values) => write::<BoolType, W>(group, values, 1),
            Column::Texts(values) => write::<ByteArrayType, W>(group, values, 1),
            Column::TextLists(values) => write_lists::<ByteArrayType, W>(group, values, 1),
            Column::IntegerLists(values) => write_lists::<Int64Type, W>(group, values, 1),
            Column::DoubleLists(values, size) => write_lists::<DoubleType, W>(group, values, *size),
            Column::Vectors(values, size) => write_lists::<FloatType, W>(group, values, *size),
            Column::Images(values) => {
                write::<ByteArrayType, W>(group, values, 2)?;
                // The path is missing in an image that is there.
                write_levels::<ByteArrayType, W>(group, &[], &vec![1; values.len()], None)
            }
        }
    }
}

fn leaf(name: &str, kind: PhysicalType, logical: Option<LogicalType>) -> Result<TypePtr> {
    let builder = Type::primitive_type_builder(name, kind).with_repetition(Repetition::OPTIONAL);
    Ok(Arc::new(builder.with_logical_type(logical).build()?))
}

fn list(name: &str, element: TypePtr) -> Result<TypePtr> {
    let repeated = Type::group_type_builder("list").with_repetition(Repetition::REPEATED);
    let repeated = Arc::new(repeated.with_fields(vec![element]).build()?);
    let outer = Type::group_type_builder(name).with_repetition(Repetition::OPTIONAL);
    Ok(Arc::new(outer.with_logical_type(Some(LogicalType::List)).with_fields(vec![repeated]).build()?))
}

/// Writes the next column, all of whose values are there, at this definition level.
fn write<T: DataType, W: io::Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    values: &[T::T],
    level: i16,
) -> Result<()> {
    write_levels::<T, W>(group, values, &vec![level; values.len()], None)
}

/// Writes the next column: lists of `size` values.
fn write_lists<T: DataType, W: io::Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    values: &[T::T],
    size: usize,
) -> Result<()> {
    let repeats: Vec<i16> = (0..values.len()).map(|index| i16::from(index % size > 0)).collect();
    write_levels::<T, W>(group, values, &vec![3; values.len()], Some(&repeats))
}

fn write_levels<T: DataType, W: io::Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    values: &[T::T],
    definitions: &[i16],
    repeats: Option<&[i16]>,
) -> Result<()> {
    let Some(mut column) = group.next_column()? else {
        return Err(ParquetError::General("more columns than the schema has".to_string()));
    };
    column.typed::<T>().write_batch(values, Some(definitions), repeats)?;
    column.close()
}
