"""Probes: small frames along the scene's camera path, with everything traced and with one effect at a time left out.

Two frames that differ in one effect show what it changes, pixel by pixel, in the picture that people see: after the tone map.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from phrt.clock import Clock, WallClock
from phrt.frame import FrameResult
from phrt.interfaces.effect import LayerSpec
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.output.tonemap import to_8bit
from phrt.renderer import Renderer
from phrt.scene import Scene


class LeaveOut(Heuristic):
    """Traces everything but the effects in `left_out`, mandatory or not."""

    def __init__(self) -> None:
        self.left_out: frozenset[str] = frozenset()
        self._items: list[int] = []

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        out = [name in self.left_out for name in candidates.effect_names]
        kept = ~np.array(out, bool)[candidates.effect]
        self._items = np.flatnonzero(kept)[::-1].tolist()

    def next(self, remaining: float) -> int | None:
        return self._items.pop() if self._items else None


class ProbeClock(Clock):
    """Real time, without being a `WallClock`: what probes cost goes into the profile, and is not what the next run of the scene
    begins with (phrt.cost_memory)."""

    def __init__(self) -> None:
        self._clock = WallClock()

    def now_ms(self) -> float:
        return self._clock.now_ms()

    def wave(self, started_ms: float, thread_ms: np.ndarray, rays: np.ndarray) -> np.ndarray:
        return self._clock.wave(started_ms, thread_ms, rays)


@dataclass
class Findings:
    """What the probes of one situation found; N objects, row or column 0 the background; E effects.

    frames      : probes so far
    seen        : (N + 1,) int64, probes that show the object
    pixels      : (N + 1,) float64, its visible pixels, summed over probes
    area        : (N + 1,) float64, A summed over probes; visibility: V likewise
    total_change: (N + 1,) float64, sum over its pixels of what all effects together change, 0 to 1 a pixel
    effect_pixels, change, peak, rays, traced: (N + 1, E) float64: pixels the effect applies to, sum and maximum of
      what it changes at one, rays, and pixels they were traced at
    marked: (N + 1, E) float64, pixels at which its layer, traced, held anything but its clear value
    coefficients: by effect, ms_per_item and ms_per_ray
    """

    effect_names: tuple[str, ...]
    frames: int
    seen: np.ndarray
    pixels: np.ndarray
    area: np.ndarray
    visibility: np.ndarray
    total_change: np.ndarray
    effect_pixels: np.ndarray
    change: np.ndarray
    peak: np.ndarray
    rays: np.ndarray
    traced: np.ndarray
    marked: np.ndarray
    coefficients: dict[str, dict[str, float]] = field(default_factory=dict)

    def only(self, effects: np.ndarray) -> Findings:
        """Without what is said about effects that are not among `effects` (E,) bool."""
        each = ("effect_pixels", "change", "peak", "rays", "traced", "marked")
        names = tuple(name for name, kept in zip(self.effect_names, effects, strict=True) if kept)
        kept = {name: getattr(self, name)[:, effects] for name in each}
        return replace(self, effect_names=names, **kept)

    @classmethod
    def nothing(cls, objects: int, effect_names: tuple[str, ...]) -> Findings:
        def one() -> np.ndarray:
            return np.zeros(objects + 1)

        def each() -> np.ndarray:
            return np.zeros((objects + 1, len(effect_names)))

        return cls(
            effect_names, 0, np.zeros(objects + 1, np.int64), one(), one(), one(), one(), each(), each(), each(),
            each(), each(), each(),
        )  # fmt: skip


def probe_times(scene: Scene, frames: int) -> list[tuple[int, float]]:
    """(frame number, seconds) of at most `frames` of the scene's frames, spread evenly, each at the middle of its share."""
    count = min(frames, scene.settings.frames)
    numbers = [math.floor((k + 0.5) * scene.settings.frames / count) for k in range(count)]
    return [(number, number / scene.settings.fps) for number in numbers]


