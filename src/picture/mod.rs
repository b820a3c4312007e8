//! Pictures and films of simulations, and the states and full traces from which they are drawn.

mod cameras;
mod decisions;
mod example;
mod film;
mod frames;
mod full_trace;
mod policy_view;
mod ray_renderer;
mod recorded_scene;
mod recording;
mod trajectory;

pub use cameras::{CameraSettings, SeenEpisode, TargetCameras};
pub(crate) use decisions::{Decisions, RecordedController, SharedDecisions};
pub use example::ExampleSimulation;
pub use film::Film;
pub use frames::{Drawing, FrameCaptions, FrameRenderer, SeenStates};
pub use full_trace::full_trace;
pub use policy_view::{Occlusion, PatchChanges, PolicyView, policy_views};
pub use recorded_scene::{RecordedScene, SceneEpisode, recorded_scene};
pub(crate) use recording::{Recording, RecordingEnvironment, SharedRecordings};
pub use trajectory::{
    StateTrajectory, initial_state, replay_states, replay_states_with, simulate_states, strip_samples,
};
