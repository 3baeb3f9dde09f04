"""Pictures of what was done to a log: as it was read, tared, cut into phases, and its curves."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from palpate.api import EQUILIBRIUM_CHANNELS, FORCE, FloatArray, IntArray
from palpate_report.api import STYLE
from palpate_robot_log.processing.chain import Processed
from palpate_robot_log.processing.cycles import Cycles
from palpate_robot_log.recording import Recording

N_BUCKETS = 1000  # stretches of a long signal of which a picture shows the least and the greatest value
_ON_SCREEN = {
    "figure.dpi": 160,
    **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize"), 9.0),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize"), 9.0),
    "legend.fontsize": 8.0,
}
_AXES = (("x", "#0072B2"), ("y", "#E69F00"), ("z", "#009E73"))
_FOUND = "#D55E00"
_MEASURED = "#0072B2"
_RAW = "0.7"
_SHADES = {
    "approach": "0.93",
    "departure": "0.93",
    "dwell": "#F5E9C8",
    "press": "#D6E8F5",
    "retract": "#E3DFF2",
}
_TWISTS = ("#D9F0E3", "#BFE3CF")


def draw_recording(recording: Recording, folder: Path) -> Path:
    """Draw ``1_as_read.png``: position, turn, force and moment over time, in the frames of the log."""
    with _over_time(recording, "as read", 4, folder / "1_as_read.png") as axes:
        time = recording.time_s
        _components(axes[0], time, recording.position_mm - recording.position_mm[0])
        axes[0].set_ylabel("travel from\nthe first row (mm)")
        orientation = Rotation.from_quat(np.array(recording.quaternion))
        _components(axes[1], time, (orientation[0].inv() * orientation).as_rotvec(degrees=True))
        axes[1].set_ylabel("turn from\nthe first row (°)")
        _components(axes[2], time, recording.force_N)
        axes[2].set_ylabel("force (N)\n(sensor)")
        _components(axes[3], time, recording.moment_Nmm)
        axes[3].set_ylabel("moment (N·mm)\n(sensor)")
        _legend_above(axes[0])
    return folder / "1_as_read.png"


def draw_processed(processed: Processed, folder: Path) -> tuple[Path, ...]:
    """Draw ``2_tared.png``, ``3_phases.png``, ``4_onset.png``, ``5_curves.png``; write ``over_time.csv``."""
    return (
        _draw_tared(processed, folder),
        _draw_phases(processed, folder),
        _draw_onset(processed, folder),
        _draw_curves(processed, folder),
        _write_over_time(processed, folder),
    )


def _write_over_time(processed: Processed, folder: Path) -> Path:
    """Table of depth, rotation and shift, then of force and torque, over the time of the log."""
    signals = {
        channel: signal
        for channel in EQUILIBRIUM_CHANNELS
        if (signal := processed.signals.get(channel.name)) and signal.branches
    }
    motion = {channel.abscissa: signal.abscissa for channel, signal in signals.items()}
    values = motion | {channel.ordinate: signal.ordinate for channel, signal in signals.items()}
    rows = np.unique(np.concatenate([envelope(each) for each in values.values()]))
    frame = pl.DataFrame({"time_s": processed.motion.time_s, **values})[rows]
    path = folder / "over_time.csv"
    frame.write_csv(path, float_precision=5)
    return path


def _draw_tared(processed: Processed, folder: Path) -> Path:
    """Wrench before and after weight, drift and bias were taken out, near zero where it is free."""
    raw, tared = processed.raw, processed.cleaned.recording
    found = {
        "weight": processed.cleaned.tool,
        "drift": processed.cleaned.drift,
        "bias": processed.cleaned.bias,
    }
    taken = [name for name, value in found.items() if value is not None]
    path, what = folder / "2_tared.png", f"without {', '.join(taken) or 'any correction'}"
    with _over_time(raw, what, 4, path) as axes:
        free = np.zeros(raw.n_rows, dtype=bool)
        free[processed.cleaned.free] = True
        for k, (quantity, unit) in enumerate((("force_N", "N"), ("moment_Nmm", "N·mm"))):
            before, after = getattr(raw, quantity), getattr(tared, quantity)
            for axis, near in ((axes[2 * k], False), (axes[2 * k + 1], True)):
                for j, (name, colour) in enumerate(_AXES):
                    _line(axis, raw.time_s, before[:, j], color=colour, linewidth=0.6, alpha=0.4)
                    _line(axis, raw.time_s, after[:, j], color=colour, label=f"{name}, after")
                edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
                for start, stop in edges.reshape(-1, 2):
                    axis.axvspan(raw.time_s[start], raw.time_s[stop - 1], color="0.88", linewidth=0, zorder=0)
                axis.axhline(0.0, color="0.3", linewidth=0.6)
                if near:
                    reach = 1.3 * float(max(np.abs(each[free]).max() for each in (before, after))) or 1.0
                    axis.set_ylim(-reach, reach)
                axis.set_ylabel(
                    f"{quantity.partition('_')[0]} ({unit})\n" + ("(near zero)" if near else "(sensor)")
                )
        _legend_above(axes[0])
        axes[0].set_title("pale: as read; grey: free air", loc="left", fontsize=8)
    return path


def _draw_phases(processed: Processed, folder: Path) -> Path:
    time = processed.motion.time_s
    signals = (
        (processed.depth_mm, "depth (mm)"),
        (processed.motion.turn_deg, "rotation (°)"),
        (processed.wrench.pressing, "normal force (N)"),
        (processed.wrench.twisting, "torque (N·mm)"),
    )
    path, what = folder / "3_phases.png", "phases, in the frame of the spot"
    with _over_time(processed.raw, what, len(signals), path) as axes:
        for axis, (values, label) in zip(axes, signals, strict=True):
            for phase in processed.phases:
                kind, _, number = phase.name.partition("_")
                shade = _SHADES.get(kind) or _TWISTS[int(number) % 2]
                axis.axvspan(phase.start.time_s, phase.stop.time_s, color=shade, linewidth=0, zorder=0)
            _line(axis, time, values, color="0.15")
            axis.set_ylabel(label)
        whole = processed.phases[-1].stop.time_s - processed.phases[0].start.time_s
        for phase in processed.phases:
            narrow = phase.stop.time_s - phase.start.time_s < 0.09 * whole
            axes[0].annotate(
                phase.name.replace("_", " "),
                ((phase.start.time_s + phase.stop.time_s) / 2.0, 1.03),
                xycoords=("data", "axes fraction"),
                ha="center", va="bottom", fontsize=7, rotation=90 if narrow else 0,
            )  # fmt: skip
        for item in (each for each in processed.relaxations if each.is_significant):
            phase = processed.phase(item.phase)
            axes[{FORCE.name: 2}.get(item.channel, 3)].annotate(
                f"falls {100.0 * item.share:.1f} %",
                ((phase.start.time_s + phase.stop.time_s) / 2.0, 0.04),
                xycoords=("data", "axes fraction"),
                ha="center", fontsize=7, color=_FOUND, rotation=90,
            )  # fmt: skip
    return path


def _draw_onset(processed: Processed, folder: Path) -> Path:
    """Force over depth about first contact, on both ways."""
    time, depth, force = processed.motion.time_s, processed.depth_mm, processed.wrench.pressing
    press = processed.phase("press")
    way = time <= press.stop.time_s
    near = np.abs(depth) < 0.25 * float(depth.max())
    std = processed.onset.std_mm
    path = folder / "4_onset.png"
    with _figure(processed.raw, "first contact", path) as ((axis,),):
        axis.plot(depth[near & ~way], force[near & ~way], ".", color="0.8", markersize=2, label="way out")
        axis.plot(depth[near & way], force[near & way], ".", color="0.45", markersize=2, label="way in")
        curve = processed.curves["force"]
        kept = curve.abscissa < 0.25 * float(depth.max())
        axis.plot(curve.abscissa[kept], curve.ordinate[kept], color=_MEASURED, label="curve")
        axis.axvline(0.0, color=_FOUND, label=f"first contact ± {std:.3f} mm")
        axis.axvspan(-std, std, color=_FOUND, alpha=0.2, linewidth=0)
        axis.set_xlabel("depth (mm)")
        axis.set_ylabel("normal force (N)")
        axis.legend(loc="upper left")
    return path


def _draw_curves(processed: Processed, folder: Path) -> Path:
    """Each curve on the rows of the log, and below it what smoothing left of them."""
    labels = {
        "force": ("depth (mm)", "normal force (N)"),
        "torque": ("rotation (°)", "torque (N·mm)"),
        "lateral_force": ("shift (mm)", "lateral force (N)"),
        "force_over_time": ("time (s)", "normal force (N)"),
    }
    curves, path = processed.curves, folder / "5_curves.png"
    grid = {"nrows": 2, "ncols": len(curves), "sharex": "col", "height_ratios": (2.0, 1.0)}
    with _figure(processed.raw, "curves", path, (4.6 * len(curves), 5.6), **grid) as panels:
        for (above, below), (name, curve) in zip(panels.T, curves.items(), strict=True):
            x_label, y_label = labels[name]
            signal = processed.signals[name]
            branches = signal.branches
            if len(curve.branches) == 1:  # press and rest, over time
                branches = [slice(branches[0].start, branches[-1].stop)]
            for k, (rows, (start, stop)) in enumerate(zip(branches, curve.branches, strict=True)):
                x, y = signal.abscissa[rows], signal.ordinate[rows]
                branch = curve.cut(slice(start, stop))
                up = np.argsort(branch.abscissa)
                at = branch.abscissa[up]
                residual = y - np.interp(x, at, branch.ordinate[up])
                label = "_" if k else "rows of the log"
                above.plot(x, y, ".", color=_RAW, markersize=1.5, label=label)
                below.plot(x, residual, ".", color=_RAW, markersize=1.0, label=label)
                if branch.std is not None:
                    band = 3.0 * branch.std[up]
                    label = "_" if k else "± three standard deviations"
                    below.fill_between(at, -band, band, color=_FOUND, alpha=0.45, linewidth=0, label=label)
            above.plot(curve.abscissa, curve.ordinate, color=_MEASURED, linewidth=1.0, label="curve")
            below.axhline(0.0, color=_MEASURED, linewidth=0.8)
            above.set_ylabel(y_label)
            below.set_ylabel(f"residual {y_label[y_label.index('(') :]}")
            below.set_xlabel(x_label)
            above.legend(loc="upper left", markerscale=3.0)
            # Above the panel: the residuals fill all of it.
            _legend_above(below, fontsize=7, markerscale=4.0)
    return path


def draw_cycles(cycles: Cycles, folder: Path) -> Path:
    """Draw ``6_cycles.png``: force over depth of each cycle of a log."""
    path, raw = folder / "6_cycles.png", next(iter(cycles.processed.values())).raw
    with _figure(raw, "cycles", path) as ((axis,),):
        shades = np.linspace(0.75, 0.0, len(cycles.processed))
        for shade, (number, processed) in zip(shades, cycles.processed.items(), strict=True):
            curve = processed.curves["force"]
            found = next(row for row in cycles.table if row["cycle"] == number)["changes"].get("force")
            label = f"cycle {number}" + (f", {100.0 * found['share']:+.1f} %" if found else "")
            width = 2.2 if number in cycles.counted else 1.0
            axis.plot(curve.abscissa, curve.ordinate, color=str(shade), linewidth=width, label=label)
        axis.set_xlabel("depth (mm)")
        axis.set_ylabel("normal force (N)")
        axis.legend(loc="upper left", title="force since the one before\n(thick: counts)")
    return path


@contextmanager
def _figure(
    recording: Recording,
    what: str,
    path: Path,
    size: tuple[float, float] = (5.2, 3.8),
    **grid: Any,  # noqa: ANN401 - as subplots takes
) -> Iterator[Any]:
    """Panels (n, k) of a figure in palpate's style, which is written in the end."""
    with mpl.rc_context(cast("Any", {**STYLE, **_ON_SCREEN})):
        figure = Figure(figsize=size)
        yield figure.subplots(squeeze=False, **grid)
        figure.suptitle(f"{Path(recording.source).name}: {what}", fontsize=10)
        FigureCanvasAgg(figure).print_figure(path, dpi=130)


