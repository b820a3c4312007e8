//! The cloth's part of the MJCF document: a square grid of point masses.
//!
//! Each point mass is a body with three slide joints along the world axes and a small sphere that
//! collides with table, ground and fingers (bits 4 and 16 of `panda.xml`). A flex connects the
//! masses. Its edges (rows, columns and one diagonal per cell) are equality constraints.
//!
//! The benchmark has a grid of 11 x 11. A grid of 7 x 7 takes less than half the time: a control
//! step of the expert's episodes took 1.37 ms and 0.63 ms of CPU time in total, which is 728 and
//! 1,594 control steps per second and core on a loaded machine. From the same 1,000 initial states
//! (`evaluate TASK --controller expert --episodes 1000 --seed 1`) the expert satisfies the success
//! formula from all of them on both grids, and the strict formula from 98.0 % on 11 x 11 and 90.4 %
//! on 7 x 7. The coarse folds of 7 x 7 stand up and keep moving, and a finger slips between its
//! vertices. The success outcome is the same for 100.0 % of the initial states and the strict
//! outcome for 90.8 %, close to the value for independent failures. So 7 x 7 is for experiments;
//! train and evaluate on 11 x 11.
//!
//! The first table compares alternatives (measured at 51c0ab8, with softer contacts): one scripted
//! placement at 11 x 11, including the arm. `us` is the CPU time of a physics step with the cloth
//! at rest on the table, on a machine with two loaded cores (the arm alone took 8 us there, and 6
//! to 8 us on an idle core). `steps/s` is the number of control steps per second at this cost.
//!
//! | model | us | steps/s | largest stretch | rest after |
//! |---|--:|--:|--:|--:|
//! | CG, tolerance 1e-5, 4 substeps | 310 | 805 | 17 % | 0.35 s |
//! | CG, MuJoCo's tolerance of 1e-8 | 393 | 637 | 17 % | 2.1 s |
//! | CG, at most 10 iterations | 316 | 791 | 25 % | 3.2 s |
//! | Newton (MuJoCo's default), sparse Jacobian | 551 | 453 | 17 % | 2.7 s |
//! | Newton, dense Jacobian | 3329 | 75 | 17 % | 2.7 s |
//! | Newton, elliptic cone | 698 | 358 | 17 % | 0.4 s |
//! | Euler's integrator | 613 | 408 | 16 % | 0.3 s |
//! | the integrator `discrete` | 276 | 907 | 37 % | 0.6 s |
//! | 2 substeps, edges half as fast | 360 | 1387 | 30 % | 0.3 s |
//! | 8 substeps, edges twice as fast | 316 | 395 | 6 % | 1.0 s |
//! | edges of impedance 0.9 | 302 | 827 | 16 % | 2.0 s |
//! | edges of impedance 0.99 | 376 | 666 | 17 % | 0.5 s |
//! | vertices touch each other | 277 | 903 | 11 % | 0.4 s |
//! | the flex's triangles touch the table, not spheres | 709 | 353 | 17 % | 0.6 s |
//!
//! In all of them the whole cloth ends over the table, 1 to 4 cm from its center. The folding of a
//! limp cloth is chaotic, so rest times and stretches of single runs vary; the costs do not. Edges
//! with a time constant below two physics steps diverge.
//!
//! The present model takes half the time of six substeps with edges of impedance 0.95, damping
//! ratio 1 and CG at a tolerance of 1e-5 (below: A), and its edges stretch less. Edges of a lower
//! impedance make the constraints better conditioned, so CG needs fewer iterations, and a lower
//! damping ratio makes them stiffer in return. The table replays the controls of 28 episodes of the
//! expert, `ppo`, `ppo-2` and `td3`. The three numbers are the median, the 90 % quantile and the
//! largest value over the episodes of the largest value of an episode. Depth is that of a vertex in
//! table or ground after 50 ms of contact, and impact is that in all contacts.
//!
//! | model | iterations | stretch, % | depth, mm | impact, mm |
//! |---|--:|--:|--:|--:|
//! | A, 6 substeps | 26.7 | 23, 39, 55 | 2.3, 6.3, 10.9 | 5.4, 10.0, 13.5 |
//! | present (4 substeps, 0.85, ratio 0.6) | 17.6 | 15, 38, 61 | 1.0, 6.2, 8.3 | 5.6, 9.9, 14.9 |
//! | impedance 0.75 | 14.3 | 17, 31, 43 | 0.7, 5.3, 9.8 | 5.9, 10.6, 13.3 |
//! | 3 substeps, time constant 11.12 ms | 16.2 | 18, 35, 51 | 1.1, 3.9, 7.8 | 7.9, 10.3, 13.6 |
//!
//! At rest, impedance 0.75 and three substeps let the upper edges of a hanging cloth sag by 6 %
//! instead of less than 5 %, and with three an edge of an episode of the expert stretches by 56 %.
//! CG that stops after 16 iterations diverges.

use std::fmt::Write;

/// Side of the cloth, m.
const SIDE: f64 = 0.3;

/// Mass of the cloth, kg.
const MASS: f64 = 0.605;

/// Initial center of the cloth, m. The cloth is in the plane y = 0.
pub(super) const CENTER: [f64; 3] = [0.5, 0.0, 0.65];

