"""Options of the heuristic and of the metric."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from phrt.registry import Options

CHANNELS = ("intensity", "color", "orientation")


class MapOptions(Options):
    """What the map of saliency is made of."""

    map_width: int = Field(
        160, ge=16, le=1024, description="width of the picture that is looked at", json_schema_extra={"unit": "pixels"}
    )
    intensity: float = Field(1.0, ge=0.0, le=100.0, description="weight of contrasts of brightness")
    color: float = Field(1.0, ge=0.0, le=100.0, description="weight of contrasts of colour")
    orientation: float = Field(1.0, ge=0.0, le=100.0, description="weight of contrasts of direction")

    @model_validator(mode="after")
    def _something_counts(self) -> MapOptions:
        if not any(self.weights):
            raise ValueError(f"one of {', '.join(CHANNELS)} must be above 0")
        return self

    @property
    def weights(self) -> tuple[float, float, float]:
        """Of the channels, in the order of `CHANNELS`."""
        return self.intensity, self.color, self.orientation


class SaliencyOptions(MapOptions):
    weight: float = Field(
        1.0, ge=0.0, le=1.0, description="0 takes the area as it is (relevance R alone), 1 counts it in saliency alone"
    )
    place: bool = Field(True, description="P and D count, as in eq. (1); off takes the area alone, wherever it is")
    choose: Literal["levels", "ratio", "relevance"] = Field(
        "levels",
        description="parts of items by relevance for the predicted cost, whole items by that, or whole items by relevance "
        "whatever they cost",
    )
    settle_frames: float = Field(
        4.0,
        ge=0.0,
        le=1000.0,
        description="an object's saliency follows half of a change in so many frames; 0 follows at once",
        json_schema_extra={"unit": "frames"},
    )


class SaliencyErrorOptions(MapOptions):
    pass
