//! Even grids through the intervals for which rounded times stand: every start and period such that
//! the time of each sample is in its interval.

/// Share of the rounding errors by which the times of a grid stay off the ends of the intervals. A
/// single step that is longer by the last digit just fits between both ends.
const INSIDE: f64 = 1e-9;

/// Number of halvings of an interval until nothing is left of it in 64 bits.
const HALVINGS: usize = 200;

/// The intervals, as differences from a grid that starts at the first time.
pub struct Grid {
    /// The period of that grid.
    near: f64,
    /// The corners of the lower hull of the upper ends, and of the negated lower ends: pairs of
    /// sample and difference. No other sample limits a grid.
    above: Vec<(f64, f64)>,
    below: Vec<(f64, f64)>,
    /// The differences of the least and the greatest period of a grid that starts at the first time
    /// and may touch the ends of the intervals, as numbers halfway between two rounded ones do.
    anchored: (f64, f64),
    /// More than the absolute difference of every period that fits.
    limit: f64,
}

impl Grid {
    /// Creates the intervals of times that have these largest errors by rounding, besides that of a
    /// 64-bit number.
    pub fn new(times_and_errors: impl Iterator<Item = (f64, f64)> + Clone, near: f64) -> Grid {
        let first = times_and_errors.clone().next().map_or(0.0, |(time, _)| time);
        let largest = times_and_errors.clone().fold(0.0, |largest: f64, (time, _)| largest.max(time.abs()));
        let noise = 2.0 * f64::EPSILON * largest;
        let mut grid = Grid {
            near,
            above: Vec::new(),
            below: Vec::new(),
            anchored: (f64::NEG_INFINITY, f64::INFINITY),
            limit: 0.0,
        };
        for (sample, (time, error)) in times_and_errors.enumerate() {
            let sample = sample as f64;
            let difference = time - first - sample * near;
            let inside = error * (1.0 - INSIDE) + noise;
            push_corner(&mut grid.above, sample, difference + inside);
            push_corner(&mut grid.below, sample, inside - difference);
            if sample > 0.0 {
                let closed = error * (1.0 + INSIDE) + noise;
                grid.anchored.0 = grid.anchored.0.max((difference - closed) / sample);
                grid.anchored.1 = grid.anchored.1.min((difference + closed) / sample);
            }
            grid.limit = grid.limit.max(4.0 * (difference.abs() + inside));
        }
        grid
    }

    /// Returns the least and the greatest period of a grid; `None` if there is no grid.
    pub fn periods(&self) -> Option<(f64, f64)> {
        let best = self.roomiest();
        let (low, high) = if self.room(best) >= 0.0 {
            (self.last_with_room(best, -self.limit), self.last_with_room(best, self.limit))
        } else {
            self.anchored
        };
        (low <= high).then_some((self.near + low, self.near + high))
    }

    /// Returns whether there is a grid of the period that the grid was created for.
    pub fn fits(&self) -> bool {
        self.room(0.0) >= 0.0 || (self.anchored.0 <= 0.0 && 0.0 <= self.anchored.1)
    }

    /// Returns the room for the start of a grid whose period differs by this much: it is negative
    /// if no start fits. This function is concave.
    fn room(&self, difference: f64) -> f64 {
        let least = |corners: &[(f64, f64)], slope: f64| {
            corners.iter().map(|(sample, end)| end + slope * sample).fold(f64::INFINITY, f64::min)
        };
        least(&self.above, -difference) + least(&self.below, difference)
    }

    /// Returns the difference with the most room.
    fn roomiest(&self) -> f64 {
        let mut low = -self.limit;
        let mut high = self.limit;
        for _ in 0..HALVINGS {
            let third = (high - low) / 3.0;
            if self.room(low + third) < self.room(high - third) {
                low += third;
            } else {
                high -= third;
            }
        }
        0.5 * (low + high)
    }

    /// Returns the difference farthest from `inside`, which has room, in the direction of
    /// `outside`, which has none.
    fn last_with_room(&self, mut inside: f64, mut outside: f64) -> f64 {
        for _ in 0..HALVINGS {
            let middle = 0.5 * (inside + outside);
            if self.room(middle) >= 0.0 {
                inside = middle;
            } else {
                outside = middle;
            }
        }
        inside
    }
}

/// Appends a corner to a lower hull, and removes the corners that are now above it.
fn push_corner(hull: &mut Vec<(f64, f64)>, x: f64, y: f64) {
    while let [.., (x0, y0), (x1, y1)] = hull.as_slice()
        && (y1 - y0) * (x - x0) >= (y - y0) * (x1 - x0)
    {
        hull.pop();
    }
    hull.push((x, y));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(times: &[f64], error: f64, expected: Option<(f64, f64)>) {
        let near = (times[times.len() - 1] - times[0]) / (times.len() - 1) as f64;
        let found = Grid::new(times.iter().map(|time| (*time, error)), near).periods();
        let is_close = match (found, expected) {
            (Some((a, b)), Some((c, d))) => (a - c).abs() < 1e-6 && (b - d).abs() < 1e-6,
            (found, expected) => found == expected,
        };
        assert!(is_close, "{times:?} within {error}: {found:?}, not {expected:?}");
    }

    #[test]
    fn the_periods_are_those_of_all_lines_through_the_intervals() {
        // From one end of the first interval to the other end of the last one.
        check(&[0.0, 1.0], 0.25, Some((0.5, 1.5)));
        check(&[0.0, 1.0, 2.0, 3.0], 0.3, Some((0.8, 1.2)));
        check(&[5.0, 6.0, 7.0], 0.0, Some((1.0, 1.0)));
        // Lines through (0, 0.3) and (1, 0.7), or through (1, 0.7) and (2, 2.3).
        check(&[0.0, 1.0, 2.0], 0.3, Some((0.7, 1.3)));
        // Off by 0.25, -0.25 and 0.25 from the best grid, -0.25 + 1.5 i. With 0.251 there is 0.001
        // more at each end: 1.5 ± 0.002.
        check(&[0.0, 1.0, 3.0], 0.24, None);
        check(&[0.0, 1.0, 3.0], 0.25, None);
        check(&[0.0, 1.0, 3.0], 0.251, Some((1.498, 1.502)));
    }

    #[test]
    fn numbers_halfway_between_two_rounded_ones_may_be_rounded_to_either() {
        // 1/80 s, rounded half to even.
        let times = [0.0, 0.012, 0.025, 0.038, 0.05, 0.062, 0.075, 0.088];
        check(&times, 0.0005, Some((0.0125, 0.0125)));
        // One step is longer by 0.01 s.
        check(&[0.0, 0.1, 0.21, 0.3], 0.005, None);
    }
}