@contextmanager
def _over_time(recording: Recording, what: str, n_panels: int, path: Path) -> Iterator[Sequence[Axes]]:
    """Panels over one axis of time."""
    size = (9.0, 1.6 * n_panels + 0.6)
    with _figure(recording, what, path, size, nrows=n_panels, sharex=True) as panels:
        axes = list(panels[:, 0])
        yield axes
        axes[-1].set_xlabel("time (s)")
        axes[-1].set_xlim(recording.time_s[0], recording.time_s[-1])


def _components(axis: Axes, time: FloatArray, values: FloatArray) -> None:
    for k, (name, colour) in enumerate(_AXES):
        _line(axis, time, values[:, k], color=colour, label=name)


def _line(axis: Axes, time: FloatArray, values: FloatArray, **look: Any) -> None:  # noqa: ANN401 - as plot takes
    rows = envelope(values)
    axis.plot(time[rows], values[rows], **({"linewidth": 0.9} | look))


def envelope(values: FloatArray) -> IntArray:
    """Rows, in order, that draw a signal (n,) as all would: the extremes of ``N_BUCKETS`` stretches."""
    size = values.size // N_BUCKETS
    if size < 3:
        return np.arange(values.size)
    stretches = values[: size * N_BUCKETS].reshape(N_BUCKETS, size)
    first = size * np.arange(N_BUCKETS)
    rest = np.arange(size * N_BUCKETS, values.size)
    return np.unique(
        np.concatenate([first + stretches.argmin(axis=1), first + stretches.argmax(axis=1), rest])
    )


def _legend_above(axis: Axes, **look: Any) -> None:  # noqa: ANN401 - as legend takes
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, **look)
