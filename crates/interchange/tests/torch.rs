//! Checkpoints of PyTorch: those of real libraries against the actions that the libraries computed,
//! and hostile ones.

#![allow(clippy::unwrap_used)]

use mishandle_controllers::Policy;
use mishandle_interchange::{ImportOptions, ObservationNormalizer, TorchProblem, import};
use mishandle_network::Activation;
use mishandle_rollout::Controller;

const OBSERVATIONS: [f32; 6] = [0.3, -0.7, 1.5, 0.2, -4.0, 2.5];

fn file(name: &str) -> Vec<u8> {
    std::fs::read(format!("{}/tests/data/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

fn given(activation: Activation, output: Activation) -> ImportOptions {
    ImportOptions { activation: Some(activation), output_activation: Some(output), normalizer: None }
}

fn actions(policy: &Policy) -> Vec<f32> {
    let mut actions = vec![0.0; 3];
    policy.worker().act(3, &OBSERVATIONS, &mut [], &mut actions);
    actions
}

#[track_caller]
fn check(name: &str, options: &ImportOptions, source: &str, expected: [f32; 3]) -> Policy {
    let imported = import(&file(name), options).unwrap();
    assert_eq!(imported.source, source);
    for (found, expected) in actions(&imported.policy).iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6, "{name}: {found}, expected {expected}");
    }
    imported.policy
}

#[test]
fn models_of_stable_baselines3_have_its_actions() {
    let defaults = ImportOptions::default();
    let ppo = check(
        "sb3_ppo.zip",
        &defaults,
        "Stable-Baselines3 PPO or A2C",
        [-0.46324468, -0.18660524, -0.36306113],
    );
    assert_eq!(ppo.network().hidden_activation(), Activation::Elu);
    assert_eq!(ppo.log_std(), [0.0]);
    assert_eq!(ppo.observation_clip(), None);
    let sac = check("sb3_sac.zip", &defaults, "Stable-Baselines3 SAC", [0.14159301, 0.16091229, 0.032517157]);
    assert_eq!(sac.network().sizes(), [2, 3, 2, 1]);
    assert!(sac.log_std()[0] < -10.0);
    check("sb3_td3.zip", &defaults, "Stable-Baselines3 TD3 or DDPG", [-0.12863521, 0.08627436, -0.407_256_5]);
}

#[test]
fn a_checkpoint_of_skrl_has_its_actions_and_its_normalizer() {
    let options = ImportOptions { activation: Some(Activation::Elu), ..ImportOptions::default() };
    let policy = check("skrl_agent.pt", &options, "skrl", [0.2608726, 0.5398161, 0.65475094]);
    assert_eq!(policy.observation_clip(), Some(5.0));
    assert!((policy.mean()[0] - 1.125).abs() < 1e-7);
    let message = import(&file("skrl_agent.pt"), &ImportOptions::default()).unwrap_err().to_string();
    assert!(message.contains("give --activation NAME: elu, relu"), "{message}");
}

#[test]
fn a_sequential_with_layer_normalization_has_the_outputs_of_pytorch() {
    let options = given(Activation::Gelu, Activation::Identity);
    let policy = check(
        "sequential.pt",
        &options,
        "a state dictionary of PyTorch",
        [-0.31973985, -0.513_962_6, -0.3665523],
    );
    assert!(policy.network().has_affine_layer_norm());
}

#[test]
fn the_statistics_of_vec_normalize_are_applied() {
    let text = r#"{"mean": [1.0, -1.0], "variance": [4.0, 0.0], "epsilon": 0.01, "clip": 2.0}"#;
    let normalizer = ObservationNormalizer::from_json(text).unwrap();
    let options = ImportOptions { normalizer: Some(normalizer), ..ImportOptions::default() };
    let normalized = import(&file("sb3_ppo.zip"), &options).unwrap().policy;
    let plain = import(&file("sb3_ppo.zip"), &ImportOptions::default()).unwrap().policy;
    // (o - mean) / √(variance + 0.01), clipped to ±2, computed by hand.
    let inputs = OBSERVATIONS.chunks(2).flat_map(|o| {
        let scaled = [(f64::from(o[0]) - 1.0) / 4.01_f64.sqrt(), (f64::from(o[1]) + 1.0) / 0.1];
        scaled.map(|x| x.clamp(-2.0, 2.0) as f32)
    });
    let mut expected = vec![0.0; 3];
    plain.worker().act(3, &inputs.collect::<Vec<f32>>(), &mut [], &mut expected);
    for (found, expected) in actions(&normalized).iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6, "{found}, expected {expected}");
    }
    assert!(ObservationNormalizer::from_json(r#"{"mean": [1.0], "var": [4.0]}"#).is_err());
}

/// CRC-32, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    let bits = bytes.iter().flat_map(|byte| (0..8).map(move |bit| u32::from(byte >> bit & 1)));
    !bits.fold(!0, |crc, bit| if (crc ^ bit) & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
}

/// Returns an archive of stored entries, or with another method of compression in the directory.
fn archive(entries: &[(&str, &[u8])], method: u16) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for (name, content) in entries {
        let offset = bytes.len() as u32;
        let sizes = [content.len() as u32; 2].map(u32::to_le_bytes).concat();
        let name_length = (name.len() as u16).to_le_bytes();
        bytes.extend(b"PK\x03\x04\x14\0\0\0\0\0\0\0\0\0\0\0\0\0");
        bytes.extend(&sizes);
        bytes.extend(name_length);
        bytes.extend([0, 0]);
        bytes.extend(name.as_bytes());
        bytes.extend(*content);
        directory.extend(b"PK\x01\x02\x14\0\x14\0\0\0");
        directory.extend(method.to_le_bytes());
        directory.extend([0; 4]);
        directory.extend(crc32(content).to_le_bytes());
        directory.extend(&sizes);
        directory.extend(name_length);
        directory.extend([0; 12]);
        directory.extend(offset.to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let (start, count) = (bytes.len() as u32, (entries.len() as u16).to_le_bytes());
    let length = (directory.len() as u32).to_le_bytes();
    bytes.extend(directory);
    bytes.extend(
        [b"PK\x05\x06\0\0\0\0", &[count, count].concat()[..], &length, &start.to_le_bytes(), &[0, 0]]
            .concat(),
    );
    bytes
}

/// Returns the message for a checkpoint with this pickle and this storage `0`.
fn message(pickle: &[u8], storage: &[u8]) -> String {
    let bytes = archive(&[("a/data.pkl", pickle), ("a/data/0", storage)], 0);
    import(&bytes, &given(Activation::Elu, Activation::Identity)).unwrap_err().to_string()
}

/// Returns the pickle of `{"weight": tensor, "bias": tensor}`; the bias has the shape (1,).
fn pickle(offset: u8, shape: [u8; 2], strides: [u8; 2]) -> Vec<u8> {
    let tensor = |name: &str, offset: u8, shape: &[u8], strides: &[u8]| {
        let tuple = |numbers: &[u8]| {
            let numbers: Vec<u8> = numbers.iter().flat_map(|number| [b'K', *number]).collect();
            [b"(", &numbers[..], b"t"].concat()
        };
        let text = |text: &str| [b"X", &(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
        [
            &text(name)[..],
            b"ctorch._utils\n_rebuild_tensor_v2\n((",
            &text("storage"),
            b"ctorch\nFloatStorage\n",
            &text("0"),
            &text("cpu"),
            b"K\x03tQK",
            &[offset],
            &tuple(shape),
            &tuple(strides),
            b"\x89ccollections\nOrderedDict\n)RtR",
        ]
        .concat()
    };
    [b"\x80\x02}(", &tensor("weight", offset, &shape, &strides)[..], &tensor("bias", 0, &[1], &[1]), b"u."]
        .concat()
}

#[test]
fn a_small_pickle_is_a_linear_layer() {
    let storage: Vec<u8> = [0.5_f32, 2.0, 3.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let bytes = archive(&[("a/data.pkl", &pickle(1, [1, 2], [2, 1])), ("a/data/0", &storage)], 0);
    let policy = import(&bytes, &given(Activation::Elu, Activation::Identity)).unwrap().policy;
    // 2 · 0.3 + 3 · (-0.7) + 0.5
    assert!((actions(&policy)[0] + 1.0).abs() < 1e-6);
}

#[test]
fn tensors_outside_their_storage_are_errors() {
    let storage = [0; 12];
    for (offset, shape, strides) in [
        (2, [1, 2], [2, 1]),
        (0, [2, 2], [2, 1]),
        (0, [1, 2], [1, 200]),
        (0, [255, 255], [0, 0]),
        (255, [1, 2], [1, 1]),
    ] {
        let message = message(&pickle(offset, shape, strides), &storage);
        assert!(message.contains("the numbers of the tensor `weight` are not inside it"), "{message}");
    }
}

#[test]
fn names_and_operations_that_run_code_are_errors() {
    for (pickle, expected) in [
        (&b"\x80\x02cos\nsystem\nX\x02\0\0\0ls\x85R."[..], "refers to `os.system`"),
        (b"\x80\x02cbuiltins\neval\nX\x01\0\0\x001\x85R.", "refers to `builtins.eval`"),
        (
            b"\x80\x02ctorch.nn.modules.container\nSequential\n)\x81.",
            "refers to `torch.nn.modules.container.Sequential`",
        ),
        // The same by other operations: INST, OBJ, NEWOBJ, STACK_GLOBAL, extension codes,
        // persistent names.
        (b"(S'ls'\nios\nsystem\n.", "operation 0x53 at byte 1"),
        (b"(ios\nsystem\n.", "operation 0x69 at byte 1"),
        (b"(o.", "operation 0x6f"),
        (b")\x81.", "operation 0x81"),
        (b"\x8c\x02os\x8c\x06system\x93.", "operation 0x8c"),
        (b"\x82\x01.", "operation 0x82"),
        (b"Pid\n.", "operation 0x50"),
        (b"ccollections\nOrderedDict\nN\x85R.", "damaged"),
        (b"X\x02\0\0\0osR.", "damaged"),
    ] {
        let message = message(pickle, &[]);
        assert!(message.contains(expected), "{message}");
    }
    let name = message(b"cos\nsystem\n.", &[]);
    assert!(name.contains("nothing was executed; save `model.state_dict()`"), "{name}");
}

#[test]
fn pickles_that_are_damaged_deep_or_long_are_errors() {
    let deep = [&b"\x80\x02)"[..], &b"\x85".repeat(100_000), b"."].concat();
    assert!(message(&deep, &[]).contains("nested more than 16 deep"));
    let long = [&b"\x80\x02"[..], &b"N".repeat(5 << 20), b"."].concat();
    assert!(message(&long, &[]).contains("bytes; the limit is 4194304"));
    // Repeats of repeats, which double the size of a copy each time.
    let bomb = (0..15_u8).flat_map(|i| [b'q', i, b'h', i, b'h', i, 0x87]).collect::<Vec<u8>>();
    assert!(message(&[b"\x80\x02N", &bomb[..], b"."].concat(), &[]).contains("no dictionary of tensors"));
    let whole = pickle(0, [1, 2], [2, 1]);
    for length in 0..whole.len() {
        assert!(!message(&whole[..length], &[0; 12]).is_empty());
    }
    for operation in
        [b"R.".as_slice(), b"t.", b"u.", b"s.", b"a.", b"e.", b"Q.", b"h\x09.", b"q\x05.", b"b.", b"."]
    {
        assert!(message(operation, &[]).contains("damaged"), "{operation:?}");
    }
}

#[test]
fn archives_that_are_compressed_damaged_or_foreign_are_errors() {
    let problem = |bytes: &[u8]| import(bytes, &ImportOptions::default()).unwrap_err();
    let compressed = problem(&archive(&[("policy.pth", b"x")], 8)).to_string();
    assert!(compressed.contains("entry `policy.pth` is compressed; save the model again"), "{compressed}");
    for bytes in [&b""[..], b"PK\x03\x04", b"PK\x05\x06", &[0; 100], &archive(&[("readme.txt", b"hello")], 0)]
    {
        assert!(matches!(problem(bytes), TorchProblem::Archive { .. }));
    }
    for name in ["sb3_ppo.zip", "skrl_agent.pt", "sequential.pt"] {
        let whole = file(name);
        for length in (0..whole.len()).step_by(37) {
            problem(&whole[..length]);
        }
        // Any changed byte gives an error or a policy, never a panic.
        for index in (0..whole.len()).step_by(11) {
            let mut changed = whole.clone();
            changed[index] ^= 1 << (index % 8);
            let _ = import(&changed, &given(Activation::Elu, Activation::Identity));
        }
    }
}

#[test]
fn long_and_thin_layers_are_errors() {
    // Rows of 10,001 numbers. The shape (1, 10001) is `J` with 4 bytes instead of `K` with one.
    let wide = [&b"J"[..], &10_001_i32.to_le_bytes()].concat();
    let pickle = pickle(0, [1, 77], [1, 1]);
    let at = pickle.windows(2).position(|window| window == b"KM").unwrap();
    let pickle = [&pickle[..at], &wide, &pickle[at + 2..]].concat();
    let message = message(&pickle, &vec![0; 4 * 10_001]);
    assert!(message.contains("more than 10000 numbers in a layer"), "{message}");
}

#[test]
fn layers_that_are_no_perceptron_are_listed() {
    let storage = [0; 12];
    let message = message(&pickle(0, [2, 1], [1, 1]), &storage);
    assert!(message.contains("its layers do not form a chain; found: weight [2, 1], bias [1]"), "{message}");
}

/// The operations for a text, and for a tensor of the storage `0` with the shape and the strides on
/// the stack.
fn text(text: &str) -> Vec<u8> {
    [b"X", &(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

fn storage(name: &str, kind: &str) -> Vec<u8> {
    let kind = format!("ctorch\n{kind}\n");
    [b"(", &text("storage")[..], kind.as_bytes(), &text(name), &text("cpu"), b"K\x03tQ"].concat()
}

#[test]
fn sizes_and_names_that_many_tensors_share_do_not_fill_the_memory() {
    // One tuple of 100,000 sizes, as the shape of 100,000 tensors: 20 GB if each had a copy.
    let long = [b"\x80\x02(", &b"K\0".repeat(100_000)[..], b"tq\0"].concat();
    let rebuild = b"ctorch._utils\n_rebuild_tensor_v2\nq\x02";
    let tensors = b"h\x02(h\x01K\0h\0h\0tR".repeat(100_000);
    let pickle =
        [&long[..], &storage("0", "FloatStorage"), b"q\x01", rebuild, b"(", &tensors, b"t."].concat();
    assert!(message(&pickle, &[]).contains("damaged"));
    // One name of 1 MB for any number of tensors.
    let long = text(&"n".repeat(1_000_000));
    assert!(message(&long, &[]).contains("a text of 1000000 bytes; the limit is 1024"));
    // 20,000 empty tensors.
    let empty = [b"(", &storage("0", "FloatStorage")[..], b"K\0(K\0t(K\x01ttRq\x03"].concat();
    let names: Vec<u8> = (0..20_000).flat_map(|n| [&text(&n.to_string())[..], b"h\x03"].concat()).collect();
    let pickle = [b"\x80\x02N", &b"q\0q\x01"[..], rebuild, &empty, b"}(", &names, b"u."].concat();
    assert!(message(&pickle, &[]).contains("more than 10000 tensors"), "{}", message(&pickle, &[]));
    let twice = [
        &b"\x80\x02N"[..],
        b"q\0q\x01",
        rebuild,
        &empty,
        b"}(",
        &text("a"),
        b"h\x03",
        &text("a"),
        b"h\x03u.",
    ];
    assert!(message(&twice.concat(), &[]).contains("two tensors `a`"));
}

#[test]
fn archives_that_mean_different_things_to_different_readers_are_errors() {
    let problem = |bytes: &[u8]| import(bytes, &ImportOptions::default()).unwrap_err().to_string();
    let twice = archive(&[("a/data.pkl", b"}."), ("a/data.pkl", b"N.")], 0);
    assert!(problem(&twice).contains("two entries `a/data.pkl`"));
    let mut changed = archive(&[("a/data.pkl", b"}."), ("a/data/0", b"weights")], 0);
    let at = changed.windows(7).position(|window| window == b"weights").unwrap();
    changed[at] ^= 1;
    assert!(problem(&changed).contains("the checksum of its entry `a/data/0` is wrong"));
    // The second entry of the directory is the first one again, which has more than half of the
    // file.
    let mut overlapping = archive(&[("a", &[0; 4000]), ("a", &[])], 0);
    let directory = 31 + 4000 + 31;
    overlapping.copy_within(directory + 16..directory + 46, directory + 47 + 16);
    assert!(problem(&overlapping).contains("its entries overlap"), "{}", problem(&overlapping));
    assert!(problem(b"\x80\x02}.").contains("no zip archive"));
}

#[test]
fn weights_of_16_bits_and_statistics_below_zero_are_errors() {
    let tensor = |kind: &str| {
        [b"ctorch._utils\n_rebuild_tensor_v2\n(", &storage("0", kind)[..], b"K\0(K\x01t(K\x01ttR"].concat()
    };
    for kind in ["HalfStorage", "BFloat16Storage"] {
        let message = message(&[b"\x80\x02}", &text("weight")[..], &tensor(kind), b"s."].concat(), &[0; 4]);
        assert!(message.contains("the tensor `weight` has 16-bit numbers; expected 32 or 64"), "{message}");
    }
    let nested =
        [b"\x80\x02}", &text("model")[..], b"}", &text("a"), &tensor("FloatStorage"), b"ss."].concat();
    assert!(message(&nested, &[0; 4]).contains("found the keys: model; save `model.state_dict()` alone"));
    for variance in ["-1.0", "-1e-3"] {
        let text = format!(r#"{{"mean": [0.0, 0.0], "variance": [1.0, {variance}]}}"#);
        let normalizer = Some(ObservationNormalizer::from_json(&text).unwrap());
        let options = ImportOptions { normalizer, ..ImportOptions::default() };
        let message = import(&file("sb3_ppo.zip"), &options).unwrap_err().to_string();
        assert!(message.contains("variance"), "{message}");
    }
}

/// Returns a model of Stable-Baselines3 with tensors of these names, shapes and zeros.
fn stable_baselines(tensors: &[(&str, &[u8])]) -> Vec<u8> {
    let tuple = |sizes: &[u8]| {
        [b"(", &sizes.iter().flat_map(|size| [b'K', *size]).collect::<Vec<u8>>()[..], b"t"].concat()
    };
    let items = tensors.iter().flat_map(|(name, shape)| {
        let strides = vec![0; shape.len()];
        let tensor =
            [b"ctorch._utils\n_rebuild_tensor_v2\n(", &storage("0", "FloatStorage")[..], b"K\0"].concat();
        [&text(name)[..], &tensor, &tuple(shape), &tuple(&strides), b"tR"].concat()
    });
    let pickle = [&b"\x80\x02}("[..], &items.collect::<Vec<u8>>(), b"u."].concat();
    let weights = archive(&[("a/data.pkl", &pickle), ("a/data/0", &[0; 400])], 0);
    archive(&[("policy.pth", &weights)], 0)
}

#[test]
fn only_continuous_perceptrons_of_stable_baselines3_are_imported() {
    let linear: [(&str, &[u8]); 3] =
        [("log_std", &[1]), ("action_net.weight", &[1, 2]), ("action_net.bias", &[1])];
    let policy = import(&stable_baselines(&linear), &ImportOptions::default()).unwrap().policy;
    assert_eq!(policy.network().sizes(), [2, 1]);
    let message = |tensors: &[(&str, &[u8])]| {
        import(&stable_baselines(tensors), &ImportOptions::default()).unwrap_err().to_string()
    };
    assert!(message(&linear[1..]).contains("its actions are discrete"));
    let recurrent = [&linear[..], &[("lstm_actor.weight_ih_l0", &[4, 2])]].concat();
    assert!(message(&recurrent).contains("it is recurrent"));
    let dqn = message(&[("q_net.q_net.0.weight", &[4, 2]), ("q_net.q_net.0.bias", &[4])]);
    assert!(dqn.contains("expected a policy of PPO, A2C, SAC, TD3 or DDPG, found: q_net"), "{dqn}");
}
