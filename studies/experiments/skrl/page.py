"""The tables of studies/notebook/2026-11-22-skrl.md."""

import pathlib

PAGE = pathlib.Path(__file__).parents[2] / "notebook/2026-11-22-skrl.md"


def insert(name, text):
    """Replaces the text between the comments of that name."""
    start, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"
    before, rest = PAGE.read_text(encoding="utf-8").split(start)
    after = rest.split(end)[1]
    PAGE.write_text(f"{before}{start}\n{text}\n\n{end}{after}", encoding="utf-8")
