//! Edits change what they name and nothing else.

use std::collections::BTreeMap;

use mishandle_robots::mjcf::{Edit, Select, Source};
use mishandle_world::{ElementKind, Model, ModelField};

const ARM: &str = r#"<?xml version="1.0"?>
<mujoco model="arm">
  <compiler angle="radian"/>
  <!-- <joint name="no"/> -->
  <default>
    <geom contype="0" conaffinity="0"/>
    <default class="limb"><joint damping="0.50" armature="0.1"/>
      <default class="skin"><geom contype="1"/></default>
      <default class="inner"><geom conaffinity="1"/><joint armature="7"/></default>
    </default>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1" contype="1"/>
    <body name="upper" childclass="limb">
      <body name="lower"><joint name="elbow" axis="0 1 0"/><geom name="shin" size="0.1" class="skin"/>
        <frame childclass="inner"><geom name="core" size="0.1"/></frame><geom name="seen" size="0.1"/></body>
      <joint name='shoulder' axis="0 1 0" armature='.3'/><geom size="0.1"/>
    </body>
    <body name="loose"><freejoint name="float"/><geom name="pebble" size="0.1"/></body>
    <body name="tray"/>
  </worldbody>
  <equality><joint joint1="elbow" joint2="shoulder"/></equality>
</mujoco>
"#;

fn source() -> Source {
    Source { document: ARM.to_string(), assets: BTreeMap::new() }
}

fn pairs(attributes: &[(&str, &str)]) -> Vec<(String, String)> {
    attributes.iter().map(|(key, value)| (key.to_string(), value.to_string())).collect()
}

fn set(kind: &str, select: Select, attributes: &[(&str, &str)]) -> Edit {
    Edit::Set { kind: kind.into(), select, attributes: pairs(attributes) }
}

fn named(pattern: &str) -> Select {
    Select::Name(pattern.to_string())
}

fn add(parent: &str, xml: &str) -> Edit {
    Edit::Add { parent: parent.into(), xml: xml.into() }
}

fn actuator(joints: &str, kind: &str, attributes: &[(&str, &str)]) -> Edit {
    Edit::Actuator { joints: joints.into(), kind: kind.into(), attributes: pairs(attributes) }
}

fn edited(edits: &[Edit]) -> String {
    source().edit(edits).unwrap().document
}

fn error(edit: Edit) -> String {
    source().edit(&[edit]).unwrap_err().to_string()
}

fn model(edits: &[Edit]) -> Model {
    Model::from_xml(&edited(edits)).unwrap()
}

#[test]
fn no_edit_changes_no_byte() {
    assert_eq!(edited(&[]), ARM);
}

#[test]
fn attributes_are_replaced_where_they_are_or_inserted_behind_the_name() {
    let text = edited(&[set("joint", named("elbow|shoulder"), &[("armature", "0.004026312")])]);
    let expected = ARM
        .replace("<joint name=\"elbow\"", "<joint armature=\"0.004026312\" name=\"elbow\"")
        .replace("armature='.3'", "armature=\"0.004026312\"");
    assert_eq!(text, expected);
}

#[test]
fn an_attribute_of_an_element_wins_over_its_class() {
    let model = model(&[set("joint", named("elbow"), &[("armature", "2")])]);
    let armature = |name: &str| {
        let row = model.field_rows(ModelField::DofArmature, model.find(ElementKind::Joint, name).unwrap());
        model.field(ModelField::DofArmature)[row.start]
    };
    assert_eq!((armature("elbow"), armature("shoulder")), (2.0, 0.3));
}

#[test]
fn a_pattern_matches_whole_names() {
    for pattern in ["elb", "lbow", "elbow|shoul", "(?i)ELBO"] {
        let found = source().edit(&[set("joint", named(pattern), &[("damping", "1")])]);
        let is_alternative = pattern.contains('|');
        assert_eq!(found.is_ok(), is_alternative, "{pattern}");
        if let Ok(found) = found {
            assert_eq!(found.document.matches("damping=\"1\"").count(), 1);
        }
    }
    assert!(error(set("joint", named("a)|(b"), &[])).starts_with("`a)|(b` is not a regular expression"));
    assert!(error(set("joint", named("(a{1000}){1000}"), &[])).contains("not a regular expression"));
}

