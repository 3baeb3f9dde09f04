"""The page: everything in one file, for any names of the study, and accessible."""

import base64
import hashlib
import json
import re
import zlib
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import palpate_report
from palpate.domain import Indentation
from palpate.domain.indenter import Sphere
from palpate.errors import MeshError
from palpate.fit.least_squares import LeastSquares
from palpate.mesh.specimens import block
from palpate.plugins.sections import Drawing, Fold, Listing, ReportWarning, Section, Table
from palpate.run.result import FitResult
from palpate.run.tables import DECLARED
from palpate_report.answer.result import make_conclusion
from palpate_report.data.tables import TITLES, make_tables
from palpate_report.figures.limb_view import limb_view
from palpate_report.figures.scene import scene
from palpate_report.from_run import write_report
from palpate_report.page.html import render
from palpate_report.page.page_data import MOST_SETS, page_data

from .fits import refused, with_tables
from .hostile import ATTACK, NAMES, REASON, renamed

VOID = {"meta", "link", "input", "br", "img"}


class Page(HTMLParser):
    """Elements of a page in order: tag, attributes and text directly within."""

    def __init__(self, text):
        super().__init__()
        self.elements, self._open = [], []
        self.feed(text)
        self.close()
        assert not self._open, f"left open: {self._open}"

    def handle_starttag(self, tag, attrs):
        self.elements.append([tag, dict(attrs), ""])
        if tag not in VOID:
            self._open.append(len(self.elements) - 1)

    def handle_endtag(self, tag):
        assert self.elements[self._open.pop()][0] == tag

    def handle_data(self, data):
        if self._open:
            self.elements[self._open[-1]][2] += data

    def all(self, *tags):
        return [element for element in self.elements if element[0] in tags]

    def text(self):
        return " ".join(text for tag, _, text in self.elements if tag not in ("script", "style"))

    def data(self):
        return json.loads(next(t for _, attributes, t in self.elements if attributes.get("id") == "data"))


@pytest.fixture
def page(content):
    def made(change=lambda content: content, **changes):
        shown = change(content(**changes))
        tables = make_tables(shown)
        files = [Path("tables/a%20b.csv"), Path("figures/x.svg")]
        return Page(render(shown, tables, make_conclusion(shown, tables), files))

    return made


def test_the_page_names_every_file_and_reports_simulated_data(undrawn, content, tmp_path):
    files = write_report(content(), tmp_path / "report").files
    text = (tmp_path / "report" / "index.html").read_text()
    assert "these are simulated data, not a measurement" in text
    assert 'href="figures/a%20figure.svg"' in text
    for path in files:
        unlisted = ("index.html", "a figure.svg", "methods.md", "result.json")
        assert f'"{path.parent.name}/{path.name}"' in text or path.name in unlisted
    write_report(content(data="measured"), tmp_path / "real")
    real = (tmp_path / "real" / "index.html").read_text()
    assert "not a measurement" not in real
    assert "experiment (simulated)" not in real.partition("<script>")[0]


def test_the_page_requests_nothing_and_runs_only_its_scripts(page):
    made = page()
    (policy,) = (a["content"] for _, a, _ in made.all("meta") if a.get("http-equiv"))
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-eval" not in policy
    data, library, script = made.all("script")
    assert data[1]["type"] == "application/json"
    unpacked = zlib.decompress(base64.b64decode(library[2]))
    for source in (script[2].encode(), unpacked):
        assert f"'sha256-{base64.b64encode(hashlib.sha256(source).digest()).decode()}'" in policy
    asked = [a[k] for _, a, _ in made.elements for k in ("src", "href") if k in a]
    assert all(re.match(r"#|data:,$|tables/|figures/", place) for place in asked)
    assert "tables/a%2520b.csv" in asked


