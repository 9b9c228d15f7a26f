"""Display of results in notebooks: pictures and tables as HTML, drawn apart from pyplot and its global state."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic.plots.canvas import PANEL_GAP

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOTS = 160
"""Per inch; shown at half of that, pictures are sharp on fine screens too."""
_MOST_BYTES = 138_000
"""Of a picture: base64 makes 184 kB of it, which leaves room for tables below 200 kB."""
_SMALLER = ((1.0, 90), (1.0, 80), (0.75, 80), (0.5, 75), (0.35, 60))
"""Sizes and qualities of JPEG that are tried where a PNG is too large: noise does not compress."""


def picture_html(
    draw: Callable[[Figure], Any], *, size: tuple[float, float], alt: str, text: str, has_caption: bool = True
) -> str:
    """HTML of the figure that `draw` fills, of some inches, above a text; without matplotlib the text alone.

    `size` is width and height; `alt` describes the figure for those who cannot see it. Without a caption, the text
    stands only where there is no figure.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
        from matplotlib.layout_engine import ConstrainedLayoutEngine
    except ImportError:
        return text_html(text)
    figure = Figure(figsize=size, dpi=DOTS, layout=ConstrainedLayoutEngine(h_pad=0.08, w_pad=0.06, wspace=PANEL_GAP))
    canvas = FigureCanvasAgg(figure)
    draw(figure)
    canvas.draw()
    kind, picture = _small_picture(canvas.buffer_rgba())
    lines = text_html(text) if "\n" in text else html.escape(text)
    caption = f"<figcaption>{lines}</figcaption>" if text and has_caption else ""
    return (
        f'<figure style="margin:0"><img width="{round(size[0] * DOTS / 2)}" '
        f'style="max-width:100%;height:auto;background:white" alt="{html.escape(alt)}" '
        f'src="data:image/{kind};base64,{base64.b64encode(picture).decode()}"/>{caption}</figure>'
    )


def _small_picture(rgba: Any) -> tuple[str, bytes]:
    """A picture on white: as PNG, or where that is large as JPEG, and smaller."""
    from PIL import Image

    drawn = Image.fromarray(np.asarray(rgba))
    full = Image.new("RGB", drawn.size, "white")
    full.paste(drawn, mask=drawn.getchannel("A"))
    kind, data = "png", _encode(full, format="PNG", compress_level=6)
    for scale, quality in _SMALLER:
        if len(data) <= _MOST_BYTES:
            break
        size = max(1, round(scale * full.width)), max(1, round(scale * full.height))
        smaller = full if scale == 1.0 else full.resize(size, Image.Resampling.LANCZOS)
        kind, data = "jpeg", _encode(smaller, format="JPEG", quality=quality, subsampling=0)
    return kind, data


def _encode(image: Any, **options: Any) -> bytes:
    stream = io.BytesIO()
    image.save(stream, **options)
    return stream.getvalue()


def text_html(text: str) -> str:
    """A text as it would be printed."""
    return f"<pre>{html.escape(text)}</pre>"


def table_html(columns: Sequence[str], rows: Iterable[Sequence[str]], *, caption: str = "") -> str:
    """A table; the first cell of each row is its heading. No columns: a table without a head."""
    cell = 'style="text-align:left;vertical-align:top"'
    title = f'<caption style="text-align:left">{html.escape(caption)}</caption>' if caption else ""
    names = "".join(f'<th scope="col" {cell}>{html.escape(name)}</th>' for name in columns)
    head = f"<thead><tr>{names}</tr></thead>" if columns else ""
    body = "".join(
        f'<tr><th scope="row" {cell}>{html.escape(first)}</th>'
        + "".join(f"<td {cell}>{html.escape(text)}</td>" for text in cells)
        + "</tr>"
        for first, *cells in rows
    )
    return f"<table>{title}{head}<tbody>{body}</tbody></table>"


def heading_html(text: str) -> str:
    """Heading line."""
    return f"<p><strong>{html.escape(text)}</strong></p>"


def list_html(items: Iterable[str], *, title: str) -> str:
    """Sentences below a title; nothing where there are none."""
    lines = "".join(f"<li>{html.escape(item)}</li>" for item in items)
    return f"{heading_html(title)}<ul>{lines}</ul>" if lines else ""
