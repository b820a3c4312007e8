//! Documents that refer to files in memory.

use mishandle_world::{Assets, ElementKind, Model, mjcf_of_urdf};

/// A tetrahedron with edges of this length along the axes, as binary STL.
fn tetrahedron(edge: f32) -> Vec<u8> {
    let corners = [[0.0; 3], [edge, 0.0, 0.0], [0.0, edge, 0.0], [0.0, 0.0, edge]];
    let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let mut bytes = vec![0; 80];
    bytes.extend(4_u32.to_le_bytes());
    for face in faces {
        bytes.extend([0; 12]); // MuJoCo computes the normals
        bytes.extend(face.iter().flat_map(|corner: &usize| corners[*corner]).flat_map(f32::to_le_bytes));
        bytes.extend([0; 2]);
    }
    bytes
}

fn assets(edge: f32) -> Assets {
    Assets::from([("corner.stl".to_string(), tetrahedron(edge))])
}

const BODY: &str = r#"<mujoco><asset><mesh file="corner.stl"/></asset><worldbody><body name="b"><freejoint/>
    <geom type="mesh" mesh="corner" density="600"/></body></worldbody></mujoco>"#;

const URDF: &str = r#"<robot name="pair">
  <link name="base"><collision><geometry><mesh filename="corner.stl"/></geometry></collision>
    <inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="arm"><visual><geometry><mesh filename="not_there.dae"/></geometry></visual>
    <inertial><origin xyz="0.25 0 0"/><mass value="0.5"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1.5" effort="10" velocity="2"/></joint>
</robot>"#;

#[test]
fn a_mesh_in_memory_has_the_mass_of_its_volume() {
    for edge in [1.0, 2.0] {
        let model = Model::from_xml_with_assets(BODY, &assets(edge)).unwrap();
        let mass = model.mass(model.body("b").unwrap());
        // A sixth of the cube of the edge, also if another file had this name before.
        let expected = 600.0 * f64::from(edge).powi(3) / 6.0;
        assert!((mass - expected).abs() < 1e-6 * expected, "{mass} and {expected}");
    }
}

#[test]
fn no_file_is_read_from_the_disk() {
    // A test runs in the folder of its package, in which this file is.
    std::fs::write(concat!(env!("CARGO_TARGET_TMPDIR"), "/corner.stl"), tetrahedron(1.0)).unwrap();
    let error = |xml: &str| Model::from_xml(xml).unwrap_err().to_string();
    let beside = BODY
        .replace("corner.stl", "Cargo.toml")
        .replace("<mesh ", "<mesh content_type=\"model/stl\" name=\"corner\" ");
    assert!(error(&beside).contains("Error opening file"), "{}", error(&beside));
    for path in [
        concat!(env!("CARGO_TARGET_TMPDIR"), "/corner.stl"),
        "../world/corner.stl",
        "a/../../corner.stl",
        "../../../../../../../../../../../../../../../../../../../../../../../../../../../../../../../../../../../../etc/corner.stl",
        "&#47;etc/corner.stl",
        "\\etc\\corner.stl",
        "file:///corner.stl",
    ] {
        let message = error(&BODY.replace("corner.stl", path));
        assert!(message.contains("Error opening file"), "{path}: {message}");
    }
    let folder = format!("<mujoco><compiler meshdir = '{}'/>", env!("CARGO_TARGET_TMPDIR"));
    let message = error(&BODY.replace("<mujoco>", &folder));
    assert!(message.contains("Error opening file"), "{message}");
    for path in ["/etc/passwd", "../../etc/passwd", "Cargo.toml"] {
        let message = error(&format!("<mujoco><include file=\"{path}\"/></mujoco>"));
        assert!(message.contains("Error opening file"), "{message}");
        let message = error(&format!("<mujoco><asset><model file=\"{path}\"/></asset></mujoco>"));
        assert!(message.contains("opening file") || message.contains("find decoder"), "{message}");
    }
}

#[test]
fn urdf_compiles_and_becomes_mjcf() {
    let direct = Model::from_xml_with_assets(URDF, &assets(0.1)).unwrap();
    assert_eq!(direct.names(ElementKind::Joint), ["elbow"]);
    let mjcf = mjcf_of_urdf(URDF, &assets(0.1)).unwrap();
    let converted = Model::from_xml_with_assets(&mjcf, &assets(0.1)).unwrap();
    assert!(mjcf.starts_with("<mujoco"), "{mjcf}");
    let a = direct.joint("elbow").unwrap();
    let b = converted.joint("elbow").unwrap();
    assert_eq!((a.low, a.high), (b.low, b.high));
    assert_eq!(direct.names(ElementKind::Body), converted.names(ElementKind::Body));
    let error = mjcf_of_urdf("<robot name=\"r\"><link/></robot>", &Assets::new()).unwrap_err().to_string();
    assert!(error.starts_with("MuJoCo cannot compile the model"), "{error}");
}

#[test]
fn a_full_message_names_line_and_file() {
    let error =
        Model::from_xml("<mujoco>\n<worldbody>\n<geon/>\n</worldbody></mujoco>").unwrap_err().to_string();
    assert!(error.contains("line 3"), "{error}");
    let empty = Model::from_xml_with_assets(BODY, &Assets::new()).unwrap_err().to_string();
    assert!(empty.contains("corner.stl"), "{empty}");
}
