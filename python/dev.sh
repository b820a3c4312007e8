#!/usr/bin/env bash
# Builds the Python package, installs it into the virtual environment target/python-venv, checks its types and runs its
# tests. With --all it then installs large packages, and runs the tests that need them or minutes (GPU kernels on the
# CPU, Ray, Warp, ONNX Runtime) and the notebooks. With other arguments, which are those of unittest, it checks the types
# and runs the named tests only.
set -euo pipefail
cd "$(dirname "$0")/.."
# They would override the instruction set and library paths of .cargo/config.toml.
unset RUSTFLAGS CARGO_ENCODED_RUSTFLAGS CARGO_TARGET_DIR

large=(test_gpu.py test_ray.py test_fronts.py notebooks test_gpu_cameras.py test_gpu_probe.py test_gpu_verdicts.py
    test_onnx.py test_onnx_policies.py test_controller_format.py test_seeing.py)
all=
if [ "${1-}" = --all ]; then
    all=yes
    shift
fi

export root="$PWD" tests="$PWD/python/tests" VIRTUAL_ENV="$PWD/target/python-venv"
python="$VIRTUAL_ENV/bin/python"
install() {
    "$python" -m pip install --quiet --disable-pip-version-check "$@"
}
# Installs a file of requirements unless the environment has it. The peers are clients and servers of others, to test
# ours against; their other requirements are not needed, and one excludes NumPy 2.
require() {
    local stamp="$VIRTUAL_ENV/$1"
    cmp --silent "$tests/$1" "$stamp" && return
    [ "$1" != requirements.txt ] || python3 -m venv --clear "$VIRTUAL_ENV"
    install --requirement "$tests/$1"
    [ "$1" != requirements.txt ] || install --no-deps openpi-client==0.1.2 vla-eval==0.8.0
    cp "$tests/$1" "$stamp"
}
require requirements.txt
cargo xtask mujoco
cargo xtask results
PATH="$VIRTUAL_ENV/bin:$PATH" maturin develop --quiet
# In another folder, so that the tests import the installed package.
cd "$VIRTUAL_ENV"
check_types() { (cd "$root" && "$VIRTUAL_ENV/bin/mypy" --strict python/mishandle); }
if [ $# -gt 0 ]; then
    [ -z "$all" ] || require requirements-all.txt
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
# Runs what standard input names, one process for each, as many at a time as there are cores.
run() {
    xargs -P "$(nproc)" -I{} bash -c '
        if log=$(check "$1" 2>&1); then
            echo "$1: $(grep "^Ran " <<< "$log" || echo passed)"
        else
            printf "%s\n%s\n" "$1" "$log" >&2
            exit 1
        fi' _ {}
}
# The longest first. The usual tests come before the large packages, which they must not need.
usual() {
    echo types
    (cd "$tests" && ls -S test_*.py) | grep --invert-match --line-regexp --fixed-strings "$(printf "%s\n" "${large[@]}")"
}
usual | run
if [ "$all" ]; then
    require requirements-all.txt
    MISHANDLE_TEST_ALL=1 run < <(printf "%s\n" "${large[@]}" test_docs.py)
fi
