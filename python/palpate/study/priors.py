"""What a study knows of a number before anything is fitted."""

from palpate.domain import Parameter, Prior
from palpate.study.model import PriorTable
from palpate.units import convert

FAR = 3.0
"""Standard deviations outside a range beyond which a prior contradicts it."""


def build_prior(parameter: Parameter, table: PriorTable | None) -> Prior | None:
    """Read a prior in the unit of its parameter.

    Raises
    ------
    ValueError
        A quantity of another kind.
    PalpateError
        No positive standard deviation, or a value far outside the range.
    """
    if table is None:
        return None
    prior = Prior(value=convert(table.value, parameter.unit), sd=convert(table.sd, parameter.unit))
    outside = max(parameter.lower - prior.value, prior.value - parameter.upper)
    if outside > FAR * prior.sd:
        raise ValueError(
            f"{table.value!r} is {outside / prior.sd:.3g} standard deviations outside the range of "
            f"'{parameter.name}', {parameter.lower:g} to {parameter.upper:g} {parameter.unit}; correct either"
        )
    return prior
