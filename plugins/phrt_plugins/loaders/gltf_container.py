"""The outside of a glTF file: GLB chunks, and URIs, which name data inside the file or a file beside it."""

from __future__ import annotations

import base64
import binascii
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, unquote_to_bytes

from phrt.errors import AssetError
from phrt.interfaces.loader import MAX_FILE_BYTES, LoadContext
from phrt_plugins.loaders.gltf_json import fail

GLB_MAGIC = b"glTF"
JSON_CHUNK, BIN_CHUNK = 0x4E4F534A, 0x004E4942
SCHEME = re.compile(r"^[A-Za-z][A-Za-z0-9+.\-]+:")


@dataclass(frozen=True)
class Container:
    """json: the glTF text. binary: the GLB's BIN chunk, None where it has none. is_glb: whether it was a GLB."""

    json: bytes
    binary: bytes | None
    is_glb: bool


def read_bytes(path: Path) -> bytes:
    """The bytes of a file no larger than MAX_FILE_BYTES."""
    try:
        if not path.is_file():
            raise AssetError(f"{path}: {'is not a file' if path.exists() else 'does not exist'}")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise AssetError(f"{path}: is larger than {MAX_FILE_BYTES // 2**20} MiB, the most a loader reads")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        raise AssetError(f"{path}: cannot be read: {error}") from None


def read_container(path: Path, warn: Callable[[str], None]) -> Container:
    """A .glb by its magic number (whatever its name says), otherwise the text of a .gltf."""
    data = read_bytes(path)
    if path.suffix.lower() == ".glb" or data[:4] == GLB_MAGIC:
        return parse_glb(data, warn)
    if data.startswith(b"\xef\xbb\xbf"):
        warn("starts with a byte order mark, which glTF forbids; it is ignored")
        data = data[3:]
    return Container(data, None, False)


def parse_glb(data: bytes, warn: Callable[[str], None]) -> Container:
    """The chunks of a GLB. Raises AssetError for a wrong header, a chunk past the end, or chunks in the wrong order."""
    if len(data) < 12:
        fail("GLB header", f"is cut short: the file has {len(data)} bytes")
    magic, version, length = struct.unpack_from("<4sII", data)
    if magic != GLB_MAGIC:
        fail("GLB header", f"starts with {magic!r}, not {GLB_MAGIC!r}")
    if version != 2:
        fail("GLB header", f"is version {version}; only version 2 (glTF 2.0) is read")
    if length > len(data):
        fail("GLB header", f"says {length} bytes, but the file is truncated at {len(data)}")
    if length < 20:
        fail("GLB header", f"says {length} bytes in all, too few for a JSON chunk")
    if length < len(data):
        warn(f"has {len(data) - length} bytes after the end of the GLB, which are ignored")
    chunks = _chunks(data, length)
    if not chunks or chunks[0][0] != JSON_CHUNK:
        fail("GLB", "the first chunk is not JSON")
    return Container(chunks[0][1], _binary_chunk(chunks[1:], warn), True)


def _chunks(data: bytes, length: int) -> list[tuple[int, bytes]]:
    chunks: list[tuple[int, bytes]] = []
    at = 12
    while at < length:
        where = f"GLB chunk {len(chunks)}"
        if at + 8 > length:
            fail(where, "has a truncated header")
        size, kind = struct.unpack_from("<II", data, at)
        if size % 4:
            fail(where, f"is {size} bytes long; chunks are a multiple of 4")
        if at + 8 + size > length:
            fail(where, f"is {size} bytes long, but only {length - at - 8} are left")
        # Only the two kinds that are read are copied.
        chunks.append((kind, data[at + 8 : at + 8 + size] if kind in (JSON_CHUNK, BIN_CHUNK) else b""))
        at += 8 + size
    return chunks


def _binary_chunk(rest: list[tuple[int, bytes]], warn: Callable[[str], None]) -> bytes | None:
    for number, (kind, _) in enumerate(rest, start=1):
        if kind == JSON_CHUNK:
            fail(f"GLB chunk {number}", "is a second JSON chunk")
        if kind == BIN_CHUNK and number > 1:
            fail(f"GLB chunk {number}", "is binary data where only the second chunk may be")
        if kind != BIN_CHUNK:
            warn(f"GLB chunk {number} of unknown kind 0x{kind:08x} is ignored")
    return rest[0][1] if rest and rest[0][0] == BIN_CHUNK else None


def is_data_uri(uri: str) -> bool:
    return uri[:5].lower() == "data:"


def decode_data_uri(uri: str, where: str) -> bytes:
    """The bytes of a data URI, base64 or percent-encoded."""
    head, comma, body = uri.partition(",")
    if not comma:
        fail(where, "is a data URI without data")
    if not head.lower().endswith(";base64"):
        return unquote_to_bytes(body)
    body = unquote(body) if "%" in body else body
    try:
        return base64.b64decode(body + "=" * (-len(body) % 4), validate=True)
    except (binascii.Error, ValueError) as error:
        fail(where, f"is a data URI with broken base64: {error}")


def check_uri(uri: str, where: str) -> None:
    """Refuse everything but data URIs and relative references: PHRT fetches nothing."""
    for text in (uri, unquote(uri)):
        if is_data_uri(uri):
            return
        if SCHEME.match(text):
            fail(
                where,
                f"'{shorten(text)}' has the scheme '{text.split(':')[0]}:'; "
                "only relative file names and data: URIs are read",
            )
        if text.startswith(("//", "\\\\")):
            fail(where, f"'{shorten(text)}' names another machine; only relative file names and data: URIs are read")
        if not text or text.startswith(":") or any(ord(character) < 32 for character in text):
            fail(where, f"{shorten(text)!r} is not a file name")


def resolve_uri(uri: str, where: str, context: LoadContext) -> Path:
    """The file a relative URI names: percent-decoded, else literally, else with backslashes as separators."""
    check_uri(uri, where)
    decoded = unquote(uri)
    first: AssetError | None = None
    for reference in dict.fromkeys((decoded, uri, decoded.replace("\\", "/"))):
        try:
            return context.resolve(reference)
        except AssetError as error:
            first = first or error
        except (OSError, ValueError) as error:
            first = first or AssetError(f"'{shorten(reference)}' cannot be opened: {error}")
    raise AssetError(f"{where}: {first}") from None


def stays_beside(uri: str) -> bool:
    """Does a relative URI name something in the file's own folder or below? Failing to resolve then means: missing."""
    depth = 0
    reference = unquote(uri).replace("\\", "/")
    for part in PurePosixPath(reference).parts:
        depth += -1 if part == ".." else 1
        if depth < 0 or part == "/":
            return False
    return not re.match(r"^[A-Za-z]:", reference)


def shorten(text: str, length: int = 80) -> str:
    """`text` for a message: printable and not too long."""
    text = text.encode("utf-8", "replace").decode("utf-8")
    return text if len(text) <= length else text[: length - 3] + "..."
