//! Records are read back bit for bit and in order, and invalid records are errors.

use crate::sample::{axis, header, record, signal, trace, traced_record};
use mishandle_store::{
    AxisRecord, Counts, FormulaRecord, IfExists, RunFile, RunHeader, RunWriter, Simulation, SimulationEnd,
    StoreError, StoredTrace, TrialStatus,
};
use tempfile::TempDir;

fn new_run() -> (TempDir, RunWriter) {
    let folder = tempfile::tempdir().unwrap();
    let writer = RunWriter::create(folder.path().join("run.sqlite"), &header(), IfExists::Refuse).unwrap();
    (folder, writer)
}

/// Returns all bits of a simulation. `==` on floats does not distinguish -0.0 from 0.0.
fn bits(simulation: &Simulation) -> String {
    let hex = |values: &[Option<f64>]| {
        values.iter().map(|value| format!("{:x?} ", value.map(f64::to_bits))).collect::<String>()
    };
    let Simulation { robustness, robustness_low, robustness_high, stop_threshold, .. } = *simulation;
    let unit_point: Vec<_> = simulation.unit_point.iter().copied().map(Some).collect();
    format!(
        "{simulation:?} {} {} {} {}",
        hex(&unit_point),
        hex(&simulation.scenario),
        hex(&simulation.verdicts),
        hex(&[robustness, robustness_low, robustness_high, stop_threshold])
    )
}

#[test]
fn the_header_is_read_back_unchanged() {
    let (_folder, writer) = new_run();
    let path = writer.file().path().to_owned();
    writer.close().unwrap();
    assert_eq!(RunFile::open(path).unwrap().header(), &header());
}

#[test]
fn simulations_are_read_back_bit_for_bit_and_sorted_for_every_recording_order() {
    let (_folder, mut writer) = new_run();
    for trial in [2, 0, 1] {
        writer.start_trial(trial, u64::MAX - u64::from(trial)).unwrap();
    }
    // More than one page of the iterator, in batches of 1, 2, 3, … simulations, alternating between
    // trials.
    let mut expected = Vec::new();
    let mut first = 1;
    let mut length = 1;
    while first < 700 {
        for trial in [1, 2, 0] {
            let batch: Vec<_> = (first..first + length).map(|number| record(trial, number)).collect();
            writer.record(&batch).unwrap();
            expected.extend(batch);
        }
        first += length;
        length += 1;
    }
    expected.sort_by_key(|simulation| (simulation.trial, simulation.number));
    let path = writer.file().path().to_owned();
    writer.close().unwrap();

    let run = RunFile::open(path).unwrap();
    let got: Vec<Simulation> = run.simulations().map(Result::unwrap).collect();
    assert_eq!(got.len(), expected.len());
    for (got, expected) in got.iter().zip(&expected) {
        assert_eq!(bits(got), bits(expected));
        assert_eq!(bits(&run.simulation(expected.trial, expected.number).unwrap()), bits(expected));
    }
    let of_trial_1: Vec<Simulation> = run.trial_simulations(1).map(Result::unwrap).collect();
    assert_eq!(
        of_trial_1,
        expected.iter().filter(|simulation| simulation.trial == 1).cloned().collect::<Vec<_>>()
    );
    assert_eq!(run.trial_simulations(3).count(), 0);
    run.check().unwrap();
}

#[test]
fn extreme_values_are_read_back_unchanged() {
    let hard = [-0.0, 5e-324, f64::MAX, f64::MIN, 0.1 + 0.2, 1e15, -3.0, f64::INFINITY, f64::NEG_INFINITY];
    let (_folder, mut writer) = new_run();
    writer.start_trial(1, 0).unwrap();
    for (number, value) in (1..).zip(hard) {
        let mut record = record(1, number);
        record.robustness = Some(value);
        record.robustness_low = Some(value);
        record.robustness_high = Some(value);
        record.stop_threshold = Some(value);
        record.verdicts = vec![Some(value), None];
        record.seed = [0, 1 << 63, u64::MAX][number as usize % 3];
        if value.is_finite() {
            record.unit_point = vec![value, -value];
            record.scenario = vec![Some(-value), Some(value)];
        }
        writer.record(std::slice::from_ref(&record)).unwrap();
        assert_eq!(bits(&writer.file().simulation(1, number).unwrap()), bits(&record));
    }
}

