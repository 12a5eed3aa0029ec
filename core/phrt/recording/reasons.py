"""Why an item was traced or not, in a sentence, from what a run recorded."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from phrt.errors import OptionError, did_you_mean
from phrt.recording.run import Run, spans

Items = dict[str, np.ndarray]
"""Rows of one frame's candidates, arrays (n,) by column."""


@dataclass(frozen=True)
class Explanation:
    """effect: of the item; sentence: why; item: its row of `Items`, None where the object had no such item in the frame."""

    effect: str
    sentence: str
    item: int | None


def find_object(run: Run, given: str) -> str:
    """The path of the recorded object that `given` names: its path, or the end of it, upper or lower case, if that is unique.

    Raises OptionError with what is near.
    """
    paths = [str(entry["path"]) for entry in run.config["scene"]["objects"]]
    if given in paths:
        return given
    ending = "/" + given.strip("/").lower()
    found = [path for path in paths if path.lower().endswith(ending)]
    if len(found) == 1:
        return found[0]
    if found:
        raise OptionError(f"'{given}' is ambiguous: {some(found)}")
    parts = {path.rpartition("/")[2].lower(): path for path in paths}
    # A name without its folders is compared with names, a path with paths.
    near = did_you_mean(given.lower(), list(parts)) if "/" not in given else did_you_mean(given, paths)
    raise OptionError(f"'{run.folder}' has no object '{given}'. It has {some(paths)}.{near}")