#[test]
fn geoms_collide_by_their_own_attributes_or_their_class() {
    let text = edited(&[set("geom", Select::Colliding, &[("group", "5")])]);
    let changed = |name: &str| text.contains(&format!("<geom group=\"5\" name=\"{name}\""));
    let found: Vec<bool> = ["floor", "shin", "core", "seen", "pebble"].map(changed).to_vec();
    assert_eq!(found, [true, true, true, false, false]);
    // As MuJoCo resolves them.
    let model = Model::from_xml(ARM).unwrap();
    assert_eq!(model.names(ElementKind::Geom).iter().filter(|name| name.is_empty()).count(), 1);
    assert_eq!(
        error(set("joint", Select::Colliding, &[])),
        "only geoms collide; a joint cannot be selected so"
    );
}

#[test]
fn classes_are_resolved_as_mujoco_resolves_them() {
    let world =
        "<worldbody><geom name=\"a\" size=\"1\"/><geom name=\"b\" class=\"x\" size=\"1\"/></worldbody>";
    for (defaults, collide) in [
        // An inner class has what its outer class has when it is made.
        ("<default><default class='x'/><geom contype='0' conaffinity='0'/></default>", vec![]),
        (
            "<default><default class='x'/></default><default><geom contype='0' conaffinity='0'/></default>",
            vec!["b"],
        ),
        (
            "<default><geom contype='0' conaffinity='0'/></default><default><default class='x'/></default>",
            vec![],
        ),
        (
            "<default class='main'><default class='x'><geom contype=' 0 ' conaffinity='+0'/></default></default>",
            vec!["a"],
        ),
    ] {
        let document = format!("<mujoco>{defaults}{world}</mujoco>");
        let source = Source { document, assets: BTreeMap::new() };
        let edited = source.edit(&[set("geom", Select::Colliding, &[("mass", "3")])]);
        let found: Vec<String> = match edited {
            Ok(source) => {
                let document = roxmltree::Document::parse(&source.document).unwrap();
                let changed = document.descendants().filter(|node| node.attribute("mass") == Some("3"));
                changed.map(|node| node.attribute("name").unwrap().to_string()).collect()
            }
            Err(_) => Vec::new(),
        };
        assert_eq!(found, collide, "{defaults}");
    }
}

/// Numbers in 0..n: the top bits of a multiplicative congruential generator.
fn below(n: usize, state: &mut u64) -> usize {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    ((*state >> 33) as usize) % n
}

#[test]
fn no_text_makes_an_edit_panic_or_write_invalid_xml() {
    const TOKENS: [&str; 14] = [
        "<",
        ">",
        "/",
        "\"",
        "'",
        "=",
        "<body>",
        "</body>",
        "/>",
        "<!--",
        "-->",
        "<joint name=\"elbow\"/>",
        "é",
        " ",
    ];
    let edits = [
        set("joint", named("elbow"), &[("damping", "1")]),
        set("geom", Select::Colliding, &[("group", "1")]),
        add("lower", "<site/>"),
        add("world", "<geom/>"),
        actuator(".*", "motor", &[]),
        Edit::Option { attributes: pairs(&[("timestep", "0.001")]) },
    ];
    let mut state = 1;
    let mut changed = 0;
    for _ in 0..20_000 {
        let mut text = ARM.to_string();
        for _ in 0..=below(3, &mut state) {
            let places: Vec<usize> = text.char_indices().map(|(at, _)| at).collect();
            let at = places[below(places.len(), &mut state)];
            let end = places[below(places.len(), &mut state)].clamp(at, (at + 40).min(text.len()));
            let end = (end..=text.len()).find(|end| text.is_char_boundary(*end)).unwrap();
            let token = TOKENS[below(TOKENS.len(), &mut state)];
            text.replace_range(at..if below(2, &mut state) == 0 { at } else { end }, token);
        }
        // MuJoCo reads more than XML, and so do edits.
        let is_xml = roxmltree::Document::parse(&text).is_ok();
        let source = Source { document: text, assets: BTreeMap::new() };
        let edit = &edits[below(edits.len(), &mut state)];
        let Ok(edited) = source.edit(std::slice::from_ref(edit)) else { continue };
        if is_xml {
            roxmltree::Document::parse(&edited.document).unwrap();
            changed += 1;
        }
        edited.edit(&[Edit::Option { attributes: pairs(&[("timestep", "0.5")]) }]).unwrap();
    }
    assert!(changed > 1_000, "only {changed} texts were edited");
}

