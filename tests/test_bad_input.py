"""Bad input gives one clear message that names the argument, before anything is compiled."""

import json
import re
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from particles.refused import REFUSED

import sigmapoint as sp

EYE1, EYE2 = np.eye(1), np.eye(2)


def f(x, u):
    return 0.9 * x


def h(x, u):
    return x[:1]


def model(**changes):
    parts = {
        "dynamics": f,
        "observation": h,
        "process_noise": EYE2,
        "observation_noise": EYE1,
        "initial": sp.Gaussian(np.zeros(2), EYE2),
    }
    return sp.StateSpaceModel(**{**parts, **changes})


def run(y=None, u=None, **changes):
    return sp.filter(model(**changes), np.ones((5, 1)) if y is None else y, u, sp.srcdkf())


NAN = np.array([[1.0, np.nan], [np.nan, 1.0]])
CASES = {
    "asymmetric Q": (lambda: model(process_noise=[[1.0, 0.5], [0.0, 1.0]]), "process_noise must be symmetric"),
    "negative variance": (
        lambda: model(process_noise=np.diag([1.0, -1e-3])),
        r"process_noise has a negative variance.*\[1, 1\]",
    ),
    "indefinite Q": (
        lambda: model(process_noise=[[1.0, 2.0], [2.0, 1.0]]),
        "process_noise must be positive semi-definite",
    ),
    "covariance without variance": (
        lambda: model(process_noise=[[0.0, 0.1], [0.1, 1.0]]),
        "process_noise must be positive",
    ),
    "NaN in Q": (lambda: model(process_noise=NAN), "process_noise has 2 NaN"),
    "Q of the wrong size": (lambda: model(process_noise=np.eye(3)), r"process_noise must be \(2, 2\)"),
    "Q as variances": (lambda: model(process_noise=np.ones(2)), r"process_noise must be a covariance.*jnp.diag"),
    "Q as a number": (lambda: model(process_noise=0.1), "process_noise must be a covariance"),
    "Q not square": (lambda: model(process_noise=np.ones((2, 3))), "process_noise must be a covariance"),
    "Q of strings": (lambda: model(process_noise="small"), "process_noise must be an array"),
    "Q missing": (lambda: model(process_noise=None), "process_noise must be an array"),
    "complex R": (lambda: model(observation_noise=EYE1 * 1j), "observation_noise must be real"),
    "infinite R": (lambda: model(observation_noise=[[np.inf]]), "observation_noise has 1 NaN or infinite"),
    "Q for too few instants": (
        lambda: run(process_noise=np.tile(EYE2, (3, 1, 1))),
        "process_noise is given for 3 instants, but y has 5",
    ),
    "one negative variance in a series": (
        lambda: model(process_noise=np.stack([EYE2, -EYE2])),
        "process_noise has a negative variance",
    ),
    "initial not a Gaussian": (lambda: model(initial=(np.zeros(2), EYE2)), "initial must be sp.Gaussian"),
    "mean and cov differ": (lambda: model(initial=sp.Gaussian(np.zeros(3), EYE2)), r"initial.cov must be \(3, 3\)"),
    "mean a number": (lambda: sp.Gaussian(0.0, EYE1), r"mean must be \(n,\)"),
    "NaN in the mean": (lambda: sp.Gaussian([0.0, np.nan], EYE2), "mean has 1 NaN"),
    "dynamics not a function": (lambda: model(dynamics=EYE2), "dynamics must be a function"),
    "a path that comes second, saving": (
        lambda: sp.save({"a": EYE1}, "s.npz"),
        r"save: path must be the name of a file, got dict; it comes first: save\(path, tree\)",
    ),
    "a path that comes second, loading": (
        lambda: sp.load({"a": EYE1}, "s.npz"),
        r"load: path must be the name of a file, got dict; it comes first: load\(path, like\)",
    ),
    "a drift as a structure": (
        lambda: sp.em(model(), np.ones((5, 1)), process_noise=sp.fixed(1.0)),
        "em: process_noise must be sp.full, sp.diagonal, sp.tied, None .*got Annealed",
    ),
    "names too few": (lambda: model(state_names=("a",)), "state_names must be 2 string"),
    "names twice": (lambda: model(state_names=("a", "a")), "state_names must differ"),
    "dynamics returns too much": (
        lambda: run(dynamics=lambda x, u: jnp.ones(3)),
        r"dynamics must return an array of shape \(2,\)",
    ),
    "dynamics returns a tuple of odd parts": (
        lambda: run(dynamics=lambda x, u: (x, x[0])),
        "dynamics must return one array",
    ),
    "observation returns a number": (
        lambda: run(observation=lambda x, u: x[0]),
        r"observation must return an array of shape \(1,\)",
    ),
    "y one-dimensional": (lambda: run(y=np.ones(5)), r"y must be \(T, m\).*y\[:, None\]"),
    "y too wide": (lambda: run(y=np.ones((5, 3))), r"y has 3 element.*observation returns 1.*\(T, 1\).*transposed"),
    "y transposed, with names": (
        lambda: run(y=np.ones((1, 5)), observation_names=("a",)),
        "observation_names must be 5 .*is y transposed",
    ),
    "online y too long": (
        lambda: sp.online(model()).update(sp.online(model()).init(), [1.0, 2.0]),
        r"y has 2 element.*observation returns 1.*single sample \(1,\)",
    ),
    "y masked": (
        lambda: run(y=np.ma.masked_invalid([[1.0], [np.nan]])),
        r"y must not be a masked array: pass y.astype\(float\).filled\(np.nan\)",
    ),
    "u masked": (lambda: run(u={"a": np.ma.masked_equal(np.arange(5), 3)}), r"u\['a'\] must not be a masked array"),
    "u of strings": (lambda: run(u={"a": np.array(list("abcde"))}), r"u\['a'\] must be an array of numbers, .* of <U1"),
    "y empty": (lambda: run(y=np.ones((0, 1))), "y has no rows"),
    "y without columns": (lambda: run(y=np.ones((5, 0))), "y has no columns"),
    "y of strings": (lambda: run(y=[["a"]]), "y must be an array of numbers, got an array of <U1$"),
    "y of rows of several lengths": (
        lambda: run(y=[np.ones(3), np.ones(2)]),
        "y must be .*, got list: .* inhomogeneous",
    ),
    "y an array of strings": (lambda: run(y=np.array([["a"]])), "y must be an array of numbers, got an array of <U1$"),
    "u a frame": (lambda: run(u=pd.DataFrame({"a": np.ones(5)})), "u is a table: pass {name: u"),
    "y infinite": (lambda: run(y=np.full((5, 1), np.inf)), "y has infinite values"),
    "NaN in u": (lambda: run(u={"a": np.array([0.0, np.nan, 0, 0, 0])}), r"u\['a'\] has 1 NaN.*index \(1,\)"),
    "u too short": (lambda: run(u=np.ones(4)), "u must have one row for each of the 5"),
    "u a number": (lambda: run(u=3.0), "u must have one row"),
    "R of the wrong size": (lambda: run(observation_noise=EYE2), r"observation_noise must be \(1, 1\)"),
    "keep unknown": (lambda: sp.filter(model(), np.ones((3, 1)), keep=("mean", "median")), "keep has unknown.*median"),
    "keep a number": (lambda: sp.filter(model(), np.ones((3, 1)), keep=3), "keep must be names out of mean, .*got 3"),
    "model not a model": (lambda: sp.filter(f, np.ones((3, 1))), "model must be a sp.StateSpaceModel"),
    "online y a matrix": (
        lambda: sp.online(model()).update(sp.online(model()).init(), np.ones((2, 1))),
        "y must be one measurement",
    ),
    "online y a number": (
        lambda: sp.online(model()).update(sp.online(model()).init(), 1.0),
        r"y must be one measurement of shape \(m,\), got shape \(\); for a single number pass \[y\]",
    ),
    "one of the compared draws without a key": (
        lambda: sp.compare(model(), np.ones((3, 1)), methods={"ekf": sp.ekf(), "cloud": sp.bootstrap(10)}),
        "cloud: key is missing",
    ),
    "fit with NumPy": (
        lambda: sp.fit(lambda theta: model(process_noise=np.diag([theta, 1.0])), jnp.ones(()), np.ones((3, 1))),
        r"build\(theta\) must be a function that JAX can trace",
    ),
    "online state a tuple": (lambda: sp.online(model()).predict((1, 2)), "state must come from"),
    "online y a string": (
        lambda: sp.online(model()).update(sp.online(model()).init(), "a"),
        "y must be an array of numbers",
    ),
    "iterated without parentheses": (lambda: sp.iterated(sp.srukf), r"method must be a sp.Method.*sp.srukf\(\)"),
    "augmented without parentheses": (lambda: sp.augmented(sp.srukf), r"method must be a sp.Method.*sp.srukf\(\)"),
    "extended without parentheses": (lambda: sp.extended_set(sp.ukf), r"method must be a sp.Method.*sp.ukf\(\)"),
    "alpha a string": (lambda: sp.ukf("a"), "alpha must be a number, got 'a'"),
    "w0 a string": (lambda: sp.srjulier_ukf("a"), "w0 must be a number"),
    "interval a string": (lambda: sp.srcdkf("a"), "h must be a number"),
    "order a string": (lambda: sp.srghkf("a"), "order must be a whole number of at least 2"),
    "smoother a string": (
        lambda: sp.smooth(model(), np.ones((3, 1)), smoother="rts"),
        r"smoother must be sp.rts\(\), .* or sp.ipls\(\), got str",
    ),
    "iterated zero times": (lambda: sp.iterated(sp.ekf(), 0), "iterations"),
    "iterated and augmented": (lambda: sp.iterated(sp.augmented(sp.ukf()), 2), "iterated"),
    "augmented and iterated": (lambda: sp.augmented(sp.iterated(sp.ukf(), 2)), "iterated"),
    "simulate nothing": (lambda: sp.simulate(model(), 0, key=jax.random.key(0)), "T must be"),
    "Hermite in many dimensions": (lambda: sp.filter(_wide(), np.ones((2, 1)), None, sp.ghkf()), "points"),
    "method without parentheses": (
        lambda: sp.filter(model(), np.ones((3, 1)), None, sp.ukf),
        r"method must be a sp.Method.*sp.ukf\(\)",
    ),
    "method in the place of u": (lambda: sp.filter(model(), np.ones((3, 1)), sp.ukf()), "u must be an array"),
    "space a string": (lambda: model(state_space="angles"), "state_space must be sp.angles"),
    "angle of an element that is not there": (
        lambda: model(state_space=sp.angles(7)),
        "state_space names the elements",
    ),
    "angle of a measurement that is not there": (
        lambda: run(observation_space=sp.angles(1)),
        "observation_space names",
    ),
    "Jacobian not a function": (lambda: model(dynamics_jacobian=EYE2), "dynamics_jacobian must be a function"),
    "Jacobian of the wrong shape": (
        lambda: run(dynamics_jacobian=lambda x, u: jnp.ones((1, 2))),
        r"dynamics_jacobian must return an array of shape \(2, 2\)",
    ),
    "observation names too many": (lambda: run(observation_names=("a", "b")), "observation_names must be 1 string"),
    "simulate a number": (lambda: sp.simulate(5, 3, key=jax.random.key(0)), "model must be"),
    "black box not a function": (lambda: sp.blackbox(3), "callable"),
    "half a worker": (lambda: sp.blackbox(f, workers=1.5), "blackbox: workers must be a whole number of at least 0"),
    "size a string": (lambda: sp.blackbox(f, size="a"), "blackbox: size must be a whole number of at least 1"),
    "an angle wider than its points can be": (lambda: _angle(3.63), "initial: the standard deviation of heading, 3.63"),
    "a key that is none": (lambda: sp.simulate(model(), 3, key="0"), "key must be"),
    "angles of half an element": (lambda: sp.angles(0.5), "angles: positions must be whole numbers"),
    "angles without indices": (lambda: sp.angles(), "angles"),
    "angles as a list": (lambda: sp.angles([0, 1]), r"angles: positions.*write sp.angles\(0, 1\)"),
    "a turn of letters": (lambda: sp.angles(0, period="a"), "angles: period, a full turn, must be a positive number"),
    "black box without a value": (
        lambda: run(dynamics=sp.blackbox(lambda x, u: [None, 1.0])),
        "blackbox: the function must return real numbers, got object: None",
    ),
    "black box of no elements": (lambda: sp.blackbox(f, size=0), "blackbox: size must be a whole number of at least 1"),
}


