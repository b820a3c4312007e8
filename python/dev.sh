#!/usr/bin/env bash
# Builds the Python module, installs it into the virtual environment target/python-venv, and runs its tests.
set -euo pipefail
cd "$(dirname "$0")/.."
# They would override the instruction set and library paths of .cargo/config.toml.
unset RUSTFLAGS CARGO_ENCODED_RUSTFLAGS CARGO_TARGET_DIR

export VIRTUAL_ENV="$PWD/target/python-venv"
if [ ! -x "$VIRTUAL_ENV/bin/maturin" ]; then
    python3 -m venv --clear "$VIRTUAL_ENV"
    "$VIRTUAL_ENV/bin/python" -m pip install --quiet --disable-pip-version-check "maturin>=1.16,<2" numpy
fi
cargo xtask mujoco
"$VIRTUAL_ENV/bin/maturin" develop --quiet --manifest-path python/Cargo.toml
"$VIRTUAL_ENV/bin/python" python/tests/vector_env.py "$@"
