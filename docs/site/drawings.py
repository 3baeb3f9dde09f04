"""Drawings of the guides, from results of ready studies."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import meshio
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from palpate import Plugins
from palpate.run.ledger import Ledger
from palpate_multis import fit as fit_people, read_presses
from palpate_report.figures.style import LEAST_COLOUR, LINES, MEASURED_COLOUR, sized

KPA = 1000.0
GREY = "0.55"
REGIONS = {"skin": "#E7837A", "soft_tissue": "#F2C6A0"}


def _two(width_mm: float = 150.0, height_mm: float = 58.0, n: int = 2) -> tuple[Figure, list[Axes]]:
    figure = sized(width_mm, height_mm)
    return figure, list(figure.subplots(1, n, squeeze=False).flat)


def _measured(run: Path, spot: str = "p1") -> dict[str, pl.DataFrame]:
    table = pl.read_parquet(run / "measured" / f"{spot}.parquet")
    return {str(name): part for (name,), part in table.group_by(["channel"], maintain_order=True)}


def curves(runs: Path) -> Figure:
    """Force and torque of one press, with the phases of the torque."""
    figure, (left, right) = _two()
    curve = _measured(runs / "forearm-demo")
    left.plot(curve["force"]["abscissa"], curve["force"]["ordinate"], color=MEASURED_COLOUR)
    left.set(xlabel="depth (mm)", ylabel="normal force (N)", title="press")
    x, y = (curve["torque"][name].to_numpy() for name in ("abscissa", "ordinate"))
    loads = np.abs(x[1:]) > np.abs(x[:-1])
    for i, load in enumerate(loads):
        right.plot(x[i : i + 2], y[i : i + 2], color=LINES[0][0] if load else LINES[3][0], lw=1.4)
    right.plot([], [], color=LINES[0][0], label="load: |rotation| grows")
    right.plot([], [], color=LINES[3][0], label="unload: |rotation| falls")
    right.set(xlabel="rotation (°)", ylabel="torque (N·mm)", title="twist at full depth")
    right.legend(loc="upper left")
    return figure


def mistakes(runs: Path) -> Figure:
    """The force of a press, and three mistakes that palpate names."""
    figure, axes = _two(n=3)
    force = _measured(runs / "forearm-demo")["force"]
    x, y = force["abscissa"].to_numpy(), force["ordinate"].to_numpy()
    late = np.where(x > 1.0, np.interp(x - 1.0, x, y), 0.0)
    wrongs = {"bias of 1 N": y + 1.0, "contact 1 mm late": late, "wrong sign": -y}
    for axis, (name, wrong) in zip(axes, wrongs.items(), strict=True):
        axis.plot(x, y, color=GREY, ls="--", label="as measured")
        axis.plot(x, wrong, color=LEAST_COLOUR, label=name)
        axis.set(xlabel="depth (mm)", ylabel="force (N)", title=name)
    axes[0].legend()
    return figure


def press_in_time(runs: Path) -> Figure:
    """Depth and rotation of a press over time, with its rests."""
    log = pl.read_parquet(runs / "studies" / "robot-log" / "logs" / "simulated_p1.parquet")
    time = log["time_s"].to_numpy() - log["time_s"][0]
    force = np.linalg.norm(log.select("fx_N", "fy_N", "fz_N").to_numpy(), axis=1)
    tip = log.select("x_m", "y_m", "z_m").to_numpy() * 1000.0
    way = np.linalg.norm(tip - tip[0], axis=1)
    turn = 2.0 * np.degrees(np.arccos(np.clip(np.abs(_turned(log)), 0.0, 1.0)))
    figure = sized(150.0, 80.0)
    for axis, values, label in zip(
        figure.subplots(3, 1, sharex=True),
        (way, turn, force),
        ("way (mm)", "rotation (°)", "sensor (N)"),
        strict=True,
    ):
        axis.plot(time, values, color=MEASURED_COLOUR)
        axis.set_ylabel(label)
    figure.axes[-1].set_xlabel("time (s)")
    return figure


def _turned(log: pl.DataFrame) -> Any:  # noqa: ANN401 - an array
    """Cosine of half the angle from the first orientation."""
    quaternions = log.select("qx", "qy", "qz", "qw").to_numpy()
    return quaternions @ quaternions[0]


def relaxing(runs: Path) -> Figure:
    """Force over time of two presses at two rates."""
    figure, axes = _two()
    for axis, spot in zip(axes, ("p1", "p2"), strict=True):
        log = pl.read_parquet(runs / "studies" / "forearm-relaxing" / "logs" / f"simulated_{spot}.parquet")
        force = np.linalg.norm(log.select("fx_N", "fy_N", "fz_N").to_numpy(), axis=1)
        axis.plot(log["time_s"] - log["time_s"][0], force, color=MEASURED_COLOUR, lw=0.6)
        axis.set(xlabel="time (s)", ylabel="force on the sensor (N)", title=f"press {spot}")
    return figure


def indenters(_: Path) -> Figure:
    """Sections of the shapes that palpate has."""
    plugins = Plugins.load()
    shapes = {
        "sphere": {"radius": "7.5 mm"},
        "punch": {"radius": "6 mm", "edge": "1.5 mm"},
        "capsule": {"radius": "5 mm", "length": "12 mm"},
        "box": {"length": "20 mm", "width": "12 mm", "height": "8 mm", "edge": "2 mm"},
        "ring": {"radius": "9 mm", "edge": "2 mm"},
        "cuff": {"radius": "20 mm", "angle": "90 deg", "width": "12 mm", "edge": "2 mm"},
    }
    x, z = np.meshgrid(np.linspace(-18.0, 18.0, 300), np.linspace(-9.0, 17.0, 260))
    points = np.stack([x, np.zeros_like(x), z], axis=-1)
    figure = sized(150.0, 75.0)
    for axis, (name, settings) in zip(figure.subplots(2, 3).flat, shapes.items(), strict=True):
        kind = plugins.indenters[name]
        distance = np.asarray(kind(kind.Settings.model_validate(settings)).distance(points))
        axis.contourf(x, z, distance, levels=[-1e3, 0.0], colors=["0.6"])
        axis.axhline(0.0, color=LINES[0][0], lw=0.8, zorder=0)
        axis.plot(0.0, 0.0, "o", color=LEAST_COLOUR, ms=3)
        axis.set(title=name, aspect="equal", xticks=[], yticks=[])
    return figure


def motion(_: Path) -> Figure:
    """Pose over the waypoints of a motion of moves."""
    kind = Plugins.load().motions["moves"]
    moves = [
        {"depth": "6 mm"},
        {"twist": "20 deg"},
        {"slide": ["4 mm", "0 mm"]},
        {"tilt": ["5 deg", "0 deg"]},
        {"tilt": ["0 deg", "0 deg"]},
        {"depth": "0 mm"},
    ]
    pose = np.asarray(kind(kind.Settings.model_validate({"moves": moves})).waypoints().pose)
    figure = sized(150.0, 62.0)
    axis = figure.subplots()
    columns = ((0, "depth (mm)"), (1, "slide along x (mm)"), (3, "tilt about x (°)"), (5, "twist (°)"))
    for (column, label), (colour, dash) in zip(columns, LINES, strict=False):
        axis.plot(pose[:, column], color=colour, ls=dash, marker="o", ms=2.5, label=label)
    axis.set(xlabel="move", ylabel="place of the indenter")
    axis.legend(loc="upper left")
    return figure


def _section(axis: Axes, path: Path, names: tuple[str, ...], at_mm: float = 0.05) -> None:
    """Fill the polygons in which a plane across the limb cuts the elements, by region from 0."""
    mesh = meshio.read(path)
    corners = np.asarray(mesh.cells[0].data)[:, :4]
    regions = np.asarray(mesh.cell_data["region"][0]).astype(int)
    points = np.asarray(mesh.points)
    for cell, region in zip(points[corners], regions, strict=True):
        polygon = _cut(cell, at_mm)
        if len(polygon) >= 3:
            axis.fill(*polygon.T, color=REGIONS[names[region]], ec="0.25", lw=0.15)
    for name in names:
        axis.fill([], [], color=REGIONS[name], label=name.replace("_", " "))
    axis.set(aspect="equal", xlabel="y (mm)", ylabel="z (mm)")


def _cut(cell: Any, at_mm: float) -> Any:  # noqa: ANN401 - arrays
    """Corners (y, z) of the polygon in which a plane x = constant cuts a tetrahedron."""
    found = []
    for i in range(4):
        for j in range(i):
            a, b = cell[i], cell[j]
            if (a[0] - at_mm) * (b[0] - at_mm) < 0.0:
                found.append((a + (b - a) * (at_mm - a[0]) / (b[0] - a[0]))[1:])
    polygon = np.array(found).reshape(-1, 2)
    turn = polygon - polygon.mean(axis=0) if len(polygon) else polygon
    return polygon[np.argsort(np.arctan2(turn[:, 1], turn[:, 0]))]


def section(runs: Path) -> Figure:
    """A section of the phantom's mesh: soft tissue, and the holes of both bones."""
    figure = sized(100.0, 72.0)
    axis = figure.subplots()
    _section(axis, runs / "phantom" / "meshes" / "p2.vtu", ("soft_tissue",))
    axis.plot(0.0, 0.0, "o", color=LEAST_COLOUR, ms=4)
    axis.annotate("spot", (0.0, 0.0), xytext=(4, 6), textcoords="offset points", color=LEAST_COLOUR)
    return figure


