"""The documentation's gallery has every experiment."""

import re
from pathlib import Path

from sigmapoint.experiments import EXPERIMENTS

DOCS = Path(__file__).parents[2] / "docs"


def test_the_gallery_has_every_experiment_with_its_picture():
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (.+)$", page, re.MULTILINE) == list(EXPERIMENTS)
    pictures = re.findall(r"^!\[.+\]\((.+)\)$", page, re.MULTILINE)
    assert len(pictures) == len(EXPERIMENTS)
    assert all((DOCS / picture).is_file() for picture in pictures)
