"""``palpate init`` and ``palpate synthesise``: a study to start from, and simulated measurements of one."""

import json
import os
import re
import shutil
import unicodedata
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.completion import ready_studies
from palpate.cli.experiment import look_into
from palpate.cli.limb import look_into_mesh
from palpate.cli.options import AsJson, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session
from palpate.errors import MeshError, StudyError
from palpate.toml_text import ASKED, MARK

if TYPE_CHECKING:
    from palpate.plugins.optional import Inspection

FIRST = "first-press"
"""The ready study that is copied where none is named."""

FOR_ONE_TISSUE, FOR_LAYERS = "forearm-demo", "forearm-layered"
"""Ready studies that give one of own presses its protocol and materials where none is named.

The second is for limbs of several materials: skin is neo-Hookean there, all below it Yeoh's material.
"""

OF_PRESSES = ("study", "spot", "experiment", "budget", "truth")
"""Tables of a ready study that hold for its own presses alone."""


def init(
    context: typer.Context,
    folder: Annotated[
        Path | None, typer.Argument(metavar="FOLDER", help="Folder to make; must be empty or new.")
    ] = None,
    study: Annotated[
        str | None,
        typer.Option(
            "--study",
            help=f"Name of a ready study; default: {FIRST}; own presses: {FOR_ONE_TISSUE} or {FOR_LAYERS}.",
            autocompletion=ready_studies,
        ),
    ] = None,
    measured: Annotated[
        list[Path] | None,
        typer.Option("--measured", metavar="FILE", help="Log or curves of an own press; once for each spot."),
    ] = None,
    mesh: Annotated[
        list[Path] | None,
        typer.Option("--mesh", metavar="FILE", help="Mesh around the spot; in the order of --measured."),
    ] = None,
    wrench: Annotated[
        Path | None,
        typer.Option("--wrench", metavar="FILE", help="Wrench of the first press, if in a file of its own."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Copy a ready study into FOLDER, or write one for your presses; list the ready ones without FOLDER."""
    session = Session.of(context)
    if folder is None:
        _list_ready(session, as_json=as_json)
    elif measured or mesh or wrench:
        _write_own(session, folder, study, measured or [], mesh or [], wrench, as_json=as_json)
    else:
        ready = session.only("studies").studies[study or FIRST]
        copy_study(Path(ready.directory), folder)
        name_study(folder)
        if as_json:
            session.json({"study": ready.name, "folder": str(folder)})
        else:
            session.say(f"{ready.name} copied to {folder}")
            session.next(ready.first_command, folder=folder)


def _write_own(
    session: Session,
    folder: Path,
    study: str | None,
    measured: Sequence[Path],
    meshes: Sequence[Path],
    wrench: Path | None,
    *,
    as_json: bool,
) -> None:
    """Write a study of own presses, or of one homogeneous test, with everything else from a ready study."""
    from palpate.cli.half_space import with_own_ranges

    alone = look_into(measured[0], None, session, None) if measured and not (meshes or wrench) else None
    if not (test := alone.test if alone else ""):
        _check_pairs(measured, meshes, alone)
    found = alone or look_into(measured[0], wrench, session, None)
    looks = [_look(session, mesh) for mesh in meshes]
    # The ready study that gives a homogeneous test its solver and material where none is named.
    name = study or ("treloar" if test else FOR_LAYERS if any(map(_tissues, looks)) else FOR_ONE_TISSUE)
    ready = Path(session.plugins.studies[name].directory)
    if test:
        others = [look_into(file, None, session, None) for file in measured[1:]]
        text = own_test_text(ready, folder, measured, [found, *others])
    else:
        text = own_study_text(session, ready, folder, measured, meshes, looks, found)
    check_new(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "study.toml").write_text(text, encoding="utf-8")
    has_marks = with_own_ranges(folder / "study.toml", session.plugins, name)
    if as_json:
        session.json({"study": name, "folder": str(folder)})
        return
    own, kept = ("test", "ranges") if test else ("presses and meshes", "protocol and ranges")
    kept = f"lines marked {MARK}" if has_marks else kept
    session.say(f"{folder / 'study.toml'}: your {own}, everything else from {name}")
    session.note(f"edit before you run: {kept} are copied from {name} and are not yours; check the units")
    asked = [*found.findings, *re.findall(f"^# ({ASKED}.*)", text, flags=re.MULTILINE)]
    for question in dict.fromkeys(each for each in asked if each.startswith(ASKED)):
        session.note(f"{question} (a comment in the study)")
    session.next("check {folder}", folder=folder)


def own_test_text(ready: Path, folder: Path, measured: Sequence[Path], looks: Sequence["Inspection"]) -> str:
    """Text of a study of own homogeneous tests of one mode, which have no mesh: a spot for each specimen.

    A StudyError where a file has another mode than the first one, or other columns.
    """
    from palpate.study.reading import parse_toml

    found, tables = looks[0], [each.study_text.partition("[experiment]")[2] for each in looks]
    for file, each, table in zip(measured, looks, tables, strict=True):
        if each.test != found.test:
            raise StudyError(
                f"{file}: {f'a test of mode {each.test}' if each.test else 'no homogeneous test'}, and "
                f"{measured[0]} is of mode {found.test}; give files of one mode, and name a file of another "
                "mode in measured of its specimen"
            )
        if table != tables[0]:
            raise StudyError(f"{file}: other columns than {measured[0]}; give files with the same columns")
    names = [_name_of(file.stem) for file in measured] if len(measured) > 1 else ["specimen"]
    if len(set(names)) < len(names):
        names = [f"s{k}" for k in range(1, len(names) + 1)]
    own = [f'[study]\nname = {json.dumps(_name_of(folder.resolve().name))}\ndata = "measured"\n']
    for name, path in zip(names, measured, strict=True):
        file_text = json.dumps(_from(folder, path), ensure_ascii=False)
        own.append(f'[[spot]]\nname = "{name}"\nmeasured = {{ {found.test} = {file_text} }}\n')
    # Tables of a ready study that hold for its own homogeneous tests alone, besides `OF_PRESSES`.
    kept = _tables_of(parse_toml(ready / "study.toml")[0], (*OF_PRESSES, "scoring", "selection", "scenario"))
    weights = f'[[scenario]]\nname = "test"\nweights = {{ {found.test} = 1.0 }}\n'
    return "\n".join([*own, found.study_text, *kept, '[selection]\nscenarios = ["test"]\n', weights])


def _check_pairs(measured: Sequence[Path], meshes: Sequence[Path], alone: "Inspection | None") -> None:
    """Refuse anything but one mesh that is there for each file of curves that is there.

    ``alone`` is the inspection of a first file without a mesh.
    """
    if alone is not None:
        remarks = (text.partition("; of a specimen")[2] for text in alone.findings)
        specimen = next(filter(None, remarks), ", give strain and stress")
        raise StudyError(
            f"{measured[0]}: a press needs the mesh of its spot; add --mesh MESH. A specimen needs no mesh: "
            f"of a specimen{specimen}"
        )
    if not measured or len(measured) != len(meshes):
        raise StudyError(
            f"{len(measured)} files with --measured and {len(meshes)} with --mesh; give one of each for "
            "every spot, in the same order"
        )
    for file in (*measured, *meshes):
        if not file.exists() or (file.is_dir() and file in meshes):
            raise StudyError(f"{file}: no such file; give a file that is there")


def _list_ready(session: Session, *, as_json: bool) -> None:
    """List the ready studies, the first press before the others."""
    studies = session.only("studies").studies
    rows = [
        {"name": name, "plugin": studies.provider(name), "summary": studies[name].summary}
        for name in sorted(studies, key=lambda name: name != FIRST)
    ]
    if as_json:
        session.json(rows)
        return
    shown = ("name", "summary")
    session.table("Ready studies", shown, [[row[key] for key in shown] for row in rows])
    session.next(f"init --study {FIRST} {FIRST}")
    session.note("for your presses: palpate init FOLDER --measured FILE --mesh FILE")


def own_study_text(
    session: Session,
    ready: Path,
    folder: Path,
    measured: Sequence[Path],
    meshes: Sequence[Path],
    looks: Sequence["Inspection | None"],
    found: "Inspection",
) -> str:
    """Text of a study of own presses: their files and meshes as inspected, and else a ready study."""
    from palpate.cli.half_space import SEARCHED
    from palpate.limb.inspection import skin_of
    from palpate.study.reading import parse_toml

    if found.test:
        raise StudyError(f"{measured[0]}: a homogeneous test ({found.test}) needs no mesh; leave --mesh out")
    measured = [_file_of(file, session) for file in measured]
    spots = [_name_of(mesh.stem) for mesh in meshes]
    if len(set(spots)) < len(spots):
        spots = [f"p{k}" for k in range(1, len(spots) + 1)]
    own = [f'[study]\nname = {json.dumps(_name_of(folder.resolve().name))}\ndata = "measured"\n']
    for spot, file, mesh, look in zip(spots, measured, meshes, looks, strict=True):
        files = {"name": spot, "mesh": _from(folder, mesh), "measured": _from(folder, file)}
        lines = [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in files.items()]
        place = look.study_text.partition("\n[limb]")[0].splitlines() if look else []
        lines += (line for line in place if re.match(r"# |position|normal", line))
        own.append("\n".join(["[[spot]]", *lines, ""]))
    ready_text, raw = parse_toml(ready / "study.toml")
    # The tables that name most: another spot's mesh may lack a layer or the bone.
    named = [look.study_text.partition("[limb]")[2].count(" = ") if look else -1 for look in looks]
    fullest = looks[named.index(max(named))]
    kept = "\n".join(_of_mesh(list(_tables_of(ready_text)), fullest))
    is_open = raw.get("fit", {}).keys().isdisjoint({"searched", "parametrisation"})
    searched = [SEARCHED] if "protocol" in raw and is_open else []
    shape = raw.get("protocol", {}).get("indenter", {}).get("shape")
    limbs = [look.limb if look else None for look in looks]
    is_on_skin = shape == "sphere" and all(limb and skin_of(limb) for limb in limbs)
    onset, errors = _of_layers(found.study_text, is_on_skin=is_on_skin)
    errors = errors if any(map(_tissues, looks)) else ""
    return "\n".join(filter(None, [*own, found.study_text, onset, kept, *searched, errors]))


def _file_of(measured: Path, session: Session) -> Path:
    """File that a study names: of a folder, such as a bag, the one in it that a loader reads."""
    if not measured.is_dir():
        return measured
    if (file := look_into(measured, None, session, None).file) is None:
        raise StudyError(
            f"{measured}: a folder of several files; give one of them, or convert it to one file"
        )
    return file


def _look(session: Session, mesh: Path) -> "Inspection | None":
    """Inspection of a mesh; None, with a note, where no limb source can read it."""
    try:
        return look_into_mesh(mesh, session)
    except MeshError as error:
        session.stderr.print(f"{error}; [limb] is from the ready study", markup=False)
        return None


def _tissues(look: "Inspection | None") -> Sequence[str]:
    """Regions of a mesh of several; none of another mesh."""
    regions = look.limb.mesh.regions if look and look.limb else ()
    return regions if len(regions) > 1 else ()


def _of_layers(experiment: str, *, is_on_skin: bool) -> tuple[str, str]:
    """Contact law of a robot's log of a sphere on skin, and the errors that widen intervals most."""
    law = f"exponent = 1.3   # {MARK}: of a sphere on skin over softer tissue; 1.5 where all is alike"
    errors = """[budget]
# Standard deviations. Fixed and tied parameters have half of their value; state yours, such as
# parameters = { "skin.nu" = "5 %" }. A thickness measured at one spot: [spot.layers] skin = "1.6 mm ± 0.2 mm"
"""
    errors += f'layers = "10 %"   # {MARK}: of the thickness of each layer\n'
    errors += f'bone = "1 mm"   # {MARK}: of the depth of the bones\n'
    onset = f"[experiment.settings.onset]\n{law}\n" if is_on_skin and '"robot_log"' in experiment else ""
    return onset, errors


def _of_mesh(blocks: list[str], look: "Inspection | None") -> list[str]:
    """Tables with the limb source that reads a mesh, and a material for each of its regions."""
    from palpate.limb.inspection import is_skin, skin_of

    if look is None:
        return blocks
    head = re.compile(r"\[(\w+)(?:\.(\w+))?").match
    tables = [(found[1], found[2]) if (found := head(block)) else ("", None) for block in blocks]
    there = list(dict.fromkeys(name for table, name in tables if name and table == "region"))
    regions = there if look.limb is None else look.limb.mesh.regions
    kept = [
        look.study_text[look.study_text.index("[limb]") :] if table == "limb" else block
        for block, (table, name) in zip(blocks, tables, strict=True)
        if (table != "limb" or name is None) and (table != "region" or name in regions)
    ]
    # Skin under another name gets the material of the ready study's skin, other tissue the one of its tissue.
    outer, took = skin_of(look.limb) if look.limb else None, dict[str, str]()
    for name in (each for each in regions if there and each not in there):
        is_of_skin = is_skin(name) or (outer is not None and name == outer[0])
        kin = [each for each in there if is_skin(each) == is_of_skin] or there
        alike = next((each for each in kin if each not in (*regions, *took)), kin[0])
        material = (block for block, t in zip(blocks, tables, strict=True) if t == ("region", alike))
        kept += [block.replace(f"[region.{alike}", f"[region.{name}") for block in material]
        if alike not in regions:
            took.setdefault(alike, name)
    # A tie follows the region that took the place of a ready one.
    tie = re.compile(rf"(\* *)({'|'.join(took)})\.")
    return [tie.sub(lambda m: f"{m[1]}{took[m[2]]}.", block) for block in kept] if took else kept


def _name_of(text: str) -> str:
    """Name of a study or spot, as near to a text as its characters allow."""
    # Letters lose their accents; others become their code point, so that two names stay two.
    letters = (each for each in unicodedata.normalize("NFKD", text) if not unicodedata.combining(each))
    plain = "".join(each if each.isascii() or not each.isalnum() else f"u{ord(each):x}" for each in letters)
    return re.sub(r"[^A-Za-z0-9_-]+", "-", plain).strip("-_") or "own"


def _from(folder: Path, file: Path) -> str:
    """Path of a file as a study in a folder names it."""
    # Links of folders are followed, as the system does; that of the file keeps its name.
    return Path(os.path.relpath(file.parent.resolve() / file.name, folder.resolve())).as_posix()


def _tables_of(text: str, without: Sequence[str] = OF_PRESSES) -> Iterator[str]:
    """Tables of a ready study, with their comments, that hold for other presses too."""
    for block in re.split(r"^(?=\[)", text, flags=re.MULTILINE)[1:]:
        if re.split(r"[\].]", block.lstrip("["), maxsplit=1)[0] not in without:
            yield block.strip() + "\n"


def copy_study(source: Path, folder: Path) -> None:
    """Copy a template into a new or empty folder; a StudyError where it is neither, or cannot be written."""
    check_new(folder)
    try:
        shutil.copytree(source, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
    except OSError as error:
        raise StudyError(f"{folder}: cannot be written ({error}); name another folder") from error


def name_study(folder: Path) -> None:
    """Name the study in a folder after it, so that the runs of two copies have a folder each."""
    file, named = folder / "study.toml", json.dumps(_name_of(folder.resolve().name))
    text = file.read_text(encoding="utf-8")
    name = r"(^\[study\]\n(?:(?!\[).*\n)*?name = )\"[^\"]*\""
    text = re.sub(name, lambda found: found[1] + named, text, count=1, flags=re.MULTILINE)
    file.write_text(text, encoding="utf-8")


def check_new(folder: Path) -> None:
    """Refuse a folder that holds something, or is a file."""
    if folder.exists() and not folder.is_dir():
        raise StudyError(f"{folder}: is a file; name a new folder")
    if folder.is_dir() and any(folder.iterdir()):
        raise StudyError(f"{folder}: is not empty; name a new folder, nothing is overwritten")


def synthesise(
    context: typer.Context,
    study: StudyPath,
    out: Annotated[
        Path | None,
        typer.Option("--into", metavar="FOLDER", help="Instead of the study's folder; file names stay."),
    ] = None,
    noise: Annotated[
        float, typer.Option(help="Standard deviation of noise, as a share of each curve's largest value.")
    ] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 1,
    as_json: AsJson = False,
) -> None:
    """Simulate a study's [truth] and write it as measured curves, to plan an experiment.

    Before anyone touches a limb: write a study with the limb's mesh, the protocol, a guess of
    the tissue under [truth] and data = "simulated". This command simulates the truth at each
    spot, with the study's solver, into the files that the study names as measured; they need
    not exist before. `palpate run` then shows which parameters the planned channels identify.

    The curves come from the same model that will be fitted to them, so a good fit shows that the
    parameters can be identified, not that the model is right. --noise makes it harder. Nothing
    is overwritten; origin.json next to the curves records how they were made.
    """
    from palpate.simulation.synthesis import synthesise as write_curves

    session = Session.of(context)
    planned = session.study(study, need_measured=False)
    with StageProgress(session) as progress:
        responses, files = write_curves(
            planned, session.plugins.channels, out, noise=noise, seed=seed, progress=progress
        )
    if as_json:
        session.json({"study": planned.name, "files": [str(file) for file in files]})
        return
    rows = [
        [spot, name, str(y.size), f"{y.min():.6g}", f"{y.max():.6g}"]
        for spot, response in responses.items()
        for name, y in ((name, curve.ordinate) for name, curve in response.curves.items())
    ]
    session.table("Simulated curves", ["spot", "channel", "points", "least", "largest"], rows)
    for file in files:
        session.say(str(file))
    session.next("check {study}", "" if out is None else "once the study names these files, ", study=study)
