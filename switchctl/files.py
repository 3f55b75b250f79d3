"""Reading and writing JSON documents that say what they are."""

import json
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any


class FormatError(ValueError):
    """A file is not what it should be."""


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write a file whole or not at all: into a temporary file beside it, then renamed."""
    place = Path(os.path.realpath(path))  # a link stays a link
    if not place.parent.is_dir():
        raise FileNotFoundError(f"there is no folder {str(place.parent)!r} to write {place.name} into; create it first")
    if place.exists() and not place.is_file():  # a device or a pipe can't be replaced
        place.write_text(text, encoding="utf-8", newline="")
        return Path(path)
    handle, temporary = tempfile.mkstemp(dir=place.parent, suffix=".part")
    try:
        with open(handle, "w", encoding="utf-8", newline="") as file:
            file.write(text)
        if place.exists():
            shutil.copymode(place, temporary)
        else:
            mask = os.umask(0)
            os.umask(mask)
            os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, place)
    except BaseException:
        os.unlink(temporary)
        raise
    return Path(path)


def write_document(path: str | os.PathLike[str], kind: str, version: int, content: dict[str, Any]) -> Path:
    """Write a JSON document headed by its kind and version."""
    document = {"format": f"switchctl {kind}", "version": version, **content}
    return write_text(path, json.dumps(document, indent=1, allow_nan=False) + "\n")


def read_json(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a JSON object."""
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path} is not a JSON file: {error}") from None
    if not isinstance(document, dict):
        raise FormatError(f"{path} holds a JSON {type(document).__name__}; expected an object")
    return document


def read_document(path: str | os.PathLike[str], kind: str, version: int) -> dict[str, Any]:
    """Read a JSON document of the given kind and version."""
    document = read_json(path)
    if document.get("format") != f"switchctl {kind}":
        raise FormatError(f"{path} is not a switchctl {kind}: its format is {document.get('format')!r}")
    if document.get("version") != version:
        raise FormatError(
            f"{path} has version {document.get('version')!r} of the {kind} format; this switchctl reads {version}"
        )
    return document
