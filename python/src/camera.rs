//! Pictures of simulations.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use mishandle::rollout::{Environment, Sample, Scenario, Seed, StepStatus};
use mishandle::tasks::TaskEnvironment;
use mishandle::world::{CAMERAS, PictureModel, Quality, Renderer, Size};

/// States to draw, and where to send the pixels or an error.
type Order = (Vec<Vec<f64>>, Sender<Result<Vec<u8>, String>>);

/// Draws states of one scene on a thread of its own, because OpenGL binds a renderer to the thread
/// that created it.
pub(crate) struct Camera {
    size: Size,
    /// `None` while the camera is dropped.
    orders: Option<Sender<Order>>,
    thread: Option<JoinHandle<()>>,
    process: u32,
}

impl Camera {
    /// Creates a camera that shows everything that is in one of the `framed` states.
    pub(crate) fn new(model: PictureModel, size: Size, framed: Vec<Vec<f64>>) -> Camera {
        let (sender, orders) = channel();
        let thread = std::thread::spawn(move || draw_orders(&model, size, &framed, &orders));
        Camera { size, orders: Some(sender), thread: Some(thread), process: std::process::id() }
    }

    pub(crate) fn size(&self) -> Size {
        self.size
    }

    /// Draws states: three bytes per pixel, rows from the top, one picture after the other.
    pub(crate) fn draw(&self, states: Vec<Vec<f64>>) -> Result<Vec<u8>, String> {
        let (reply, drawn) = channel();
        let is_sent = self.orders.as_ref().is_some_and(|orders| orders.send((states, reply)).is_ok());
        let lost = || Err("the renderer ended unexpectedly".to_string());
        if is_sent { drawn.recv().unwrap_or_else(|_| lost()) } else { lost() }
    }
}

impl Drop for Camera {
    fn drop(&mut self) {
        self.orders = None;
        let Some(thread) = self.thread.take() else { return };
        // A process made by fork does not have the thread.
        if self.process == std::process::id() {
            // Nothing can be done about a renderer that panicked while it was freed.
            drop(thread.join());
        } else {
            std::mem::forget(thread);
        }
    }
}

fn draw_orders(model: &PictureModel, size: Size, framed: &[Vec<f64>], orders: &Receiver<Order>) {
    let mut renderer = Renderer::new(model, size, Quality::Fast, CAMERAS[0]);
    if let Ok(renderer) = &mut renderer {
        renderer.stage().frame(framed.iter().map(Vec::as_slice));
    }
    for (states, reply) in orders {
        let drawn = match &mut renderer {
            Err(error) => Err(error.to_string()),
            Ok(renderer) => states.iter().try_fold(Vec::new(), |mut pixels, state| {
                let picture = renderer.draw(state).map_err(|error| error.to_string())?;
                pixels.extend_from_slice(picture);
                Ok(pixels)
            }),
        };
        // The thread that ordered waits for the reply.
        let _ = reply.send(drawn);
    }
}

/// Control steps of the motions that the camera must show.
const MOTION_STEPS: usize = 30;

/// Returns states for placing a camera: the initial states at the center and at both ends of each
/// axis of the initial box, and those after half a second at full speed in both directions.
pub(crate) fn framed_states(environment: &TaskEnvironment) -> Vec<Vec<f64>> {
    let nominal = environment.space().nominal();
    let mut scenarios = vec![nominal.clone()];
    for (i, axis) in environment.space().axes().iter().enumerate() {
        for end in [axis.low, axis.high] {
            let mut values = nominal.values().to_vec();
            values[i] = Some(end);
            scenarios.push(Scenario::new(values));
        }
    }
    let moved = [-1.0, 1.0].map(|action| state_after(environment, &nominal, action, MOTION_STEPS));
    scenarios.iter().map(|start| state_after(environment, start, 0.0, 0)).chain(moved).collect()
}

/// Returns the state after some control steps with all actions equal.
fn state_after(environment: &TaskEnvironment, start: &Scenario, action: f64, steps: usize) -> Vec<f64> {
    let mut worker = environment.worker();
    let mut state = vec![0.0; environment.state_size()];
    let mut observation = vec![0.0; environment.observation_size()];
    let mut signals = vec![0.0; environment.signals().len()];
    let mut rewards = vec![0.0; environment.reward_terms().len()];
    let actions = vec![action; environment.action_size()];
    for step in 0..=steps {
        let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
        if step == 0 {
            worker.reset(start, Seed(0), &mut state, sample);
        } else if worker.step(&actions, &mut state, sample) == StepStatus::Diverged {
            break;
        }
    }
    state
}
