"""Pages of the site, as hooks of MkDocs: the repository's Markdown in its places, and what is made from code.

Links between pages are those of the repository; a link to another file copies that file into the site.
"""

import re
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import gallery
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from pygments.formatters.html import HtmlFormatter

import palpate
import palpate.testing
from palpate_report.answer.warnings import kinds

ROOT = Path(__file__).parents[2]
TERMS = Path(__file__).with_name("glossary.toml")
LINK = re.compile(r"(?<=\]\()(?!https?:|#|mailto:)([^)#\s]+)")
GUIDE = re.compile(r"^\| ([\w ]*) ?\| \[[^\]]+\]\(([^)]+\.md)\)", flags=re.MULTILINE)


def texts() -> tuple[str, ...]:
    """Paths of the repository's Markdown that the site shows."""
    folders = ("plugins", "plugins/*", "examples/*")
    patterns = ("README.md", "C*.md", "docs/*.md", *(f"{folder}/README.md" for folder in folders))
    patterns += ("plugins/reference.md",)
    return tuple(path.relative_to(ROOT).as_posix() for each in patterns for path in sorted(ROOT.glob(each)))


def guides() -> dict[str, list[Any]]:
    """Paths of the guides by the step of a reader, both in the README's order."""
    steps: dict[str, list[Any]] = {}
    for step, path in GUIDE.findall((ROOT / "README.md").read_text(encoding="utf-8")):
        steps.setdefault(step.strip() or list(steps)[-1], []).append(path)
    return steps


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """List the pages: guides step by step, with plugins and the generated reference in theirs."""
    steps = guides()
    listed = {path for paths in steps.values() for path in paths}
    steps["plugins"] += [
        path for path in texts() if path.startswith(("plugins/", "examples/")) and path not in listed
    ]
    steps["reference"] += [
        {"Python": "reference/palpate.md"},
        {"Contract tests": "reference/testing.md"},
        {"Glossary": "reference/glossary.md"},
        {"Warnings": "reference/warnings.md"},
        {"Tables of a run": "reference/tables.md"},
        {"Gallery": "gallery.md"},
    ]
    config.nav = [
        {"palpate": "README.md"},
        *({step.capitalize(): paths} for step, paths in steps.items()),
        {"Project": ["CHANGELOG.md", "CONTRIBUTING.md"]},
    ]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the repository's Markdown, the files that it links to, and the generated pages."""
    for path in texts():
        files.append(_copied(path, config))
    for path in sorted({target for page in texts() for target in _linked_files(page)}):
        files.append(_copied(path, config))
    made = {
        "reference/palpate.md": api(palpate),
        "reference/testing.md": api(palpate.testing),
        "reference/glossary.md": glossary(),
        "reference/warnings.md": warnings(),
        "reference/tables.md": tables(),
        "gallery.md": gallery.page(),
        "pygments.css": HtmlFormatter().get_style_defs(".highlight"),
    }
    for path, content in made.items():
        files.append(File.generated(config, path, content=content))
    for name, file in gallery.files():
        files.append(File.generated(config, name, abs_src_path=str(file)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Point links to folders at their README."""
    folder = (ROOT / page.file.src_uri).parent

    def read_me(match: re.Match[str]) -> str:
        target = match[1]
        return f"{target.rstrip('/')}/README.md" if (folder / target).is_dir() else target

    return LINK.sub(read_me, markdown)


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Let the keyboard scroll code, and give what is below a page its landmarks."""
    changes = {
        "<pre>": '<pre tabindex="0">',
        'role="contentinfo"': "",
        "<footer>": '<footer role="contentinfo">',
        'role="note" aria-label="Versions"': 'role="navigation" aria-label="Versions"',
    }
    for old, new in changes.items():
        output = output.replace(old, new)
    return output


def api(module: Any) -> str:  # noqa: ANN401 - a module with names in __all__
    """Describe the public names of a module, from their docstrings."""
    lines = [f"# {module.__name__}", "", f"::: {module.__name__}", "    options:", "      members: false"]
    lines += ["      show_root_heading: false", ""]
    for name in module.__all__:
        if not name.startswith("_"):
            lines += [f"::: {module.__name__}.{name}", ""]
    return "\n".join(lines)


def glossary() -> str:
    """Write the terms of the method."""
    terms = tomllib.loads(TERMS.read_text(encoding="utf-8"))
    return "# Glossary\n\n" + "\n".join(_term(name, **entry) for name, entry in terms.items())


def warnings() -> str:
    """Write the warnings of a report by code."""
    head = "# Warnings of a report\n\nEach warning of a page and of a terminal has a code."
    parts = (f"## {code}\n\n{of['when']} {of['why']}\n\n{of['remedy']}" for code, of in kinds().items())
    return "\n\n".join([head, *parts])


def tables() -> str:
    """Write the tables that stages make, with their columns."""
    parts = ["# Tables of a run\n\n`NAME.parquet` in the run directory; the heading of a section is a stage."]
    for stage, kind in sorted(palpate.Plugins.load().stages.items()):
        parts += [f"## {stage}"] if kind.tables else []
        for name, table in kind.tables.items():
            rows = [f"| `{column}` | {of} |" for column, of in table.columns.items()]
            head = ["| column | content |", "|---|---|"] if rows else []
            more = [table.more] if table.more else []
            parts += [f"### {stage}: {name}\n\n{table.text}", "\n".join([*head, *rows]), *more]
    return "\n\n".join(filter(None, parts))


def _term(
    name: str, text: str, aliases: Sequence[str] = (), avoid: Sequence[str] = (), see: Sequence[str] = ()
) -> str:
    also = f"\n\nAlso: {', '.join(aliases)}." if aliases else ""
    also += f" Not: {', '.join(avoid)}." if avoid else ""
    more = f"\n\nSee {', '.join(f'`{each}`' for each in see)}." if see else ""
    return f"## {name}\n\n{text}{also}{more}\n"


def _linked_files(page: str) -> Iterator[str]:
    """Files other than Markdown that a page links to."""
    folder = (ROOT / page).parent
    for target in LINK.findall((ROOT / page).read_text(encoding="utf-8")):
        path = (folder / target).resolve()
        if path.is_file() and path.suffix != ".md":
            yield path.relative_to(ROOT).as_posix()


def _copied(path: str, config: MkDocsConfig) -> File:
    return File(path, str(ROOT), config.site_dir, use_directory_urls=False)
