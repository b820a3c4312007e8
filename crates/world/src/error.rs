/// The error of compiling a model, finding its elements or rendering it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorldError {
    /// MuJoCo cannot compile the MJCF document.
    #[error("MuJoCo cannot compile the model: {0}")]
    Model(String),
    /// A model of others ends or blocks MuJoCo.
    #[error(
        "a child process tried the model, and it cannot be used: {0}; simplify the model, or report this to MuJoCo"
    )]
    Hostile(String),
    /// A model of others could not be tried.
    #[error("a model of others is tried in a child process first, which failed: {0}; run the command again")]
    Untried(String),
    /// No element has this name.
    #[error("the model has no {kind} named `{name}`; known names: {}", known.join(", "))]
    Element {
        /// The kind of element.
        kind: &'static str,
        /// The given name.
        name: String,
        /// The names of all elements of this kind.
        known: Vec<String>,
    },
    /// A field of the model cannot be changed so.
    #[error("cannot change {field} of {element}: {reason}")]
    Field {
        /// MuJoCo's name of the field.
        field: &'static str,
        /// The element.
        element: String,
        /// The reason.
        reason: String,
    },
    /// The body is not a mocap body.
    #[error("body `{0}` is not a mocap body, so its pose cannot be set")]
    NotMocap(String),
    /// The vertices of the flex do not form a contiguous block of free point masses.
    #[error(
        "flex `{0}` must consist of consecutive top-level bodies, each with slide joints along x, y and z"
    )]
    UnsupportedFlex(String),
    /// A [`WorldDevice`](crate::WorldDevice) cannot make or step a batch.
    #[error("{0}")]
    Device(String),
    /// Pixels are not a picture.
    #[error("cannot encode a picture: {0}")]
    Picture(String),
    /// OpenGL is not available.
    #[error(
        "cannot render without a display: {0} (rendering needs EGL and OpenGL; on Debian and Ubuntu: apt install libegl1 \
         libgl1-mesa-dri)"
    )]
    Render(String),
    /// The program was built without the feature `render`.
    #[error("this program was built without its feature `render`")]
    NoRenderer,
}
