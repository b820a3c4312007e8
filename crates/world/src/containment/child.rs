//! The child: limits itself, reads a request, tries the model, asks for its files and answers.

use std::ffi::{CStr, c_char};
use std::io::Write;

use super::message::{Answer, ask, read_request};
use super::{Task, compiled};
use crate::WorldError;
use crate::compile::{Visuals, mjcf_of, parse};
use crate::files::{Open, prepare};

/// Processor time of a trial, s.
pub const CPU_SECONDS: u64 = 60;

/// Memory of a trial beside that of the program, GiB.
pub const MEMORY_GIB: u64 = 4;

/// Stack of the thread that tries the model. It is smaller than that of every thread that compiles
/// it later.
const STACK: usize = 1 << 20;

/// Physics steps at nominal and at random controls, each.
const STEPS: usize = 10;

/// Tries the model that the parent sends and answers it. Returns the exit code of the process.
pub fn run_child() -> u8 {
    prepare();
    limit();
    // SAFETY: no other thread runs MuJoCo in this process.
    #[allow(unsafe_code)]
    unsafe {
        mujoco_rs::mujoco_c::mju_user_error = Some(fatal);
    }
    let Some((task, xml)) = read_request(&mut std::io::stdin().lock()) else { return 2 };
    let trial = std::thread::Builder::new().stack_size(STACK).spawn(move || attempt(task, &xml));
    let Ok(Ok(result)) = trial.map(std::thread::JoinHandle::join) else { return 2 };
    answer(&Answer::of(result));
    0
}

fn attempt(task: Task, xml: &str) -> Result<(), WorldError> {
    // A parent that has ended answers no question.
    let open: &mut Open<'_> =
        &mut |name| ask(name, &mut std::io::stdin().lock(), &mut std::io::stdout().lock()).ok().flatten();
    match task {
        Task::Parse => parse(xml, open),
        Task::Read => {
            compiled(xml, Visuals::Keep, open)?;
            simulate(xml, Visuals::Discard, open)
        }
        Task::Simulate(visuals) => simulate(xml, visuals, open),
        Task::Convert => mjcf_of(xml, open).map(drop),
    }
}

/// Takes steps at nominal and at random controls, from the initial state and from each keyframe.
fn simulate(xml: &str, visuals: Visuals, open: &mut Open<'_>) -> Result<(), WorldError> {
    let model = compiled(xml, visuals, open)?;
    let mut world = model.world();
    world.reset();
    for _ in 0..STEPS {
        world.step();
    }
    let ranges: Vec<[f64; 2]> =
        (0..model.actuators()).map(|index| model.actuator_range(index).unwrap_or([-1.0, 1.0])).collect();
    let mut draw = 0.0_f64;
    world.reset();
    for _ in 0..STEPS {
        for (control, [low, high]) in world.ctrl_mut().iter_mut().zip(&ranges) {
            // Multiples of the golden ratio are spread evenly over [0, 1).
            draw = (draw + 0.618_033_988_749_895).fract();
            *control = low + draw * (high - low);
        }
        world.step();
    }
    for key in 0..model.names(crate::ElementKind::Key).len() {
        world.reset();
        world.qpos_mut().copy_from_slice(model.key_qpos(key));
        world.qvel_mut().copy_from_slice(model.key_qvel(key));
        world.step();
    }
    Ok(())
}

/// Limits memory, processor time and files of this process.
#[cfg(unix)]
fn limit() {
    use rustix::process::{Resource, Rlimit, setrlimit};
    // Memory of the program itself, in KiB, such as that of Python. Only Linux reports it and
    // limits memory.
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let own = status.lines().find_map(|line| line.strip_prefix("VmSize:")?.split_whitespace().next());
    let memory = own.and_then(|own| own.parse::<u64>().ok()).unwrap_or(0) * 1024 + (MEMORY_GIB << 30);
    let limits = [
        (Resource::As, memory),
        (Resource::Cpu, CPU_SECONDS),
        // A crash writes no image of the process, and nothing else writes a file.
        (Resource::Core, 0),
        (Resource::Fsize, 0),
        // Its input and output are open, and nothing else will be.
        (Resource::Nofile, 0),
    ];
    for (resource, limit) in limits {
        // A system that lacks one of them has the others, and the parent limits the time.
        let _ = setrlimit(resource, Rlimit { current: Some(limit), maximum: Some(limit) });
    }
}

#[cfg(not(unix))]
fn limit() {}

/// Answers with a fatal error of MuJoCo, after which no code of it may run.
extern "C" fn fatal(message: *const c_char) {
    // SAFETY: MuJoCo passes a terminated text.
    #[allow(unsafe_code)]
    let message = unsafe { CStr::from_ptr(message) }.to_string_lossy().into_owned();
    answer(&Answer::Fatal(message));
    std::process::exit(0);
}

fn answer(answer: &Answer) {
    let mut stdout = std::io::stdout().lock();
    // A parent that has ended needs no answer.
    let _ = stdout.write_all(answer.text().as_bytes()).and_then(|()| stdout.flush());
}
