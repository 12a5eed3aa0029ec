"""`phrt analyze`: a scene into a profile - what its objects gain from rays, and what that takes."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from phrt.cli.console import DelayedProgress, say, terminal
from phrt.cli.options import (
    DebugOption,
    JsonOption,
    PluginOption,
    QuietOption,
    SceneArgument,
    StrictOption,
    check_plugins,
)
from phrt.cli.parsing import check_number, parse_camera, parse_size
from phrt.errors import OptionError, PhrtWarning, ProfileError

if TYPE_CHECKING:
    from phrt.profile import Profile
    from phrt.profile_edits import Decision
    from phrt.scene import Scene

PROBE_WIDTH = 160
MOST_PROBES = 10_000
_NAMED = 5


def analyze(
    scene: SceneArgument,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="PROFILE", help="The profile; SCENE.profile.yaml beside the scene."),
    ] = None,
    frames: Annotated[int, typer.Option(help="Probes a situation, spread over the scene's frames.")] = 12,
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Pixels of a probe; 160 wide, as high as the scene's picture.")
    ] = None,
    situation: Annotated[
        list[str] | None,
        typer.Option("--situation", "--variant", help="Variant of the scene to look at; all of them. Repeatable."),
    ] = None,
    camera: Annotated[str, typer.Option(help="Number or path of the camera.")] = "0",
    tone_map: Annotated[
        str | None, typer.Option(help="Curve that changes are measured after; the scene's, or neutral.")
    ] = None,
    threads: Annotated[int | None, typer.Option(help="Threads; all cores when not given.")] = None,
    define: Annotated[
        list[str] | None,
        typer.Option("-D", metavar="/PRIM.KEY=VALUE", help="Override a value of the scene. Repeatable."),
    ] = None,
    strict: StrictOption = False,
    plugin: PluginOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Look at SCENE in small probe frames, and write a profile: per object how much it gains from ray tracing, effects that
    change nothing and need not be traced, and how many rays and how much time effects take.

    The profile is text. Values that you change in it are kept when you analyse again. `phrt render --profile` and
    `Renderer(profile=...)` use it; without one, importance is what the scene says, nothing is ruled out but by the scene,
    and costs are learnt from the first frames.
    """
    check_plugins(strict)
    # What can be wrong without reading the scene is said before reading it.
    check_number("--frames", frames, 1, MOST_PROBES)
    if threads is not None:
        check_number("--threads", threads, 1, 1024)
    given_size = None if size is None else parse_size(size)

    from phrt.analysis.analyze import ProbeOptions
    from phrt.analysis.analyze import analyze as analyzed
    from phrt.loading import load_scene
    from phrt.output.files import check_output
    from phrt.output.tonemap import curve_code
    from phrt.profile_edits import with_decisions
    from phrt.profile_text import write_profile

    target = output or scene.with_name(f"{scene.stem}.profile.yaml")
    with DelayedProgress(1, f"loading {scene.name}"):
        plain = load_scene(scene, overrides=define)
    before = existing(check_output(target, (".yaml", ".yml")), plain)
    situations = chosen_situations(situation, plain)
    curve = tone_map or plain.settings.tone_map or "neutral"
    curve_code(curve)
    options = ProbeOptions(frames, given_size or probe_size(plain), curve, parse_camera(camera), threads, strict)

    with DelayedProgress(len(situations) * min(frames, plain.settings.frames), "probing") as progress:

        def done(name: str) -> None:
            progress.step(f"probing {name}")
            progress.advance()

        profile = analyzed(lambda name: load_scene(scene, overrides=define, variant=name), situations, options, done)
    if not any(found.seen for found in profile.measured.values()):
        warnings.warn(f"{scene}: no probe shows an object; the profile says what rules say", PhrtWarning, stacklevel=2)
    profile, kept = (profile, []) if before is None else with_decisions(profile, before)
    write_profile(target, profile)
    report(target, profile, kept, as_json)


def probe_size(scene: Scene) -> tuple[int, int]:
    """As wide as probes are, in the proportions of the scene's picture."""
    width, height = scene.settings.size or (16, 9)
    return PROBE_WIDTH, max(1, min(round(PROBE_WIDTH * height / width), 16 * PROBE_WIDTH))


def chosen_situations(asked: list[str] | None, scene: Scene) -> list[str]:
    """Those asked for, each one of the scene's variants; all of them, the plain one first, where none is."""
    from phrt.controls import checked_situation

    known = list(scene.situations)
    return list(dict.fromkeys(checked_situation(name, known) for name in asked)) if asked else known


def existing(path: Path, scene: Scene) -> Profile | None:
    """The profile that is there already, whose decisions are kept. Raises OptionError where they cannot be: what is there is
    never thrown away."""
    from phrt.profile import read_profile

    if not path.exists():
        return None
    try:
        found = read_profile(path)
    except ProfileError as error:
        raise OptionError(f"{error}. It is left as it is: move it away, or name another file with -o") from None
    if scene.objects and not {entry.path for entry in scene.objects} & {*found.measured, *found.objects}:
        raise OptionError(
            f"{path}: is the profile of scene '{found.scene.name}', and none of its objects is in '{scene.name}'. "
            "It is left as it is: name another file with -o"
        )
    return found


def report(path: Path, profile: Profile, kept: list[Decision], as_json: bool) -> None:
    """Say what was written: one JSON object on standard output, or a few lines on standard error."""
    probes = profile.probes.frames * len(profile.probes.situations)
    ruled_out = sum(len(found.effects) for found in profile.measured.values())
    decided = [f"{decision.path} {decision.value}" for decision in kept]
    if as_json:
        print(
            json.dumps(
                {
                    "file": str(path),
                    "scene": profile.scene.name,
                    "objects": len(profile.measured),
                    "situations": profile.probes.situations,
                    "probes": probes,
                    "ruled_out": ruled_out,
                    "kept": decided,
                    "warnings": terminal.warned,
                }
            )
        )
        return
    say(f"{path}: {len(profile.measured)} objects in {probes} probes ({', '.join(profile.probes.situations)})")
    if ruled_out:
        say(f"  effects ruled out because they change nothing: {ruled_out}, over all objects")
    if decided:
        more = f" and {len(decided) - _NAMED} more" if len(decided) > _NAMED else ""
        say(f"  kept what was decided by hand: {', '.join(decided[:_NAMED])}{more}")
