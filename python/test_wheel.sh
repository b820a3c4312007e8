#!/usr/bin/env bash
# Builds the release wheel in a copy of the clone, removes the copy, installs the wheel into a fresh virtual environment in
# another folder, and uses it there beside the package `mujoco`, imported before and after it. With `--keep FOLDER`, the wheel
# and the virtual environment stay in FOLDER.
set -euo pipefail
cd "$(dirname "$0")/.."
if [ "${1:-}" = "--keep" ]; then
    mkdir -p "$2"
    folder="$(cd "$2" && pwd)"
else
    folder="$(mktemp -d)"
    trap 'rm -rf "$folder"' EXIT
fi

rm -rf "$folder/clone" "$folder/wheel" "$folder/venv"
git clone --quiet . "$folder/clone"
mkdir -p target
# Compiled dependencies are shared; the crates of the copy have paths of their own.
ln -s "$PWD/target" "$folder/clone/target"
(cd "$folder/clone" && python3 -m pip wheel . --no-deps --quiet --wheel-dir "$folder/wheel")
rm -rf "$folder/clone"

python3 -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check "$folder"/wheel/*.whl "mujoco>=3.1"
cp python/tests/wheel.py "$folder"
cd "$folder"
for order in "mujoco mishandle" "mishandle mujoco"; do
    venv/bin/python wheel.py $order
done
ls -l wheel
