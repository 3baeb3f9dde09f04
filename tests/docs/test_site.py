"""The site is built without a warning and without the network."""

import re
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import palpate
from palpate_report.answer.warnings import kinds

ROOT = Path(__file__).parents[2]
TERMS = ROOT / "docs" / "site" / "glossary.toml"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    palpate_command = [sys.executable, "-m", "palpate"]
    copy, run = folder / "treloar", folder / "gallery" / "treloar"
    for arguments in (["init", "--study", "treloar", copy], ["run", copy, "--out", run]):
        subprocess.run([*palpate_command, *map(str, arguments)], check=True, capture_output=True)
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
    command += ["--config-file", str(ROOT / "docs/site/mkdocs.yml"), "--site-dir", str(folder / "site")]
    environment = {"PALPATE_GALLERY": str(folder / "gallery"), "NO_COLOR": "1"}
    with pytest.MonkeyPatch.context() as patch:
        for key, value in environment.items():
            patch.setenv(key, value)
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    return folder / "site"


def test_every_guide_and_plugin_has_a_page(site: Path) -> None:
    for path in [*(ROOT / "docs").glob("*.md"), ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md"]:
        assert (site / path.relative_to(ROOT)).with_suffix(".html").is_file()
    for path in ROOT.glob("*/palpate-*/pyproject.toml"):
        assert (site / path.relative_to(ROOT)).with_name("index.html").is_file()


def test_nothing_is_fetched_from_the_network(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.findall(r"<(?:script|link|img|iframe)\b[^>]*(?:src|href)=\"(?:https?:)?//", text), page
    for style in site.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        assert not re.findall(r"(?:url\(|@import )['\"]?(?:https?:)?//", text), style


def test_every_table_of_a_stage_has_its_columns_on_a_page(site: Path) -> None:
    page = (site / "reference" / "tables.html").read_text(encoding="utf-8")
    for kind in palpate.Plugins.load().stages.values():
        for name, table in kind.tables.items():
            assert f": {name}<a" in page
            assert [column for column in table.columns if f"<code>{column}</code>" not in page] == []


@pytest.mark.browser
@pytest.mark.parametrize("name", ["index", "docs/choose", "docs/tutorial", "gallery", "reference/warnings"])
def test_a_page_fits_on_phones_and_axe_finds_no_violation(site: Path, tmp_path: Path, name: str) -> None:
    chromium = runpy.run_path(str(ROOT / "plugins" / "palpate-report" / "tests" / "chromium.py"))
    axe = pytest.importorskip("axe_core_python", reason="no axe-core is installed")
    if chromium["COMMAND"] is None:
        pytest.skip("no Chromium is installed")
    with chromium["Chromium"](tmp_path) as browser:
        for width in (1100, 390):
            browser.visit(site / f"{name}.html", width)
            browser.wait("document.readyState === 'complete'")
            assert browser.value("document.documentElement.scrollWidth") <= width
            browser.value(Path(axe.__file__).with_name("axe.min.js").read_text(encoding="utf-8") + "; 1")
            found = "axe.run().then(r => r.violations.map(v => [v.id, v.nodes[0].html]))"
            assert browser.value(found) == []


def test_every_warning_has_a_place_on_a_page(site: Path) -> None:
    page = (site / "reference" / "warnings.html").read_text(encoding="utf-8")
    assert [code for code in kinds() if f'id="{code}"' not in page] == []


def test_the_reference_has_every_public_name_and_every_term(site: Path) -> None:
    reference = (site / "reference" / "palpate.html").read_text(encoding="utf-8")
    named = set(re.findall(r'id="palpate\.(\w+)"', reference))
    assert set(palpate.__all__) <= named
    assert not re.findall(r":(?:class|func|meth|mod|data|attr):", reference)
    terms = (site / "reference" / "glossary.html").read_text(encoding="utf-8")
    assert all(f">{term}<a" in terms for term in tomllib.loads(TERMS.read_text(encoding="utf-8")))


def test_the_gallery_shows_figures_and_lines_of_runs(site: Path) -> None:
    gallery = (site / "gallery.html").read_text(encoding="utf-8")
    assert 'src="gallery/treloar/response_specimen.png"' in gallery
    for name in ("response_specimen.png", "report.html"):
        assert (site / "gallery" / "treloar" / name).is_file()
    assert "<strong>Conclusion</strong>" in gallery
    assert "Not run yet" in gallery
