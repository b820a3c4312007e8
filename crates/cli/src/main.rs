//! The program `mishandle`.

fn main() -> std::process::ExitCode {
    mishandle_cli::main()
}
