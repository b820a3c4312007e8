use std::path::Path;

use anyhow::{Result, bail, ensure};
use mishandle::Film;
use mishandle::store::RunFile;
use mishandle::world::{Renderer, Size, png};

use crate::progress::Bar;
use crate::video::{self, Video};
use crate::{ExitStatus, args, interrupt, output};

/// Pictures a second in a film, nearly: whole control steps lie between two.
const FILM_RATE: f64 = 30.0;

/// Pictures in a filmstrip, and how many stand side by side.
const STRIP: usize = 6;
const STRIP_COLUMNS: usize = 3;

const PICTURE_SIZE: (u32, u32) = (960, 720);
const FILM_SIZE: (u32, u32) = (640, 480);
const STRIP_SIZE: (u32, u32) = (480, 360);

/// What the output's name asks for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Png,
    Mp4,
}

pub fn run(command: &args::Render) -> Result<ExitStatus> {
    let kind = kind(&command.out)?;
    if command.run.is_none() && command.task.is_some() {
        ensure!(
            kind == Kind::Png,
            "a start is one picture; --out has to end in .png, or give a --run to film"
        );
    }
    let default = match (kind, &command.run) {
        (Kind::Png, None) => PICTURE_SIZE,
        (Kind::Png, Some(_)) => STRIP_SIZE,
        (Kind::Mp4, _) => FILM_SIZE,
    };
    let size = size(command.size.as_deref(), default)?;
    // Whether it can be made is known before a simulation has run for it.
    drop(output::create(&command.out, command.force)?);
    if kind == Kind::Mp4 {
        video::check_encoder()?;
    }
    let (mut renderer, film) = match (&command.run, &command.task) {
        (Some(path), _) => recorded(path, command, size)?,
        (None, Some(task)) => {
            let task = mishandle::task(task)?;
            let film = mishandle::start(task, command.at.as_deref())?;
            (Renderer::new(&mishandle::scene(task)?, size)?, film)
        }
        (None, None) => bail!("give a TASK, or --run RUN"),
    };
    let outcome = match kind {
        Kind::Png => strip(&mut renderer, &film, size, command)?,
        Kind::Mp4 => video(&mut renderer, &film, size, command)?,
    };
    match outcome {
        ExitStatus::Interrupted => output::say("interrupted; nothing was written"),
        _ => output::say(&format!("wrote {}", command.out.display())),
    }
    Ok(outcome)
}

fn kind(out: &Path) -> Result<Kind> {
    match out.extension().and_then(|extension| extension.to_str()) {
        Some("png") => Ok(Kind::Png),
        Some("mp4") => Ok(Kind::Mp4),
        _ => bail!("--out is {}; it has to end in .png (a picture) or .mp4 (a film)", out.display()),
    }
}

/// The size that a text like `960x720` asks for.
fn size(text: Option<&str>, default: (u32, u32)) -> Result<Size> {
    let (width, height) = match text {
        None => default,
        Some(text) => text
            .split_once('x')
            .and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)))
            .unwrap_or((0, 0)),
    };
    let (low, high) = (Size::RANGE.start(), Size::RANGE.end());
    match Size::new(width, height) {
        Some(size) => Ok(size),
        None => bail!(
            "--size is {}; it has to be WIDTHxHEIGHT in pixels, like 960x720, both even and from {low} to {high}",
            text.unwrap_or_default()
        ),
    }
}

/// A recorded simulation, run again.
fn recorded(path: &Path, command: &args::Render, size: Size) -> Result<(Renderer, Film)> {
    let run = RunFile::open(path)?;
    let Some((trial, simulation)) = mishandle::choose(&run, command.trial, command.simulation)? else {
        bail!("{} has no decided simulation to draw", path.display());
    };
    let renderer = Renderer::new(&mishandle::scene(mishandle::task(&run.header().target.name)?)?, size)?;
    let (replayed, film) = mishandle::film(&run, trial, simulation, command.controller.as_deref())?;
    for difference in &replayed.other_build {
        output::say(&format!("warning: the run was made by another build: {difference}"));
    }
    if !replayed.differences.is_empty() {
        bail!("the replay is not the same as the record: {}", replayed.differences.join("; "));
    }
    output::say(&format!("trial {trial}, simulation {simulation}: {} control steps", replayed.episode.steps));
    Ok((renderer, film))
}

/// One picture, or several moments of an episode beside and below each other.
fn strip(renderer: &mut Renderer, film: &Film, size: Size, command: &args::Render) -> Result<ExitStatus> {
    let last = film.states.len() - 1;
    let count = film.states.len().min(STRIP);
    let moments: Vec<usize> = (0..count).map(|i| last * i / (count - 1).max(1)).collect();
    renderer.frame(moments.iter().map(|moment| film.states[*moment].as_slice()));
    let columns = count.min(STRIP_COLUMNS);
    let (width, height) = (size.width() as usize, size.height() as usize);
    let (whole_width, whole_height) = (columns * width, count.div_ceil(columns) * height);
    let mut whole = vec![255_u8; 3 * whole_width * whole_height];
    for (i, moment) in moments.iter().enumerate() {
        let (left, top) = (i % columns * width, i / columns * height);
        let picture = renderer.draw(&film.states[*moment])?;
        for (row, pixels) in picture.chunks(3 * width).enumerate() {
            whole[3 * ((top + row) * whole_width + left)..][..3 * width].copy_from_slice(pixels);
        }
    }
    if count > 1 {
        let times: Vec<String> =
            moments.iter().map(|step| format!("{:.2} s", *step as f64 * film.control_dt)).collect();
        output::say(&format!("at {}, row by row", times.join(", ")));
    }
    let bytes = png(whole_width as u32, whole_height as u32, &whole)?;
    output::write_atomically(&command.out, command.force, &bytes)?;
    Ok(ExitStatus::Done)
}

fn video(renderer: &mut Renderer, film: &Film, size: Size, command: &args::Render) -> Result<ExitStatus> {
    let stride = (1.0 / (FILM_RATE * film.control_dt)).round().max(1.0) as usize;
    let rate = 1.0 / (stride as f64 * film.control_dt);
    renderer.frame(film.states.iter().step_by(stride).map(Vec::as_slice));
    // From here on there is a file to take away, so a signal must not end the program by itself.
    let bar = Bar::new(film.states.len().div_ceil(stride) as u64, "pictures");
    let cleared = bar.line();
    interrupt::listen(|| (), move || cleared.finish_and_clear())?;
    let mut video = Video::begin(output::create(&command.out, command.force)?, size, rate)?;
    for (done, state) in (1..).zip(film.states.iter().step_by(stride)) {
        if interrupt::asked() {
            return Ok(ExitStatus::Interrupted);
        }
        video.push(renderer.draw(state)?)?;
        bar.set_position(done);
    }
    bar.clear();
    video.end()?;
    Ok(ExitStatus::Done)
}
