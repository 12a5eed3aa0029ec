"""Figures as SVG text: one look, text as text, ids that are unique on a page, and the data beside it as CSV.

matplotlib is imported when the first figure is drawn.
"""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

COLOURS = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#332288", "#7a6a53", "#882255", "#8c8c8c",
)  # fmt: skip
"""Told apart by colour-blind people: Okabe and Ito 2008 without yellow and black, indigo and wine of Paul Tol; brown and grey are
ours. The style sheet lightens the dark ones where the page is dark."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">")
DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)))
INK, GRID = "#1f2933", "#d5dae0"
"""Text and axes; the lines behind. The page's style sheet knows both and changes them where the page is dark."""

_RC: dict[str, Any] = {
    "svg.fonttype": "none",
    "text.parse_math": False,
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.linewidth": 1.5,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
}
_FONTS = "'DejaVu Sans', Verdana, sans-serif"


@dataclass(frozen=True)
class Plot:
    """A figure of the page. key: names its files and prefixes its ids; alt: what it shows, for who cannot see it; svg: one `<svg>`
    element; csv: what is drawn, with a header line; wide: as wide as the page."""

    key: str
    title: str
    caption: str
    alt: str
    svg: str
    csv: str
    wide: bool = False


@dataclass(frozen=True)
class Look:
    """How a contestant is drawn, the same in every figure."""

    colour: str
    marker: str
    dash: Any


def looks(labels: Iterable[str]) -> dict[str, Look]:
    """A look for every label, in their order; no two of the first eighty are alike."""
    found = {}
    for number, label in enumerate(labels):
        again = number // len(COLOURS)
        found[label] = Look(
            COLOURS[number % len(COLOURS)], MARKERS[(number + again) % len(MARKERS)], DASHES[again % len(DASHES)]
        )
    return found


def draw(key: str, size: tuple[float, float], paint: Callable[[Any], None]) -> str:
    """One `<svg>` element of `size` inches of what `paint` puts on a matplotlib Figure. Ids begin with `key`."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with matplotlib.rc_context({**_RC, "svg.hashsalt": key}), warnings.catch_warnings():
        # Labels are data: signs that the font lacks, or a long one that leaves no room, are no reason to warn.
        warnings.simplefilter("ignore", UserWarning)
        figure = Figure(figsize=size, dpi=100)
        canvas = FigureCanvasSVG(figure)
        paint(figure)
        out = io.StringIO()
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        canvas.print_svg(out, metadata=nothing)
    return tidy(out.getvalue(), key)


def tidy(text: str, key: str) -> str:
    """matplotlib's SVG as an element of a page: no prolog, `key` before all ids, short numbers and fonts."""
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(r'(?<= )id="', f'id="{key}-', text)
    text = re.sub(r'(href="#|url\(#)', rf"\g<1>{key}-", text)
    text = re.sub(r"font-family: [^;\"]+|(?<=px )'DejaVu Sans'[^;\"]*", _fonts, text)
    text = re.sub(r'(?<= d=")[^"]+', _shorter, text)
    return text.strip()


def _fonts(found: re.Match[str]) -> str:
    return f"font-family: {_FONTS}" if found[0].startswith("font-family") else _FONTS


def _shorter(found: re.Match[str]) -> str:
    return re.sub(r"-?\d+\.\d{3,}", lambda number: f"{float(number[0]):.2f}", found[0])


def path_text(text: str, most: int = 44) -> str:
    """A path for a figure: its end says more than its beginning."""
    text = printable(text)
    return text if len(text) <= most else "…" + text[-(most - 1) :]


def name_text(text: str, most: int = 34) -> str:
    """A name for a figure, cut at its end."""
    text = printable(text)
    return text if len(text) <= most else text[: most - 1] + "…"


def printable(text: str) -> str:
    """Text of data without control signs, which SVG cannot hold."""
    return "".join(sign if sign.isprintable() else " " for sign in text)


def table_csv(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table as CSV text; floats with seven digits, None and NaN empty."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return out.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, float):
        return "" if value != value else f"{value:.7g}"
    return "" if value is None else value


def margins(figure: Any, left: float, bottom: float, right: float = 0.3, top: float = 0.15, **between: float) -> None:
    """Room around the panels, inches; between: `wspace`, `hspace`, inches between panels. matplotlib's own layout engines need more
    time than the drawing."""
    width, height = figure.get_figwidth(), figure.get_figheight()
    rows, columns = figure.axes[0].get_subplotspec().get_gridspec().get_geometry()
    gaps = {}
    for name, count, size in (("wspace", columns, width - left - right), ("hspace", rows, height - bottom - top)):
        gap = between.get(name, 0.0)
        gaps[name] = gap / max((size - gap * (count - 1)) / count, 0.05)
    figure.subplots_adjust(left / width, bottom / height, 1 - right / width, 1 - top / height, **gaps)


def text_width(texts: Iterable[str], points: float = 9.5) -> float:
    """Inches that the widest of `texts` takes, about."""
    return max(map(len, texts), default=0) * points * 0.62 / 72


def legend_height(width: float, labels: Sequence[str]) -> float:
    """Inches that the legend of a figure of this width takes."""
    return 0.19 * -(-len(labels) // _fitting(width, labels)) + 0.06


def _fitting(width: float, labels: Sequence[str]) -> int:
    """Columns of a legend."""
    return min(max(1, int((width - 0.2) / (text_width(map(name_text, labels), 9) + 0.5))), max(len(labels), 1))


def legend(figure: Any, handles: Sequence[Any], labels: Sequence[str]) -> None:
    """A legend at the lower edge of a figure. Labels are data: one that begins with "_" would be left out by matplotlib."""
    shown = [("\u200b" + label) if label.startswith("_") else label for label in map(name_text, labels)]
    figure.legend(
        handles, shown, loc="lower center", bbox_to_anchor=(0.5, 0.0), ncols=_fitting(figure.get_figwidth(), labels),
        borderaxespad=0.1, labelspacing=0.3, columnspacing=1.2, handletextpad=0.5, markerscale=1.4,
    )  # fmt: skip
