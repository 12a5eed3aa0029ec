"""`phrt render`: a scene into pictures, a video or EXR layers."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from phrt.budget import parse_budget
from phrt.cli.console import DelayedProgress, say, terminal, warn_of
from phrt.cli.options import (
    DebugOption,
    JsonOption,
    PluginOption,
    QuietOption,
    SceneArgument,
    StrictOption,
    check_plugins,
)
from phrt.cli.parsing import (
    FrameRange,
    check_number,
    parse_camera,
    parse_controls,
    parse_effects,
    parse_frames,
    parse_heuristic_options,
    parse_size,
)
from phrt.cli.rerun import Rerun, check_exclusive
from phrt.errors import OptionError, SceneError
from phrt.registry.auto import DEFAULT_HEURISTIC

if TYPE_CHECKING:
    from phrt.frame import FrameResult
    from phrt.scene import Scene

DEFAULT_SIZE = (1280, 720)
DEFAULT_TONE_MAP = "neutral"


@dataclass(frozen=True)
class Moment:
    """One frame to render: its number, its time in seconds, and whether it is written."""

    index: int
    time: float
    shown: bool = True


def render(
    scene: SceneArgument,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="OUT", help=".png, .exr, .mp4, or a pattern as frame_%04d.png.")
    ],
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Pixels; the scene's size, or 1280x720 (in Python 640x360).")
    ] = None,
    heuristic: Annotated[
        str | None, typer.Option(help=f"Who decides what is traced; the scene's, or {DEFAULT_HEURISTIC}.")
    ] = None,
    heuristic_option: Annotated[
        list[str] | None,
        typer.Option("-H", "--heuristic-option", metavar="OPTION=VALUE", help="Option of the heuristic, as seed=3."),
    ] = None,
    budget: Annotated[
        str | None,
        typer.Option(
            metavar="BUDGET",
            help="What a frame may take: 50ms (all of it), rays:20ms (its ray phase), 200000rays, or none; the scene's track's.",
        ),
    ] = None,
    cost_model: Annotated[
        str, typer.Option(help="What budgets are held by: measured (rays and their time) or paper (one price for C).")
    ] = "measured",
    group_by: Annotated[
        str, typer.Option(help="What is chosen: object, object_effect or object_effect_light.")
    ] = "object_effect",
    persistence: Annotated[
        float | None, typer.Option(help="How much having been traced in the previous frame counts: I of the paper.")
    ] = None,
    profile: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="What `phrt analyze` found: importance, effects to leave out, costs. Without it: what the scene says.",
        ),
    ] = None,
    attention: Annotated[
        list[str] | None,
        typer.Option(metavar="TAG=FACTOR", help="What is looked for: objects with this tag count more. Repeatable."),
    ] = None,
    view_speed: Annotated[
        float | None, typer.Option(help="How much movement in the picture lowers visibility; 0 not at all.")
    ] = None,
    parameter: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="External parameter for heuristics that know it. Repeatable."),
    ] = None,
    frames: Annotated[
        str | None, typer.Option(metavar="A:B", help="Frames A to B - 1, or one frame; all of them for a video.")
    ] = None,
    time: Annotated[float | None, typer.Option(help="The moment of a single picture, seconds.")] = None,
    camera: Annotated[str, typer.Option(help="Number or path of the camera.")] = "0",
    situation: Annotated[
        str | None,
        typer.Option("--situation", "--variant", help="Variant of the scene, or of its importance maps, as night."),
    ] = None,
    gbuffer: Annotated[
        str, typer.Option(help="G-buffer producer; auto takes moderngl on a GPU, else raycast.")
    ] = "auto",
    tracer: Annotated[str, typer.Option(help="Tracer; auto takes the fastest that is available.")] = "auto",
    threads: Annotated[int | None, typer.Option(help="Threads; all cores when not given.")] = None,
    aa: Annotated[int, typer.Option("--aa", help="Samples per pixel; 1 to 1024.")] = 1,
    history: Annotated[
        bool,
        typer.Option("--history/--no-history", help="Values of earlier frames stand in where nothing is traced."),
    ] = True,
    tone_map: Annotated[str | None, typer.Option(help="srgb, aces or neutral; the scene's, or neutral.")] = None,
    exposure: Annotated[float | None, typer.Option(help="Factor on the light of the picture.")] = None,
    layers: Annotated[Path | None, typer.Option(metavar="DIR", help="Also write every layer into this folder.")] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME.OPTION=VALUE", help="Option of an effect, as shadows.samples=4. Repeatable."),
    ] = None,
    record: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Record every frame and every choice into this folder.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a run that --record finds in DIR.")] = False,
    overlay: Annotated[
        bool, typer.Option("--overlay", help="Tint the pictures by what was traced, with names and the budget.")
    ] = False,
    overlay_effect: Annotated[
        str | None, typer.Option(metavar="NAME", help="The overlay of one effect alone, as shadows.")
    ] = None,
    replay: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Render again with the decisions recorded in this folder.")
    ] = None,
    strict: StrictOption = False,
    define: Annotated[
        list[str] | None,
        typer.Option(
            "-D",
            metavar="/PRIM.KEY=VALUE",
            help="Override a value of the scene, as /World/Lamp.intensity=3 or exposure=2. Repeatable.",
        ),
    ] = None,
    plugin: PluginOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Render SCENE into a picture, a sequence, a video or EXR layers."""
    check_plugins(strict)
    # What can be wrong without reading the scene is said before reading it.
    limit = None if budget is None else parse_budget(budget, "--budget")
    controls = parse_controls(attention or [], view_speed, parameter or [])
    decides = parse_heuristic_options(heuristic_option or [])
    if persistence is not None:
        check_number("--persistence", persistence, 0, 1e9)
    options = parse_effects(effect or [])
    given_size = None if size is None else parse_size(size)
    given_frames = None if frames is None else parse_frames(frames)
    check_arguments(threads, aa, time, exposure, given_frames)
    tint = overlay_effect or ("all" if overlay else None)
    check_record(record, overwrite, replay)
    rerun = None
    if replay is not None:
        asked = {
            "--heuristic": bool(heuristic),
            "-H": bool(decides),
            "--budget": budget not in (None, "none"),
            "--time": time is not None,
        }
        check_exclusive(asked)
        rerun = Rerun(replay)

    from phrt.cli.writers import is_pattern, is_video, open_writer
    from phrt.clock import RecordingClock, WallClock
    from phrt.description.seen import lacking
    from phrt.overlay import chosen_effects
    from phrt.recording import Recorder
    from phrt.renderer import Renderer

    with DelayedProgress(1, f"loading {scene.name}"):
        loaded = load_in_situation(scene, define, situation, controls)
        warn_of(lacking(loaded))
        settings = loaded.settings
        if exposure is not None:
            settings.exposure = exposure
        width_height = given_size or (rerun.size if rerun else settings.size) or DEFAULT_SIZE
        if rerun:
            moments = [Moment(*each) for each in rerun.moments(given_frames, is_video(output) or is_pattern(output))]
        else:
            moments = choose_moments(loaded, given_frames, time, is_video(output))
        curve = tone_map or settings.tone_map or DEFAULT_TONE_MAP
        shown = sum(moment.shown for moment in moments)
        writer = open_writer(output, shown, width_height, settings.fps, curve, layers, tint)

    chosen: dict[str, Any] = {
        "heuristic": heuristic or settings.heuristic or DEFAULT_HEURISTIC,
        "heuristic_options": decides or None,
        "budget": limit,
        "persistence": persistence,
        "profile": profile,
        "cost_model": cost_model,
        "group_by": group_by,
        "strict": strict,
        "gbuffer": gbuffer,
        "tracer": tracer,
        "threads": threads,
        "effects": options or None,
        "aa": aa,
        "history": history,
    }
    if rerun:
        chosen = rerun.options(loaded, chosen)
    if record is not None:
        chosen["clock"] = RecordingClock(WallClock())
    with (
        writer,
        DelayedProgress(len(moments), first_step()) as progress,
        Renderer(loaded, size=width_height, **chosen) as renderer,
        ExitStack() as recording,
    ):
        renderer.control(**controls)
        if tint is not None:
            chosen_effects([effect.name for effect in renderer.effects], tint)
        if rerun:
            rerun.check(renderer)
        recorder = None
        if record is not None:
            kept = {"output": output, "frames": frames, "camera": camera, "tone_map": curve, "overrides": define or []}
            recorder = recording.enter_context(Recorder(record, renderer, settings=kept, overwrite=overwrite))
        rows: list[dict[str, Any]] = []
        for moment in moments:
            if rows:
                progress.step(f"rendering frame {moment.index}")
            seen = rerun.view(moment.index, width_height) if rerun and camera == "0" else parse_camera(camera)
            frame = renderer.render(moment.time, frame_index=moment.index, camera=seen)
            progress.advance()
            if not moment.shown:
                continue
            if recorder is not None:
                recorder.add(frame)
            writer.add(moment.index, frame)
            rows.append(frame_row(moment, frame))
    report(rows, [str(path) for path in writer.files], output, width_height, as_json, record)


def load_in_situation(
    path: Path, define: list[str] | None, situation: str | None, controls: dict[str, object]
) -> Scene:
    """The scene as variant `situation`; where it has none of that name but its importance maps know it, the plain scene, and
    `controls` select the situation."""
    from phrt.controls import known_situations
    from phrt.loading import load_scene

    try:
        return load_scene(path, overrides=define, variant=situation)
    except SceneError:
        if situation is None:
            raise
        plain = load_scene(path, overrides=define)
        if situation in plain.situations or situation not in known_situations(plain):
            raise
        controls["situation"] = situation
        return plain


def check_arguments(
    threads: int | None, aa: int, time: float | None, exposure: float | None, frames: FrameRange | None
) -> None:
    """OptionError where a number is out of its range, or two options exclude each other."""
    check_number("--aa", aa, 1, 1024)
    if threads is not None:
        check_number("--threads", threads, 1, 1024)
    if exposure is not None:
        check_number("--exposure", exposure, 0, 1e9)
    if time is not None:
        check_number("--time", time, -1e6, 1e6)
        if frames is not None:
            raise OptionError("--time and --frames exclude each other: a frame's time is its number / the scene's fps")


def check_record(record: Path | None, overwrite: bool, replay: Path | None) -> None:
    """OptionError where nothing can be recorded: said before anything is rendered."""
    if record is None:
        if overwrite:
            raise OptionError("--overwrite is for --record, which was not given")
        return
    from phrt.recording.recorder import check_recording

    if replay is not None and record.resolve() == replay.resolve():
        raise OptionError(f"--record and --replay both name '{record}': the run would be overwritten while it is read")
    check_recording(record, overwrite=overwrite)