def test_the_page_is_below_its_limit_with_many_sets_and_meshes(content):
    made = content()
    limb = block("tet10", n_across=30, n_down=12)
    assert sum(len(part.triangles) for part in limb_view(limb)) > 6000
    values = np.random.default_rng(0).uniform(0.1, 50.0, (MOST_SETS, 2))
    many = replace(
        made,
        design=replace(made.design, values=values),
        limbs={name: replace(limb, spot=replace(limb.spot, name=name)) for name in ("p1", "p2")},
    )
    assert 1_000_000 < len(render(many, {}, make_conclusion(many, {}), []).encode()) < 5_000_000


def test_of_too_many_sets_the_best_are_shown(content):
    made = content()
    n_sets = MOST_SETS + 500
    values = np.random.default_rng(0).uniform(0.1, 50.0, (n_sets, 2))
    data = page_data(replace(made, design=replace(made.design, values=values)))
    assert set(data["sets"]["ids"]) == set(made.scores["set_id"])
    assert data["sets"]["n_left_out"] == n_sets - 40


def test_hostile_names_stay_text_in_markup_and_script(page):
    made = page(renamed)
    assert len(made.all("script")) == 3
    assert not made.all("marquee", "img", "iframe")
    assert not [a for _, a, _ in made.elements if any(key.startswith("on") for key in a)]
    assert not [a for _, a, _ in made.all("a") if a["href"].startswith("javascript")]
    data = made.data()
    reported = json.dumps(data, ensure_ascii=False)
    for name in NAMES:
        assert json.dumps(name, ensure_ascii=False)[1:-1] in reported or name == NAMES[-1]
    raw = next(t for _, a, t in made.elements if a.get("id") == "data")
    assert not re.search("[<>&\u2028\u2029]", raw)
    assert ATTACK in made.text()
    assert REASON in made.text()


def test_what_is_not_finite_is_null_in_the_data(page):
    made = page(lambda content: content)
    assert "NaN" not in next(t for _, a, t in made.elements if a.get("id") == "data")


