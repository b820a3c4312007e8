//! Laws of logs that are followed: however their bytes arrive, the samples and the verdicts are
//! those of the same logs when they are complete.

use std::io::{self, Read, Write};
use std::time::Duration;

use crate::names;
use mishandle_logs::{
    Duplicates, Evaluation, Follow, Following, Interpolation, LogError, Missing, Next, OpenLog, Options,
    Result, Samples, Sampling, Signals, Source, Unit, Watch, Watched,
};
use mishandle_results::Key;
use mishandle_stl::{Formula, is_satisfied};

struct Random(u64);

impl Random {
    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % count
    }

    fn of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())]
    }
}

/// Gives a few bytes at a time, and is interrupted now and then.
struct Pieces {
    bytes: Vec<u8>,
    at: usize,
    random: Random,
}

impl Read for Pieces {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.random.below(20) == 0 {
            return Err(io::ErrorKind::Interrupted.into());
        }
        if self.random.below(200) == 0 {
            std::thread::sleep(Duration::from_micros(50));
        }
        let most = self.random.of(&[1, 3, 17, 300]);
        let count = most.min(buffer.len()).min(self.bytes.len() - self.at);
        buffer[..count].copy_from_slice(&self.bytes[self.at..self.at + count]);
        self.at += count;
        Ok(count)
    }
}

fn pieces(text: &str, random: &mut Random) -> Box<dyn Read + Send> {
    let seed = random.below(1 << 30) as u64;
    Box::new(Pieces { bytes: text.as_bytes().to_vec(), at: 0, random: Random(seed) })
}

/// The samples of a followed log, and what is known about formulas after each of them.
struct Found {
    samples: Vec<Vec<f64>>,
    times: Vec<Option<f64>>,
    watch: Watch,
    /// The bounds and the verdict of each formula after each sample.
    known: Vec<Vec<(f64, f64, Option<bool>)>>,
}

type Pipes = Vec<(Option<String>, Box<dyn Read + Send>)>;

fn followed(
    pipes: Pipes,
    formulas: &[Formula],
    options: &Options,
    lateness: Option<f64>,
    is_strict: bool,
) -> Result<Found> {
    let following = Following { lateness, idle: None };
    let mut follow = Follow::open_pipes(pipes, formulas, options, following)?;
    let watched: Vec<Watched> =
        formulas.iter().map(|formula| Watched { formula: formula.clone(), unit: None }).collect();
    let mut watch = Watch::new(&watched, follow.signals(), options.period, is_strict)?;
    let mut samples = Vec::new();
    let mut times = Vec::new();
    let mut known = Vec::new();
    loop {
        match follow.next(Duration::from_secs(20))? {
            Next::Waiting => panic!("no end"),
            Next::End => break,
            Next::Sample => {
                watch.push(follow.sample(), follow.time())?;
                samples.push(follow.sample().to_vec());
                times.push(follow.time());
                let each = (0..formulas.len()).map(|i| {
                    let answer = watch.answer(i);
                    (answer.bounds.low, answer.bounds.high, answer.verdict)
                });
                known.push(each.collect());
            }
        }
    }
    watch.finish()?;
    Ok(Found { samples, times, watch, known })
}

/// Formulas over `a` and `b`, with windows ahead and behind, with and without an end.
const FORMULAS: [&str; 9] = [
    "always(a <= 1.5)",
    "eventually(b >= 1.9)",
    "always(a >= 0 implies eventually[0:4](b >= 0))",
    "always[0:5](a <= 1) and eventually[2:20](b >= 1)",
    "(a >= -1.5) until[1:8] (b >= 0.5)",
    "eventually(always[0:2](a >= b))",
    "always(rise(a >= 0) implies not(b <= -1) unless[0:3] (a <= 0))",
    "historically(a <= 9) and next(b >= 0) or always(once[0:3](a <= b))",
    "always[0:3](eventually[1:6](abs(a - b) <= 0.2))",
];