def some(names: list[str], most: int = 8) -> str:
    """The first names of a list, as text."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def frame_items(run: Run, frame: int) -> Items:
    """The items of a frame, of its last sub-pixel sample. Raises OptionError for a frame that was not recorded."""
    items = run.items(frame)
    if not items or not len(items["sample"]):
        return items
    last = items["sample"] == items["sample"].max()
    return {name: values[last] for name, values in items.items()}


def explain_object(run: Run, frame: int, path: str, effect: str | None = None) -> list[Explanation]:
    """One explanation per effect of object `path` in `frame`. Raises OptionError for an unknown frame or effect."""
    row, items = run.frame(frame), frame_items(run, frame)
    mine = np.flatnonzero(items["object"] == path) if items else np.zeros(0, np.int64)
    effects = list(dict.fromkeys([*(items["effect"][mine] if len(mine) else ()), *known_effects(run, items)]))
    found = []
    for name in chosen_effects(run, effects, effect):
        place = next((int(item) for item in mine if items["effect"][item] == name), None)
        why = absent(run, row, path, name, len(mine) > 0) if place is None else sentence(run, row, items, place)
        found.append(Explanation(name, why, place))
    return found


def known_effects(run: Run, items: Items) -> list[str]:
    """The effects that items were made of in the frame; of the run where it had none."""
    seen = sorted(set(items["effect"].tolist())) if items else []
    recorded = list(run.config["effects"])
    return [*seen, *(name for name in recorded if not any(name == s.partition("@")[0] or s == "all" for s in seen))]


def subject(effect: str, path: str) -> str:
    """An item in words, with its verb: "shadows of /World/Floor by the light /Lights/Key were"."""
    kind, _, light = effect.partition("@")
    kind = "all effects" if kind == "all" else kind.replace("_", " ")
    verb = "were" if kind.endswith("s") else "was"
    return f"{kind} of {path}" + (f" by the light {light} {verb}" if light else f" {verb}")


def absent(run: Run, row: dict[str, Any], path: str, effect: str, visible: bool) -> str:
    """Why an object had no such item in a frame."""
    entry = next(entry for entry in run.config["scene"]["objects"] if entry["path"] == path)
    what, kind = f"{subject(effect, path)} not traced in frame {row['frame']}", effect.partition("@")[0]
    if entry["effects"].get(kind) == "never":
        return f"{what}: the scene forbids it (effects: {kind}: never)."
    if kind != "all" and kind not in entry["applies"]:
        return f"{what}: the effect changes nothing on the object's materials."
    if visible:
        return f"{what}: none of the pixels that the effect applies to is visible in this frame."
    return f"{what}: the object is not visible in this frame."


def sentence(run: Run, row: dict[str, Any], items: Items, item: int) -> str:
    """Why row `item` of `items` was traced, or not, in the frame of `row`."""
    what = f"{subject(str(items['effect'][item]), str(items['object'][item]))}"
    where = f"in frame {row['frame']}"
    match str(items["reason"][item]):
        case "selected":
            why = f"{what} traced whole {where}: {how_it_came(row, items, item)}; {took(items, item, row)}."
        case "reduced":
            why = (
                f"{what} traced at {share(items, item)} of the pixels {where}: {row['heuristic']} asked for no more; "
                f"{how_it_came(row, items, item)}; {took(items, item, row)}."
            )
        case "cut":
            why = (
                f"{what} cut after {share(items, item)} {where} because {ran_out(row)}: {how_it_came(row, items, item)}; "
                f"{took(items, item, row)}."
            )
        case "no_fit":
            left = amount(left_before(row, items, item), row["budget_unit"])
            why = (
                f"{what} not traced {where}: the item asked for {cost(items, item, row)} and about {left} were left; "
                f"{came_first(items, item)}."
            )
        case "no_time":
            why = (
                f"{what} not traced {where}: the item was asked for as number {items['order'][item] + 1}, but {ran_out(row)} "
                f"before its turn; {came_first(items, item)}."
            )
        case "effect_off":
            why = f"{what} not traced {where}: {switched_off(run, str(items['effect'][item]).partition('@')[0])}."
        case _:
            why = f"{what} not traced {where}: {fault_before(run, row) or not_asked(row, items, item)}."
    return why + stands_in(items, item)


def not_asked(row: dict[str, Any], items: Items, item: int) -> str:
    """Why a heuristic did not name an item."""
    who, unit = row["heuristic"], row["budget_unit"]
    if unit != "none" and not row["budget"] > 0:
        return f"nothing of the budget of {row['frame_budget']} was left for rays"
    if not (items["order"] >= 0).any():
        return f"{who} asked for nothing in this frame"
    if unit == "none":
        return f"{who} did not ask for the item; there was no budget to keep"
    predicted, left = float(items["predicted_cost"][item]), float(row["left"])
    if predicted > left:
        return (
            f"the item is behind the budget: it is predicted to take {amount(predicted, unit)}, of {amount(row['budget'], unit)} "
            f"{amount(left, unit)} were left in the end, and {who} did not ask for it; {came_first(items, item)}"
        )
    return (
        f"{who} did not ask for the item, although {amount(predicted, unit)} would have fitted into the {amount(left, unit)} "
        f"that were left in the end; {came_first(items, item)}"
    )


def how_it_came(row: dict[str, Any], items: Items, item: int) -> str:
    """Which place it had, and why."""
    asked = int((items["order"] >= 0).sum())
    place = f"number {items['order'][item] + 1} of {asked} that {row['heuristic']} asked for"
    if items["mandatory"][item]:
        return f"the item is mandatory (effects: always), {place}"
    relevance = f"relevance number {rank(items['relevance'], item) or 1} of {len(items['relevance'])}"
    # Runs that were recorded before heuristics could say what they rank by have no such column.
    score = rank(items["score"], item) if "score" in items else None
    return f"{place}, with {relevance if score is None else f'score number {score} and {relevance}'}"


def came_first(items: Items, item: int) -> str:
    """How many items were traced instead, and how many of them were more relevant."""
    traced = items["chosen"].astype(bool)
    if items["order"][item] >= 0:
        traced = traced & (items["order"] < items["order"][item])
    more = int((traced & (items["relevance"] > items["relevance"][item])).sum())
    count = int(traced.sum())
    if count == 0:
        return "no item was traced before"
    return f"{count} item{'s' if count > 1 else ''} came first, {more} of them with higher relevance"


def left_before(row: dict[str, Any], items: Items, item: int) -> float:
    """About what was left of the budget when an item was asked for: less what those before it took."""
    before = items["chosen"].astype(bool) & (items["order"] < items["order"][item])
    spent = items["rays"] if row["budget_unit"] == "rays" else items["milliseconds"]
    return max(float(row["budget"]) - float(spent[before].sum()), 0.0)


def stands_in(items: Items, item: int) -> str:
    """What is seen instead, where it is of an earlier frame."""
    kept = float(items["history_share"][item])
    if items["reason"][item] == "selected" or not kept > 0:
        return ""
    age = f"{items['history_age'][item]:.1f} frames old on average"
    return f" Values of earlier frames, {age}, stood in at {kept:.0%} of the pixels.".replace("%", " %")


def switched_off(run: Run, effect: str) -> str:
    """By what an effect was switched off: its own error, or that of the tracer, which is all effects' end."""
    for fault in run.faults:
        if fault["kind"] == "effect" and fault["name"] == effect:
            return f"the effect was switched off after an error{in_frame(fault)} ({fault['message']})"
        if fault["kind"] == "tracer" and "no more rays" in fault["done"]:
            return (
                f"all ray tracing was switched off after an error of the tracer{in_frame(fault)} ({fault['message']})"
            )
        if f"'{effect}'" in fault["done"]:
            return f"the effect was switched off after an error of what it needs{in_frame(fault)} ({fault['message']})"
    return "the effect was switched off after an error"


def fault_before(run: Run, row: dict[str, Any]) -> str:
    """That the heuristic had been switched off by then, where it was."""
    for fault in run.faults:
        when = np.flatnonzero(run.numbers == fault["frame"])
        if fault["kind"] == "heuristic" and (not len(when) or when[0] <= row["step"]):
            return f"the heuristic was switched off after an error{in_frame(fault)} ({fault['message']})"
    return ""


