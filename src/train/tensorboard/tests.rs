use mishandle_results::{Key, Remedy};
use mishandle_training::TimeShares;

use super::encoding::{checksum, masked_checksum};
use super::*;

#[test]
fn checksums_match_published_values() {
    // RFC 3720, appendix B.4: 32 bytes of zeros, 32 of ones; and the check value of CRC catalogues.
    assert_eq!(checksum(&[0; 32]), 0x8a91_36aa);
    assert_eq!(checksum(&[0xff; 32]), 0x62a8_ab43);
    assert_eq!(checksum(b"123456789"), 0xe306_9283);
}

#[test]
fn messages_match_the_protocol_buffer_encoding() {
    let mut message = Vec::new();
    // Examples of the encoding guide: field 1 = 150 is 08 96 01; field 2 = "testing" is 12 07 and
    // the text.
    put_integer(&mut message, 1, 150);
    put_bytes(&mut message, 2, b"testing");
    assert_eq!(message, b"\x08\x96\x01\x12\x07testing");
}

/// A field of a protocol buffer.
#[derive(Debug, PartialEq)]
enum Field<'a> {
    Integer(u64),
    Double(f64),
    Float(f32),
    Bytes(&'a [u8]),
}

fn take<'a>(rest: &mut &'a [u8], count: usize) -> &'a [u8] {
    let (taken, left) = rest.split_at(count);
    *rest = left;
    taken
}

fn take_varint(rest: &mut &[u8]) -> u64 {
    let mut number = 0;
    let mut shift = 0;
    loop {
        let byte = take(rest, 1)[0];
        number |= u64::from(byte & 0x7f) << shift;
        shift += 7;
        if byte < 0x80 {
            return number;
        }
    }
}

/// Decodes a message into field numbers and values.
fn fields(mut message: &[u8]) -> Vec<(u64, Field<'_>)> {
    let mut fields = Vec::new();
    while !message.is_empty() {
        let key = take_varint(&mut message);
        let field = match key & 7 {
            0 => Field::Integer(take_varint(&mut message)),
            1 => Field::Double(f64::from_le_bytes(take(&mut message, 8).try_into().unwrap())),
            2 => {
                let length = take_varint(&mut message) as usize;
                Field::Bytes(take(&mut message, length))
            }
            5 => Field::Float(f32::from_le_bytes(take(&mut message, 4).try_into().unwrap())),
            other => panic!("unexpected wire type {other}"),
        };
        fields.push((key >> 3, field));
    }
    fields
}

/// Returns the messages of an event file and checks their checksums.
fn messages(mut file: &[u8]) -> Vec<&[u8]> {
    let mut messages = Vec::new();
    while !file.is_empty() {
        let length = take(&mut file, 8);
        assert_eq!(take(&mut file, 4), masked_checksum(length));
        let message = take(&mut file, u64::from_le_bytes(length.try_into().unwrap()) as usize);
        assert_eq!(take(&mut file, 4), masked_checksum(message));
        messages.push(message);
    }
    messages
}

/// Returns step and scalars of an event.
fn scalars_of(message: &[u8]) -> (u64, Vec<(String, f32)>) {
    let [(1, Field::Double(time)), (2, Field::Integer(step)), (5, Field::Bytes(summary))] =
        fields(message)[..]
    else {
        panic!("not an event with a summary: {:?}", fields(message));
    };
    assert!((time - now_secs()).abs() < 60.0, "{time}");
    let scalar = |(number, value): (u64, Field<'_>)| {
        let Field::Bytes(value) = value else { panic!("not a value: {value:?}") };
        let [(1, Field::Bytes(tag)), (2, Field::Float(number_of_tag))] = fields(value)[..] else {
            panic!("not a scalar: {:?}", fields(value));
        };
        assert_eq!(number, 1);
        (String::from_utf8(tag.to_vec()).unwrap(), number_of_tag)
    };
    (step, fields(summary).into_iter().map(scalar).collect())
}

