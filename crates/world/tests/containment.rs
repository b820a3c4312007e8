//! Models that would end this process, and models that are as before.

use std::sync::{Arc, Once};

use mishandle_world::{
    Assets, Model, Visuals, WorldError, mjcf_of_untrusted_urdf, run_child, set_child_program,
};

/// Flag by which this program knows that it is the child.
const CHILD: &str = "--show-output";

/// The child: this program, started again with the name of this test. Without the flag, it tests
/// nothing.
#[test]
fn the_child() {
    if std::env::args().any(|argument| argument == CHILD) {
        std::process::exit(run_child().into());
    }
}

pub fn register() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let program = std::env::current_exe().unwrap().into();
        let arguments = ["--exact", "containment::the_child", "--nocapture", CHILD].map(Into::into);
        set_child_program([program].into_iter().chain(arguments).collect());
    });
}

fn error(xml: &str) -> WorldError {
    register();
    Model::from_untrusted(xml, &Assets::new(), Visuals::Discard).unwrap_err()
}

const PENDULUM: &str = r#"<mujoco><worldbody><body><joint name="j" type="hinge" axis="0 1 0"/>
    <geom size="0.1" pos="0 0 0.5"/></body></worldbody>
    <actuator><motor joint="j"/></actuator><keyframe><key qpos="0.2"/></keyframe></mujoco>"#;

#[test]
fn a_sound_model_is_as_without_a_child() {
    register();
    let state = |model: Model| {
        let mut world = model.world();
        world.qpos_mut()[0] = 0.3;
        (0..100).for_each(|_| world.step());
        (world.qpos()[0].to_bits(), world.qvel()[0].to_bits())
    };
    let tried = Model::from_untrusted(PENDULUM, &Assets::new(), Visuals::Discard).unwrap();
    assert_eq!(state(tried), state(Model::from_xml(PENDULUM).unwrap()));
}

#[test]
fn a_mistake_has_the_message_of_mujoco() {
    let xml = PENDULUM.replace("size=\"0.1\"", "size=\"big\"");
    assert_eq!(error(&xml).to_string(), Model::from_xml(&xml).unwrap_err().to_string());
}

#[test]
fn memory_that_no_machine_has_is_an_error() {
    let with = |memory: &str| {
        let size = format!("<size memory=\"{memory}\"/><worldbody>");
        error(&PENDULUM.replace("<worldbody>", &size)).to_string()
    };
    assert!(with("2G").contains("it has 2048 MiB"), "{}", with("2G"));
    assert!(with("900G").contains("Could not allocate memory"), "{}", with("900G"));
    // A height field of 80 GB.
    let field =
        "<asset><hfield name=\"h\" nrow=\"100000\" ncol=\"100000\" size=\"1 1 1 1\"/></asset><worldbody>";
    let message = error(&PENDULUM.replace("<worldbody>", field)).to_string();
    assert!(message.contains("memory") || message.contains("alloc"), "{message}");
}

#[test]
fn an_arena_without_space_is_enlarged() {
    register();
    // A step needs the arena for these contacts. MuJoCo ends the process if it is full.
    let boxes: String = (0..6)
        .map(|i| {
            format!(
                "<body pos=\"0 0 {}\"><freejoint/><geom type=\"box\" size=\".1 .1 .1\"/></body>",
                0.19 * f64::from(i)
            )
        })
        .collect();
    let xml = format!(
        "<mujoco><size memory=\"16K\"/><worldbody><geom type=\"plane\" size=\"1 1 1\"/>{boxes}</worldbody></mujoco>"
    );
    let model = Model::from_untrusted(&xml, &Assets::new(), Visuals::Discard).unwrap();
    let mut world = model.world();
    (0..20).for_each(|_| world.step());
    assert!(world.qpos().iter().all(|value| value.is_finite()));
}

#[test]
fn a_urdf_is_converted_as_without_a_child() {
    register();
    let urdf = "<robot name=\"r\"><link name=\"a\"/><link name=\"b\"><inertial><mass value=\"1\"/>\
        <inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial></link>\
        <joint name=\"j\" type=\"continuous\"><parent link=\"a\"/><child link=\"b\"/></joint></robot>";
    let none = Assets::new();
    assert_eq!(
        mjcf_of_untrusted_urdf(urdf, &none).unwrap(),
        mishandle_world::mjcf_of_urdf(urdf, &none).unwrap()
    );
}

#[cfg(feature = "render")]
#[test]
fn a_picture_of_a_model_that_no_machine_can_hold_is_an_error() {
    use mishandle_world::{PictureModel, Quality, Renderer, Size};
    register();
    let field =
        "<asset><hfield name=\"h\" nrow=\"100000\" ncol=\"100000\" size=\"1 1 1 1\"/></asset><worldbody>";
    let picture = PictureModel::from_untrusted(PENDULUM.replace("<worldbody>", field), Arc::default());
    let made = Renderer::new(&picture, Size::new(64, 64).unwrap(), Quality::Fast, "auto");
    let message = made.err().unwrap().to_string();
    assert!(message.starts_with("a child process tried the model"), "{message}");
}
