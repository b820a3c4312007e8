"""Programs of the core, to compare its module with."""

import pathlib
import subprocess

ROOT = pathlib.Path(__file__).parents[2]


def example(name, *arguments):
    """Runs an example and returns what it prints. It is that of the build of all crates, which the
    Rust tests need, too."""
    subprocess.run(
        ["cargo", "build", "--quiet", "--workspace", "--example", name], cwd=ROOT, check=True
    )
    command = [ROOT / "target/debug/examples" / name, *map(str, arguments)]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout
