//! Reading models with includes and assets. Files outside the folder are not read.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

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
    Model::from_xml_with_assets(&source.document, Arc::new(source.assets.clone())).unwrap()
}

#[test]
fn a_document_without_files_stays_as_it_is() {
    let text = "<?xml version=\"1.0\"?>\n<!-- a robot -->\n<mujoco  model='x'>\n <option timestep=\"1e-3\" />\n\
                <worldbody><geom size=\".10\"/></worldbody>\n</mujoco>\n";
    let source = read(&folder(&[("main.xml", text)])).unwrap();
    assert_eq!(source.document, text);
    assert!(source.assets.is_empty() && !source.is_urdf());
}

#[test]
fn includes_are_replaced_by_what_their_root_contains() {
    let source = read(&folder(&[
        (
            "main.xml",
            "<mujoco><!-- first --><include file=\"parts/a.xml\"/><worldbody><body><include file='b.xml'></include></body></worldbody></mujoco>",
        ),
        // Relative to the main file, or to the file itself.
        ("parts/a.xml", "<mujocoinclude>\n<include file=\"c.xml\"/><default/></mujocoinclude>"),
        ("parts/c.xml", "<mujoco/>"),
        ("b.xml", "<x><geom size=\"0.1\"/><!-- </x> --><geom size=\"0.20\"/></x>"),
    ]));
    let expected = "<mujoco><!-- first -->\n<default/><worldbody><body><geom size=\"0.1\"/><!-- </x> --><geom \
                    size=\"0.20\"/></body></worldbody></mujoco>";
    assert_eq!(source.unwrap().document, expected);
}

#[test]
fn a_file_beside_the_main_file_wins_over_one_beside_the_included_file() {
    let source = read(&folder(&[
        ("main.xml", "<mujoco><include file=\"sub/a.xml\"/></mujoco>"),
        ("sub/a.xml", "<mujoco><include file=\"b.xml\"/></mujoco>"),
        ("sub/b.xml", "<mujoco><option/></mujoco>"),
        ("b.xml", "<mujoco><size/></mujoco>"),
    ]));
    assert_eq!(source.unwrap().document, "<mujoco><size/></mujoco>");
}

#[test]
fn assets_have_the_names_of_their_files_in_the_document() {
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
        ("sub/meshes/own.stl", "4"),
    ]);
    let source = read(&files).unwrap();
    let names: Vec<&str> = source.assets.keys().map(String::as_str).collect();
    assert_eq!(names, ["2_x.stl", "one.stl", "own.stl", "x.stl"]);
    assert!(!source.document.contains("meshdir") && source.document.contains("angle=\"radian\""));
    let model = compile(&source);
    assert_eq!(model.count(ElementKind::Geom), 4);
    assert_eq!(source.assets["2_x.stl"], tetrahedron(0.3));
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
fn an_asset_keeps_its_name_if_its_file_gets_another_one() {
    let text = "<mujoco><asset><mesh file=\"a&amp;b: c.stl\"/></asset><worldbody><geom type=\"mesh\" \
                mesh=\"a&amp;b: c\"/></worldbody></mujoco>";
    let source = read(&folder(&[("main.xml", text), ("a&b: c.stl", "1")])).unwrap();
    assert!(
        source.document.contains("<mesh name=\"a&amp;b: c\" file=\"a_b_ c.stl\"/>"),
        "{}",
        source.document
    );
    assert_eq!(compile(&source).count(ElementKind::Geom), 1);
    // The files of the sides of a texture give it no name.
    let sides = ["a/x.png", "b/x.png", "c/x.png"];
    let text = "<mujoco><asset><texture type=\"cube\" fileup=\"a/x.png\" filedown=\"b/x.png\" fileleft=\"c/x.png\"/>\
                </asset></mujoco>";
    let files: Vec<(&str, &str)> = sides.iter().map(|side| (*side, "")).chain([("main.xml", text)]).collect();
    let source = read(&folder(&files)).unwrap();
    assert_eq!(source.assets.len(), 3);
    assert!(!source.document.contains("name="), "{}", source.document);
}

#[test]
fn strippath_drops_folders_of_files() {
    let text = "<mujoco><compiler strippath=\"true\"/><asset><mesh file=\"gone/one.stl\"/></asset></mujoco>";
    let source = read(&folder(&[("main.xml", text), ("one.stl", "1")])).unwrap();
    assert_eq!(source.assets.len(), 1);
    assert_eq!(source.document, "<mujoco><compiler /><asset><mesh file=\"one.stl\"/></asset></mujoco>");
}

#[test]
fn errors_name_file_line_and_reason() {
    let check = |files: &[(&str, &str)], expected: &str| {
        assert_eq!(read(&folder(files)).unwrap_err(), expected);
    };
    let main = |text: &'static str| [("main.xml", text)];
    check(&main("<mujoco>\n\n<include/></mujoco>"), "main.xml:3: an include needs the attribute `file`");
    check(
        &main("<mujoco>\n<include file='no.xml'/></mujoco>"),
        "main.xml:2: the included file `no.xml` does not exist",
    );
    check(
        &main("<mujoco>\n<asset>\n<mesh file='no.stl'/></asset></mujoco>"),
        "main.xml:3: the file `no.stl` does not exist",
    );
    check(
        &main("<urdf/>"),
        "main.xml: the root element is `urdf`; a model has `mujoco` (MJCF) or `robot` (URDF)",
    );
    check(
        &main("<mujoco><extension><plugin plugin='x'/></extension></mujoco>"),
        "main.xml:1: plugins run code and are not loaded; remove them from the model",
    );
    check(
        &main("<mujoco><asset><model file='x.xml'/></asset></mujoco>"),
        "main.xml:1: attached models are not supported; save the composed model with MuJoCo (mj_saveXML)",
    );
    let included = [
        ("main.xml", "<mujoco>\n<include file=\"a.xml\"/>\n<asset><mesh file='b.stl'/></asset></mujoco>"),
        ("a.xml", "<mujoco>\n\n\n<asset><texture fileleft='no.png'/></asset></mujoco>"),
    ];
    check(&included, "a.xml:4: the file `no.png` does not exist");
    let after = [included[0], ("a.xml", "<mujoco>\n\n\n</mujoco>")];
    check(&after, "main.xml:3: the file `b.stl` does not exist");
}

