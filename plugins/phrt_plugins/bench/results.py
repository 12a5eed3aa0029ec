"""BenchRun: what `phrt bench` wrote, read back, whether it is finished, still running or was killed.

    run = BenchRun.read("runs/standard")
    for cell in run.cells:
        flip = run.measures(cell, ["frame", "flip"])      # a pyarrow table over the cell's finished blocks

Nothing but `bench.json` and the cells' settings is read before it is asked for, and then only the columns that are asked for.
Folders that end in `.part` are work in progress and are never opened. docs/statistics.md says what is computed from it.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from phrt.errors import OptionError
from phrt.recording.arrow import import_arrow
from phrt.recording.rows import widened
from phrt_plugins.bench.plan import reference_name

BENCH_VERSION = 1
"""Of bench.json and the folder's layout."""

BENCH_FILE = "bench.json"
State = Literal["ok", "partial", "failed"]
_BLOCK = re.compile(r"block-(\d+)")
_FRAME = re.compile(r"(?P<kind>[a-z_]+)-(?P<frame>\d+)\.png")
_STAGE, _RAYS = re.compile(r"stage_\w+_ms"), re.compile(r"rays_\w+")


@dataclass(frozen=True)
class Blocks:
    """Recorded blocks of consecutive frames: run folders `block-000`, `block-001`, ...

    id, setup : whose they are
    folder    : where they are
    blocks    : the numbers of the whole ones, sorted
    """

    id: str
    setup: str
    folder: Path
    blocks: tuple[int, ...]

    def block_folder(self, block: int) -> Path:
        return self.folder / f"block-{block:03d}"


@dataclass(frozen=True)
class Failure:
    """Why a cell failed, and in which block; None where it is not one block's fault."""

    block: int | None
    reason: str
    kind: str


@dataclass(frozen=True)
class Cell(Blocks):
    """One contestant in one setup under one budget, once.

    size           : (width, height), pixels
    budget         : as it is written; budget_amount in ms or rays as budget_kind says (frame_ms, ray_ms, rays, none); NaN where
                     half of the rays is not known yet
    planned_blocks : how many it has when it is done
    state          : ok (all blocks are there), partial (some are not, yet), failed
    settings       : cell.json
    """

    scene: str
    label: str
    heuristic: str
    options: dict[str, Any]
    size: tuple[int, int]
    tracer: str
    gbuffer: str
    clock: Any
    budget: str
    budget_kind: str
    budget_amount: float
    persistence: float | None
    cost_model: str
    group_by: str
    history: bool
    repeat: int
    planned_blocks: int
    failure: Failure | None
    settings: dict[str, Any] = field(repr=False)

    @property
    def state(self) -> State:
        if self.failure is not None:
            return "failed"
        return "ok" if len(self.blocks) >= self.planned_blocks else "partial"

    @property
    def group(self) -> tuple[str, str, str]:
        """What its repeats have in common: setup, budget, label."""
        return self.setup, self.budget, self.label


