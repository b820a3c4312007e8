//! Controller files.

use mishandle::controllers::{
    ControllerFile, Entry, Header, Layout, Policy, TrainingRecord, ValidationRecord, write_checksum,
};
use mishandle_network::{Activation, Mlp};

/// Checks that a file that is read and written is the same controller: the written bytes read as a
/// controller that is written as the same bytes, with the same header. Each input is read as it is,
/// and with its checksum corrected.
pub fn check(bytes: &[u8]) {
    check_file(bytes);
    let mut corrected = bytes.to_vec();
    write_checksum(&mut corrected);
    if corrected != bytes {
        check_file(&corrected);
    }
}

fn check_file(bytes: &[u8]) {
    let Ok(file) = ControllerFile::from_bytes(bytes) else { return };
    let written = file.to_bytes();
    let again = ControllerFile::from_bytes(&written).expect("a written controller is read");
    assert_eq!(again.header, file.header);
    assert_eq!(again.to_bytes(), written);
    let numbers = file.policy.network().parameters().iter().chain(file.policy.log_std());
    assert!(numbers.into_iter().all(|number| number.is_finite()));
}

pub fn seeds() -> Vec<Vec<u8>> {
    let entry = |name: &str, unit: &str, size| Entry { name: name.into(), unit: unit.into(), size };
    let layout = Layout { observation: vec![entry("ball", "m", 2)], action: vec![entry("push", "1", 1)] };
    let validation = ValidationRecord { episodes: 8, success_rate: 0.5, strict_success_rate: 0.25 };
    let training = TrainingRecord {
        seed: u64::MAX,
        wall_clock_secs: 1.5,
        settings: "gamma = 0.99\n".to_string(),
        validation: Some(validation),
        ..TrainingRecord::default()
    };
    let header = Header {
        task: "ball-pushing".into(),
        algorithm: "ppo".into(),
        preset: "paper".into(),
        reward: "shaped".into(),
        layout,
        action_interface: None,
        task_hash: "0123".into(),
        training,
    };
    let network = |inputs, outputs| {
        let mut network =
            Mlp::new(&[inputs, 2, outputs], Activation::Elu, Activation::Identity).expect("valid sizes");
        network.update(|parameters| parameters.fill(0.5));
        network
    };
    let mean = vec![0.25; 2];
    let variance = vec![1.0; 2];
    // The network of a squashed policy returns a mean and a standard deviation per action.
    let gaussian = Policy::new(mean.clone(), variance.clone(), network(2, 1), vec![-0.5]);
    let squashed = Policy::squashed(mean.clone(), variance.clone(), network(2, 2));
    let with_history = Policy::with_history(1, mean, variance, network(5, 1), Some(vec![-0.5]));
    [gaussian, squashed, with_history]
        .into_iter()
        .map(|policy| {
            ControllerFile { header: header.clone(), policy: policy.expect("valid sizes") }.to_bytes()
        })
        .collect()
}