#[test]
fn elements_of_a_class_are_those_that_have_or_inherit_it() {
    let text = edited(&[set("joint", Select::Class("limb".into()), &[("frictionloss", "1")])]);
    assert_eq!(text.matches("frictionloss").count(), 2);
    let text = edited(&[set("geom", Select::Class("inner".into()), &[("group", "1")])]);
    assert!(text.contains("<geom group=\"1\" name=\"core\""));
    assert_eq!(
        error(set("geom", Select::Class("skim".into()), &[])),
        "no geom has the class `skim`; did you mean `skin`? known names: inner, limb, main, skin"
    );
}

#[test]
fn all_elements_of_a_kind_without_defaults_and_references() {
    let text = edited(&[set("joint", Select::All, &[("group", "2")])]);
    assert_eq!(text.matches("<joint group=\"2\"").count(), 2);
    let text = edited(&[set("equality", Select::All, &[("active", "false")])]);
    assert!(text.contains("<joint active=\"false\" joint1"));
    assert_eq!(error(set("light", Select::All, &[])), "the model has no element `light`");
}

#[test]
fn actuators_follow_the_order_of_the_joints_in_mujoco() {
    let edits = [actuator(".*", "position", &[("kp", "25"), ("ctrlrange", "-1 1")])];
    let text = edited(&edits);
    let expected = "<actuator><position name=\"shoulder\" joint=\"shoulder\" kp=\"25\" ctrlrange=\"-1 1\"/>\
                    <position name=\"elbow\" joint=\"elbow\" kp=\"25\" ctrlrange=\"-1 1\"/></actuator></mujoco>";
    assert!(text.trim_end().ends_with(expected), "{text}");
    let model = Model::from_xml(&text).unwrap();
    assert_eq!(model.names(ElementKind::Joint), ["shoulder", "elbow", "float"]);
    assert_eq!(model.names(ElementKind::Actuator), ["shoulder", "elbow"]);
    assert_eq!(model.actuator_joint(1), Some(1));
    // A second edit appends to the section, and may change what the first one made.
    let more = [
        actuator("elbow", "motor", &[]),
        actuator("should.*", "velocity", &[("kv", "2")]),
        set("actuator", named("elbow"), &[("forcerange", "-3 3")]),
    ];
    let text = edited(&more);
    assert!(
        text.contains(
            "<motor forcerange=\"-3 3\" name=\"elbow\" joint=\"elbow\"/><velocity name=\"shoulder\""
        )
    );
    let twice = source().edit(&[edits[0].clone(), actuator("elbow", "motor", &[])]).unwrap_err();
    assert_eq!(twice.to_string(), "the model has an actuator `elbow` already");
    assert_eq!(
        error(actuator("elbow", "positon", &[])),
        "no kind of actuator is `positon`; did you mean `position`? known names: motor, position, velocity, \
         intvelocity, damper, cylinder, muscle, general"
    );
}

