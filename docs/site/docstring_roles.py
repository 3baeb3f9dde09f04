"""Shows what docstrings write in reStructuredText as Markdown."""

import re

import griffe


class DocstringRoles(griffe.Extension):
    """Sets cross-references in code font, and ends the line before a block of code with one colon."""

    def on_instance(self, *, obj: griffe.Object, **_: object) -> None:
        """Rewrite the docstring of a module, class, function or attribute."""
        if obj.docstring:
            text = re.sub(r":\w+:`~?([^`]*)`", r"`\1`", obj.docstring.value)
            obj.docstring.value = re.sub(r"::$", ":", text, flags=re.MULTILINE)