#[test]
fn a_simulation_without_a_unit_point_and_a_run_without_axes_are_valid() {
    let (_folder, mut writer) = new_run();
    writer.start_trial(1, 0).unwrap();
    let mut bare = record(1, 1);
    bare.unit_point.clear();
    writer.record(std::slice::from_ref(&bare)).unwrap();
    assert_eq!(writer.file().simulation(1, 1).unwrap(), bare);

    let folder = tempfile::tempdir().unwrap();
    let nothing = RunHeader { axes: vec![], verdicts: vec![], signals: vec![], ..header() };
    let mut writer = RunWriter::create(folder.path().join("run"), &nothing, IfExists::Refuse).unwrap();
    writer.start_trial(1, 0).unwrap();
    let bare = Simulation { unit_point: vec![], scenario: vec![], verdicts: vec![], ..bare };
    writer.record(std::slice::from_ref(&bare)).unwrap();
    assert_eq!(writer.file().simulation(1, 1).unwrap(), bare);
}

#[test]
fn stored_traces_are_read_back() {
    let (_folder, mut writer) = new_run();
    writer.start_trial(1, 0).unwrap();
    writer.record(&[record(1, 1), traced_record(1, 2)]).unwrap();
    let mut diverged = traced_record(1, 3);
    diverged.trace = Some(StoredTrace { columns: vec![vec![1.0, f64::NAN], vec![f64::INFINITY, -0.0]] });
    diverged.trace_digest = None;
    writer.record(std::slice::from_ref(&diverged)).unwrap();

    let run = writer.file();
    assert_eq!(run.simulation(1, 1).unwrap().trace, None);
    assert_eq!(run.simulation(1, 2).unwrap(), traced_record(1, 2));
    assert_eq!(run.stored_traces().unwrap(), [(1, 2), (1, 3)]);
    assert!(run.simulations().all(|simulation| simulation.unwrap().trace.is_none()));
    // The writer computes a missing digest; NaN is compared by its bits.
    let read = run.simulation(1, 3).unwrap();
    assert_eq!(read.trace_digest, Some(diverged.trace.unwrap().digest()));
    assert!(read.trace.unwrap().columns[0][1].is_nan());
}

#[test]
fn counts_match_the_records() {
    let (_folder, mut writer) = new_run();
    writer.start_trial(1, 11).unwrap();
    writer.start_trial(2, 22).unwrap();
    let with = |number, robustness, end| {
        let mut record = record(1, number);
        record.robustness = robustness;
        record.end = end;
        record
    };
    writer
        .record(&[
            with(1, Some(0.5), SimulationEnd::Completed),
            with(2, Some(-0.25), SimulationEnd::Stopped { step: 9 }),
            with(3, Some(-0.0), SimulationEnd::Completed), // violated, at the border
            with(4, None, SimulationEnd::Completed),
            with(5, Some(f64::INFINITY), SimulationEnd::Diverged { step: 7 }),
            with(6, None, SimulationEnd::InvalidAction { step: 0, index: 0 }),
            with(7, None, SimulationEnd::InvalidObservation { step: 0, index: 0 }),
            with(8, None, SimulationEnd::InvalidReward { step: 1, index: 2 }),
            with(9, None, SimulationEnd::InvalidSignal { step: 1, index: 2 }),
            with(10, None, SimulationEnd::InvalidScenario),
        ])
        .unwrap();
    writer.end_trial(1, TrialStatus::Falsified).unwrap();

    let expected = Counts { simulations: 10, falsified: 2, undecided: 6, diverged: 1, invalid: 4 };
    let run = writer.file();
    assert_eq!(run.counts().unwrap(), expected);
    let [first, second] = run.trials().unwrap()[..] else { panic!("two trials") };
    assert_eq!(first.counts, expected);
    assert_eq!((first.trial.number, first.trial.seed, first.trial.status), (1, 11, TrialStatus::Falsified));
    assert_eq!(first.minimum_robustness, Some(-0.25));
    assert_eq!(second.counts, Counts::default());
    assert_eq!((second.trial.status, second.minimum_robustness), (TrialStatus::Running, None));
    assert_eq!((run.last_simulation_number(1).unwrap(), run.last_simulation_number(2).unwrap()), (10, 0));
}

