"""Make the documentation's gallery, `docs/gallery.md` and its pictures, from what `reproduce --all` has left.

uv run sigmapoint reproduce --all --data DIR --out OUT
uv run python scripts/gallery.py OUT
"""

import json
import sys
from datetime import datetime
from pathlib import Path

from PIL import Image

from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.publishing.results import WORDS

DOCS = Path(__file__).parents[1] / "docs"
IMAGES = DOCS / "images" / "gallery"
WIDE = 1000
"""[pixels] no wider than this"""
COLOURS = 256


def main(out: Path) -> None:
    """Read OUT, write the page."""
    done = {name: _read(out / name / "claim.json") for name in EXPERIMENTS}
    runs = {name: _read(out / name / "run.json") for name in EXPERIMENTS}
    held = sum(bool(claim["holds"]) for claim in done.values())
    day = datetime.fromtimestamp((out / "index.html").stat().st_mtime).date()
    versions = ", ".join(f"{name} {one}" for name, one in next(iter(runs.values()))["versions"].items())
    lines = [
        "# Gallery of experiments",
        "",
        "Every experiment of the papers, and a few of ours, each from one command. `sigmapoint reproduce --all` runs",
        "them and leaves an index with published beside measured numbers; `sigmapoint reproduce NAME` runs one and",
        f"leaves a page with its tables and figures. These are runs up to {day} ({versions}):",
        f"{held} of {len(done)} claims were reproduced. Numbers come with their standard errors, and what was not",
        "reproduced says why.",
        "",
        "| experiment | claim | |",
        "|---|---|---|",
        *(f"| [{name}](#{name}) | {claim['claim']} | {WORDS[claim['holds']]} |" for name, claim in done.items()),
    ]
    IMAGES.mkdir(parents=True, exist_ok=True)
    for name, claim in done.items():
        picture = _shown(name, out / name / claim["pictures"][0])
        lines += ["", f"## {name}", "", f"{claim['title']}. Claim: {claim['claim']}."]
        lines += ["", f"![{claim['title']}](images/gallery/{picture})", "", f"**{_capital(claim['verdict'])}.**"]
        lines += ["", f"`sigmapoint reproduce {name}`: {runs[name]['seconds'] / 60:.1f} minutes."]
    (DOCS / "gallery.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _shown(name: str, picture: Path) -> str:
    """The name of the picture's copy, in few colours; a film is copied whole."""
    if picture.suffix == ".gif":
        (IMAGES / f"{name}.gif").write_bytes(picture.read_bytes())
        return f"{name}.gif"
    image = Image.open(picture).convert("RGB")
    image.thumbnail((WIDE, 10 * WIDE), Image.Resampling.LANCZOS)
    image.quantize(COLOURS).save(IMAGES / f"{name}.png", optimize=True)
    return f"{name}.png"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _read(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