#[test]
fn a_file_is_included_once() {
    let twice = [
        ("main.xml", "<mujoco>\n<include file='a.xml'/>\n<include file='./a.xml'/></mujoco>"),
        ("a.xml", "<mujoco/>"),
    ];
    let error = read(&folder(&twice)).unwrap_err();
    assert_eq!(error, "main.xml:3: `./a.xml` is included a second time; MuJoCo includes a file once");
    for target in ["main.xml", "b.xml"] {
        let cycle = format!("<mujoco><include file='{target}'/></mujoco>");
        let files = [
            ("main.xml", "<mujoco><include file='a.xml'/></mujoco>"),
            ("a.xml", "<mujoco><include file='b.xml'/></mujoco>"),
            ("b.xml", cycle.as_str()),
        ];
        let error = read(&folder(&files)).unwrap_err();
        assert!(error.contains("a second time"), "{error}");
    }
}

#[test]
fn no_path_leaves_the_folder() {
    let outer = folder(&[
        ("secret.xml", "<mujoco/>"),
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
            format!("<mujoco><asset><hfield file='{path}'/></asset></mujoco>"),
            format!("<mujoco><asset><texture fileup='{path}'/></asset></mujoco>"),
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
    let error = read("<mujoco><asset><mesh file='zero.stl'/></asset></mujoco>", true).unwrap_err();
    assert!(error.contains("expected a regular file, found a device"), "{error}");
    let error = read("<mujoco><asset><mesh file='http://x/y.stl'/></asset></mujoco>", true).unwrap_err();
    assert!(error.contains("is a link; only files can be read"), "{error}");
    // With permission, and links inside the folder.
    assert_eq!(
        read("<mujoco><include file='../secret.xml'/></mujoco>", true).unwrap().document,
        "<mujoco></mujoco>"
    );
    let source = read("<mujoco><asset><mesh file='inside.stl'/></asset></mujoco>", false).unwrap();
    assert_eq!(source.assets.len(), 1);
}

#[test]
fn hostile_files_are_refused_in_bounded_time() {
    let main = |text: String| {
        let error = read(&folder(&[("main.xml", &text)])).unwrap_err();
        error.strip_prefix("main.xml").unwrap().to_string()
    };
    let laughs = "<!DOCTYPE m [<!ENTITY a \"ha\"><!ENTITY b \"&a;&a;&a;\">]><mujoco>&b;</mujoco>";
    assert!(main(laughs.to_string()).contains("DTD"));
    let deep = format!("<mujoco>\n{}", "<body>".repeat(1_000_000));
    assert!(!main(deep).is_empty());
    let closed = format!("<mujoco>\n{}{}</mujoco>", "<body>".repeat(5000), "</body>".repeat(5000));
    assert_eq!(main(closed), ":2: elements are nested more than 400 deep");
    let attributes: String = (0..200_000).map(|i| format!(" a{i}=''")).collect();
    assert_eq!(main(format!("<mujoco{attributes}/>")), ":1: an element has more than 1000 attributes");
    assert!(main("<a/>".repeat(5_000_000)).contains("not valid XML"));
    assert!(main(format!("<mujoco>{}</mujoco>", "<a/>".repeat(5_000_000))).contains("not valid XML"));
    assert_eq!(main("<mujoco>\0</mujoco>".to_string()), ": the text contains a zero byte");
    assert_eq!(main(String::new()).lines().count(), 1);

    let files = folder(&[("main.xml", "<mujoco><include file='big.xml'/></mujoco>")]);
    fs::File::create(files.path().join("big.xml")).unwrap().set_len(1 << 40).unwrap();
    assert!(read(&files).unwrap_err().contains("the limit is 67108864"));
    fs::write(files.path().join("big.xml"), [0xFF, 0xFE, b'<']).unwrap();
    assert!(read(&files).unwrap_err().ends_with("`big.xml` is not UTF-8 text"));
    fs::write(files.path().join("main.xml"), [0xFF]).unwrap();
    assert_eq!(read(&files).unwrap_err(), "main.xml: the file is not UTF-8 text");

    let names: Vec<String> = (0..40).map(|i| format!("{i}.xml")).collect();
    let texts: Vec<String> = (1..41).map(|i| format!("<m><include file='{i}.xml'/></m>")).collect();
    let mut chain: Vec<(&str, &str)> =
        names.iter().map(String::as_str).zip(texts.iter().map(String::as_str)).collect();
    chain.push(("main.xml", "<mujoco><include file='0.xml'/></mujoco>"));
    assert!(read(&folder(&chain)).unwrap_err().ends_with("includes are nested more than 32 deep"));
}

#[test]
fn too_many_files_are_refused() {
    let files = folder(&[]);
    let mut text = "<mujoco><asset>".to_string();
    for index in 0..2001 {
        fs::write(files.path().join(format!("{index}.obj")), "").unwrap();
        text += &format!("<mesh file='{index}.obj'/>");
    }
    fs::write(files.path().join("main.xml"), text + "</asset></mujoco>").unwrap();
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
