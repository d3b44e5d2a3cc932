"""A simulator that JAX cannot trace gives the numbers of its traced twin, and its exceptions arrive as they are."""

import ctypes
import ctypes.util
import os
import pickle
import traceback
import weakref
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp
from sigmapoint.blackbox import MOST_KEPT, Ticket


def traced_step(x, u):
    return jnp.stack([x[0] + 0.1 * x[1], x[1] - 0.1 * jnp.sin(x[0]) + u["push"]])


def python_step(x, u):
    """The twin in plain Python."""
    return [x[0] + 0.1 * x[1], x[1] - 0.1 * np.sin(x[0]) + u["push"]]


def rows_step(x, u):
    return np.stack([x[:, 0] + 0.1 * x[:, 1], x[:, 1] - 0.1 * np.sin(x[:, 0]) + u["push"]], axis=1)


def compiled_step(x, u):
    """The twin with its sine from the C library."""
    return [x[0] + 0.1 * x[1], x[1] - 0.1 * LIBM.sin(x[0]) + u["push"]]


LIBM = ctypes.CDLL(ctypes.util.find_library("m"))
LIBM.sin.restype, LIBM.sin.argtypes = ctypes.c_double, [ctypes.c_double]
T = 30
U = {"push": np.linspace(-0.1, 0.1, T)}
Y = np.random.default_rng(0).normal(size=(T, 1))


def model(step, **more):
    return sp.StateSpaceModel(
        step,
        lambda x, u: jnp.sin(x[:1]),
        1e-3 * np.eye(2),
        0.1 * np.eye(1),
        sp.Gaussian(np.zeros(2), np.eye(2)),
        **more,
    )


@pytest.mark.parametrize(
    "box",
    [sp.blackbox(python_step), sp.blackbox(rows_step, vectorized=True), sp.blackbox(compiled_step)],
    ids=["python", "rows", "compiled"],
)
@pytest.mark.parametrize("method", [sp.srukf(), sp.augmented(sp.cdkf())], ids=["srukf", "augmented"])
def test_same_numbers_as_the_traced_twin(box, method):
    a, b = sp.filter(model(box), Y, U, method), sp.filter(model(traced_step), Y, U, method)
    np.testing.assert_allclose(a.mean, b.mean, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(a.cov, b.cov, rtol=1e-10, atol=1e-12)


def test_smoother_batch_online_and_simulation_take_a_black_box():
    box = sp.blackbox(python_step)
    a, b = model(box), model(traced_step)
    np.testing.assert_allclose(sp.smooth(a, Y, U).mean, sp.smooth(b, Y, U).mean, rtol=1e-10, atol=1e-12)
    batch = jnp.stack([jnp.asarray(Y), jnp.asarray(-Y)])
    many = [jax.vmap(lambda y, m=m: sp.filter(m, y, U, sp.srukf()).mean)(batch) for m in (a, b)]
    np.testing.assert_allclose(*many, rtol=1e-10, atol=1e-12)
    live = sp.online(a)
    assert live.predict(live.init(), {"push": 0.5}).mean[1] == pytest.approx(0.5)
    x, _ = sp.simulate(a, T, key=jax.random.key(0), u=U)
    np.testing.assert_allclose(x, sp.simulate(b, T, key=jax.random.key(0), u=U)[0], rtol=1e-10)


def test_whole_point_set_is_handed_over_at_once():
    sizes = []

    def step(x, u):
        sizes.append(x.shape)
        return rows_step(x, u)

    sp.filter(model(sp.blackbox(step, vectorized=True)), Y, U, sp.srukf())
    assert set(sizes) == {(5, 2)}
    assert len(sizes) == T


def test_worker_processes_give_the_same_numbers():
    box = sp.blackbox(python_step, workers=2)
    try:
        a = sp.filter(model(box), Y, U, sp.srukf())
        x, _ = sp.simulate(model(box), T, key=jax.random.key(0), u=U)  # one point for both of them
    finally:
        box.close()
    np.testing.assert_allclose(x, sp.simulate(model(traced_step), T, key=jax.random.key(0), u=U)[0], rtol=1e-10)
    np.testing.assert_allclose(a.mean, sp.filter(model(traced_step), Y, U, sp.srukf()).mean, rtol=1e-10, atol=1e-12)


class SimulatorError(Exception):
    pass


def failing_step(x, u):
    raise SimulatorError("valve stuck")


@pytest.mark.parametrize("run", [sp.filter, sp.smooth])
def test_an_exception_inside_arrives_with_its_own_type_and_traceback(run):
    with pytest.raises(SimulatorError, match="valve stuck") as caught:
        run(model(sp.blackbox(failing_step)), Y, U, sp.srukf())
    assert "failing_step" in "".join(traceback.format_tb(caught.value.__traceback__))
    sp.filter(model(sp.blackbox(python_step)), Y, U, sp.srukf())  # and the next run is not disturbed


def test_a_lambda_with_workers_is_told_what_to_write():
    box = sp.blackbox(lambda x, u: x, workers=1)
    with pytest.raises((AttributeError, pickle.PicklingError)) as caught:
        sp.filter(model(box), Y, U, sp.srukf())
    assert "not as a lambda" in caught.value.__notes__[0]
    box.close()


def test_numbers_that_lost_half_their_bits_on_the_way_are_refused():
    with pytest.raises(Ticket, match="a state of float64 arrived as float32"):
        sp.blackbox(python_step)._call(2, np.dtype(np.float64), np.zeros((1, 2), np.float32))


def deadly_step(x, u):
    os._exit(3)


def test_where_a_worker_dies_that_is_told_and_others_take_its_place():
    box = sp.blackbox(deadly_step, workers=1)
    for _ in range(2):
        with pytest.raises(BrokenProcessPool) as caught:
            sp.filter(model(box), Y, U, method=sp.srukf())
        assert "a worker process ended; did the simulator crash" in caught.value.__notes__[0]
        assert box._pool is None


def test_an_exception_in_a_worker_arrives_too():
    box = sp.blackbox(failing_step, workers=1)
    try:
        with pytest.raises(SimulatorError, match="valve stuck"):
            sp.filter(model(box), Y, U, sp.srukf())
    finally:
        box.close()


class OtherError(Exception):
    pass


def test_threads_get_their_own_exceptions():
    def other_step(x, u):
        raise OtherError("pump dry")

    def caught(step):
        one, found = model(sp.blackbox(step)), []
        for _ in range(15):
            try:
                sp.filter(one, Y, U, sp.srukf())
            except Exception as error:
                found.append(type(error))
        return found

    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(caught, (failing_step, other_step)))
    assert found == [[SimulatorError] * 15, [OtherError] * 15]


