"""Ways to look back on a noisy series, by stage: the forward filter, a backward one, and both together."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

import sigmapoint as sp
from sigmapoint import affine
from sigmapoint.belief import Belief, SquareRoot
from sigmapoint.compiled import series
from sigmapoint.model import StateSpaceModel
from sigmapoint.problems.noisy_series import NOISE
from sigmapoint.smoothing.backward_model import Backward
from sigmapoint.smoothing.smoother import Smoother
from sigmapoint.smoothing.two_filter import informed
from sigmapoint.step import Filter, FilterState

F, B, S = "forward (F)", "backward (B)", "smoothed (S)"
LEAST = 1e-6
"""Information beside that of a backward filter, which has none of some directions at first."""


class Whole(eqx.Module):
    """A smoother of the whole state."""

    smoother: Smoother

    def stages(self, run: Filter, y: Float[Array, "T 1"], forward: Belief) -> dict[str, Float[Array, " T"]]:
        """Estimates of the sample by stage, where there is a backward filter also of that."""
        found = {S: self.smoother(run, y, None, ("mean",))["mean"][:, 0]}
        if isinstance(self.smoother, Backward):
            found[B] = self.smoother.filtered(run, y, None)[1].mean[:, 0]
        return found


class Linearised(eqx.Module):
    """The two-filter smoother of the linearised model."""

    def stages(self, run: Filter, y: Float[Array, "T 1"], forward: Belief) -> dict[str, Float[Array, " T"]]:
        """As of `Whole`; backward, with the measurement of the instant itself."""
        model = affine.linearized(run, jax.vmap(lambda b: SquareRoot(b.mean, b.factor))(forward), y, None)
        later = informed(model)

        def at(mean: Array, eta: Array, Z: Array, H: Array, r: Array) -> Array:
            information = Z @ Z.T + H.T @ H / NOISE + LEAST * jnp.eye(len(mean))
            return mean + jnp.linalg.solve(information, eta + H.T @ r / NOISE)

        backward = jax.vmap(at)(forward.mean, later.eta, later.Z, model.H, model.r)
        return {B: backward[:, 0], **Whole(sp.two_filter()).stages(run, y, forward)}


class Samplewise(eqx.Module):
    """A filter of the reversed series, by a model of its own; the two estimates of a sample alone are combined."""

    model: StateSpaceModel

    def stages(self, run: Filter, y: Float[Array, "T 1"], forward: Belief) -> dict[str, Float[Array, " T"]]:
        """As of `Whole`."""
        back = Filter.of(self.model, run.method)

        def step(ahead: FilterState, y: Array) -> tuple[FilterState, tuple[Belief, Belief]]:
            state = back.update(ahead, y, None)[0]
            return back.predict(state, None), (ahead.belief, state.belief)

        before, filtered = series.scan(step, back.init(), y, reverse=True)[1]
        m, n = forward.mean[:, 0], before.mean[:, 0]
        v, w = (jax.vmap(lambda belief: belief.std[0] ** 2)(beliefs) for beliefs in (forward, before))
        return {B: filtered.mean[:, 0], S: (m * w + n * v) / (v + w)}
