//! Fixed points of a disk and of a pixel, over which rays are spread.

/// The reciprocals of the plastic number and of its square: steps of a sequence that fills a square
/// evenly.
///
/// # Reference
/// Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018.
const STEPS: [f32; 2] = [0.754_877_7, 0.569_840_3];

/// Returns point `index` of a square from -1 to 1.
fn square(index: u32) -> [f32; 2] {
    STEPS.map(|step| {
        let value = 0.5 + step * (index + 1) as f32;
        2.0 * (value - value.floor()) - 1.0
    })
}

/// Returns point `index` of `count` points of a pixel, from -0.5 to 0.5. A single point is its
/// center.
pub(crate) fn pixel_point(index: u32, count: u32) -> [f32; 2] {
    if count <= 1 { [0.0; 2] } else { square(index).map(|v| 0.5 * v) }
}

/// Writes `count` points of a disk with radius 1, in pairs around its center. A single point is the
/// center.
pub(crate) fn disk_points(count: u32, out: &mut Vec<[f32; 2]>) {
    out.clear();
    if count <= 1 {
        out.push([0.0; 2]);
        return;
    }
    let mut index = 0;
    while out.len() < count as usize {
        let [x, y] = square(index);
        index += 1;
        if x * x + y * y <= 1.0 {
            out.extend([[x, y], [-x, -y]]);
        }
    }
    out.truncate(count as usize);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_disk_cover_it_evenly_around_its_center() {
        let mut points = Vec::new();
        disk_points(1, &mut points);
        assert_eq!(points, [[0.0; 2]]);
        disk_points(256, &mut points);
        let mean = |f: &dyn Fn(&[f32; 2]) -> f32| points.iter().map(f).sum::<f32>() / points.len() as f32;
        assert_eq!(points.len(), 256);
        assert!(mean(&|p| p[0]).abs() < 1e-6 && mean(&|p| p[1]).abs() < 1e-6);
        // The mean square of a coordinate of a disk is a quarter.
        assert!((mean(&|p| p[0] * p[0]) - 0.25).abs() < 0.01);
        assert!((mean(&|p| p[1] * p[1]) - 0.25).abs() < 0.01);
        assert!(points.iter().all(|[x, y]| x * x + y * y <= 1.0));
    }
}