fn progress(environment_steps: u64) -> TrainingProgress {
    TrainingProgress {
        iteration: 1,
        environment_steps,
        total_steps: 1_000_000,
        steps_per_second: 4096.0,
        wall_clock_secs: 0.5,
        mean_return: None,
        mean_episode_steps: None,
        terminated_rate: None,
        diverged: 0,
        reward_terms: vec![-0.25, 3.0],
        validation: Some(Validation::of_starts(Rates {
            success_rate: 0.75,
            strict_success_rate: 0.5,
            mean_return: -7.0,
        })),
        validation_is_fresh: false,
        scenario_share: None,
        kl: Some(0.0625),
        entropy: None,
        learning_rate: 0.125,
        time_shares: TimeShares { physics: 0.5, inference: 0.25, learning: 0.25 },
    }
}

fn bytes_of(folder: &Path, resumes: bool, progress: &[TrainingProgress]) -> Vec<u8> {
    let terms = ["near".to_string(), "calm".to_string()];
    let mut file = EventFile::create(folder, &terms, resumes).unwrap();
    progress.iter().for_each(|progress| file.write(progress).unwrap());
    std::fs::read(file.file.path()).unwrap()
}

#[test]
fn an_event_file_contains_the_scalars_of_each_iteration() {
    let folder = tempfile::tempdir().unwrap();
    let validated =
        TrainingProgress { validation_is_fresh: true, mean_return: Some(-8.0), ..progress(1 << 40) };
    let bytes = bytes_of(folder.path(), false, &[progress(300), validated]);
    let messages = messages(&bytes);
    assert_eq!(messages.len(), 3);
    assert_eq!(fields(messages[0])[1], (3, Field::Bytes(b"brain.Event:2")));
    let always = [
        ("train/kl", 0.0625),
        ("train/learning_rate", 0.125),
        ("time/steps_per_second", 4096.0),
        ("time/wall_clock_secs", 0.5),
        ("time/physics_share", 0.5),
        ("time/inference_share", 0.25),
        ("time/learning_share", 0.25),
        ("reward/near", -0.25),
        ("reward/calm", 3.0),
    ];
    let (step, scalars) = scalars_of(messages[1]);
    let plain: Vec<(&str, f32)> = scalars.iter().map(|(tag, number)| (tag.as_str(), *number)).collect();
    assert_eq!((step, &plain[..]), (300, &always[..]));
    let (step, scalars) = scalars_of(messages[2]);
    assert_eq!((step, scalars.len()), (1 << 40, always.len() + 4));
    for (tag, number) in [("validation/success_rate", 0.75), ("train/mean_return", -8.0)] {
        assert!(scalars.contains(&(tag.to_string(), number)), "{scalars:?}");
    }
}

#[test]
fn a_resumed_run_writes_a_session_start() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = bytes_of(folder.path(), true, &[progress(300), progress(400)]);
    let messages = messages(&bytes);
    assert_eq!(messages.len(), 4);
    // Field 7, SessionLog: its field 1, status, is START = 1.
    assert_eq!(fields(messages[1])[1..], [(2, Field::Integer(300)), (7, Field::Bytes(&[8, 1]))]);
    assert_eq!((scalars_of(messages[2]).0, scalars_of(messages[3]).0), (300, 400));
}

#[test]
fn a_folder_contains_event_files_of_one_training_run() {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("a/b");
    let mut first = EventFile::create(&inside, &[], false).unwrap();
    first.write(&progress(300)).unwrap();
    let error = EventFile::create(&inside, &[], false).unwrap_err();
    assert!(error.to_string().contains("a/b"), "{error}");
    assert_eq!(error.remedies().first(), Some(&Remedy::Another(Key::EVENTS)));
    // Same second, same process.
    let second = EventFile::create(&inside, &[], true).unwrap();
    assert!(second.file.path() > first.file.path(), "{second:?}");
    let name = first.file.path().file_name().unwrap().to_string_lossy().into_owned();
    assert!(name.starts_with("events.out.tfevents.") && name.ends_with(".0"), "{name}");
    // A run that was killed before its first checkpoint left a file without data.
    let killed = folder.path().join("killed");
    drop(EventFile::create(&killed, &[], false).unwrap());
    EventFile::create(&killed, &[], false).unwrap();
    assert_eq!(std::fs::read_dir(&killed).unwrap().count(), 1);
}
