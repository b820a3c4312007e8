use mishandle_training::{Checkpoint, PartValidation, Rates, TimeShares, TrainingProgress, Validation};

use super::*;
use crate::error::MishandleError;

/// Returns the progress of a run with two reward terms; an iteration has 512 environment steps and
/// takes 0.5 s.
fn progress(iteration: u64) -> TrainingProgress {
    TrainingProgress {
        iteration,
        environment_steps: 512 * iteration,
        total_steps: 1_000_000,
        steps_per_second: 1024.0,
        wall_clock_secs: 0.5 * iteration as f64,
        mean_return: (iteration > 1).then_some(-0.1 * iteration as f64),
        mean_episode_steps: (iteration > 1).then_some(299.5),
        terminated_rate: (iteration > 1).then_some(1.0 / 3.0),
        diverged: 0,
        reward_terms: vec![0.1 + 0.2, -1e-9],
        validation: Some(Validation::of_starts(Rates {
            success_rate: 0.75,
            strict_success_rate: 0.5,
            mean_return: -7.0,
        })),
        validation_is_fresh: iteration.is_multiple_of(2),
        scenario_share: None,
        kl: Some(0.01),
        entropy: None,
        learning_rate: 1e-5,
        time_shares: TimeShares { physics: 0.5, inference: 0.25, learning: 0.25 },
    }
}

fn columns(reward_terms: &[String]) -> CurveColumns<'_> {
    CurveColumns { has_scenarios: false, has_curriculum: false, reward_terms }
}

fn terms() -> Vec<String> {
    vec!["distance".to_string(), "a,b".to_string()]
}

fn checkpoint(iteration: u64) -> Checkpoint {
    let mut checkpoint = Checkpoint::new("ppo", "toy", 0, "");
    checkpoint.put("iteration", vec![iteration]);
    checkpoint.put("wall_clock_secs", vec![progress(iteration).wall_clock_secs]);
    checkpoint
}

struct Example {
    folder: tempfile::TempDir,
}

impl Example {
    /// Writes a curve of three iterations.
    fn new() -> Example {
        let example = Example { folder: tempfile::tempdir().unwrap() };
        let mut writer = CurveWriter::create(&example.path(), columns(&terms())).unwrap();
        for iteration in 1..=3 {
            writer.write(&progress(iteration)).unwrap();
        }
        example
    }

    fn path(&self) -> std::path::PathBuf {
        self.folder.path().join("curve.csv")
    }

    fn text(&self) -> String {
        std::fs::read_to_string(self.path()).unwrap()
    }

    fn resume(&self, terms: &[String], iteration: u64) -> Result<CurveWriter, MishandleError> {
        CurveWriter::resume(&self.path(), columns(terms), &checkpoint(iteration))
    }
}

#[test]
fn the_file_has_the_documented_columns() {
    let text = Example::new().text();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(
        lines[0],
        "iteration,environment_steps,wall_clock_secs,mean_return,mean_episode_steps,terminated_rate,\
         success_rate,strict_success_rate,validation_return,kl,entropy,learning_rate,physics_share,\
         inference_share,learning_share,reward_distance,\"reward_a,b\""
    );
    assert_eq!(
        lines[1],
        "1,512,0.500000000,,,,,,,0.01,,0.00001,0.5000,0.2500,0.2500,0.30000000000000004,-0.000000001"
    );
    assert!(
        lines[2].starts_with("2,1024,1.000000000,-0.2,299.5,0.3333333333333333,0.75,0.5,-7,0.01,,"),
        "{text}"
    );
    assert!(lines[3].contains(",299.5,0.3333333333333333,,,,0.01,"), "{text}");
    assert_eq!(lines.len(), 4);
}

#[test]
fn a_curve_round_trips() {
    let curve = Curve::load(&Example::new().path()).unwrap();
    assert_eq!(curve.reward_terms, terms());
    assert_eq!(curve.rows, [1, 2, 3].map(|iteration| CurveRow::from(&progress(iteration))));
    assert_eq!((curve.rows[0].validation, curve.rows[1].validation.is_some()), (None, true));
}

#[test]
fn a_resumed_run_replaces_the_rows_after_its_checkpoint() {
    let example = Example::new();
    let whole = example.text();
    let mut writer = example.resume(&terms(), 2).unwrap();
    // Opening the file does not change it.
    assert_eq!(example.text(), whole);
    writer.write(&progress(3)).unwrap();
    assert_eq!(example.text(), whole);
    writer.write(&progress(4)).unwrap();
    assert_eq!(Curve::load(&example.path()).unwrap().rows.len(), 4);
    // A run without further iterations removes the later rows at its end.
    example.resume(&terms(), 2).unwrap().finish().unwrap();
    assert_eq!(Curve::load(&example.path()).unwrap().rows.len(), 2);
}

