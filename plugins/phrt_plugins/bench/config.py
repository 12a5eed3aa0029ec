"""What `phrt bench` is to compare: one YAML file, checked against these models before anything is rendered.

    name: smoke
    scenes: [{scene: ../atrium.yaml, frames: "0:100"}]
    sizes: [320x180]
    budgets: [33ms, half]
    heuristics: [gain, {heuristic: selection_graph, label: stale, options: {refresh_pointers: false}}]

Everything is compared with everything: scenes x sizes x tracers x gbuffers x budgets x heuristics x repeats.
Errors name file, line and key. docs/bench.md explains every key.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer, WithJsonSchema, model_validator

from phrt.budget import parse_budget
from phrt.cli.parsing import parse_frames, parse_size
from phrt.description.fields import Described, Flag, NotNegative, Positive, Real, Text, Whole
from phrt.errors import OptionError

HALF = "half"
"""The budget that is half of the rays that tracing everything takes."""

ALL_METRICS, WALL, ALL_TRACE = "all", "wall", "all_trace"


def _size(value: Any) -> Any:
    return "x".join(map(str, _checked(parse_size, value, "a size as 640x360", "--size is ")))


def _budget(value: Any) -> Any:
    if value == HALF:
        return value
    try:
        return str(parse_budget(value))
    except OptionError as error:
        raise ValueError(f"{error}, or {HALF}") from None


def _frames(value: Any) -> Any:
    if isinstance(value, int) and not isinstance(value, bool):
        value = str(value)
    chosen = _checked(parse_frames, value, 'frames as "0:300"', "--frames is ")
    return f"{chosen.first}:{chosen.stop}"


def _checked(parse: Any, value: Any, wanted: str, prefix: str) -> Any:
    """`parse(value)`, its message without the name of a command line's option."""
    if not isinstance(value, str):
        raise ValueError(f"given {value!r}; wanted {wanted}")
    try:
        return parse(value)
    except OptionError as error:
        raise ValueError("given " + str(error).removeprefix(prefix)) from None


def _named(value: Any) -> Any:
    return {"heuristic": value} if isinstance(value, str) else value


def _placed(value: Any) -> Any:
    return {"scene": value} if isinstance(value, str) else value


def _label(value: str) -> str:
    if not re.fullmatch(r"[^\s/\\.\x00-\x1f][^/\\\x00-\x1f]{0,63}", value):
        raise ValueError(
            f"given '{value}'; a name has 1 to 64 characters without / and \\, and begins with no dot or space"
        )
    return value


Name = Annotated[Text, AfterValidator(_label)]
SizeText = Annotated[str, BeforeValidator(_size), WithJsonSchema({"type": "string"})]
BudgetOrHalf = Annotated[str, BeforeValidator(_budget), WithJsonSchema({"type": "string"})]
FramesText = Annotated[str, BeforeValidator(_frames), WithJsonSchema({"type": "string"})]
OptionsByName = dict[Text, Any]
EffectOptions = dict[Text, dict[Text, Any]]


class RayPrice(Described):
    """A clock on which only rays take time, so that decisions are the same on every machine."""

    rays: Positive = Field(100.0, lt=1e9, description="Nanoseconds that a ray takes.")


def _clock(value: Any) -> Any:
    if value in (WALL, None):
        return None
    if not isinstance(value, (dict, RayPrice)):
        raise ValueError(f"given {value!r}; allowed: wall, or {{rays: NANOSECONDS}}")
    return value


class PathTraced(Described):
    """A reference that a tracer path traces."""

    tracer: Text = Field(description="Tracer that can path trace, such as mitsuba of the package phrt-mitsuba.")
    samples: Annotated[Whole, Field(ge=1, le=1_000_000)] = Field(
        64, description="Paths a pixel. What is left of their noise is in every measure."
    )
    max_depth: Annotated[Whole, Field(ge=1, le=1000)] = Field(
        6, description="The most edges of a path from the eye to a light; 2 is direct light alone."
    )


def _reference(value: Any) -> Any:
    if value == ALL_TRACE:
        return None
    if not isinstance(value, (dict, PathTraced)):
        raise ValueError(f"given {value!r}; allowed: {ALL_TRACE}, or {{tracer: NAME}} for path tracing")
    return value


def _metrics(value: Any) -> Any:
    if value in (ALL_METRICS, None):
        return None
    if not isinstance(value, (list, tuple)) or not value:
        raise ValueError(f"given {value!r}; allowed: all, or a list of names")
    return value


def _clock_text(value: RayPrice | None) -> Any:
    return WALL if value is None else value.model_dump()


def _metrics_text(value: list[str] | None) -> Any:
    return ALL_METRICS if value is None else value


def _reference_text(value: PathTraced | None) -> Any:
    return ALL_TRACE if value is None else value.model_dump()


def _camera(value: Any) -> Any:
    whole = isinstance(value, int) and not isinstance(value, bool) and value >= 0
    if not (whole or (isinstance(value, str) and value)):
        raise ValueError(f"given {value!r}; wanted a camera's number from 0, or its path")
    return value


