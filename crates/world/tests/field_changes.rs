//! A changed number of the model has the effect of the same number in the document.

use mishandle_world::{Change, ElementKind, FieldOperation, Model, ModelField};

/// A model in which every number matters. Numbers in braces are replaced. A sphere is where the
/// center of mass of its body is.
const XML: &str = r#"<mujoco>
  <option timestep="0.002" density="5" wind="{wind=0} 0 0" gravity="{gravity=0} 0 -9.81"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1" friction="{friction=0.9} 0.01 0.001" solref="{solref=0.02} 1"
     solimp="{solimp=0.9} 0.95 0.001 0.5 2"/>
    <body name="base" pos="0 0 {height=0.4}">
      <inertial pos="{ipos=0.1} 0 0" mass="{mass=1.5}" diaginertia="{inertia=0.01} 0.02 0.02"/>
      <joint name="swing" axis="0 1 0" stiffness="{stiffness=0}" damping="{damping=0}" armature="{armature=0}"
       frictionloss="{loss=0}" springref="20"/>
      <geom name="rod" type="capsule" fromto="0 0 0 0.4 0 0" size="0.03"/>
      <geom name="knob" size="0.06" pos="0.1 0 0"/>
      <body name="cart" pos="0.4 0 0">
        <inertial pos="0.01 0.02 0" quat="0.9 0.1 0.2 0.3" mass="0.6" diaginertia="0.002 0.0015 0.001"/>
        <joint name="slide" type="slide" axis="1 0 0" range="-0.1 0.1"/>
        <geom name="box" type="box" size="{size=0.06} 0.05 0.03" pos="{geom=0} 0 0.02" euler="10 20 30"/>
        <geom name="ball" type="sphere" size="{ball=0.05}" pos="0 0.05 -0.04"/>
        <geom name="pin" type="cylinder" size="0.02 {pin=0.06}" pos="0 -0.05 -0.04"/>
        <geom name="egg" type="ellipsoid" size="0.02 0.03 {egg=0.05}" pos="0.1 0 -0.05"/>
        <site name="hook" pos="0 {site=0} 0"/>
      </body>
    </body>
    <body name="brick" pos="0.12 0.02 0.56"><freejoint name="brick"/>
      <geom type="box" size="0.05 0.04 0.06" euler="5 0 9" mass="0.3" friction="0.1 0.01 0.001"/></body>
    <body name="loose" pos="0.5 0 0.56"><freejoint/>
      <geom type="box" size="0.05 0.04 0.03" mass="0.3"/>
      <geom type="sphere" size="0.03" pos="0.04 0 0.01" mass="0.1"/></body>
    <body name="stone" pos="1 1 0.1" euler="0 20 0"><freejoint name="stone"/>
      <geom type="box" size="0.05 0.04 0.03" mass="0.3" friction="0.1 0.01 0.001"/></body>
    <site name="anchor" pos="0.6 0 1"/>
  </worldbody>
  <tendon><spatial name="string" stiffness="3" damping="0.1" springlength="0.4"><site site="hook"/><site site="anchor"/></spatial></tendon>
  <actuator>
    <position name="servo" joint="swing" kp="{kp=8}" kv="0.5" forcerange="-6 {force=5}"/>
    <motor name="pull" tendon="string" gear="{gear=1}"/>
  </actuator>
</mujoco>"#;

/// Name of a number, its other value, and the entries that have it: field, element, column.
type Case = (&'static str, f64, &'static [(&'static str, &'static str, usize, f64)]);