fn formulas(random: &mut Random, names: [&str; 2]) -> Vec<Formula> {
    let text = |random: &mut Random| {
        let words = random.of(&FORMULAS).split_inclusive(|c: char| !c.is_alphanumeric());
        let renamed = words.map(|word| {
            let (name, rest) = word.split_at(word.find(|c: char| !c.is_alphanumeric()).unwrap_or(word.len()));
            match name {
                "a" => format!("`{}`{rest}", names[0]),
                "b" => format!("`{}`{rest}", names[1]),
                _ => word.to_owned(),
            }
        });
        renamed.collect::<String>()
    };
    (0..1 + random.below(3)).map(|_| Formula::parse(&text(random)).expect("a formula")).collect()
}

/// Checks that a followed log has the samples and verdicts of the whole one.
#[track_caller]
fn agrees(
    whole: Result<Samples>,
    found: Result<Found>,
    formulas: &[Formula],
    is_strict: bool,
    shown: &str,
) -> usize {
    let whole = match (whole, &found) {
        (Ok(whole), _) => whole,
        (Err(_), Err(_)) => return 0,
        (Err(error), Ok(_)) => panic!("{shown}: only the whole log is refused: {error}"),
    };
    let evaluation = Evaluation { unit: None, strict_horizon: is_strict };
    let verdicts: Result<Vec<_>> =
        formulas.iter().map(|formula| whole.verdict(formula, &evaluation)).collect();
    let (verdicts, found) = match (verdicts, found) {
        (Ok(verdicts), Ok(found)) => (verdicts, found),
        (Err(_), Err(LogError::Content(_) | LogError::TooShort(_))) => return 0,
        (Err(_), Ok(found)) => {
            // Certain before the log was long enough for whole windows.
            assert!(is_strict && found.known.iter().flatten().any(|known| known.2.is_some()), "{shown}");
            return 0;
        }
        (verdicts, found) => panic!("{shown}: {verdicts:?} and {:?}", found.err()),
    };
    let Signals::Even { trace, period, start, has_times } = &whole.signals else { panic!("dense") };
    assert_eq!(found.samples.len(), trace.len(), "{shown}");
    for (step, sample) in found.samples.iter().enumerate() {
        let mut order: Vec<usize> = (0..trace.names().len()).collect();
        order.sort_by_key(|column| &trace.names()[*column]);
        let expected: Vec<u64> = order.iter().map(|column| trace.column(*column)[step].to_bits()).collect();
        assert_eq!(
            sample.iter().map(|v| v.to_bits()).collect::<Vec<_>>(),
            expected,
            "{shown}: sample {step}"
        );
        if let (Some(period), true) = (period, *has_times || found.times[step].is_some()) {
            let time = start + step as f64 * period;
            assert!(found.times[step].is_some_and(|found| (found - time).abs() < 1e-9), "{shown}");
        }
    }
    let mut early = 0;
    for (i, verdict) in verdicts.iter().enumerate() {
        let is_satisfied = is_satisfied(verdict.robustness);
        let answer = found.watch.answer(i);
        let shown = format!("{shown}: {} has {:?}, {answer:?}", formulas[i], verdict.robustness);
        assert_eq!(answer.verdict, Some(is_satisfied), "{shown}");
        let last = found.known.last().map(|known| known[i]);
        if last.is_some_and(|(.., verdict)| verdict.is_none()) {
            assert_eq!(answer.bounds.low.to_bits(), verdict.robustness.to_bits(), "{shown}");
            assert_eq!(answer.cuts_windows, verdict.cuts_windows, "{shown}");
        }
        for known in &found.known {
            let (low, high, certain) = known[i];
            assert!(low <= verdict.robustness && verdict.robustness <= high, "{shown}: {low} to {high}");
            assert!(certain.is_none_or(|certain| certain == is_satisfied), "{shown}");
            early += usize::from(certain.is_some());
        }
        if let (Some(violation), false) = (&answer.violation, is_satisfied) {
            let same = verdict.violations.iter().find(|known| {
                known.formula == violation.formula
                    && known.start.sample == Some(violation.sample)
                    && known.start.secs.or(violation.time) == violation.time
            });
            assert!(same.is_some(), "{shown}: {:?}", verdict.violations);
        }
    }
    1 + early
}

