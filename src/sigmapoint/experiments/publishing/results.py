"""What an experiment leaves behind: `results.json`, `claim.json`, figures, and a self-contained `report.html`.

A row of `results.json` has the keys `experiment, quantity, method, published, measured, spread, runs, note`:
`published` is null where the paper prints no number, `spread` is the standard error of `measured` over `runs` runs.
A number that is not finite becomes null.
"""

import json
import math
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, Protocol

import numpy as np
from matplotlib.animation import Animation, PillowWriter
from matplotlib.figure import Figure
from scipy import stats

from sigmapoint.experiments.publishing.page import Image, page
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
        return Image(f"{self.name}.png", images["png"])


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
        return Image(f"{self.name}.gif", content)


WORDS = {True: "reproduced", False: "not reproduced", None: "not decided"}
"""what became of a claim, by whether it holds"""


class Claim(NamedTuple):
    """What was claimed, and what became of it."""

    said: str
    """in words"""
    parts: Mapping[str, bool | None]
    """each statement that it comes to, with what was measured; whether it holds, None where runs do not decide"""

    @property
    def holds(self) -> bool | None:
        """All of it; None where a part is not decided and none fails."""
        if False in self.parts.values():
            return False
        return None if None in self.parts.values() else True

    @property
    def verdict(self) -> str:
        """In words, with the parts that decide it."""
        why = {True: "", False: ", because", None: " by these runs"}[self.holds]
        return (
            f"{WORDS[self.holds]}{why}: {'; '.join(part for part, holds in self.parts.items() if holds is self.holds)}"
        )


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


def ahead(found: np.ndarray, over: np.ndarray) -> Mean:
    """How much more one has than the other, (runs,) each, on the runs that both have: the first ones.

    NaN, which decides nothing, where a run was lost by one of them.
    """
    runs = min(len(found), len(over))
    found, over = found[:runs], over[:runs]
    if (np.isfinite(found) != np.isfinite(over)).any():
        return Mean(math.nan, math.nan, runs)
    return mean_of(found - over)


def positive(gain: Mean) -> bool | None:
    """Whether this is, as surely as three standard deviations of a Gaussian; None where that is not decided.

    By Student's distribution: a spread that few runs estimate says less.
    """
    if gain.runs < 2:
        return None
    surely = float(stats.t.isf(stats.norm.sf(3.0), gain.runs - 1))
    return gain.value > 0 if abs(gain.value) > surely * gain.spread else None


def decided(gain: Mean) -> str:
    """What became of a claim that this is positive, in words."""
    return {True: "reproduced", False: "contradicted", None: "not decided by these runs"}[positive(gain)]


def plus_minus(mean: Mean, form: str = ".3g") -> str:
    """A mean and its standard error."""
    return f"{mean.value:{form}} ± {mean.spread:.1g}"


def publish(
    out: Path, title: str, claim: Claim, findings: Sequence[str], rows: Sequence[Row], pictures: Sequence[Shown]
) -> list[dict[str, Any]]:
    """Write results, figures and page into the folder `out` (made if need be); returns the rows as written.

    Args:
        out: the folder.
        title: of the page.
        claim: of the paper, or ours, first on the page.
        findings: paragraphs in plain words, each one statement, after it.
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
    said = {"title": title, "claim": claim.said, "holds": claim.holds, "verdict": claim.verdict}
    said["pictures"] = [image.file for image in images]
    _write(out / "claim.json", json.dumps(said, indent=1, ensure_ascii=False).encode())
    about = (f"Claim: {claim.said}", claim.verdict[0].upper() + claim.verdict[1:] + ".", *findings)
    captions = [picture.caption for picture in pictures]
    _write(out / "report.html", page(title, about, [row._asdict() for row in rows], captions, images).encode())
    return records


def _record(row: Row) -> dict[str, Any]:
    return {name: _finite(value) for name, value in row._asdict().items()}


def _finite(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _write(path: Path, content: bytes) -> None:
    write_atomically(path, lambda file: file.write(content))