/// The last number of an entry is its sign.
const CASES: [Case; 22] = [
    ("wind", 3.0, &[("opt.wind", "", 0, 1.0)]),
    ("gravity", 1.5, &[("opt.gravity", "", 0, 1.0)]),
    ("friction", 0.2, &[("geom_friction", "floor", 0, 1.0)]),
    ("solref", 0.05, &[("geom_solref", "floor", 0, 1.0)]),
    ("solimp", 0.5, &[("geom_solimp", "floor", 0, 1.0)]),
    ("height", 0.33, &[("body_pos", "base", 2, 1.0)]),
    ("ipos", 0.15, &[("body_ipos", "base", 0, 1.0)]),
    ("mass", 2.5, &[("body_mass", "base", 0, 1.0)]),
    ("inertia", 0.02, &[("body_inertia", "base", 0, 1.0)]),
    ("stiffness", 4.0, &[("jnt_stiffness", "swing", 0, 1.0)]),
    ("damping", 0.7, &[("dof_damping", "swing", 0, 1.0)]),
    ("armature", 0.05, &[("dof_armature", "swing", 0, 1.0)]),
    ("loss", 0.4, &[("dof_frictionloss", "swing", 0, 1.0)]),
    ("size", 0.09, &[("geom_size", "box", 0, 1.0)]),
    ("ball", 0.06, &[("geom_size", "ball", 0, 1.0)]),
    ("pin", 0.2, &[("geom_size", "pin", 1, 1.0)]),
    ("egg", 0.15, &[("geom_size", "egg", 2, 1.0)]),
    ("geom", 0.05, &[("geom_pos", "box", 0, 1.0)]),
    ("site", 0.06, &[("site_pos", "hook", 1, 1.0)]),
    ("kp", 11.0, &[("actuator_gainprm", "servo", 0, 1.0), ("actuator_biasprm", "servo", 1, -1.0)]),
    ("force", 0.5, &[("actuator_forcerange", "servo", 1, 1.0)]),
    ("gear", 2.0, &[("actuator_gear", "pull", 0, 1.0)]),
];

/// Returns the document in which the number with this name has this value.
fn document(name: &str, value: f64) -> String {
    let mut parts = XML.split('{');
    let mut out = parts.next().unwrap().to_string();
    for part in parts {
        let (number, rest) = part.split_once('}').unwrap();
        let (own, plain) = number.split_once('=').unwrap();
        out += &if own == name { value.to_string() } else { plain.to_string() };
        out += rest;
    }
    out
}

fn change(model: &Model, field: &str, element: &str, column: usize, value: f64) -> Change {
    let field = ModelField::from_name(field).unwrap();
    let row = match field.rows() {
        Some(kind) => model.field_rows(field, model.find(kind, element).unwrap()).start,
        None => 0,
    };
    let entries = vec![row * field.width() + column];
    Change::Field { field, entries, operation: FieldOperation::Set, value }
}

/// Returns the changes of the entries of a case.
fn changes(model: &Model, entries: &[(&str, &str, usize, f64)], value: f64) -> Vec<Change> {
    let of_entry = |(field, element, column, sign): &(&str, &str, usize, f64)| {
        change(model, field, element, *column, sign * value)
    };
    entries.iter().map(of_entry).collect()
}

