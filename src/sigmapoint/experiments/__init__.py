"""The papers' experiments by name: `EXPERIMENTS[name].run(runs, seed, out, quick)`. Loaded when run.

To add one: a folder with a module `experiment`, whose `run(runs, seed, out, quick) -> list[dict]` ends in
`publishing.results.publish`, and one line in `EXPERIMENTS`. Where real data cannot be bundled, `run` has a fifth
argument, the folder with them or None, and the line says what the folder holds.
"""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

Run = Callable[..., list[dict[str, Any]]]


class Experiment(NamedTuple):
    """An experiment.

    Attributes:
        name: what the command line calls it.
        description: one line.
        run: `(runs, seed, out, quick) -> rows`: `runs` where not None is the number of Monte-Carlo runs (None: the
            experiment's own), `seed` seeds them, `out` is the folder for `results.json`, `report.html` and figures,
            `quick` asks for a small version. Where `data` is not empty also `(runs, seed, out, quick, folder)`.
        data: what a folder holds that the experiment can take its data from; empty where it takes none.
        timed: it takes times, so nothing should run beside it.
    """

    name: str
    description: str
    run: Run
    data: str = ""
    timed: bool = False


def _lazily(module: str) -> Run:
    """That of a folder's `experiment`, or of another module in it."""
    path = module if "." in module else f"{module}.experiment"

    def run(runs: int | None, seed: int, out: Path, quick: bool, *data: Path) -> list[dict[str, Any]]:
        if runs is not None and runs < 2:
            raise ValueError(f"runs must be at least 2, to show a spread; got {runs}")
        return import_module(f"sigmapoint.experiments.{path}").run(runs, seed, Path(out), quick, *data)

    return run


_ALL = (
    Experiment("scalar", "EKF and sigma-point filters on a scalar model with a cubic sensor", _lazily("scalar")),
    Experiment("transform", "mean and covariance through a nonlinearity: pictures, orders", _lazily("transform")),
    Experiment(
        "mackey-glass", "a chaotic series through noise, its network known", _lazily("mackey_glass"), timed=True
    ),
    Experiment("cost", "operations and times of an update against the number of weights", _lazily("cost"), timed=True),
    Experiment("robot-arm", "a network learns a robot arm: EKF, UKF, square roots", _lazily("learning.robot_arm")),
    Experiment(
        "four-regions", "a network learns four interlocking regions: two costs", _lazily("learning.four_regions")
    ),
    Experiment("ikeda", "a network learns the Ikeda map: four choices of process noise", _lazily("learning.ikeda")),
    Experiment(
        "mackey-glass-learning", "the same with the Mackey-Glass series", _lazily("learning.mackey_glass_learning")
    ),
    Experiment(
        "pendulum-parameters", "lengths and masses of a pendulum from its falls", _lazily("pendulum_parameters")
    ),
    Experiment(
        "pendulum-state", "a pendulum of which half the states are seen, held upright", _lazily("pendulum_state")
    ),
    Experiment("rosenbrock", "a curved valley: filters beside Levenberg-Marquardt and BFGS", _lazily("rosenbrock")),
    Experiment("smoother", "two-filter smoothers of noisy series, with networks backward", _lazily("smoother")),
    Experiment(
        "dual-mackey-glass", "a noisy series and its unknown network: dual, joint", _lazily("dual.dual_mackey_glass")
    ),
    Experiment("dual-ar", "the same with a chaotic autoregressive network, and EM", _lazily("dual.dual_ar")),
    Experiment("modes", "natural frequencies of two masses, estimated with their motion", _lazily("modes")),
    Experiment(
        "pendulum-adaptive", "a pendulum held upright while its masses are learned", _lazily("pendulum_adaptive")
    ),
    Experiment("f15", "a flight simulator as the model: a stabilator that fails", _lazily("f15"), timed=True),
    Experiment("battery-joint", "capacity and resistance of a real cell, with bars", _lazily("battery_joint")),
    Experiment(
        "upf-synthetic", "particle filters with proposals of Kalman filters: gamma noise", _lazily("upf_synthetic")
    ),
    Experiment("terrain", "an aircraft above one of several ridges that look alike", _lazily("terrain")),
    Experiment(
        "options",
        "interest rate and volatility from prices of options on an index",
        _lazily("options"),
        "c2925.prn to c3325.prn and p2925.prn to p3325.prn: day, price, index",
    ),
)

EXPERIMENTS: dict[str, Experiment] = {experiment.name: experiment for experiment in _ALL}