#[test]
fn every_status_is_read_back() {
    let (_folder, mut writer) = new_run();
    writer.start_trial(1, 0).unwrap();
    for status in
        [TrialStatus::Falsified, TrialStatus::BudgetSpent, TrialStatus::Converged, TrialStatus::Running]
    {
        writer.end_trial(1, status).unwrap();
        assert_eq!(writer.file().trial(1).unwrap().status, status);
    }
}

#[test]
fn a_resumed_run_continues_after_its_last_record() {
    let (_folder, mut writer) = new_run();
    let path = writer.file().path().to_owned();
    writer.start_trial(1, 0).unwrap();
    writer.record(&[record(1, 1), record(1, 2)]).unwrap();
    drop(writer);
    let mut writer = RunWriter::resume(&path).unwrap();
    assert_eq!(writer.file().last_simulation_number(1).unwrap(), 2);
    writer.record(&[record(1, 3)]).unwrap();
    writer.close().unwrap();
    let run = RunFile::open(&path).unwrap();
    assert_eq!(run.header(), &header());
    assert_eq!(run.simulations().map(|simulation| simulation.unwrap().number).collect::<Vec<_>>(), [1, 2, 3]);
}

#[test]
fn the_content_digest_ignores_batches_and_detects_every_difference() {
    let digest = |batches: &[&[Simulation]], status| {
        let (_folder, mut writer) = new_run();
        writer.start_trial(1, 5).unwrap();
        batches.iter().for_each(|batch| writer.record(batch).unwrap());
        writer.end_trial(1, status).unwrap();
        writer.file().content_digest().unwrap()
    };
    let records: Vec<_> = (1..=600).map(|number| record(1, number)).collect();
    let budget_spent = TrialStatus::BudgetSpent;
    let converged = TrialStatus::Converged;
    let one = digest(&[&records], budget_spent);
    assert_eq!(digest(&[&records[..100], &records[100..101], &records[101..]], budget_spent), one);
    assert_eq!(digest(&[&records[300..], &records[..300]], budget_spent), one);

    assert_ne!(digest(&[&records], converged), one);
    assert_ne!(digest(&[&records[..599]], budget_spent), one);
    let changes: [fn(&mut Simulation); 14] = [
        |simulation| simulation.seed ^= 1,
        |simulation| simulation.steps += 1,
        |simulation| simulation.robustness = Some(0.0), // it was -0.0
        |simulation| simulation.unit_point[1] = -0.0,
        |simulation| simulation.scenario[0] = Some(0.5),
        |simulation| simulation.scenario[1] = None,
        |simulation| simulation.robustness_low = None,
        |simulation| simulation.robustness_high = Some(0.0), // it was -0.0
        |simulation| simulation.stop_threshold = Some(0.0),  // it was None
        |simulation| simulation.verdicts[1] = Some(0.0),     // it was None
        |simulation| simulation.end = SimulationEnd::Stopped { step: 1 },
        |simulation| simulation.end = SimulationEnd::InvalidObservation { step: 598, index: 1 }, // it was 597
        |simulation| simulation.trace_digest = None,
        |simulation| simulation.number += 1000,
    ];
    for (index, change) in changes.into_iter().enumerate() {
        let mut changed = records.clone();
        change(&mut changed[596]);
        assert_ne!(digest(&[&changed], budget_spent), one, "change {index}");
    }
}

#[test]
fn a_reader_sees_each_transaction_of_a_running_writer() {
    let (_folder, mut writer) = new_run();
    let reader = RunFile::open(writer.file().path()).unwrap();
    writer.start_trial(1, 0).unwrap();
    for number in 1..=3 {
        writer.record(&[record(1, number)]).unwrap();
        assert_eq!(reader.counts().unwrap().simulations, u64::from(number));
    }
    writer.close().unwrap();
    assert_eq!(reader.counts().unwrap().simulations, 3);
}

