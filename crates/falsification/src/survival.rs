//! How long trials last until a violation, where some were never seen to find one.

/// How long one trial was watched, and whether that ended with a violation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spell {
    /// Simulations.
    pub simulations: u32,
    /// Whether the last of them is a violation; otherwise nothing is known of what would have come after it.
    pub falsified: bool,
}

/// The Kaplan-Meier estimate of how many trials are still without a violation after m simulations.
///
/// ```text
/// S(m) = product over i <= m of (1 - d(i) / n(i))
/// ```
///
/// with d(i) trials falsified by simulation i among the n(i) that were watched for at least i simulations. Unlike a
/// mean over the falsified trials, it is not drawn towards searches that find something quickly or never.
///
/// # Example
/// Four trials with a budget of 300, of which one found nothing:
/// ```
/// use mishandle_falsification::{Spell, Survival};
/// let falsified = |simulations| Spell { simulations, falsified: true };
/// let censored = Spell { simulations: 300, falsified: false };
/// let survival = Survival::new(vec![falsified(10), falsified(2), censored, falsified(40)]);
/// assert_eq!(survival.at(10), 0.5);
/// assert_eq!(survival.median(), Some(10));
/// assert_eq!(survival.restricted_mean(300), Some((2.0 + 10.0 + 40.0 + 300.0) / 4.0));
/// ```
///
/// # Reference
/// Kaplan and Meier, "Nonparametric estimation from incomplete observations", JASA 53, 1958.
#[derive(Clone, Debug, PartialEq)]
pub struct Survival {
    /// Number of simulations of each violation and S from there on, in order.
    steps: Vec<(u32, f64)>,
    /// Simulations of the longest spell.
    watched: u32,
}

impl Survival {
    /// The estimate from these spells, in any order.
    pub fn new(mut spells: Vec<Spell>) -> Survival {
        spells.sort_by_key(|spell| spell.simulations);
        let watched = spells.last().map_or(0, |spell| spell.simulations);
        let mut at_risk = spells.len();
        let mut share = 1.0;
        let mut steps = Vec::new();
        for same in spells.chunk_by(|a, b| a.simulations == b.simulations) {
            let falsified = same.iter().filter(|spell| spell.falsified).count();
            if falsified > 0 {
                share *= (at_risk - falsified) as f64 / at_risk as f64;
                steps.push((same[0].simulations, share));
            }
            at_risk -= same.len();
        }
        Survival { steps, watched }
    }

    /// S(m): the share of trials without a violation after `simulations` simulations.
    pub fn at(&self, simulations: u32) -> f64 {
        let past = self.steps.partition_point(|(m, _)| *m <= simulations);
        past.checked_sub(1).map_or(1.0, |last| self.steps[last].1)
    }

    /// The least number of simulations after which at most half of the trials are without a violation, if any.
    pub fn median(&self) -> Option<u32> {
        self.steps.iter().find(|(_, share)| *share <= 0.5).map(|(m, _)| *m)
    }

    /// The mean number of simulations to the first violation, `budget` where there is none by then.
    ///
    /// ```text
    /// E min(T, budget) = S(0) + S(1) + … + S(budget - 1)
    /// ```
    ///
    /// `None` if no trial was watched for that long and some might have gone on.
    pub fn restricted_mean(&self, budget: u32) -> Option<f64> {
        let (mut sum, mut since, mut share) = (0.0, 0, 1.0);
        for &(m, next) in self.steps.iter().filter(|(m, _)| *m < budget) {
            sum += share * f64::from(m - since);
            (since, share) = (m, next);
        }
        if share > 0.0 && self.watched < budget {
            return None;
        }
        Some(sum + share * f64::from(budget - since))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Weeks of remission under 6-mercaptopurine, a minus sign for those still in it: Freireich et al., Blood 21, 1963.
    const REMISSION: [i32; 21] =
        [6, 6, 6, -6, 7, -9, 10, -10, -11, 13, 16, -17, -19, -20, 22, 23, -25, -32, -32, -34, -35];

    fn survival(times: &[i32]) -> Survival {
        let spell = |time: &i32| Spell { simulations: time.unsigned_abs(), falsified: *time > 0 };
        Survival::new(times.iter().map(spell).collect())
    }

    #[test]
    fn the_remission_data_give_the_published_curve() {
        let survival = survival(&REMISSION);
        // As in every textbook, for instance Cox and Oakes, "Analysis of Survival Data", 1984.
        let published = [
            (5, 1.0),
            (6, 0.857),
            (7, 0.807),
            (10, 0.753),
            (13, 0.690),
            (16, 0.627),
            (22, 0.538),
            (23, 0.448),
        ];
        for (week, share) in published {
            assert!((survival.at(week) - share).abs() < 0.0005, "week {week}: {}", survival.at(week));
        }
        assert_eq!(survival.at(35), survival.at(23));
        assert_eq!(survival.median(), Some(23));
        // R's survfit prints 23.3 for the mean restricted to 35 weeks.
        assert!((survival.restricted_mean(35).unwrap() - 23.3).abs() < 0.05);
    }

    #[test]
    fn without_censoring_it_is_the_share_and_the_mean() {
        let survival = survival(&[3, 1, 4, 1]);
        assert_eq!([0, 1, 2, 3, 4].map(|m| survival.at(m)), [1.0, 0.5, 0.5, 0.25, 0.0]);
        assert_eq!(survival.restricted_mean(10), Some(9.0 / 4.0));
    }

    #[test]
    fn the_order_of_the_spells_does_not_matter() {
        let mut reversed = REMISSION;
        reversed.reverse();
        assert_eq!(survival(&reversed), survival(&REMISSION));
    }

    #[test]
    fn nothing_is_said_beyond_what_was_watched() {
        let cut_short = survival(&[2, -4]);
        assert_eq!(cut_short.median(), Some(2));
        assert_eq!(cut_short.restricted_mean(4), Some(3.0));
        assert_eq!(cut_short.restricted_mean(5), None);
        assert_eq!(survival(&[-4, -4]).median(), None);
        assert_eq!(survival(&[]).restricted_mean(1), None);
    }
}
