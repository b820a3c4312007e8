//! The space of a search: coordinates, the times at which they begin to act, and the parts of the
//! robustness.

use crate::{Coordinate, SearchError, coordinate};

/// The space of a search, without units.
///
/// Times are fractions of the episode in [0, 1].
///
/// # Example
/// ```
/// use mishandle_search::{Coordinate, SearchSpace};
/// let space = SearchSpace::from(&[Coordinate::Continuous; 2]);
/// assert_eq!((space.begins, space.parts), (vec![0.0, 0.0], None));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct SearchSpace {
    /// The type of each coordinate.
    pub coordinates: Vec<Coordinate>,
    /// For each coordinate the time before which it has no effect; 0 if it acts from the start.
    pub begins: Vec<f64>,
    /// The parts that observations can contain; `None` if they contain none.
    pub parts: Option<Parts>,
}

/// The parts of a robustness: numbers of which minima and maxima are made.
#[derive(Debug, Clone, PartialEq)]
pub struct Parts {
    /// For each part the time after which nothing changes it.
    pub ends: Vec<f64>,
    /// For each part the number of its signal. Parts of one signal are its extrema in several
    /// windows of time.
    pub signals: Vec<usize>,
    /// How the parts compose the robustness.
    pub composition: Composition,
}

/// A tree of minima and maxima.
#[derive(Debug, Clone, PartialEq)]
pub enum Composition {
    /// The part with this index.
    Part(usize),
    /// The least of some values; +∞ of none.
    Min(Vec<Composition>),
    /// The greatest of some values; −∞ of none.
    Max(Vec<Composition>),
}

impl Composition {
    /// Returns the value that the parts compose.
    ///
    /// # Panics
    /// If a part has no value.
    ///
    /// # Example
    /// ```
    /// use mishandle_search::Composition::{Max, Min, Part};
    /// let composition = Max(vec![Part(0), Min(vec![Part(1), Part(2)])]);
    /// assert_eq!(composition.value(&[1.0, 2.0, 3.0]), 2.0);
    /// ```
    pub fn value<'a>(&'a self, parts: &[f64]) -> f64 {
        let of = |operands: &'a [Composition]| operands.iter().map(|operand| operand.value(parts));
        match self {
            Composition::Part(index) => parts[*index],
            Composition::Min(operands) => least(of(operands)),
            Composition::Max(operands) => -least(of(operands).map(|x| -x)),
        }
    }
}

/// Returns the least value, of the two zeros −0; +∞ of none.
fn least(values: impl Iterator<Item = f64>) -> f64 {
    values.min_by(f64::total_cmp).unwrap_or(f64::INFINITY)
}

impl SearchSpace {
    /// Returns the number of coordinates.
    ///
    /// # Errors
    /// As for [`by_name`](crate::by_name).
    pub(crate) fn dimension(&self) -> Result<usize, SearchError> {
        coordinate::dimension(&self.coordinates)
    }

    /// Returns the space of the coordinates for which `is_kept` holds.
    pub(crate) fn only(&self, is_kept: impl Fn(&Coordinate) -> bool) -> SearchSpace {
        let kept = self.coordinates.iter().zip(&self.begins).filter(|(coordinate, _)| is_kept(coordinate));
        let (coordinates, begins) = kept.map(|(coordinate, begin)| (*coordinate, *begin)).unzip();
        SearchSpace { coordinates, begins, parts: self.parts.clone() }
    }
}

impl From<&[Coordinate]> for SearchSpace {
    /// Makes the space of coordinates that act from the start, for observations without parts.
    fn from(coordinates: &[Coordinate]) -> SearchSpace {
        SearchSpace { coordinates: coordinates.to_vec(), begins: vec![0.0; coordinates.len()], parts: None }
    }
}

impl From<&Vec<Coordinate>> for SearchSpace {
    fn from(coordinates: &Vec<Coordinate>) -> SearchSpace {
        SearchSpace::from(coordinates.as_slice())
    }
}

impl<const N: usize> From<&[Coordinate; N]> for SearchSpace {
    fn from(coordinates: &[Coordinate; N]) -> SearchSpace {
        SearchSpace::from(coordinates.as_slice())
    }
}

impl From<&SearchSpace> for SearchSpace {
    fn from(space: &SearchSpace) -> SearchSpace {
        space.clone()
    }
}
