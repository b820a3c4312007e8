//! Files that MuJoCo reads though they look odd: the model is the one that it reads from the disk.

use std::path::{Path, PathBuf};

use mishandle_world::{Model, Opened, Visuals, files_of_untrusted};
use mujoco_rs::prelude::{MjData, MjModel};

use crate::containment::register;

const ARM: &str = r#"<worldbody><body name="b" pos="0 0 1"><joint name="j" axis="0 1 0"/><geom size="0.1" pos="0.3 0 0"/>
    <geom type="box" size=".1 .2 .3" contype="0" conaffinity="0"/></body></worldbody>
    <actuator><motor name="m" joint="j"/></actuator>"#;

fn model(elements: &str) -> String {
    format!("<mujoco>{elements}{ARM}</mujoco>")
}

/// Writes files into a new folder; the first one is the document.
fn folder(name: &str, files: &[(&str, &[u8])]) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("files").join(name);
    for (name, bytes) in files {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    folder
}

/// Reads the document of a folder and compiles it.
fn read(folder: &Path, document: &str) -> Model {
    register();
    let mut open = |name: &str| std::fs::read(folder.join(name)).ok();
    let files = files_of_untrusted(document, Opened::All, &mut open).unwrap();
    // It is compiled from these files alone.
    Model::from_untrusted(document, &files, Visuals::Discard).unwrap()
}

/// Checks that 20 steps have the bits of MuJoCo's own reading from the disk.
fn check(name: &str, files: &[(&str, &[u8])]) {
    let folder = folder(name, files);
    let (main, document) = files[0];
    let own = MjModel::from_xml(folder.join(main)).unwrap();
    let mut data = MjData::new(&own);
    let model = read(&folder, std::str::from_utf8(document).unwrap());
    let mut world = model.world();
    for _ in 0..20 {
        data.ctrl_mut().fill(0.1);
        data.step();
        world.ctrl_mut().fill(0.1);
        world.step();
    }
    let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert!(data.qpos().iter().any(|value| *value != 0.0), "{name}");
    assert_eq!(bits(world.qpos()), bits(data.qpos()), "{name}");
    assert_eq!(bits(world.qvel()), bits(data.qvel()), "{name}");
}

#[test]
fn odd_documents_are_the_models_that_mujoco_reads() {
    for (name, document) in [
        (
            "comment_with_a_folder",
            model("<!-- <compiler meshdir=\"../../arm\"/> <include file='../x.xml'/> -->"),
        ),
        ("comment_with_dashes", model("<!-- first -- second -->")),
        ("empty_line", format!("\n<?xml version=\"1.0\"?>\n{}", model(""))),
        ("byte_order_mark", format!("\u{feff}{}", model(""))),
        ("raw_ampersand", model("<custom><text name=\"t\" data=\"R&D\"/></custom>")),
        ("entity", model("<custom><text name=\"t\" data=\"R&amp;D &#65;\"/></custom>")),
        ("document_type", format!("<!DOCTYPE mujoco>{}", model(""))),
        ("large_size", model("<size njmax=\"5000\" nconmax=\"5000\"/>")),
        ("larger_size", model("<size njmax=\"8000\" nconmax=\"4000\"/>")),
        ("inertia_from_visual_geoms", model("<compiler inertiafromgeom=\"true\"/>")),
        ("windows_lines", model("\r\n<option timestep=\"0.004\"/>\r\n")),
    ] {
        check(name, &[("main.xml", document.as_bytes())]);
    }
}

#[test]
fn odd_files_beside_a_document_are_those_that_mujoco_reads() {
    let main = model("<include file=\"parts/options.xml\"/>");
    let latin = b"<?xml version=\"1.0\" encoding=\"ISO-8859-1\"?><m><!-- K\xf6rper --><option timestep=\"0.003\"/></m>";
    check("latin_1", &[("main.xml", main.as_bytes()), ("parts/options.xml", latin)]);
    let options =
        "\n<?xml version='1.0'?><!DOCTYPE m><m><!-- <m> -- </m> --><include file=\"more.xml\"/></m>";
    let more = ("parts/more.xml", &b"<m><option timestep='0.001'/></m>"[..]);
    check("includes", &[("main.xml", main.as_bytes()), ("parts/options.xml", options.as_bytes()), more]);

    let attached = "<mujoco><asset><model name=\"p\" file=\"parts/p.xml\"/></asset><worldbody><body name=\"base\">\
                    <attach model=\"p\" body=\"b\" prefix=\"left-\"/><attach model=\"p\" body=\"b\" prefix=\"right-\"/>\
                    </body></worldbody></mujoco>";
    let part = model("<compiler meshdir=\"m\"/><asset><mesh name=\"x\" file=\"x.obj\"/></asset>")
        .replace("type=\"box\" size=\".1 .2 .3\"", "type=\"mesh\" mesh=\"x\"");
    let mesh = b"v 0 0 0\nv .1 0 0\nv 0 .2 0\nv 0 0 .3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    check(
        "attach",
        &[("main.xml", attached.as_bytes()), ("parts/p.xml", part.as_bytes()), ("parts/m/x.obj", mesh)],
    );
}

#[test]
fn documents_that_include_each_other_without_end_are_an_error() {
    register();
    let mut open = |_: &str| Some(b"<m><include file=\"b.xml\"/></m>".to_vec());
    let files = files_of_untrusted(&model("<include file=\"a.xml\"/>"), Opened::All, &mut open);
    assert!(files.unwrap_err().to_string().starts_with("a child process tried the model"));
}

#[test]
fn a_refused_file_is_not_there() {
    register();
    let files = files_of_untrusted(&model("<include file=\"a.xml\"/>"), Opened::All, &mut |_: &str| None);
    let error = files.unwrap_err().to_string();
    assert!(error.contains("Error opening file 'a.xml'"), "{error}");
    // A requested file has the path of the document, wherever that is.
    let mut asked = Vec::new();
    for path in ["a/./b.xml", "../c.xml", "../../../d.xml", "/etc/e.xml", "x/../../f.xml"] {
        let document = model(&format!("<include file=\"{path}\"/>"));
        let mut open = |name: &str| {
            asked.push(name.to_string());
            None
        };
        assert!(files_of_untrusted(&document, Opened::Included, &mut open).is_err());
    }
    asked.dedup();
    assert_eq!(asked, ["a/b.xml", "../c.xml", "../../../d.xml", "/etc/e.xml", "../f.xml"]);
}