def layers(runs: Path) -> Figure:
    """A section of the mesh of the layered study."""
    figure = sized(100.0, 72.0)
    axis = figure.subplots()
    path = runs / "studies" / "forearm-layered" / "meshes" / "p2.vtu"
    _section(axis, path, ("skin", "soft_tissue"))
    axis.plot(0.0, 0.0, "o", color=LEAST_COLOUR, ms=4, label="spot")
    axis.legend(loc="lower left")
    return figure


def real_section(runs: Path) -> Figure:
    """Sections of a real forearm's meshes at two spots."""
    figure, axes = _two(height_mm=70.0)
    for axis, spot in zip(axes, ("p1", "p2"), strict=True):
        _section(axis, runs / "studies" / "forearm-real" / "meshes" / f"{spot}.vtu", ("skin", "soft_tissue"))
        axis.set_title(spot)
    axes[0].legend(loc="lower left")
    return figure


def scenarios(runs: Path) -> Figure:
    """What force, torque and both allow: draws of two parameters by scenario."""
    draws = pl.read_parquet(runs / "forearm-demo" / "draws.parquet").filter(pl.col("fit") == "all spots")
    figure = sized(95.0, 75.0)
    axis = figure.subplots()
    named = (("II", "torque (II)"), ("III", "force (III)"), ("I", "both (I)"))
    for (scenario, label), (colour, _) in zip(named, (LINES[1], LINES[4], LINES[0]), strict=True):
        part = draws.filter(pl.col("scenario") == scenario)
        axis.plot(
            part["soft_tissue.c1"] * KPA, part["soft_tissue.c2"] * KPA, ".", color=colour, ms=3, label=label
        )
    axis.plot(14.1, -1.1, "*", color="black", ms=9, label="true value")
    axis.set(xlabel="c1 (kPa)", ylabel="c2 (kPa)")
    axis.legend()
    return figure