def probe(
    scene: Scene,
    size: tuple[int, int],
    frames: int,
    tone_map: str,
    *,
    camera: int | str = 0,
    threads: int | None = None,
    strict: bool = False,
    done: Callable[[], None] = lambda: None,
) -> Findings:
    """What `frames` probes of `scene` at `size` (width, height) find; `done` is called after each.

    Nothing is said about an effect that fails. Raises PluginError when the tracer does, and, with `strict`, any plugin.
    """
    heuristic = LeaveOut()
    clock = ProbeClock()
    with Renderer(
        scene, size=size, heuristic=heuristic, threads=threads, budget="none", clock=clock, history=False,
        strict=strict,
    ) as renderer:  # fmt: skip
        findings = Findings.nothing(len(scene.objects), tuple(effect.name for effect in renderer.effects))

        def picture(number: int, time: float, *left_out: str, count: bool = False) -> FrameResult:
            """Without some effects; the same randomness every time. count: rays item by item."""
            heuristic.left_out, renderer.measure_each = frozenset(left_out), count
            return renderer.render(time, frame_index=number, camera=camera)

        for number, time in probe_times(scene, frames):
            whole = picture(number, time, count=True)
            seen = whole.gbuffer.object_id.ravel()
            shown = _shown(whole, tone_map)
            for column, name in enumerate(findings.effect_names):
                without = _shown(picture(number, time, name), tone_map)
                _add_change(findings, column, seen, np.abs(shown - without).mean(axis=1))
            bare = _shown(picture(number, time, *findings.effect_names), tone_map)
            _add_marks(findings, whole, seen, [effect.writes for effect in renderer.effects])
            _add_sight(findings, whole, seen, np.abs(shown - bare).mean(axis=1))
            done()
        findings.coefficients = renderer.costs()
        if (lost := renderer.run.faults.tracer_failure) is not None:
            raise lost
        sound = [not renderer.run.faults.is_off(effect) for effect in renderer.effects]
    return findings if all(sound) else findings.only(np.array(sound))


def _shown(frame: FrameResult, tone_map: str) -> np.ndarray:
    """(P, 3) float32, the picture as it is shown, 0 to 1."""
    return to_8bit(frame.image, tone_map).reshape(-1, 3).astype(np.float32) / np.float32(255)


def _add_change(findings: Findings, column: int, seen: np.ndarray, changed: np.ndarray) -> None:
    """What an effect changes (P,) at pixels that show objects `seen` (P,)."""
    findings.change[:, column] += np.bincount(seen, weights=changed, minlength=len(findings.seen))
    np.maximum.at(findings.peak[:, column], seen, changed)


def _add_marks(findings: Findings, frame: FrameResult, seen: np.ndarray, writes: Sequence[LayerSpec]) -> None:
    """At how many pixels of each object the effects' layers hold something."""
    for column, layer in enumerate(writes):
        marked = (frame.layers[layer.name].reshape(len(seen), -1) != np.float32(layer.clear)).any(axis=1)
        findings.marked[:, column] += np.bincount(seen[marked], minlength=len(findings.seen))


def _add_sight(findings: Findings, frame: FrameResult, seen: np.ndarray, changed: np.ndarray) -> None:
    """How much of the objects was seen, what all effects together change (P,), and what that took."""
    count = np.bincount(seen, minlength=len(findings.seen))
    count[0] = 0
    findings.frames += 1
    findings.seen += count > 0
    findings.pixels += count
    findings.area += count / len(seen)
    findings.total_change += np.bincount(seen, weights=changed, minlength=len(findings.seen))
    work, decisions = frame.decisions.candidates, frame.decisions
    where = work.object_id, work.effect
    findings.effect_pixels[where] += work.pixel_count
    findings.rays[where] += decisions.rays
    findings.traced[where] += decisions.traced_pixels
    visibility = np.zeros(len(findings.seen))
    visibility[work.object_id] = work.visibility
    findings.visibility += visibility
