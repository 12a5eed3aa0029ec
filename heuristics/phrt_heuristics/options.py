"""Options of the built-in heuristics."""

from __future__ import annotations

from pydantic import Field

from phrt.registry import Options


class SelectionGraphOptions(Options):
    n_pointers: int = Field(
        4,
        ge=1,
        le=1024,
        json_schema_extra={"unit": "pointers"},
        description="N: pointers of a node to more relevant nodes that cost no more",
    )
    refresh_pointers: bool = Field(
        True, description="update the pointers after every selection; off keeps those that the frame began with"
    )


class RandomOptions(Options):
    seed: int = Field(0, ge=0, lt=2**63, description="another seed, another order")


class GainOptions(Options):
    power: float = Field(
        1.0, ge=0.0, le=4.0, description="a change of twice the size at a pixel counts 2 to the power of this"
    )
    optimism: float = Field(
        1.5, ge=0.0, le=100.0, description="what was never measured is expected to change this times its effect's mean"
    )
    forget_frames: float = Field(
        60.0,
        gt=0.0,
        le=1e6,
        json_schema_extra={"unit": "frames"},
        description="frames without tracing after which a measurement counts half",
    )
    damping: float = Field(
        0.15, ge=0.0, le=10.0, description="advantage of passes that were traced in the previous frame"
    )
