"""Pieces of HTML: everything that is said is escaped, nothing is fetched."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Final

__all__ = ["details", "figure", "heading", "notes", "page", "paragraph", "section", "table"]

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
.scenes { display: grid; grid-template-columns: repeat(auto-fill, minmax(310px, 1fr)); gap: 1rem; }
figure { margin: 0; background: #fff; border: 1px solid #e4e7ec; border-radius: 8px;
  padding: .8rem; }
figure img { max-width: 100%; display: block; margin: 0 auto; }
figcaption { font-size: .88rem; color: #4b5563; margin-top: .4rem; }
figcaption b { color: #2b2f36; }
.scroll { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; background: #fff; font-size: .92rem; min-width: 50%; }
caption { text-align: left; color: #6b7280; font-size: .88rem; padding: .3rem 0; }
th, td { padding: .32rem .8rem; border-bottom: 1px solid #e4e7ec; text-align: right;
  font-variant-numeric: tabular-nums; }
th { font-weight: 600; color: #4b5563; background: #fbfbfc; }
th.text, td.text { text-align: left; }
td:not(.text), th { white-space: nowrap; }
pre { background: #fff; border: 1px solid #e4e7ec; padding: .8rem; overflow-x: auto;
  font-size: .82rem; }
summary { cursor: pointer; color: #4b5563; }
p.hint { color: #6b7280; font-size: .92rem; margin: .2rem 0 .8rem; }
"""


def page(title: str, body: Sequence[str]) -> str:
    """A whole page of pieces."""
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body><main>",
            *body,
            "</main></body></html>\n",
        ]
    )


def heading(text: str) -> str:
    """What the page is of."""
    return f"<h1>{escape(text)}</h1>"


def section(title: str, *pieces: str, hint: str = "") -> str:
    """A heading, a grey line that says what one sees, and pieces."""
    lead = paragraph(hint, style="hint") if hint else ""
    return "\n".join([f"<section><h2>{escape(title)}</h2>", lead, *pieces, "</section>"])


def paragraph(text: str, *, style: str = "") -> str:
    """A paragraph of plain text; nothing if there is none."""
    if not text:
        return ""
    return f'<p class="{style}">{escape(text)}</p>' if style else f"<p>{escape(text)}</p>"


def notes(texts: Sequence[str]) -> str:
    """Warnings, one a line; nothing if there are none."""
    if not texts:
        return ""
    return '<ul class="notes">' + "".join(f"<li>{escape(t)}</li>" for t in texts) + "</ul>"


def figure(picture: str, *, alt: str, title: str = "", text: str = "") -> str:
    """A picture that lies in the page (``data:``), and what is said of it."""
    heading = f"<b>{escape(title)}</b><br>" if title else ""
    return (
        f'<figure><img src="{escape(picture)}" alt="{escape(alt)}">'
        f"<figcaption>{heading}{escape(text)}</figcaption></figure>"
    )


def table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], *, words: int = 1, caption: str = ""
) -> str:
    """A table of texts, the first ``words`` columns of which are words and not numbers."""

    def row(cells: Sequence[str], tag: str) -> str:
        styles = [' class="text"' if k < words else "" for k in range(len(cells))]
        pairs = zip(cells, styles, strict=True)
        styled = (f"<{tag}{style}>{escape(cell)}</{tag}>" for cell, style in pairs)
        return f"<tr>{''.join(styled)}</tr>"

    said = f"<caption>{escape(caption)}</caption>" if caption else ""
    body = "".join(row(cells, "td") for cells in rows)
    return (
        f'<div class="scroll"><table>{said}<thead>{row(columns, "th")}</thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def details(summary: str, text: str) -> str:
    """Something long that is folded away."""
    return f"<details><summary>{escape(summary)}</summary><pre>{escape(text)}</pre></details>"
