use super::*;
use mishandle_training::{Checkpoint, Progress, Shares, Validation};

/// What a training of two terms tells after an iteration of 512 environment steps and half a second.
fn progress(iteration: u64) -> Progress {
    Progress {
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
        validation: Some(Validation { success_rate: 0.75, strict_success_rate: 0.5, mean_return: -7.0 }),
        validation_is_fresh: iteration.is_multiple_of(2),
        kl: Some(0.01),
        entropy: None,
        learning_rate: 1e-5,
        shares: Shares { physics: 0.5, inference: 0.25, learning: 0.25 },
    }
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
    /// A curve of three iterations.
    fn new() -> Example {
        let example = Example { folder: tempfile::tempdir().unwrap() };
        let mut writer = CurveWriter::create(&example.path(), &terms()).unwrap();
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
        CurveWriter::resume(&self.path(), terms, &checkpoint(iteration))
    }
}

#[test]
fn the_file_is_as_the_manual_says() {
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
fn a_curve_comes_back() {
    let curve = Curve::load(&Example::new().path()).unwrap();
    assert_eq!(curve.reward_terms, terms());
    assert_eq!(curve.rows, [1, 2, 3].map(|iteration| CurveRow::from(&progress(iteration))));
    assert_eq!((curve.rows[0].validation, curve.rows[1].validation.is_some()), (None, true));
}

#[test]
fn a_resumed_training_writes_the_rows_behind_its_checkpoint_anew() {
    let example = Example::new();
    let whole = example.text();
    let mut writer = example.resume(&terms(), 2).unwrap();
    // Nothing is lost as long as nothing was done.
    assert_eq!(example.text(), whole);
    writer.write(&progress(3)).unwrap();
    assert_eq!(example.text(), whole);
    writer.write(&progress(4)).unwrap();
    assert_eq!(Curve::load(&example.path()).unwrap().rows.len(), 4);
    // One that has nothing left to do drops them in the end.
    example.resume(&terms(), 2).unwrap().finish().unwrap();
    assert_eq!(Curve::load(&example.path()).unwrap().rows.len(), 2);
}

#[test]
fn what_a_killed_training_left_of_a_line_is_no_harm_behind_the_checkpoint() {
    let example = Example::new();
    let whole = example.text();
    std::fs::write(example.path(), &whole[..whole.len() - 20]).unwrap();
    let cut = Curve::load(&example.path()).unwrap();
    assert_eq!((cut.rows.len(), cut.is_cut), (2, true));
    example.resume(&terms(), 2).unwrap().write(&progress(3)).unwrap();
    assert_eq!(example.text(), whole);
    // Cut within the last number, it still has all its cells.
    std::fs::write(example.path(), &whole[..whole.len() - 3]).unwrap();
    assert_eq!(Curve::load(&example.path()).unwrap(), cut);
    assert!(example.resume(&terms(), 3).unwrap_err().to_string().contains("no row of iteration 3"));
    // A file that is cut within its first line has no columns.
    std::fs::write(example.path(), &whole[..20]).unwrap();
    assert!(
        Curve::load(&example.path()).unwrap_err().to_string().contains("column 1 of its first line is ``")
    );
}

#[test]
fn a_file_that_is_not_the_training_s_is_refused_and_left_alone() {
    let example = Example::new();
    let whole = example.text();
    let refusal = |terms: &[String], iteration| example.resume(terms, iteration).unwrap_err().to_string();
    assert!(refusal(&terms(), 5).contains("no row of iteration 5"), "{}", refusal(&terms(), 5));
    assert!(
        refusal(&["a".to_string()], 2)
            .ends_with("its reward terms are distance, a,b, those of this training a")
    );
    let mut other = checkpoint(2);
    other.put("wall_clock_secs", vec![1.000_000_002]);
    let told = CurveWriter::resume(&example.path(), &terms(), &other).unwrap_err().to_string();
    assert!(
        told.ends_with("its row of iteration 2 is from second 1.000000000, the checkpoint from 1.000000002"),
        "{told}"
    );
    assert!(CurveWriter::create(&example.path(), &terms()).is_err());
    assert_eq!(example.text(), whole);
    // One that is not there is begun.
    std::fs::remove_file(example.path()).unwrap();
    example.resume(&terms(), 2).unwrap().write(&progress(3)).unwrap();
    assert_eq!(Curve::load(&example.path()).unwrap().rows[0].iteration, 3);
}

/// The example with `from` replaced by `to`, read.
#[track_caller]
fn check_refusal(from: &str, to: &str, told: &str) {
    let example = Example::new();
    let text = example.text();
    assert!(text.contains(from), "{text}");
    std::fs::write(example.path(), text.replacen(from, to, 1)).unwrap();
    let refusal = Curve::load(&example.path()).unwrap_err().to_string();
    assert!(refusal.contains("curve.csv: ") && refusal.contains(told), "{refusal}");
    assert!(!refusal.contains('\n'));
}

#[test]
fn what_a_training_measures_as_it_breaks_down_comes_back() {
    let example = Example::new();
    let broken = Progress { mean_return: Some(f64::NEG_INFINITY), kl: Some(f64::INFINITY), ..progress(1) };
    std::fs::remove_file(example.path()).unwrap();
    CurveWriter::create(&example.path(), &terms()).unwrap().write(&broken).unwrap();
    assert_eq!(Curve::load(&example.path()).unwrap().rows, [CurveRow::from(&broken)]);
}

#[test]
fn a_file_edited_by_hand_is_refused_with_its_line() {
    check_refusal("kl,entropy", "entropy,kl", "column 10 of its first line is `entropy`; it has to be `kl`");
    check_refusal(
        "reward_distance",
        "distance",
        "column 16 of its first line is `distance`; it has to be `reward_` and",
    );
    check_refusal("\n2,1024", "\n2,many", "line 3: environment_steps is `many`; it has to be a whole number");
    check_refusal("\n2,1024", "\n4,1024", "line 3: iteration 4 cannot follow iteration 1");
    check_refusal("\n2,1024", "\n2,512", "line 3: 512 environment steps cannot follow 512");
    check_refusal("-0.2,", "low,", "line 3: mean_return is `low`; it has to be a number, or nothing");
    check_refusal("0.00001", "NaN", "line 2: learning_rate is `NaN`; it has to be a finite number");
    check_refusal("0.00001", "", "line 2: learning_rate is ``; it has to be a finite number");
    check_refusal(
        "0.75,0.5,-7",
        "0.75,,-7",
        "line 3: validation_return is `-7`; it has to be there with both",
    );
    check_refusal("-0.2,", "", "line: 3");
    check_refusal("iteration,", "", "column 1 of its first line is `environment_steps`");
}

#[test]
fn what_is_no_file_of_text_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("curve.csv");
    let told = || Curve::load(&path).unwrap_err().to_string();
    let missing = Curve::load(&path).unwrap_err();
    assert!(std::error::Error::source(&missing).is_some(), "{missing}");
    std::fs::write(&path, "").unwrap();
    assert!(told().contains("column 1 of its first line is ``; it has to be `iteration`"), "{}", told());
    std::fs::write(&path, b"\xff\xfe\x00\n").unwrap();
    assert!(told().contains("UTF-8"), "{}", told());
    let device = Curve::load(Path::new("/dev/zero")).unwrap_err().to_string();
    assert_eq!(device, "/dev/zero: it is no plain file");
}
