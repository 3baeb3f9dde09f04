"""Contract tests that a plugin's own suite inherits.

Subclass the contract of what you provide, override its fixtures, and pytest
runs the laws that palpate relies on::

    from palpate.testing import MaterialContract

    class TestMyTissue(MaterialContract):
        @pytest.fixture
        def material(self):
            return MyTissue()
"""

from palpate.testing.components import ComponentContract, check_described, overridden, plugins_with
from palpate.testing.executors import ExecutorContract, LinearMaterial
from palpate.testing.files import Expected, LimbSourceContract, LoaderContract
from palpate.testing.fits import (
    ParametrisationContract,
    Rehearsal,
    SamplerContract,
    SearchContract,
    SetFilterContract,
)
from palpate.testing.materials import MaterialContract
from palpate.testing.presses import ChannelContract, IndenterContract, MotionContract, ScenarioContract
from palpate.testing.solvers import SolverContract
from palpate.testing.stages import ScoreContract, StageContract
from palpate.testing.studies import SmallStudy, StudyRunner, study_runner

__all__ = [
    "ChannelContract",
    "ComponentContract",
    "ExecutorContract",
    "Expected",
    "IndenterContract",
    "LimbSourceContract",
    "LinearMaterial",
    "LoaderContract",
    "MaterialContract",
    "MotionContract",
    "ParametrisationContract",
    "Rehearsal",
    "SamplerContract",
    "ScenarioContract",
    "ScoreContract",
    "SearchContract",
    "SetFilterContract",
    "SmallStudy",
    "SolverContract",
    "StageContract",
    "StudyRunner",
    "check_described",
    "overridden",
    "plugins_with",
    "study_runner",
]
