"""What the core itself provides, through the same hooks as everyone else."""

from pydantic import Field

from palpate import _core, hookimpl
from palpate.domain import FloatArray
from palpate.interfaces import Sampler, Settings


class LatinHypercubeSettings(Settings):
    """Settings of :class:`LatinHypercube`."""

    centred: bool = Field(
        default=False, description="Put each point at the centre of its cell instead of anywhere in it."
    )


class LatinHypercube(Sampler):
    """Latin hypercube: one point in each of ``n_sets`` equal slices of every parameter."""

    name = "lhs"
    summary = "Latin hypercube: every slice of every parameter is visited once"
    Settings = LatinHypercubeSettings

    def draw(self, n_sets: int, n_parameters: int, seed: int) -> FloatArray:
        """Points (n_sets, n_parameters) in (0, 1); the same seed gives the same bits."""
        return _core.latin_hypercube(n_sets, n_parameters, seed, centred=self.settings.centred)


@hookimpl
def palpate_samplers() -> list[type[Sampler]]:
    """Provide the sampler of the paper."""
    return [LatinHypercube]