def _angle(std, method=None):
    parts = {"initial": sp.Gaussian(np.zeros(2), np.diag([std**2, 1.0])), "state_names": ("heading", "rate")}
    return sp.filter(model(**parts, state_space=sp.angles(0)), np.ones((3, 1)), None, method)


def _wide():
    return sp.StateSpaceModel(f, h, np.eye(9), EYE1, sp.Gaussian(np.zeros(9), np.eye(9)))


CASES |= REFUSED


def messages() -> dict[str, str]:
    """What each case raises, as `type: message`."""
    found = {}
    for name, (make, _) in CASES.items():
        try:
            make()
            found[name] = "nothing was raised"
        except Exception as error:
            found[name] = f"{type(error).__name__}: {error}"
    return found


@pytest.fixture(scope="module")
def as_a_user_sees_them() -> dict[str, str]:
    """In a process of its own, without the run-time checks of annotations that the tests switch on."""
    code = "import json, test_bad_input; print(json.dumps(test_bad_input.messages()))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=Path(__file__).parent, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("case", CASES)
def test_message_names_the_argument(case, as_a_user_sees_them):
    assert re.match("ValueError: .*" + CASES[case][1], as_a_user_sees_them[case], re.DOTALL), as_a_user_sees_them[case]


def test_an_angle_within_half_a_turn_and_a_derivative_at_one_point_are_fine():
    assert np.isfinite(_angle(1.0).mean).all()
    assert np.isfinite(_angle(3.63, sp.ekf()).mean).all()