@dataclass(frozen=True)
class BenchRun:
    """A folder of `phrt bench`.

    about : bench.json
    cells : sorted by setup, budget, label and repeat; those that were planned and not begun have no blocks
    """

    folder: Path
    about: dict[str, Any]
    cells: tuple[Cell, ...]

    @classmethod
    def read(cls, folder: str | Path) -> BenchRun:
        """The run in `folder`. Raises OptionError: it is none, is of another version, or pyarrow is missing."""
        import_arrow()
        folder = Path(folder)
        about = _read_about(folder)
        settings = {entry["id"]: entry for entry in _planned_cells(about)}
        # Folders of cells that are not planned any more are of a contestant whose code was changed.
        begun = {entry["id"]: entry for entry in _begun_cells(folder)}
        settings |= {id: entry for id, entry in begun.items() if id in settings or not settings}
        cells = [_cell(folder, about, entry) for entry in settings.values()]
        most = {cell.setup: 0 for cell in cells}
        for cell in cells:
            most[cell.setup] = max(most[cell.setup], cell.planned_blocks, len(cell.blocks))
        cells = [_with_blocks(cell, most[cell.setup]) for cell in cells]
        order = sorted(
            cells, key=lambda cell: (cell.setup, cell.budget_kind, cell.budget_amount, cell.label, cell.repeat)
        )
        return cls(folder, about, tuple(order))

    @property
    def name(self) -> str:
        return str(self.about.get("name") or self.folder.name)

    @property
    def title(self) -> str:
        return str(self.about.get("title") or self.name)

    @property
    def state(self) -> str:
        """running | finished | ended early, as bench.json says."""
        return str(self.about.get("state", "running"))

    @property
    def config(self) -> dict[str, Any]:
        """The resolved configuration."""
        return dict(self.about.get("config") or {})

    @property
    def reference_name(self) -> str:
        """What pictures were compared with: "all-trace", or which path tracing."""
        return reference_name(self.config.get("reference"))

    @cached_property
    def setups(self) -> tuple[str, ...]:
        """Of the cells, sorted."""
        return tuple(dict.fromkeys(cell.setup for cell in self.cells))

    @cached_property
    def references(self) -> dict[str, Blocks]:
        """The run that traced everything, and the pictures to compare with, of each setup that has them."""
        return {path.name: _blocks_of(path, path.name, path.name) for path in _folders(self.folder / "references")}

    def cell(self, id: str) -> Cell:
        """Raises OptionError for one that is not there."""
        found = next((cell for cell in self.cells if cell.id == id), None)
        if found is None:
            raise OptionError(
                f"no cell '{id}' in '{self.folder}'; there are: {', '.join(c.id for c in self.cells) or 'none'}"
            )
        return found

    def contest(self, setup: str) -> str:
        """The first of the setups that `setup` is compared with: those that differ in effects only."""
        return self._contests.get(setup, setup)

    @cached_property
    def _contests(self) -> dict[str, str]:
        found: dict[str, str] = {}
        first: dict[str, str] = {}
        for entry in (self.about.get("plan") or {}).get("setups") or ():
            if isinstance(entry, dict) and "id" in entry:
                rest = {name: value for name, value in entry.items() if name not in ("id", "effects")}
                found[entry["id"]] = first.setdefault(json.dumps(rest, sort_keys=True), entry["id"])
        return found

    def groups(self) -> dict[tuple[str, str, str], tuple[Cell, ...]]:
        """(setup, budget, label) -> its repeats."""
        found: dict[tuple[str, str, str], list[Cell]] = {}
        for cell in self.cells:
            found.setdefault(cell.group, []).append(cell)
        return {key: tuple(cells) for key, cells in found.items()}

    def frames(self, of: Blocks, columns: Sequence[str] | None = None) -> Any:
        """pyarrow table of all frames: `block` and the columns of frames.parquet, with one per stage (`stage_rays_ms`) and kind
        of rays (`rays_shadows`). columns: which of them (None: all); those that are not there are left out."""
        return _joined([_numbered(block, table) for block, table in self._frame_tables(of, columns)], columns)

    def measures(self, of: Blocks, columns: Sequence[str] | None = None) -> Any:
        """pyarrow table of the judged frames: `block`, `frame` and a column per metric column."""
        return self._table(of, "measures", columns)

    def candidates(self, of: Blocks, columns: Sequence[str]) -> Any:
        """pyarrow table of all candidates of all frames: `block` and `columns`."""
        return self._table(of, "candidates", columns)

    def candidate_blocks(self, of: Blocks, columns: Sequence[str] | None = None) -> Iterator[tuple[int, Any]]:
        """(block, its candidates) one after the other: what is held at a time does not grow with the run."""
        for block in of.blocks:
            if (table := read_columns(of.block_folder(block) / "candidates.parquet", columns)) is not None:
                yield block, table

    def pictures(self, of: Blocks, kind: str = "frame") -> dict[int, Path]:
        """Frame number -> PNG, sorted. kind: "frame"; "floor" too of a reference."""
        found: dict[int, Path] = {}
        for block in of.blocks:
            for path in (of.block_folder(block) / "pictures").glob("*.png"):
                match = _FRAME.fullmatch(path.name)
                if match and match["kind"] == kind:
                    found[int(match["frame"])] = path
        return dict(sorted(found.items()))

    def has_oracle(self, setup: str) -> bool:
        return any((self.folder / "oracle" / setup).glob("block-*.parquet"))

    def oracle(self, setup: str, columns: Sequence[str] | None = None) -> Any:
        """pyarrow table: `block` and a row per judged frame and budget of the oracle of `setup`; empty where there is none."""
        return self._oracle_table(setup, "block", columns)

    def oracle_items(self, setup: str, columns: Sequence[str] | None = None) -> Any:
        """pyarrow table: `block` and a row per item and judged frame: its true benefit and cost; empty where there is none."""
        return self._oracle_table(setup, "items", columns)

    def _oracle_table(self, setup: str, kind: str, columns: Sequence[str] | None) -> Any:
        paths = {
            int(match[1]): path
            for path in (self.folder / "oracle" / setup).glob(f"{kind}-*.parquet")
            if (match := re.fullmatch(kind + r"-(\d+)", path.stem))
        }
        tables = [(block, read_columns(path, columns)) for block, path in sorted(paths.items())]
        return _joined([_numbered(block, table) for block, table in tables if table is not None], columns)

    def _table(self, of: Blocks, name: str, columns: Sequence[str] | None) -> Any:
        tables = [(block, read_columns(of.block_folder(block) / f"{name}.parquet", columns)) for block in of.blocks]
        return _joined([_numbered(block, table) for block, table in tables if table is not None], columns)

    def _frame_tables(self, of: Blocks, columns: Sequence[str] | None) -> Iterator[tuple[int, Any]]:
        """(block, its frames), stages and kinds of rays as columns."""
        stored = None if columns is None else list(dict.fromkeys(_stored_in(name) for name in columns))
        for block in of.blocks:
            if (table := read_columns(of.block_folder(block) / "frames.parquet", stored)) is not None:
                table = widened(table)
                kept = table.column_names if columns is None else [c for c in columns if c in table.column_names]
                yield block, table.select(kept)


