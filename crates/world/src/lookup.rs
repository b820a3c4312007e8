//! Finding elements of a model by name.

use mujoco_rs::prelude::MjtJoint;

use crate::{Actuator, Body, ElementKind, Equality, Flex, Joint, Mocap, Model, Site, WorldError};

impl Model {
    /// Returns the body with this name.
    ///
    /// # Errors
    /// If the model has no such element.
    pub fn body(&self, name: &str) -> Result<Body, WorldError> {
        self.find(ElementKind::Body, name).map(Body)
    }

    /// Returns the site with this name.
    ///
    /// # Errors
    /// If the model has no such element.
    pub fn site(&self, name: &str) -> Result<Site, WorldError> {
        self.find(ElementKind::Site, name).map(Site)
    }

    /// Returns the actuator with this name.
    ///
    /// # Errors
    /// If the model has no such element.
    pub fn actuator(&self, name: &str) -> Result<Actuator, WorldError> {
        self.find(ElementKind::Actuator, name).map(Actuator)
    }

    /// Returns the equality constraint with this name.
    ///
    /// # Errors
    /// If the model has no such element.
    pub fn equality(&self, name: &str) -> Result<Equality, WorldError> {
        self.find(ElementKind::Equality, name).map(Equality)
    }

    /// Returns the joint with this name.
    ///
    /// # Errors
    /// If the model has no such element.
    pub fn joint(&self, name: &str) -> Result<Joint, WorldError> {
        self.find(ElementKind::Joint, name).map(|index| self.joint_at(index))
    }

    /// Returns the mocap body with this name. Its pose is part of the state.
    ///
    /// # Errors
    /// If the model has no such body, or it is not a mocap body.
    pub fn mocap(&self, name: &str) -> Result<Mocap, WorldError> {
        let Body(id) = self.body(name)?;
        usize::try_from(self.inner.body_mocapid()[id])
            .map(Mocap)
            .map_err(|_| WorldError::NotMocap(name.to_string()))
    }

    /// Returns the flex with this name, such as a cloth.
    ///
    /// # Errors
    /// If the model has no such flex, or its vertices are not consecutive top-level bodies with
    /// slide joints along x, y and z.
    pub fn flex(&self, name: &str) -> Result<Flex, WorldError> {
        let id = self.find(ElementKind::Flex, name)?;
        let model = &*self.inner;
        let vertices = model.flex_vertnum()[id] as usize;
        let bodies = &model.flex_vertbodyid()[model.flex_vertadr()[id] as usize..][..vertices];
        let first = bodies[0] as usize;
        let free = |(i, body): (usize, &i32)| {
            let body = *body as usize;
            let joint = model.body_jntadr()[body].max(0) as usize;
            body == first + i
                && model.body_parentid()[body] == 0
                && model.body_quat()[body] == [1.0, 0.0, 0.0, 0.0]
                && model.body_jntnum()[body] == 3
                && model.jnt_type()[joint..][..3] == [MjtJoint::mjJNT_SLIDE; 3]
                && model.jnt_axis()[joint..][..3] == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        };
        if !bodies.iter().enumerate().all(free) {
            return Err(WorldError::UnsupportedFlex(name.to_string()));
        }
        Ok(Flex { body: first, dof: model.body_dofadr()[first] as usize, vertices })
    }

    /// Returns the index of the element of a kind with this name.
    ///
    /// # Errors
    /// If the model has no such element.
    ///
    /// # Example
    /// ```
    /// use mishandle_world::{ElementKind, Model, PANDA};
    /// let model = Model::from_xml(PANDA)?;
    /// assert_eq!(model.find(ElementKind::Joint, "joint7")?, 6);
    /// assert_eq!(model.names(ElementKind::Body)[..2], ["world", "link0"]);
    /// # Ok::<(), mishandle_world::WorldError>(())
    /// ```
    pub fn find(&self, kind: ElementKind, name: &str) -> Result<usize, WorldError> {
        // An element without a name has the empty name.
        let is_name = !name.is_empty() && !name.contains('\0');
        let found = if is_name { self.inner.name_to_id(kind.object(), name) } else { None };
        found.ok_or_else(|| WorldError::Element {
            kind: kind.label(),
            name: name.to_string(),
            known: self.names(kind).into_iter().filter(|name| !name.is_empty()).collect(),
        })
    }

    /// Returns the names of all elements of a kind, in the order of their indices; empty for an
    /// element without a name.
    pub fn names(&self, kind: ElementKind) -> Vec<String> {
        let name = |index| self.inner.id_to_name(kind.object(), index).unwrap_or_default().to_string();
        (0..self.count(kind)).map(name).collect()
    }

    /// Returns the number of elements of a kind.
    pub fn count(&self, kind: ElementKind) -> usize {
        let model = &self.inner;
        let count = match kind {
            ElementKind::Body => model.nbody(),
            ElementKind::Joint => model.njnt(),
            ElementKind::Geom => model.ngeom(),
            ElementKind::Site => model.nsite(),
            ElementKind::Camera => model.ncam(),
            ElementKind::Pair => model.npair(),
            ElementKind::Flex => model.nflex(),
            ElementKind::Equality => model.neq(),
            ElementKind::Tendon => model.ntendon(),
            ElementKind::Actuator => model.nactuator(),
            ElementKind::Sensor => model.nsensor(),
            ElementKind::Key => model.nkey(),
        };
        count as usize
    }
}
