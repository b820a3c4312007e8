"""Runs the notebooks of this folder and stores their outputs: `python run.py [--check]
[NOTEBOOK...]`.

With `--check`, nothing is written. It needs the packages nbclient and ipykernel.
"""

import argparse
import pathlib
import tempfile
import time

import nbformat
from nbclient import NotebookClient

HERE = pathlib.Path(__file__).parent


def run(path: pathlib.Path, is_check: bool) -> None:
    notebook = nbformat.read(path, as_version=4)
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        # Run files and other outputs of the cells go to the folder.
        client = NotebookClient(
            notebook, timeout=300, record_timing=False, resources={"metadata": {"path": folder}}
        )
        client.execute()
    print(f"{path.name}: {time.monotonic() - started:.0f} s")
    if is_check:
        return
    # What depends on the machine that ran it.
    notebook.metadata = {
        "kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}
    }
    nbformat.validate(notebook)
    nbformat.write(notebook, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing")
    parser.add_argument("notebooks", nargs="*", type=pathlib.Path)
    arguments = parser.parse_args()
    for path in arguments.notebooks or sorted(HERE.glob("*.ipynb")):
        run(path, arguments.check)


if __name__ == "__main__":
    main()
