"""What `make dist` wrote is complete, and works in an empty environment away from the checkout."""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
DIST = ROOT / "dist"
FOLDERS = (ROOT, *sorted(path.parent for path in ROOT.glob("plugins/*/pyproject.toml")))

pytestmark = [
    pytest.mark.packaging,
    pytest.mark.skipif(not list(DIST.glob("*.whl")), reason="dist/ is empty; run `make dist`"),
]


def distribution(folder: Path) -> str:
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return f"{project['name'].replace('-', '_')}-{project['version']}"


def tracked(*folders: Path) -> Iterator[Path]:
    command = ["git", "-C", str(ROOT), "ls-files", *map(str, folders)]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return (ROOT / line for line in listed.splitlines())


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_a_wheel_has_the_package_with_its_data_and_licences(folder: Path) -> None:
    (wheel,) = DIST.glob(f"{distribution(folder)}-*.whl")
    sources = folder / ("python" if folder == ROOT else "src")
    assert ("-cp311-abi3-" if folder == ROOT else "-py3-none-any") in wheel.name
    with zipfile.ZipFile(wheel) as archive:
        names = [name for name in archive.namelist() if ".dist-info/" not in name]
        licences = [name for name in archive.namelist() if "/licenses/LICENSE-" in name]
        (about,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        fields = archive.read(about).decode()
        packed = {name: archive.read(name) for name in names if not name.endswith(".abi3.so")}
    assert packed == {path.relative_to(sources).as_posix(): path.read_bytes() for path in tracked(sources)}
    assert len(licences) == 2
    data = " AND CC-BY-SA-4.0 AND CC-BY-SA-2.1-JP" if folder.name == "palpate-forearm" else ""
    assert f"License-Expression: {'(MIT OR Apache-2.0)' if data else 'MIT OR Apache-2.0'}{data}\n" in fields
    assert "Description-Content-Type: text/markdown" in fields
    assert any(name.endswith("/py.typed") for name in names)


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_a_source_distribution_has_all_that_a_build_needs(folder: Path) -> None:
    if folder == ROOT:
        built = (ROOT / name for name in ("python", "pyproject.toml", "Cargo.lock", "README.md"))
        needed = [*tracked(*built), *ROOT.glob("LICENSE-*"), *ROOT.glob("crates/*/src/**/*.rs")]
    else:
        needed = list(tracked(folder))
    name = distribution(folder)
    with tarfile.open(DIST / f"{name}.tar.gz") as archive:
        assert not [member.name for member in archive if member.issym() or member.islnk()]
        for path in needed:
            member = archive.extractfile(f"{name}/{path.relative_to(folder)}")
            assert member is not None, path
            assert member.read() == path.read_bytes(), path


def requirements(wheels: list[Path]) -> set[str]:
    """Names of the distributions that the wheels need, and those need."""
    found: set[str] = set()
    waiting = []
    for wheel in wheels:
        with zipfile.ZipFile(wheel) as archive:
            (about,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
            waiting += re.findall(r"^Requires-Dist: (.*)$", archive.read(about).decode(), flags=re.MULTILINE)
    while waiting:
        wanted = Requirement(waiting.pop())
        if wanted.name.startswith("palpate") or (wanted.marker and not wanted.marker.evaluate({"extra": ""})):
            continue
        if wanted.name not in found:
            found.add(wanted.name)
            waiting += metadata.requires(wanted.name) or ()
    return found


def link_libraries(site: Path, names: set[str]) -> None:
    """Put libraries of this environment into another, by link: nothing is downloaded."""
    for name in names:
        library = metadata.distribution(name)
        for top in {file.parts[0] for file in library.files or ()} - {"..", "__pycache__"}:
            if not (site / top).exists():
                (site / top).symlink_to(Path(str(library.locate_file(top))).resolve())


@pytest.fixture(scope="module")
def away(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with an environment `env` that has palpate, its plugins and a third party's, from wheels."""
    folder = tmp_path_factory.mktemp("away")
    venv.create(folder / "env")
    (site,) = (folder / "env").glob("lib/python*/site-packages")
    copy = folder / "fibre"
    shutil.copytree(ROOT / "examples" / "palpate-fibre", copy)
    build = [sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", str(folder), str(copy)]
    subprocess.run(build, check=True, capture_output=True)
    wheels = [*DIST.glob("*.whl"), *folder.glob("*.whl")]
    link_libraries(site, requirements(wheels))
    install = [sys.executable, "-m", "pip", "--python", str(folder / "env" / "bin" / "python"), "install"]
    command = [*install, "--quiet", "--no-index", "--find-links", str(DIST), *map(str, wheels)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def run(away: Path, program: str, *arguments: str) -> str:
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    command = [str(away / "env" / "bin" / program), *arguments]
    done = subprocess.run(command, cwd=away, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_plugin_is_found_and_none_is_broken(away: Path) -> None:
    code = "import palpate; print(palpate.__file__, len(palpate.Plugins.load().broken))"
    home, broken = run(away, "python", "-c", code).split()
    assert (home.startswith(str(away)), broken) == (True, "0")
    listed = run(away, "palpate", "plugins")
    for folder in (*FOLDERS[1:], ROOT / "examples" / "palpate-fibre"):
        assert folder.name.removeprefix("palpate-") in listed


def leave_out_the_fit(study: Path) -> None:
    """Keep to the sweep: a fit takes up to minutes, and is tested elsewhere."""
    file = study / "study.toml"
    text = file.read_text(encoding="utf-8").replace("n_sets = 0", "n_sets = 2")
    if "[fit]" not in text:
        text += "[fit]\n"
    file.write_text(text.replace("[fit]\n", '[fit]\nsearch = "sweep"\n'), encoding="utf-8")


def keep_one_spot(study: Path) -> None:
    file = study / "study.toml"
    before, first, *others = file.read_text(encoding="utf-8").split("[[spot]]")
    after = others[-1][others[-1].index("\n[") :]
    file.write_text(f"{before}[[spot]]{first}{after}", encoding="utf-8")


def test_the_study_of_the_demo_runs(away: Path) -> None:
    run(away, "palpate", "init", "--study", "forearm-demo", "demo")
    leave_out_the_fit(away / "demo")
    keep_one_spot(away / "demo")
    run(away, "palpate", "run", "demo", "--sets", "2")
    assert (away / "runs" / "forearm-demo" / "report" / "index.html").is_file()


def test_a_study_of_a_third_party_runs(away: Path) -> None:
    leave_out_the_fit(away / "fibre" / "study")
    found = json.loads(run(away, "palpate", "run", "fibre/study", "--sets", "8", "--json"))
    assert found["n_sets"] == 8
