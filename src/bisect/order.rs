//! Finds the first failing one of ordered candidates.

use std::collections::BTreeMap;

use mishandle_results::BisectedResult;

/// Where the first failing candidate is, with indices from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// The last candidate that passes and the first one that fails. Those between are undecided.
    Between(usize, usize),
    /// The first candidate does not pass, or the last one does not fail.
    NotBracketed(BisectedResult, BisectedResult),
}

/// Finds the first failing one of `n` candidates, at least 2, if all before it pass and none after
/// it. `test` returns `None` if it was interrupted; then there is no result.
///
/// A candidate without a decision is replaced by the nearest one with a decision.
pub(super) fn first_failing<E>(
    n: usize,
    mut test: impl FnMut(usize) -> Result<Option<BisectedResult>, E>,
) -> Result<Option<Place>, E> {
    let mut known = BTreeMap::new();
    let mut ask = |index: usize| -> Result<Option<BisectedResult>, E> {
        if let Some(outcome) = known.get(&index) {
            return Ok(Some(*outcome));
        }
        let found = test(index)?;
        known.extend(found.map(|outcome| (index, outcome)));
        Ok(found)
    };
    let Some(first) = ask(0)? else { return Ok(None) };
    let Some(last) = ask(n - 1)? else { return Ok(None) };
    if (first, last) != (BisectedResult::Passes, BisectedResult::Fails) {
        return Ok(Some(Place::NotBracketed(first, last)));
    }
    let mut good = 0;
    let mut bad = n - 1;
    'halve: loop {
        let middle = good + (bad - good) / 2;
        // The nearest first, the earlier one of two.
        let mut between: Vec<usize> = (good + 1..bad).collect();
        between.sort_by_key(|index| (index.abs_diff(middle), *index));
        for index in between {
            match ask(index)? {
                None => return Ok(None),
                Some(BisectedResult::Undecided) => {}
                Some(BisectedResult::Passes) => {
                    good = index;
                    continue 'halve;
                }
                Some(BisectedResult::Fails) => {
                    bad = index;
                    continue 'halve;
                }
            }
        }
        return Ok(Some(Place::Between(good, bad)));
    }
}

/// Returns the place of the first failing one, if all candidates are tested, whatever those after
/// it do.
pub(super) fn earliest_failing(outcomes: &[BisectedResult]) -> Option<Place> {
    let first = *outcomes.first()?;
    let last = *outcomes.last()?;
    if (first, last) != (BisectedResult::Passes, BisectedResult::Fails) {
        return Some(Place::NotBracketed(first, last));
    }
    let bad = outcomes.iter().position(|outcome| *outcome == BisectedResult::Fails)?;
    let good = outcomes[..bad].iter().rposition(|outcome| *outcome == BisectedResult::Passes)?;
    Some(Place::Between(good, bad))
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;

    fn found(outcomes: &[BisectedResult]) -> (Place, usize) {
        let mut tests = 0;
        let place = first_failing(outcomes.len(), |index| {
            tests += 1;
            Ok::<_, Infallible>(Some(outcomes[index]))
        });
        (place.expect("no test fails").expect("no test is interrupted"), tests)
    }

    #[test]
    fn the_first_failing_one_is_found_with_a_logarithmic_number_of_tests() {
        for n in 2..70_usize {
            for first in 1..n {
                let outcomes: Vec<BisectedResult> = (0..n)
                    .map(|index| if index < first { BisectedResult::Passes } else { BisectedResult::Fails })
                    .collect();
                let (place, tests) = found(&outcomes);
                assert_eq!(place, Place::Between(first - 1, first), "{first} of {n}");
                let most = 2 + (n - 1).next_power_of_two().trailing_zeros() as usize;
                assert!(tests <= most, "{tests} tests, {first} of {n}");
            }
        }
    }

    #[test]
    fn undecided_candidates_stay_between_the_ends() {
        use BisectedResult::{Fails, Passes, Undecided};
        // Each set of undecided candidates among 6 inner ones, for each border.
        for first in 1..7_usize {
            for set in 0..1_u32 << 6 {
                let is_undecided = |index: usize| (1..7).contains(&index) && set >> (index - 1) & 1 == 1;
                let outcome = |index: usize| match index {
                    index if is_undecided(index) => Undecided,
                    index if index < first => Passes,
                    _ => Fails,
                };
                let outcomes: Vec<BisectedResult> = (0..8).map(outcome).collect();
                let good =
                    (0..first).rev().find(|index| outcomes[*index] == Passes).expect("the first passes");
                let bad = (first..8).find(|index| outcomes[*index] == Fails).expect("the last fails");
                assert_eq!(found(&outcomes).0, Place::Between(good, bad), "{outcomes:?}");
            }
        }
    }

    #[test]
    fn of_tested_candidates_the_earliest_failing_one_is_the_answer() {
        use BisectedResult::{Fails, Passes, Undecided};
        // Halving would end at the second change.
        let outcomes = [Passes, Fails, Passes, Fails, Fails];
        assert_eq!(found(&outcomes).0, Place::Between(2, 3));
        assert_eq!(earliest_failing(&outcomes), Some(Place::Between(0, 1)));
        let outcomes = [Passes, Passes, Undecided, Fails, Passes, Fails];
        assert_eq!(earliest_failing(&outcomes), Some(Place::Between(1, 3)));
        assert_eq!(earliest_failing(&[Passes, Fails, Passes]), Some(Place::NotBracketed(Passes, Passes)));
    }

    #[test]
    fn ends_that_do_not_bracket_are_reported_after_two_tests() {
        use BisectedResult::{Fails, Passes, Undecided};
        for ends in
            [(Passes, Passes), (Fails, Fails), (Fails, Passes), (Undecided, Fails), (Passes, Undecided)]
        {
            let outcomes = [ends.0, Passes, Fails, ends.1];
            assert_eq!(found(&outcomes), (Place::NotBracketed(ends.0, ends.1), 2));
        }
    }
}
