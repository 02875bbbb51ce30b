"""The page's style: light and dark, phone to print; eight lines that differ in colour and in dashes."""

from __future__ import annotations

_DASHES = ("", "7 3", "2 3", "9 3 2 3", "12 4", "4 2", "1 4", "14 3 2 3 2 3")
_LIGHT = ("#0072b2", "#c8500a", "#007a5a", "#a3487f", "#8a6000", "#2f7fb8", "#5d3fa8", "#444b54")
_DARK = ("#5cb8ee", "#ff9d5c", "#3fd0a4", "#eb9fcd", "#edc04d", "#9ad1f5", "#b9a4f5", "#c6ccd4")
"""Okabe and Ito's colours, darkened or lightened for contrast."""


def _palette(colours: tuple[str, ...]) -> str:
    return " ".join(f"--s{i}: {colour};" for i, colour in enumerate(colours))


_LINES = "\n".join(
    f".line.s{i} {{ stroke: var(--s{i}); {f'stroke-dasharray: {dash};' if dash else ''} }} "
    f".band.s{i} {{ fill: var(--s{i}); }}"
    for i, dash in enumerate(_DASHES)
)
STYLE = f"""
:root {{ color-scheme: light dark; --ink: #1d2733; --muted: #55616e; --rule: #dfe4ea; --paper: #fff; --ground: #f5f7f9;
  --blue: #005f99; --good: #d9edf8; --once: #f1f4f7; --note: #fff6e0; --edge: #e0c27a; --alarm: #b0357f;
  {_palette(_LIGHT)} }}
@media screen and (prefers-color-scheme: dark) {{ :root {{ --ink: #e4e9ee; --muted: #a2adb9; --rule: #37414c;
  --paper: #1a2028; --ground: #12161b; --blue: #6cbff0; --good: #17384c; --once: #242c36; --note: #3a3116;
  --edge: #86702d; --alarm: #f08ac4; {_palette(_DARK)} }} }}
* {{ box-sizing: border-box; }}
html {{ scroll-padding-top: 3.4rem; }}
body {{ margin: 0; background: var(--ground); color: var(--ink); overflow-wrap: break-word;
  font: 16px/1.5 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }}
header, main, footer {{ max-width: 1240px; margin: 0 auto; padding: 0 20px; }}
header {{ padding-top: 22px; }}
h1 {{ font-size: 1.45rem; line-height: 1.25; margin: 0 0 .2rem; overflow-wrap: anywhere; }}
h1 small {{ display: block; font-size: .85rem; font-weight: 600; color: var(--blue); letter-spacing: .05em; }}
.about {{ color: var(--muted); margin: 0 0 .8rem; font-size: .92rem; }}
.verdict {{ background: var(--paper); border: 1px solid var(--rule); border-left: 6px solid var(--blue);
  border-radius: 6px; padding: .7rem 1.2rem; font-size: 1.15rem; margin: 0 0 .8rem; }}
.verdict p {{ margin: .3rem 0; }} .verdict p + p + p {{ font-size: 1rem; color: var(--muted); }}
nav {{ position: sticky; top: 0; z-index: 3; background: var(--ground); border-bottom: 1px solid var(--rule); }}
nav ul {{ max-width: 1240px; margin: 0 auto; padding: .5rem 20px; display: flex; gap: 1.1rem; list-style: none;
  overflow-x: auto; white-space: nowrap; font-size: .92rem; }}
a {{ color: var(--blue); text-decoration: none; }} a:hover {{ text-decoration: underline; }}
.note {{ background: var(--note); border: 1px solid var(--edge); border-radius: 6px; padding: .6rem 1rem;
  margin: 0 0 .8rem; }}
.note ul {{ margin: .2rem 0; padding-left: 1.2rem; overflow-wrap: anywhere; }}
section {{ background: var(--paper); border: 1px solid var(--rule); border-radius: 6px; padding: .9rem 20px 1rem;
  margin: 1rem 0; }}
h2 {{ font-size: 1.22rem; margin: .1rem 0 .5rem; }} h3 {{ font-size: 1.02rem; margin: 1rem 0 .3rem; }}
.scroll {{ overflow-x: auto; }}
table {{ border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; margin: .3rem 0 .8rem; }}
th, td {{ text-align: left; padding: .25rem .8rem .25rem 0; border-bottom: 1px solid var(--rule);
  vertical-align: top; }}
th {{ font-weight: 600; color: var(--muted); white-space: nowrap; }} td.n, th.n {{ text-align: right; }}
table.map td {{ text-align: center; padding: .2rem .45rem; border: 1px solid var(--rule); min-width: 4.6rem; }}
table.map th {{ padding: .2rem .5rem; text-align: center; }} table.map td, td.n {{ white-space: nowrap; }}
table.map small {{ display: block; color: var(--muted); font-size: .88em; }}
td.now {{ background: var(--good); font-weight: 650; }} td.now small {{ font-weight: 400; }}
td.once {{ background: var(--once); }} td.never, td.known {{ color: var(--muted); }}
td.known {{ font-style: italic; }}
figure {{ margin: .6rem 0 1.3rem; }} figure:focus-visible {{ outline: 2px solid var(--blue); outline-offset: 4px; }}
figcaption {{ color: var(--muted); font-size: .9rem; max-width: 70rem; margin-bottom: .3rem; }}
figcaption strong {{ color: var(--ink); }} figcaption span {{ white-space: nowrap; margin-left: .6rem; }}
.panels {{ display: grid; gap: .5rem 1.6rem; }}
.panels > * {{ min-width: 0; }}
@media (min-width: 900px) {{ .panels.c2 {{ grid-template-columns: 1fr 1fr; }} }}
.head {{ display: flex; flex-wrap: wrap; gap: 0 1rem; font-size: .88rem; }}
.head em {{ font-style: normal; font-weight: 600; }}
.head b {{ font-variant-numeric: tabular-nums; color: var(--blue); display: inline-block; min-width: 3.2em; }}
html:not(.live) .head b, html:not(.live) span.live {{ display: none; }}
svg.key {{ width: 26px; height: 6px; vertical-align: middle; margin-right: .3rem; overflow: visible; }}
.frame {{ display: flex; }}
.ys {{ position: relative; width: 3.4rem; flex: none; font-size: .8rem; color: var(--muted); }}
.ys span {{ position: absolute; right: .4rem; transform: translateY(-50%); }}
.plot {{ position: relative; flex: 1; min-width: 0; height: 150px; touch-action: pan-y; cursor: crosshair;
  border-left: 1px solid var(--muted); border-bottom: 1px solid var(--muted); overflow: hidden; }}
.plot svg {{ position: absolute; inset: 0; width: 100%; height: 100%; }}
.xs {{ position: relative; height: 1.3rem; margin-left: 3.4rem; font-size: .8rem; color: var(--muted); }}
.xs span {{ position: absolute; transform: translateX(-50%); }} .xs .unit {{ left: -1.6rem; transform: none; }}
path {{ vector-effect: non-scaling-stroke; }}
.rule {{ stroke: var(--rule); stroke-width: 1; fill: none; }}
.line {{ fill: none; stroke-width: 1.5; }} .band {{ opacity: .2; stroke: none; }} .sure {{ fill: var(--s0); }}
.line.s8 {{ stroke: var(--ink); stroke-width: 1.2; stroke-dasharray: 5 4; }}
.line.s9 {{ stroke: var(--ink); stroke-width: 1.4; stroke-dasharray: 1 3; }}
path.alarm {{ stroke: var(--alarm); stroke-width: 1.6; fill: none; }}
path.change {{ stroke: var(--ink); stroke-width: 1.4; stroke-dasharray: 2 3; fill: none; }}
i.key {{ display: inline-block; height: .9em; margin-right: .3rem; vertical-align: -.1em; width: 0; }}
i.key.alarm {{ border-left: 2px solid var(--alarm); }} i.key.change {{ border-left: 2px dotted var(--ink); }}
.cursor {{ display: none; position: absolute; top: 0; bottom: 0; width: 0; border-left: 1px solid var(--ink);
  pointer-events: none; }}
.cursor::after {{ content: attr(data-t); position: absolute; top: 0; left: 3px; font: 600 .78rem/1.2 system-ui;
  white-space: nowrap; background: var(--paper); padding: 0 3px; }}
{_LINES}
code {{ font: .92em ui-monospace, "SF Mono", Consolas, "DejaVu Sans Mono", monospace; overflow-wrap: anywhere; }}
summary {{ cursor: pointer; color: var(--blue); margin: .3rem 0; }}
.files a {{ display: inline-block; border: 1px solid var(--rule); border-radius: 5px; padding: .3rem .8rem;
  margin: .2rem .6rem .2rem 0; }}
footer {{ color: var(--muted); font-size: .88rem; padding-bottom: 2.5rem; }}
@media (max-width: 500px) {{ header, main, footer {{ padding-left: 10px; padding-right: 10px; }}
  section {{ padding-left: 12px; padding-right: 12px; }} nav ul {{ padding-left: 10px; }} .plot {{ height: 130px; }}
  table:not(.map) td:last-child:not(.n) {{ min-width: 15rem; }}
  table:not(.map) th {{ white-space: normal; }}
  .ys {{ width: 2.9rem; }} .xs {{ margin-left: 2.9rem; }} .verdict {{ font-size: 1.05rem; padding: .6rem .8rem; }} }}
@media print {{ :root {{ color-scheme: light; }} nav, .cursor, span.live {{ display: none !important; }}
  html {{ font-size: 12px; }} body {{ background: #fff; font-size: 1rem; }} .plot {{ height: 110px; }}
  section {{ border: 0; padding: 0; }} .panel, tr {{ break-inside: avoid; }} .scroll {{ overflow: visible; }}
  h2, h3, figcaption {{ break-after: avoid; break-inside: avoid; }} .panels.c2 {{ grid-template-columns: 1fr 1fr; }}
  th {{ white-space: normal; }} table.map td {{ min-width: 0; padding: .1rem .2rem; }} }}
"""
