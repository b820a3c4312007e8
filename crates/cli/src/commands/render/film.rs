//! Films of a recorded simulation: videos and animated PNG.

use anyhow::Result;
use mishandle::inspect::Event;
use mishandle::picture::{Film, FrameRenderer, StateTrajectory};
use mishandle::world::{Picture, animated_png};
use mishandle_text::instant;

use super::Job;
use crate::exit_status::ExitStatus;
use crate::interrupt;
use crate::show::output;
use crate::show::progress::Bar;
use crate::show::video::Video;

/// The camera is placed by every second state, which is enough to show all motions.
const FIT_STRIDE: usize = 2;

/// Plans a film, says what it shows, and places the cameras for it.
fn film(
    renderer: &mut FrameRenderer,
    trajectory: &StateTrajectory,
    event: Option<Event>,
    job: &Job<'_>,
) -> Film {
    let StateTrajectory { states, control_dt, .. } = trajectory;
    let last = states.len() - 1;
    let speed = job.command.speed.unwrap_or(1.0);
    let film = Film::new(*control_dt, last, event.as_ref(), job.settings.render.around, speed);
    let (first, end) = film.window;
    if film.window != (0, last) {
        output::message(&format!(
            "the video shows {} to {}",
            instant(first, *control_dt),
            instant(end, *control_dt)
        ));
    }
    renderer.fit(&states[first..=end].iter().step_by(FIT_STRIDE).map(Vec::as_slice));
    film
}

/// Renders an animated PNG. Its number of colors and its size are small.
pub fn animation(
    renderer: &mut FrameRenderer,
    trajectory: &StateTrajectory,
    event: Option<Event>,
    job: &Job<'_>,
) -> Result<ExitStatus> {
    let film = film(renderer, trajectory, event, job);
    let delay = 1000.0 / film.rate;
    let mut frames = Vec::new();
    // A held sample is one frame.
    for held in film.samples.chunk_by(|sample, next| sample == next) {
        let shown = (delay * held.len() as f64).round() as u16;
        frames.push((renderer.draw(held[0], &trajectory.states[held[0]])?, shown));
    }
    output::write_atomically(job.out, job.command.force, &animated_png(&frames)?)?;
    Ok(ExitStatus::Done)
}

/// Renders a video.
pub fn video(
    renderer: &mut FrameRenderer,
    trajectory: &StateTrajectory,
    event: Option<Event>,
    job: &Job<'_>,
) -> Result<ExitStatus> {
    let film = film(renderer, trajectory, event, job);
    let states = &trajectory.states;
    // From here on a signal must not end the program directly, because an unfinished file must be
    // removed.
    let bar = Bar::new(film.samples.len() as u64, "frames");
    let cleared = bar.line();
    interrupt::listen(|| (), move || cleared.finish_and_clear())?;
    let file = output::create(job.out, job.command.force)?;
    let mut video = Video::start(file, renderer.frame_size(), film.rate)?;
    let mut drawn: Option<(usize, Picture)> = None;
    for (done, sample) in (1..).zip(&film.samples) {
        if interrupt::requested() {
            return Ok(ExitStatus::Interrupted);
        }
        // A held sample is drawn once.
        let picture = match drawn.take() {
            Some((known, picture)) if known == *sample => picture,
            _ => renderer.draw(*sample, &states[*sample])?,
        };
        if video.push_frame(picture.pixels())?.is_break() {
            return Ok(ExitStatus::Interrupted);
        }
        drawn = Some((*sample, picture));
        bar.set_position(done);
    }
    let finished = video.finish()?;
    bar.clear();
    Ok(if finished.is_break() { ExitStatus::Interrupted } else { ExitStatus::Done })
}
