//! Random numbers and random networks for tests.

use mishandle_network::{Activation, Mlp, Scalar};

/// SplitMix64 (Steele, Lea and Flood, 2014), for random cases that are the same on every run.
pub struct Random(pub u64);

impl Random {
    /// Returns a number from [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Returns a standard normal number.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// Standard normal numbers.
    pub fn normals<T: Scalar>(&mut self, count: usize) -> Vec<T> {
        (0..count).map(|_| T::from_f64(self.normal())).collect()
    }
}

/// Sizes, activations of the hidden layers and of the last, whether there is layer normalization.
type Case = (&'static [usize], Activation, Activation, bool);

/// Common pairs of activations, and sizes around the width of a panel (16).
pub const CASES: [Case; 10] = [
    (&[3, 5, 2], Activation::Elu, Activation::Identity, false),
    (&[3, 5, 2], Activation::Tanh, Activation::Identity, false),
    (&[3, 5, 2], Activation::Relu, Activation::Tanh, false),
    (&[17, 33, 31, 16], Activation::Elu, Activation::Tanh, false),
    (&[16, 15, 1], Activation::Tanh, Activation::Elu, false),
    (&[30, 64, 48, 9], Activation::Elu, Activation::Identity, false),
    (&[1, 16, 32, 3], Activation::Relu, Activation::Identity, false),
    (&[4, 2], Activation::Elu, Activation::Tanh, false),
    (&[5, 7, 33, 2], Activation::Elu, Activation::Identity, true),
    (&[20, 32, 16, 1], Activation::Tanh, Activation::Tanh, true),
];

/// Returns a network with random weights and biases.
pub fn network<T: Scalar>(case: Case, random: &mut Random) -> Mlp<T> {
    let (sizes, hidden, output, layer_norm) = case;
    let mut network = Mlp::new(sizes, hidden, output).expect("a network");
    if layer_norm {
        network = network.with_layer_norm();
    }
    network.initialize_uniform(|| random.uniform());
    network
}
