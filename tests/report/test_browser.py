"""The page in a browser: no error, every figure drawn, nothing wider than the screen."""

import re
import shutil
import subprocess

import jax
import jax.numpy as jnp
import pytest

import sigmapoint as sp
from sigmapoint.reporting import report

CHROMIUM = shutil.which("chromium")
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--enable-logging=stderr"),
    *("--virtual-time-budget=8000", "--dump-dom"),
)
SHELL = """<iframe id="f" style="width:{width}px;height:900px;border:0"></iframe><pre id="out"></pre><script>
const f = document.getElementById("f");
setTimeout(() => {{
  const d = f.contentDocument, count = (what) => d.querySelectorAll(what).length;
  const seen = [count(".graph"), count(".graph:has(svg.main-svg .trace)"), d.documentElement.scrollWidth];
  document.getElementById("out").textContent = seen.join(" ");
}}, 6000);
f.src = "{page}";
</script>"""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    model = sp.StateSpaceModel(
        lambda x, u: 0.95 * x,
        lambda x, u: x[:1],
        0.1 * jnp.eye(2),
        jnp.eye(1),
        sp.Gaussian(jnp.zeros(2), jnp.eye(2)),
        state_names=("level", "</script><script>console.error('injected')</script>"),
    )
    x, y = sp.simulate(model, 5000, key=jax.random.key(0))
    return report(sp.filter(model, y), tmp_path_factory.mktemp("page") / "report.html", truth=x, title="A <b>title</b>")


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
@pytest.mark.parametrize("width", [1280, 390])
def test_every_figure_is_drawn_without_an_error(page, width, tmp_path):
    shell = tmp_path / "shell.html"  # a frame of exactly this width: windows have a least width
    shell.write_text(SHELL.format(width=width, page=page.as_uri()))
    extra = (
        f"--user-data-dir={tmp_path / 'profile'}",
        "--allow-file-access-from-files",
        f"--window-size={width + 40},900",
    )
    done = subprocess.run(
        [str(CHROMIUM), *FLAGS, *extra, shell.as_uri()], capture_output=True, text=True, timeout=120, check=True
    )
    assert not re.findall(r".*(?:CONSOLE|Uncaught|Refused).*", done.stderr)
    counts = re.search(r'<pre id="out">(\d+) (\d+) (\d+)</pre>', done.stdout)
    assert counts, done.stdout[-500:]
    graphs, drawn, wide = (int(c) for c in counts.groups())
    assert graphs == drawn > 0
    assert wide <= width
