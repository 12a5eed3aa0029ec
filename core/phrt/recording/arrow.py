"""pyarrow, where it is installed."""

from __future__ import annotations

from typing import Any

from phrt.errors import OptionError


def import_arrow() -> Any:
    """The module `pyarrow`, with `ipc` and `parquet`. Raises OptionError that names the extra where it is missing."""
    try:
        import pyarrow
        import pyarrow.ipc
        import pyarrow.parquet
    except ImportError as error:
        raise OptionError(f"recordings need pyarrow ({error}): pip install 'phrt[record]'") from error
    return pyarrow