/// Positions over the first second, in which the brick and the arm fall on the ground.
fn simulate(model: &Model) -> Vec<f64> {
    let mut world = model.world();
    world.ctrl_mut().copy_from_slice(&[0.9, 1.0]);
    let stone = model.joint("stone").unwrap();
    world.qvel_mut()[stone.dof] = 1.0;
    let mut positions = Vec::new();
    for _ in 0..500 {
        world.step();
        positions.extend_from_slice(world.qpos());
    }
    positions
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn a_changed_number_has_the_effect_of_that_number_in_the_document() {
    let plain = Model::from_xml(&document("", 0.0)).unwrap();
    for (name, value, entries) in CASES {
        let changes = changes(&plain, entries, value);
        changes.iter().for_each(|change| plain.check_change(change).unwrap());
        let changed = plain.changed(&changes);
        let compiled = Model::from_xml(&document(name, value)).unwrap();
        let found = simulate(&changed);
        let expected = simulate(&compiled);
        // Contacts amplify the last bits.
        assert!(distance(&found, &expected) < 1e-6, "{name}: {}", distance(&found, &expected));
        assert!(distance(&found, &simulate(&plain)) > 1e-4, "{name} has no effect");
        for field in ["geom_aabb", "geom_rbound", "tendon_length0", "actuator_acc0"] {
            let values = |model| values(model, &plain, field);
            let error = distance(&values(&changed), &values(&compiled));
            assert!(error < 1e-9, "{name}, {field}: {error}");
        }
        // The compiler may split the boxes in another order, but the largest ones are the same.
        let error = distance(
            &largest(&values(&changed, &plain, "bvh_aabb")),
            &largest(&values(&compiled, &plain, "bvh_aabb")),
        );
        assert!(error < 1e-9, "{name}, boxes: {error}");
    }
}

/// Returns the values of a field that changes modify.
fn values(model: &Model, plain: &Model, field: &str) -> Vec<f64> {
    let fields = ModelField::of(&field_changes(plain));
    model.field(*fields.iter().find(|known| known.name() == field).unwrap()).to_vec()
}

/// Returns the ends of boxes (center, half lengths) on each side of each axis.
fn largest(boxes: &[f64]) -> [f64; 6] {
    std::array::from_fn(|side| {
        let axis = side % 3;
        let sign = if side < 3 { -1.0 } else { 1.0 };
        boxes.chunks(6).map(|b| sign * b[axis] + b[3 + axis]).fold(0.0, f64::max)
    })
}

fn field_changes(model: &Model) -> Vec<Change> {
    CASES.iter().flat_map(|(_, value, entries)| changes(model, entries, *value)).collect()
}

#[test]
fn operations_set_add_and_scale() {
    let model = Model::from_xml(&document("", 0.0)).unwrap();
    let base = model.find(ElementKind::Body, "base").unwrap();
    for (operation, expected) in
        [(FieldOperation::Set, 3.0), (FieldOperation::Add, 4.5), (FieldOperation::Scale, 4.5)]
    {
        let change =
            Change::Field { field: ModelField::BodyMass, entries: vec![base], operation, value: 3.0 };
        assert_eq!(model.changed(&[change]).mass(model.body_at(base)), expected, "{operation:?}");
    }
}

#[test]
fn a_change_without_effect_or_meaning_is_refused_with_its_reason() {
    let model = Model::from_xml(&document("", 0.0)).unwrap();
    let check = |field: &str, element: &str, column: usize, value: f64, expected: &str| {
        let error = model.check_change(&change(&model, field, element, column, value)).unwrap_err();
        assert_eq!(error.to_string(), expected);
    };
    check("body_mass", "base", 0, -1.0, "cannot change body_mass of body `base`: -1 is negative");
    check("body_mass", "world", 0, 1.0, "cannot change body_mass of body `world`: the world has no mass");
    check("body_mass", "base", 0, f64::NAN, "cannot change body_mass of body `base`: NaN is not finite");
    check(
        "geom_size",
        "ball",
        1,
        1.0,
        "cannot change geom_size of geom `ball`: this shape has 1 sizes, so number 1 has no effect",
    );
    check(
        "geom_size",
        "floor",
        0,
        1.0,
        "cannot change geom_size of geom `floor`: the collisions of a plane have no size",
    );
    check(
        "actuator_forcerange",
        "pull",
        0,
        1.0,
        "cannot change actuator_forcerange of actuator `pull`: its force is not limited; give it a `forcerange` in the \
         model",
    );
    check(
        "body_pos",
        "brick",
        2,
        1.0,
        "cannot change body_pos of body `brick`: it has a free joint, so its position belongs to the state",
    );
    let error = ModelField::from_name("geom_aabb").unwrap_err().to_string();
    assert!(
        error.starts_with("the model has no field that can be changed named `geom_aabb`; known"),
        "{error}"
    );
}

#[test]
fn the_center_of_mass_of_a_body_without_coupled_inertia_stays() {
    let xml =
        r#"<mujoco><worldbody><body name="ball"><freejoint/><geom size="0.1"/></body></worldbody></mujoco>"#;
    let model = Model::from_xml(xml).unwrap();
    let row = model.find(ElementKind::Body, "ball").unwrap();
    let change = |value| Change::Field {
        field: ModelField::BodyIpos,
        entries: vec![3 * row],
        operation: FieldOperation::Set,
        value,
    };
    assert!(model.check_change(&change(0.0)).is_ok());
    let error = model.check_change(&change(0.01)).unwrap_err().to_string();
    assert!(
        error.starts_with("cannot change body_ipos of body `ball`: its center of mass is the origin"),
        "{error}"
    );
}
