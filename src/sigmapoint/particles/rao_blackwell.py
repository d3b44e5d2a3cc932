"""Rao-Blackwellised particle filters: some elements of the state are drawn, the others stay Gaussian.

Every particle is a history of the drawn elements z and a Gaussian filter's belief about the state given that history,
in which z has no variance. Time takes the belief on; then z is drawn from its marginal and the belief conditioned on
it, by which the others learn from how z has moved. A measurement updates the belief, and multiplies the particle's
weight by the density that this belief predicted. Where the model is linear and Gaussian given z, nothing but z is
approximated (Doucet, de Freitas, Murphy & Russell 2000; Schön, Gustafsson & Nordlund 2005).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sigmapoint.carry import known
from sigmapoint.compiled.native import applied
from sigmapoint.compiled.series import of_each
from sigmapoint.conditioning import Joint, condition
from sigmapoint.model import StateSpaceModel
from sigmapoint.particles.instant import Instant
from sigmapoint.particles.normals import normals
from sigmapoint.particles.sampled import Draws, Sampled
from sigmapoint.particles.state import ParticleInfo, Surprise
from sigmapoint.particles.weights import Cloud, even, together, weighed
from sigmapoint.rules.linearization import Linearization
from sigmapoint.step import Filter, FilterState

RESAMPLED, DRAWN = range(2)
"""What random numbers are for."""


class RaoBlackwellisedState(Sampled):
    """What a Rao-Blackwellised particle filter knows at instant `step`.

    Attributes:
        filters: the states of N Gaussian filters, one for each particle.
        log_weights: logarithms of their weights (N,), which sum to one.
        ancestors: for each, its place among the particles of the instant before (N,).
        draws: where the filter is in its random numbers.

    Examples:
        >>> import jax.numpy as jnp, sigmapoint as sp
        >>> model = sp.StateSpaceModel(lambda x, u: 0.9 * x, lambda x, u: x[:1], jnp.eye(2), jnp.eye(1),
        ...                            sp.Gaussian(jnp.zeros(2), jnp.eye(2)))
        >>> state = sp.online(model, sp.rao_blackwellised(100, (0,))).init(key=0)
        >>> state.particles.shape, state.mean.shape, state.cov.shape
        ((100, 2), (2,), (2, 2))
    """

    filters: FilterState
    ancestors: Int[Array, " N"]

    @property
    def step(self) -> Int[Array, ""]:
        """The instant."""
        return self.filters.step[0]

    @property
    def particles(self) -> Float[Array, "N d"]:
        """The mean of each particle's belief: what was drawn, and what is expected of the others."""
        return self.filters.belief.mean

    @property
    def moments(self) -> Cloud:
        belief = self.filters.belief
        covs = belief.factor @ jnp.swapaxes(belief.factor, 1, 2)
        return together(self.log_weights, belief.mean, covs, self.space)


class RaoBlackwellisedFilter(NamedTuple):
    """A model made ready for a Rao-Blackwellised method."""

    filter: Filter
    method: Any
    key: Array | None

    @property
    def model(self) -> StateSpaceModel:
        """What is run."""
        return self.filter.model

    def init(self) -> RaoBlackwellisedState:
        """Draws of the initial belief, at instant 0."""
        N, mean, draws = self.method.particles, self.model.initial.mean, Draws.of(self.key)
        start = jax.tree.map(lambda a: jnp.broadcast_to(a, (N, *a.shape)), self.filter.init())
        return RaoBlackwellisedState(
            filters=self._drawn(draws.key_for(DRAWN), start),
            log_weights=even(N, mean.dtype),
            ancestors=jnp.arange(N, dtype=jnp.int32),
            draws=draws.after(),
            space=self.model.state_space,
        )

    def predict(self, state: RaoBlackwellisedState, u: Any) -> RaoBlackwellisedState:
        """Beliefs about the next instant, of the particles that are worth it, and draws from them."""
        key = state.draws.key_for(RESAMPLED)
        filters, log_weights, ancestors = self.method.resampler.where_due(key, state.log_weights, state.filters)
        ahead = of_each(lambda one: self.filter.predict(one, u), filters)
        drawn = self._drawn(state.draws.key_for(DRAWN), ahead)
        return state.replace(filters=drawn, log_weights=log_weights, ancestors=ancestors, draws=state.draws.after())

    def update(
        self, state: RaoBlackwellisedState, y: Float[Array, " e"], u: Any
    ) -> tuple[RaoBlackwellisedState, ParticleInfo]:
        """Beliefs after a measurement; elements that are NaN were not measured."""
        filters, infos = of_each(lambda one: self.filter.update(one, y, u), state.filters)
        log_weights, log_likelihood = weighed(state.log_weights, infos.log_likelihood)
        explained = log_likelihood > -jnp.inf
        filters = jax.tree.map(lambda new, old: jnp.where(explained, new, old), filters, state.filters)
        info = ParticleInfo.of(self._predicted(state, y, u), log_likelihood, log_weights)
        return state.replace(filters=filters, log_weights=log_weights, draws=state.draws.after()), info

    def _drawn(self, key: Array, filters: FilterState) -> FilterState:
        """Each belief given a draw of the sampled elements from it."""
        kind, space, places = (
            self.method.method.belief,
            self.model.state_space,
            jnp.asarray(self.method.places(self.model)),
        )
        noise = normals(key, filters.belief.factor.shape[:2], filters.belief.mean.dtype)

        def one(state: FilterState, noise: Array) -> FilterState:
            belief, nothing = state.belief, jnp.zeros((places.shape[0], 0), noise.dtype)
            slope = belief.factor[places]
            zero = jnp.zeros_like(slope[:, 0])
            joint = Joint(Linearization(zero, slope, nothing, zero, nothing), known(belief, noise.shape[0]), None)
            given = condition(joint, applied(slope, noise)[:, None], jnp.ones(places.shape, bool), kind)
            mean = space.retract(belief.mean, given.step[:, 0])
            return self.filter.about(kind.from_root(mean, given.root), state.step)

        return of_each(one, filters, noise)

    def _predicted(self, state: RaoBlackwellisedState, y: Array, u: Any) -> Surprise:
        """The measurement as the particles predicted it."""
        at = Instant.of(self.filter.system, state.step, y, u)
        means, covs = of_each(lambda one: self.filter.expected(one, y, u), state.filters)
        whole = together(state.log_weights, means, covs, at.functions.observation_space)
        return at.surprise(whole.mean, whole.cov)
