//! Statistics that normalize observations, from a file that their owner writes.

use serde::Deserialize;

/// The statistics of `VecNormalize` of Stable-Baselines3, as JSON.
///
/// ```text
/// x = clamp((o - mean) / √(variance + epsilon), -clip, clip)
/// ```
///
/// # Example
/// ```
/// use mishandle_interchange::ObservationNormalizer;
/// let normalizer = ObservationNormalizer::from_json(r#"{"mean": [0.5], "variance": [4.0]}"#).unwrap();
/// assert_eq!((normalizer.epsilon, normalizer.clip), (1e-8, Some(10.0)));
/// ```
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObservationNormalizer {
    /// The mean of each component.
    pub mean: Vec<f64>,
    /// The variance of each component.
    pub variance: Vec<f64>,
    /// Added to the variance; 1e-8 by default.
    #[serde(default = "default_epsilon")]
    pub epsilon: f64,
    /// The limit of normalized numbers, 10 by default; `null` clips nothing.
    #[serde(default = "default_clip")]
    pub clip: Option<f64>,
}

fn default_epsilon() -> f64 {
    1e-8
}

fn default_clip() -> Option<f64> {
    Some(10.0)
}

impl ObservationNormalizer {
    /// Returns the normalizer that changes nothing.
    pub(super) fn identity(size: usize) -> ObservationNormalizer {
        ObservationNormalizer { mean: vec![0.0; size], variance: vec![1.0; size], epsilon: 0.0, clip: None }
    }

    /// Parses the text of a file.
    ///
    /// # Errors
    /// If the text is not JSON, a key is missing or unknown.
    pub fn from_json(text: &str) -> Result<ObservationNormalizer, serde_json::Error> {
        serde_json::from_str(text)
    }

    /// Returns the variances with which our own normalizer, which divides by √variance + 1e-8,
    /// divides by the same numbers.
    pub(super) fn own_variance(&self) -> Vec<f64> {
        let own = |variance: &f64| {
            // NaN of an invalid variance stays NaN, which a policy refuses.
            let scale = (variance + self.epsilon).sqrt() - 1e-8;
            if scale < 0.0 { 0.0 } else { scale * scale }
        };
        self.variance.iter().map(own).collect()
    }
}
