"""The package is tested as it lies here, installed or not: its folder is put on the path, and its plugins are registered."""

from __future__ import annotations

import sys
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]
if str(PACKAGE) not in sys.path:
    sys.path.insert(0, str(PACKAGE))

import phrt  # noqa: E402
from phrt.registry import get_registry  # noqa: E402

if not any(entry.name == "saliency" for entry in get_registry().plugins("heuristic")):
    import phrt_saliency.plugin

    phrt.register(phrt_saliency.plugin)
