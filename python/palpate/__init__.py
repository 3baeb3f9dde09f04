"""palpate finds what soft tissue is made of from how it pushes back and twists.

The stages of a study as functions, for scripts and notebooks, with polars frames in and out::

    study = palpate.read_study("arm")
    measured, design = palpate.measure(study), palpate.sample(study)
    simulated = palpate.simulate(study, design, measured)
    scores = palpate.score(study, simulated, measured)
    palpate.select(study, scores, design)

>>> import palpate
>>> list(palpate.Plugins.load(entry_points=False).samplers)
['lhs', 'optimised_lhs', 'sobol']

Plugins mark their hooks with :data:`hookimpl`. Names are imported when they are
first used, so that ``import palpate`` costs next to nothing.
"""

import importlib
from types import MappingProxyType
from typing import TYPE_CHECKING

import pluggy

if TYPE_CHECKING:
    from palpate.domain import (
        Channel,
        Curve,
        Design,
        HomogeneousTests,
        Indentation,
        Job,
        Limb,
        Mesh,
        Normaliser,
        Parameter,
        ParameterSpace,
        RegionMaterial,
        Response,
        Scenario,
        Simulation,
        Sphere,
        Spot,
        Status,
        StudyTemplate,
    )
    from palpate.errors import PalpateError
    from palpate.notebook import generalise, measure, sample, score, select, simulate
    from palpate.pipeline import run_study
    from palpate.plugins.catalogue import Plugins
    from palpate.plugins.interfaces import (
        AnisotropicMaterial,
        Executor,
        ExperimentLoader,
        LimbSource,
        Material,
        Sampler,
        SetFilter,
        Settings,
        Solver,
    )
    from palpate.run.result import RunResult
    from palpate.study.reading import Study, read_study

__all__ = [
    "AnisotropicMaterial",
    "Channel",
    "Curve",
    "Design",
    "Executor",
    "ExperimentLoader",
    "HomogeneousTests",
    "Indentation",
    "Job",
    "Limb",
    "LimbSource",
    "Material",
    "Mesh",
    "Normaliser",
    "PalpateError",
    "Parameter",
    "ParameterSpace",
    "Plugins",
    "RegionMaterial",
    "Response",
    "RunResult",
    "Sampler",
    "Scenario",
    "SetFilter",
    "Settings",
    "Simulation",
    "Solver",
    "Sphere",
    "Spot",
    "Status",
    "Study",
    "StudyTemplate",
    "__version__",
    "generalise",
    "hookimpl",
    "measure",
    "read_study",
    "run_study",
    "sample",
    "score",
    "select",
    "simulate",
]

__version__ = "0.1.0"

hookimpl = pluggy.HookimplMarker("palpate")
"""Marks a function of a plugin as the implementation of a hook of :mod:`palpate.plugins.hookspecs`."""

_HOMES = MappingProxyType(
    {
        "errors": ("PalpateError",),
        "plugins.interfaces": (
            "AnisotropicMaterial",
            "Executor",
            "ExperimentLoader",
            "LimbSource",
            "Material",
            "Sampler",
            "SetFilter",
            "Settings",
            "Solver",
        ),
        "pipeline": ("run_study",),
        "run.result": ("RunResult",),
        "plugins.catalogue": ("Plugins",),
        "notebook": ("generalise", "measure", "sample", "score", "select", "simulate"),
        "study.reading": ("Study", "read_study"),
    }
)


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module 'palpate' has no attribute '{name}'")
    home = next((module for module, names in _HOMES.items() if name in names), "domain")
    value: object = getattr(importlib.import_module(f"palpate.{home}"), name)
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