fn value(random: &mut Random) -> String {
    format!("{}", random.below(33) as f64 / 8.0 - 2.0)
}

/// A cell, which can be missing.
fn cell(random: &mut Random, missing: Missing) -> String {
    let is_missing = random.below(if missing == Missing::Error { 400 } else { 6 }) == 0;
    if is_missing { random.of(&["", "nan", "NaN"]).to_owned() } else { value(random) }
}

/// Times of a clock that is far from even, in milliseconds.
fn times(random: &mut Random, rows: usize) -> Vec<usize> {
    let mut at = random.below(300);
    (0..rows)
        .map(|_| {
            // Now and then the same time again, or one before.
            at = match random.below(80) {
                0 => at,
                1 => at.saturating_sub(random.below(40)),
                _ => at + random.of(&[7, 40, 93, 100, 100, 171]),
            };
            at
        })
        .collect()
}

/// A time as the unit says: seconds with three decimals, or nanoseconds of our time.
fn time_text(ms: usize, options: &Options) -> String {
    match options.time_unit {
        Some(Unit::Nanoseconds) => format!("{}", 1_700_000_000_000_000_001 + ms as u64 * 1_000_000),
        _ => format!("{}.{:03}", ms / 1000, ms % 1000),
    }
}

fn options(random: &mut Random) -> Options {
    let sampling = random.of(&[
        Sampling::Even,
        Sampling::Resampled(Interpolation::Hold),
        Sampling::Resampled(Interpolation::Linear),
    ]);
    let is_even = sampling == Sampling::Even;
    Options {
        sampling,
        period: (!is_even).then(|| random.of(&[0.1, 0.0335, 0.25])),
        tolerance: (!is_even && random.below(3) == 0).then(|| random.of(&[0.2, 0.35])),
        missing: random.of(&[Missing::Error, Missing::Hold, Missing::Drop]),
        time_unit: random.of(&[None, Some(Unit::Nanoseconds)]),
        duplicates: random.of(&[Duplicates::Error, Duplicates::First, Duplicates::Last]),
        ..Options::default()
    }
}

#[test]
fn a_log_that_arrives_in_pieces_is_the_log() {
    let mut random = Random(1);
    let mut agreed = [0; 3];
    for case in 0..3000 {
        let mut options = options(&mut random);
        let has_times = options.sampling != Sampling::Even || random.below(2) == 0;
        let rows = random.of(&[0, 1, 3, 10, 40]);
        let mut ms = times(&mut random, rows);
        if options.sampling == Sampling::Even {
            // Even times, with a period or none.
            ms = (0..rows).map(|row| 200 + 125 * row).collect();
            options.period = random.of(&[None, Some(0.125)]);
            options.missing = random.of(&[Missing::Error, Missing::Hold]);
        }
        let mut text = if has_times { "time,a,b\n" } else { "a,b\n" }.to_owned();
        let end = random.of(&["\n", "\r\n"]);
        for ms in ms {
            if has_times {
                text += &format!("{},", time_text(ms, &options));
            }
            text += &format!(
                "{},{}{end}",
                cell(&mut random, options.missing),
                cell(&mut random, options.missing)
            );
        }
        if random.below(4) == 0 {
            text.truncate(text.trim_end().len());
        }
        let formulas = formulas(&mut random, ["a", "b"]);
        let is_strict = random.below(3) == 0;
        let read = || -> Result<Samples> {
            let log = OpenLog::open_csv(Box::new(io::Cursor::new(text.clone())), &options)?;
            let mut signals: Vec<&str> = formulas.iter().flat_map(Formula::signals).collect();
            signals.sort_unstable();
            signals.dedup();
            log.read(&signals)?.samples(&options)
        };
        let found = followed(vec![(None, pieces(&text, &mut random))], &formulas, &options, None, is_strict);
        let shown = format!("case {case}, {options:?}, {text:?}, {:?}", found.as_ref().err());
        let sampling = match options.sampling {
            Sampling::Even => 0,
            Sampling::Resampled(Interpolation::Hold) => 1,
            _ => 2,
        };
        agreed[sampling] += agrees(read(), found, &formulas, is_strict, &shown);
    }
    assert!(agreed.iter().all(|count| *count > 2000), "{agreed:?}");
}