def test_under_jit_of_the_users_own_the_exception_is_told_in_the_text():
    run = jax.jit(lambda y: sp.filter(model(sp.blackbox(failing_step)), y, U, sp.srukf()).mean)
    with pytest.raises(jax.errors.JaxRuntimeError, match="SimulatorError in a blackbox: valve stuck"):
        run(jnp.asarray(Y)).block_until_ready()


def test_exceptions_nobody_asks_for_are_not_kept_forever():
    error = SimulatorError("valve stuck")
    first = weakref.ref(error)
    Ticket(error)
    del error
    assert first() is not None
    for _ in range(MOST_KEPT):
        Ticket(SimulatorError("valve stuck"))
    assert first() is None


def test_control_c_inside_comes_out_as_control_c():
    def interrupted(x, u):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sp.filter(model(sp.blackbox(interrupted)), Y, U, sp.srukf())


def test_extended_filter_needs_a_jacobian_and_says_so():
    box = sp.blackbox(python_step)
    with pytest.raises(ValueError, match="sigma-point method"):
        sp.filter(model(box), Y, U, sp.ekf())
    own = model(
        box,
        dynamics_jacobian=lambda x, u: (
            jnp.array([[1.0, 0.1], [0.0, 1.0]]) + jnp.array([[0.0, 0.0], [-0.1, 0.0]]) * jnp.cos(x[0])
        ),
    )
    np.testing.assert_allclose(
        sp.filter(own, Y, U, sp.ekf()).mean, sp.filter(model(traced_step), Y, U, sp.ekf()).mean, rtol=1e-10, atol=1e-12
    )


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: sp.blackbox(python_step, workers=-1), "workers"),
        (lambda: sp.blackbox(rows_step, workers=2, vectorized=True), "workers or vectorized"),
        (lambda: sp.filter(model(sp.blackbox(lambda x, u: [1.0])), Y, U, sp.ukf()), r"must return shape \(2,\)"),
        (lambda: sp.filter(model(sp.blackbox(lambda x, u: np.ones((3, 3)), vectorized=True)), Y, U, sp.ukf()), "rows"),
    ],
)
def test_bad_use_is_refused(make, word):
    with pytest.raises(ValueError, match=word):
        make()
