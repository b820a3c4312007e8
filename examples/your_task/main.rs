//! The whole command line with your own task. See docs/guide/your_task.md.

mod cube_flipping;

fn main() -> std::process::ExitCode {
    mishandle_cli::main_with_tasks(&[&cube_flipping::CubeFlipping])
}
