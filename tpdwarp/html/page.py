"""Pages that carry everything with them: styles, scripts and pictures, and nothing from a network."""

from __future__ import annotations

import html
import json
import os
from collections.abc import Iterable
from importlib import resources
from typing import Any

from tpdwarp.io.files import complete_or_absent
from tpdwarp.version import VERSION

# The browser itself then refuses whatever would leave the page.
_POLICY = "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"


def write_page(
    path: str | os.PathLike[str], title: str, parts: Iterable[str], scripts: Iterable[tuple[str, str]] = ()
) -> None:
    """Writes an HTML page part by part, so that it need not fit in memory; it appears only when complete.

    Args:
        path: The file.
        title: Of the page, as plain text.
        parts: The body, as HTML.
        scripts: Package and file name of each script, run in this order after the body.

    Raises:
        FrameError: The file cannot be written.
    """
    with complete_or_absent(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
        file.write(
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f'<meta name="generator" content="tpdwarp {VERSION}">\n'
            f"<title>{escape(title)}</title>\n<style>\n{_resource('tpdwarp.html', 'page.css')}</style>\n"
            '</head>\n<body>\n<a class="skip" href="#main">Skip to content</a>\n'
        )
        for part in parts:
            file.write(part)
            file.write("\n")
        for package, name in scripts:
            file.write(f"<script>\n{_resource(package, name)}</script>\n")
        file.write("</body>\n</html>\n")


def escape(text: object) -> str:
    """Text for HTML, within attributes too."""
    return html.escape(str(text))


def data_block(name: str, value: Any) -> str:
    """JSON that scripts find under the id ``name``; browsers do not parse it until a script asks."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    return f'<script type="application/json" id="{escape(name)}">{text}</script>'


def _resource(package: str, name: str) -> str:
    return resources.files(package).joinpath(name).read_text(encoding="utf-8")
