//! Exports simulations of a run as Parquet.

use std::collections::BTreeSet;
use std::io::Write;
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as PhysicalType};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{Type, TypePtr};

use crate::columns::{Field, FieldType, columns, fields};
use crate::{Result, RunFile, RunHeader, StoreError};

/// Number of simulations that are in memory at a time.
const ROW_GROUP: usize = 1 << 16;

/// Writes all simulations of a run as Parquet, with the columns of
/// [`export_csv`](crate::export_csv).
///
/// Integers are unsigned 64-bit, numbers are 64-bit floats with their bits, `end` and
/// `trace_digest` are strings; missing values are null. If two columns have the same name, a number
/// is appended to the later one. Pages are compressed with LZ4.
///
/// # Errors
/// [`Write`](StoreError::Write) if `writer` fails, or an error of the run file.
pub fn export_parquet(run: &RunFile, writer: &mut (impl Write + Send)) -> Result<()> {
    let header = run.header();
    let properties = WriterProperties::builder().set_compression(Compression::LZ4_RAW).build();
    let schema = schema(header).map_err(failed)?;
    let mut file = SerializedFileWriter::new(writer, schema, Arc::new(properties)).map_err(failed)?;
    let mut rows: Vec<Vec<Field>> = Vec::new();
    for simulation in run.simulations() {
        rows.push(fields(&simulation?, header.axes.len()));
        if rows.len() == ROW_GROUP {
            write(&mut file, &rows).map_err(failed)?;
            rows.clear();
        }
    }
    write(&mut file, &rows).and_then(|()| file.close()).map_err(failed)?;
    Ok(())
}

fn schema(header: &RunHeader) -> std::result::Result<TypePtr, ParquetError> {
    let mut taken = BTreeSet::new();
    let column = |(name, kind): (String, FieldType)| {
        let numbered = (2..).map(|number: u32| format!("{name}_{number}"));
        let mut candidates = std::iter::once(name.clone()).chain(numbered);
        let free = candidates.find(|candidate| taken.insert(candidate.clone())).unwrap_or_default();
        let (physical, logical) = match kind {
            FieldType::Integer => (PhysicalType::INT64, Some(LogicalType::integer(64, false))),
            FieldType::Number => (PhysicalType::DOUBLE, None),
            FieldType::Text => (PhysicalType::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let builder = Type::primitive_type_builder(&free, physical);
        Ok(Arc::new(builder.with_repetition(Repetition::OPTIONAL).with_logical_type(logical).build()?))
    };
    let columns =
        columns(header).into_iter().map(column).collect::<std::result::Result<_, ParquetError>>()?;
    Ok(Arc::new(Type::group_type_builder("simulation").with_fields(columns).build()?))
}

/// Writes rows as a row group.
fn write<W: Write + Send>(
    file: &mut SerializedFileWriter<W>,
    rows: &[Vec<Field>],
) -> std::result::Result<(), ParquetError> {
    let mut group = file.next_row_group()?;
    for column in 0..rows.first().map_or(0, Vec::len) {
        write_column(&mut group, rows, column)?;
    }
    if rows.is_empty() {
        // A row group needs all columns, also without rows.
        while let Some(column) = group.next_column()? {
            column.close()?;
        }
    }
    group.close()?;
    Ok(())
}

fn write_column<W: Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    rows: &[Vec<Field>],
    column: usize,
) -> std::result::Result<(), ParquetError> {
    let Some(mut writer) = group.next_column()? else { return Ok(()) };
    let mut levels = Vec::new();
    let mut integers = Vec::new();
    let mut numbers = Vec::new();
    let mut texts = Vec::new();
    for row in rows {
        let is_present = match &row[column] {
            // The logical type is unsigned, the physical one has the same bits.
            Field::Integer(value) => value.map(|value| integers.push(value.cast_signed())),
            Field::Number(value) => value.map(|value| numbers.push(value)),
            Field::Text(value) => value.as_deref().map(|value| texts.push(ByteArray::from(value))),
        };
        levels.push(i16::from(is_present.is_some()));
    }
    match &rows[0][column] {
        Field::Integer(_) => writer.typed::<Int64Type>().write_batch(&integers, Some(&levels), None)?,
        Field::Number(_) => writer.typed::<DoubleType>().write_batch(&numbers, Some(&levels), None)?,
        Field::Text(_) => writer.typed::<ByteArrayType>().write_batch(&texts, Some(&levels), None)?,
    };
    writer.close()
}

fn failed(error: ParquetError) -> StoreError {
    StoreError::Write { what: "cannot write the Parquet file".into(), source: std::io::Error::other(error) }
}
