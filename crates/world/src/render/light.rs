//! Lights, sky and ground of a scene.

use std::sync::Arc;

use super::Quality;
use super::stage::{self, FOVY_DEG};
use super::view::Surroundings;
use crate::{Model, with_elements};

/// Number of lights of a fine picture, and radius of the disk of their directions, rad. OpenGL has
/// eight lights; the camera has one of them. Each light costs as much as half a picture with one.
const LIGHTS: usize = 4;
const LIGHT_RADIUS: f64 = 0.025;

/// Horizontal direction of the light per meter of fall, and the point of the ground on its axis, m.
const LIGHT_SLOPE: [f64; 2] = [-0.35, 0.3];
const LIT_POINT: [f64; 2] = [0.345, 0.09];

/// Height of the lights, m.
const LIGHT_HEIGHT: f64 = 3.3;

fn light_count(quality: Quality) -> usize {
    if quality == Quality::Fine { LIGHTS } else { 1 }
}

/// Returns lights with these slopes that together are as bright as one light. Their shadows
/// overlap, and the edges fade. `scale` is the size of the scene, 1 for an arm.
fn lights(quality: Quality, scale: f64) -> String {
    let count = light_count(quality);
    let height = scale * LIGHT_HEIGHT;
    let light = |i: usize| {
        // Points of a spiral that cover a disk evenly (Vogel, 1979).
        let turn = std::f64::consts::PI * (3.0 - 5_f64.sqrt()) * i as f64;
        let radius = match count {
            1 => 0.0,
            _ => LIGHT_RADIUS * ((i as f64 + 0.5) / count as f64).sqrt(),
        };
        let slope = [LIGHT_SLOPE[0] + radius * turn.cos(), LIGHT_SLOPE[1] + radius * turn.sin()];
        let [x, y] = [0, 1].map(|axis| LIT_POINT[axis] - height * slope[axis]);
        let diffuse = 0.5 / count as f64;
        let specular = 0.15 / count as f64;
        format!(
            r#"<light directional="true" pos="{x:.6} {y:.6} {height}" dir="{:.6} {:.6} -1" diffuse="{diffuse} {diffuse} {diffuse}" specular="{specular} {specular} {specular}"/>
  "#,
            slope[0], slope[1],
        )
    };
    (0..count).map(light).collect()
}

/// Adds lights, a sky, a frame buffer for this image size and, if missing, a ground plane to the
/// document of the model `bare`.
pub(super) fn with_lights(
    bare: &Model,
    [width, height]: [u32; 2],
    quality: Quality,
    surroundings: &Surroundings,
) -> String {
    let size = surroundings.scale();
    // The area of the shadows around the lit point, m (ground outside of it has stripes), and the
    // size of their map, pixels.
    let shadow_radius = 3.2 * size;
    let scale = if quality == Quality::Fine { 2 } else { 3 };
    let shadow_size = (scale * width.max(height)).next_power_of_two().clamp(256, 4096);
    let ground = stage::ground(bare, surroundings).map_or_else(String::new, |ground| {
        let [x, y, z] = ground.position;
let [across, along, step] = ground.size;
let [red, green, blue, _] = ground.color;
        format!(
            r#"<geom type="plane" pos="{x} {y} {z}" size="{across} {along} {step}" contype="0" conaffinity="0" rgba="{red} {green} {blue} 1"/>"#
        )
    });
    let additions = format!(
        r#"
<visual>
  <global offwidth="{width}" offheight="{height}" fovy="{FOVY_DEG}"/>
  <headlight ambient="0.42 0.42 0.42" diffuse="0.28 0.28 0.28" specular="0.05 0.05 0.05"/>
  <quality shadowsize="{shadow_size}" offsamples="4"/>
  <map znear="0.05" zfar="{}" shadowclip="{shadow_radius}"/>
</visual>
<statistic extent="1"/>
<asset>
  <texture type="skybox" builtin="gradient" rgb1="0.94 0.96 0.98" rgb2="1 1 1" width="64" height="384"/>
</asset>
<worldbody>
  {}{ground}
</worldbody>
"#,
        12.0 * size,
        lights(quality, size),
    );
    with_elements(bare.document(), &additions)
}

/// Switches all lights off that the model had before [`with_lights`]: pictures of all scenes are
/// equally bright, and OpenGL has a few lights only.
pub(super) fn without_others(lit: Model, bare: &Model, quality: Quality) -> Model {
    if bare.inner.nlight() == 0 {
        return lit;
    }
    // Lights are sorted by their bodies, so the new ones are the last ones of the world.
    let first = bare.inner.light_bodyid().iter().filter(|body| **body == 0).count();
    let own = first..first + light_count(quality);
    let mut inner = (*lit.inner).clone();
    for (index, is_active) in inner.light_active_mut().iter_mut().enumerate() {
        *is_active = own.contains(&index);
    }
    Model { inner: Arc::new(inner), ..lit }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_lights_of_a_scene_are_replaced() {
        let lamp = r#"<light pos="0 0 3"/>"#;
        for (own, on_body) in [("", ""), (lamp, ""), ("", lamp), (lamp, lamp)] {
            let document = format!(
                r#"<mujoco><worldbody>{own}<body><joint/><geom size="1"/>{on_body}</body></worldbody></mujoco>
                <!-- the end of </mujoco> is not the end of the file -->"#
            );
            let bare = Model::from_xml(&document).unwrap();
            let lit = with_lights(&bare, [64, 64], Quality::Fine, &Surroundings::new(&bare));
            let lit = without_others(Model::from_xml(&lit).unwrap(), &bare, Quality::Fine);
            let lights = lit.inner.light_active().iter().zip(lit.inner.light_diffuse());
            let active: Vec<[f32; 3]> =
                lights.filter(|(active, _)| **active).map(|(_, color)| *color).collect();
            assert_eq!(active, [[0.125; 3]; 4]);
        }
    }

    #[test]
    fn the_lights_of_a_fine_picture_are_together_as_bright_as_one() {
        let one = lights(Quality::Fast, 1.0);
        assert!(
            one.contains(r#"pos="1.500000 -0.900000 3.3" dir="-0.350000 0.300000 -1" diffuse="0.5 0.5 0.5""#),
            "{one}"
        );
        let several = lights(Quality::Fine, 1.0);
        assert_eq!(several.matches("<light").count(), 4);
        assert_eq!(several.matches(r#"diffuse="0.125 0.125 0.125""#).count(), 4);
    }
}