#[test]
fn an_incomplete_line_after_the_checkpoint_is_replaced() {
    let example = Example::new();
    let whole = example.text();
    std::fs::write(example.path(), &whole[..whole.len() - 20]).unwrap();
    let cut = Curve::load(&example.path()).unwrap();
    assert_eq!((cut.rows.len(), cut.is_truncated), (2, true));
    example.resume(&terms(), 2).unwrap().write(&progress(3)).unwrap();
    assert_eq!(example.text(), whole);
    // The file ends within the last number, so the line has all its cells.
    std::fs::write(example.path(), &whole[..whole.len() - 3]).unwrap();
    assert_eq!(Curve::load(&example.path()).unwrap(), cut);
    assert!(example.resume(&terms(), 3).unwrap_err().to_string().contains("no row for iteration 3"));
    // A file that ends within its header has no columns.
    std::fs::write(example.path(), &whole[..20]).unwrap();
    assert!(Curve::load(&example.path()).unwrap_err().to_string().contains("column 1 of the header is ``"));
}

#[test]
fn a_curve_of_another_training_run_is_an_error_and_unchanged() {
    let example = Example::new();
    let whole = example.text();
    let error = |terms: &[String], iteration| example.resume(terms, iteration).unwrap_err().to_string();
    assert!(error(&terms(), 5).contains("no row for iteration 5"), "{}", error(&terms(), 5));
    assert!(
        error(&["a".to_string()], 2)
            .ends_with("its reward terms are distance, a,b, those of this training are a")
    );
    let mut other = checkpoint(2);
    other.put("wall_clock_secs", vec![1.000_000_002]);
    let message = CurveWriter::resume(&example.path(), columns(&terms()), &other).unwrap_err().to_string();
    assert!(
        message.ends_with("time of iteration 2 is 1.000000000 s, in the checkpoint 1.000000002 s"),
        "{message}"
    );
    assert!(CurveWriter::create(&example.path(), columns(&terms())).is_err());
    assert_eq!(example.text(), whole);
    // A missing file is created.
    std::fs::remove_file(example.path()).unwrap();
    example.resume(&terms(), 2).unwrap().write(&progress(3)).unwrap();
    assert_eq!(Curve::load(&example.path()).unwrap().rows[0].iteration, 3);
}

/// Checks the error of reading the example with `from` replaced by `to`.
#[track_caller]
fn check_error(from: &str, to: &str, expected: &str) {
    let example = Example::new();
    let text = example.text();
    assert!(text.contains(from), "{text}");
    std::fs::write(example.path(), text.replacen(from, to, 1)).unwrap();
    let error = Curve::load(&example.path()).unwrap_err().to_string();
    assert!(error.contains("curve.csv: ") && error.contains(expected), "{error}");
    assert!(!error.contains('\n'));
}

#[test]
fn infinite_values_of_a_diverging_run_round_trip() {
    let example = Example::new();
    let diverging =
        TrainingProgress { mean_return: Some(f64::NEG_INFINITY), kl: Some(f64::INFINITY), ..progress(1) };
    std::fs::remove_file(example.path()).unwrap();
    CurveWriter::create(&example.path(), columns(&terms())).unwrap().write(&diverging).unwrap();
    assert_eq!(Curve::load(&example.path()).unwrap().rows, [CurveRow::from(&diverging)]);
}

#[test]
fn errors_of_an_edited_file_name_the_line() {
    check_error("kl,entropy", "entropy,kl", "column 10 of the header is `entropy`, expected `kl`");
    check_error(
        "reward_distance",
        "distance",
        "column 16 of the header is `distance`, expected `reward_` and",
    );
    check_error("\n2,1024", "\n2,many", "line 3: environment_steps is `many`, expected a whole number");
    check_error("\n2,1024", "\n4,1024", "line 3: iteration 4 cannot follow iteration 1");
    check_error("\n2,1024", "\n2,512", "line 3: 512 environment steps cannot follow 512");
    check_error("-0.2,", "low,", "line 3: mean_return is `low`, expected a number or an empty cell");
    check_error("0.00001", "NaN", "line 2: learning_rate is `NaN`, expected a finite number");
    check_error("0.00001", "", "line 2: learning_rate is ``, expected a finite number");
    check_error(
        "0.75,0.5,-7",
        "0.75,,-7",
        "line 3: validation_return is `-7`, expected a number beside both",
    );
    check_error(
        "-0.2,",
        "",
        "line 3: the number of cells is 16; it must be 17, one for each name in the header",
    );
    check_error("\n2,1024", "\n2,1024,1", "line 3: the number of cells is 18; it must be 17");
    check_error("iteration,", "", "column 1 of the header is `environment_steps`");
}

