"""Curves of recorded logs are, number for number, those that the whole chain gave before."""

from pathlib import Path

import numpy as np
import pytest

from palpate_robot_log import RobotLogLoader, RobotLogSettings

from . import log_writers as write, simulated_logs as logs

CURVES = Path(__file__).parent / "data" / "robot_logs" / "curves.npz"
"""Rows of each curve: abscissa, ordinate, its standard deviation and time, by ``<spot>_<channel>``."""


def curves_of(spot: str, folder: Path) -> dict[str, np.ndarray]:
    """Curves of a log that is read from text, with every channel that it has."""
    path = folder / f"{spot}.csv"
    write.write_text(path, logs.columns(spot))
    settings = {"channels": write.MAP, "gravity": logs.WEIGHT, "over_time": {"enabled": True}}
    curves = RobotLogLoader(RobotLogSettings.model_validate(settings)).load(path).curves
    return {
        f"{spot}_{name}": np.stack([curve.abscissa, curve.ordinate, curve.std, curve.time_s])
        for name, curve in curves.items()
    }


@pytest.mark.parametrize("spot", logs.SPOTS)
def test_the_curves_of_a_recorded_log_stay_as_they_are(spot: str, tmp_path: Path) -> None:
    with np.load(CURVES) as stored:
        expected = {name: stored[name] for name in stored.files if name.startswith(spot)}
    found = curves_of(spot, tmp_path)
    assert {*found} == {*expected}
    for name, values in expected.items():
        sizes = np.abs(values).max(axis=1, keepdims=True)
        # Another processor adds in another order: by up to 3e-11 of the largest.
        np.testing.assert_allclose(found[name] / sizes, values / sizes, rtol=0.0, atol=1e-9, err_msg=name)