def test_headings_go_down_one_by_one_and_every_table_and_control_has_a_name(page):
    made = page(search=LeastSquares(), truth={"soft_tissue.stiffness": 0.4})
    assert made.all("html")[0][1]["lang"] == "en"
    levels = [int(tag[1]) for tag, _, _ in made.elements if re.fullmatch(r"h\d", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(b - a <= 1 for a, b in pairwise(levels))
    assert len(made.all("caption")) == len(made.all("table"))
    assert all(a.get("scope") in ("col", "row") for _, a, _ in made.all("th"))
    for _, attributes, _ in made.all("section"):
        titles = [a for _, a, _ in made.all("h2") if a.get("id") == attributes["aria-labelledby"]]
        assert len(titles) == 1
    ids = [a["id"] for _, a, _ in made.elements if "id" in a]
    assert len(ids) == len(set(ids))
    links = [a["href"][1:] for _, a, _ in made.all("a") if a["href"].startswith("#")]
    assert set(links) <= set(ids)
    assert all(
        a.get("aria-label") for _, a, _ in made.elements if a.get("role") in ("img", "region", "group")
    )


AS_FILES = {
    "table1_fit",
    "table1_coefficients",
    "table2_fit",
    "fit",
    "intervals",
    "parameter_combinations",
    "budget",
    "distance_to_truth",
}
"""Tables that the page names as files: its own table of values has what leads of them."""


def test_every_table_of_a_full_run_is_on_the_page_or_named_as_a_file(content):
    made = refused(content(search=LeastSquares(), truth={"soft_tissue.stiffness": 0.4}))
    verification = pl.DataFrame({"spot": ["p1"], "set_id": [3], "passed": [True], "message": [""]})
    failed = made.scores.with_columns(nmse=pl.when(pl.col("set_id") > 1).then("nmse"))
    row = {
        "fit": "all spots", "scenario": "I", "parameter": "soft_tissue.stiffness",
        "coarse": 0.3, "corrected": 0.4,
    }  # fmt: skip
    fit = replace(made.fit, mesh=pl.DataFrame([row]))
    made = replace(made, fit=fit, verification=verification, scores=failed)
    names = ("posterior", "profile_ends", "volumes", "emulator")
    of_joint = pl.DataFrame({"fit": ["all spots"], "scenario": ["I"]})
    drawn = of_joint.with_columns(split_r=1.0, autocorrelation=10.0, converged=True)
    made = with_tables(made, **dict.fromkeys(names, of_joint) | {"posterior": drawn})
    tables = make_tables(made)
    assert set(tables) == set(TITLES) - {"convergence", "parameters", "errors", "criteria", "laws"}
    conclusion = make_conclusion(made, tables)
    shown_page = Page(render(made, tables, conclusion, []))
    captions = [text for tag, _, text in shown_page.elements if tag == "caption"]
    shown = {"identifiability": "Intervals in scenario I"}
    every = {name: shown.get(name, TITLES[name]) for name in (*tables, "convergence")}
    missing = {name for name, caption in every.items() if caption not in captions}
    assert missing <= AS_FILES
    text = " ".join(text for *_, text in shown_page.elements)
    assert [name for name in missing if f"tables/{name}.csv" not in text] == []


def test_the_page_leads_with_the_joint_fit_and_its_spots_beside_it(content):
    truth = {"soft_tissue.stiffness": 0.4, "soft_tissue.grip": 20.0}
    made = content(assessed=False, search=LeastSquares(), truth=truth)
    tables = make_tables(made)
    shown = Page(render(made, tables, make_conclusion(made, tables), []))
    heads = [text for _, a, text in shown.all("th") if a.get("scope") == "col"]
    assert heads[:4] == ["parameter", "value", "about as good", "identified"]
    heads = heads[4:]  # after the card
    assert heads[:5] == ["parameter", "all spots", "p1", "p2", "true value"]
    rows = [text for _, a, text in shown.all("th") if a.get("scope") == "row"]
    rows = rows[4:]
    assert rows[:9] == [
        "stiffness (MPa)", "grip (MPa)", "initial shear modulus (MPa)", "Young's modulus (MPa)",
        "Fopt (all spots: mean)", "least Fopt of the search (all spots: mean)",
        "R² force (all spots: least)", "R² torque (all spots: least)", "found by",
    ]  # fmt: skip
    _, values, *_ = (k for k, (tag, *_) in enumerate(shown.elements) if tag == "table")
    cells = [text.strip() for tag, _, text in shown.elements[values:] if tag == "td"]
    joint = make_conclusion(made, tables).bests[0].values[0].text
    assert [cells[0], cells[3], cells[11]] == [joint, "0.4", "0.4"]
    data = shown.data()
    assert [each["fit"] for each in data["searches"][0][0]] == ["all spots", "p1"]


@pytest.mark.slow
def test_a_fit_without_a_sweep_has_a_page_without_its_sections(page):
    made = page(assessed=False, n_sets=0, search=LeastSquares())
    ids = {a.get("id") for _, a, _ in made.elements}
    assert not ids & {"section-distribution", "section-generalisation", "pick"}
    assert {"section-fit", "section-space", "pairs", "section-curves"} <= ids
    assert "2 spots, no sweep" in made.text()
    assert "One material for all 2 spots" in made.text()


def test_fits_that_all_failed_without_a_sweep_have_a_whole_page(page):
    reason = "the start cannot be simulated (p1: diverged)"

    def failed(content):
        about = [{"fit": "all spots", "scenario": name} for name in ("I", "II", "III")]
        rows = [row | {"message": reason, "n_runs": 2, "n_fine": 0} for row in about]
        table = DECLARED["fit"]["fit"].frame(rows)
        trace = content.fit.trace.with_columns(fopt=pl.lit(None), objective=pl.lit(None))
        return replace(content, fit=FitResult(table=table, trace=trace))

    made = page(failed, n_sets=0, search=LeastSquares())
    text = made.text()
    assert "1 of the fits has no result" in text
    assert "2 of the fits have no result" in text
    assert f"all spots, scenario I: {reason}" in text
    assert "No result for 6 of 6 spots and scenarios" in text
    ids = {a.get("id") for _, a, _ in made.elements}
    assert {f"section-{name}" for name in ("fit", "curves", "space", "provenance")} <= ids
    assert made.data()["figures"] == []


def test_a_sweep_without_a_fit_has_no_section_on_one(page):
    ids = {a.get("id") for _, a, _ in page().elements}
    assert "section-fit" not in ids


def test_what_a_run_lacks_has_no_section(page):
    made = page(lambda c: replace(c, generalisation=c.generalisation[:0], tables={}))
    ids = {a.get("id") for _, a, _ in made.elements}
    sections = {each.removeprefix("section-") for each in ids if each and each.startswith("section-")}
    assert not sections & {"generalisation", "identifiability", "limb"}
    assert {"curves", "space", "distribution", "channels", "convergence", "provenance"} <= sections


def test_provenance_has_every_leaf_of_the_manifest(page):
    text = page(lambda c: c).text()
    for word in ("normaliser", "mean_abs", "soft_tissue", "textbook", "study.toml"):
        assert word in text


# ------------------------------------------------------------------- sections


class Extra(Section):
    name, title, summary, after = "extra", "Extra", "of a plugin", "warnings"

    def blocks(self, data, report):
        return [Fold("more", [Table.of("Sets", report.tables["cross_channel"])]), Listing([("a", "b")])]

    def warnings(self, data):
        return [ReportWarning("Extra care", "It is of a plugin.")]


class Broken(Extra):
    name, title = "broken", "Broken"

    def blocks(self, data, report):
        raise KeyError("misspelt")

    def warnings(self, data):
        return 1 / 0


def test_a_plugin_adds_a_section_at_its_place_with_its_warnings(page):
    made = page(lambda c: replace(c, sections={**c.sections, "extra": Extra}))
    sections = [a["id"].removeprefix("section-") for _, a, _ in made.all("section")]
    assert sections[sections.index("warnings") + 1] == "extra"
    assert "#section-extra" in [a["href"] for _, a, _ in made.all("a")]
    assert "Sets" in [text for _, _, text in made.all("caption")]
    assert "Extra care." in made.text()


def test_a_section_that_fails_says_so_and_the_others_are_there(page):
    notes = []
    made = page(lambda c: replace(c, sections={**c.sections, "broken": Broken}, note=notes.append))
    (note,) = notes
    assert note.startswith("warning: section 'broken' of the page could not be made: laying out the report")
    text = made.text()
    assert "This section could not be made: laying out the report: 'broken'" in text
    assert "raised KeyError: 'misspelt'" in text
    assert "Section 'broken' of the report has failed" in text
    assert "section-provenance" in {a.get("id") for _, a, _ in made.elements}


class Generated(Extra):
    def blocks(self, data, report):
        yield Fold("more", (Table("Sums", iter(["a", "b"]), iter([iter([1, 2])])) for _ in range(1)))


class NotMade(Extra):
    def __init__(self):
        raise KeyError("not made")


def of(name, blocks, warnings=()):
    return type(name, (Extra,), {"blocks": lambda *_: blocks, "warnings": lambda *_: warnings})


@pytest.mark.parametrize(
    ("section", "said"),
    [
        (of("Longer", [Table("Sums", ["a"], [[1], [1, 2]])]), "row 1 has 2 cells for 1 columns"),
        (of("Shorter", [Table("Sums", ["a", "b"], [[1]])]), "row 0 has 1 cells for 2 columns"),
        (of("Drawn", [Fold("more", [Drawing("nothing")])]), "only the page's own sections can draw"),
        (of("Triples", [Listing([("a", "b", "c")])]), "raised ValueError"),
        (of("Warns", [], ["beware"]), "warns of 'beware', which is no palpate.api.ReportWarning"),
        (NotMade, "raised KeyError: 'not made'"),
    ],
)
def test_what_the_page_cannot_show_is_refused_by_the_name_of_its_section(page, section, said):
    made = page(lambda c: replace(c, sections={**c.sections, "extra": section}))
    assert "'extra'" in made.text()
    assert said in made.text()
    assert "section-provenance" in {a.get("id") for _, a, _ in made.elements}


def test_blocks_that_are_made_one_by_one_are_all_shown(page):
    made = page(lambda c: replace(c, sections={**c.sections, "extra": Generated}))
    assert "Sums" in [text for _, _, text in made.all("caption")]


# --------------------------------------------------------------------- colours


def _colours(css, dark):
    blocks = re.findall(r":root \{(.*?)\}", css, re.DOTALL)
    found = dict(re.findall(r"--(\S+): (#[0-9a-f]{6});", blocks[0]))
    return found | (dict(re.findall(r"--(\S+): (#[0-9a-f]{6});", blocks[1])) if dark else {})


def _luminance(colour):
    parts = [int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def _contrast(one, other):
    light, dark = sorted((_luminance(one), _luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("dark", [False, True])
def test_text_has_a_contrast_of_4_5_and_lines_of_3(dark):
    colours = _colours((Path(palpate_report.__file__).parent / "page" / "page.css").read_text(), dark)
    for paper in ("paper", "panel"):
        for text in ("ink", "soft", "link", "warn", "bad", "good"):
            assert _contrast(colours[text], colours[paper]) >= 4.5, (text, paper)
    assert _contrast(colours["ink"], colours["warn-paper"]) >= 4.5
    for line in ("measured", "least", "above", "failed", *(f"line{i}" for i in range(6))):
        assert _contrast(colours[line], colours["paper"]) >= 3.0, line


# ------------------------------------------------------------------------ limb


def test_a_limb_is_made_coarser_and_stays_where_it_is():
    limb = block("tet10", n_across=16, n_down=10)
    protocol = Indentation(indenter=Sphere(radius_mm=7.5), path=[(0, 0), (4, 0)], friction=1.0)
    whole, coarse = scene(limb, protocol, 10**6), scene(limb, protocol, 600)
    surfaces = [t for t in coarse if t["type"] == "mesh3d" and not t["name"].startswith("sphere")]
    assert sum(len(t["i"]) for t in surfaces) <= 600
    assert [t["name"] for t in coarse] == [t["name"] for t in whole]
    for trace, full in zip(coarse, whole, strict=True):
        for axis in "xyz":
            size = max(np.ptp(limb.mesh.points_mm, axis=0))
            assert abs(min(trace[axis]) - min(full[axis])) < 0.2 * size
            assert abs(max(trace[axis]) - max(full[axis])) < 0.2 * size
        if trace["type"] == "mesh3d":
            assert max(max(trace[k]) for k in "ijk") < len(trace["x"])
    assert whole == scene(limb, protocol, 10**5)


def test_the_sphere_is_shown_at_rest_and_where_it_presses_deepest():
    limb = block("tet4", n_across=4, n_down=3)
    protocol = Indentation(indenter=Sphere(radius_mm=7.5), path=[(0, 0), (4, 0), (4, 20)], friction=1.0)
    traces = {t["name"]: t for t in scene(limb, protocol, 1000)}
    assert min(traces["sphere"]["z"]) == pytest.approx(0.0, abs=0.01)
    assert min(traces["sphere at 4 mm"]["z"]) == pytest.approx(-4.0, abs=0.01)
    assert not [name for name in (t["name"] for t in scene(limb, None, 1000)) if name.startswith("sphere")]


class Lost(Sphere):
    name = "lost"

    def distance(self, points):
        raise MeshError("tool.stl: the tool cannot be read")


def test_a_limb_is_shown_without_a_tool_whose_file_is_lost():
    limb = block("tet4", n_across=4, n_down=3)
    protocol = Indentation(indenter=Lost(radius_mm=7.5), path=[(0, 0), (4, 0)], friction=1.0)
    assert scene(limb, protocol, 1000) == scene(limb, None, 1000)