def read_columns(path: Path, columns: Sequence[str] | None = None) -> Any:
    """The Parquet file at `path` as a pyarrow table with those of `columns` that it has (None: all); None where there is no file.

    Raises OptionError for a file that cannot be read.
    """
    arrow = import_arrow()
    if not path.exists():
        return None
    try:
        with arrow.parquet.ParquetFile(path) as file:
            names = file.schema_arrow.names
            return file.read(columns=None if columns is None else [name for name in columns if name in names])
    except (OSError, arrow.ArrowException) as error:
        raise OptionError(f"'{path}' cannot be read: {error}") from error


def _stored_in(column: str) -> str:
    """The column of frames.parquet that holds `column`."""
    if _STAGE.fullmatch(column):
        return "stages"
    return "rays" if _RAYS.fullmatch(column) else column


def _numbered(block: int, table: Any) -> Any:
    """`table` with a first column `block`."""
    arrow = import_arrow()
    return table.add_column(0, "block", arrow.array([block] * table.num_rows, arrow.int32()))


def _joined(tables: list[Any], columns: Sequence[str] | None) -> Any:
    """One table; a stage or kind of rays that a block does not have is 0 there, anything else that is missing is null."""
    arrow = import_arrow()
    if not tables:
        return arrow.table({name: arrow.array([], arrow.float64()) for name in ("block", *(columns or ()))})
    table = arrow.concat_tables(tables, promote_options="permissive").unify_dictionaries()
    for name in table.column_names:
        if (_STAGE.fullmatch(name) or _RAYS.fullmatch(name)) and table.column(name).null_count:
            filled = table.column(name).fill_null(0)
            table = table.set_column(table.schema.get_field_index(name), name, filled)
    return table


def _read_about(folder: Path) -> dict[str, Any]:
    """bench.json. Raises OptionError."""
    path = folder / BENCH_FILE
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        if isinstance(error, OSError) and not path.exists():
            why = "there is no such folder" if not folder.exists() else f"there is no {BENCH_FILE} in it"
        else:
            why = f"{BENCH_FILE} cannot be read: {error}"
        raise OptionError(f"'{folder}' is no folder of phrt bench: {why}") from error
    if not isinstance(about, dict) or "phrt_bench" not in about:
        raise OptionError(f"'{folder}' is no folder of phrt bench: its {BENCH_FILE} was not written by phrt")
    if about["phrt_bench"] != BENCH_VERSION:
        raise OptionError(
            f"'{folder}' was written with version {about['phrt_bench']} of bench folders; this phrt reads version {BENCH_VERSION}"
        )
    return about