class SceneEntry(Described):
    """A scene and the path through it."""

    scene: Text = Field(description="Scene or model file: beside the config, or in a folder of PHRT_ASSETS.")
    name: Name | None = Field(
        None, description="What it is called in results; by default the file's name and the variant."
    )
    variant: Text | None = Field(None, description="Variant of the scene.")
    overrides: dict[Text, Any] = Field(
        default_factory=dict, description="Values of the scene, as {/World/Lamp.intensity: 3}."
    )
    camera: Annotated[int | str, BeforeValidator(_camera)] = Field(0, description="Number or path of the camera.")
    frames: FramesText | None = Field(
        None, description='Frames FIRST:STOP of the path, as "0:300"; by default the scene\'s.'
    )
    fps: Positive | None = Field(None, le=1000, description="Frames a second along the path; by default the scene's.")
    laps: Annotated[Whole, Field(ge=1, le=100_000)] = Field(
        1, description="How often the path is walked, every second time backwards; frames are counted on."
    )
    simplify: Annotated[Real, Field(gt=0, lt=1)] | None = Field(
        None, description="Share of its triangles that every mesh keeps; null for all of them."
    )
    effects: EffectOptions = Field(default_factory=dict, description="Options by effect, over the scene's.")


class HeuristicEntry(Described):
    """A contestant."""

    heuristic: Text = Field(description="Name of a heuristic plugin.")
    label: Name | None = Field(None, description="What it is called in results; by default the heuristic's name.")
    options: OptionsByName = Field(default_factory=dict, description="Options of the heuristic.")
    persistence: Annotated[NotNegative, Field(le=1e9)] | None = Field(None, description="I of the paper.")
    cost_model: Literal["measured", "paper"] = Field("measured", description="What budgets are held by.")
    group_by: Literal["object", "object_effect", "object_effect_light"] = Field(
        "object_effect", description="What is chosen."
    )
    history: Flag = Field(True, description="Values of earlier frames stand in where nothing is traced.")
    effects: EffectOptions = Field(
        default_factory=dict, description="Options by effect for this contestant alone, over the scene's entry's."
    )

    @property
    def shown(self) -> str:
        """What it is called."""
        return self.label or self.heuristic


class BenchConfig(Described):
    """A benchmark."""

    phrt_bench: Literal[1] = Field(1, description="Version of the format.")
    name: Name = Field(description="Name of the benchmark.")
    title: str = Field("", max_length=400, description="What it is for, in a line.")
    scenes: list[Annotated[SceneEntry, BeforeValidator(_placed)]] = Field(
        min_length=1, description="Scenes and paths; a file's name alone will do."
    )
    sizes: list[SizeText] = Field(default=["640x360"], min_length=1, description="Sizes of the pictures, pixels.")
    budgets: list[BudgetOrHalf] = Field(
        default=["none"],
        min_length=1,
        description="What a frame may take: 50ms, rays:20ms, 200000rays, none, or half of all-trace's rays.",
    )
    heuristics: list[Annotated[HeuristicEntry, BeforeValidator(_named)]] = Field(
        min_length=1, description="Contestants; a heuristic's name alone will do."
    )
    tracers: list[Text] = Field(default=["auto"], min_length=1, description="Tracers, or auto.")
    gbuffers: list[Text] = Field(default=["auto"], min_length=1, description="G-buffer producers, or auto.")
    clock: Annotated[RayPrice | None, BeforeValidator(_clock), PlainSerializer(_clock_text)] = Field(
        default=WALL,
        validate_default=True,
        description="wall for real time, or {rays: 100}: nanoseconds a ray, so that decisions are the same everywhere.",
    )
    repeats: Annotated[Whole, Field(ge=1, le=1000)] = Field(1, description="How often everything is run.")
    warm_up: Annotated[Whole, Field(ge=0, le=10_000)] = Field(
        10, description="Frames before every block that are rendered and not counted."
    )
    block: Annotated[Whole, Field(ge=1, le=100_000)] = Field(
        50, description="Frames after which the next contestant takes its turn; what a resumed run keeps."
    )
    threads: Annotated[Whole, Field(ge=1, le=1024)] | None = Field(None, description="By default one per usable core.")
    judge_every: Annotated[Whole, Field(ge=1, le=100_000)] = Field(
        5, description="Every how-manieth frame is compared with its reference."
    )
    metrics: Annotated[list[Text] | None, BeforeValidator(_metrics), PlainSerializer(_metrics_text)] = Field(
        default=ALL_METRICS,
        validate_default=True,
        description="Metrics by name, or all: those that ship with PHRT, and those of `plugins`.",
    )
    pictures: Annotated[Whole, Field(ge=0, le=1000)] = Field(
        3, description="Judged frames, spread over the path, that are kept as pictures."
    )
    oracle: Flag = Field(False, description="Find the best choice for every judged frame, too.")
    reference: Annotated[PathTraced | None, BeforeValidator(_reference), PlainSerializer(_reference_text)] = Field(
        default=ALL_TRACE,
        validate_default=True,
        description="What pictures are compared with: all_trace, or {tracer: mitsuba, samples: 64}, a path-traced picture.",
    )
    plugins: list[Text] = Field(
        default_factory=list, description="Plugins to use: modules, or .py files beside the config. Runs their code."
    )

    @model_validator(mode="after")
    def _told_apart(self) -> BenchConfig:
        """Nothing twice: results could not be told apart."""
        for key in ("sizes", "budgets", "tracers", "gbuffers", "plugins"):
            twice = _first_twice(getattr(self, key))
            if twice is not None:
                raise ValueError(f"{key}: '{twice}' is given twice")
        twice = _first_twice([entry.shown for entry in self.heuristics])
        if twice is not None:
            raise ValueError(f"heuristics: two are called '{twice}'; give one of them a `label`")
        return self


def _first_twice(names: list[str]) -> str | None:
    return next((name for number, name in enumerate(names) if name in names[:number]), None)
