"""What a method is to the drivers: something that makes a model ready to be run, and says what comes out.

Gaussian filters (`step`) are one kind; particle filters, Gaussian sums and Rao-Blackwellised filters (`particles`) are
others. What runs over a series does not ask which; what looks back does.
"""

from typing import Any, ClassVar, Protocol, runtime_checkable

from jaxtyping import Array, Float

from sigmapoint.model import StateSpaceModel
from sigmapoint.results import Posterior

MAKER = "a sp.Method such as sp.srcdkf(), or a particle filter such as sp.bootstrap(1000)"


@runtime_checkable
class Run(Protocol):
    """A model made ready for a method."""

    @property
    def model(self) -> StateSpaceModel:
        """What is run."""
        ...

    @property
    def method(self) -> Any:
        """What it is run with."""
        ...

    def init(self) -> Any:
        """What is known at instant 0, before any measurement."""
        ...

    def update(self, state: Any, y: Float[Array, " d"], u: Any, /) -> tuple[Any, Any]:
        """What is known after a measurement, and what that looked like."""
        ...

    def predict(self, state: Any, u: Any, /) -> Any:
        """What is known of the next instant."""
        ...


@runtime_checkable
class Recipe(Protocol):
    """A method: hashable, and equal to any other made in the same way."""

    posterior: ClassVar[type[Posterior]]
    """what a run of it gives"""
    state: ClassVar[type]
    """what it knows at one instant"""
    smoothers: ClassVar[str]
    """those that look back through it, in words; empty where there are none"""

    def fits(self, model: StateSpaceModel, /) -> None:
        """Raise where the model is none for this method."""
        ...

    def random(self, key: Any, /) -> Array | None:
        """The random key of a run, checked; nothing where nothing is drawn."""
        ...

    def ready(self, model: StateSpaceModel, key: Array | None = None, /) -> Run:
        """The model made ready; `key` is needed by `init`, and by what draws trajectories."""
        ...
