"""A batch gives of every series what a run of its own gives."""

import os
import subprocess
import sys
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp
from sigmapoint import batching as batches
from sigmapoint.compiled import series


@cache
def _model(T: int = 30) -> sp.StateSpaceModel:
    return sp.StateSpaceModel(
        lambda x, u: jnp.stack([x[0] + 0.1 * x[1], x[1] - 0.1 * jnp.sin(x[0]) + u["push"]]),
        lambda x, u: x[:1] + u["offset"],
        0.01 * np.eye(2) * np.linspace(1, 2, T)[:, None, None],
        0.1 * np.eye(1),
        sp.Gaussian(np.zeros(2), np.eye(2)),
    )


def _inputs(r: np.random.Generator, *axes: int) -> dict[str, np.ndarray]:
    return {"push": r.normal(size=axes), "offset": r.normal(size=(*axes, 1))}


@pytest.fixture(scope="module", params=[False, True], ids=["in step", "one by one"])
def form(request):
    """Series in step under vmap, and each as a loop of its own with its end left out."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(series, "NATIVE", request.param)
        patch.setattr(series, "SKIPPED", 4)
        jax.clear_caches()
        yield
    jax.clear_caches()


def _same(found: sp.Posterior, expected: sp.Posterior) -> None:
    for name in ("mean", "cov", "std", "innovation", "innovation_cov", "nis", "log_likelihood", "y"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-10, atol=1e-12, err_msg=name)


@pytest.mark.parametrize(
    "smoother",
    [
        pytest.param(None, id="filter"),
        pytest.param(sp.rts(), id="rts"),
        pytest.param(sp.ipls(2), id="ipls", marks=pytest.mark.slow),
    ],
)
def test_series_of_different_lengths(form, smoother):
    r = np.random.default_rng(0)
    lengths = (7, 30, 1, 8, 29, 7, 25)
    ys = [r.normal(size=(T, 1)) for T in lengths]
    ys[1][3:6] = np.nan
    us = [_inputs(r, T) for T in lengths]
    found = sp.batch(_model(), ys, us, sp.srukf(), smoother=smoother)
    assert [post.mean.shape for post in found] == [(T, 2) for T in lengths]
    for i in (0, 1, 2):
        one = (_model(), ys[i], us[i], sp.srukf())
        _same(found[i], sp.filter(*one) if smoother is None else sp.smooth(*one, smoother=smoother))
        assert (found[i].u["push"] == us[i]["push"]).all()


def test_series_of_one_length(form):
    r = np.random.default_rng(1)
    y, u = r.normal(size=(19, 12, 1)), _inputs(r, 19, 12)
    found = sp.batch(_model(), y, u, sp.cdkf())
    assert found.mean.shape == (19, 12, 2)
    assert found.log_likelihood.shape == (19,)
    for i in (0, 18):
        part = jax.tree.map(lambda a, i=i: a[i], u)
        _same(jax.tree.map(lambda a, i=i: a[i], found), sp.filter(_model(), y[i], part, sp.cdkf()))


def test_what_is_kept_and_one_series_of_one_row(form):
    u = {"push": np.zeros((1, 1)), "offset": np.zeros((1, 1, 1))}
    found = sp.batch(_model(), np.ones((1, 1, 1)), u, keep=("mean",))
    assert found.mean.shape == (1, 1, 2)
    assert found.cov is None
    assert found.log_likelihood.shape == (1,)


def test_the_precision_is_that_of_the_caller():
    """Threads do not know of a context that the caller is in."""
    with jax.enable_x64(False):
        model = sp.StateSpaceModel(
            lambda x, u: x + jnp.zeros(1), lambda x, u: x, np.eye(1), np.eye(1), sp.Gaussian(np.zeros(1), np.eye(1))
        )
        assert sp.batch(model, np.ones((2, 3, 1)), keep=("mean",)).mean.dtype == jnp.float32


def test_it_may_be_called_inside_of_jit_and_grad():
    y = np.random.default_rng(0).normal(size=(3, 5, 1))

    def likelihood(q):
        model = sp.StateSpaceModel(
            lambda x, u: 0.9 * x, lambda x, u: x, q * jnp.eye(1), jnp.eye(1), sp.Gaussian(jnp.zeros(1), jnp.eye(1))
        )
        return sp.batch(model, y, keep=()).log_likelihood.sum()

    h = 1e-6
    value = jax.jit(likelihood)
    difference = (value(0.1 + h) - value(0.1 - h)) / (2 * h)
    np.testing.assert_allclose(value(0.1), likelihood(0.1), rtol=1e-12)
    np.testing.assert_allclose(jax.jit(jax.grad(likelihood))(0.1), difference, rtol=1e-7)


def test_little_is_filled_up():
    """Where series run in step, the longest of a piece counts for all."""
    lengths = np.random.default_rng(0).integers(20, 2000, 1000)
    rows = batches.Ragged(np.zeros((lengths.sum(), 1)), None, np.cumsum(lengths) - lengths, lengths)
    pieces = list(batches._pieces(rows, one_by_one=False))
    assert sorted(np.concatenate([piece.members for piece in pieces])) == list(range(1000))
    assert all((piece.lengths[: len(piece.members)] == lengths[piece.members]).all() for piece in pieces)
    assert sum(piece.y.shape[0] * piece.y.shape[1] for piece in pieces) < 1.15 * lengths.sum()


@pytest.mark.parametrize(
    ("y", "u", "message"),
    [
        (np.ones((3, 4)), None, r"y of a batch must be \(B, T, m\), or a list of arrays"),
        (np.ones((0, 4, 1)), None, "at least one series"),
        ([], None, "y is an empty list"),
        ([np.ones((3, 1)), np.ones((3, 2))], None, r"y\[1\] must be \(T, m\)"),
        ([np.ones((3, 1)), np.ones((0, 1))], None, r"y\[1\] must be \(T, m\)"),
        ([np.ones((3, 1))], {"push": 1}, "u must be a list of 1 pytrees"),
        ([np.ones((3, 1)), np.ones((3, 1))], [{"a": np.ones(3)}, {"b": np.ones(3)}], "same structure"),
        (np.ones((3, 4, 1)), {"push": np.ones((3, 5))}, r"u\['push'\] must have leading axes \(3, 4\)"),
        ([np.full((3, 1), np.inf)], None, "infinite"),
        ([np.ones((3, 1))] * 2, [np.zeros(3), np.full(3, np.nan)], "series 1: u has 3 NaN"),
        (np.ones((2, 3, 1)), np.array([[0, 0, 0], [0, np.nan, 0]]), r"u has 1 NaN .* at index \(1, 1\)"),
        ([np.ones((31, 1))], None, "process_noise is given for 30 instants, but y has 31 rows"),
    ],
)
def test_bad_input_is_named(y, u, message):
    with pytest.raises(ValueError, match=message):
        sp.batch(_model(), y, u)


def test_an_error_of_a_black_box_comes_out_as_it_was_raised():
    def broken(x, u):
        raise ArithmeticError("the simulator stopped")

    model = sp.StateSpaceModel(
        sp.blackbox(broken), lambda x, u: x, np.eye(1), np.eye(1), sp.Gaussian(np.zeros(1), np.eye(1))
    )
    with pytest.raises(ArithmeticError, match="the simulator stopped"):
        sp.batch(model, np.ones((5, 3, 1)), method=sp.ukf())


DEVICES = """
import numpy as np, jax, sigmapoint as sp
jax.config.update("jax_enable_x64", True)
assert jax.device_count() == 3
model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x, np.eye(1), np.eye(1),
                           sp.Gaussian(np.zeros(1), np.eye(1)))
y = np.random.default_rng(0).normal(size=(14, 6, 1))
found = sp.batch(model, y)
for i in range(14):
    np.testing.assert_allclose(found.mean[i], sp.filter(model, y[i]).mean, rtol=1e-13)
P = jax.sharding.PartitionSpec("series")
of_one = jax.vmap(lambda y: sp.filter(model, y).log_likelihood)
mesh = jax.sharding.Mesh(np.array(jax.devices()), "series")
spread = jax.shard_map(of_one, mesh=mesh, in_specs=P, out_specs=P, check_vma=False)
np.testing.assert_allclose(jax.jit(spread)(y[:12]), found.log_likelihood[:12], rtol=1e-12)
used = {d for f in (sp.batch(model, y[:3]).mean,) for d in f.devices()}
print("same", len(used))
"""


def test_several_devices(monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", f"{os.environ['XLA_FLAGS']} --xla_force_host_platform_device_count=3")
    run = subprocess.run([sys.executable, "-c", DEVICES], capture_output=True, text=True, check=False)
    assert run.stdout.startswith("same"), run.stderr