def in_frame(fault: dict[str, Any]) -> str:
    return "" if fault["frame"] is None else f" in frame {fault['frame']}"


def ran_out(row: dict[str, Any]) -> str:
    return "the rays were used up" if row["budget_unit"] == "rays" else "time ran out"


def share(items: Items, item: int) -> str:
    """How much of an item was traced."""
    return f"{items['traced_pixels'][item] / max(items['pixel_count'][item], 1):.0%}".replace("%", " %")


def took(items: Items, item: int, row: dict[str, Any]) -> str:
    """Predicted and actual price."""
    rays, spent = int(items["rays"][item]), float(items["milliseconds"][item])
    return f"predicted {cost(items, item, row)}, took {amount(spent, 'ms')} and {amount(rays, 'rays')}"


def cost(items: Items, item: int, row: dict[str, Any]) -> str:
    """The predicted price in the budget's unit; in rays where there is none."""
    if row["budget_unit"] == "none":
        return amount(float(items["predicted_rays"][item]), "rays")
    return amount(float(items["predicted_cost"][item]), row["budget_unit"])


def amount(value: float, unit: str) -> str:
    """A number with its unit: "5.1 ms", "12,300 rays"."""
    if unit == "ms":
        return f"{value:.1f} ms" if value >= 0.95 else f"{value:.2g} ms"
    return f"{value:,.0f} rays"


def rank(values: np.ndarray, item: int) -> int | None:
    """The place of an item when the largest comes first; None where its value is NaN, and where all are equal."""
    value = float(values[item])
    return None if math.isnan(value) or bool((values == value).all()) else 1 + int((values > value).sum())


@dataclass(frozen=True)
class Line:
    """An item over time. frames: how many it was a candidate in; traced: in how many it was traced, at least in part; whole: in how
    many whole; first, last: frames in which it was traced, None if never; runs: stretches of them as text."""

    object: str
    effect: str
    frames: int
    traced: int
    whole: int
    first: int | None
    last: int | None
    runs: str


def over_time(run: Run, path: str | None = None, effect: str | None = None) -> list[Line]:
    """How often the items of object `path` (None: of all objects) were traced in the run, by object and effect.

    Raises OptionError for an effect that no item had.
    """
    table = run.read_candidates(("frame", "object", "effect", "traced_pixels", "pixel_count"))
    if not table.num_rows:
        return []
    objects, object_code = coded(table, "object")
    effects, effect_code = coded(table, "effect")
    wanted = chosen_effects(run, effects, effect)
    shown = np.isin(effect_code, [code for code, name in enumerate(effects) if name in wanted])
    if path is not None:
        shown &= np.isin(object_code, [code for code, name in enumerate(objects) if name == path])
    rows = np.flatnonzero(shown)
    key = object_code[rows].astype(np.int64) * len(effects) + effect_code[rows]
    rows = rows[np.argsort(key, kind="stable")]
    groups = np.split(rows, np.flatnonzero(np.diff(np.sort(key))) + 1) if len(rows) else []
    frames, pixels, size = (np.asarray(table.column(n).to_numpy()) for n in ("frame", "traced_pixels", "pixel_count"))
    lines = [
        line_of(objects[object_code[mine[0]]], effects[effect_code[mine[0]]], frames[mine], pixels[mine], size[mine])
        for mine in groups
    ]
    return sorted(lines, key=lambda line: (line.object, line.effect))


def coded(table: Any, column: str) -> tuple[list[str], np.ndarray]:
    """The names of a dictionary column, and (n,) int32 which of them each row has."""
    values = table.unify_dictionaries().column(column).combine_chunks()
    return values.dictionary.to_pylist(), np.asarray(values.indices.to_numpy())


def line_of(thing: str, effect: str, frames: np.ndarray, pixels: np.ndarray, size: np.ndarray) -> Line:
    """An item's line. frames, pixels, size (k,): the frames it was a candidate in, its traced and all its pixels there."""
    traced = np.unique(frames[pixels > 0])
    return Line(
        thing,
        effect,
        frames=len(np.unique(frames)),
        traced=len(traced),
        whole=len(np.unique(frames[pixels >= size])),
        first=int(traced[0]) if len(traced) else None,
        last=int(traced[-1]) if len(traced) else None,
        runs=spans(traced),
    )


def chosen_effects(run: Run, known: list[str], given: str | None) -> list[str]:
    """Those of `known` that `given` names: one, with "shadows" all of "shadows@LIGHT" or "all" that it is part of, with None
    every one. Raises OptionError."""
    part = given in run.config["effects"]
    chosen = [name for name in known if given in (None, name, name.partition("@")[0]) or (part and name == "all")]
    if given is not None and not chosen:
        names = sorted(known)
        raise OptionError(f"'{run.folder}' has no effect '{given}': {', '.join(names)}.{did_you_mean(given, names)}")
    return chosen
