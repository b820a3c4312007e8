//! Learning curves, as CSV.

use mishandle::train::Curve;

use crate::scratch::Scratch;

/// Checks that the iterations of every curve that is read are consecutive, that its environment
/// steps increase, and that every row has one number per reward term.
pub fn check(bytes: &[u8]) {
    let scratch = Scratch::new();
    let Ok(curve) = Curve::load(&scratch.file("curve.csv", bytes)) else { return };
    assert_eq!(curve.is_truncated, bytes.last().is_some_and(|last| *last != b'\n'));
    for pair in curve.rows.windows(2) {
        assert_eq!(pair[1].iteration, pair[0].iteration + 1);
        assert!(pair[1].environment_steps > pair[0].environment_steps);
    }
    for row in &curve.rows {
        assert_eq!(row.reward_terms.len(), curve.reward_terms.len());
        assert!(row.wall_clock_secs.is_finite() && row.learning_rate.is_finite());
    }
}

pub fn seeds() -> Vec<Vec<u8>> {
    let columns = "iteration,environment_steps,wall_clock_secs,mean_return,mean_episode_steps,terminated_rate,\
                   success_rate,strict_success_rate,validation_return,kl,entropy,learning_rate,physics_share,\
                   inference_share,learning_share,reward_distance";
    let first = "1,8192,0.412,,,,,,,0.01,4.1,0.001,0.6,0.1,0.3,-0.25";
    let second = "2,16384,0.9,-3.5,300,0.5,0.25,0,-4,NaN,inf,1e-3,0.6,0.1,0.3,-0.125";
    [
        format!("{columns}\n{first}\n{second}\n"),
        format!("{columns}\r\n{first}\r\n\"2\",16384"),
        format!("{columns},reward_\"\n{first},1\n"),
        format!("{columns}\n"),
    ]
    .map(String::into_bytes)
    .into()
}
