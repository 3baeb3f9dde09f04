"""The page in a browser: drawn without an error, linked, for keyboards, phones and dark rooms."""

from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

from palpate.fit.least_squares import LeastSquares
from palpate.mesh.specimens import block
from palpate.plugins.sections import Figure, Paragraph, Picture, Section, Table
from palpate_report.answer.result import make_conclusion
from palpate_report.comparison import write_comparison
from palpate_report.data.tables import make_tables
from palpate_report.page.html import render

from .chromium import COMMAND, Chromium
from .dimple import dimple
from .hostile import ATTACK, NAMES, renamed

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(COMMAND is None, reason="no Chromium is installed"),
]


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Chromium(tmp_path_factory.mktemp("chromium")) as chromium:
        yield chromium


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pages")


def as_it_is(content):
    return content


@pytest.fixture
def page(content, folder):
    """Path of a page of two spots, with limbs; made once of each kind."""

    def made(change=as_it_is, **changes):
        path = folder / f"{change.__name__}{len(changes)}.html"
        if not path.exists():
            limb = block("tet4", n_across=4, n_down=3)
            limbs = {name: replace(limb, spot=replace(limb.spot, name=name)) for name in ("p1", "p2")}
            shown = change(replace(content(**changes), limbs=limbs))
            tables = make_tables(shown)
            path.write_text(render(shown, tables, make_conclusion(shown, tables), []))
        return path

    return made


def count(browser, selector):
    return browser.value(f"document.querySelectorAll({selector!r}).length")


def unfolded(browser, path, *width, **how):
    """Open a page with every section unfolded, and its figures drawn."""
    browser.open(path, *width, **how)
    browser.value("document.querySelectorAll('details').forEach(d => {d.open = true})")
    browser.wait("document.getElementById('pairs').data")


def choose(browser, menu, value):
    """Choose in one menu of a kind; the others follow."""
    browser.value(
        f"(s => {{s.value = '{value}'; s.dispatchEvent(new Event('change'))}})"
        f"(document.querySelector('[data-menu={menu}]'))"
    )


def rectangle(browser, selector):
    found = f"document.querySelector({selector!r}).getBoundingClientRect()"
    return browser.value(f"(b => [b.x, b.y, b.width, b.height])({found})")


def test_it_is_drawn_at_every_width_in_light_and_dark_without_an_error_or_a_request(browser, page):
    path = page()
    for width, dark in ((1100, False), (400, False), (320, False), (1100, True)):
        browser.open(path, width, dark=dark)
        # Folded as it comes, and drawn without a figure that cannot be seen.
        assert browser.value("document.documentElement.scrollHeight") < 4000
        assert count(browser, "#pairs .point") == 0
        unfolded(browser, path, width, dark=dark)
        assert browser.value("document.documentElement.dataset.ready") == "yes"
        assert browser.complaints() == []
        assert [each for each in browser.requests() if not each.startswith("data:")] == [path.as_uri()]
        assert browser.value("document.documentElement.scrollWidth") <= width
        # Of the parameters' plane each set, and the least again.
        assert count(browser, "#pairs .subplot.xy .point") >= 41
        ink = browser.value("getComputedStyle(document.querySelector('#pairs .xtitle')).fill")
        assert ink == ("rgb(232, 235, 238)" if dark else "rgb(27, 31, 35)")


