"""Pages of experiments as HTML, each one file."""

import base64
import math
from collections.abc import Mapping, Sequence
from html import escape
from itertools import groupby
from typing import Any, NamedTuple

Record = Mapping[str, Any]
"""a row of `results.json`"""


class Image(NamedTuple):
    """What a browser shows."""

    file: str
    """its name, with `.png` or `.gif` at the end"""
    content: bytes


def page(
    title: str, said: Sequence[str], rows: Sequence[Record], captions: Sequence[str], images: Sequence[Image]
) -> str:
    """The page as HTML: paragraphs, figures with captions, and a table of the rows."""
    paragraphs = "".join(f"<p>{escape(one)}</p>" for one in said)
    shown = "".join(_figure(caption, image) for caption, image in zip(captions, images))
    groups = groupby(rows, key=lambda row: row["quantity"])
    table = HEAD + "".join(_group(quantity, list(group)) for quantity, group in groups)
    return framed(title, f'{paragraphs}{shown}<div class="wide"><table>{table}</table></div>')


def framed(title: str, body: str) -> str:
    """A page of its own, with nothing from elsewhere."""
    return FRAME.format(title=escape(title), body=body)


def _figure(caption: str, image: Image) -> str:
    caption = escape(caption)
    data = base64.b64encode(image.content).decode()
    image_tag = f'<img alt="{caption}" src="data:image/{image.file[-3:]};base64,{data}">'
    return f"<figure>{image_tag}<figcaption>{caption}</figcaption></figure>"


def _group(quantity: str, rows: Sequence[Record]) -> str:
    lines = "".join(
        f"<tr><td>{escape(row['method'])}</td><td class=n>{number(row['published'])}</td>"
        f"<td class=n>{number(row['measured'])}{_plus_minus(row['spread'])}</td>"
        f"<td class=n>{row['runs']:,}</td><td class=note>{escape(row['note'])}</td></tr>"
        for row in rows
    )
    return f"<tbody><tr><th colspan=5>{escape(quantity)}</th></tr>{lines}</tbody>"


def number(value: float | None) -> str:
    """Four significant digits; a dash where there is none."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.4g}".replace("-", "−")


def _plus_minus(spread: float | None) -> str:
    return "" if spread is None or not math.isfinite(spread) else f" <small>± {spread:.2g}</small>"


HEAD = (
    "<thead><tr><td>method</td><td class=n>published</td><td class=n>measured ± standard error</td>"
    "<td class=n>runs</td><td>note</td></tr></thead>"
)
FRAME = """<!doctype html>
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
{body}
</body></html>
"""
