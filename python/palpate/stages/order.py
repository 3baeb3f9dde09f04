"""Order of stages: each after the stages that it needs."""

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from palpate.errors import PluginError
from palpate.plugins.registry import MORE, suggestion
from palpate.study.reading import Study

if TYPE_CHECKING:
    from palpate.stages.stage import Stage


def in_order(stages: "Mapping[str, Stage]", wanted: Iterable[str]) -> "list[Stage]":
    """Wanted stages and all that they need, each after those that it needs.

    A PluginError where there is no such stage, or stages need each other.
    """
    found: dict[str, Stage] = {}

    def add(name: str, path: tuple[str, ...]) -> None:
        if name in path:
            raise PluginError(f"stages need each other: {' → '.join([*path, name])}; leave one `needs` out")
        if name not in stages:
            by = f" that '{path[-1]}' needs" if path else ""
            raise PluginError(
                f"no stage '{name}'{by}{suggestion(name, stages)}; install its plugin ({MORE}), or give "
                f"the settings that it requires in [stages.{name}] of the study"
            )
        for need in stages[name].needs:
            add(need, (*path, name))
        found.setdefault(name, stages[name])

    for name in wanted:
        add(name, ())
    return list(found.values())


def stages_of_run(study: Study, stages: "Mapping[str, Stage]") -> "Iterator[Stage]":
    """Stages of a whole run, in order: the stages of every run, and the stages that the study asks for.

    What a run cannot do without comes before what may fail.
    """
    asked = {stage.name for stage in study.stages}
    wanted = [name for name, each in stages.items() if name in asked or each.is_in_run(study)]
    yield from in_order(
        stages, sorted(wanted, key=lambda name: (stages[name].comes_last, stages[name].may_fail))
    )
