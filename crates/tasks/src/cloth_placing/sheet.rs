//! The cloth's part of the MJCF document: a square grid of point masses.
//!
//! The cloth is a square grid of point masses: bodies with three slides along the world's axes, each with a small sphere
//! that touches table, ground and fingers. A flex joins them to a sheet; its edges (rows, columns and one diagonal in
//! every cell) are equality constraints. Two sizes of grid share the task: 11 x 11 is the benchmark's, 7 x 7 is the
//! same cloth for less than half of the time: the expert's episodes took 1.37 ms and 0.63 ms of processor time a control
//! step, everything included, 728 and 1,594 control steps a second and core on a busy machine. From the same 1,000 starts
//! (`evaluate TASK --controller expert --episodes 1000 --seed 1`) the expert meets the success formula from every one on
//! both, the strict one from 98.0 % on 11 x 11 and 90.4 % on 7 x 7, whose coarse folds stand up and keep shifting, while
//! a finger slips between its vertices. 100.0 % end with the same success, 90.8 % with the same strict outcome, near
//! what independent failures would give. So 7 x 7 is for trying things; train and measure on 11 x 11.
//!
//! What each choice costs and gives, by `docs/cloth.py`: one scripted placing at 11 x 11, the arm included. `us` is
//! processor time for a physics step with the cloth at rest on the table, measured while other programs kept both cores
//! busy (the arm alone took 8 us then, 6 to 8 us on a quiet core); `steps/s` counts control steps at that cost.
//!
//! | model | us | steps/s | largest stretch | rest after |
//! |---|--:|--:|--:|--:|
//! | as it is: CG, tolerance 1e-5, 4 substeps | 310 | 805 | 17 % | 0.35 s |
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
//! In all of them the whole cloth ends over the table, 1 to 4 cm from its centre. How a limp cloth folds is chaotic, so
//! rest times and stretches of single runs scatter; the costs do not. Edges that answer in less than two physics steps
//! diverge, so a stiffer cloth needs more substeps: 4 of them are the fewest that keep every edge of the expert's
//! episodes within a fifth of its length.

use std::fmt::Write;

/// Side of the cloth, m.
const SIDE: f64 = 0.3;

/// Mass of the cloth, kg.
const MASS: f64 = 0.605;

/// Centre of the cloth at the start, m: it stands in the plane y = 0.
pub(super) const CENTRE: [f64; 3] = [0.5, 0.0, 0.65];

/// Where the finger tips meet at the start, in the plane of the cloth: x and z, m.
const TIPS: [f64; 2] = [0.449, 0.7155];

/// How far the cloth is from flat at the start, m. A sheet that is flat to the last bit never folds: nothing pushes it
/// out of its plane.
const WAVE: f64 = 2e-4;

/// A square grid of vertices: rows from below, columns along x.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sheet {
    /// Vertices along a side.
    pub vertices: usize,
}

impl Sheet {
    fn spacing(self) -> f64 {
        SIDE / (self.vertices - 1) as f64
    }

    /// The column and the row at the lower left of the cell that the finger tips pinch.
    fn pinched_cell(self) -> [usize; 2] {
        [0, 1].map(|axis| {
            let corner = [CENTRE[0], CENTRE[2]][axis] - 0.5 * SIDE;
            ((TIPS[axis] - corner) / self.spacing()) as usize
        })
    }

    /// Column and row of the vertices that the fingers hold: the corners of the cell that they pinch.
    fn pinched(self) -> [[usize; 2]; 4] {
        let [i, j] = self.pinched_cell();
        [[i, j], [i + 1, j], [i, j + 1], [i + 1, j + 1]]
    }

    /// Where a vertex is from the cloth's centre, m.
    fn offset(self, [i, j]: [usize; 2]) -> [f64; 3] {
        let along = |k: usize| k as f64 * self.spacing() - 0.5 * SIDE;
        let (x, z) = (along(i), along(j));
        // Waves that lie askew, so that no fold is the mirror image of another.
        let phase = std::f64::consts::TAU * (x + 0.6 * z) / SIDE;
        [x, WAVE * phase.sin(), z]
    }

    fn name([i, j]: [usize; 2]) -> String {
        format!("cloth_{i}_{j}")
    }

    /// Places, columns first.
    fn places(self) -> impl Iterator<Item = [usize; 2]> {
        (0..self.vertices).flat_map(move |j| (0..self.vertices).map(move |i| [i, j]))
    }

    /// The scene's document with the cloth in it.
    pub fn fill(self, scene: &str) -> String {
        let (mut pinch, mut vertices) = (String::new(), String::new());
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
        let [x, y, z] = [0, 1, 2].map(|axis| CENTRE[axis] + offset[axis]);
        let mass = MASS / (self.vertices * self.vertices) as f64;
        // Table and ground (8); the fingers (1) only from where they pinch downwards: a flap that falls over from
        // above the fingers would have to pass through the hand, which it does not touch, and hang on a finger.
        let conaffinity = if place[1] < self.pinched_cell()[1] { 9 } else { 8 };
        let site = if pinched { format!("<site name=\"{name}\"/>") } else { String::new() };
        format!(
            "<body name=\"{name}\" pos=\"{x} {y} {z}\" childclass=\"cloth\"><joint axis=\"1 0 0\"/>\
             <joint axis=\"0 1 0\"/><joint axis=\"0 0 1\"/>\
             <geom mass=\"{mass}\" conaffinity=\"{conaffinity}\"/>{site}</body>"
        )
    }

    /// Vertex numbers of two triangles in every cell, their diagonals turned from cell to cell, so that no direction
    /// is preferred.
    fn triangles(self) -> String {
        let mut out = String::new();
        let last = self.vertices - 1;
        for (j, i) in (0..last).flat_map(|j| (0..last).map(move |i| (j, i))) {
            let a = j * self.vertices + i;
            let (b, c, d) = (a + 1, a + self.vertices, a + self.vertices + 1);
            let cell = if (i + j) % 2 == 0 { [a, b, d, a, d, c] } else { [a, b, c, b, d, c] };
            cell.iter().for_each(|vertex| {
                let _ = write!(out, "{vertex} ");
            });
        }
        out
    }

    /// MJCF of the points of the hand that hold the cloth, in a frame at the cloth's centre.
    pub fn pinch(self) -> String {
        let sites = self.pinched().into_iter().enumerate().map(|(corner, place)| {
            let [x, y, z] = self.offset(place);
            format!("<site name=\"pinch_{corner}\" pos=\"{x} {y} {z}\" group=\"4\" size=\"0.004\"/>")
        });
        format!("<body>{}</body>", sites.collect::<String>())
    }
}
