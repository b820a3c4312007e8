/// What can be wrong with a model.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorldError {
    /// MuJoCo does not accept the MJCF document.
    #[error("MuJoCo cannot compile the model: {0}")]
    Model(String),
    /// No element has the name asked for.
    #[error("the model has no {kind} named `{name}`; it has: {}", known.join(", "))]
    Element {
        /// Kind of element.
        kind: &'static str,
        /// The name asked for.
        name: String,
        /// The names there are.
        known: Vec<String>,
    },
    /// The body is there, but its pose cannot be set.
    #[error("body `{0}` is not a mocap body, so its pose cannot be set")]
    NotMocap(String),
    /// The flex is there, but its vertices are no plain rows.
    #[error("flex `{0}` is not made of bodies of the world in a row, each with slides along x, y and z")]
    NotFree(String),
    /// Nothing can be drawn.
    #[error(
        "no picture can be drawn without a display here: {0} (it takes EGL and OpenGL; on Debian and Ubuntu: apt install \
         libegl1 libgl1-mesa-dri)"
    )]
    Render(String),
    /// The program cannot draw.
    #[error(
        "this program was built without pictures; build it with `cargo build --release --features render`"
    )]
    NoRenderer,
}
