# ruff: noqa: E501 - a line of a layout is a line here
"""Units in the head of a file: in an object of JSON, a structure, a comment or keys above the names."""

import json
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from palpate.domain import FloatArray
from palpate.errors import CurveError
from palpate_robot_log.reading.inspection import inspect_log

from .layouts_of_makers import DEPTH, FORCE, SECONDS, rows
from .test_layouts_of_makers import proposed

pytestmark = pytest.mark.usefixtures("in_this_process")

UM, MN = (1e3 * DEPTH).tolist(), (1e3 * FORCE).tolist()
SAMPLES = [{"depth": depth, "force": force} for depth, force in zip(UM, MN, strict=True)]
UNITS = {"depth": "um", "force": "mN"}


def of_json(content: object, *more: object) -> bytes:
    return "\n".join(map(json.dumps, (content, *more))).encode()


def of_text(head: str, *columns: FloatArray) -> bytes:
    return "\n".join([head, *rows(*columns), ""]).encode()


def of_matlab(**content: object) -> bytes:
    stream = BytesIO()
    savemat(stream, content)
    return stream.getvalue()


HEADS: Mapping[str, bytes] = {
    "columns and units next to data.json": of_json({**UNITS, "units": UNITS, "depth": UM, "force": MN}),
    "header and data.json": of_json({"header": {"units": UNITS}, "data": {"depth": UM, "force": MN}}),
    "header and rows.json": of_json({"header": {"units": UNITS}, "rows": SAMPLES}),
    "unit by name, samples.json": of_json(
        {"meta": {"depth_unit": "um", "force_unit": "mN"}, "samples": SAMPLES}
    ),
    "named columns.json": of_json(
        {"columns": [{"name": n, "unit": u, "values": of} for (n, u), of in zip(UNITS.items(), (UM, MN), strict=True)]}
    ),
    "head in the first line.jsonl": of_json({"units": UNITS}, *SAMPLES),
    "columns of pandas.json": of_json(
        {f"{n} ({u})": dict(enumerate(of)) for (n, u), of in zip(UNITS.items(), (UM, MN), strict=True)}
    ),
    "structure of units.mat": of_matlab(test={"units": UNITS, "depth": np.array(UM), "force": np.array(MN)}),
    "list in a comment.csv": of_text("# Units = [s, um, mN]\ntime,depth,force", SECONDS, 1e3 * DEPTH, 1e3 * FORCE),
    "words in a comment.csv": of_text("# depth in um, force in mN\ndepth,force", 1e3 * DEPTH, 1e3 * FORCE),
    "names in a comment above their units.csv": of_text("# depth, force\n# um, mN", 1e3 * DEPTH, 1e3 * FORCE),
    "units in a comment below the names.csv": of_text("No.,depth,force\n#,um,mN", np.arange(41.0), 1e3 * DEPTH, 1e3 * FORCE),
    "keys above the names.csv": of_text("---\nunits:\n  depth: um\n  force: mN\n---\ndepth,force", 1e3 * DEPTH, 1e3 * FORCE),
    "no unit of the first column, grams under mm.csv": of_text("Points,Elapsed Time,Disp,Load\n ,Sec,um,g", np.arange(41.0), SECONDS, 1e3 * DEPTH, FORCE / 9.80665e-3),
    "seconds as a capital.csv": of_text("Time (S),Displacement (um),Force (mN)", SECONDS, 1e3 * DEPTH, 1e3 * FORCE),
    "unit behind each name.csv": of_text("Depth unit: um\nForce unit: mN\n\ndepth,force", 1e3 * DEPTH, 1e3 * FORCE),
}  # fmt: skip


@pytest.mark.parametrize("name", HEADS)
def test_units_in_the_head_of_a_file_count(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(HEADS[name])
    curves, problem = proposed(tmp_path / name)
    assert curves is not None, problem
    found = curves["force"]
    assert (found.abscissa.max(), found.ordinate.max()) == pytest.approx((8.0, FORCE.max()))


def test_two_units_of_one_name_in_the_head_are_none(tmp_path: Path) -> None:
    head = "# limits: force in N\n# force in mN\ndepth,force"
    (tmp_path / "t.csv").write_bytes(of_text(head, DEPTH, 1e4 * FORCE))
    assert "force spans 9.051e+04 and shows no unit" in proposed(tmp_path / "t.csv")[1]


@pytest.mark.parametrize("sep", [",", " "])
@pytest.mark.parametrize("remark", ["radius{}mm", "sensor:{}kN", "Max.{}5{}N"])
def test_a_unit_next_to_a_word_in_a_comment_is_of_no_column(remark: str, sep: str, tmp_path: Path) -> None:
    names = ["depth [mm]", "force"] if remark.count("{}") == 1 else ["t [s]", "depth [mm]", "force"]
    lines = rows(*[SECONDS, DEPTH, FORCE][-len(names) :], between=sep)
    head = sep.join(name.replace(" ", "") for name in names)
    (tmp_path / "t.txt").write_text("\n".join([f"# {remark.replace('{}', sep)}", head, *lines]))
    shown = [row[1:3] for row in inspect_log(tmp_path / "t.txt").tables[0].rows]
    assert ("depth[mm]", "mm") in shown
    assert ("force", "?") in shown


def test_units_in_a_comment_leave_those_of_names(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_bytes(of_text("# m, N\ndepth_mm,force", DEPTH, FORCE))
    curves, problem = proposed(tmp_path / "t.csv")
    assert curves is not None, problem
    assert curves["force"].abscissa.max() == pytest.approx(8.0)


@pytest.mark.parametrize("names", ["s,F", "d,N"])
def test_names_in_a_comment_may_be_letters_of_units(names: str, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_bytes(of_text(f"# {names}", DEPTH, FORCE))
    shown = [row[1] for row in inspect_log(tmp_path / "t.csv").tables[0].rows]
    assert shown == names.split(",")


@pytest.mark.parametrize(
    "content",
    [
        {"tags": [], "depth_mm": DEPTH.tolist(), "force_N": FORCE.tolist()},
        {"head": {}, "depth_mm": DEPTH.tolist(), "force_N": FORCE.tolist()},
        {
            "rows": [
                {"name": "press 1", "depth_mm": depth, "force_N": force}
                for depth, force in zip(DEPTH.tolist(), FORCE.tolist(), strict=True)
            ]
        },
    ],
    ids=["an empty list", "an empty object", "rows of one name"],
)
def test_what_describes_no_column_leaves_the_columns(content: object, tmp_path: Path) -> None:
    (tmp_path / "t.json").write_bytes(of_json(content))
    curves, problem = proposed(tmp_path / "t.json")
    assert curves is not None, problem
    assert curves["force"].abscissa.size == DEPTH.size


def test_yaml_is_named(tmp_path: Path) -> None:
    (tmp_path / "t.yaml").write_text("depth: [0.1, 0.2]\nforce: [1, 2]\n")
    with pytest.raises(CurveError, match="YAML is not read; save its fields as JSON"):
        inspect_log(tmp_path / "t.yaml")