/// Writes the topics to files, and returns what is read from them when they are complete.
fn complete(texts: &[(&str, String)], formulas: &[Formula], options: &Options) -> Result<Samples> {
    let folder = tempfile::tempdir().expect("a folder");
    let mut sources = Vec::new();
    for (topic, text) in texts {
        let path = folder.path().join(format!("{topic}.csv"));
        std::fs::write(&path, text).expect("a file");
        sources.push(Source { topic: (!topic.is_empty()).then(|| (*topic).to_owned()), path });
    }
    let log = OpenLog::open(&sources, options)?;
    let mut signals: Vec<&str> = formulas.iter().flat_map(Formula::signals).collect();
    signals.sort_unstable();
    signals.dedup();
    log.read(&signals)?.samples(options)
}

/// The rows of one topic in order, and with some of them shifted if they are sorted later.
fn rows(random: &mut Random, rows: usize, options: &Options) -> Vec<(usize, String)> {
    let mut found: Vec<(usize, String)> =
        times(random, rows).into_iter().map(|ms| (ms, cell(random, options.missing))).collect();
    if options.sort {
        for at in 1..found.len() {
            if random.below(3) == 0 {
                found.swap(at - 1, at);
            }
        }
    }
    found
}

#[test]
fn topics_that_arrive_in_any_order_are_one_log() {
    let mut random = Random(7);
    let mut agreed = [0; 4];
    for case in 0..3000 {
        let mut options = options(&mut random);
        let is_one_file = random.below(3) == 0;
        options.sort = random.below(3) == 0;
        // More than any row is late.
        let waits = options.sampling != Sampling::Even && random.below(4) == 0;
        let lateness = (options.sort || waits).then_some(1000.0);
        let counts = [random.of(&[1, 5, 30]), random.of(&[1, 5, 30])];
        let [mut arm, mut hand] = counts.map(|count| rows(&mut random, count, &options));
        if options.sampling == Sampling::Even {
            // The same even times for both, if both have as many rows and none is left out.
            if options.missing == Missing::Drop {
                continue;
            }
            for rows in [&mut arm, &mut hand] {
                rows.iter_mut().enumerate().for_each(|(row, (ms, _))| *ms = 125 * row);
            }
        }
        let formulas = formulas(&mut random, ["arm/q", "hand/force"]);
        let is_strict = random.below(3) == 0;
        let (whole, pipes): (Result<Samples>, Pipes) = if is_one_file {
            options.topic_column = Some("topic".to_owned());
            let mut lines: Vec<(usize, String)> = Vec::new();
            lines.extend(
                arm.iter().map(|(ms, cell)| (*ms, format!("{},arm,{cell},\n", time_text(*ms, &options)))),
            );
            lines.extend(
                hand.iter().map(|(ms, cell)| (*ms, format!("{},hand,,{cell}\n", time_text(*ms, &options)))),
            );
            if !options.sort && random.below(2) == 0 {
                lines.sort_by_key(|(ms, _)| *ms);
            }
            let text = "time,topic,q,force\n".to_owned()
                + &lines.into_iter().map(|(_, line)| line).collect::<String>();
            (complete(&[("", text.clone())], &formulas, &options), vec![(None, pieces(&text, &mut random))])
        } else {
            let text = |name: &str, rows: &[(usize, String)]| {
                let lines = rows.iter().map(|(ms, cell)| format!("{},{cell}\n", time_text(*ms, &options)));
                format!("time,{name}\n") + &lines.collect::<String>()
            };
            let texts = [("arm", text("q", &arm)), ("hand", text("force", &hand))];
            let pipes =
                texts.iter().map(|(topic, text)| (Some((*topic).to_owned()), pieces(text, &mut random)));
            let pipes = pipes.collect();
            (complete(&texts, &formulas, &options), pipes)
        };
        let found = followed(pipes, &formulas, &options, lateness, is_strict);
        let shown =
            format!("case {case}, {options:?}, {lateness:?}, {arm:?}, {hand:?}, {:?}", found.as_ref().err());
        let kind = usize::from(is_one_file) + 2 * usize::from(options.sampling == Sampling::Even);
        agreed[kind] += agrees(whole, found, &formulas, is_strict, &shown);
    }
    assert!(agreed.iter().all(|count| *count > 1000), "{agreed:?}");
}