#[test]
fn a_closed_run_is_a_single_file() {
    let (folder, mut writer) = new_run();
    writer.start_trial(1, 0).unwrap();
    writer.record(&[traced_record(1, 1)]).unwrap();
    writer.close().unwrap();
    let names: Vec<_> =
        std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names, ["run.sqlite"]);
}

#[test]
fn the_log_does_not_grow_with_the_run() {
    let (folder, mut writer) = new_run();
    writer.start_trial(1, 0).unwrap();
    let numbers: Vec<u32> = (1..=60_000).collect();
    for batch in numbers.chunks(200) {
        writer.record(&batch.iter().map(|&number| record(1, number)).collect::<Vec<_>>()).unwrap();
    }
    // SQLite moves the log into the file every 1,000 pages of 4 KiB.
    let log = folder.path().join("run.sqlite-wal").metadata().unwrap().len();
    assert!(log < 6 << 20, "{log} bytes");
}

// Invalid records and headers.

#[track_caller]
fn check_rejected(change: impl FnOnce(&mut Simulation), message: &str) {
    let (_folder, mut writer) = new_run();
    writer.start_trial(1, 0).unwrap();
    writer.record(&[record(1, 1)]).unwrap();
    let mut invalid = traced_record(1, 3);
    change(&mut invalid);
    let error = writer.record(&[record(1, 2), invalid]).unwrap_err();
    assert_eq!(error.to_string(), message);
    // No simulation of the batch is recorded, and the writer remains usable.
    assert_eq!(writer.file().counts().unwrap().simulations, 1);
    writer.record(&[record(1, 2)]).unwrap();
}

#[test]
fn an_invalid_record_rejects_its_whole_batch() {
    let cannot = "cannot record simulation 3 of trial 1: its";
    check_rejected(
        |record| record.scenario.truncate(1),
        &format!("{cannot} scenario has 1 elements, the run's header requires 2"),
    );
    check_rejected(
        |record| record.unit_point.push(0.0),
        &format!("{cannot} unit point has 3 elements, the run's header requires 2"),
    );
    check_rejected(
        |record| record.verdicts.clear(),
        &format!("{cannot} list of verdicts has 0 elements, the run's header requires 2"),
    );
    check_rejected(
        |record| record.trace.as_mut().unwrap().columns.truncate(1),
        &format!("{cannot} trace has 1 elements, the run's header requires 2"),
    );
    check_rejected(
        |record| record.trace.as_mut().unwrap().columns[1].truncate(52),
        &format!("{cannot} trace has 52 samples of `ball_height`, but 53 of `ball_hole_distance`"),
    );
    check_rejected(|record| record.robustness = Some(f64::NAN), &format!("{cannot} robustness is NaN"));
    check_rejected(
        |record| record.scenario[1] = Some(f64::INFINITY),
        &format!("{cannot} scenario value of axis `ball_velocity_x` is inf"),
    );
    check_rejected(
        |record| record.robustness_low = Some(f64::NAN),
        &format!("{cannot} lower bound of the robustness is NaN"),
    );
    check_rejected(
        |record| record.robustness_high = Some(f64::NAN),
        &format!("{cannot} upper bound of the robustness is NaN"),
    );
    check_rejected(
        |record| record.stop_threshold = Some(f64::NAN),
        &format!("{cannot} stop threshold is NaN"),
    );
    check_rejected(
        |record| record.unit_point[0] = f64::NAN,
        &format!("{cannot} unit point value of axis `ball_x` is NaN"),
    );
    check_rejected(
        |record| record.verdicts[0] = Some(f64::NAN),
        &format!("{cannot} verdict `strict_robustness` is NaN"),
    );
    check_rejected(
        |record| record.trace_digest = Some(0xabc),
        &format!(
            "{cannot} trace digest is 00000000000000000000000000000abc, but its trace has the digest {:032x}",
            trace(53).digest()
        ),
    );
    check_rejected(
        |record| record.number = 0,
        "cannot record simulation 0 of trial 1: simulations of a trial are numbered from 1",
    );
    check_rejected(
        |record| record.number = 1,
        "cannot record simulation 1 of trial 1: the run already contains it",
    );
    check_rejected(|record| record.trial = 4, "the run has no trial 4");
}

