"""Reading and writing files: whole or not at all, and JSON documents that say what they are."""

import hashlib
import json
import os
import secrets
import shutil
from pathlib import Path
from typing import Any

LARGEST = 1 << 27
"""Bytes of a file that is read."""


class FormatError(ValueError):
    """A file is not what it should be."""


def require_path(path: Any) -> None:
    """Refuse what names no file, such as the number of an open one."""
    if not isinstance(path, str | os.PathLike) or not os.fspath(path):
        raise TypeError(f"path must be a str or a pathlib.Path that names a file, not {path!r:.50}")


def write_bytes(path: str | os.PathLike[str], content: bytes) -> Path:
    """Write a file whole or not at all: into a temporary file beside it, then renamed."""
    require_path(path)
    place = Path(os.path.realpath(path))  # a link stays a link
    if not place.parent.is_dir():
        raise FileNotFoundError(f"there is no folder {str(place.parent)!r} to write {place.name} into; create it first")
    if place.exists() and not place.is_file():  # a device or a pipe can't be replaced
        place.write_bytes(content)
        return Path(path)
    temporary = place.with_name(f".{secrets.token_hex(8)}.part")
    try:
        with open(temporary, "xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        if place.exists():
            shutil.copymode(place, temporary)
        os.replace(temporary, place)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return Path(path)


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write a text as UTF-8, whole or not at all."""
    return write_bytes(path, text.encode())


def write_document(path: str | os.PathLike[str], kind: str, version: int, content: dict[str, Any]) -> Path:
    """Write a JSON document headed by its kind and version, sealed by the sha256 of all of it."""
    document = {"format": f"switchctl {kind}", "version": version, **content}
    return write_json(path, document | {"sha256": digest(document)})


def write_json(path: str | os.PathLike[str], document: dict[str, Any]) -> Path:
    """Write a JSON object, one key a line."""
    lines = ",\n".join(f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in document.items())
    if len(lines) > LARGEST:
        raise ValueError(
            f"{path} would take {len(lines)} bytes; of more than {LARGEST} it could not be read again. Pickle it"
        )
    return write_text(path, f"{{\n{lines}\n}}\n")


def read_json(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a JSON object of which no key comes twice."""
    require_path(path)
    with open(path, "rb") as file:
        content = file.read(LARGEST + 1)
    if len(content) > LARGEST:
        raise FormatError(f"{path} has more than {LARGEST} bytes; larger files are not read")
    try:
        document = json.loads(content.decode(), object_pairs_hook=_once)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path} is not a JSON file: {error}; mend it, or take another copy") from None
    if not isinstance(document, dict):
        raise FormatError(f"{path} holds a JSON {type(document).__name__}; expected an object")
    return document


def read_document(path: str | os.PathLike[str], kind: str, version: int) -> dict[str, Any]:
    """Read a JSON document of the given kind and version."""
    document = read_json(path)
    if document.get("format") != f"switchctl {kind}":
        raise FormatError(f"{path} is not a switchctl {kind}: its format is {document.get('format')!r:.50}")
    if document.get("version") != version:
        raise FormatError(
            f"{path} has version {document.get('version')!r:.50} of the {kind} format; this switchctl reads {version}. "
            "Make it anew"
        )
    return document


def read_sealed(path: str | os.PathLike[str], kind: str, version: int) -> dict[str, Any]:
    """Read a JSON document that is as `write_document` wrote it."""
    document = read_document(path, kind, version)
    told = document.get("sha256")
    try:
        found = digest({key: value for key, value in document.items() if key != "sha256"})
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path} is not a JSON file: {error}; mend it, or take another copy") from None
    if told != found:
        raise FormatError(
            f"{path} was changed after it was written: its sha256 is not that of its content. "
            "Take another copy, or make it anew"
        )
    return document


def digest(document: dict[str, Any]) -> str:
    """The sha256 of a document."""
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    document = dict(pairs)
    if len(document) < len(pairs):
        twice = next(key for i, (key, _) in enumerate(pairs) if key in dict(pairs[:i]))
        raise ValueError(f"the key {twice!r:.50} comes twice")
    return document
