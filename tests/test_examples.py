"""Every example in a docstring, the README and the docs runs."""

import doctest
import importlib
import pkgutil
import re
from pathlib import Path

import jax
import pytest

import sigmapoint

ROOT = Path(__file__).parents[1]
MODULES = [m.name for m in pkgutil.walk_packages(sigmapoint.__path__, "sigmapoint.")]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def _blocks(page: Path) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("name", MODULES)
def test_docstrings(name):
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        result = doctest.testmod(importlib.import_module(name), optionflags=flags)
    assert result.failed == 0


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_pages(page, tmp_path, monkeypatch):
    """The Python blocks of a page, run one after the other as one program."""
    monkeypatch.chdir(tmp_path)
    blocks = _blocks(page)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):  # as a reader has them
        exec(compile("\n".join(blocks), str(page), "exec"), {"__name__": "__page__"})


def test_the_worked_example_of_a_new_rule_is_the_rule_as_it_is():
    blocks = _blocks(ROOT / "CONTRIBUTING.md")
    source = ROOT / "src" / "sigmapoint"
    assert blocks[0] == (source / "rules" / "spherical_simplex.py").read_text("utf-8")
    assert blocks[1].partition("\n\n\n")[2] in (source / "methods.py").read_text("utf-8")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_what_a_page_points_to_is_there(page):
    """MkDocs holds links within the documentation, anchors included; this one those of README and CONTRIBUTING too."""
    links = re.findall(r"\]\(([^)#\s]+)", re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.M | re.S))
    assert [link for link in links if "://" not in link and not (page.parent / link).exists()] == []
