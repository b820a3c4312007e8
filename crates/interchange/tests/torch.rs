//! Checkpoints of PyTorch: those of real libraries against the actions that the libraries computed,
//! and hostile ones.

use crate::checkpoint;
use crate::checkpoint::{archive, storage, text};
use mishandle_controllers::Policy;
use mishandle_interchange::{ImportOptions, Normalization, ObservationNormalizer, TorchProblem, import};
use mishandle_network::Activation;
use mishandle_rollout::Controller;

const OBSERVATIONS: [f32; 6] = [0.3, -0.7, 1.5, 0.2, -4.0, 2.5];

fn file(name: &str) -> Vec<u8> {
    std::fs::read(format!("{}/tests/data/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

fn given(activation: Activation, output: Activation) -> ImportOptions {
    ImportOptions {
        activation: Some(activation),
        output_activation: Some(output),
        normalizer: Normalization::OfFile,
    }
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
    let options = given(Activation::Elu, Activation::Identity);
    let policy = check("skrl_agent.pt", &options, "skrl", [0.2608726, 0.5398161, 0.65475094]);
    assert_eq!(policy.observation_clip(), Some(5.0));
    assert!((policy.mean()[0] - 1.125).abs() < 1e-7);
    // The activations are in the code or in the settings of skrl, such as `tanh(ACTIONS)`.
    for (options, part) in [
        (ImportOptions::default(), "hidden layers"),
        (ImportOptions { activation: Some(Activation::Elu), ..ImportOptions::default() }, "last layer"),
    ] {
        let message = import(&file("skrl_agent.pt"), &options).unwrap_err().to_string();
        assert!(message.contains(&format!("does not say which activation of the {part}")), "{message}");
    }
    let plain = ImportOptions { normalizer: Normalization::Nothing, ..options };
    let plain = import(&file("skrl_agent.pt"), &plain).unwrap().policy;
    assert_eq!((plain.mean()[0], plain.observation_clip()), (0.0, None));
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
    let options = ImportOptions { normalizer: Normalization::Given(normalizer), ..ImportOptions::default() };
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
        let normalizer = Normalization::Given(ObservationNormalizer::from_json(&text).unwrap());
        let options = ImportOptions { normalizer, ..ImportOptions::default() };
        let message = import(&file("sb3_ppo.zip"), &options).unwrap_err().to_string();
        assert!(message.contains("variance"), "{message}");
    }
}

/// A module of a `Sequential`, with the function that it computes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Module {
    Linear,
    Relu,
    LayerNorm,
    /// A layer normalization without weights.
    PlainNorm,
    Dropout,
}

/// Returns the state dictionary of a `Sequential` from 2 numbers to 1, and its output.
fn sequential(modules: &[Module], x: [f64; 2]) -> (Vec<u8>, f64) {
    let linear = modules.iter().filter(|module| **module == Module::Linear).count();
    let mut parts = Vec::new();
    let mut x = x.to_vec();
    let mut seen = 0;
    for (number, module) in modules.iter().enumerate() {
        let standardized = || {
            let mean = x.iter().sum::<f64>() / x.len() as f64;
            let variance = x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / x.len() as f64;
            x.iter().map(|x| (x - mean) / (variance + 1e-5).sqrt()).collect::<Vec<f64>>()
        };
        let mut push = |weight: &[f32], shape: Vec<usize>, bias: &[f32]| {
            parts.push((format!("{number}.weight"), shape, weight.to_vec()));
            parts.push((format!("{number}.bias"), vec![bias.len()], bias.to_vec()));
        };
        match module {
            Module::Linear => {
                seen += 1;
                let outputs = if seen == linear { 1 } else { 2 };
                let weight =
                    |row: usize, column: usize| (1.0 + row as f64 - 1.5 * column as f64) / seen as f64;
                let rows: Vec<Vec<f64>> =
                    (0..outputs).map(|row| vec![weight(row, 0), weight(row, 1)]).collect();
                let weights: Vec<f32> = rows.concat().iter().map(|w| *w as f32).collect();
                push(&weights, vec![outputs, 2], &vec![0.25; outputs]);
                let w = |row: usize, column: usize| f64::from(weights[2 * row + column]);
                x = (0..outputs).map(|row| w(row, 0) * x[0] + w(row, 1) * x[1] + 0.25).collect();
            }
            Module::Relu => x.iter_mut().for_each(|x| *x = x.max(0.0)),
            Module::LayerNorm => {
                x = standardized().iter().map(|x| 1.5 * x - 0.5).collect();
                push(&vec![1.5; x.len()], vec![x.len()], &vec![-0.5; x.len()]);
            }
            Module::PlainNorm => x = standardized(),
            // In evaluation, it passes all numbers.
            Module::Dropout => {}
        }
    }
    (checkpoint::state_dictionary(&parts), x[0])
}

#[test]
fn a_sequential_acts_as_it_does_in_pytorch_or_is_refused() {
    use Module::{Dropout, LayerNorm, Linear, PlainNorm, Relu};
    let between = [Linear, Relu, LayerNorm, PlainNorm, Dropout];
    let mut accepted = 0;
    let mut refused = 0;
    for number in 0..5_usize.pow(6) {
        let digit = |place: u32| between[number / 5_usize.pow(place) % 5];
        let head = number % 3;
        let first = 1 + number % 4;
        let second = 1 + number / 4 % 3;
        let mut modules: Vec<Module> = (0..head / 2).map(|_| digit(0)).collect();
        modules.push(Linear);
        modules.extend((0..first as u32).map(digit));
        modules.push(Linear);
        modules.extend((0..second as u32).map(|place| digit(place + 3)));
        modules.push(Linear);
        let x = [0.7, -1.3];
        let (bytes, expected) = sequential(&modules, x);
        let Ok(imported) = import(&bytes, &given(Activation::Relu, Activation::Identity)) else {
            refused += 1;
            continue;
        };
        accepted += 1;
        let mut action = [0.0];
        imported.policy.worker().act(1, &x.map(|x| x as f32), &mut [], &mut action);
        // A normalization of almost equal numbers amplifies their rounding.
        let is_plain = (f64::from(action[0]) - expected).abs() < 1e-4;
        // A module between two layers without weights is an activation, as the user says.
        let is_other = modules
            .windows(3)
            .any(|three| matches!(three, [Linear | LayerNorm, PlainNorm | Dropout, Linear]));
        assert!(is_plain || is_other, "{action:?}, expected {expected}: {modules:?}");
    }
    assert!(accepted > 100 && refused > 10_000, "{accepted} accepted, {refused} refused");
}