def valley(runs: Path) -> Figure:
    """Fopt over two parameters by force alone and by both channels."""
    planes = pl.read_parquet(runs / "forearm-demo" / "profile_planes.parquet").filter(
        (pl.col("parameter") == "soft_tissue.c1") & (pl.col("other") == "soft_tissue.c2")
    )
    figure, axes = _two(height_mm=66.0)
    for axis, (scenario, title) in zip(
        axes, (("III", "force alone"), ("I", "force and torque")), strict=True
    ):
        part = planes.filter((pl.col("scenario") == scenario) & pl.col("fopt").is_finite())
        values = np.log10(part["fopt"].to_numpy())
        shown = axis.tricontourf(
            part["value"] * KPA,
            part["other_value"] * KPA,
            values,
            levels=np.arange(-4.0, 0.6, 0.5),
            cmap="viridis_r",
            extend="both",
        )
        axis.plot(14.1, -1.1, "*", color="white", ms=8, mec="black", mew=0.5)
        axis.set(xlabel="c1 (kPa)", ylabel="c2 (kPa)", title=title)
    figure.colorbar(shown, ax=axes, label="log10 of Fopt")
    return figure


def estimator(runs: Path) -> Figure:
    """Values of the least Fopt and reported values with their intervals, by scenario."""
    folder = runs / "forearm-demo"
    intervals = pl.read_parquet(folder / "intervals.parquet").filter(pl.col("fit") == "all spots")
    least = (
        pl.read_parquet(folder / "fit.parquet")
        .filter(pl.col("fit") == "all spots")
        .unique("scenario", keep="first")
    )
    names = ["soft_tissue.c1", "soft_tissue.c2", "soft_tissue.c3"]
    figure, axes = _two(n=3, height_mm=52.0)
    for axis, name, truth in zip(axes, names, (14.1, -1.1, 0.105), strict=True):
        for i, scenario in enumerate(("I", "II", "III")):
            row = intervals.filter((pl.col("scenario") == scenario) & (pl.col("parameter") == name)).row(
                0, named=True
            )
            low, value, high = (KPA * row[key] for key in ("lower", "value", "upper"))
            axis.plot([low, high], [i, i], color=LINES[0][0], lw=3, alpha=0.35, solid_capstyle="butt")
            axis.plot(value, i, "o", color=LINES[0][0], ms=4, label="reported value" if not i else None)
            found = KPA * float(least.filter(pl.col("scenario") == scenario)[name][0])
            axis.plot(found, i, "D", color=MEASURED_COLOUR, ms=3, label="least Fopt" if not i else None)
        axis.axvline(truth, color=LEAST_COLOUR, lw=0.8, label="true value")
        axis.set(
            xlabel=f"{name.split('.')[1]} (kPa)",
            yticks=range(3),
            yticklabels=("I", "II", "III"),
            ylim=(2.6, -0.6),
        )
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def trace(runs: Path) -> Figure:
    """Fopt over the simulations of a fit."""
    steps = pl.read_parquet(runs / "forearm-demo" / "fit_trace.parquet").filter(pl.col("fit") == "all spots")
    figure = sized(100.0, 60.0)
    axis = figure.subplots()
    for (colour, dash), scenario in zip(LINES, ("I", "II", "III"), strict=False):
        part = steps.filter(pl.col("scenario") == scenario).sort("n_runs")
        axis.plot(
            part["n_runs"],
            part["fopt"],
            color=colour,
            ls=dash,
            marker="o",
            ms=3,
            label=f"scenario {scenario}",
        )
    axis.set(xlabel="simulations", ylabel="Fopt", yscale="log")
    axis.legend()
    return figure


