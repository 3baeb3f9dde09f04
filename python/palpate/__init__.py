"""palpate identifies material parameters of soft tissue from indentation force and torque.

A study is run as by the command line, and what the run has found is read back from its folder::

    palpate.run_study(palpate.read_study("arm"), "runs/arm")
    run = palpate.open_run("runs/arm")
    run.intervals, run.curves
    run.material("soft_tissue").stress(1.2, mode="uniaxial")
    run.plot().savefig("curves.svg")

Plugins mark their hooks with :data:`hookimpl`. Names are imported when they are
first used, so that ``import palpate`` is fast.

Examples
--------
>>> import palpate
>>> list(palpate.Plugins.load(entry_points=False).samplers)
['lhs', 'optimised_lhs', 'sobol']
"""

from typing import TYPE_CHECKING

import pluggy

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.domain import (
        Channel as Channel,
        Curve as Curve,
        Design as Design,
        HomogeneousTests as HomogeneousTests,
        Indentation as Indentation,
        Job as Job,
        Limb as Limb,
        Mesh as Mesh,
        Normaliser as Normaliser,
        Parameter as Parameter,
        ParameterSpace as ParameterSpace,
        RegionMaterial as RegionMaterial,
        Response as Response,
        Scenario as Scenario,
        Simulation as Simulation,
        Spot as Spot,
        Status as Status,
        StudyTemplate as StudyTemplate,
    )
    from palpate.domain.component import Settings as Settings
    from palpate.domain.indenter import Sphere as Sphere
    from palpate.domain.material import (
        AnisotropicMaterial as AnisotropicMaterial,
        IsotropicMaterial as IsotropicMaterial,
        Material as Material,
    )
    from palpate.errors import PalpateError as PalpateError
    from palpate.fit.problem import Problem as Problem
    from palpate.plugins.catalogue import Plugins as Plugins
    from palpate.plugins.execution import Executor as Executor
    from palpate.plugins.interfaces import (
        ExperimentLoader as ExperimentLoader,
        LimbSource as LimbSource,
        Sampler as Sampler,
        SetFilter as SetFilter,
        Solver as Solver,
    )
    from palpate.plugins.provides import Provides as Provides
    from palpate.stages.open_problem import open_problem as open_problem
    from palpate.stages.pipeline import RunResult as RunResult, run_study as run_study
    from palpate.stages.saved_run import SavedRun as SavedRun, open_run as open_run
    from palpate.study.reading import Study as Study, read_study as read_study

__version__ = "0.1.0"

hookimpl = pluggy.HookimplMarker("palpate")
"""Marks a function of a plugin as the implementation of a hook of :mod:`palpate.plugins.hookspecs`."""

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
    __dir__ = __getattr__("__dir__")
