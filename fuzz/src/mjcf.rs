//! Edits of models in MJCF. MuJoCo reads the models: a child process of the program runs it.

use std::collections::BTreeMap;

use mishandle::mjcf::{Edit, Select, Source};

/// Ends a file of an input.
const END: u8 = 0x1e;

/// The names of the files of an input after the document.
const FILES: [&str; 3] = ["a.xml", "b.xml", "m.stl"];

/// Checks the law: an edited model can be edited again, and an edit adds and removes no file.
pub fn check(bytes: &[u8]) {
    let mut parts = bytes.split(|byte| *byte == END);
    let document = String::from_utf8_lossy(parts.next().unwrap_or_default()).into_owned();
    let assets = FILES.iter().zip(parts).map(|(name, bytes)| (name.to_string(), bytes.to_vec()));
    let source = Source { document, assets: BTreeMap::from_iter(assets) };
    for edit in edits() {
        if let Ok(edited) = source.clone().edit(&[edit]) {
            assert!(edited.assets.keys().eq(source.assets.keys()));
            let again = Edit::Option { attributes: vec![("timestep".into(), "0.5".into())] };
            assert!(edited.edit(&[again]).is_ok());
        }
    }
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
