//! Reading models with includes and assets. Files outside the folder are not read.

use std::fs;
use std::path::{Path, PathBuf};

use mishandle_robots::mjcf::Source;
use mishandle_world::{ElementKind, Model};
use tempfile::TempDir;

/// A tetrahedron as STL, with edges of this length along the axes.
fn tetrahedron(edge: f32) -> Vec<u8> {
    let corners = [[0.0; 3], [edge, 0.0, 0.0], [0.0, edge, 0.0], [0.0, 0.0, edge]];
    let mut bytes = vec![0; 80];
    bytes.extend(4_u32.to_le_bytes());
    for face in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
        bytes.extend([0; 12]);
        bytes.extend(face.iter().flat_map(|corner: &usize| corners[*corner]).flat_map(f32::to_le_bytes));
        bytes.extend([0; 2]);
    }
    bytes
}

/// Writes files into a new folder; those with the ending `stl` are tetrahedra of this edge, dm.
fn folder(files: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        let edge = text.parse::<f32>().map(|edge| 0.1 * edge);
        fs::write(
            path,
            if name.ends_with("stl") { tetrahedron(edge.unwrap()) } else { text.as_bytes().to_vec() },
        )
        .unwrap();
    }
    folder
}

fn read(folder: &TempDir) -> Result<Source, String> {
    read_file(&folder.path().join("main.xml"))
}

fn read_file(path: &Path) -> Result<Source, String> {
    // Messages begin with the path of the file.
    let prefix = format!("{}/", path.parent().unwrap().display());
    Source::read(path, false).map_err(|error| error.to_string().replace(&prefix, ""))
}

fn compile(source: &Source) -> Model {
    Model::from_xml_with_assets(&source.document, &source.assets).unwrap()
}

#[test]
fn a_document_without_files_stays_as_it_is() {
    let text = "<?xml version=\"1.0\"?>\n<!-- a robot -->\n<mujoco  model='x'>\n <option timestep=\"1e-3\" />\n\
                <worldbody><geom size=\".10\"/></worldbody>\n</mujoco>\n";
    let source = read(&folder(&[("main.xml", text)])).unwrap();
    assert_eq!(source.document, text);
    assert!(source.assets.is_empty() && !source.is_urdf());
}

fn names(source: &Source) -> Vec<&str> {
    source.assets.keys().map(String::as_str).collect()
}

#[test]
fn included_files_are_read_as_they_are() {
    let main = "<mujoco><!-- first --><include file=\"parts/a.xml\"/><worldbody><body><include file='b.xml'></include></body>\
                </worldbody></mujoco>";
    let source = read(&folder(&[
        ("main.xml", main),
        // Relative to the main file, or to the file itself.
        ("parts/a.xml", "<mujocoinclude>\n<include file=\"c.xml\"/><default/></mujocoinclude>"),
        ("parts/c.xml", "<mujoco><option/></mujoco>"),
        ("b.xml", "<x><geom size=\"0.1\"/><!-- </x> --><geom size=\"0.20\"/></x>"),
    ]))
    .unwrap();
    assert_eq!(
        (source.document.as_str(), names(&source)),
        (main, vec!["b.xml", "parts/a.xml", "parts/c.xml"])
    );
    assert_eq!(compile(&source).count(ElementKind::Geom), 2);
}

#[test]
fn a_file_beside_the_main_file_wins_over_one_beside_the_included_file() {
    let source = read(&folder(&[
        ("main.xml", "<mujoco><include file=\"sub/a.xml\"/></mujoco>"),
        ("sub/a.xml", "<mujoco><include file=\"b.xml\"/></mujoco>"),
        ("sub/b.xml", "<mujoco><option/></mujoco>"),
        ("b.xml", "<mujoco><size/></mujoco>"),
    ]))
    .unwrap();
    assert_eq!(names(&source), ["b.xml", "sub/a.xml"]);
}

