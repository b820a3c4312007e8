//! The frames of a film: which samples it shows, for how long, and around which event.

use crate::inspect::Event;

/// Approximate frame rate, in frames per second. Consecutive frames are a whole number of samples
/// apart.
const FRAME_RATE: f64 = 30.0;

/// Time for which a film holds a marked frame, in seconds of the film.
const HOLD: f64 = 1.0;

/// Longest episode that a film shows as a whole by default, in seconds.
const WHOLE: f64 = 10.0;

/// Parts of an episode that a film or filmstrip shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// First and last sample.
    pub window: (usize, usize),
    /// The sample of each frame. A marked sample is repeated.
    pub samples: Vec<usize>,
    /// Frames per second.
    pub rate: f64,
}

impl Film {
    /// Plans a film of an episode with samples 0 to `last`, `control_dt` seconds apart.
    ///
    /// The film shows the samples up to `around` seconds before and after the event.
    /// By default, it shows an episode of up to 10 s as a whole, and 5 s on each side otherwise.
    /// Without an event, the last sample takes its place. The film holds each mark of the event for
    /// 1 s. `speed` is the speed of the film relative to the simulation.
    ///
    /// # Example
    /// ```
    /// use mishandle::inspect::{Event, EventKind};
    /// use mishandle::picture::Film;
    /// let event = Event { sample: 63, decisive: None, kind: EventKind::Violation };
    /// let film = Film::new(1.0 / 60.0, 300, Some(&event), Some(0.1), 1.0);
    /// assert_eq!(film.window, (57, 69));
    /// // Every second sample at 30 frames per second, and the event for 30 frames.
    /// assert_eq!((film.samples[..4].to_vec(), film.samples.len()), (vec![57, 59, 61, 63], 7 + 29));
    /// ```
    pub fn new(control_dt: f64, last: usize, event: Option<&Event>, around: Option<f64>, speed: f64) -> Film {
        let center = event.map_or(last, |event| event.sample.min(last));
        let is_short = last as f64 * control_dt <= WHOLE;
        let window = match around.or((!is_short).then_some(0.5 * WHOLE)) {
            None => (0, last),
            Some(around) => {
                let samples = (around / control_dt).round() as usize;
                (center.saturating_sub(samples), center.saturating_add(samples).min(last))
            }
        };
        let stride = (speed / (FRAME_RATE * control_dt)).round().max(1.0) as usize;
        let rate = speed / (stride as f64 * control_dt);
        let mut samples: Vec<usize> = (window.0..=window.1).step_by(stride).collect();
        let held = (HOLD * rate).round().max(1.0) as usize;
        for (sample, _) in event.map_or(Vec::new(), Event::marks) {
            if (window.0..=window.1).contains(&sample) {
                samples.retain(|shown| *shown != sample);
                samples.extend(std::iter::repeat_n(sample, held));
            }
        }
        samples.sort_unstable();
        Film { window, samples, rate }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspect::EventKind;

    const DT: f64 = 1.0 / 60.0;

    #[test]
    fn a_short_episode_is_shown_as_a_whole_with_both_marks_held() {
        let event = Event { sample: 100, decisive: Some(201), kind: EventKind::Violation };
        let film = Film::new(DT, 300, Some(&event), None, 1.0);
        assert_eq!((film.window, film.rate.round()), ((0, 300), 30.0));
        let count = |sample: usize| film.samples.iter().filter(|shown| **shown == sample).count();
        // Sample 201 is not a multiple of the stride of 2, and is shown nevertheless.
        assert_eq!([98, 99, 100, 201, 202].map(count), [1, 0, 30, 30, 1]);
        assert_eq!(film.samples.len(), 151 + 29 + 30);
    }

    #[test]
    fn a_long_episode_is_cut_around_its_event() {
        let event = Event { sample: 1000, decisive: Some(10), kind: EventKind::Violation };
        let film = Film::new(0.05, 2000, Some(&event), None, 1.0);
        assert_eq!(film.window, (900, 1100));
        assert!(film.samples.contains(&1000) && !film.samples.contains(&10));
        assert_eq!(Film::new(0.05, 2000, None, None, 1.0).window, (1900, 2000));
    }

    #[test]
    fn slow_motion_shows_every_sample_at_a_lower_rate() {
        let film = Film::new(DT, 300, None, Some(1.0), 0.25);
        assert_eq!((film.window, film.samples.len()), ((240, 300), 61));
        assert!((film.rate - 15.0).abs() < 1e-9);
        // Ten times as fast: 20 samples apart.
        assert_eq!(Film::new(DT, 300, None, None, 10.0).samples.len(), 16);
    }
}