#[test]
fn an_unknown_trial_or_simulation_is_an_error_that_names_it() {
    let (_folder, mut writer) = new_run();
    writer.start_trial(1, 0).unwrap();
    let run = writer.file();
    assert_eq!(run.simulation(1, 2).unwrap_err().to_string(), "the run has no simulation 2 of trial 1");
    assert_eq!(run.trial(9).unwrap_err().to_string(), "the run has no trial 9");
    let error = writer.end_trial(9, TrialStatus::Converged).unwrap_err();
    assert_eq!(error.to_string(), "the run has no trial 9");
    assert_eq!(
        writer.start_trial(1, 3).unwrap_err().to_string(),
        "cannot record trial 1: the run already contains it"
    );
}

#[test]
fn an_invalid_header_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let axis = |name, low| axis(name, "", low, 1.0);
    let formula = |text: &str| FormulaRecord { name: "safe".into(), text: text.into() };
    for (header, message) in [
        (
            RunHeader { signals: vec![signal("a", "m"), signal("b", ""), signal("a", "")], ..header() },
            "cannot create a run: two of its signals have the name `a`; names must be unique",
        ),
        (
            RunHeader { axes: vec![axis("x", 0.0), axis("x", 0.0)], ..header() },
            "cannot create a run: two of its axes have the name `x`; names must be unique",
        ),
        (
            RunHeader { formulas: vec![formula("a"), formula("b")], ..header() },
            "cannot create a run: two of its formulas have the name `safe`; names must be unique",
        ),
        (
            RunHeader { versions: vec![("a".into(), "1".into()), ("a".into(), "2".into())], ..header() },
            "cannot create a run: two of its versions have the name `a`; names must be unique",
        ),
        (
            RunHeader {
                axes: vec![AxisRecord { nominal: Some(f64::INFINITY), ..axis("x", 0.0) }],
                ..header()
            },
            "cannot create a run: axis `x` has the nominal value inf; it must be finite",
        ),
        (
            RunHeader { axes: vec![axis("x", f64::NAN)], ..header() },
            "cannot create a run: axis `x` has the bounds NaN and 1; they must be finite",
        ),
        (
            RunHeader { control_dt: f64::NAN, ..header() },
            "cannot create a run: its control period is NaN s; it must be positive and finite",
        ),
    ] {
        let path = folder.path().join("run.sqlite");
        assert_eq!(RunWriter::create(&path, &header, IfExists::Refuse).unwrap_err().to_string(), message);
        assert!(!path.exists());
    }
}

#[test]
fn an_existing_run_is_replaced_only_on_request() {
    let (_folder, mut writer) = new_run();
    let path = writer.file().path().to_owned();
    writer.start_trial(1, 0).unwrap();
    // A run that is being written is not replaced.
    assert!(matches!(RunWriter::create(&path, &header(), IfExists::Replace), Err(StoreError::Locked { .. })));
    writer.close().unwrap();
    assert!(matches!(RunWriter::create(&path, &header(), IfExists::Refuse), Err(StoreError::Exists { .. })));
    assert_eq!(RunFile::open(&path).unwrap().trials().unwrap().len(), 1);

    let header = RunHeader { seed: 3, ..header() };
    let writer = RunWriter::create(&path, &header, IfExists::Replace).unwrap();
    assert_eq!((writer.file().header(), writer.file().trials().unwrap().len()), (&header, 0));
}

#[test]
fn a_run_has_one_writer_at_a_time() {
    let (_folder, writer) = new_run();
    let path = writer.file().path().to_owned();
    let error = RunWriter::resume(&path).unwrap_err();
    assert!(matches!(error, StoreError::Locked { .. }), "{error}");
    writer.close().unwrap();
    RunWriter::resume(&path).unwrap();
}