#[test]
fn elements_are_added_to_bodies_the_world_and_sections() {
    let model = model(&[
        add("lower", "<site name=\"tool\" pos=\"0 0 0.1\"/>\n<geom name=\"hand\" size=\"0.02\"/>"),
        add("tray", "<geom name=\"plate\" size=\"0.1\"/>"),
        add("world", "<body name=\"post\"><geom size=\"0.1\"/></body>"),
        add("sensor", "<framepos name=\"where\" objtype=\"site\" objname=\"tool\"/>"),
        add("sensor", "<jointpos name=\"angle\" joint=\"elbow\"/>"),
        add("default", "<default class=\"new\"><geom contype=\"3\"/></default>"),
        add("world", "<geom name=\"late\" class=\"new\" size=\"0.1\"/>"),
        add("keyframe", "<key name=\"home\" ctrl=\"\"/>"),
        add("contact", "<exclude body1=\"upper\" body2=\"lower\"/>"),
    ]);
    assert_eq!(
        model.body_of_geom(model.find(ElementKind::Geom, "hand").unwrap()),
        model.body("lower").unwrap()
    );
    assert_eq!(
        model.body_of_geom(model.find(ElementKind::Geom, "plate").unwrap()),
        model.body("tray").unwrap()
    );
    assert_eq!(model.names(ElementKind::Sensor), ["where", "angle"]);
    assert_eq!(model.names(ElementKind::Body).last().unwrap(), "post");
    assert_eq!(model.names(ElementKind::Key), ["home"]);
}

#[test]
fn options_and_the_compiler_are_set_in_their_last_section() {
    let edits = [
        Edit::Option { attributes: pairs(&[("timestep", "0.004"), ("integrator", "implicitfast")]) },
        Edit::Option { attributes: pairs(&[("timestep", "0.001")]) },
        Edit::Compiler { attributes: pairs(&[("angle", "degree"), ("autolimits", "true")]) },
    ];
    let text = edited(&edits);
    assert!(text.contains("<compiler autolimits=\"true\" angle=\"degree\"/>"), "{text}");
    assert!(text.contains("<option timestep=\"0.001\" integrator=\"implicitfast\"/></mujoco>"), "{text}");
    assert_eq!(Model::from_xml(&text).unwrap().timestep(), 0.001);
    assert_eq!(
        error(Edit::Compiler { attributes: pairs(&[("meshdir", "/etc")]) }),
        "`meshdir` cannot be set; the files of the model have been read"
    );
}

#[test]
fn what_matches_nothing_is_an_error_with_the_nearest_names() {
    assert_eq!(
        error(set("joint", named("elbw"), &[])),
        "no joint matches `elbw`; did you mean `elbow`? known names: elbow, shoulder"
    );
    assert_eq!(
        error(actuator("knee.*", "motor", &[])),
        "no joint matches `knee.*`; known names: shoulder, elbow"
    );
    assert_eq!(
        error(add("lowr", "<site/>")),
        "no body has the name `lowr`; did you mean `lower`? known names: upper, lower, loose, tray, world, asset, \
         contact, sensor, equality, default, keyframe, tendon, actuator"
    );
    assert_eq!(error(set("tendon", named("x"), &[])), "the model has no element `tendon`");
}

#[test]
fn values_are_text_and_never_markup() {
    for value in ["\"/><plugin/>", "<a>", "a & b", "x\ny", "'"] {
        let text = edited(&[set("body", named("tray"), &[("user", value)])]);
        let document = roxmltree::Document::parse(&text).unwrap();
        let tray = document.descendants().find(|node| node.attribute("name") == Some("tray")).unwrap();
        assert_eq!(tray.attribute("user"), Some(value));
        assert_eq!(
            document.descendants().count(),
            roxmltree::Document::parse(ARM).unwrap().descendants().count()
        );
    }
    for key in ["", "a b", "x=\"1\" y", "1x", "a>"] {
        assert!(error(set("body", Select::All, &[(key, "1")])).contains("is not the name of an attribute"));
    }
    assert!(error(set("body", Select::All, &[("a", "\u{1}")])).contains("control character"));
    assert!(error(set("body", Select::All, &[("a", "1"), ("a", "2")])).contains("is set twice"));
}