fn next(follow: &mut Follow) -> (Next, Vec<f64>, Option<f64>) {
    let next = follow.next(Duration::from_millis(200)).expect("no error");
    (next, follow.sample().to_vec(), follow.time())
}

/// The ends of a pipe; the reader waits for what is written.
fn pipe() -> (io::PipeWriter, Box<dyn Read + Send>) {
    let (reader, writer) = io::pipe().expect("a pipe");
    (writer, Box::new(reader))
}

#[test]
fn a_sample_waits_for_all_topics_or_for_the_lateness() {
    let formula = [Formula::parse("always(`arm/q` <= `hand/f`)").expect("a formula")];
    let options = Options {
        sampling: Sampling::Resampled(Interpolation::Hold),
        period: Some(1.0),
        ..Options::default()
    };
    for lateness in [None, Some(2.5)] {
        let (mut arm, first) = pipe();
        let (mut hand, second) = pipe();
        let pipes: Pipes = vec![(Some("arm".to_owned()), first), (Some("hand".to_owned()), second)];
        let following = Following { lateness, idle: None };
        let mut follow = Follow::open_pipes(pipes, &formula, &options, following).expect("open");
        assert_eq!(follow.signals(), ["arm/q", "hand/f"]);
        arm.write_all(b"time,q\n0,1\n1,2\n2,3\n").expect("written");
        assert_eq!(next(&mut follow).0, Next::Waiting);
        hand.write_all(b"time,f\n0.5,7\n").expect("written");
        // The signals have a common time from 0.5 s on, and no row of `hand` is later.
        assert_eq!(next(&mut follow), (Next::Sample, vec![1.0, 7.0], Some(0.5)));
        assert_eq!(next(&mut follow).0, Next::Waiting);
        arm.write_all(b"3,4\n4,5\n5,6\n").expect("written");
        if lateness.is_some() {
            // 5 s - 2.5 s: the value of `hand` holds.
            assert_eq!(next(&mut follow), (Next::Sample, vec![2.0, 7.0], Some(1.5)));
            assert_eq!(next(&mut follow).0, Next::Waiting);
            hand.write_all(b"1.75,8\n1.8,9\n").expect("written");
            assert_eq!(next(&mut follow).0, Next::Waiting);
            arm.write_all(b"5.5,6\n").expect("written");
            assert_eq!(next(&mut follow), (Next::Sample, vec![3.0, 9.0], Some(2.5)));
            hand.write_all(b"2.25,9\n").expect("written");
            let error = loop {
                match follow.next(Duration::from_secs(20)) {
                    Ok(Next::Sample) => {}
                    Ok(other) => panic!("{other:?}"),
                    Err(error) => break error,
                }
            };
            assert!(names(&error, Key::LATENESS), "{error}");
        } else {
            assert_eq!(next(&mut follow).0, Next::Waiting);
            hand.write_all(b"2.25,9\n").expect("written");
            assert_eq!(next(&mut follow), (Next::Sample, vec![2.0, 7.0], Some(1.5)));
            drop((arm, hand));
            let rest: Vec<f64> = std::iter::from_fn(|| {
                let (next, sample, _) = next(&mut follow);
                (next == Next::Sample).then(|| sample[0] - sample[1])
            })
            .collect();
            // At 2.5 s, 3.5 s and 4.5 s.
            assert_eq!(rest, [3.0 - 9.0, 4.0 - 9.0, 5.0 - 9.0]);
        }
    }
}

