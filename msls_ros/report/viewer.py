"""The page's style and its few lines of script: a click enlarges a figure, the wheel zooms, dragging moves."""

from __future__ import annotations

STYLE = """
:root { --ink: #1d2733; --muted: #5d6976; --rule: #dfe4ea; --paper: #fff; --ground: #f5f7f9; --blue: #0072b2; }
* { box-sizing: border-box; }
html { scroll-behavior: smooth; scroll-padding-top: 3.6rem; }
body { margin: 0; background: var(--ground); color: var(--ink);
  font: 16px/1.55 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
header, main, footer { max-width: 1200px; margin: 0 auto; padding: 0 24px; }
header { padding-top: 28px; }
h1 { font-size: 1.75rem; line-height: 1.25; margin: 0 0 .2rem; }
h1 small { display: block; font-size: .95rem; font-weight: 600; color: var(--blue); letter-spacing: .04em; }
.about { color: var(--muted); margin: 0 0 1rem; }
nav { position: sticky; top: 0; z-index: 2; background: rgba(245, 247, 249, .96);
  border-bottom: 1px solid var(--rule); }
nav ul { max-width: 1200px; margin: 0 auto; padding: .55rem 24px; display: flex; flex-wrap: wrap; gap: .1rem 1.15rem;
  list-style: none; font-size: .92rem; }
a { color: var(--blue); text-decoration: none; } a:hover { text-decoration: underline; }
.summary { background: var(--paper); border: 1px solid var(--rule); border-left: 5px solid var(--blue);
  border-radius: 6px; padding: .9rem 1.2rem; font-size: 1.06rem; margin: 0 0 1rem; }
.summary p { margin: .25rem 0; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(165px, 1fr)); gap: 12px; margin: 0 0 1.2rem; }
.tile { background: var(--paper); border: 1px solid var(--rule); border-radius: 6px; padding: .6rem .9rem; }
.tile b { display: block; font-size: 1.35rem; line-height: 1.3; font-variant-numeric: tabular-nums; }
.tile span { color: var(--muted); font-size: .88rem; }
.note { background: #fff6e0; border: 1px solid #ecd08a; border-radius: 6px; padding: .7rem 1.1rem; margin: 0 0 1rem; }
.note strong { display: block; } .note ul { margin: .2rem 0; padding-left: 1.2rem; overflow-wrap: anywhere; }
section { background: var(--paper); border: 1px solid var(--rule); border-radius: 6px; padding: 1rem 24px 1.2rem;
  margin: 1.1rem 0; }
h2 { font-size: 1.25rem; margin: .1rem 0 .6rem; } h3 { font-size: 1.02rem; margin: 1rem 0 .3rem; }
figure { margin: .4rem 0 1.4rem; } figure:last-child { margin-bottom: .2rem; }
figure button { display: block; width: 100%; padding: 0; border: 0; background: none; cursor: zoom-in; }
figure button:focus-visible { outline: 2px solid var(--blue); }
figure img { display: block; width: 100%; height: auto; }
figcaption { color: var(--muted); font-size: .92rem; max-width: 62rem; margin-top: .3rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: .93rem; font-variant-numeric: tabular-nums; margin: .3rem 0 .8rem; }
th, td { text-align: left; padding: .28rem .9rem .28rem 0; border-bottom: 1px solid var(--rule); vertical-align: top; }
th { font-weight: 600; color: var(--muted); white-space: nowrap; } td.n, th.n { text-align: right; }
code { font: .92em ui-monospace, "SF Mono", Consolas, "DejaVu Sans Mono", monospace; overflow-wrap: anywhere; }
summary { cursor: pointer; color: var(--blue); margin: .3rem 0; }
footer { color: var(--muted); font-size: .88rem; padding-bottom: 2.5rem; }
dialog { padding: 0; border: 0; width: 100vw; height: 100vh; max-width: none; max-height: none; background: #fff;
  overflow: hidden; }
dialog img { position: absolute; cursor: grab; user-select: none; max-width: none; }
dialog div { position: absolute; right: 14px; top: 10px; z-index: 1; display: flex; gap: 8px; align-items: center;
  background: rgba(255, 255, 255, .92); padding: 4px 8px; border-radius: 6px; color: var(--muted); font-size: .9rem; }
dialog button { font: inherit; padding: .2rem .8rem; border: 1px solid var(--rule); border-radius: 5px;
  background: #fff; cursor: pointer; }
@media print { nav, dialog { display: none; } section { break-inside: avoid; border: 0; } body { background: #fff; } }
"""

SCRIPT = """
(() => {
  const box = document.querySelector('dialog'), big = box.querySelector('img');
  let x = 0, y = 0, w = 1, shape = 1, from = null;
  const place = () => { big.style.left = x + 'px'; big.style.top = y + 'px'; big.style.width = w + 'px'; };
  const fit = () => {
    w = Math.min(innerWidth - 40, (innerHeight - 80) / shape);
    x = (innerWidth - w) / 2; y = (innerHeight + 40 - w * shape) / 2; place();
  };
  const zoom = (by, cx, cy) => {
    const next = Math.min(20000, Math.max(200, w * by));
    x = cx - (cx - x) * next / w; y = cy - (cy - y) * next / w; w = next; place();
  };
  for (const button of document.querySelectorAll('figure button')) button.addEventListener('click', () => {
    const image = button.querySelector('img');
    shape = image.naturalHeight / image.naturalWidth; big.src = image.src; big.alt = image.alt;
    box.showModal(); fit();
  });
  box.addEventListener('wheel', e => {
    e.preventDefault(); zoom(Math.exp(-e.deltaY / 500), e.clientX, e.clientY);
  }, { passive: false });
  big.addEventListener('dragstart', e => e.preventDefault());
  box.addEventListener('pointerdown', e => {
    if (!e.target.closest('div')) from = [e.clientX - x, e.clientY - y];
  });
  box.addEventListener('pointermove', e => {
    if (from) { x = e.clientX - from[0]; y = e.clientY - from[1]; place(); }
  });
  for (const name of ['pointerup', 'pointerleave']) box.addEventListener(name, () => { from = null; });
  big.addEventListener('dblclick', fit);
  addEventListener('resize', () => { if (box.open) fit(); });
  box.addEventListener('keydown', e => {
    if (e.key === '+' || e.key === '=') zoom(1.25, innerWidth / 2, innerHeight / 2);
    if (e.key === '-') zoom(0.8, innerWidth / 2, innerHeight / 2);
    if (e.key === '0') fit();
  });
  box.querySelector('button').addEventListener('click', () => box.close());
})();
"""
