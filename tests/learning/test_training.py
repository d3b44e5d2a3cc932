"""Training in epochs: the same whether it was interrupted or not, and it stops when it should."""

import os
import runpy
import signal
import subprocess
import sys
import textwrap

import jax.numpy as jnp
import numpy as np
import pytest

import sigmapoint as sp
from sigmapoint.learning import epochs, training
from sigmapoint.learning.checkpoints import fingerprint
from sigmapoint.learning.interrupts import uninterrupted


def problem(N=60):
    r = np.random.default_rng(0)
    x = r.uniform(-2, 2, size=(N, 1))
    d = np.sin(2 * x) + 0.05 * r.normal(size=(N, 1))
    w = {"in": r.normal(size=(6, 2)), "out": r.normal(size=(1, 7)) / 3}
    return x, d, w


def g(w, x):
    return w["out"] @ jnp.append(jnp.tanh(w["in"] @ jnp.append(x, 1.0)), 1.0)


SETTINGS = {"noise": 0.01, "drift": sp.annealed(1e-3, 0.99, floor=1e-7), "epochs": 3, "key": 5}


def test_it_learns_and_tells_how():
    x, d, w = problem()
    seen = []
    fit = sp.learn(g, w, x, d, **SETTINGS | {"epochs": 12}, validation=(x, d), progress=seen.append)
    assert fit.history.mse[-1] < 0.02 < fit.history.mse[0]
    assert fit.history.validation[-1] < fit.history.validation[0]
    assert fit.history.epochs == 12
    assert seen[-1].done == 1.0
    assert "epoch 12/12, 100%" in str(seen[-1])
    mean, std = fit.predict(x[0])
    assert abs(float(mean[0] - d[0, 0])) < 0.3
    assert 0 < float(std[0]) < 0.3
    assert str(fit).startswith("19 parameters after 12 epochs: squared error 0.0")
    assert fit.std_params["in"].shape == (6, 2)


def test_it_is_the_learner_in_the_order_of_the_key():
    x, d, w = problem(10)
    plain = sp.learn(g, w, x, d, noise=0.01)
    learner = sp.learner(g, w, noise=0.01)
    s = learner.init()
    for pair in zip(x, d):
        s, _ = learner.update(s, *pair)
    np.testing.assert_allclose(plain.state.mean, s.mean, rtol=1e-11)
    shuffled, again, other = (sp.learn(g, w, x, d, noise=0.01, key=key).state.mean for key in (1, 1, 2))
    np.testing.assert_array_equal(shuffled, again)
    assert not np.allclose(shuffled, other, rtol=1e-6)


def test_the_last_batch_may_be_smaller():
    r = np.random.default_rng(0)
    x = r.normal(size=(11, 3))
    d = x @ np.ones(3)
    batches = sp.learn(lambda w, x: w @ x, jnp.zeros(3), x, d, noise=0.1, batch=4, key=0)
    single = sp.learn(lambda w, x: w @ x, jnp.zeros(3), x, d, noise=0.1)
    np.testing.assert_allclose(batches.state.mean, single.state.mean, rtol=1e-10)
    assert int(batches.state.step) == 3


def test_it_stops_early_and_keeps_the_best():
    x, d, w = problem()
    elsewhere = (x + 10, d)  # what is learned does not help there
    fit = sp.learn(g, w, x, d, noise=0.01, epochs=50, key=0, validation=elsewhere, patience=2)
    errors = fit.history.validation
    assert fit.history.epochs < 50
    assert errors.argmin() == len(errors) - 3
    error = float(jnp.mean((fit.learner.setup.values(fit.state.mean, jnp.asarray(elsewhere[0])) - d) ** 2))
    np.testing.assert_allclose(error, errors.min(), rtol=1e-12)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_an_interrupted_run_goes_on_where_it_was(tmp_path, monkeypatch, dtype):
    x, d, w = problem()
    w = {name: value.astype(dtype) for name, value in w.items()}
    whole = sp.learn(g, w, x, d, **SETTINGS)
    monkeypatch.setattr(epochs, "LONGEST_CALL", 7)
    monkeypatch.setattr(training, "SAVED_EVERY", 0.0)
    file = tmp_path / "run.npz"

    def stop(progress):
        if progress.done > 0.4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sp.learn(g, w, x, d, **SETTINGS, checkpoint=file, progress=stop)
    seen = []
    resumed = sp.learn(g, w, x, d, **SETTINGS, checkpoint=file, progress=seen.append)
    assert seen[0].done > 0.4
    np.testing.assert_allclose(resumed.state.mean, whole.state.mean, rtol=1e-12 if dtype == np.float64 else 1e-5)
    np.testing.assert_allclose(resumed.history.mse, whole.history.mse, rtol=1e-12 if dtype == np.float64 else 1e-4)


