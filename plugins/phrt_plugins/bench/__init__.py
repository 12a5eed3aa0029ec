"""The comparison of heuristics: `phrt bench`, and `compare` for Python. docs/bench.md is its manual."""

from __future__ import annotations
