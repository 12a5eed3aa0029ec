"""`phrt render --replay DIR`: what is taken from the recorded run when nothing else is asked for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from phrt.cli.parsing import FrameRange
from phrt.errors import OptionError

if TYPE_CHECKING:
    from phrt.camera import CameraView
    from phrt.renderer import Renderer
    from phrt.scene import Scene


class Rerun:
    """A recorded run that is rendered again. Raises OptionError where `folder` holds none."""

    def __init__(self, folder: Path) -> None:
        from phrt.recording import Replay

        self.heuristic = Replay(folder)
        self._run = self.heuristic.run
        self._config = self._run.config

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), recorded."""
        width, height = self._config["size"]
        return width, height

    def moments(self, frames: FrameRange | None, many: bool) -> list[tuple[int, float, bool]]:
        """Number and time of `frames`, by default of all recorded ones, or of the first unless there is room for `many`; and of
        those before that their pictures came from: the third value says which are to be shown.

        Raises OptionError for frames that were not recorded.
        """
        from phrt.recording.replay import check_frames, with_those_before

        numbers = list(dict.fromkeys(self._run.numbers.tolist()))
        if frames is not None:
            chosen = list(range(frames.first, frames.stop))
        else:
            chosen = numbers if many else numbers[:1]
        if not chosen:
            raise OptionError(f"--replay '{self._run.folder}': no frame was recorded")
        check_frames(self._run, chosen)
        rendered = with_those_before(self._run, chosen)
        return [(number, self._run.frame(number)["time"], number in chosen) for number in rendered]

    def options(self, scene: Scene, given: dict[str, Any]) -> dict[str, Any]:
        """Options of `Renderer`: those that were `given`, the others as recorded. "auto", aa 1 and history count as not given."""
        from phrt.recording.replay import recorded_options

        options = recorded_options(self._config, scene)
        effects = {name: dict(values) for name, values in options["effects"].items()}
        for name, values in (given["effects"] or {}).items():
            effects.setdefault(name, {}).update(values)
        for name in ("gbuffer", "tracer"):
            if given[name] != "auto":
                options[name] = given[name]
        if given["aa"] != 1:
            options["aa"] = given["aa"]
        if not given["history"]:
            options["history"] = False
        return given | options | {"effects": effects, "heuristic": self.heuristic, "budget": "none"}

    def check(self, renderer: Renderer) -> None:
        """As `Replay.check`."""
        self.heuristic.check(renderer)

    def view(self, number: int, size: tuple[int, int]) -> CameraView:
        """Where frame `number` was seen from."""
        from phrt.recording.rows import view_of

        return view_of(self._run.frame(number)["view"], size)


def check_exclusive(given: dict[str, bool]) -> None:
    """Raises OptionError for an option that was given and contradicts `--replay`."""
    for option, is_given in given.items():
        if is_given:
            raise OptionError(f"{option} and --replay exclude each other: what is traced is as it was recorded")
