"""What an experiment leaves behind: `results.json`, figures as PNG and SVG, and a self-contained `report.html`.

A row of `results.json` has the keys `experiment, quantity, method, published, measured, spread, runs, note`:
`published` is null where the paper prints no number, `spread` is the standard error of `measured` over `runs` runs.
A number that is not finite becomes null.
"""

import base64
import json
import math
from collections.abc import Sequence
from html import escape
from io import BytesIO
from itertools import groupby
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, Protocol

import numpy as np
from matplotlib.animation import Animation, PillowWriter
from matplotlib.figure import Figure

from sigmapoint.storage import write_atomically


class Row(NamedTuple):
    """One measured number beside the published one."""

    experiment: str
    quantity: str
    method: str
    published: float | None
    measured: float | None
    spread: float | None
    runs: int
    note: str = ""


class Image(NamedTuple):
    """What a browser shows."""

    kind: str
    """`png` or `gif`"""
    content: bytes


class Shown(Protocol):
    """Something on the page."""

    @property
    def caption(self) -> str:
        """What it shows in words."""
        ...

    def saved(self, out: Path) -> Image:
        """Written into the folder, and as the page has it."""
        ...


class Picture(NamedTuple):
    """A figure, its file name without an ending, and what it shows in words."""

    name: str
    caption: str
    figure: Figure

    def saved(self, out: Path) -> Image:
        """Written as PNG and SVG."""
        images = {}
        for kind in ("png", "svg"):
            buffer = BytesIO()
            self.figure.savefig(buffer, format=kind, dpi=160)
            self.figure.set_layout_engine("none")  # as laid out by the first
            images[kind] = buffer.getvalue()
            _write(out / f"{self.name}.{kind}", images[kind])
        return Image("png", images["png"])


class Film(NamedTuple):
    """A moving picture, its file name without an ending, and what it shows in words."""

    name: str
    caption: str
    animation: Animation
    rate: int
    """pictures a second"""

    def saved(self, out: Path) -> Image:
        """Written as GIF."""
        with TemporaryDirectory() as folder:
            path = Path(folder) / "film.gif"
            self.animation.save(path, writer=PillowWriter(fps=self.rate), dpi=72)
            content = path.read_bytes()
        _write(out / f"{self.name}.gif", content)
        return Image("gif", content)


class Mean(NamedTuple):
    """A mean over runs with its standard error."""

    value: float
    spread: float
    runs: int


def row_of(experiment: str, quantity: str, method: str, mean: Mean, note: str = "") -> Row:
    """A mean that the papers print no number of."""
    return Row(experiment, quantity, method, None, mean.value, mean.spread, mean.runs, note)


def mean_of(samples: np.ndarray) -> Mean:
    """Mean and standard error of one number a run (runs,); runs that are not finite are left out of both."""
    kept = samples[np.isfinite(samples)]
    if kept.size < 2:
        return Mean(math.nan, math.nan, kept.size)
    return Mean(float(kept.mean()), float(kept.std(ddof=1) / math.sqrt(kept.size)), kept.size)


def decided(gain: Mean) -> str:
    """What became of a claim that this is positive, by three standard errors."""
    if not abs(gain.value) > 3 * gain.spread:
        return "not decided by these runs"
    return "reproduced" if gain.value > 0 else "contradicted"


def publish(
    out: Path, title: str, findings: Sequence[str], rows: Sequence[Row], pictures: Sequence[Shown]
) -> list[dict[str, Any]]:
    """Write results, figures and page into the folder `out` (made if need be); returns the rows as written.

    Args:
        out: the folder.
        title: of the page.
        findings: paragraphs in plain words, each one statement, before everything else on the page.
        rows: the numbers, those of one quantity next to each other.
        pictures: the figures and films, in order.

    Raises:
        OSError: the folder cannot be written.
    """
    out.mkdir(parents=True, exist_ok=True)
    records = [_record(row) for row in rows]
    text = json.dumps(records, indent=1, ensure_ascii=False, allow_nan=False)
    _write(out / "results.json", text.encode())
    images = [picture.saved(out) for picture in pictures]
    _write(out / "report.html", page(title, findings, rows, pictures, images).encode())
    return records


def _record(row: Row) -> dict[str, Any]:
    return {name: _finite(value) for name, value in row._asdict().items()}


def _finite(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _write(path: Path, content: bytes) -> None:
    write_atomically(path, lambda file: file.write(content))


def page(
    title: str, findings: Sequence[str], rows: Sequence[Row], pictures: Sequence[Shown], images: Sequence[Image]
) -> str:
    """The page as HTML; `images` are those of the pictures."""
    said = "".join(f"<p>{escape(finding)}</p>" for finding in findings)
    shown = "".join(_figure(picture, image) for picture, image in zip(pictures, images))
    groups = groupby(rows, key=lambda row: row.quantity)
    table = "".join(_group(quantity, list(group)) for quantity, group in groups)
    return PAGE.format(title=escape(title), findings=said, figures=shown, table=table)


def _figure(picture: Shown, image: Image) -> str:
    caption = escape(picture.caption)
    data = base64.b64encode(image.content).decode()
    image_tag = f'<img alt="{caption}" src="data:image/{image.kind};base64,{data}">'
    return f"<figure>{image_tag}<figcaption>{caption}</figcaption></figure>"


def _group(quantity: str, rows: Sequence[Row]) -> str:
    lines = "".join(
        f"<tr><td>{escape(row.method)}</td><td class=n>{number(row.published)}</td>"
        f"<td class=n>{number(row.measured)}{_plus_minus(row.spread)}</td>"
        f"<td class=n>{row.runs:,}</td><td class=note>{escape(row.note)}</td></tr>"
        for row in rows
    )
    return f"<tbody><tr><th colspan=5>{escape(quantity)}</th></tr>{lines}</tbody>"


def number(value: float | None) -> str:
    """Four significant digits; a dash where there is none."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.4g}".replace("-", "−")


def _plus_minus(spread: float | None) -> str:
    return "" if spread is None or not math.isfinite(spread) else f" <small>± {spread:.2g}</small>"


PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
body {{ font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff }}
body {{ max-width: 72rem; margin: auto; padding: 1rem }}
h1 {{ font-size: 1.5rem; line-height: 1.25 }}
p {{ max-width: 46rem }}
figure {{ margin: 2rem 0 }}
img {{ max-width: 100%; height: auto }}
figcaption {{ color: #555; max-width: 46rem }}
.wide {{ overflow-x: auto }}
table {{ border-collapse: collapse; font-variant-numeric: tabular-nums }}
th, td {{ text-align: left; vertical-align: top; padding: .25rem .75rem .25rem 0; border-bottom: 1px solid #e5e5e5 }}
tbody th {{ padding-top: 1.25rem; border-bottom: 2px solid #999 }}
.n {{ text-align: right }}
.n, td:first-child {{ white-space: nowrap }}
.note {{ color: #555; font-size: .85rem; min-width: 12rem }}
small {{ color: #555 }}
@media (max-width: 40rem) {{ body {{ font-size: 15px; padding: .75rem }} th, td {{ padding-right: .5rem }} }}
</style></head><body>
<h1>{title}</h1>
{findings}
{figures}
<div class="wide"><table>
<thead><tr><td>method</td><td class=n>published</td><td class=n>measured ± standard error</td><td class=n>runs</td>
<td>note</td></tr></thead>
{table}
</table></div>
</body></html>
"""