#[test]
fn rows_that_are_sorted_wait_for_the_lateness() {
    let formula = [Formula::parse("always(d <= 2)").expect("a formula")];
    let options = Options { sort: true, ..Options::default() };
    let (mut writer, reader) = pipe();
    let following = Following { lateness: Some(1.0), idle: None };
    let mut follow = Follow::open_pipes(vec![(None, reader)], &formula, &options, following).expect("open");
    writer.write_all(b"time,d\n0,1\n0.5,3\n0.25,2\n1.5,4\n").expect("written");
    for expected in [0.0, 0.25] {
        assert_eq!(next(&mut follow), (Next::Sample, vec![1.0 + 4.0 * expected], Some(expected)));
    }
    // A row at 0.5 s can still come.
    assert_eq!(next(&mut follow).0, Next::Waiting);
    writer.write_all(b"0.4,1\n").expect("written");
    let error = follow.next(Duration::from_secs(20)).expect_err("too late");
    assert!(names(&error, Key::LATENESS), "{error}");
}

#[test]
fn times_must_fit_the_period() {
    let formula = [Formula::parse("always[0:1s](d <= 2)").expect("a formula")];
    let options = Options { period: Some(0.1), ..Options::default() };
    let rows = |secs: &dyn Fn(f64) -> f64| {
        let lines = (0..200).map(|row| format!("{:.3},0\n", secs(f64::from(row))));
        "time,d\n".to_owned() + &lines.collect::<String>()
    };
    let mut random = Random(3);
    let mut end = |text: String| {
        let pipes: Pipes = vec![(None, pieces(&text, &mut random))];
        followed(pipes, &formula, &options, None, false).map(|found| found.samples.len())
    };
    assert_eq!(end(rows(&|row| row / 10.0)).expect("even"), 200);
    // Rounded, and nearly even.
    assert_eq!(end(rows(&|row| 7.0004 + row / 10.0)).expect("even"), 200);
    assert_eq!(end(rows(&|row| row / 9.999)).expect("even"), 200);
    let error = end(rows(&|row| row / 10.0 + if row > 100.0 { 0.1 } else { 0.0 })).expect_err("a gap");
    assert!(names(&error, Key::LOG_RESAMPLE) && error.to_string().contains("line 103"), "{error}");
    assert!(names(&end(rows(&|row| row / 9.0)).expect_err("another rate"), Key::LOG_RESAMPLE));
}

/// Follows a file that holds `before`, and that holds `after` instead once its rows were taken.
fn follow_rewritten(before: &str, after: &str) -> Result<Vec<f64>> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("log.csv");
    std::fs::write(&path, before).expect("a file");
    let source = [Source { topic: None, path: path.clone() }];
    let formula = [Formula::parse("always(d <= 2)").expect("a formula")];
    let following = Following { lateness: None, idle: Some(Duration::from_secs(3)) };
    let mut follow = Follow::open(&source, &formula, &Options::default(), following)?;
    let rows = before.lines().count() - 1;
    let mut found = Vec::new();
    loop {
        match follow.next(Duration::from_secs(20))? {
            Next::Sample => found.push(follow.sample()[0]),
            Next::End => return Ok(found),
            Next::Waiting => panic!("nothing happens"),
        }
        if found.len() == rows {
            // In one step, so that the file is never shorter.
            let mut file = std::fs::OpenOptions::new().write(true).open(&path).expect("a file");
            file.write_all(after.as_bytes()).expect("written");
        }
    }
}

