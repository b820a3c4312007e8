"""Files that the package writes."""

import os
import pathlib
import tempfile
from typing import Union

PathLike = Union[str, "os.PathLike[str]"]


def write_text(path: PathLike, text: str) -> pathlib.Path:
    """Writes a file and makes its folder. An existing file is replaced, and never by a part of the
    text."""
    file = pathlib.Path(path)
    file.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(
        "w", encoding="utf-8", dir=file.parent, prefix=f".{file.name}-", delete=False
    ) as part:
        part.write(text)
    try:
        # As a new file has it; that of a temporary file is private.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(part.name, 0o666 & ~mask)
        os.replace(part.name, file)
    except OSError:
        os.unlink(part.name)
        raise
    return file
