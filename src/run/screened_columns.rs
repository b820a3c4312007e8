//! Outcomes of another physics engine as columns of numbers, which a run file stores compressed.

use mishandle_rollout::{EpisodeEnd, ScreenedEpisode, Verdict};
use mishandle_store::StoredTrace;

/// Columns of every outcome: code, step and index of its end, four values of formulas, dangerous
/// steps, completion, overflow.
const FIXED: usize = 9;

/// Returns the number of columns of outcomes with this many parts of the robustness.
pub(crate) fn columns(parts: usize) -> usize {
    FIXED + parts
}

/// Converts outcomes to columns. A value that is missing is NaN.
pub(crate) fn encode(outcomes: &[ScreenedEpisode], parts: usize) -> StoredTrace {
    let mut columns = vec![Vec::with_capacity(outcomes.len()); columns(parts)];
    for ScreenedEpisode { end, verdict, has_overflowed } in outcomes {
        let (code, step, index) = end_numbers(*end);
        let count = |count: Option<usize>| count.map_or(f64::NAN, |count| count as f64);
        let value = |value: Option<f64>| value.unwrap_or(f64::NAN);
        let fixed: [f64; FIXED] = [
            code,
            step as f64,
            index as f64,
            value(verdict.robustness),
            value(verdict.success),
            value(verdict.strict),
            count(verdict.dangerous_steps),
            count(verdict.completion_step),
            f64::from(u8::from(*has_overflowed)),
        ];
        let parts = (0..parts).map(|index| value(verdict.parts.get(index).copied()));
        columns.iter_mut().zip(fixed.into_iter().chain(parts)).for_each(|(column, value)| column.push(value));
    }
    StoredTrace { columns }
}

/// Converts columns back to outcomes.
pub(crate) fn decode(stored: &StoredTrace) -> Vec<ScreenedEpisode> {
    let rows = stored.columns.first().map_or(0, Vec::len);
    let value = |column: usize, row: usize| Some(stored.columns[column][row]).filter(|value| !value.is_nan());
    let count = |column: usize, row: usize| value(column, row).map(|value| value as usize);
    let outcome = |row: usize| {
        let at = |column: usize| count(column, row).unwrap_or_default();
        let parts = (FIXED..stored.columns.len()).map(|column| value(column, row));
        ScreenedEpisode {
            end: end(at(0), at(1), at(2)),
            verdict: Verdict {
                robustness: value(3, row),
                success: value(4, row),
                strict: value(5, row),
                dangerous_steps: count(6, row),
                completion_step: count(7, row),
                parts: parts.collect::<Option<Vec<_>>>().unwrap_or_default(),
                // No screened question reads the others.
                ..Verdict::default()
            },
            has_overflowed: at(8) == 1,
        }
    };
    (0..rows).map(outcome).collect()
}

/// Returns code, step and index of an end. The codes are part of the format of run files.
fn end_numbers(end: EpisodeEnd) -> (f64, usize, usize) {
    match end {
        EpisodeEnd::Completed => (0.0, 0, 0),
        EpisodeEnd::Terminated { step } => (1.0, step, 0),
        EpisodeEnd::Stopped { step } => (2.0, step, 0),
        EpisodeEnd::Diverged { step } => (3.0, step, 0),
        EpisodeEnd::Undefined { step } => (4.0, step, 0),
        EpisodeEnd::InvalidAction { step, index } => (5.0, step, index),
        EpisodeEnd::InvalidObservation { step, index } => (6.0, step, index),
        EpisodeEnd::InvalidReward { step, index } => (7.0, step, index),
        EpisodeEnd::InvalidSignal { step, index } => (8.0, step, index),
        EpisodeEnd::InvalidScenario => (9.0, 0, 0),
        EpisodeEnd::Crashed { step } => (10.0, step, 0),
        EpisodeEnd::TimedOut { step } => (11.0, step, 0),
    }
}

/// Returns the end with this code. An unknown code has no verdict.
fn end(code: usize, step: usize, index: usize) -> EpisodeEnd {
    match code {
        0 => EpisodeEnd::Completed,
        1 => EpisodeEnd::Terminated { step },
        2 => EpisodeEnd::Stopped { step },
        3 => EpisodeEnd::Diverged { step },
        4 => EpisodeEnd::Undefined { step },
        5 => EpisodeEnd::InvalidAction { step, index },
        6 => EpisodeEnd::InvalidObservation { step, index },
        7 => EpisodeEnd::InvalidReward { step, index },
        8 => EpisodeEnd::InvalidSignal { step, index },
        9 => EpisodeEnd::InvalidScenario,
        11 => EpisodeEnd::TimedOut { step },
        _ => EpisodeEnd::Crashed { step },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_outcome_survives_the_round_trip() {
        let full = Verdict {
            robustness: Some(-0.1),
            success: Some(f64::INFINITY),
            strict: Some(f64::NEG_INFINITY),
            careful: None,
            dangerous_steps: Some(7),
            completion_step: Some(0),
            parts: vec![f64::NEG_INFINITY, -0.0],
            ..Verdict::default()
        };
        let ends = (0..12).map(|code| end(code, code + 1, code + 2));
        let mut outcomes: Vec<ScreenedEpisode> = ends
            .map(|end| ScreenedEpisode { end, verdict: Verdict::default(), has_overflowed: false })
            .collect();
        outcomes.push(ScreenedEpisode { end: EpisodeEnd::Completed, verdict: full, has_overflowed: true });
        let stored = encode(&outcomes, 2);
        assert_eq!(stored.columns.len(), columns(2));
        assert_eq!(decode(&stored), outcomes);
        assert!(decode(&encode(&[], 0)).is_empty());
    }
}
