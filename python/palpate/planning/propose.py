"""Propose further presses of a run."""

from pathlib import Path

from palpate.errors import StudyError
from palpate.fitted import NO_INTERVALS, certainty_stage, fitted
from palpate.planning.candidates import Allowed, candidates, limits_of, usual
from palpate.planning.narrowing import ALL
from palpate.planning.stage import PlanningStage, Proposal
from palpate.planning.tables import for_robot
from palpate.plugins.catalogue import Plugins
from palpate.progress import SILENT, Progress
from palpate.study.reading import Study


def propose(
    study: Study,
    run_folder: Path,
    plugins: Plugins,
    progress: Progress = SILENT,
    *,
    allowed: Allowed | None = None,
    goal: str = ALL,
    n_presses: int = 1,
    n_points: int = 6,
) -> Proposal:
    """Rank further presses by how much they would narrow the joint fit; simulates each at likely parameters.

    Raises
    ------
    StudyError
        There is no joint fit with intervals, or nothing that is allowed is possible.
    """
    allowed = allowed or usual(study)
    limits, presses = limits_of(allowed, plugins.channels), candidates(study, plugins, allowed)
    with fitted(study, run_folder, plugins, progress) as (stored, simulations, cases):
        certain = certainty_stage(simulations, stored.inputs, cases)
        assessed = next(iter(certain.assessed(cases, joint_only=True)), None)
        if assessed is None:
            raise StudyError(NO_INTERVALS.format(run=run_folder, scenario=study.generalise_by))
        stage = PlanningStage(
            study=stored.study,
            measured=stored.inputs.measured,
            assessed=assessed,
            columns=certain.columns(assessed.case),
            refinement=certain.refinement,
            progress=progress,
        )
        proposal = stage.run(presses, goal, limits=limits, n_presses=n_presses, n_points=n_points)
        stored.run.write_proposal(for_robot(proposal, stored.inputs.limbs))
        return proposal
