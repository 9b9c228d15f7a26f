"""The page itself: styles, scripts and data put into one document that may load nothing."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import os
import re
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.values import value

_IMPORT = re.compile(r'^import \{[^}]*\} from "\./\w+\.js";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|const|class) )", re.MULTILINE)
_HEIGHT = 640
"""Pixels that a page is high in a notebook."""


@value
class Viewer:
    """A page to look at: shown where a notebook displays it, and saved as a file. See `LightField.viewer`.

    Parameters
    ----------
    document : str
        The HTML document, which holds all that it needs.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> page = pl.Exposure(np.ones((2, 3, 1))).viewer()
    >>> page.document.startswith("<!doctype html>"), page
    (True, Viewer(0.1 MB))
    """

    document: str

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the page to a file, which appears whole or not at all; any browser opens it from the disk.

        Raises
        ------
        FileError
            Where it cannot be written.
        """
        write_file(path, self.document.encode())

    def _repr_html_(self) -> str:
        # A frame of its own keeps styles and scripts of the notebook apart; without allow-same-origin it can reach
        # nothing there.
        return (
            f'<iframe title="plenoptic viewer" sandbox="allow-scripts" style="width:100%;height:{_HEIGHT}px;border:0" '
            f'srcdoc="{html.escape(self.document)}"></iframe>'
        )

    def __repr__(self) -> str:
        return f"Viewer({len(self.document) / 1e6:.1f} MB)"


def page(  # noqa: D417
    title: str, *, facts: Mapping[str, Any], data: bytes, still: bytes, modules: Sequence[str], shaders: Sequence[str]
) -> Viewer:
    """A document with `facts` for its scripts, bytes that they point into, and a picture (WebP) for until they run.

    Modules are joined in their order, in which names that they share must differ: imported ones stand before them.
    """
    script = "".join(_EXPORT.sub("", _IMPORT.sub("", _text(f"{name}.js"))) for name in modules)
    style = _text("style.css")
    filled = {
        "title": html.escape(title),
        # Nothing is loaded: scripts and styles are those whose hashes stand here, pictures are made of the data.
        "policy": (
            f"default-src 'none'; script-src {_hash(script)}; style-src {_hash(style)}; img-src data: blob:; "
            "base-uri 'none'; form-action 'none'"
        ),
        "style": style,
        "script": script,
        "shaders": "".join(
            f'<script type="x-shader/x-fragment" id="{name}">{_text(f"{name}.glsl")}</script>\n' for name in shaders
        ),
        # No "<" in it can end the element that holds it.
        "facts": json.dumps(facts, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        "still": base64.b64encode(still).decode(),
        "data": base64.b64encode(data).decode(),
    }
    # One pass, so that nothing in a title or script is taken for a place to fill.
    return Viewer(re.sub(r"\{\{(\w+)\}\}", lambda found: filled[found[1]], _text("page.html")))


def _text(name: str) -> str:
    return resources.files("plenoptic.viewer").joinpath("web", name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
