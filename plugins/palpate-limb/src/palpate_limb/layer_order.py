"""The order of layers, from those that are named together."""

from collections.abc import Iterable, Sequence
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise

from palpate.api import MeshError

OUTERMOST = "skin"


def layer_order(together: Iterable[Sequence[str]]) -> tuple[str, ...]:
    """The only order of all layers, from the outside in, that agrees with every given one.

    Parameters
    ----------
    together : iterable of sequence of str
        Layers that are named together, from the outside in. ``skin`` is the outermost wherever it is named.

    Raises
    ------
    MeshError
        No order agrees with all of them, or several do; with the names of two layers.
    """
    graph: TopologicalSorter[str] = TopologicalSorter()
    outermost: tuple[str, ...] = ()
    for names in together:
        if OUTERMOST in names:
            outermost = (OUTERMOST,)
        inner = [name for name in names if name != OUTERMOST]
        for name in inner:
            graph.add(name)
        for above, below in pairwise(inner):
            graph.add(below, above)
    try:
        graph.prepare()
    except CycleError as error:
        first, second, *_ = error.args[1]
        raise MeshError(
            f"layers '{first}' and '{second}': each is named above the other, or above layers that are; name "
            "them in one order, from the outside in, at every spot"
        ) from None
    order: list[str] = []
    while graph.is_active():
        ready = sorted(graph.get_ready())
        if len(ready) > 1:
            raise MeshError(
                f"layers '{ready[0]}' and '{ready[1]}': which one is above the other is not said; name them "
                "together once, from the outside in: both for all spots, both for one, or both in the table"
            )
        order += ready
        graph.done(*ready)
    return (*outermost, *order)