@pytest.mark.parametrize("dark", [False, True])
def test_a_comparison_fits_on_phones_and_paper(browser, content, folder, dark):
    path = folder / "comparison" / "index.html"
    if not path.exists():
        run = content(search=LeastSquares(), n_sets=12)
        write_comparison({"one": run, "a_second_run": run, "third": run}, path.parent)
    for width in (1100, 400, 320):
        browser.open(path, width, dark=dark)
        assert browser.value("document.documentElement.scrollWidth") <= width
        assert browser.complaints() == []
        assert violations(browser) == []
    browser.print_media(path, dark=dark)
    assert browser.n_printed_pages() <= 3
    assert browser.value("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"


def violations(browser):
    """Rules of axe that the open page breaks, with the first place."""
    axe = pytest.importorskip("axe_core_python", reason="no axe-core is installed")
    browser.value(Path(axe.__file__).with_name("axe.min.js").read_text(encoding="utf-8") + "; 1")
    return browser.value("axe.run().then(r => r.violations.map(v => [v.id, v.nodes[0].html]))")


@pytest.mark.parametrize("dark", [False, True])
def test_axe_finds_no_violation(browser, page, dark):
    for width in (1100, 400):
        unfolded(browser, page(pressed), width, dark=dark)
        assert violations(browser) == []


@pytest.mark.parametrize("dark", [False, True])
def test_print_is_on_white_and_has_heads_of_whole_words(browser, page, dark):
    path = page(search=LeastSquares())
    browser.print_media(path, dark=dark)
    assert browser.n_printed_pages() <= 6
    shown = "[...document.querySelectorAll('.plot, canvas, [data-menu]')].filter(e => e.checkVisibility())"
    assert browser.value(f"{shown}.length") == 0
    sections = (
        "[...document.querySelectorAll('main > section')].filter(e => e.checkVisibility()).map(e => e.id)"
    )
    assert {"conclusion", "section-curves", "section-values"} <= set(browser.value(sections))
    assert "section-provenance" not in browser.value(sections)
    assert browser.value("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    # The result begins on the first page, below the name of the study.
    top = browser.value("document.getElementById('conclusion').getBoundingClientRect().top")
    assert 0.0 < top < 300.0
    heads = "[...document.querySelectorAll('thead th')]"
    assert browser.value(f"{heads}.every(h => getComputedStyle(h).overflowWrap !== 'anywhere')")
    # A line for each word at most: none is broken.
    broken = (
        f"{heads}.filter(h => h.textContent.trim()).filter(h => {{const r = document.createRange();"
        "r.selectNodeContents(h); const lines = new Set([...r.getClientRects()].map(b => Math.round(b.top)));"
        "return lines.size > h.textContent.trim().split(/[\\s_–-]+/).length}).map(h => h.textContent)"
    )
    assert browser.value(broken) == []


@pytest.mark.parametrize("changes", [{}, {"n_sets": 0}])
def test_a_fit_is_drawn_with_and_without_a_sweep(browser, page, changes):
    path = page(search=LeastSquares(), **changes)
    for width in (1100, 400):
        unfolded(browser, path, width)
        assert browser.complaints() == []
        assert browser.value("document.documentElement.scrollWidth") <= width
        ends = "document.getElementById('pairs').data.filter(t => t.marker?.symbol === 'diamond')"
        assert browser.value(f"{ends}.length") == 2 * 3
        assert browser.value(f"{ends}[1].x[0]") == pytest.approx(0.4, rel=1e-3)
        choose(browser, "spot", 1)
        assert "p2: fit" in browser.value("document.getElementById('pairs').data.map(t => t.name)")
        # Every menu of spots shows the one that was chosen.
        assert (
            browser.value("[...document.querySelectorAll('[data-menu=spot]')].map(s => s.value)") == ["1"] * 2
        )
        browser.value("document.querySelector('[data-reset]').click()")
        assert browser.complaints() == []
    assert "NaN" not in attributes_of_pictures(browser)


def attributes_of_pictures(browser):
    return browser.value(
        "[...document.querySelectorAll('svg *')].flatMap(e => [...e.attributes].map(a => a.value)).join(' ')"
    )


def unranked(content):
    """The same run, of which no torque could be compared: two of three scenarios have no set."""
    unscored = pl.when(pl.col("channel") == "torque").then(None).otherwise(pl.col("nmse"))
    third = pl.col("scenario") == "III"
    return replace(
        content,
        scores=content.scores.with_columns(nmse=unscored),
        selection=content.selection.filter(third),
        generalisation=content.generalisation[:0],
        tables=content.tables | {"identifiability": content.table("identifiability").filter(third)},
    )


def test_a_scenario_without_a_ranked_set_is_drawn_without_an_error(browser, page):
    path = page(unranked)
    for width in (1100, 400):
        unfolded(browser, path, width)
        assert browser.complaints() == []
        choose(browser, "scenario", 2)
        assert browser.complaints() == []
    assert "NaN" not in attributes_of_pictures(browser)


def pressed(content):
    """The same run, with the skin at one of its two spots."""
    return replace(content, surfaces={"p1": dimple(turned=3)})


INK = (
    "(c => [...c.getContext('2d').getImageData(0, 0, c.width, c.height).data]"
    ".filter((v, i) => i % 4 === 3 && v).length)(document.getElementById('skin'))"
)


EDGES = (
    "(c => { const [w, h] = [c.width - 80 * devicePixelRatio, c.height], of = c.getContext('2d');"
    " return [[0, 0, w, 2], [0, h - 2, w, 2], [0, 0, 2, h], [w - 2, 0, 2, h]].map(at =>"
    " [...of.getImageData(...at).data].filter((v, i) => i % 4 === 3 && v).length); })"
    "(document.getElementById('skin'))"
)


def test_the_first_view_has_the_whole_skin(browser, page):
    path = page(pressed)
    for width in (1100, 400):
        unfolded(browser, path, width)
        for _ in range(4):
            assert browser.value(EDGES) == [0, 0, 0, 0]
            browser.value("document.querySelector('[data-turn-skin=left]').click()")
        browser.value("document.querySelector('[data-turn-skin=in]').click()")
        assert any(browser.value(EDGES))


def test_the_skin_moves_with_the_slider_turns_plays_and_has_two_colours(browser, page, until):
    path = page(pressed)
    for width, dark in ((1100, False), (400, True)):
        unfolded(browser, path, width, dark=dark)
        label = "document.getElementById('skin-label').textContent"
        assert browser.value(label).startswith("depth 8 mm, rotation 0°: largest displacement 6.64 mm")
        picture, seen = "document.getElementById('skin').toDataURL()", []
        seen.append(browser.value(picture))
        assert browser.value(INK) > 5_000
        for change in (
            "(s => {s.value = 1; s.dispatchEvent(new Event('input'))})(document.getElementById('skin-step'))",
            "(s => {s.value = 'pressure'; s.dispatchEvent(new Event('input'))})"
            "(document.getElementById('skin-quantity'))",
            "document.querySelector('[data-turn-skin=left]').click()",
            "document.querySelector('[data-turn-skin=in]').click()",
        ):
            browser.value(change)
            seen.append(browser.value(picture))
        assert len(set(seen)) == 5
        assert "largest contact pressure 0.00" in browser.value(label)
        assert browser.value(label) in browser.value("document.getElementById('skin').ariaLabel")
        step, play = "document.getElementById('skin-step').value", "document.getElementById('skin-play')"
        first = browser.value(step)
        browser.value(f"{play}.click()")
        assert browser.value(f"{play}.textContent") == "Pause"
        until(lambda step=step, first=first: browser.value(step) != first)
        browser.value(f"{play}.click()")
        assert browser.value(f"{play}.textContent") == "Play"
        choose(browser, "spot", 1)
        assert browser.value("document.getElementById('skin').hidden")
        assert not browser.value("document.getElementById('skin-missing').hidden")
        choose(browser, "spot", 0)
        assert not browser.value("document.getElementById('skin').hidden")
        assert browser.complaints() == []
        assert browser.value("document.documentElement.scrollWidth") <= width


def test_each_menu_is_once_in_a_section_and_changes_what_that_shows(browser, page):
    unfolded(browser, page(pressed, search=LeastSquares()))
    menus = browser.value(
        "[...document.querySelectorAll('[data-menu]')].map(m => [m.closest('section').id, m.dataset.menu])"
    )
    assert sorted(menus) == [
        ["section-limb", "spot"],
        ["section-space", "scenario"],
        ["section-space", "spot"],
    ]
    for section, menu in menus:
        shown = (
            f"[...document.querySelectorAll('#{section} .plot')].map(p => JSON.stringify(p.data)).join()"
            f" + [...document.querySelectorAll('#{section} canvas.skin')].map(c => c.hidden).join()"
        )
        before = browser.value(shown)
        choose(browser, menu, 1)
        assert browser.value(shown) != before, (section, menu)
        choose(browser, menu, 0)
    assert browser.complaints() == []


KEYS = (
    "[...document.querySelectorAll('#pairs-legend li')]"
    ".map(li => [li.firstChild.style.color, li.textContent])"
)


def test_the_legend_of_the_planes_names_what_is_drawn_in_its_colours(browser, page):
    unfolded(browser, page(search=LeastSquares()))
    texts = [text for _, text in browser.value(KEYS)]
    for part in (
        "set, coloured",
        "× set of Fopt above",
        "★",
        "path of the fit to all spots",
        "path of the fit to p1",
    ):
        assert sum(part in text for text in texts) == 1, part
    for scenario in (0, 1):
        choose(browser, "scenario", scenario)
        drawn = "document.getElementById('pairs').data.find(t => t.name === 'p1: fit').line.color"
        shown = f"(e => {{e.style.color = {drawn}; return e.style.color}})(document.createElement('i'))"
        assert browser.value(shown) in [c for c, text in browser.value(KEYS) if "the fit to p1" in text]
    choose(browser, "spot", 1)
    assert not any("fit to p1" in text for _, text in browser.value(KEYS))
    # What there is nothing of is not in the legend, and dragging zooms where there is nothing to select.
    unfolded(browser, page(search=LeastSquares(), n_sets=0))
    assert not any("set" in text for _, text in browser.value(KEYS))
    assert browser.value("document.getElementById('pairs').layout.dragmode") == "zoom"


def test_a_selection_is_the_same_everywhere(browser, page):
    unfolded(browser, page())
    assert count(browser, "#selected tr") == 0
    browser.value(
        "document.getElementById('most').value = '0.5'; document.getElementById('pick').requestSubmit()"
    )
    chosen = browser.value(
        "document.getElementById('pairs').data.find(t => t.selectedpoints).selectedpoints.length"
    )
    assert 0 < chosen < 40
    assert f"{chosen} of 40 sets are selected" in browser.value(
        "document.getElementById('selected-count').textContent"
    )
    assert browser.value(
        "document.getElementById('pairs').data"
        f".filter(t => t.selectedpoints).every(t => t.selectedpoints.length === {chosen})"
    )
    listed = min(chosen, 12)
    assert count(browser, "#selected tbody tr") == listed
    browser.value("document.getElementById('clear').click()")
    assert browser.value("document.getElementById('selected').hidden")
    browser.value("document.getElementById('pairs').scrollIntoView()")
    x, y, width, height = rectangle(browser, "#pairs .nsewdrag")
    browser.drag((x + 0.02 * width, y + 0.02 * height), (x + 0.5 * width, y + 0.98 * height))
    browser.wait("document.querySelectorAll('#selected tbody tr').length > 0")
    assert browser.complaints() == []


def test_the_keyboard_reaches_every_control_in_the_order_of_the_page(browser, page):
    browser.open(page())
    browser.press("Tab")
    assert browser.value("document.activeElement.getAttribute('href')") == "#conclusion"
    assert browser.value("document.activeElement.getBoundingClientRect().x") >= 0.0
    seen = []
    for _ in range(200):
        browser.press("Tab")
        if browser.value("document.activeElement === document.body"):
            break
        seen.append(browser.value(
            "[...document.querySelectorAll('*')].indexOf(document.activeElement)"
        ))  # fmt: skip
        assert browser.value("getComputedStyle(document.activeElement).outlineStyle") != "none"
    assert seen == sorted(seen)
    assert len(seen) == len(set(seen)) > 20
    assert browser.value("[...document.querySelectorAll('.plot button')].every(b => b.ariaLabel)")
    assert count(browser, ".plot .main-svg:not([aria-hidden=true])") == 0


def test_the_limb_turns(browser, page):
    unfolded(browser, page())
    browser.value("document.getElementById('around').scrollIntoView()")
    browser.wait("document.querySelector('#around canvas')")
    eye = "JSON.stringify(document.getElementById('around').layout.scene.camera.eye)"
    before = browser.value(eye)
    browser.value("document.querySelector('[data-turn=left]').click()")
    assert browser.value(eye) != before
    names = browser.value("document.getElementById('around').data.map(t => t.name)")
    assert {"sphere", "sphere at 10 mm", "normal"} <= set(names)
    assert browser.complaints() == []


def test_hostile_names_are_shown_as_they_are_and_do_nothing(browser, page):
    unfolded(browser, page(renamed))
    assert browser.value("document.documentElement.dataset.ready") == "yes"
    assert browser.value("window.pwned") is None
    assert count(browser, "marquee, img, b b, .plot a, iframe") == 0
    assert browser.value("document.querySelector('h1').textContent") == ATTACK
    browser.value(
        "document.getElementById('most').value = '9'; document.getElementById('pick').requestSubmit()"
    )
    assert NAMES[0] in browser.value("document.getElementById('selected').textContent")
    assert browser.value("window.pwned") is None
    assert browser.complaints() == []


class Hostile(Section):
    name, title, summary = "hostile", "Hostile <b>x</b>", "a figure, and hostile texts"

    def blocks(self, data, report):
        return [
            Paragraph(ATTACK),
            Table(
                ATTACK,
                [ATTACK, "share"],
                [[ATTACK, ATTACK], ["b", 9]],
            ),
            Figure(
                label=ATTACK,
                traces=[
                    {
                        "type": "scatter",
                        "x": [0, 1],
                        "y": [1.0, float("nan")],
                        "name": ATTACK,
                        "line": {"color": "--least"},
                    }
                ],
                layout={"xaxis": {"title": ATTACK}, "images": [{"source": "https://example.org/a.png"}]},
            ),
            Picture(
                label=ATTACK,
                content=b"<svg xmlns='http://www.w3.org/2000/svg'><script>pwned = 1</script></svg>",
            ),
        ]


def hostile(content):
    return replace(content, sections={**content.sections, "hostile": Hostile})


def test_a_figure_of_a_section_is_drawn_and_no_text_of_it_does_anything(browser, page):
    unfolded(browser, page(hostile))
    figure = "document.querySelector('#section-hostile .plot')"
    browser.wait(f"{figure}.data")
    red = "getComputedStyle(document.documentElement).getPropertyValue('--least').trim()"
    assert browser.value(f"{figure}.data[0].line.color === {red}")
    assert count(browser, "#section-hostile .plot a, #section-hostile image, marquee") == 0
    assert browser.value("window.pwned") is None
    assert all(address.startswith(("file:", "data:")) for address in browser.requests())
    assert browser.complaints() == []
