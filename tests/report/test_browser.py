"""The page in a browser: no error, every figure drawn, nothing wider than the screen, hover and zoom at work."""

import json
import re
import shutil
import subprocess
from html import unescape

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp
from sigmapoint.reporting import report

CHROMIUM = shutil.which("chromium")
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--enable-logging=stderr"),
    *("--virtual-time-budget=12000", "--dump-dom"),
)
# Drives the page as a hand would: the mouse over the middle of a figure, then a box drawn in it from left to right.
SHELL = """<iframe id="f" style="width:WIDTHpx;height:900px;border:0"></iframe><pre id="out"></pre><script>
const f = document.getElementById("f"), out = document.getElementById("out");
const pause = (ms) => new Promise((go) => setTimeout(go, ms));
async function seen() {
  await pause(6000);
  const d = f.contentDocument, count = (what) => d.querySelectorAll(what).length;
  const counts = { graphs: count(".graph"), drawn: count(".graph:has(svg.main-svg .trace)") };
  const [first, second] = Array.from(d.querySelectorAll(".graph")).filter((g) => g.layout.meta && g.layout.meta.series);
  const area = first.querySelector(".nsewdrag");
  area.scrollIntoView({ block: "center" });
  const box = area.getBoundingClientRect();
  const mouse = (what, type, part) => what.dispatchEvent(new f.contentWindow.MouseEvent(type, {
    bubbles: true, clientX: box.x + part * box.width, clientY: box.y + box.height / 2,
  }));
  mouse(area, "mousemove", 0.5);
  await pause(500);
  const hover = first.querySelector(".hoverlayer").textContent;
  const before = [first, second].map((g) => g.layout.xaxis.range.slice());
  mouse(area, "mousedown", 0.25);
  for (const part of [0.3, 0.4, 0.5]) mouse(d, "mousemove", part);
  mouse(d, "mouseup", 0.5);
  await pause(1500);
  const after = [first, second].map((g) => g.layout.xaxis.range.slice());
  return { ...counts, wide: d.documentElement.scrollWidth, hover, before, after };
}
f.onload = () => seen().then((found) => { out.textContent = JSON.stringify(found); },
                             (error) => { console.error(error); });
f.src = "PAGE";
</script>"""


def filtered():
    model = sp.StateSpaceModel(
        lambda x, u: 0.95 * x,
        lambda x, u: x[:1],
        0.1 * jnp.eye(2),
        jnp.eye(1),
        sp.Gaussian(jnp.zeros(2), jnp.eye(2)),
        state_names=("level", "</script><script>console.error('injected')</script>"),
    )
    x, y = sp.simulate(model, 5000, key=jax.random.key(0))
    return sp.filter(model, y), {"truth": x}


def identified():
    def build(theta):
        return sp.StateSpaceModel(
            lambda x, u: theta["a"] * x, lambda x, u: x, jnp.eye(1), theta["r"] * jnp.eye(1),
            sp.Gaussian(jnp.zeros(1), jnp.eye(1)), state_names=("level",),
        )  # fmt: skip

    _, y = sp.simulate(build({"a": 0.9, "r": 1.0}), 5000, key=jax.random.key(0))
    theta = {"a": sp.real(0.5, 0.2), "r": sp.positive(0.5, 0.5)}
    learned = sp.em(build({"a": 0.9, "r": 0.5}), y, initial=None, tolerance=1e-3, method=sp.ekf())
    dual = sp.dual(build, theta, cost=sp.maximum_likelihood(), state_method=sp.ekf(), parameter_method=sp.ekf())
    return {"estimate": dual.filter(y, epochs=2), "em": learned}, {}


@pytest.fixture(scope="module", params=[filtered, identified])
def page(request, tmp_path_factory):
    result, given = request.param()
    return report(result, tmp_path_factory.mktemp("page") / "report.html", title="A <b>title</b>", **given)


@pytest.mark.skipif(CHROMIUM is None, reason="needs the browser chromium, which is not on this machine")
@pytest.mark.parametrize("width", [1280, 390])
def test_every_figure_is_drawn_says_its_values_and_zooms_with_the_others(page, width, tmp_path):
    shell = tmp_path / "shell.html"  # a frame of exactly this width: windows have a least width
    shell.write_text(SHELL.replace("WIDTH", str(width)).replace("PAGE", page.as_uri()))
    extra = (
        f"--user-data-dir={tmp_path / 'profile'}",
        "--allow-file-access-from-files",
        f"--window-size={width + 40},900",
    )
    done = subprocess.run(
        [str(CHROMIUM), *FLAGS, *extra, shell.as_uri()], capture_output=True, text=True, timeout=120, check=True
    )
    assert not re.findall(r".*(?:CONSOLE|Uncaught|Refused).*", done.stderr)
    found = re.search(r'<pre id="out">(.+)</pre>', done.stdout)
    assert found, done.stdout[-500:]
    seen = json.loads(unescape(found[1]))
    assert seen["graphs"] == seen["drawn"] > 0
    assert seen["wide"] <= width
    assert re.match(r"2,[45]\d\d", seen["hover"])  # the middle of 5,000 samples
    assert "estimate" in seen["hover"]
    (whole, other), (zoomed, followed) = seen["before"], seen["after"]
    assert whole == other
    span = whole[1] - whole[0]
    np.testing.assert_allclose(zoomed, [whole[0] + span / 4, whole[0] + span / 2], atol=0.02 * span)
    assert followed == zoomed
