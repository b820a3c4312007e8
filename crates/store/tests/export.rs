//! The exports, compared with lines written by hand, and read back.

use std::path::Path;

use crate::sample::{header, signal};
use bytes::Bytes;
use mishandle_store::{
    IfExists, RunHeader, RunWriter, Simulation, SimulationEnd, StoredTrace, TraceColumn, export_csv,
    export_parquet, export_trace_csv,
};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;

/// A run with two simulations: one with all values, one with as few as possible.
fn run(folder: &Path) -> RunWriter {
    let mut writer = RunWriter::create(folder.join("run"), &header(), IfExists::Refuse).unwrap();
    writer.start_trial(1, 0).unwrap();
    let full = Simulation {
        trial: 1,
        number: 1,
        seed: u64::MAX,
        unit_point: vec![0.1 + 0.2, 1.0],
        scenario: vec![Some(1e-300), Some(-0.0)],
        robustness: Some(f64::NEG_INFINITY),
        robustness_low: Some(f64::NEG_INFINITY),
        robustness_high: Some(-0.25),
        stop_threshold: Some(-0.0),
        end: SimulationEnd::Stopped { step: 17 },
        steps: 17,
        verdicts: vec![Some(0.5), None],
        reason: String::new(),
        trace_digest: Some(0xab),
        trace: None,
    };
    let bare = Simulation {
        number: 2,
        unit_point: vec![],
        scenario: vec![Some(2.0), None],
        robustness: None,
        robustness_low: None,
        robustness_high: None,
        stop_threshold: None,
        end: SimulationEnd::InvalidAction { step: 4, index: 6 },
        steps: 300,
        reason: String::new(),
        trace_digest: None,
        ..full.clone()
    };
    writer.record(&[full, bare]).unwrap();
    writer
}

#[test]
fn simulations_are_exported_with_exact_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let writer = run(folder.path());
    let mut csv = Vec::new();
    export_csv(writer.file(), &mut csv).unwrap();
    assert_eq!(
        String::from_utf8(csv).unwrap(),
        "trial,simulation,seed,robustness,violated,robustness_low,robustness_high,stop_threshold,end,end_step,end_index,steps,u_ball_x,u_ball_velocity_x,ball_x_m,\
         ball_velocity_x_m_per_s,strict_robustness,completion_step,trace_digest\n\
         1,1,18446744073709551615,-inf,1,-inf,-0.25,-0.0,stopped,17,,17,0.30000000000000004,1.0,1e-300,-0.0,0.5,,\
         000000000000000000000000000000ab\n\
         1,2,18446744073709551615,,,,,,invalid action,4,6,300,,,2.0,,0.5,,\n"
    );
}

#[test]
fn a_trace_is_exported_with_time_and_one_column_per_signal() {
    let folder = tempfile::tempdir().unwrap();
    let header = RunHeader {
        control_dt: 0.25,
        signals: vec![signal("a", "m"), signal("say \"b\", c", "")],
        ..header()
    };
    let writer = RunWriter::create(folder.path().join("run"), &header, IfExists::Refuse).unwrap();
    let trace = StoredTrace { columns: vec![vec![1.0, 2.5], vec![f64::INFINITY, f64::NAN]] };
    let mut csv = Vec::new();
    export_trace_csv(writer.file().header(), &trace, &[], &mut csv).unwrap();
    assert_eq!(String::from_utf8(csv).unwrap(), "time,a,\"say \"\"b\"\", c\"\n0.0,1.0,inf\n0.25,2.5,NaN\n");
    let column = |name: &str, unit: &str, values: &[Option<f64>]| TraceColumn {
        name: name.to_string(),
        unit: unit.to_string(),
        values: values.to_vec(),
    };
    let more =
        [column("dq_ball", "m/s", &[Some(0.5), Some(-0.0)]), column("action_joint1", "", &[Some(1.0), None])];
    let mut csv = Vec::new();
    export_trace_csv(writer.file().header(), &trace, &more, &mut csv).unwrap();
    assert_eq!(
        String::from_utf8(csv).unwrap(),
        "time,a,\"say \"\"b\"\", c\",dq_ball_m_per_s,action_joint1\n0.0,1.0,inf,0.5,1.0\n0.25,2.5,NaN,-0.0,\n"
    );
}

#[test]
fn parquet_has_the_columns_and_exact_values_of_the_csv() {
    let folder = tempfile::tempdir().unwrap();
    let writer = run(folder.path());
    let mut csv = Vec::new();
    let mut bytes = Vec::new();
    export_csv(writer.file(), &mut csv).unwrap();
    export_parquet(writer.file(), &mut bytes).unwrap();
    let reader = SerializedFileReader::new(Bytes::from(bytes)).unwrap();
    let text = |field: &Field| match field {
        Field::Null => String::new(),
        Field::ULong(value) => value.to_string(),
        Field::Double(value) => format!("{value:?}"),
        Field::Str(value) => value.clone(),
        other => panic!("unexpected type of {other:?}"),
    };
    let mut lines = Vec::new();
    for row in reader.get_row_iter(None).unwrap() {
        let row = row.unwrap();
        if lines.is_empty() {
            lines.push(row.get_column_iter().map(|(name, _)| name.clone()).collect::<Vec<_>>().join(","));
        }
        lines.push(row.get_column_iter().map(|(_, field)| text(field)).collect::<Vec<_>>().join(","));
    }
    assert_eq!(lines.join("\n") + "\n", String::from_utf8(csv).unwrap());
}

#[test]
fn parquet_without_simulations_or_with_two_columns_of_a_name_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let header = RunHeader { verdicts: vec!["steps".to_string(), "steps_2".to_string()], ..header() };
    let writer = RunWriter::create(folder.path().join("run"), &header, IfExists::Refuse).unwrap();
    let mut bytes = Vec::new();
    export_parquet(writer.file(), &mut bytes).unwrap();
    let reader = SerializedFileReader::new(Bytes::from(bytes)).unwrap();
    let schema = reader.metadata().file_metadata().schema();
    let names: Vec<&str> = schema.get_fields().iter().map(|field| field.name()).collect();
    let distinct: std::collections::BTreeSet<&&str> = names.iter().collect();
    assert_eq!(distinct.len(), names.len(), "{names:?}");
    assert_eq!(reader.get_row_iter(None).unwrap().count(), 0);
}
