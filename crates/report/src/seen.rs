//! The images that a policy saw in a failure, beside those of the same simulation at nominal, and
//! the patches of an image on which its action depends.

use mishandle::inspect::Explanation;
use mishandle::picture::{PatchChanges, PolicyView, policy_views};
use mishandle::resolve::ResolvedPlan;
use mishandle::rollout::{Image, Request};
use mishandle::stl::is_violated;
use mishandle::store::RunHeader;
use mishandle::world::png;
use mishandle_text::decimal;

use crate::html::{base64, text};
use crate::pictures::{PictureError, strip_samples};

/// Width of an image on the page, pixels: each pixel of a small image is a square.
const WIDTH: usize = 160;

/// Color of a patch that changes the action most, and how much it covers the image.
const HEAT: [f64; 3] = [224.0, 74.0, 0.0];
const MOST: f64 = 0.8;

/// The images that a policy saw in a simulation.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    cameras: Vec<Camera>,
    /// Robustness of the same simulation at nominal, if other axes than starts are varied.
    nominal: Option<Option<f64>>,
    /// Norm of the action at the decisive instant.
    action: Option<f64>,
    /// Control step of the decisive instant.
    decisive: usize,
}

/// The images of a camera.
#[derive(Clone, Debug)]
struct Camera {
    image: Image,
    instants: Vec<Instant>,
    heat: Option<Heat>,
}

/// The images of one control step.
#[derive(Clone, Debug)]
struct Instant {
    step: usize,
    saw: Vec<u8>,
    /// The image at nominal, and the difference; `None` after the end of that simulation.
    nominal: Option<[Vec<u8>; 2]>,
}

/// The change of the action by covered patches.
#[derive(Clone, Debug)]
struct Heat {
    png: Vec<u8>,
    patches: [usize; 2],
    /// The largest change.
    most: f64,
}

/// Simulates a failure and its counterpart at nominal, and draws what the policy saw. `None` if it
/// sees nothing.
pub fn seen(
    resolved: &ResolvedPlan,
    request: &Request,
    explanation: &Explanation,
) -> Result<Option<Seen>, PictureError> {
    let Some((view, nominal)) = policy_views(resolved, request)? else { return Ok(None) };
    let Some(last) = view.steps().checked_sub(1) else { return Ok(None) };
    let event = explanation.event();
    // The policy acts in all samples but the last one.
    let mut steps: Vec<usize> =
        strip_samples(event.as_ref(), last + 1).into_iter().map(|sample| sample.min(last)).collect();
    steps.dedup();
    let decisive = event.map_or(last, |event| event.sample.min(last));
    let occlusion = view.occlusion(decisive);
    let camera = |(index, image): (usize, &Image)| -> Result<Camera, PictureError> {
        let instant = |step: &usize| instant(&view, nominal.as_ref(), index, *step);
        let changes = occlusion.as_ref().map(|occlusion| &occlusion.images[index]);
        let heat = changes.map(|changes| heat(image, view.image(index, decisive), changes)).transpose()?;
        let instants = steps.iter().map(instant).collect::<Result<_, _>>()?;
        Ok(Camera { image: image.clone(), instants, heat })
    };
    Ok(Some(Seen {
        cameras: view.images.iter().enumerate().map(camera).collect::<Result<_, _>>()?,
        nominal: nominal.as_ref().map(|nominal| nominal.episode.robustness()),
        action: occlusion.as_ref().map(|occlusion| occlusion.action),
        decisive,
    }))
}

fn instant(
    view: &PolicyView,
    nominal: Option<&PolicyView>,
    index: usize,
    step: usize,
) -> Result<Instant, PictureError> {
    let image = &view.images[index];
    let saw = view.image(index, step);
    let nominal = nominal.filter(|nominal| step < nominal.steps()).map(|nominal| {
        let usual = nominal.image(index, step);
        let difference: Vec<u8> = saw.iter().zip(usual).map(|(a, b)| difference(*a, *b)).collect();
        Ok::<_, PictureError>([encoded(image, usual)?, encoded(image, &difference)?])
    });
    Ok(Instant { step, saw: encoded(image, saw)?, nominal: nominal.transpose()? })
}

/// Returns half the difference of two bytes around middle gray.
fn difference(a: u8, b: u8) -> u8 {
    (128 + (i16::from(a) - i16::from(b)) / 2).clamp(0, 255) as u8
}

fn encoded(image: &Image, rgb: &[u8]) -> Result<Vec<u8>, PictureError> {
    Ok(png(image.width as u32, image.height as u32, rgb)?)
}

fn heat(image: &Image, rgb: &[u8], found: &PatchChanges) -> Result<Heat, PictureError> {
    let most = found.changes.iter().copied().fold(0.0, f64::max);
    let png = encoded(image, &heat_map(image, rgb, found, most))?;
    Ok(Heat { png, patches: found.patches, most })
}

/// Draws the changes over a gray image; `most` is the largest one.
fn heat_map(image: &Image, rgb: &[u8], found: &PatchChanges, most: f64) -> Vec<u8> {
    let PatchChanges { patches: [across, down], changes } = found;
    // The patch that covers a pixel: the last one that begins at it or before.
    let patch = |at: usize, count: usize, side: usize| ((at + 1) * count - 1) / side;
    let pixel = |index: usize| {
        let x = index % image.width;
        let y = index / image.width;
        let change = changes[patch(y, *down, image.height) * across + patch(x, *across, image.width)];
        let share = if most > 0.0 { MOST * change / most } else { 0.0 };
        let [red, green, blue] = [0, 1, 2].map(|channel| f64::from(rgb[3 * index + channel]));
        let gray = 0.299 * red + 0.587 * green + 0.114 * blue;
        HEAT.map(|heat| ((1.0 - share) * gray + share * heat).round() as u8)
    };
    (0..image.width * image.height).flat_map(pixel).collect()
}

