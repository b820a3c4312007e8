//! The look of a model: shapes of bodies, meshes and cloths, for other renderers than MuJoCo's.

use mujoco_rs::wrappers::mj_model::{MjtCamLight, MjtGeomBase, MjtProjection};

use crate::frame::{add, rotate};
use crate::{Body, ElementKind, Model, World};

/// Group of collision shapes, which are drawn only if bodies have no other ones.
pub(crate) const COLLISION_GEOMS: usize = 3;

/// Which groups of sites pictures show.
const SITE_GROUPS: [bool; 6] = [true, true, true, false, false, false];

/// The color of a geom or site that states none.
const UNSET: [f32; 4] = [0.5, 0.5, 0.5, 1.0];

/// The kind of a geom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GeomKind {
    /// The plane z = 0, which is visible from above. Half sizes along x and y; 0 is infinite.
    Plane,
    /// Radius.
    Sphere,
    /// Radius and half length of its axis, z.
    Capsule,
    /// Half axes.
    Ellipsoid,
    /// Radius and half length along z.
    Cylinder,
    /// Half sizes.
    Box,
    /// The mesh with this index.
    Mesh(usize),
    /// The height field with this index.
    HeightField(usize),
    /// A kind without a simple surface: a signed distance field.
    Other,
}

impl GeomKind {
    fn of(kind: MjtGeomBase, data: i32) -> GeomKind {
        match kind {
            MjtGeomBase::mjGEOM_PLANE => GeomKind::Plane,
            MjtGeomBase::mjGEOM_SPHERE => GeomKind::Sphere,
            MjtGeomBase::mjGEOM_CAPSULE => GeomKind::Capsule,
            MjtGeomBase::mjGEOM_ELLIPSOID => GeomKind::Ellipsoid,
            MjtGeomBase::mjGEOM_CYLINDER => GeomKind::Cylinder,
            MjtGeomBase::mjGEOM_BOX => GeomKind::Box,
            MjtGeomBase::mjGEOM_MESH => GeomKind::Mesh(data as usize),
            MjtGeomBase::mjGEOM_HFIELD => GeomKind::HeightField(data as usize),
            _ => GeomKind::Other,
        }
    }
}

/// A geom or a site as it is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geom {
    /// Its body.
    pub body: Body,
    /// Its kind.
    pub kind: GeomKind,
    /// Its size, m, as its kind says.
    pub size: [f64; 3],
    /// Its position in the frame of the body, m.
    pub position: [f64; 3],
    /// Its orientation in the frame of the body.
    pub quaternion: [f64; 4],
    /// Whether pictures show it.
    pub is_drawn: bool,
    /// Red, green, blue and opacity, from 0 to 1.
    pub color: [f32; 4],
    /// Strength of highlights, from 0 to 1.
    pub specular: f32,
    /// Sharpness of highlights, from 0 to 1.
    pub shininess: f32,
    /// Light of its own, as a fraction of its color.
    pub emission: f32,
}

/// The surface of a cloth or of another flex.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// The vertices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// The body of each vertex and its position in the frame of this body, m.
    pub vertices: Vec<(Body, [f64; 3])>,
    /// Red, green, blue and opacity, from 0 to 1.
    pub color: [f32; 4],
}

/// A camera of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraMount {
    /// The body that it moves with.
    pub body: Body,
    /// Its position in the frame of the body, m.
    pub position: [f64; 3],
    /// Its orientation in the frame of the body: it looks along its -z, and its y is up in images.
    pub quaternion: [f64; 4],
    /// Vertical field of view, degrees.
    pub fovy_deg: f64,
    /// Whether it is fixed to its body and has a perspective. Others follow a body, or are
    /// orthographic.
    pub is_plain: bool,
}

impl Model {
    /// Returns which groups of geoms pictures show: those below the group of collision shapes, and
    /// this one if bodies have no other shapes.
    pub(crate) fn drawn_groups(&self) -> [bool; 6] {
        let is_other = |(body, group): (&i32, &i32)| *body > 0 && *group < COLLISION_GEOMS as i32;
        let has_other = self.inner.geom_bodyid().iter().zip(self.inner.geom_group()).any(is_other);
        [true, true, true, !has_other, false, false]
    }

    /// Returns the geoms, in the order of their indices.
    pub fn geoms(&self) -> Vec<Geom> {
        let model = &*self.inner;
        let groups = self.drawn_groups();
        let geom = |index: usize| Geom {
            body: Body(model.geom_bodyid()[index] as usize),
            kind: GeomKind::of(model.geom_type()[index], model.geom_dataid()[index]),
            size: model.geom_size()[index],
            position: model.geom_pos()[index],
            quaternion: model.geom_quat()[index],
            ..self.looks(
                model.geom_group()[index],
                &groups,
                model.geom_rgba()[index],
                model.geom_matid()[index],
            )
        };
        (0..self.count(ElementKind::Geom)).map(geom).collect()
    }

    /// Returns the sites, in the order of their indices.
    pub fn sites(&self) -> Vec<Geom> {
        let model = &*self.inner;
        let site = |index: usize| Geom {
            body: Body(model.site_bodyid()[index] as usize),
            kind: GeomKind::of(model.site_type()[index], 0),
            size: model.site_size()[index],
            position: model.site_pos()[index],
            quaternion: model.site_quat()[index],
            ..self.looks(
                model.site_group()[index],
                &SITE_GROUPS,
                model.site_rgba()[index],
                model.site_matid()[index],
            )
        };
        (0..self.count(ElementKind::Site)).map(site).collect()
    }

