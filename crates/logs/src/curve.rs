//! Values of a formula or term over the time of a log, for charts.

use mishandle_stl::{Clock, DenseMonitor, DenseSignal, Formula, Monitor};

use crate::error::Result;
use crate::samples::{Samples, Signals};
use crate::verdict::Evaluation;

impl Samples {
    /// Returns whether times are in seconds, rather than in samples for lack of times and a period.
    pub fn is_timed(&self) -> bool {
        !matches!(self.signals, Signals::Even { period: None, .. })
    }

    /// Returns the time of a sample, in seconds if [`Samples::is_timed`], otherwise its number.
    /// Dense time has no samples: the time is NaN.
    pub fn time_of(&self, sample: usize) -> f64 {
        match &self.signals {
            Signals::Even { period, start, .. } => {
                period.map_or(sample as f64, |period| start + sample as f64 * period)
            }
            Signals::Dense(_) => f64::NAN,
        }
    }

    /// Returns whether all values of a signal are 0 or 1.
    pub fn has_truth_values(&self, signal: &str) -> bool {
        let values = match &self.signals {
            Signals::Even { trace, .. } => trace.signal(signal),
            Signals::Dense(signals) => {
                signals.iter().find(|found| found.name() == signal).map(DenseSignal::values)
            }
        };
        values.is_some_and(|values| values.iter().all(|value| [0.0, 1.0].contains(value)))
    }

    /// Returns the first and last time, in seconds if [`Samples::is_timed`].
    pub fn time_range(&self) -> [f64; 2] {
        match &self.signals {
            Signals::Even { trace, .. } => {
                let last = trace.len().saturating_sub(1);
                [0, last].map(|sample| self.time_of(sample))
            }
            Signals::Dense(signals) => {
                signals.first().map_or([0.0; 2], |signal| [signal.start(), signal.end()])
            }
        }
    }

    /// Returns points of a line through the values of a formula or term: times as those of
    /// [`Samples::time_range`], and values. A step has two points.
    ///
    /// # Errors
    /// As for [`Samples::verdict`].
    ///
    /// # Example
    /// ```
    /// use mishandle_logs::{Evaluation, Interpolation, OpenLog, Options, Sampling};
    /// use mishandle_stl::Formula;
    ///
    /// let options = Options { sampling: Sampling::Dense(Interpolation::Hold), ..Options::default() };
    /// let log = OpenLog::open_csv(Box::new("time,d\n0,1\n1,4\n3,2\n".as_bytes()), &options).unwrap();
    /// let samples = log.read(&["d"]).unwrap().samples(&options).unwrap();
    /// let curve = samples.curve(&Formula::parse("2 * d").unwrap(), &Evaluation::default()).unwrap();
    /// assert_eq!(curve, [[0.0, 2.0], [1.0, 2.0], [1.0, 8.0], [3.0, 8.0], [3.0, 4.0]]);
    /// ```
    pub fn curve(&self, formula: &Formula, evaluation: &Evaluation) -> Result<Vec<[f64; 2]>> {
        let mut curve = Vec::new();
        match (&self.signals, self.clock(formula, evaluation)?) {
            (Signals::Even { trace, .. }, clock) => {
                let mut monitor = Monitor::new(formula, trace.names(), clock.unwrap_or(Clock::unknown()))?;
                let values = monitor.robustness_signal(trace)?.iter().enumerate();
                curve.extend(values.map(|(sample, value)| [self.time_of(sample), *value]));
            }
            (Signals::Dense(signals), _) => {
                let names: Vec<String> = signals.iter().map(|signal| signal.name().to_owned()).collect();
                let monitor = DenseMonitor::new(formula, &names, evaluation.unit)?;
                for point in monitor.robustness_signal(signals)?.breakpoints() {
                    for value in [point.before, point.at, point.after] {
                        if curve.last() != Some(&[point.time, value]) {
                            curve.push([point.time, value]);
                        }
                    }
                }
            }
        }
        Ok(curve)
    }
}