def _planned_cells(about: dict[str, Any]) -> list[dict[str, Any]]:
    """The settings of the cells in bench.json's plan."""
    planned = (about.get("plan") or {}).get("cells") or ()
    return [entry for entry in planned if isinstance(entry, dict) and "id" in entry and "setup" in entry]


def _begun_cells(folder: Path) -> Iterator[dict[str, Any]]:
    """cell.json of every cell that has a folder. One that cannot be read is not there yet."""
    for path in _folders(folder / "cells"):
        settings = _read_json(path / "cell.json")
        if isinstance(settings, dict) and "setup" in settings:
            yield {**settings, "id": path.name}


def _planned_blocks(about: dict[str, Any], setup: str) -> int:
    """How many blocks a cell of `setup` has by the plan, which gives a number or a list, for all or by setup; 0: unknown."""
    blocks = (about.get("plan") or {}).get("blocks")
    if isinstance(blocks, dict):
        blocks = blocks.get(setup)
    if isinstance(blocks, int):
        return blocks
    return len(blocks) if isinstance(blocks, list) else 0


def _place(cell: Cell) -> tuple[Any, ...]:
    """What cells are sorted by."""
    known = not math.isnan(cell.budget_amount)
    return cell.setup, cell.budget_kind, cell.budget_amount if known else 0.0, cell.budget, cell.label, cell.repeat


def _amount(settings: dict[str, Any]) -> float:
    """ms or rays of a cell's budget. JSON has no infinity: null is no limit, or what half of the rays is, not known yet."""
    amount = settings.get("budget_amount")
    if amount is None:
        return math.inf if settings["budget_kind"] == "none" else math.nan
    return float(amount)


def _cell(folder: Path, about: dict[str, Any], settings: dict[str, Any]) -> Cell:
    path = folder / "cells" / settings["id"]
    failed = _read_json(path / "failed.json")
    width, height = settings["size"]
    return Cell(
        **vars(_blocks_of(path, settings["id"], settings["setup"])),
        scene=settings["scene"],
        label=settings["label"],
        heuristic=settings["heuristic"],
        options=dict(settings.get("options") or {}),
        size=(int(width), int(height)),
        tracer=settings["tracer"],
        gbuffer=settings["gbuffer"],
        clock=settings.get("clock"),
        budget=str(settings["budget"]),
        budget_kind=settings["budget_kind"],
        budget_amount=_amount(settings),
        persistence=settings.get("persistence"),
        cost_model=settings.get("cost_model", "measured"),
        group_by=settings.get("group_by", "object_effect"),
        history=bool(settings.get("history", True)),
        repeat=int(settings.get("repeat", 0)),
        planned_blocks=_planned_blocks(about, settings["setup"]),
        failure=_failure(failed) if isinstance(failed, dict) else None,
        settings=settings,
    )


def _failure(found: dict[str, Any]) -> Failure:
    block = found.get("block")
    return Failure(
        None if block is None else int(block), str(found.get("reason", "unknown")), str(found.get("kind", ""))
    )


def _with_blocks(cell: Cell, planned: int) -> Cell:
    """`cell`; where the plan does not say how many blocks it has, as many as the furthest of its setup."""
    return Cell(**{**vars(cell), "planned_blocks": cell.planned_blocks or max(planned, 1)})


def _blocks_of(folder: Path, id: str, setup: str) -> Blocks:
    """The whole blocks in `folder`."""
    numbers = [int(match[1]) for path in _folders(folder) if (match := _BLOCK.fullmatch(path.name))]
    return Blocks(id, setup, folder, tuple(sorted(numbers)))


def _folders(folder: Path) -> list[Path]:
    """The folders in `folder`, sorted; none where it is not there. Those of unfinished work are left out."""
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.endswith(".part"))


def _read_json(path: Path) -> Any:
    """What is in it; None where it is not there or not whole."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
