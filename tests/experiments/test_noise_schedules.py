"""Series to learn, and that four choices of process noise learn them."""

import json

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

from sigmapoint.experiments import EXPERIMENTS
from sigmapoint.experiments.learning import ikeda as experiment
from sigmapoint.experiments.learning import mackey_glass_learning, noise_schedules
from sigmapoint.experiments.learning.curves import taught
from sigmapoint.experiments.publishing.results import Mean
from sigmapoint.problems import ikeda, mackey_glass
from sigmapoint.problems.autoregression import normalized, pairs


def test_a_pair_is_a_sample_with_those_before_newest_first():
    x, d = pairs(jnp.arange(5.0), 2)
    np.testing.assert_array_equal(x, [[1, 0], [2, 1], [3, 2]])
    np.testing.assert_array_equal(d, [[2], [3], [4]])


def test_the_ikeda_map_shrinks_areas_by_u_squared():
    for point in np.random.default_rng(0).normal(size=(5, 2)):
        det = jnp.linalg.det(jax.jacobian(ikeda.step)(jnp.asarray(point)))
        np.testing.assert_allclose(det, ikeda.U**2, rtol=1e-12)


def test_ikeda_is_chaotic():
    orbit = ikeda.drawn(4000, jax.random.key(0))

    def stretched(direction, point):
        after = jax.jacobian(ikeda.step)(point) @ direction
        return after / jnp.linalg.norm(after), jnp.log(jnp.linalg.norm(after))

    _, rates = jax.lax.scan(stretched, jnp.array([1.0, 0.0]), orbit)
    assert 0.4 < rates.mean() < 0.6  # the largest Lyapunov exponent is 0.51
    assert 0.45 < orbit[:, 0].std() < 0.53


def textbook_mackey_glass(until):
    """The method of steps: an ordinary differential equation over each delay, with the last solution as its input."""
    before, x, spans = (lambda t: 0.9), 0.9, []
    for start in np.arange(0, until, 30.0):

        def slope(t, x, before=before):
            y = before(t - 30)
            return 0.2 * y / (1 + y**10) - 0.1 * x

        solution = solve_ivp(slope, (start, start + 30), [x], "DOP853", dense_output=True, rtol=1e-12, atol=1e-12)
        x, before = solution.y[0, -1], lambda t, s=solution.sol: s(t)[0]
        spans.append(solution.sol(np.arange(start + 6, start + 31, 6.0))[0])
    return np.concatenate(spans)


def test_mackey_glass_is_the_method_of_steps():
    np.testing.assert_allclose(mackey_glass.series(50), textbook_mackey_glass(300), atol=2e-9)


def test_mackey_glass_is_of_fourth_order():
    exact = textbook_mackey_glass(300)
    coarse, fine = (np.abs(mackey_glass.series(50, steps=steps) - exact).max() for steps in (6, 12))
    assert 12 < coarse / fine < 22


def test_mackey_glass_has_the_autocorrelations_of_the_recipe():
    x = normalized(mackey_glass.series(4000))
    found = [float(jnp.mean(x[lag:] * x[:-lag])) for lag in (1, 2, 3)]
    np.testing.assert_allclose(found, [0.811, 0.442, 0.105], atol=0.01)


def test_a_run_is_taught_and_tested_on_pairs_of_its_own():
    x = jnp.arange(2 * 5.0).reshape(2, 5)  # of 2 runs, 3 for training
    (train, _), lessons = taught((x, x), 3, jnp.zeros((2, 1)), 4, jax.random.key(0))
    seen = train[lessons.order]
    np.testing.assert_array_equal(jnp.sort(seen), jnp.broadcast_to(x[:, None, :3], (2, 4, 3)))
    assert (seen[:, 0] != seen[:, 1]).any()
    np.testing.assert_array_equal(lessons.test[0], x[:, 3:])


def test_series_from_random_starts_have_left_them_behind():
    """Spread at one instant, over many, is that of the long run (0.28)."""
    many = jnp.stack([mackey_glass.drawn(2, key) for key in jax.random.split(jax.random.key(0), 300)])
    long = mackey_glass.series(4000)[500:].std()
    np.testing.assert_allclose(many.std(0), long, rtol=0.15)


def test_another_start_gives_another_mackey_glass_series():
    one, other = (mackey_glass.drawn(50, jax.random.key(seed)) for seed in (0, 1))
    assert one.shape == (50,)
    assert jnp.abs(one - other).max() > 0.1


def test_a_claim_against_several_falls_with_one_and_needs_all():
    more, less, open_ = Mean(1.0, 0.1, 5), Mean(-1.0, 0.1, 5), Mean(0.1, 0.1, 5)
    assert noise_schedules.verdict({"a": more, "b": more}) == "reproduced"
    assert noise_schedules.verdict({"a": more, "b": open_}) == "not decided by these runs"
    assert noise_schedules.verdict({"a": less, "b": open_, "c": less}) == "contradicted by a and c"


def test_a_quick_run_learns_and_is_written(tmp_path):
    small = experiment.TASK._replace(sizes=(3, 4, 1))
    rows = noise_schedules.run(small, None, 0, tmp_path, True)
    assert json.loads((tmp_path / "results.json").read_text()) == rows
    assert {p.name for p in tmp_path.glob("*.png")} == {"ikeda-noise.png", "ikeda-filters.png"}
    mse = {row["method"]: row["measured"] for row in rows if row["quantity"] == "test MSE after the last epoch"}
    assert len(mse) == 7
    assert max(mse.values()) < 0.9  # 1 is what knowing nothing gives


def test_networks_of_the_papers_sizes_are_learned():
    assert {"ikeda", "mackey-glass-learning"} <= EXPERIMENTS.keys()
    assert experiment.TASK.sizes == (10, 7, 1)
    assert mackey_glass_learning.TASK.sizes == (6, 10, 1)
    for task in (experiment.TASK, mackey_glass_learning.TASK):
        assert task.series(20, jax.random.key(0)).shape == (20,)