def jobs(runs: Path) -> Figure:
    """Seconds of each simulation of a run, in the order in which they ended."""
    with Ledger(runs / "forearm-demo") as ledger:
        frame = ledger.frame().sort("finished_at")
    figure = sized(150.0, 52.0)
    axis = figure.subplots()
    for colour, (spot, part) in zip(
        (line[0] for line in LINES),
        frame.with_row_index().group_by("spot", maintain_order=True),
        strict=False,
    ):
        axis.plot(part["index"] + 1, part["seconds"], "o", color=colour, ms=3, label=str(spot[0]))
    axis.set(xlabel="simulation, in the order of its end", ylabel="time (s)", yscale="log")
    axis.legend(ncols=2)
    return figure


def held_out(runs: Path) -> Figure:
    """Differences of held-out presses from their prediction, and the bands."""
    table = pl.read_parquet(runs / "forearm-demo" / "held_out.parquet")
    figure = sized(110.0, 52.0)
    axis = figure.subplots()
    labels = [f"{row['spot']} {row['channel']}" for row in table.iter_rows(named=True)]
    axis.bar(labels, 100.0 * table["band"], color="0.85", label="90 % band")
    axis.plot(labels, 100.0 * table["difference"], "o", color=LEAST_COLOUR, ms=4, label="difference")
    axis.set_ylabel("% of the peak")
    axis.tick_params(axis="x", rotation=30)
    axis.legend()
    return figure


def people(_: Path) -> Figure:
    """Measured against predicted compliance of 552 presses."""
    presses = read_presses()
    predicted, _share = fit_people(presses).predict(presses.layers_mm, presses.width_mm, presses.force_N)
    figure = sized(85.0, 80.0)
    axis = figure.subplots()
    axis.loglog(presses.compliance, predicted, ".", color=MEASURED_COLOUR, ms=2, alpha=0.6)
    ends = [float(np.min(predicted)), float(np.max(predicted))]
    axis.plot(ends, ends, color=GREY, lw=0.8)
    axis.set(xlabel="measured compliance (mm/MPa)", ylabel="predicted compliance (mm/MPa)")
    return figure


