"""A prediction as files: tables, VTU of the skin, a figure, and a page."""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import polars as pl

from palpate.api import Channel, Indenter, Quantity, SurfaceStates
from palpate.api.cli import Closed
from palpate.api.files import write_atomically
from palpate.api.fit import Adequacy
from palpate.api.report import Block, Paragraph, Picture, Table, rounded
from palpate.api.runs import file_name, parquet
from palpate_prediction.bands import ENDS, errors_of
from palpate_prediction.predict import Prediction, SpotPrediction
from palpate_prediction.summary import QUANTITIES
from palpate_report.api import Headline, comparison_page, in_words


class PredictOutput(Closed):
    """A prediction: tables as rows, and its files; ``notes`` are the sentences of its page.

    ``source`` is ``fit`` or the set whose values are used, ``n_draws`` counts draws of linear bands.
    ``verdict`` is the verdict on the model: "describes", "approximates" or "does not describe".
    """

    source: str
    verdict: str
    scenario: str
    n_draws: int
    notes: list[str]
    summary: list[dict[str, Any]]
    strains: list[dict[str, Any]]
    files: list[str]


CardOutput = dict[str, Any]
"""Card of each region: an object for ``--for json``, else text."""


VERDICTS: Mapping[Adequacy, str] = MappingProxyType(
    {
        Adequacy.DESCRIBES: "The model describes the curves of the experiment within its error budget.",
        Adequacy.APPROXIMATES: "The model approximates the curves of the experiment: its parameters are "
        "effective ones, for the strains of the experiment alone.",
        Adequacy.FAILS: "warning: the model does not describe the curves of the experiment, so this is no "
        "prediction of the tissue; see the report of the run.",
    }
)
"""Sentence on the verdict on the model of a run."""

BANDS = {"linear": "90 % band", "solved": "90 % band of simulated draws"}
"""Heads of the bands in the table of the page, by the beginning of their columns."""


def write_prediction(
    prediction: Prediction, channels: Mapping[str, Channel], notice: str, folder: Path
) -> tuple[Path, ...]:
    """Write everything into a folder; the page comes last, as ``index.html``."""
    from palpate_prediction.figure import draw

    files = []
    names = ("summary", "strains", "states", "curves")
    tables = {name: frame for name in names if (frame := getattr(prediction, name)).height}
    for name, frame in tables.items():
        write_atomically(folder / f"{name}.parquet", parquet(frame))
        write_atomically(folder / f"{name}.csv", frame.write_csv().encode())
        files += [folder / f"{name}.parquet", folder / f"{name}.csv"]
    for spot, each in prediction.spots.items():
        files.append(folder / f"{file_name(spot)}.vtu")
        write_surface(files[-1], each.states, each.at)
    figures = draw(prediction, channels, folder)
    (svg,) = (path for path in figures if path.suffix == ".svg")
    picture = Picture(label="Curves, contact pressure and contact shear", content=svg.read_bytes())
    texts, first = [Paragraph(text) for text in notes(prediction, notice)], 2 + bool(notice)
    # First what is predicted, with the verdict and the place of an extrapolation; then how it is made.
    top: list[Block] = [*texts[:first], texts[-1], summary_table(prediction.summary), picture]
    page = comparison_page(
        f"Prediction for {prediction.tool.name}",
        (*top, *texts[first:-1], *_strains(prediction.strains)),
        [path.relative_to(folder) for path in (*files, *figures)],
    )
    write_atomically(folder / "index.html", page.encode())
    return (*files, *figures, folder / "index.html")


def summary_table(frame: pl.DataFrame) -> Table:
    """Quantities under the tool with their bands."""
    known = {name for name in frame.columns if frame[name].count()}
    bands = {name: head for name, head in BANDS.items() if f"{name}_lower" in known}
    rows = []
    for row in frame.iter_rows(named=True):
        values = [
            Headline(
                parameter=row["quantity"],
                unit=row["unit"],
                value=row["value"],
                lower=row[f"{name}_lower"],
                upper=row[f"{name}_upper"],
            )
            for name in bands
        ]
        value = next((each.text for each in values if each.interval), rounded(row["value"]))
        name = f"{row['quantity']} ({row['unit']})"
        rows.append([row["spot"], name, value, *(each.interval or None for each in values)])
    caption = "Under the tool, at its largest force"
    return Table(caption, ["spot", "quantity", "value", *bands.values()], rows, numeric=frozenset({2}))


def _strains(frame: pl.DataFrame) -> Iterator[Table]:
    """Strains of the experiment and of the prediction in words; none where the solver reports none."""
    rows = [
        [
            row["spot"],
            in_words(row["region"]),
            ENDS[row["strain"]],
            rounded(row["experiment"]),
            rounded(row["prediction"]),
            f"from depth {row['from_depth_mm']:.3g} mm" if row["beyond"] else "no",
        ]
        for row in frame.iter_rows(named=True)
    ]
    if rows:
        columns = ("spot", "region", "strain", "experiment", "prediction", "beyond the experiment")
        caption = "Strains of the experiment and of the prediction"
        yield Table(caption, columns, rows, numeric=frozenset({3, 4}))


def write_surface(path: Path, states: SurfaceStates, state: int) -> None:
    """Write one state of the skin as VTU, which ParaView reads; points are of the undeformed limb."""
    import meshio  # here: slow to import

    meshio.write_points_cells(
        path,
        states.points_mm,
        [("triangle", states.triangles)],
        point_data={
            "displacement_mm": states.displacements_mm[state],
            "contact_pressure_MPa": states.pressures_MPa[state],
            "contact_shear_MPa": states.shears_MPa[state],
            "touching": states.touching[state],
        },
    )


