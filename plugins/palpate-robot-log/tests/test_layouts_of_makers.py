"""Files in makers' layouts are read right as ``inspect`` proposes, or asked about: never read wrong."""

import tomllib
from pathlib import Path

import pytest

from palpate.domain import Response
from palpate_indentation import CsvLoader, CsvSettings
from palpate_robot_log import RobotLogLoader, RobotLogSettings
from palpate_robot_log.reading.inspection import inspect_log

from .known_presses import DEPTH_MM, FORCE_N, TORQUE_NMM
from .layouts_of_makers import LAYOUTS

ENDS = {
    "curve": ("force", (0.0, 8.0), (0.0, 9.0510)),
    "micro": ("force", (0.0, 8e-3), (0.0, 9.0510e-6)),
    "uniaxial": ("uniaxial", (1.0, 1.2), (0.0, 0.012)),
    "simple_shear": ("simple_shear", (0.0, 0.2), (0.0, 0.012)),
    "compression": ("uniaxial", (0.8, 1.0), (-0.012, 0.0)),
}
"""Channel, and least and largest abscissa and ordinate, of what a file holds."""
QUESTIONS = {
    "Arduino and HX711": "not found",
    "strain gauge in volts": "the file gives 'V', which is no unit of force",
    "specimen by force alone": "give both scales, by the length and the area of the specimen",
    "stress of an unknown measure": "palpate does not convert a measure 'almansi'",
    "sensor in counts": "the file gives the unit 'counts', which is not known",
}
FAST = (
    "Zwick testXpert II",
    "Shimadzu Trapezium X",
    "Chinese machine, words for units",
    "Compression plates",
)


def proposed(path: Path) -> tuple[Response | None, str]:
    """Curves by the tables that are proposed for a file, or the question that they leave."""
    found = inspect_log(path)
    if problem := found.record["problem"]:
        return None, str(problem)
    table = tomllib.loads(found.study_text)["experiment"]
    settings = table.get("settings", {})
    if table["loader"] == "csv":
        return CsvLoader(CsvSettings.model_validate(settings)).load(path, found.test or None), ""
    return RobotLogLoader(RobotLogSettings.model_validate(settings)).load(path), ""


@pytest.mark.filterwarnings("ignore:Gimbal lock")
@pytest.mark.parametrize(
    "name",
    [name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in LAYOUTS],
)
def test_a_makers_file_is_read_right_or_asked_about(name: str, tmp_path: Path) -> None:
    layout = LAYOUTS[name]()
    path = tmp_path / f"file.{layout.ending}"
    path.write_bytes(layout.content)
    curves, question = proposed(path)
    if layout.holds == "question":
        assert QUESTIONS[name] in question
        return
    assert curves is not None, question
    if layout.holds == "press":
        assert {*curves} == {"force", "torque"}
        force, torque = curves["force"], curves["torque"]
        assert force.abscissa.max() == pytest.approx(DEPTH_MM, abs=0.1)
        assert force.ordinate.max() == pytest.approx(FORCE_N, abs=0.1)
        assert torque.abscissa.max() == pytest.approx(22.5, abs=0.1)
        assert torque.ordinate.max() == pytest.approx(TORQUE_NMM, abs=0.5)
        return
    channel, along, of = ENDS[layout.holds]
    assert [*curves] == [channel]
    for values, ends in ((curves[channel].abscissa, along), (curves[channel].ordinate, of)):
        assert (values.min(), values.max()) == pytest.approx(ends, rel=2e-5, abs=1e-9)
