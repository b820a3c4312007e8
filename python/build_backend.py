"""Builds the package with maturin, after it has downloaded MuJoCo's library and written the classes
of results."""

import os
import pathlib
import platform
import subprocess
from typing import Any

import maturin
from maturin import get_requires_for_build_editable as get_requires_for_build_editable
from maturin import get_requires_for_build_sdist as get_requires_for_build_sdist
from maturin import get_requires_for_build_wheel as get_requires_for_build_wheel
from maturin import prepare_metadata_for_build_wheel as prepare_metadata_for_build_wheel

ROOT = pathlib.Path(__file__).resolve().parent.parent

# They would override the instruction set and the library path of .cargo/config.toml.
OVERRIDES = ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_TARGET_DIR"]


def build_wheel(directory: str, settings: Any = None, metadata: str | None = None) -> str:
    prepare()
    # maturin renames MuJoCo's library in cargo's own output, and fails on a renamed one. Without
    # this file, cargo links again.
    for linked in (ROOT / "target/release/deps").glob("libmishandle_python*.so"):
        linked.unlink()
    return maturin.build_wheel(directory, settings, metadata)


def build_editable(directory: str, settings: Any = None, metadata: str | None = None) -> str:
    prepare()
    return maturin.build_editable(directory, settings, metadata)


def build_sdist(directory: str, settings: Any = None) -> str:
    raise RuntimeError(
        "a source distribution is not supported; build a wheel from a clone of the repository"
    )


def prepare() -> None:
    # With the tag of this machine's C library, maturin copies MuJoCo's library into the wheel,
    # under another name.
    major, minor = platform.libc_ver()[1].split(".")[:2]
    os.environ.setdefault("MATURIN_PEP517_ARGS", f"--compatibility manylinux_{major}_{minor}")
    for name in OVERRIDES:
        os.environ.pop(name, None)
    # The chores `mujoco` and `results` of xtask, in the profile of the wheel, which needs most of
    # their crates anyway.
    for package in [
        ["xtask", "--", "mujoco"],
        ["mishandle-results", "--features", "schema", "--example", "generate"],
    ]:
        command = ["cargo", "run", "--quiet", "--release", "--package", *package]
        subprocess.run(command, cwd=ROOT, check=True)