def test_points_too_close_together_for_single_precision_are_named():
    eye = [jnp.eye(n, dtype=jnp.float32) for n in (1, 2)]
    start = sp.Gaussian(jnp.zeros(2, jnp.float32), eye[1])
    small = model(process_noise=eye[1], observation_noise=eye[0], initial=start)
    with pytest.warns(UserWarning, match=r"good to about 0.1 of a value only in float32: spread them \(alpha=1\)"):
        sp.filter(small, np.ones((3, 1)), method=sp.srukf(alpha=1e-3))
    sp.filter(small, np.ones((3, 1)), method=sp.srukf(alpha=0.1))
    sp.filter(model(), np.ones((3, 1)), method=sp.srukf(alpha=1e-3))


def test_a_seed_is_a_key():
    np.testing.assert_array_equal(sp.simulate(model(), 3, key=5)[0], sp.simulate(model(), 3, key=jax.random.key(5))[0])


def test_nearly_symmetric_is_accepted():
    Q = np.array([[1.0, 0.3], [0.3 + 1e-15, 1.0]])
    assert np.isfinite(run(process_noise=Q).mean).all()


def test_huge_and_tiny_scales_beside_each_other_are_accepted():
    Q = np.diag([1e12, 1e-18])
    post = run(process_noise=Q, initial=sp.Gaussian(np.zeros(2), Q))
    assert np.isfinite(post.cov).all()
    assert (post.std > 0).all()


@pytest.mark.parametrize("T", [1, 2])
def test_one_row_is_a_series(T):
    y = np.ones((T, 1))
    assert sp.filter(model(), y).mean.shape == (T, 2)
    assert sp.smooth(model(), y).mean.shape == (T, 2)


def test_inputs_of_integers_and_plain_lists_are_fine():
    post = sp.filter(model(dynamics=lambda x, u: 0.9 * x + u.astype(x.dtype)), [[1.0], [2.0]], np.array([1, 2]))
    assert np.isfinite(post.mean).all()