def first_step() -> str:
    """What the first frame waits for."""
    from phrt.cli.doctor import kernel_cache

    cold = kernel_cache()["kernels"] == 0
    return "compiling kernels, once; this takes up to a minute" if cold else "rendering"


def choose_moments(scene: Scene, frames: FrameRange | None, time: float | None, video: bool) -> list[Moment]:
    """The frames to render: those asked for, else all of a video, else the first."""
    fps = scene.settings.fps
    if time is not None:
        return [Moment(max(0, round(time * fps)), time)]
    chosen = frames or FrameRange(0, scene.settings.frames if video else 1)
    return [Moment(index, index / fps) for index in range(chosen.first, chosen.stop)]


def frame_row(moment: Moment, frame: FrameResult) -> dict[str, Any]:
    """What is reported of a frame, as plain data."""
    return {
        "index": moment.index,
        "time": moment.time,
        "milliseconds": round(float(frame.milliseconds), 3),
        "stages": {name: round(float(spent), 3) for name, spent in frame.stages.items()},
        "rays": {name: int(count) for name, count in frame.rays.items()},
    }


def report(
    rows: list[dict[str, Any]],
    files: list[str],
    output: Path,
    size: tuple[int, int],
    as_json: bool,
    record: Path | None = None,
) -> None:
    """Say what was written: one JSON object on standard output, or a line or two on standard error."""
    if as_json:
        recorded = {} if record is None else {"record": str(record)}
        print(json.dumps({"files": files, "size": list(size), "frames": rows, "warnings": terminal.warned} | recorded))
        return
    spent = sum(row["milliseconds"] for row in rows)
    rays = sum(sum(row["rays"].values()) for row in rows)
    count = f"{len(rows)} frames, " if len(rows) > 1 else ""
    say(f"{output}: {size[0]}x{size[1]}, {count}{spent:.0f} ms, {rays:,} rays")
    if len(rows) == 1:
        say("  " + ", ".join(f"{name} {milliseconds:.1f} ms" for name, milliseconds in rows[0]["stages"].items()))
    if len(files) > 1:
        say(f"  {len(files)} files")
    if record is not None:
        say(f"  recorded in {record}")