    /// Returns a point with the looks of an element of a group, with its own color and its
    /// material.
    fn looks(&self, group: i32, drawn: &[bool; 6], own: [f32; 4], material: i32) -> Geom {
        let model = &*self.inner;
        let material = usize::try_from(material).ok();
        let color = match material {
            // As in MuJoCo, the color of the element wins if it states one.
            Some(material) if own == UNSET => model.mat_rgba()[material],
            _ => own,
        };
        let is_shown = drawn.get(usize::try_from(group).unwrap_or_default()).is_some_and(|drawn| *drawn);
        Geom {
            body: Body(0),
            kind: GeomKind::Sphere,
            size: [0.0; 3],
            position: [0.0; 3],
            quaternion: [1.0, 0.0, 0.0, 0.0],
            is_drawn: is_shown && color[3] > 0.0,
            color,
            specular: material.map_or(0.5, |material| model.mat_specular()[material]),
            shininess: material.map_or(0.5, |material| model.mat_shininess()[material]),
            emission: material.map_or(0.0, |material| model.mat_emission()[material]),
        }
    }

    /// Returns vertices (m, in the frame of its geoms) and triangles of a mesh.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn mesh(&self, index: usize) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let model = &*self.inner;
        let range = |first: i32, count: i32| first as usize..(first + count) as usize;
        let vertices = range(model.mesh_vertadr()[index], model.mesh_vertnum()[index]);
        let faces = range(model.mesh_faceadr()[index], model.mesh_facenum()[index]);
        let triangle = |face: &[i32; 3]| face.map(|vertex| vertex as u32);
        (model.mesh_vert()[vertices].to_vec(), model.mesh_face()[faces].iter().map(triangle).collect())
    }

    /// Returns vertices (m, in the frame of its geoms) and triangles of the surface of a height
    /// field.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn height_field(&self, index: usize) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let model = &*self.inner;
        let rows = model.hfield_nrow()[index] as usize;
        let columns = model.hfield_ncol()[index] as usize;
        let [x, y, z, _] = model.hfield_size()[index].map(|v| v as f32);
        let heights = &model.hfield_data()[model.hfield_adr()[index] as usize..][..rows * columns];
        let along = |place: usize, count: usize| 2.0 * place as f32 / (count - 1) as f32 - 1.0;
        let vertex = |(place, height): (usize, &f32)| {
            [x * along(place % columns, columns), y * along(place / columns, rows), z * height]
        };
        let cell = |place: usize| {
            let a = (place / (columns - 1) * columns + place % (columns - 1)) as u32;
            let above = a + columns as u32;
            [[a, a + 1, above + 1], [a, above + 1, above]]
        };
        let cells = 0..(rows - 1) * (columns - 1);
        (heights.iter().enumerate().map(vertex).collect(), cells.flat_map(cell).collect())
    }

    /// Returns the surface of each flex that has one: the triangles of a cloth, or the outer ones
    /// of a solid. A flex whose vertices are interpolated has none here.
    pub fn surfaces(&self) -> Vec<Surface> {
        (0..self.count(ElementKind::Flex)).filter_map(|index| self.surface(index)).collect()
    }

    fn surface(&self, flex: usize) -> Option<Surface> {
        let model = &*self.inner;
        let corners = match model.flex_dim()[flex] {
            2 => &model.flex_elem()[model.flex_elemdataadr()[flex] as usize..]
                [..3 * model.flex_elemnum()[flex] as usize],
            3 => &model.flex_shell()[model.flex_shelldataadr()[flex] as usize..]
                [..3 * model.flex_shellnum()[flex] as usize],
            _ => return None,
        };
        let material = usize::try_from(model.flex_matid()[flex]).ok();
        let own = model.flex_rgba()[flex];
        let first = model.flex_vertadr()[flex] as usize;
        let vertex = |vertex: usize| {
            let body = usize::try_from(model.flex_vertbodyid()[vertex]).ok()?;
            Some((Body(body), model.flex_vert()[vertex]))
        };
        let vertices = (first..first + model.flex_vertnum()[flex] as usize).map(vertex);
        Some(Surface {
            triangles: corners.as_chunks::<3>().0.iter().map(|corner| corner.map(|c| c as u32)).collect(),
            vertices: vertices.collect::<Option<_>>()?,
            color: material.filter(|_| own == UNSET).map_or(own, |material| model.mat_rgba()[material]),
        })
    }

    /// Returns the camera with this index.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn camera_at(&self, index: usize) -> CameraMount {
        let model = &*self.inner;
        CameraMount {
            body: Body(model.cam_bodyid()[index] as usize),
            position: model.cam_pos()[index],
            quaternion: model.cam_quat()[index],
            fovy_deg: model.cam_fovy()[index],
            is_plain: model.cam_mode()[index] == MjtCamLight::mjCAMLIGHT_FIXED
                && model.cam_projection()[index] == MjtProjection::mjPROJ_PERSPECTIVE,
        }
    }
}

impl Surface {
    /// Returns the position of a vertex, m, at the last [`World::refresh`].
    pub fn vertex(&self, world: &World, index: usize) -> [f64; 3] {
        let (body, local) = self.vertices[index];
        let rows = world.rows();
        add(rows.position(body), rotate(rows.quaternion(body), local))
    }
}

impl World {
    /// Returns the first drawn geom that a ray meets and its distance, in lengths of `direction`,
    /// at the last [`refresh`](Self::refresh): MuJoCo's `mj_ray`. It
    /// does not meet cloths.
    pub fn ray(&mut self, origin: [f64; 3], direction: [f64; 3]) -> Option<(usize, f64)> {
        let groups = self.model().drawn_groups().map(u8::from);
        let (geom, distance) = self.data.ray(&origin, &direction, Some(&groups), true, None, None);
        geom.map(|geom| (geom, distance))
    }
}