/// Initial position of the closed fingertips in the plane of the cloth: x and z, m.
const TIPS: [f64; 2] = [0.449, 0.7155];

/// Amplitude of the initial waves of the cloth, m. An exactly flat sheet never folds, because no
/// force pushes it out of its plane.
const WAVE: f64 = 2e-4;

/// A square grid of vertices, with rows from bottom to top and columns along x.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sheet {
    /// Number of vertices along a side.
    pub vertices: usize,
}

impl Sheet {
    fn spacing(self) -> f64 {
        SIDE / (self.vertices - 1) as f64
    }

    /// Returns the column and row of the lower left corner of the cell between the fingertips.
    fn pinched_cell(self) -> [usize; 2] {
        [0, 1].map(|axis| {
            let corner = [CENTER[0], CENTER[2]][axis] - 0.5 * SIDE;
            ((TIPS[axis] - corner) / self.spacing()) as usize
        })
    }

    /// Returns the columns and rows of the vertices that the fingers hold: the corners of the cell
    /// between the fingertips.
    fn pinched(self) -> [[usize; 2]; 4] {
        let [i, j] = self.pinched_cell();
        [[i, j], [i + 1, j], [i, j + 1], [i + 1, j + 1]]
    }

    /// Returns the position of a vertex relative to the cloth's center, m.
    fn offset(self, [i, j]: [usize; 2]) -> [f64; 3] {
        let along = |k: usize| k as f64 * self.spacing() - 0.5 * SIDE;
        let x = along(i);
        let z = along(j);
        // The waves are oblique, so that the folds are not symmetric.
        let phase = std::f64::consts::TAU * (x + 0.6 * z) / SIDE;
        [x, WAVE * phase.sin(), z]
    }

    fn name([i, j]: [usize; 2]) -> String {
        format!("cloth_{i}_{j}")
    }

    /// Iterates over columns and rows, columns first.
    fn places(self) -> impl Iterator<Item = [usize; 2]> {
        (0..self.vertices).flat_map(move |j| (0..self.vertices).map(move |i| [i, j]))
    }

    /// Inserts the cloth into the document of the scene.
    pub fn fill(self, scene: &str) -> String {
        let mut pinch = String::new();
        let mut vertices = String::new();
        let pinched = self.pinched();
        for place in self.places() {
            let _ = writeln!(vertices, "{}", self.vertex(place, pinched.contains(&place)));
        }
        for (corner, place) in pinched.iter().enumerate() {
            let name = Sheet::name(*place);
            let _ = writeln!(
                pinch,
                "<connect class=\"cloth\" name=\"pinch_{corner}\" site1=\"pinch_{corner}\" site2=\"{name}\"/>"
            );
        }
        let bodies: Vec<String> = self.places().map(Sheet::name).collect();
        scene
            .replacen("<!-- vertices -->", &vertices, 1)
            .replacen("<!-- bodies -->", &bodies.join(" "), 1)
            .replacen("<!-- triangles -->", &self.triangles(), 1)
            .replacen("<!-- pinch -->", &pinch, 1)
    }

    fn vertex(self, place: [usize; 2], pinched: bool) -> String {
        let name = Sheet::name(place);
        let offset = self.offset(place);
        let [x, y, z] = [0, 1, 2].map(|axis| CENTER[axis] + offset[axis]);
        let mass = MASS / (self.vertices * self.vertices) as f64;
        // All vertices collide with table and ground (4). Only vertices below the fingertips
        // collide with the fingers (16): the part above them starts inside the hand, which no
        // vertex collides with, and would get caught on a finger when it folds over.
        let conaffinity = if place[1] < self.pinched_cell()[1] { 20 } else { 4 };
        let site = if pinched { format!("<site name=\"{name}\"/>") } else { String::new() };
        format!(
            "<body name=\"{name}\" pos=\"{x} {y} {z}\" childclass=\"cloth\"><joint axis=\"1 0 0\"/>\
             <joint axis=\"0 1 0\"/><joint axis=\"0 0 1\"/>\
             <geom mass=\"{mass}\" conaffinity=\"{conaffinity}\"/>{site}</body>"
        )
    }

    /// Returns the vertex indices of two triangles per cell. The direction of the diagonals
    /// alternates, so that the cloth is isotropic.
    fn triangles(self) -> String {
        let mut out = String::new();
        let last = self.vertices - 1;
        for (j, i) in (0..last).flat_map(|j| (0..last).map(move |i| (j, i))) {
            let a = j * self.vertices + i;
            let b = a + 1;
            let c = a + self.vertices;
            let d = a + self.vertices + 1;
            let cell = if (i + j) % 2 == 0 { [a, b, d, a, d, c] } else { [a, b, c, b, d, c] };
            cell.iter().for_each(|vertex| {
                let _ = write!(out, "{vertex} ");
            });
        }
        out
    }

    /// Returns the MJCF of the hand's sites that hold the cloth, in a frame at the cloth's center.
    pub fn pinch(self) -> String {
        let sites = self.pinched().into_iter().enumerate().map(|(corner, place)| {
            let [x, y, z] = self.offset(place);
            format!("<site name=\"pinch_{corner}\" pos=\"{x} {y} {z}\" group=\"4\" size=\"0.004\"/>")
        });
        format!("<body>{}</body>", sites.collect::<String>())
    }
}