#[test]
fn assets_have_the_names_by_which_mujoco_opens_them() {
    let files = folder(&[
        (
            "main.xml",
            "<mujoco><compiler meshdir=\"m\" angle=\"radian\"/><include file=\"sub/a.xml\"/>\
             <asset><mesh file=\"one.stl\"/><mesh name=\"two\" file=\"left/x.stl\"/><mesh name=\"three\" \
             file=\"right/x.stl\"/><mesh name=\"again\" file=\"./right/../right\\x.stl\"/></asset><worldbody>\
             <geom type=\"mesh\" mesh=\"one\"/><geom type=\"mesh\" mesh=\"two\"/><geom type=\"mesh\" mesh=\"three\"/>\
             <geom type=\"mesh\" mesh=\"own\"/></worldbody></mujoco>",
        ),
        (
            "sub/a.xml",
            "<mujoco><compiler meshdir=\"meshes\"/><asset><mesh file=\"own.stl\"/></asset></mujoco>",
        ),
        ("meshes/one.stl", "1"),
        ("meshes/left/x.stl", "2"),
        ("meshes/right/x.stl", "3"),
        ("sub/own.stl", "4"),
    ]);
    let source = read(&files).unwrap();
    let expected = ["meshes/left/x.stl", "meshes/one.stl", "meshes/right/x.stl", "sub/a.xml", "sub/own.stl"];
    assert_eq!(names(&source), expected);
    assert_eq!(compile(&source).count(ElementKind::Geom), 4);
    assert_eq!(source.assets["meshes/right/x.stl"], tetrahedron(0.3));
}

#[test]
fn a_part_of_a_composed_model_is_attached_from_its_file() {
    let source = read(&folder(&[
        (
            "main.xml",
            "<mujoco><asset><model name='part' file='parts/p.xml'/></asset><worldbody><body name='base'>\
             <attach model='part' body='b' prefix='left-'/></body></worldbody></mujoco>",
        ),
        (
            "parts/p.xml",
            "<mujoco><compiler meshdir='m'/><asset><mesh file='x.stl'/></asset><worldbody><body name='b'><joint name='j'/>\
             <geom type='mesh' mesh='x'/></body></worldbody></mujoco>",
        ),
        ("parts/m/x.stl", "1"),
    ]))
    .unwrap();
    assert_eq!(names(&source), ["parts/m/x.stl", "parts/p.xml"]);
    assert_eq!(compile(&source).names(ElementKind::Joint), ["left-j"]);
}

#[test]
fn text_that_is_not_utf_8_is_latin_1() {
    let files = folder(&[]);
    let text = "<?xml version=\"1.0\" encoding=\"ISO-8859-1\"?><mujoco model=\"K\u{f6}rper\"><option timestep=\"0.25\"/></mujoco>";
    let bytes: Vec<u8> = text.chars().map(|letter| letter as u8).collect();
    fs::write(files.path().join("main.xml"), bytes).unwrap();
    let source = read(&files).unwrap();
    assert_eq!(source.document, text);
    assert_eq!(compile(&source).timestep(), 0.25);
}

#[test]
fn the_model_has_the_bits_of_the_file_that_mujoco_loads() {
    let files = folder(&[
        (
            "main.xml",
            "<mujoco><compiler assetdir=\"a\"/><asset><mesh file=\"q/one.stl\" scale=\"1.1 0.7 0.3333333333333333\"/></asset>\
             <worldbody><body><freejoint/><geom type=\"mesh\" mesh=\"one\" density=\"123.456\"/></body></worldbody></mujoco>",
        ),
        ("a/q/one.stl", "1"),
    ]);
    let model = compile(&read(&files).unwrap());
    // The volume of a tetrahedron is a sixth of the product of its edges.
    let expected = 123.456 * 0.001 * 1.1 * 0.7 / 3.0 / 6.0;
    let mass = model.mass(model.body_at(1));
    assert!((mass - expected).abs() < 1e-6 * expected, "{mass} {expected}");
}

#[test]
fn errors_name_the_file_and_what_mujoco_or_a_rule_says() {
    let check = |files: &[(&str, &str)], expected: &[&str]| {
        let error = read(&folder(files)).unwrap_err();
        assert!(error.starts_with("main.xml: "), "{error}");
        for part in expected {
            assert!(error.contains(part), "{error}");
        }
    };
    let main = |text: &'static str| [("main.xml", text)];
    check(&main("<mujoco>\n\n<include/></mujoco>"), &["missing", "line 3"]);
    check(&main("<mujoco>\n<include file='no.xml'/></mujoco>"), &["opening file 'no.xml'", "line 2"]);
    check(&main("<mujoco>\n<asset>\n<mesh file='no.stl'/></asset></mujoco>"), &["opening file 'no.stl'"]);
    check(&main("<urdf/>"), &["Unrecognized XML model type: 'urdf'"]);
    let plugin = "<mujoco><extension><plugin plugin='x'/></extension></mujoco>";
    check(&main(plugin), &["plugins run code and are not loaded; remove them from the model"]);
    let twice = [
        ("main.xml", "<mujoco>\n<include file='a.xml'/>\n<include file='./a.xml'/></mujoco>"),
        ("a.xml", "<mujoco><option/></mujoco>"),
    ];
    check(&twice, &["already included", "line 3"]);
}

