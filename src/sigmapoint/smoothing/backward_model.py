"""Two filters, the second on a backward model of the user's own: x[k] = b(x[k+1], u[k]) + noise, nonlinear."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from sigmapoint.belief import Belief, Spread
from sigmapoint.carry import known
from sigmapoint.checks import data_checks
from sigmapoint.compiled import series
from sigmapoint.conditioning import Joint, condition
from sigmapoint.filtering import fields
from sigmapoint.model import StateSpaceModel
from sigmapoint.noise import Additive, Gaussian, NonAdditive
from sigmapoint.smoothing.reversal import last_row
from sigmapoint.smoothing.smoother import Smoother, forward
from sigmapoint.step import Filter, FilterState


class Backward(Smoother, eqx.Module):
    """Two filters, the second on a backward model."""

    dynamics: Callable[..., Any]
    noise: Additive | NonAdditive
    initial: Gaussian

    def __call__(
        self, run: Filter, y: Array, u: Any, keep: tuple[str, ...], real: Array | None = None
    ) -> dict[str, Array]:
        states, kept = forward(run, y, u, keep, real)
        later = self.filtered(run, y, u, real)[0]
        kind, space = run.method.belief, run.model.state_space
        T = y.shape[0]
        last = last_row(T, real)

        def together(k: Array, belief: Belief, later: Belief) -> dict[str, Array]:
            n = belief.factor.shape[0]
            difference = space.residual(later.mean, belief.mean)[:, None]
            state = known(belief, n)
            seen = jnp.broadcast_to(k < last, n)
            given = condition(Joint(state, state, Spread(later.cov, later.factor)), difference, seen, kind)
            return fields(keep, kind.from_root(space.retract(belief.mean, given.step[:, 0]), given.root))

        return {**jax.vmap(together)(jnp.arange(T), states.belief, later), **kept}

    def filtered(self, run: Filter, y: Array, u: Any, real: Array | None = None) -> tuple[Belief, Belief]:
        """Beliefs about every state from the measurements after it, and from those and its own."""
        model = run.model
        if self.initial.mean.shape != model.initial.mean.shape:
            raise ValueError(
                f"two_filter: initial must have a mean of shape {model.initial.mean.shape}, as the states of the "
                f"model, got {self.initial.mean.shape}"
            )
        data_checks.long_enough(y.shape[0] - 1, noise=self.noise)
        back = Filter.of(
            StateSpaceModel(
                self.dynamics,
                model.observation,
                self.noise,
                model.observation_noise,
                self.initial,
                state_space=model.state_space,
                observation_space=model.observation_space,
            ),
            run.method,
        )

        def step(ahead: FilterState, row: tuple[Array, Array, Any, Any]) -> tuple[FilterState, tuple[Belief, Belief]]:
            k, y, u, before = row
            state = back.update(ahead._replace(step=k), y, u)[0]
            return back.predict(state._replace(step=k - 1), before), (ahead.belief, state.belief)

        before = jax.tree.map(lambda a: jnp.concatenate([a[:1], a[:-1]]), u)
        rows = (jnp.arange(y.shape[0]), y, u, before)
        return series.scan(step, back.init(), rows, real=real, reverse=True)[1]
