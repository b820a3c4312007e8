//! Models of Stable-Baselines3, checkpoints of skrl and PyTorch.

use mishandle::interchange::{ImportOptions, Normalization, import};
use mishandle::rollout::Controller;
use mishandle_network::Activation;

/// Checks that an imported policy has finite weights and computes an action. Each input is read as
/// an archive, and as the pickle in an archive with correct checksums.
pub fn check(bytes: &[u8]) {
    check_archive(bytes);
    let weights: Vec<u8> = (0..64).flat_map(|number| (number as f32 * 0.125 - 4.0).to_le_bytes()).collect();
    check_archive(&archive(&[("a/data.pkl", bytes), ("a/data/0", &weights), ("a/data/1", &weights[..8])]));
}

fn check_archive(bytes: &[u8]) {
    let activation = Some(Activation::Elu);
    let output_activation = Some(Activation::Tanh);
    let options = ImportOptions { activation, output_activation, normalizer: Normalization::OfFile };
    let Ok(imported) = import(bytes, &options) else { return };
    let policy = imported.policy;
    assert!(policy.network().parameters().iter().chain(policy.log_std()).all(|number| number.is_finite()));
    assert!(policy.mean().iter().chain(policy.variance()).all(|number| number.is_finite()));
    let mut action = vec![f32::NAN; policy.action_size()];
    policy.worker().act(1, &vec![0.5; policy.observation_size()], &mut [], &mut action);
    assert!(action.iter().all(|number| number.is_finite()), "tanh is finite: {action:?}");
}

/// Returns a zip archive of stored entries.
fn archive(entries: &[(&str, &[u8])]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut directory = Vec::new();
    for (name, content) in entries {
        let length = (content.len() as u32).to_le_bytes();
        let start = (bytes.len() as u32).to_le_bytes();
        let numbers =
            [&crc32(content).to_le_bytes()[..], &length, &length, &(name.len() as u32).to_le_bytes()]
                .concat();
        bytes.extend([&b"PK\x03\x04"[..], &[0; 10], &numbers, name.as_bytes(), content].concat());
        directory
            .extend([&b"PK\x01\x02"[..], &[0; 12], &numbers, &[0; 10], &start, name.as_bytes()].concat());
    }
    let count = (entries.len() as u16).to_le_bytes();
    let length = (directory.len() as u32).to_le_bytes();
    let start = (bytes.len() as u32).to_le_bytes();
    bytes.extend([&directory[..], b"PK\x05\x06", &[0; 4], &count, &count, &length, &start, &[0; 2]].concat());
    bytes
}

/// CRC-32, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    let bits = bytes.iter().flat_map(|byte| (0..8).map(move |bit| u32::from(byte >> bit & 1)));
    !bits.fold(!0, |crc, bit| if (crc ^ bit) & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
}

pub fn seeds() -> Vec<Vec<u8>> {
    let mut seeds = vec![
        include_bytes!("../../crates/interchange/tests/data/sb3_ppo.zip").to_vec(),
        include_bytes!("../../crates/interchange/tests/data/skrl_agent.pt").to_vec(),
        include_bytes!("../../crates/interchange/tests/data/sequential.pt").to_vec(),
    ];
    // A pickle alone: a linear layer with 2 inputs and 1 output.
    let text = |text: &str| [b"X", &(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
    let tensor = |name: &str, sizes: &[u8]| {
        let storage =
            [b"(", &text("storage")[..], b"ctorch\nFloatStorage\n", &text("0"), &text("cpu"), b"K\x40tQ"];
        let end = b"\x89ccollections\nOrderedDict\n)RtR";
        [&text(name)[..], b"ctorch._utils\n_rebuild_tensor_v2\n(", &storage.concat(), b"K\x01", sizes, end]
            .concat()
    };
    let weight = tensor("weight", b"K\x01K\x02\x86K\x02K\x01\x86");
    let bias = tensor("bias", b"K\x01\x85K\x01\x85");
    seeds.push([b"\x80\x02}(", &weight[..], &bias, b"u."].concat());
    seeds
}