def test_kill_and_resume(tmp_path, monkeypatch):
    """kill -9 while it trains; started again, it ends with the weights of a run that was left alone."""
    script = tmp_path / "train.py"
    script.write_text(
        textwrap.dedent("""
        import sys, numpy as np, jax, jax.numpy as jnp, sigmapoint as sp
        import equinox as eqx
        from sigmapoint.learning import epochs, training
        jax.config.update("jax_enable_x64", True)
        training.SAVED_EVERY, epochs.LONGEST_CALL = 0.0, 20
        r = np.random.default_rng(0)
        x = r.normal(size=(80, 2)); d = np.sin(x[:, 0]) * x[:, 1]
        w = eqx.nn.MLP(2, "scalar", 8, 1, activation=jnp.tanh, key=jax.random.key(0))
        g = lambda w, x: w(x)
        fit = sp.learn(g, w, x, d, noise=0.01, epochs=30, key=0, checkpoint=sys.argv[1] if len(sys.argv) > 2 else None,
                       progress=lambda p: print(p, flush=True))
        np.save(sys.argv[-1], fit.state.mean)
        """)
    )
    checkpoint, killed, alone = tmp_path / "c.npz", tmp_path / "killed.npy", tmp_path / "alone.npy"
    arguments = [sys.executable, str(script), str(checkpoint), str(killed)]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        for line in run.stdout:
            if "epoch 4/" in line:
                break
        os.kill(run.pid, signal.SIGKILL)
    assert run.returncode == -signal.SIGKILL
    assert checkpoint.exists()
    assert not killed.exists()
    again = subprocess.run(arguments, check=True, capture_output=True, text=True)
    assert "epoch 3/" not in again.stdout
    monkeypatch.setattr(sys, "argv", [str(script), str(alone)])
    monkeypatch.setattr(training, "SAVED_EVERY", training.SAVED_EVERY)  # what the script sets is taken back
    monkeypatch.setattr(epochs, "LONGEST_CALL", epochs.LONGEST_CALL)
    runpy.run_path(str(script))
    np.testing.assert_allclose(np.load(killed), np.load(alone), rtol=1e-12)


def test_a_checkpoint_of_another_run_is_refused(tmp_path):
    x, d, w = problem(10)
    file = tmp_path / "run.npz"
    sp.learn(g, w, x, d, noise=0.01, checkpoint=file)
    with pytest.raises(ValueError, match="other data or settings"):
        sp.learn(g, w, x, d + 1, noise=0.01, checkpoint=file)
    file.write_bytes(b"not one")
    with pytest.raises(ValueError, match="not of this training"):
        sp.learn(g, w, x, d, noise=0.01, checkpoint=file)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"targets": np.zeros((0, 1)), "inputs": np.zeros((0, 1))}, "B >= 1"),
        ({"targets": np.zeros((5, 1))}, "one row for each"),
        ({"epochs": 0}, "epochs"),
        ({"batch": 0}, "batch"),
        ({"patience": 2}, "validation"),
        ({"key": "a"}, "key"),
    ],
    ids=str,
)
def test_bad_settings(change, message):
    x, d, w = problem(10)
    with pytest.raises(ValueError, match=message):
        sp.learn(**({"function": g, "w0": w, "inputs": x, "targets": d, "noise": 0.1} | change))


def test_a_function_that_breaks_shows_in_the_history_and_is_never_the_best():
    x = np.arange(1.0, 9.0)
    breaks = np.where(x > 6, -1.0, 1.0)  # its root is NaN
    with pytest.warns(RuntimeWarning, match="not finite"):
        fit = sp.learn(lambda w, x: w * jnp.sqrt(x), 1.0, x * breaks, x, noise=1.0, epochs=2, validation=(x, x))
    assert np.isnan(fit.history.mse).all()
    assert np.isnan(fit.history.validation).all()
    assert float(fit.params) == 1.0


def test_without_targets_nothing_is_said_about_errors():
    x = np.ones(4)
    fit = sp.learn(lambda w, x: w * x, 1.0, x, np.full(4, np.nan), noise=1.0)
    assert np.isnan(fit.history.mse).all()
    assert float(fit.params) == 1.0


def test_what_cannot_be_written_or_validated_shows_before_training():
    x, d, w = problem(10)
    calls = []

    def seen(w, x):
        calls.append(1)
        return g(w, x)

    with pytest.raises(OSError, match="nowhere"):
        sp.learn(seen, w, x, d, **SETTINGS, checkpoint="/nowhere/at/all.npz", progress=calls.append)
    assert not any(isinstance(call, sp.Progress) for call in calls)
    with pytest.raises(ValueError, match="validation has no known target"):
        sp.learn(g, w, x, d, **SETTINGS, validation=(x, np.full_like(d, np.nan)))


def test_a_fingerprint_is_of_numbers_not_of_where_functions_are():
    one, other = ((np.arange(3.0), lambda x: x, {"a": 1}) for _ in range(2))
    np.testing.assert_array_equal(fingerprint("s", one), fingerprint("s", other))
    for different in ((np.arange(3), one[1], {"a": 1}), (one[0][None], one[1], {"a": 1}), (*one[:2], {"b": 1})):
        assert (fingerprint("s", one) != fingerprint("s", different)).any()
    assert (fingerprint("s", one) != fingerprint("t", one)).any()


def test_ctrl_c_waits_once_and_goes_to_who_was_to_get_it():
    heard = []
    before = signal.signal(signal.SIGINT, lambda *_: heard.append("own"))
    try:
        with uninterrupted():
            signal.raise_signal(signal.SIGINT)
            assert heard == []
            signal.raise_signal(signal.SIGINT)
            assert heard == ["own"]
        assert heard == ["own", "own"]
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        with uninterrupted():
            signal.raise_signal(signal.SIGINT)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        with pytest.raises(KeyboardInterrupt), uninterrupted():  # noqa: PT012
            signal.raise_signal(signal.SIGINT)
            heard.append("end")
        assert heard[-1] == "end"
    finally:
        signal.signal(signal.SIGINT, before)
