"""Options of the built-in heuristics."""

from __future__ import annotations

from pydantic import Field

from phrt.registry import Options


class SelectionGraphOptions(Options):
    n_pointers: int = Field(
        4, ge=1, le=1024, description="N: pointers of a node to more relevant nodes that cost no more"
    )
    refresh_pointers: bool = Field(
        True, description="update the pointers after every selection; off keeps those that the frame began with"
    )


class RandomOptions(Options):
    seed: int = Field(0, ge=0, lt=2**63, description="another seed, another order")
