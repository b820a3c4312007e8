//! Models in MJCF and URDF, with the files that they refer to.

use mishandle::mjcf::{Edit, Select, Source};

use crate::scratch::Scratch;

/// Ends a file of an input.
const END: u8 = 0x1e;

/// The names of the files of an input.
const FILES: [&str; 4] = ["main.xml", "a.xml", "b.xml", "m.stl"];

/// Checks the laws:
/// - a model that was read refers to its files and to no others: without the rest, it reads the
///   same;
/// - a file outside the folder, which is there, is never read;
/// - an edited model can be edited again, and no edit changes the files.
pub fn check(bytes: &[u8]) {
    let folder = Scratch::new();
    folder.file("secret.xml", b"<mujoco><size memory=\"secret\"/></mujoco>");
    std::fs::create_dir(folder.path("robot")).expect("room for a temporary folder");
    for (name, bytes) in FILES.iter().zip(bytes.split(|byte| *byte == END)) {
        folder.file(&format!("robot/{name}"), bytes);
    }
    let Ok(source) = Source::read(&folder.path("robot/main.xml"), false) else { return };
    assert!(!source.document.contains("memory=\"secret\"") || bytes.windows(6).any(|text| text == b"secret"));
    // A mesh of URDF that is only seen may be missing, and found under the name of another one.
    if source.is_urdf() {
        return;
    }
    check_again(&source);
    for edit in edits() {
        if let Ok(edited) = source.clone().edit(&[edit]) {
            assert_eq!(edited.assets, source.assets);
            let again = Edit::Option { attributes: vec![("timestep".into(), "0.5".into())] };
            assert!(edited.edit(&[again]).is_ok());
        }
    }
}

fn check_again(source: &Source) {
    let folder = Scratch::new();
    for (name, bytes) in &source.assets {
        folder.file(name, bytes);
    }
    // No name of an asset is that of the main file, whose ending it lacks.
    let main = folder.file("main.mjcf", source.document.as_bytes());
    assert_eq!(&Source::read(&main, false).expect("it was read before"), source);
}

fn edits() -> Vec<Edit> {
    let attributes = |pairs: &[(&str, &str)]| {
        pairs.iter().map(|(key, value)| (key.to_string(), value.to_string())).collect::<Vec<_>>()
    };
    let set = |kind: &str, select| Edit::Set {
        kind: kind.into(),
        select,
        attributes: attributes(&[("name", "<&\"'"), ("group", "1")]),
    };
    let add = |parent: &str, xml: &str| Edit::Add { parent: parent.into(), xml: xml.into() };
    vec![
        set("joint", Select::Name(".*".into())),
        set("geom", Select::Colliding),
        set("body", Select::All),
        set("actuator", Select::Class("main".into())),
        add("world", "<body name=\"new\"/>"),
        add("arm", "<site/><!-- new -->"),
        add("default", "<default class=\"new\"/>"),
        Edit::Actuator {
            joints: ".*".into(),
            kind: "motor".into(),
            attributes: attributes(&[("gear", "2")]),
        },
        Edit::Compiler { attributes: attributes(&[("angle", "radian")]) },
    ]
}

pub fn seeds() -> Vec<Vec<u8>> {
    let inputs: [&[&str]; 8] = [
        &[
            "<mujoco><worldbody><body name='arm'><joint name=\"j\"/><geom size='1'/></body></worldbody></mujoco>",
        ],
        &[
            "<mujoco>\n<include file=\"a.xml\"/></mujoco>",
            "<mujoco><include file='b.xml'/></mujoco>",
            "<x><option/></x>",
        ],
        &["<mujoco><include file='../secret.xml'/></mujoco>"],
        &["<mujoco><compiler meshdir=\".\"/><asset><mesh file=\"m.stl\"/></asset></mujoco>", "", "", "solid"],
        &[
            "<mujoco><compiler assetdir='./' strippath='true'/><asset><texture file='q/a.xml' fileup='b.xml'/></asset></mujoco>",
        ],
        &[
            "<?xml version='1.0'?><mujoco><default><geom contype='0'/><default class='c'><geom/></default></default>\
           <worldbody><frame childclass='c'><geom class=\"main\"/></frame></worldbody><actuator/></mujoco>",
        ],
        &[
            "<robot name='r'><mujoco><compiler meshdir='x'/></mujoco><link><visual><mesh filename='package://p/m.stl'/>\
           </visual><collision><mesh filename='m.stl'/></collision></link></robot>",
            "",
            "",
            "solid",
        ],
        &[
            "<mujoco><!-- </mujoco> --><body name='arm'/><custom><text data=\"&lt;&#47;&gt;\"/></custom></mujoco>",
        ],
    ];
    inputs.iter().map(|files| files.join("\u{1e}").into_bytes()).collect()
}