def _sized(indenter: Indenter[Any]) -> str:
    """Kind of an indenter and its sizes, as ``box (width 10 mm, turn 30 deg)``."""
    fields = type(indenter.settings).model_fields.items()
    units = [(name, each) for name, field in fields for each in field.metadata if isinstance(each, Quantity)]
    given = ((name, getattr(indenter.settings, name), each.unit) for name, each in units)
    sizes = (f"{name} {value:g} {unit}" for name, value, unit in given if value)
    return f"{indenter.name} ({', '.join(sizes)})"


def notes(prediction: Prediction, notice: str) -> list[str]:
    """Notes that a reader of the numbers must know."""
    found, tool = prediction.fitted, prediction.tool
    lines = [f"{notice.capitalize()}."] if notice else []
    lines.append(
        f"Prediction for a {_sized(tool.protocol.indenter)} with friction {tool.protocol.friction:g}, by "
        f"the {found.source} of scenario {found.scenario} at {', '.join(found.spots)}."
    )
    if found.is_fit:
        lines.append(VERDICTS[prediction.verdict])
    sources = ((spot, each.source) for spot, each in prediction.spots.items() if each.source)
    lines += [f"The spots differ: {spot} has the values of the {source}." for spot, source in sources]
    if prediction.record_s and tool.protocol.time_s is not None:
        lines.append(_in_time(float(tool.protocol.time_s[-1]), prediction.record_s))
    if prediction.n_draws and any(each.bands for each in prediction.spots.values()):
        lines.append(
            f"90 % bands hold 90 % of {prediction.n_draws} draws, linearised around one simulation. "
            "Each draw has fitted values, a friction of the tool, a mesh error and a model error. "
            "Assumed: pressure and shear scale with force; the contact area is fixed."
        )
        channels = dict.fromkeys(c for each in prediction.spots.values() for c in each.bands)
        lines.append(_of_model(prediction.model_errors, channels))
        lines += [f"Mesh error at {spot}: {_errors(each)}." for spot, each in prediction.spots.items()]
        lines += [
            f"warning: at {spot} these errors come from [budget] alone, and may be far larger under another "
            f"tool: {each.mesh_unknown}."
            for spot, each in prediction.spots.items()
            if each.mesh_unknown
        ]
        if any(each.by_force for each in prediction.spots.values()):
            lines.append(
                "The tool is force-controlled, so no bands are given for areas, mean pressure and shear."
            )
    elif not prediction.n_draws:
        lines.append("The run has no intervals, so nothing is known of how certain this is.")
    lines += [_solved(spot, each) for spot, each in prediction.spots.items() if each.n_asked]
    failed = [f"{s} ({p.simulation.message})" for s, p in prediction.spots.items() if p.simulation.message]
    lines += [f"Not pressed to the end: {text}." for text in failed]
    return [*lines, beyond(prediction.strains)]


def _in_time(motion_s: float, record_s: float) -> str:
    """Sentence on the rate of the tool, and on time that no record tells of."""
    text = f"The tissue relaxes in the {motion_s:.3g} s of the tool's motion."
    if motion_s <= record_s:
        return text
    return f"warning: {text} The experiment tells {record_s:.3g} s of it: later forces are an extrapolation."


def _of_model(errors: pl.DataFrame, channels: Collection[str]) -> str:
    """Sentence on the model error of the curves of some channels."""
    if errors.is_empty():
        return "warning: The bands lack the model error. Run `palpate run` again to store it in the run."
    every = ((name, np.linalg.norm(errors_of(name, errors)["sd"].to_numpy())) for name in channels)
    sizes = (f"{in_words(name)} {100.0 * sd:.2g} %" for name, sd in every)
    return f"Model error (standard deviation over the peak): {', '.join(sizes)}."


def _errors(each: SpotPrediction) -> str:
    """Standard deviations by the mesh of what has a band."""
    shown = (
        q for q in QUANTITIES if (q.at_force and q.attribute != "force_N" if each.by_force else q.at_depth)
    )
    return ", ".join(f"{q.name} {100.0 * each.mesh[q.attribute]:.2g} %" for q in shown)


def _solved(spot: str, each: SpotPrediction) -> str:
    """Sentence on how many simulated draws the solved bands of a spot hold."""
    n_failed = each.n_asked - each.n_ended
    if not each.n_ended:
        return f"Solved bands at {spot}: none, since all {each.n_asked} simulated draws failed."
    text = f"Solved bands at {spot} hold {each.n_ended} draws, each simulated"
    if each.drawn_as_is:
        text += " on the mesh as it is and changed as much as the refined one changes the fitted values"
    return text + (f"; {n_failed} of {each.n_asked} failed and are not in them." if n_failed else ".")


def beyond(strains: pl.DataFrame) -> str:
    """Sentence on where the prediction goes beyond the experiment."""
    if strains.is_empty():
        return "The solver reports no strains: it is not known whether the prediction extrapolates."
    rows = strains.filter(pl.col("beyond")).to_dicts()
    if not rows:
        return "The tissue is nowhere deformed beyond the strains of the experiment."
    texts = (
        f"{in_words(row['region'])} at {row['spot']}: {ENDS[row['strain']]} "
        f"{row['prediction']:.3g} against {row['experiment']:.3g}, from depth {row['from_depth_mm']:.3g} mm"
        + (f", most at ({row['where_mm']}) mm" if row["where_mm"] else "")
        for row in rows
    )
    return f"Extrapolation beyond the experiment: {'; '.join(texts)}."
