"""What the golden files of RTAMT in discrete and in dense time have in common."""

import json
import logging

SIGNALS = ["a", "b", "c"]


def parse(spec, text):
    """Parses a formula over the signals with a specification of RTAMT."""
    for name in SIGNALS:
        spec.declare_var(name, "float")
    spec.spec = text
    spec.parse()
    return spec


def save(path, rows):
    """Writes one row of JSON per line."""
    lines = ",\n".join(json.dumps(row, separators=(",", ":")) for row in rows)
    path.write_text(f"[\n{lines}\n]\n")


def quiet():
    """Silences the warnings of RTAMT."""
    logging.disable(logging.WARNING)
