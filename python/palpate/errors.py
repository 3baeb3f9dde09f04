"""Errors a user can fix.

Every message has what was wrong, where (file, row, key) and what to do about
it. The command line prints a :class:`PalpateError` without a traceback and ends
with exit code 2; anything else that escapes is a bug: a traceback and exit code 70.
A failed simulation is not an error but a row with a status
(:class:`palpate.domain.Status`).
"""

import shlex
from pathlib import Path

NUMPY_IN_ENERGY = (
    "JAX cannot differentiate an energy that calls numpy: take xp = stretches.__array_namespace__() and call "
    "xp.sum, xp.log … in place of np's, or jax.numpy in energy_from_F"
)


def typed(path: Path) -> str:
    """Path as it is typed in a command of a message."""
    return shlex.quote(path.as_posix())


class PalpateError(Exception):
    """A mistake in the input, with what, where and what to do."""


class StudyError(PalpateError):
    """study.toml is missing, malformed or inconsistent."""


class CurveError(PalpateError, ValueError):
    """A measured or simulated curve cannot be used."""


class ScoringError(PalpateError, ValueError):
    """Curves cannot be compared: degenerate normaliser or too little coverage."""


class SamplingError(PalpateError, ValueError):
    """A design cannot be drawn from these ranges."""


class MaterialError(PalpateError, ValueError):
    """A material is unknown, or has no stable reference state."""


class ParameterError(MaterialError):
    """A value or range of a parameter is missing, reversed, or has no physical meaning."""


class SolverError(PalpateError):
    """A solver cannot simulate the job: another kind of test, more regions, directions."""


class MeshError(PalpateError):
    """A limb cannot be simulated: inverted elements, no fixed nodes, no surface at the spot."""


class PluginError(PalpateError):
    """A plugin is broken, unknown, or clashes with another."""


class LedgerError(PalpateError):
    """The results on disk are in use, corrupt, of another version, or cannot be written."""


class ExecutorError(PalpateError):
    """Jobs cannot be submitted: no scheduler, other versions, no workers."""


class StoppedError(PalpateError):
    """The user stopped the run; everything finished is kept (exit code 130)."""


class FirstAnswerError(StoppedError):
    """The run has its first answer, and no more was asked for; :func:`palpate.run_study` ends there."""


class NothingSelectableError(PalpateError):
    """Every simulation failed, so no set can be selected (exit code 1)."""
