"""The spots of a study: their files, and what is done and read otherwise at one of them."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from palpate.domain import FINE, Indentation, Protocol, Spot
from palpate.errors import MeshError
from palpate.plugins.guard import answering_for
from palpate.plugins.interfaces import ExperimentLoader
from palpate.study.build import Context, build_component
from palpate.study.model import ExperimentTable, ProtocolTable, SpotTable, StudyFile
from palpate.study.source_positions import Key, check_plain


def mesh_note(mesh: Path) -> dict[str, Any] | None:
    """The note of a mesh by whoever made it, ``<mesh>.json``; None without one.

    A MeshError where it is no JSON object, or holds what JSON or a terminal does not take.
    """
    note_file = mesh.with_suffix(".json")
    if not note_file.is_file():
        return None
    try:
        note = json.loads(note_file.read_text(encoding="utf-8"))
        if not isinstance(note, dict):
            raise ValueError("not an object")
        check_plain(note)
        json.dumps(note, allow_nan=False)
    except (ValueError, RecursionError, OSError) as error:
        raise MeshError(
            f"{note_file}: not a note on the mesh of that name ({error}); write it again, or move it away"
        ) from error
    return note


@dataclass(frozen=True, slots=True, kw_only=True)
class StudySpot:
    """One spot with its files.

    Parameters
    ----------
    measured : mapping of channel name, or None for files that hold several channels, to paths
        More than one path: repeated presses, which are averaged.
    mesh : Path or None
        None for a specimen in homogeneous tests.
    fine_mesh : Path or None
        A finer mesh of the same limb.
    fine_edge_mm : float or None
        Longest edge under the indenter of the mesh refined, which is the finer one then; 0: none; None: of
        the contact's size.
    place : str
        Where the study file names the finer mesh, as messages start.
    protocol : Protocol or None
        What is done here, where it is not what the study does everywhere.
    loader : ExperimentLoader or None
        What reads the files, where they need other settings than the study's.
    state : str
        State of the person; empty where spots have none.
    layers_mm : mapping of region to (float, float)
        Measured thickness of layers, with its standard deviation.
    """

    spot: Spot
    measured: Mapping[str | None, tuple[Path, ...]]
    mesh: Path | None
    fine_mesh: Path | None = None
    fine_edge_mm: float | None = 0.0
    place: str = ""
    protocol: Protocol | None = None
    loader: ExperimentLoader | None = None
    state: str = ""
    layers_mm: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def meshes(self) -> dict[str, Path]:
        """Files of its meshes by the name of the limb, as :attr:`Job.limb_name`."""
        name = self.spot.name
        found = {name: self.mesh, f"{name}{FINE}": self.fine_mesh}
        return {limb: path for limb, path in found.items() if path is not None}

    def is_where(self, other: "StudySpot") -> bool:
        """Whether both are the same place of the same limb; without a mesh, by the name alone."""
        here, there = self.spot, other.spot
        if self.mesh is None:
            return here.name == there.name
        same = np.array_equal(here.position_mm, there.position_mm)
        return self.mesh == other.mesh and same and np.array_equal(here.normal, there.normal)

    @property
    def files(self) -> tuple[Path, ...]:
        """Every file of measured curves."""
        return tuple(path for paths in self.measured.values() for path in paths)


def build_spots(context: Context, tables: StudyFile, need_measured: bool = True) -> tuple[StudySpot, ...]:
    """Build the spots; names are unique, files exist, channels are known."""
    spots = []
    fine_edge_mm = None if tables.fit.fine_edge == "auto" else tables.fit.fine_edge
    for index, table in enumerate(tables.spot):
        key: Key = ("spot", index)
        if table.name in [earlier.name for earlier in tables.spot[:index]]:
            context.problems.add(
                (*key, "name"), f"a spot '{table.name}' already exists; give each spot its own name"
            )
        made = ", and `palpate synthesise STUDY` simulates [truth] into it" if tables.truth else ""
        measured = _measured(context, table, key, made, needed=need_measured)
        mesh, fine_mesh = (
            None
            if name is None
            else _file(context, name, (*key, place), ", and `palpate limb SCAN` makes meshes")
            for place, name in (("mesh", table.mesh), ("fine_mesh", table.fine_mesh))
        )
        protocol = _spot_protocol(context, tables.protocol, table, key)
        loader = _spot_loader(context, tables.experiment, table, key)
        with context.problems.at(*key, "normal"):
            spot = Spot(name=table.name, position_mm=np.array(table.position), normal=np.array(table.normal))
            spots.append(
                StudySpot(
                    spot=spot,
                    measured=measured,
                    mesh=mesh,
                    fine_mesh=fine_mesh,
                    fine_edge_mm=0.0 if fine_mesh else fine_edge_mm,
                    place=context.problems.place((*key, "fine_mesh") if fine_mesh else ("fit", "fine_edge")),
                    protocol=protocol,
                    loader=loader,
                    state=table.state or "",
                    layers_mm=table.layers,
                )
            )
    _check_states(context, tables)
    return tuple(spots)


def _check_states(context: Context, tables: StudyFile) -> None:
    """Refuse a state of some spots only, and one that has the name of a spot."""
    names = {table.name for table in tables.spot}
    some = any(table.state for table in tables.spot)
    for index, table in enumerate(tables.spot):
        if some and not table.state:
            context.problems.add(("spot", index), "has no state, which other spots have; give each spot one")
        elif table.state in names:
            context.problems.add(
                ("spot", index, "state"), f"'{table.state}' is the name of a spot too; give it another name"
            )


def _measured(
    context: Context, table: SpotTable, key: Key, made: str, *, needed: bool
) -> dict[str | None, tuple[Path, ...]]:
    for channel in table.measured:
        with context.problems.at(*key, "measured", *([channel] if channel else [])):
            _ = channel and context.plugins.channels[channel]
    return {
        channel or None: tuple(
            _file(context, name, at, made, needed=needed) for name, at in _named(context, names, channel, key)
        )
        for channel, names in table.measured.items()
    }


def _named(context: Context, names: list[str], channel: str, spot: Key) -> Iterator[tuple[str, Key]]:
    """Each file with its key in study.toml; repeats are different presses."""
    key: Key = (*spot, "measured", *([channel] if channel else []))
    for place, name in enumerate(names):
        at: Key = (*key, place) if len(names) > 1 else key
        if name in names[:place]:
            context.problems.add(at, f"'{name}' is listed twice; a repeat is another press, list each once")
        yield name, at


def _file(context: Context, name: str, key: Key, made: str, *, needed: bool = True) -> Path:
    """Path of a file; a problem if it is missing, with what makes it."""
    path = context.file.parent / name
    if not context.is_copy and not path.is_file() and (needed or path.exists()):
        reason = "is a folder, not a file" if path.is_dir() else "no such file"
        context.problems.add(
            key, f"'{name}': {reason} (looked for {path}); paths are relative to study.toml{made}"
        )
    return path


def _spot_protocol(
    context: Context, base: ProtocolTable | None, table: SpotTable, key: Key
) -> Indentation | None:
    own = table.protocol
    if own is None:
        return None
    if base is None:
        context.problems.add(
            (*key, "protocol"), "changes a [protocol] that the study does not have; add the table"
        )
        return None
    named = {name: getattr(own, name) for name in own.model_fields_set & type(own).model_fields.keys()}
    motion = named.get("motion", base.motion)
    settings = (base.settings if motion == base.motion else {}) | own.settings
    kept = {name: getattr(base, name) for name in type(base).model_fields}
    return build_protocol(
        context, ProtocolTable.model_construct(**(kept | named | settings)), (*key, "protocol")
    )


def _spot_loader(
    context: Context, base: ExperimentTable | None, table: SpotTable, key: Key
) -> ExperimentLoader | None:
    if base is None or not table.settings:
        return None
    with context.problems.at("experiment", "loader"):
        # A missing loader is reported once, where it is named.
        _ = context.plugins.loaders[base.loader]
        return build_component(
            context, context.plugins.loaders, base.loader, base.settings | table.settings, (*key, "settings")
        )
    return None


def build_protocol(context: Context, table: ProtocolTable, key: Key = ("protocol",)) -> Indentation | None:
    """Put together the indenter, its motion and its friction."""
    place: Key = (*key, "indenter")
    given, plugins = table.indenter, context.plugins
    indenter = build_component(
        context, plugins.indenters, given.shape, given.settings, (*place, "shape"), place
    )
    motion = build_component(context, plugins.motions, table.motion, table.settings, (*key, "motion"), key)
    friction = table.friction if given.friction is None else given.friction
    if friction is None:
        context.problems.add((*key, "friction"), "missing; add friction = … here, or to the indenter")
    if indenter is None or motion is None or friction is None:
        return None
    with context.problems.at(*key), answering_for(motion, "its waypoints"):
        return Indentation.along(motion.waypoints(), indenter=indenter, friction=friction)
    return None