impl Seen {
    /// Returns the images as HTML.
    pub fn html(&self, header: &RunHeader) -> String {
        let time = |step: usize| format!("{:.2} s", step as f64 * header.control_dt);
        let cameras: String = self.cameras.iter().map(|camera| self.camera(camera, &time)).collect();
        let rows = match self.nominal {
            Some(robustness) => format!(
                " Second row: the same start and seed with all other axes at nominal, which {}. Third row: half the difference of \
                 the two, where gray is none. As soon as the policy acts differently, it also sees another motion.",
                verdict(robustness)
            ),
            None => String::new(),
        };
        let occlusion =
            self.action.map_or(String::new(), |action| self.occlusion(&time(self.decisive), action));
        format!(
            "<p class=\"notes\">First row: what the policy saw in this simulation.{rows}</p>\n{cameras}{occlusion}"
        )
    }

    fn camera(&self, camera: &Camera, time: &impl Fn(usize) -> String) -> String {
        let name = text(&camera.image.camera);
        let Image { width, height, .. } = camera.image;
        let picture = |png: &[u8], what: &str| {
            format!(
                "<img src=\"data:image/png;base64,{}\" width=\"{WIDTH}\" height=\"{}\" alt=\"{what}\">",
                base64(png),
                WIDTH * height / width
            )
        };
        let figure = |instant: &Instant| {
            let is_decisive = instant.step == self.decisive;
            let note = if is_decisive { ", decisive instant" } else { "" };
            let at = format!("{}{note}", time(instant.step));
            let mut images = picture(&instant.saw, &format!("What the policy saw through {name} at {at}"));
            if let Some([usual, difference]) = &instant.nominal {
                images += &picture(usual, &format!("The same at nominal, {at}"));
                images += &picture(difference, &format!("The difference, {at}"));
            }
            format!(
                "<figure class=\"frame{}\">{images}<figcaption>{at}</figcaption></figure>",
                if is_decisive { " decisive" } else { "" }
            )
        };
        let figures: String = camera.instants.iter().map(figure).collect();
        let heat = camera.heat.as_ref().map_or(String::new(), |heat| {
            let what = format!("occlusion at {}", time(self.decisive));
            format!(
                "<figure class=\"frame\">{}<figcaption>{what}</figcaption></figure>",
                picture(&heat.png, &format!("How much covered patches of {name} change the action, {what}"))
            )
        });
        format!(
            "<p class=\"notes\">Through <code>{name}</code>, {width} x {height} pixels:</p>\n<div class=\"strip \
             seen\">{figures}{heat}</div>\n"
        )
    }

    /// Says what the maps of occlusion show and what they do not.
    fn occlusion(&self, time: &str, action: f64) -> String {
        let camera = |camera: &Camera| {
            let heat = camera.heat.as_ref()?;
            let [across, down] = heat.patches;
            let name = text(&camera.image.camera);
            let most = decimal(heat.most, 4);
            Some(format!("up to {most} through <code>{name}</code> ({across} x {down} patches)"))
        };
        let cameras: Vec<String> = self.cameras.iter().filter_map(camera).collect();
        format!(
            "<p class=\"notes\">Occlusion at {time}: the policy was queried again with each patch of an image covered \
             by the mean color of the image. The more orange a patch, the more the action changes (Euclidean norm): {}. The \
             norm of the action itself is {}. The map shows which pixels this one action depends on. It does not show what the \
             policy recognizes there or why the simulation fails: other actions count as well, the policy never saw a covered \
             patch in its training, and two patches with the same information hide each other.</p>\n",
            cameras.join(", "),
            decimal(action, 4)
        )
    }
}

/// Describes the verdict of the simulation at nominal.
fn verdict(robustness: Option<f64>) -> String {
    match robustness {
        None => "has no verdict".to_string(),
        Some(robustness) => {
            let verb = if is_violated(robustness) { "violates" } else { "satisfies" };
            format!("{verb} the formula (robustness {})", decimal(robustness, 4))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_images_are_middle_gray_and_the_difference_has_a_sign() {
        assert_eq!([difference(7, 7), difference(255, 0), difference(0, 255)], [128, 255, 1]);
    }

    #[test]
    fn the_patch_that_changes_the_action_is_orange_and_the_others_stay_gray() {
        let image = Image { camera: "over".to_string(), width: 5, height: 4 };
        let changes = PatchChanges { patches: [2, 2], changes: vec![0.0, 0.5, 0.0, 0.0] };
        let pixels = heat_map(&image, &[100; 60], &changes, 0.5);
        for (index, pixel) in pixels.chunks_exact(3).enumerate() {
            // Patches of 5 pixels begin at 0 and at 5 / 2 = 2, those of 4 at 0 and 2.
            let is_covered = index % 5 >= 2 && index / 5 < 2;
            assert_eq!(is_covered, pixel[0] != pixel[2], "{index}: {pixel:?}");
        }
    }
}