#[test]
fn fragments_that_are_no_elements_or_reach_further_are_refused() {
    let check = |xml: &str, expected: &str| {
        let message = error(add("world", xml));
        assert!(message.contains(expected), "{xml}: {message}");
    };
    check("</worldbody><plugin/><worldbody>", "not valid XML");
    check("</fragment><fragment>", "not valid XML");
    check("<!-- only -->", "has no element");
    check("<!--", "not valid XML");
    check("<geom/> text", "has text between");
    check("\n<body><plugin/></body>", "line 2: plugins run code");
    check("<include file='/etc/passwd'/>", "includes are not possible here");
    check("<compiler meshdir='/'/>", "a compiler cannot be added");
    check("<!DOCTYPE a><a/>", "");
    assert!(error(set("mesh", Select::All, &[("file", "x")])).contains("`file` cannot be set"));
}

#[test]
fn urdf_is_converted_before_it_is_edited() {
    let urdf = Source { document: "<robot><link name='a'/></robot>".to_string(), assets: BTreeMap::new() };
    assert!(urdf.clone().edit(&[]).is_ok());
    let error = urdf.edit(&[add("world", "<geom/>")]).unwrap_err().to_string();
    assert_eq!(error, "only MJCF can be edited; convert the URDF to MJCF before");
}

#[test]
fn an_edit_changes_no_byte_outside_what_it_replaces() {
    // Every line that has no match stays, whatever its spacing and numbers.
    let edits = [
        set("geom", named("shin"), &[("size", "0.3")]),
        set("joint", named("shoulder"), &[("damping", "1e-3")]),
        add("tray", "<site/>"),
        actuator("elbow", "motor", &[]),
    ];
    let text = edited(&edits);
    let changed: Vec<&str> = ARM.lines().filter(|line| !text.lines().any(|other| other == *line)).collect();
    let names = ["shin", "shoulder", "tray", "</mujoco>"];
    assert_eq!(changed.len(), names.len(), "{changed:?}");
    assert!(names.iter().zip(changed).all(|(name, line)| line.contains(name)));
}

#[test]
fn an_edit_changes_the_file_that_an_element_is_from_and_no_other() {
    let main = "<mujoco><!-- <joint name='no'/> -- --><include file='sub/a.xml'/><!DOCTYPE x><worldbody><body \
                childclass='limb'><include file='sub/b.xml'/></body></worldbody></mujoco>";
    let a = "<m><default><default class='limb'><geom contype='0' conaffinity='0'/></default></default></m>";
    let b = "<m>\n<joint name='j' armature='.10'/><geom name='g & h' size='1'/></m>";
    let assets =
        [("sub/a.xml", a), ("sub/b.xml", b)].map(|(name, text)| (name.to_string(), text.as_bytes().to_vec()));
    let source = Source { document: main.to_string(), assets: BTreeMap::from(assets) };
    let edited = source.clone().edit(&[
        set("joint", Select::Class("limb".to_string()), &[("armature", "2")]),
        set("geom", Select::All, &[("group", "5")]),
        actuator("j", "motor", &[]),
    ]);
    let edited = edited.unwrap();
    assert_eq!(edited.assets["sub/a.xml"], source.assets["sub/a.xml"]);
    let expected = b.replace("armature='.10'", "armature=\"2\"").replace("<geom", "<geom group=\"5\"");
    assert_eq!(String::from_utf8_lossy(&edited.assets["sub/b.xml"]), expected);
    assert!(
        edited.document.contains("<actuator><motor name=\"j\" joint=\"j\"/></actuator></mujoco>"),
        "{}",
        edited.document
    );
    // The first geom collides by no class.
    let error = source.edit(&[set("geom", Select::Colliding, &[("group", "5")])]).unwrap_err();
    assert_eq!(error.to_string(), "no geom collides");
}