#[test]
fn a_file_that_is_rewritten_in_place_is_noticed() {
    let rows = |first: i32, count: i32| {
        let rows = (first..first + count).map(|row| format!("{row},0\n"));
        "time,d\n".to_owned() + &rows.collect::<String>()
    };
    let old = rows(0, 3);
    // The whole file again with more rows is a file that grows.
    assert_eq!(follow_rewritten(&old, &rows(0, 5)).expect("it grows"), [0.0; 5]);
    let long = rows(0, 5000);
    let is_rewritten = |before: &str, after: &str| {
        let error = follow_rewritten(before, after).expect_err("rewritten").to_string();
        assert!(error.contains("the file was rewritten while it was followed"), "{error}");
    };
    is_rewritten(&old, &rows(100, 40));
    is_rewritten(&old, &old.replace("1,0", "1,9"));
    // Others before the place of reading, or at the start alone.
    is_rewritten(&long, &long.replace("\n4990,0", "\n4990,9"));
    is_rewritten(&long, &(long.replace("\n3,0", "\n3,9") + "5000,0\n"));
}

#[test]
fn times_that_are_followed_are_read_as_those_of_whole_logs() {
    let formula = [Formula::parse("always(d <= 2)").expect("a formula")];
    let mut random = Random(11);
    let mut read = |text: &str, options: &Options| {
        let pipes: Pipes = vec![(None, pieces(text, &mut random))];
        followed(pipes, &formula, options, None, false)
    };
    let hold = Options {
        sampling: Sampling::Resampled(Interpolation::Hold),
        period: Some(1.0),
        ..Options::default()
    };
    for text in ["time,d\n0.0,0\n100.0,0\n200.0,3\n", "time,d\n1000,0\n1010,0\n1020,3\n"] {
        assert!(
            names(&read(text, &hold).map(|found| found.samples).expect_err("no unit"), Key::LOG_TIME_UNIT),
            "{text}"
        );
    }
    let stamps = "stamp.sec,stamp.nanosec,d\n10,900000000,0\n11,100000000,3\n12,100000000,0\n";
    let far = stamps.replace("\n1", "\n170000000");
    let options = Options { time: Some("stamp".to_owned()), period: Some(0.2), ..hold };
    for text in [stamps, &far] {
        let whole = complete(&[("", text.to_owned())], &formula, &options);
        let found = read(text, &options);
        assert!(agrees(whole, found, &formula, false, text) > 0, "{text}");
    }
    // A run that starts again is an error, also if its rows are sorted.
    let text = "time,d\n0,0\n1,0\n2,0\n0,3\n1,0\n2,0\n";
    let error =
        read(text, &Options::default()).map(|found| found.samples).expect_err("it starts again").to_string();
    assert!(
        error.contains("does not increase: it is 2 and then 0 in line 5; if its clock starts"),
        "{error}"
    );
    let sorted = Options { sort: true, duplicates: Duplicates::First, ..Options::default() };
    for (lateness, part) in
        [(1.5, "the lateness must be longer"), (1000.0, "the times start again before line 6")]
    {
        let pipes: Pipes = vec![(None, pieces(text, &mut random))];
        let found = followed(pipes, &formula, &sorted, Some(lateness), false);
        let error = found.map(|found| found.samples).expect_err("it starts again").to_string();
        assert!(error.contains(part), "{error}");
    }
    // Also one that starts in the middle of the run before, and whose first row violates d <= 2.
    let rows = |times: std::ops::RangeInclusive<i32>, d| times.map(move |time| format!("{time},{d}\n"));
    let text = rows(0..=10, 0).chain(rows(5..=5, 3)).chain(rows(6..=12, 0)).collect::<String>();
    let text = format!("time,d\n{text}");
    for duplicates in [Duplicates::First, Duplicates::Last] {
        let options = Options { duplicates, ..sorted.clone() };
        let pipes: Pipes = vec![(None, pieces(&text, &mut random))];
        let found = followed(pipes, &formula, &options, Some(1000.0), false);
        let error = found.map(|found| found.samples).expect_err("it starts again").to_string();
        assert!(error.contains("the times start again before line 15: another log"), "{error}");
    }
}
