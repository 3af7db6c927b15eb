"""Building blocks of the report: escaped HTML, legends, tables and plots."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from typing import Any, Final

__all__ = [
    "cross",
    "details",
    "dots",
    "folded",
    "heading",
    "legend",
    "line",
    "notes",
    "numbers",
    "page",
    "paragraph",
    "patch",
    "plot",
    "section",
    "shades",
    "table",
]

_STYLE: Final = """
:root { color-scheme: light; }
body { font: 16px/1.55 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: #2b2f36;
  background: #f6f7f9; margin: 0; }
main { max-width: 1060px; margin: 0 auto; padding: 2rem 1.5rem 4rem; }
h1 { font-size: 1.15rem; font-weight: 600; color: #6b7280; margin: 0 0 .4rem; }
h2 { font-size: 1.15rem; margin: 2.6rem 0 .6rem; }
.answer { font-size: 1.5rem; line-height: 1.35; margin: 0 0 1rem; font-weight: 600; }
.verdict { border-left: 4px solid #59a14f; padding: .3rem .9rem; background: #fff; margin: 1rem 0; }
.verdict.doubt { border-color: #e15759; }
ul.notes { list-style: none; padding: 0; margin: 0 0 1rem; }
ul.notes li { background: #fff6e5; border-left: 4px solid #f28e2b; margin: .4rem 0;
  padding: .35rem .9rem; }
.card { background: #fff; border: 1px solid #e4e7ec; border-radius: 8px; padding: .8rem;
  margin: 0 0 1rem; min-width: 0; }
.card h3 { font-size: .95rem; margin: 0 0 .4rem; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(420px, 100%), 1fr));
  gap: 1rem; align-items: start; }
.map { max-width: 680px; }
.plot { width: 100%; }
.choice, .player { display: flex; flex-wrap: wrap; gap: .5rem; align-items: center;
  margin: 0 0 .8rem; }
button { font: inherit; color: inherit; background: #fff; border: 1px solid #c3c9d2;
  border-radius: 6px; padding: .35rem .8rem; cursor: pointer; }
button[aria-pressed="true"] { background: #2b2f36; color: #fff; border-color: #2b2f36; }
button:focus-visible, input:focus-visible { outline: 3px solid #4e79a7; outline-offset: 2px; }
.player { position: sticky; bottom: 0; background: #f6f7f9; padding: .5rem 0; z-index: 2; }
.player input { flex: 1 1 12rem; min-width: 0; }
.player output { font-variant-numeric: tabular-nums; min-width: 9.5rem; }
ul.legend { list-style: none; display: flex; flex-wrap: wrap; gap: .2rem 1rem; padding: 0;
  margin: .5rem 0 0; font-size: .85rem; color: #4b5563; }
.swatch { display: inline-block; width: 1.4em; height: .8em; margin-right: .4em;
  vertical-align: middle; box-sizing: border-box; }
.scroll { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; background: #fff; font-size: .92rem; min-width: 50%; }
th, td { padding: .32rem .8rem; border-bottom: 1px solid #e4e7ec; text-align: right;
  font-variant-numeric: tabular-nums; }
th { font-weight: 600; color: #4b5563; background: #fbfbfc; }
th.text, td.text { text-align: left; }
td:not(.text), th { white-space: nowrap; }
pre { background: #fff; border: 1px solid #e4e7ec; padding: .8rem; overflow-x: auto;
  font-size: .82rem; }
summary { cursor: pointer; color: #4b5563; margin: .6rem 0; }
@media (max-width: 700px) {
  main { padding: 1rem .8rem 3rem; }
  .answer { font-size: 1.2rem; }
  .card { padding: .5rem; }
}
@media print { .choice, .player { display: none; } }
p.hint { color: #6b7280; font-size: .92rem; margin: .2rem 0 .8rem; }
"""


_POLICY: Final = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
    "img-src data: blob:; form-action 'none'; base-uri 'none'"
)
"""Content security policy of the page: no network access."""


def page(title: str, body: Sequence[str]) -> str:
    """A complete page with its scripts.

    Parameters
    ----------
    title : str
    body : sequence of str
        HTML.

    Returns
    -------
    str
        HTML.
    """
    said = "<noscript><p>The plots need JavaScript; all else is below.</p></noscript>"
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
            f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body><main>",
            said,
            *body,
            "</main>",
            *_scripts(),
            "</body></html>\n",
        ]
    )


@cache
def _scripts() -> tuple[str, str]:
    """The script of plotly, packed, and that of the report, which unpacks it."""
    from plotly.offline import get_plotlyjs

    packed = base64.b64encode(gzip.compress(get_plotlyjs().encode(), mtime=0)).decode()
    own = files("imapper_prob.results").joinpath("report.js").read_text(encoding="utf-8")
    return (
        f'<script type="application/gzip" id="plotly">{packed}</script>',
        f"<script>{own}</script>",
    )


def numbers(name: str, value: Mapping[str, Any] | str) -> str:
    """Embed data in the page for its scripts.

    Parameters
    ----------
    name : str
        Identifier by which scripts find the data.
    value : mapping or str
        Content for JSON, or JSON text.

    Returns
    -------
    str
        HTML.
    """
    text = value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))
    # Names from the input might contain a closing tag.
    text = text.replace("<", "\\u003c")
    return f'<script type="application/json" id="{name}">{text}</script>'


def plot(
    name: str, figure: Any, *, alt: str, proportion: float, title: str = "", lowest: int = 240
) -> str:
    """A plot with its data.

    Parameters
    ----------
    name : str
        Identifier by which scripts find the plot.
    figure : plotly.graph_objects.Figure
    alt : str
        Alternative text for readers who cannot see it.
    proportion : float
        Width divided by height.
    title : str
        Heading above it.
    lowest : int
        Least height in pixels.

    Returns
    -------
    str
        HTML.
    """
    above = f"<h3>{escape(title)}</h3>" if title else ""
    data = numbers(f"{name}-data", str(figure.to_json()))
    return (
        f'{above}<div class="plot" id="{name}" role="img" aria-label="{escape(alt)}" '
        f'style="aspect-ratio: {proportion:.3f}; min-height: {lowest}px"></div>{data}'
    )


# ------------------------------------------------------------------------------------------------
# Legends. An entry consists of a swatch and a text.


def legend(entries: Sequence[tuple[str, str]]) -> str:
    """A legend of colours and lines.

    Parameters
    ----------
    entries : sequence of (str, str)
        Pairs of swatch and text; duplicates are shown once.

    Returns
    -------
    str
        HTML.
    """
    shown = "".join(
        f'<li><span class="swatch" style="{swatch}"></span>{escape(text)}</li>'
        for swatch, text in dict.fromkeys(entries)
    )
    return f'<ul class="legend">{shown}</ul>'


def patch(colour: str) -> str:
    """The swatch of an area.

    Parameters
    ----------
    colour : str

    Returns
    -------
    str
        CSS.
    """
    return f"background: {colour}55; border: 1.5px solid {colour}"


def line(colour: str, *, dash: str = "solid", width: float = 2) -> str:
    """The swatch of a line.

    Parameters
    ----------
    colour : str
    dash : str
        As in plotly.
    width : float
        Pixels.

    Returns
    -------
    str
        CSS.
    """
    style = {"solid": "solid", "dash": "dashed", "dot": "dotted"}.get(dash, "dashed")
    return f"height: 0; border-top: {width}px {style} {colour}"


def dots(colour: str) -> str:
    """The swatch of points.

    Parameters
    ----------
    colour : str

    Returns
    -------
    str
        CSS.
    """
    return f"width: .7em; height: .7em; border-radius: 50%; background: {colour}"


def shades(first: str, last: str) -> str:
    """The swatch of a scale of colours.

    Parameters
    ----------
    first, last : str

    Returns
    -------
    str
        CSS.
    """
    scale = f"linear-gradient(90deg, {first}, {last})"
    return f"width: 3em; border: 1px solid #c3c9d2; background: {scale}"


def cross(colour: str) -> str:
    """The swatch of crosses.

    Parameters
    ----------
    colour : str

    Returns
    -------
    str
        CSS.
    """
    stroke = f"transparent 42%, {colour} 42%, {colour} 58%, transparent 58%"
    return (
        "width: .8em; background: "
        f"linear-gradient(45deg, {stroke}), linear-gradient(-45deg, {stroke})"
    )


def heading(text: str) -> str:
    """The heading of the page.

    Parameters
    ----------
    text : str

    Returns
    -------
    str
        HTML.
    """
    return f"<h1>{escape(text)}</h1>"


def section(title: str, *pieces: str, hint: str = "") -> str:
    """A section with heading, optional grey hint, and contents.

    Parameters
    ----------
    title : str
    *pieces : str
        HTML.
    hint : str
        A sentence that explains the section.

    Returns
    -------
    str
        HTML.
    """
    lead = paragraph(hint, style="hint") if hint else ""
    return "\n".join([f"<section><h2>{escape(title)}</h2>", lead, *pieces, "</section>"])


def paragraph(text: str, *, style: str = "") -> str:
    """A paragraph of plain text; empty for an empty text.

    Parameters
    ----------
    text : str
    style : str
        CSS class of the paragraph.

    Returns
    -------
    str
        HTML.
    """
    if not text:
        return ""
    return f'<p class="{style}">{escape(text)}</p>' if style else f"<p>{escape(text)}</p>"


def notes(texts: Sequence[str]) -> str:
    """A list of warnings; empty if there are none.

    Parameters
    ----------
    texts : sequence of str

    Returns
    -------
    str
        HTML.
    """
    if not texts:
        return ""
    return '<ul class="notes">' + "".join(f"<li>{escape(t)}</li>" for t in texts) + "</ul>"


def table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], *, words: int = 1, caption: str = ""
) -> str:
    """A table of texts.

    Parameters
    ----------
    columns : sequence of str
    rows : sequence of sequence of str
    words : int
        Number of leading columns with words instead of numbers.
    caption : str

    Returns
    -------
    str
        HTML.
    """

    def row(cells: Sequence[str], tag: str) -> str:
        styles = [' class="text"' if k < words else "" for k in range(len(cells))]
        pairs = zip(cells, styles, strict=True)
        styled = (f"<{tag}{style}>{escape(cell)}</{tag}>" for cell, style in pairs)
        return f"<tr>{''.join(styled)}</tr>"

    # Not a caption element, which on narrow screens would be as wide as the table and cut off.
    said = paragraph(caption, style="hint")
    body = "".join(row(cells, "td") for cells in rows)
    return (
        f'{said}<div class="scroll"><table><thead>{row(columns, "th")}</thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def details(summary: str, text: str) -> str:
    """A long text that is collapsed by default.

    Parameters
    ----------
    summary : str
    text : str

    Returns
    -------
    str
        HTML.
    """
    return f"<details><summary>{escape(summary)}</summary><pre>{escape(text)}</pre></details>"


def folded(summary: str, *pieces: str) -> str:
    """Contents that are collapsed by default.

    Parameters
    ----------
    summary : str
    *pieces : str
        HTML.

    Returns
    -------
    str
        HTML.
    """
    return f"<details><summary>{escape(summary)}</summary>{''.join(pieces)}</details>"