def _box(axis: Axes, x: float, y: float, text: str, colour: str = "white") -> Bbox:
    """Place of a text in a box."""
    box = {"boxstyle": "round,pad=0.4", "fc": colour, "ec": "0.3", "lw": 0.7}
    shown = axis.text(x, y, text, ha="center", va="center", fontsize=7, bbox=box, zorder=3)
    figure, patch = axis.get_figure(root=True), shown.get_bbox_patch()
    assert figure is not None
    assert patch is not None
    figure.draw_without_rendering()  # boxes have their place once they are drawn
    return patch.get_window_extent().transformed(axis.transData.inverted())


def _arrow(axis: Axes, start: tuple[float, float], end: tuple[float, float], text: str = "") -> None:
    """Arrow between two places, with a word next to its middle."""
    line = {"arrowstyle": "->", "lw": 0.8, "color": "0.3", "shrinkA": 2, "shrinkB": 2}
    axis.annotate("", xy=end, xytext=start, arrowprops=line, zorder=1)
    x, y = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    level = start[1] == end[1]
    place: dict[str, Any] = {"x": x, "y": y + 0.02, "ha": "center"} if level else {"x": x + 0.01, "y": y}
    axis.text(s=text, fontsize=6.5, style="italic", **place)


def _chart(width_mm: float, height_mm: float) -> tuple[Figure, Axes]:
    figure = sized(width_mm, height_mm)
    axis = figure.subplots()
    axis.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    axis.axis("off")
    return figure, axis


def choose(_: Path) -> Figure:
    """Chart from data to the ready study to start from."""
    figure, axis = _chart(170.0, 105.0)
    questions = (
        ("a test of a specimen\n(stress over stretch)?", "treloar, ecoflex"),
        ("force over time,\nwith a rest?", "forearm-relaxing"),
        ("a slide after the twist,\nfibres of muscle?", "forearm-fibres"),
        ("a thickness of skin or fat?", "forearm-layered"),
        ("a log of a robot\nand a sensor?", "robot-log"),
        ("a scan of a limb,\nand no mesh?", "forearm-real, residual-limb"),
        ("curves and a mesh", "first-press, forearm-demo"),
    )
    above = None
    for k, (question, study) in enumerate(questions):
        y = 0.94 - 0.147 * k
        asked, to = _box(axis, 0.3, y, question), _box(axis, 0.72, y, study, "#DCEBF7")
        _arrow(axis, (asked.x1, y), (to.x0, y), "yes" if question.endswith("?") else "")
        if above is not None:
            _arrow(axis, (0.3, above.y0), (0.3, asked.y1), "no")
        above = asked
    return figure


def pipeline(_: Path) -> Figure:
    """Stages of a run, and the kinds of plugins that each uses."""
    figure, axis = _chart(170.0, 42.0)
    stages = (
        ("experiment", "loaders"), ("limb", "limb sources"), ("sample", "samplers,\nfilters"),
        ("simulate", "solvers, materials,\nindenters, motions"), ("score, select", "scores,\nscenarios"),
        ("fit", "searches,\nparametrisations"), ("report", "sections"),
    )  # fmt: skip
    xs = np.linspace(0.07, 0.93, len(stages))
    for i, (x, (stage, kinds)) in enumerate(zip(xs, stages, strict=True)):
        _box(axis, x, 0.72, stage, "#DCEBF7")
        axis.text(x, 0.42, kinds, ha="center", va="top", fontsize=6.3)
        if i:
            _arrow(axis, (float(xs[i - 1]) + 0.05, 0.72), (float(x) - 0.045, 0.72))
    return figure


DRAWINGS: Mapping[str, Callable[[Path], Figure]] = MappingProxyType(
    {
        each.__name__: each
        for each in (
            curves, mistakes, press_in_time, relaxing, indenters, motion, section, layers, real_section,
            scenarios, valley, estimator, trace, jobs, held_out, people, choose, pipeline,
        )
    }
)  # fmt: skip
"""Drawings by the name of their file."""
