//! Pairwise coverage of a scenario space by the simulations of a run.

use mishandle_falsification::unit_scenario;
use mishandle_results::Coverage;
use mishandle_rollout::Axis;
use mishandle_store::RunFile;

use crate::error::MishandleError;
use crate::run::recorded_axis;

/// Largest number of bins of an axis. A pair of axes has at most 100 cells, which fit into the bits
/// of a `u128`.
const BINS: usize = 10;

/// Returns the pairwise coverage of the space of a run by its simulations. Axes without a value in
/// a scenario count as not visited.
///
/// # Errors
/// If the run cannot be read.
pub fn space_coverage(run: &RunFile) -> Result<Coverage, MishandleError> {
    let axes: Vec<Axis> = run.header().axes.iter().map(recorded_axis).collect();
    let mut cells = Cells::new(&axes);
    for simulation in run.simulations() {
        let simulation = simulation?;
        let fails = simulation.is_violated();
        cells.add(&unit_scenario(&axes, &simulation.scenario), fails);
    }
    Ok(cells.coverage())
}

/// The cells of all pairs of axes.
struct Cells {
    /// Number of bins of each axis.
    bins: Vec<usize>,
    /// Two axes; twice the same in a space with one axis.
    pairs: Vec<(usize, usize)>,
    /// Bits of the visited and of the failing cells of each pair.
    seen: Vec<[u128; 2]>,
}

impl Cells {
    fn new(axes: &[Axis]) -> Cells {
        let bins: Vec<usize> =
            axes.iter().map(|axis| axis.levels().map_or(BINS, |levels| levels.min(BINS))).collect();
        let free: Vec<usize> = (0..axes.len()).filter(|axis| !axes[*axis].is_fixed()).collect();
        let pairs: Vec<(usize, usize)> = match free[..] {
            [only] => vec![(only, only)],
            _ => {
                free.iter().flat_map(|a| free.iter().filter(move |b| a < b).map(move |b| (*a, *b))).collect()
            }
        };
        Cells { seen: vec![[0; 2]; pairs.len()], bins, pairs }
    }

    fn add(&mut self, point: &[Option<f64>], fails: bool) {
        let bin = |axis: usize| {
            let bins = self.bins[axis];
            point[axis].map(|u| ((u * bins as f64) as usize).min(bins - 1))
        };
        let bins: Vec<Option<usize>> = (0..point.len()).map(bin).collect();
        for ((a, b), [visited, failing]) in self.pairs.iter().zip(&mut self.seen) {
            let (Some(first), Some(second)) = (bins[*a], bins[*b]) else { continue };
            let cell = 1 << (first * BINS + second);
            *visited |= cell;
            *failing |= if fails { cell } else { 0 };
        }
    }

    fn coverage(&self) -> Coverage {
        let count = |index: usize| self.seen.iter().map(|bits| u64::from(bits[index].count_ones())).sum();
        let of_pair = |(a, b): &(usize, usize)| {
            if a == b { self.bins[*a] } else { self.bins[*a] * self.bins[*b] }
        };
        Coverage {
            pairs: self.pairs.len() as u64,
            cells: self.pairs.iter().map(|pair| of_pair(pair) as u64).sum(),
            visited: count(0),
            failing: count(1),
        }
    }
}

#[cfg(test)]
mod tests {
    use mishandle_rollout::AxisValues;

    use super::*;

    fn coverage(axes: &[Axis], points: &[(&[f64], bool)]) -> Coverage {
        let mut cells = Cells::new(axes);
        for (point, fails) in points {
            cells.add(&point.iter().map(|u| Some(*u)).collect::<Vec<_>>(), *fails);
        }
        cells.coverage()
    }

    #[test]
    fn cells_of_all_pairs_are_counted() {
        let continuous = |name| Axis::start(name, "", 0.0, 1.0);
        let integer = Axis::start("k", "", 0.0, 2.0).with_values(AxisValues::Integer);
        let axes = [continuous("x"), continuous("y"), integer, Axis::start("fixed", "", 1.0, 1.0)];
        // x and y: 100 cells, x and k: 30, y and k: 30.
        let points: [(&[f64], bool); 3] = [
            (&[0.01, 0.99, 0.5, 0.5], true),
            (&[0.09, 0.91, 0.5, 0.5], false),
            (&[1.0, 0.99, 0.5, 0.5], false),
        ];
        let found = coverage(&axes, &points);
        // The first two points share all cells. The third shares that of y and k.
        assert_eq!(found, Coverage { pairs: 3, cells: 160, visited: 5, failing: 3 });
        assert_eq!(found.failing_fraction(), Some(0.6));
    }

    #[test]
    fn a_space_of_one_axis_has_the_cells_of_the_axis() {
        let points: [(&[f64], bool); 2] = [(&[0.0], false), (&[1.0], true)];
        let found = coverage(&[Axis::start("x", "", 0.0, 1.0)], &points);
        assert_eq!(found, Coverage { pairs: 1, cells: 10, visited: 2, failing: 1 });
        assert_eq!(coverage(&[], &[]).visited_fraction(), None);
    }
}
