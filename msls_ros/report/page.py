"""The report as one HTML file: nothing in it asks for anything outside of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from urllib.parse import quote

from msls_ros.report.page_script import SCRIPT
from msls_ros.report.page_style import STYLE

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""The browser refuses whatever is not in the file."""


@dataclass(frozen=True)
class Section:
    """A part of the page."""

    anchor: str
    title: str
    body: str
    """HTML."""


@dataclass(frozen=True)
class Head:
    """What stands above the sections."""

    name: str
    about: str
    verdict: Sequence[str]
    notes: Sequence[str]
    """Warnings, and what is missing."""


def render(head: Head, sections: Sequence[Section]) -> str:
    """Return the page.

    Parameters
    ----------
    head
        What stands above.
    sections
        In their order.
    """
    contents = "".join(f'<li><a href="#{s.anchor}">{escape(s.title)}</a></li>' for s in sections)
    notes = ""
    if head.notes:
        listed = "".join(f"<li>{escape(note)}</li>" for note in head.notes)
        notes = f'<div class="note" role="note"><strong>Please note</strong><ul>{listed}</ul></div>'
    body = "".join(f'<section id="{s.anchor}"><h2>{escape(s.title)}</h2>{s.body}</section>\n' for s in sections)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Flight report: {escape(head.name)}</title>
<link rel="icon" href="data:,">
<style>{STYLE}</style>
</head>
<body>
<header>
<h1><small>FLIGHT REPORT</small>{escape(head.name)}</h1>
<p class="about">{escape(head.about)}</p>
<div class="verdict" id="verdict">{paragraphs(head.verdict)}</div>
</header>
<nav aria-label="Contents"><ul><li><a href="#verdict">Verdict</a></li>{contents}</ul></nav>
<main>
{body}{notes}</main>
<footer><span class="live">All charts share one time. A click chooses a chart; then the wheel or + and − zoom, dragging
moves, arrows move the cursor (faster with Shift), 0 shows all; two fingers zoom.</span> Made by msls_ros; this file is
complete in itself.</footer>
<script>{SCRIPT}</script>
</body>
</html>
"""


def table(columns: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """Return a table.

    Parameters
    ----------
    columns
        Heads.
    rows
        Texts.
    numbers
        Columns to align to the right.
    """

    def cell(kind: str, i: int, text: str) -> str:
        return f"<{kind}{' class=n' if i in numbers else ''}>{escape(text)}</{kind}>"

    head = "".join(cell("th", i, text) for i, text in enumerate(columns))
    body = "".join("<tr>" + "".join(cell("td", i, text) for i, text in enumerate(row)) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def paragraphs(sentences: Iterable[str]) -> str:
    """Return sentences as paragraphs."""
    return "".join(f"<p>{escape(sentence)}</p>" for sentence in sentences)


def download(name: str, kind: str, content: str, label: str) -> str:
    """Return a link that saves a text out of the page."""
    return f'<a download="{escape(name)}" href="data:{kind};charset=utf-8,{quote(content)}">{escape(label)}</a>'


def folded(summary: str, body: str) -> str:
    """Return a part that opens on a click."""
    return f"<details><summary>{escape(summary)}</summary>{body}</details>"