#[test]
fn lines_are_those_of_the_file_also_after_blank_lines() {
    check_error("\n2,1024", "\n\n\n2,many", "line 5: environment_steps is `many`");
    check_error("\n2,1024", "\r\n\r\n\r\n2,many", "line 5: environment_steps is `many`");
    check_error("\n2,1024", "\n\n\n4,1024", "line 5: iteration 4 cannot follow iteration 1");
    check_error("\n2,1024", "\n\n2,1024,1", "line 4: the number of cells is 18");
}

#[test]
fn a_header_with_another_separator_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("curve.csv");
    for (separator, name) in [(";", "semicolons"), ("\t", "tabs")] {
        std::fs::write(&path, COLUMNS.join(separator) + "\n").unwrap();
        let error = Curve::load(&path).unwrap_err().to_string();
        assert!(error.contains(&format!("the header is separated by {name}; expected commas")), "{error}");
    }
}

#[test]
fn files_that_are_not_text_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("curve.csv");
    let message = || Curve::load(&path).unwrap_err().to_string();
    let missing = Curve::load(&path).unwrap_err();
    assert!(std::error::Error::source(&missing).is_some(), "{missing}");
    std::fs::write(&path, "").unwrap();
    assert!(message().contains("column 1 of the header is ``, expected `iteration`"), "{}", message());
    std::fs::write(&path, b"a\n\n\xff\xfe\x00\n").unwrap();
    assert!(message().contains("line 3 is not UTF-8 text"), "{}", message());
    let device = Curve::load(Path::new("/dev/zero")).unwrap_err();
    let cause = std::error::Error::source(&device).unwrap().to_string();
    assert_eq!(cause, "expected a regular file, found a device");
}

#[test]
fn validations_on_scenarios_have_columns_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("curve.csv");
    let terms = terms();
    let shape = CurveColumns { has_scenarios: true, has_curriculum: false, reward_terms: &terms };
    let mut writer = CurveWriter::create(&path, shape).unwrap();
    let rates = |success_rate| Rates { success_rate, strict_success_rate: 0.25, mean_return: 1.0 / 3.0 };
    let starts = progress(2).validation.unwrap();
    let validation = Some(Validation { space: Some(rates(0.5)), corners: Some(rates(0.125)), ..starts });
    let expected = [1, 2].map(|iteration| TrainingProgress { validation, ..progress(iteration) });
    expected.iter().for_each(|progress| writer.write(progress).unwrap());
    let curve = Curve::load(&path).unwrap();
    assert_eq!(curve.rows, expected.each_ref().map(CurveRow::from));
    assert!(curve.has_scenarios && curve.rows[0].validation.is_none());
    assert_eq!((curve.rows[1].validation, &curve.reward_terms), (validation, &terms));
    assert!(CurveWriter::resume(&path, shape, &checkpoint(2)).is_ok());
    let error = CurveWriter::resume(&path, columns(&terms), &checkpoint(2)).unwrap_err().to_string();
    assert!(error.contains("has columns of validations on scenarios"), "{error}");
}

#[test]
fn a_curriculum_has_columns_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("curve.csv");
    let terms = terms();
    let shape = CurveColumns { has_scenarios: true, has_curriculum: true, reward_terms: &terms };
    let mut writer = CurveWriter::create(&path, shape).unwrap();
    let rates = |success_rate| Rates { success_rate, strict_success_rate: 0.25, mean_return: 1.0 / 3.0 };
    let starts = progress(2).validation.unwrap();
    let part = Some(PartValidation { share: 0.1 + 0.2, rates: rates(0.75) });
    let validation =
        Some(Validation { space: Some(rates(0.5)), corners: Some(rates(0.125)), part, ..starts });
    let scenario_share = Some(0.1 + 0.2);
    let expected =
        [1, 2].map(|iteration| TrainingProgress { validation, scenario_share, ..progress(iteration) });
    expected.iter().for_each(|progress| writer.write(progress).unwrap());
    let curve = Curve::load(&path).unwrap();
    assert_eq!(curve.rows, expected.each_ref().map(CurveRow::from));
    assert_eq!((curve.rows[1].validation, &curve.reward_terms), (validation, &terms));
    assert!(CurveWriter::resume(&path, shape, &checkpoint(2)).is_ok());
    let other = CurveColumns { has_curriculum: false, ..shape };
    let error = CurveWriter::resume(&path, other, &checkpoint(2)).unwrap_err().to_string();
    assert!(error.contains("has columns of a curriculum"), "{error}");
}