#[test]
fn a_second_writer_is_locked_out_between_two_transactions() {
    let (_folder, mut writer) = new_run();
    let path = writer.file().path().to_owned();
    std::thread::scope(|scope| {
        let second = scope.spawn(|| (0..50).map(|_| RunWriter::resume(&path).map(drop)).collect::<Vec<_>>());
        let mut trial = 0;
        while !second.is_finished() {
            trial += 1;
            writer.start_trial(trial, 0).unwrap();
        }
        let is_locked = |result: &Result<(), StoreError>| matches!(result, Err(StoreError::Locked { .. }));
        assert!(second.join().unwrap().iter().all(is_locked));
    });
}

#[test]
fn a_run_with_references_to_missing_rows_is_not_resumed() {
    for deleted in ["DELETE FROM trial WHERE number = 1", "DELETE FROM simulation WHERE number = 1"] {
        let (_folder, mut writer) = new_run();
        let path = writer.file().path().to_owned();
        writer.start_trial(1, 0).unwrap();
        writer.record(&[traced_record(1, 1)]).unwrap();
        writer.close().unwrap();
        let connection = rusqlite::Connection::open(&path).unwrap();
        connection.execute_batch("PRAGMA foreign_keys = off").unwrap();
        connection.execute_batch(deleted).unwrap();
        drop(connection);
        let error = RunWriter::resume(&path).unwrap_err();
        assert!(matches!(error, StoreError::Damaged { .. }), "{deleted}: {error}");
    }
}

#[test]
fn a_run_whose_lock_file_cannot_be_locked_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    RunWriter::create(&path, &header(), IfExists::Refuse).unwrap().close().unwrap();
    let before = std::fs::read(&path).unwrap();
    // Something that is not a file has the name of the lock.
    std::fs::create_dir(folder.path().join("run.sqlite.lock")).unwrap();
    for existing in [IfExists::Refuse, IfExists::Replace] {
        assert!(RunWriter::create(&path, &header(), existing).is_err());
    }
    let error = RunWriter::resume(&path).unwrap_err().to_string();
    assert!(error.starts_with("cannot lock "), "{error}");
    assert!(std::fs::read(&path).unwrap() == before);
}

#[test]
fn a_second_creator_never_evicts_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let mut writer = RunWriter::create(&path, &header(), IfExists::Refuse).unwrap();
    for trial in 1..=20 {
        for existing in [IfExists::Refuse, IfExists::Replace] {
            assert!(RunWriter::create(&path, &header(), existing).is_err());
        }
        writer.start_trial(trial, 0).unwrap();
    }
    writer.close().unwrap();
    assert_eq!(RunFile::open(&path).unwrap().trials().unwrap().len(), 20);
    // Of several processes that create the same run, one succeeds.
    std::fs::remove_file(&path).unwrap();
    let created = std::thread::scope(|scope| {
        let create = || RunWriter::create(&path, &header(), IfExists::Refuse);
        let threads: Vec<_> = (0..8).map(|_| scope.spawn(create)).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect::<Vec<_>>()
    });
    assert_eq!(created.iter().filter(|run| run.is_ok()).count(), 1, "{created:?}");
}

#[test]
fn a_header_that_is_too_large_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let plan = RunHeader { plan: "#".repeat((1 << 20) + 1), ..header() };
    let error = RunWriter::create(&path, &plan, IfExists::Refuse).unwrap_err().to_string();
    assert_eq!(error, "cannot create a run: `plan` has 1048577 bytes; it must have at most 1048576");
    let verdicts = RunHeader { verdicts: (0..100_001).map(|i| i.to_string()).collect(), ..header() };
    let error = RunWriter::create(&path, &verdicts, IfExists::Refuse).unwrap_err().to_string();
    assert!(error.contains("its table `verdict` would have 100001 rows"), "{error}");
    let name = RunHeader { verdicts: vec!["v".repeat(5000)], ..header() };
    let error = RunWriter::create(&path, &name, IfExists::Refuse).unwrap_err().to_string();
    assert!(error.contains("its table `verdict` would have a name of 5000 bytes"), "{error}");
    let whole = RunHeader { plan: "#".repeat(1 << 20), ..header() };
    RunWriter::create(&path, &whole, IfExists::Refuse).unwrap().close().unwrap();
    assert_eq!(RunFile::open(&path).unwrap().header(), &whole);
}