#[test]
fn no_path_leaves_the_folder() {
    let outer = folder(&[
        ("secret.xml", "<mujoco><option/></mujoco>"),
        ("secret.stl", "1"),
        ("robot/meshes/own.stl", "1"),
        ("robot/main.xml", ""),
    ]);
    let robot = outer.path().join("robot");
    std::os::unix::fs::symlink("../secret.xml", robot.join("link.xml")).unwrap();
    std::os::unix::fs::symlink("..", robot.join("up")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", robot.join("zero.stl")).unwrap();
    std::os::unix::fs::symlink("meshes/own.stl", robot.join("inside.stl")).unwrap();
    let read = |text: &str, allow: bool| {
        fs::write(robot.join("main.xml"), text).unwrap();
        Source::read(&robot.join("main.xml"), allow).map_err(|error| error.to_string())
    };
    let absolute = outer.path().join("secret.xml").display().to_string();
    for path in [
        "../secret.xml",
        "../../../../../../etc/passwd",
        "meshes/../../secret.xml",
        "link.xml",
        "up/secret.xml",
        "/etc/passwd",
        &absolute,
    ] {
        for text in [
            format!("<mujoco><include file='{path}'/></mujoco>"),
            format!("<mujoco><asset><hfield size='1 1 1 1' name='h' file='{path}'/></asset></mujoco>"),
            format!(
                "<mujoco><asset><texture type='cube' name='t' content_type='image/png' fileup='{path}'/></asset></mujoco>"
            ),
            format!("<robot><link><collision><mesh filename='{path}'/></collision></link></robot>"),
        ] {
            let error = read(&text, false).unwrap_err();
            assert!(error.contains("outside the folder"), "{text}: {error}");
        }
    }
    for text in [
        "<mujoco><compiler meshdir='..'/><asset><mesh file='secret.stl'/></asset></mujoco>",
        "<mujoco><compiler assetdir='/'/><asset><mesh file='etc/passwd'/></asset></mujoco>",
        "<mujoco><compiler meshdir='..\\'/><asset><mesh file='secret.stl'/></asset></mujoco>",
        "<robot><mujoco><compiler meshdir='../'/></mujoco><link><mesh filename='secret.stl'/></link></robot>",
    ] {
        let error = read(text, false).unwrap_err();
        assert!(error.contains("outside the folder"), "{text}: {error}");
    }
    for allow in [false, true] {
        let error = read("<mujoco><asset><mesh file='zero.stl'/></asset></mujoco>", allow).unwrap_err();
        let expected = if allow { "expected a regular file, found a device" } else { "outside the folder" };
        assert!(error.contains(expected), "{error}");
        let error = read("<mujoco><asset><mesh file='http://x/y.stl'/></asset></mujoco>", allow).unwrap_err();
        assert!(error.contains("is a link; only files can be read"), "{error}");
    }
    // With permission, and links inside the folder.
    let source = read("<mujoco><include file='../secret.xml'/></mujoco>", true).unwrap();
    assert_eq!(names(&source), ["../secret.xml"]);
    let source = read(&format!("<mujoco><include file='{absolute}'/></mujoco>"), true).unwrap();
    assert_eq!(names(&source), [absolute.as_str()]);
    let source = read("<mujoco><asset><mesh file='inside.stl'/></asset></mujoco>", false).unwrap();
    assert_eq!(source.assets.len(), 1);
}

#[test]
fn hostile_files_are_refused_in_bounded_time() {
    let main = |text: String| {
        let error = read(&folder(&[("main.xml", &text)])).unwrap_err();
        error.strip_prefix("main.xml: ").unwrap().to_string()
    };
    // MuJoCo knows no entities: this one would have 3 GB.
    let entities: String =
        (1..10).map(|i| format!("<!ENTITY e{i} \"{}\">", format!("&e{};", i - 1).repeat(10))).collect();
    let laughs = format!("<!DOCTYPE m [<!ENTITY e0 \"ha!\">{entities}]><mujoco>&e9;</mujoco>");
    assert_eq!(read(&folder(&[("main.xml", &laughs)])).unwrap().document, laughs);
    assert!(!main(format!("<mujoco>\n{}", "<body>".repeat(1_000_000))).is_empty());
    let closed = format!("<mujoco>\n{}{}</mujoco>", "<body>".repeat(5000), "</body>".repeat(5000));
    assert!(!main(closed).is_empty());
    let attributes: String = (0..20_000).map(|i| format!(" a{i}=''")).collect();
    assert!(main(format!("<mujoco{attributes}/>")).contains("unrecognized attribute"));
    assert!(main(format!("<mujoco>{}</mujoco>", "<a/>".repeat(1_000_000))).contains("unrecognized element"));
    assert!(main("<mujoco>\0</mujoco>".to_string()).contains("the document contains a zero byte"));
    assert!(!main(String::new()).is_empty());

    let files = folder(&[("main.xml", "<mujoco><include file='big.xml'/></mujoco>")]);
    fs::File::create(files.path().join("big.xml")).unwrap().set_len(1 << 40).unwrap();
    let error = read(&files).unwrap_err();
    assert!(error.contains("cannot read `big.xml`") && error.contains("the limit is 67108864"), "{error}");
}

#[test]
fn too_many_files_are_refused() {
    let files = folder(&[]);
    let mut text = "<mujoco>".to_string();
    for index in 0..2001 {
        fs::write(files.path().join(format!("{index}.xml")), "<m><option/></m>").unwrap();
        text += &format!("<include file='{index}.xml'/>");
    }
    fs::write(files.path().join("main.xml"), text + "</mujoco>").unwrap();
    assert!(read(&files).unwrap_err().ends_with("the model refers to more than 2000 files"));
}

#[test]
fn urdf_finds_its_meshes_and_misses_only_those_that_are_seen() {
    let urdf = |mesh: &str| {
        format!(
            "<robot name=\"r\"><mujoco><compiler meshdir=\"m\" fusestatic=\"false\"/></mujoco><link name=\"base\"><visual>\
             <geometry><mesh filename=\"package://gone/seen.dae\"/></geometry></visual><collision><geometry>\
             <mesh filename=\"{mesh}\"/></geometry></collision></link></robot>"
        )
    };
    for mesh in ["package://pkg/deep/one.stl", "one.stl", "package://pkg/two.stl", "deep/two.stl"] {
        let files = [
            ("main.xml", urdf(mesh)),
            ("m/one.stl", "1".into()),
            ("pkg/two.stl", "2".into()),
            ("m/deep/two.stl", "2".into()),
        ];
        let files: Vec<(&str, &str)> = files.iter().map(|(name, text)| (*name, text.as_str())).collect();
        let source = read(&folder(&files)).unwrap();
        assert!(source.is_urdf());
        assert_eq!(source.assets.len(), 1, "{mesh}");
        assert_eq!(compile(&source).count(ElementKind::Geom), 1, "{mesh}");
    }
    let error = read(&folder(&[("main.xml", &urdf("package://pkg/three.stl"))])).unwrap_err();
    assert!(error.starts_with("main.xml:1: found no file `m/three.stl`, no `m/pkg/three.stl`"), "{error}");
    let xacro =
        "<robot xmlns:xacro=\"http://www.ros.org/wiki/xacro\"><xacro:property name='a' value='1'/></robot>";
    let error = read(&folder(&[("main.xml", xacro)])).unwrap_err();
    assert_eq!(error, "main.xml:1: this is a xacro file; expand it with `xacro` before");
}

#[test]
fn a_package_is_looked_up_above_the_model_if_that_is_allowed() {
    let files = folder(&[]);
    let path = files.path().join("arm_description/robots/urdf/arm.urdf");
    let mesh = files.path().join("arm_description/meshes/link.stl");
    for path in [&path, &mesh] {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
    }
    let urdf = "<robot name='r'><link name='base'><collision><geometry>\
                <mesh filename='package://arm_description/meshes/link.stl'/></geometry></collision></link></robot>";
    fs::write(&path, urdf).unwrap();
    fs::write(&mesh, "1").unwrap();
    assert_eq!(Source::read(&path, true).unwrap().assets.len(), 1);
    assert!(Source::read(&path, false).is_err());
}

#[test]
fn a_missing_main_file_is_an_error_with_its_path() {
    let error = Source::read(&PathBuf::from("/nowhere/robot.xml"), false).unwrap_err();
    assert_eq!(error.file, "/nowhere/robot.xml");
}
