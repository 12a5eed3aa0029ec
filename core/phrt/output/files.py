"""Output paths: checked before work starts, and replaced only by something complete."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from phrt.errors import OptionError, did_you_mean


def check_output(path: str | Path, suffixes: tuple[str, ...]) -> Path:
    """`path`, when a file can be put there. Cheap: call it before rendering.

    suffixes : the allowed ones, lower case, with the dot
    Raises OptionError for another suffix, a folder that is missing or not writable, or a path that is a folder.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in suffixes:
        given = f"'{suffix}'" if suffix else "no suffix"
        raise OptionError(
            f"cannot write '{path}': {given} is not one of {', '.join(suffixes)}.{did_you_mean(suffix, list(suffixes))}"
        )
    try:
        is_folder, has_folder = path.is_dir(), path.parent.is_dir()
    except (OSError, ValueError) as error:
        # A name that is too long, or holds a zero byte.
        raise OptionError(f"cannot write '{path}': {getattr(error, 'strerror', None) or error}") from error
    if is_folder:
        raise OptionError(f"cannot write '{path}': it is a folder")
    if not has_folder:
        raise OptionError(f"cannot write '{path}': the folder '{path.parent}' does not exist")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise OptionError(f"cannot write '{path}': no permission to write in '{path.parent}'")
    return path


def temporary_beside(path: Path) -> Path:
    """An unused hidden name in the folder of `path`, with its suffix: `os.replace` onto `path` is then atomic."""
    return path.with_name(f".{path.stem[:64]}.{secrets.token_hex(6)}{path.suffix}")


@contextmanager
def complete_file(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`, with its suffix, moved onto `path` when the block ends well and removed when it
    does not. Raises OptionError where the system refuses to write."""
    temporary = temporary_beside(path)
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise OptionError(f"cannot write '{path}': {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)
