//! Contact forces between the parts of a model.

use mujoco_rs::prelude::{MjtDisableBit, MjtObjBase};
use mujoco_rs::wrappers::mj_model::MjtGeomBase;

use crate::frame::{add, norm, scale};
use crate::{Body, Model, World};

/// The parts of a model between which contact forces are measured.
///
/// The bodies that were given as the robot are one part, with the name `robot`. Every other body is
/// a part with its own name, also one that the robot holds, and a body without a name belongs to
/// its parent. A flex is one part. Of what is fixed to the world, a plane is the part `ground` and
/// all else is the part `scene`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ContactParts {
    names: Vec<String>,
    /// Part of each geom and of each flex.
    geoms: Vec<usize>,
    flexes: Vec<usize>,
    pairs: Vec<[usize; 2]>,
}

impl ContactParts {
    /// Returns the names of the two parts of each pair that can collide.
    pub fn pairs(&self) -> impl ExactSizeIterator<Item = [&str; 2]> {
        self.pairs.iter().map(|pair| pair.map(|part| self.names[part].as_str()))
    }

    fn part(&mut self, name: &str) -> usize {
        if let Some(known) = self.names.iter().position(|known| known == name) {
            return known;
        }
        self.names.push(name.to_string());
        self.names.len() - 1
    }

    fn add_pair(&mut self, mut parts: [usize; 2]) {
        parts.sort_unstable();
        if parts[0] != parts[1] && !self.pairs.contains(&parts) {
            self.pairs.push(parts);
        }
    }
}

impl Model {
    /// Returns the parts of the model, and the pairs of parts whose shapes collide with each other.
    /// The bodies `robot` are one part.
    pub fn contact_parts(&self, robot: &[Body]) -> ContactParts {
        let model = &*self.inner;
        let body_name =
            |body: usize| model.id_to_name(MjtObjBase::mjOBJ_BODY, body).unwrap_or_default().to_string();
        let mut parts = ContactParts {
            names: vec!["robot".to_string()],
            geoms: Vec::new(),
            flexes: Vec::new(),
            pairs: Vec::new(),
        };
        for flex in 0..model.nflex() as usize {
            let name = model.id_to_name(MjtObjBase::mjOBJ_FLEX, flex).unwrap_or("flex");
            let part = parts.part(name);
            parts.flexes.push(part);
        }
        let flex_of = |body: usize| {
            let vertex = model.flex_vertbodyid().iter().position(|vertex| *vertex as usize == body)?;
            (0..model.nflex() as usize).rev().find(|flex| model.flex_vertadr()[*flex] as usize <= vertex)
        };
        for (geom, kind) in model.geom_type().iter().enumerate() {
            let mut body = model.geom_bodyid()[geom] as usize;
            while body > 0 && body_name(body).is_empty() && flex_of(body).is_none() {
                body = model.body_parentid()[body] as usize;
            }
            let name = body_name(body);
            let part = match flex_of(body) {
                Some(flex) => parts.flexes[flex],
                None if robot.contains(&Body(body)) => 0,
                None if body > 0 => parts.part(&name),
                None if *kind == MjtGeomBase::mjGEOM_PLANE => parts.part("ground"),
                None => parts.part("scene"),
            };
            parts.geoms.push(part);
        }
        // Bodies that are fixed to the world, or placed by the program, do not push each other.
        let is_fixed = |geom: usize| {
            let body = model.geom_bodyid()[geom] as usize;
            let root = model.body_weldid()[body] as usize;
            root == 0 || model.body_mocapid()[root] >= 0
        };
        let types = model.geom_contype();
        let affinities = model.geom_conaffinity();
        for first in 0..parts.geoms.len() {
            for second in first + 1..parts.geoms.len() {
                let bodies = [first, second].map(|geom| model.geom_bodyid()[geom] as usize);
                if is_fixed(first) && is_fixed(second) || self.never_touch(bodies) {
                    continue;
                }
                if types[first] & affinities[second] != 0 || types[second] & affinities[first] != 0 {
                    parts.add_pair([parts.geoms[first], parts.geoms[second]]);
                }
            }
        }
        for (first, second) in model.pair_geom1().iter().zip(model.pair_geom2()) {
            parts.add_pair([parts.geoms[*first as usize], parts.geoms[*second as usize]]);
        }
        parts.pairs.sort_unstable();
        parts
    }

    /// Returns whether MuJoCo ignores contacts between two bodies: they are fixed to each other,
    /// one of them is the parent of the other, or the document excludes them.
    fn never_touch(&self, bodies: [usize; 2]) -> bool {
        let model = &*self.inner;
        let [a, b] = bodies.map(|body| model.body_weldid()[body] as usize);
        let parent = |body: usize| model.body_weldid()[model.body_parentid()[body] as usize] as usize;
        let filters = !model.opt().disableflags & MjtDisableBit::mjDSBL_FILTERPARENT as i32 != 0;
        let is_parent = filters && a != 0 && b != 0 && (parent(a) == b || parent(b) == a);
        let signature = (bodies[0].min(bodies[1]) << 16 | bodies[0].max(bodies[1])) as i32;
        a == b || is_parent || model.exclude_signature().contains(&signature)
    }
}

impl World {
    /// Computes the contact forces in the current state, N. Writes the norm of the net force of
    /// each pair of parts, in the order of [`ContactParts::pairs`], and then the largest force at a
    /// single contact point between two parts.
    ///
    /// The forces are those of MuJoCo's forward dynamics under the controls and applied forces of
    /// the state.
    ///
    /// # Panics
    /// If `parts` are those of another model.
    pub fn contact_forces(&mut self, parts: &ContactParts, out: &mut Vec<f64>) {
        self.data.forward();
        let mut net = vec![[0.0; 3]; parts.pairs.len()];
        let mut largest = 0.0_f64;
        for (index, contact) in self.data.contact().iter().enumerate() {
            let side = |side: usize| match usize::try_from(contact.geom[side]) {
                Ok(geom) => Some(parts.geoms[geom]),
                Err(_) => usize::try_from(contact.flex[side]).ok().map(|flex| parts.flexes[flex]),
            };
            let (Some(first), Some(second)) = (side(0), side(1)) else { continue };
            let sorted = [first.min(second), first.max(second)];
            let Some(pair) = parts.pairs.iter().position(|pair| *pair == sorted) else { continue };
            let Ok(local) = self.data.try_contact_force(index) else { continue };
            // The rows of the frame are the axes of the contact in world axes.
            let axis = |row: usize| -> [f64; 3] { std::array::from_fn(|i| contact.frame[3 * row + i]) };
            let force = (0..3).fold([0.0; 3], |sum, row| add(sum, scale(axis(row), local[row])));
            largest = largest.max(norm(force));
            // The force on the second geom; in the net force it is that on the second part.
            net[pair] = add(net[pair], scale(force, if first == sorted[0] { 1.0 } else { -1.0 }));
        }
        out.clear();
        out.extend(net.into_iter().map(norm));
        out.push(largest);
    }
}
