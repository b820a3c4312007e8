//! The whole command line with a task of your own; docs/your_task.md says more.

mod cube_flipping;

fn main() -> std::process::ExitCode {
    mishandle_cli::main_with_tasks(&[&cube_flipping::CubeFlipping])
}
