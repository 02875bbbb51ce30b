"""The page's script: one cursor and one zoom over all charts. Without it every chart stands as it is drawn."""

from __future__ import annotations

SCRIPT = r"""
(() => {
  const charts = [...document.querySelectorAll('figure.chart')];
  if (!charts.length) return;
  const SPAN = 100000, HEIGHT = 1000;
  const t0 = Math.min(...charts.map(c => +c.dataset.t0)), t1 = Math.max(...charts.map(c => +c.dataset.t1));
  let a = t0, b = t1, at = null;
  const panels = charts.flatMap(chart => [...chart.querySelectorAll('.panel')].map(panel => ({
    chart, panel, plot: panel.querySelector('.plot'), zoom: panel.querySelector('.zoom'),
    cursor: panel.querySelector('.cursor'), xs: panel.querySelector('.xs'), own0: +chart.dataset.t0,
    own1: +chart.dataset.t1, y0: +panel.dataset.y0, y1: +panel.dataset.y1, points: null,
    values: [...panel.querySelectorAll('b[data-line]')],
  })));
  const read = d => {
    const xs = [], ys = [];
    for (const piece of d.split('M').slice(1)) {
      const n = piece.match(/-?\d+/g).map(Number);
      let x = n[0], y = n[1];
      if (xs.length) { xs.push(x); ys.push(NaN); }
      xs.push(x); ys.push(y);
      if (piece.includes('l')) for (let i = 2; i + 1 < n.length; i += 2) {
        x += n[i]; y += n[i + 1]; xs.push(x); ys.push(y);
      }
    }
    return [xs, ys];
  };
  const value = (line, x) => {
    const [xs, ys] = line;
    let low = 0, high = xs.length - 1;
    if (high < 0 || x < xs[0] || x > xs[high]) return NaN;
    while (high - low > 1) { const m = (low + high) >> 1; if (xs[m] <= x) low = m; else high = m; }
    if (Number.isNaN(ys[low]) || Number.isNaN(ys[high])) return NaN;
    const w = xs[high] - xs[low];
    return w > 0 ? ys[low] + (ys[high] - ys[low]) * (x - xs[low]) / w : ys[low];
  };
  const text = v => Number.isNaN(v) ? '–' : Math.abs(v) < 1e-9 ? '0' : v.toPrecision(3).replace('-', '−');
  const inView = p => {
    const r = p.panel.getBoundingClientRect();
    return r.bottom > -200 && r.top < innerHeight + 200;
  };
  const showTime = p => {
    const place = 100 * (at - a) / (b - a), shown = at !== null && place >= 0 && place <= 100;
    p.cursor.style.display = shown ? 'block' : 'none';
    if (!shown) { for (const o of p.values) o.textContent = ''; return; }
    p.cursor.style.left = place + '%'; p.cursor.dataset.t = at.toFixed(b - a < 2 ? 3 : 2) + ' s';
    if (!inView(p)) return;
    p.points = p.points || [...p.zoom.querySelectorAll('path.line')].map(e => read(e.getAttribute('d')));
    const x = SPAN * (at - p.own0) / (p.own1 - p.own0);
    p.values.forEach(o => {
      const y = value(p.points[+o.dataset.line], x);
      o.textContent = text(p.y1 - (p.y1 - p.y0) * y / HEIGHT);
    });
  };
  const ticks = p => {
    const width = (b - a) / 6, power = 10 ** Math.floor(Math.log10(width));
    const step = power * [1, 2, 5, 10].find(f => power * f >= width);
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    let html = '';
    for (let k = Math.ceil(a / step - 1e-9); k * step <= b + 1e-9 * step; k++)
      html += `<span style="left:${100 * (k * step - a) / (b - a)}%">${(k * step).toFixed(digits)}</span>`;
    p.xs.innerHTML = html + '<span class="unit">s</span>';
  };
  let waiting = false;
  const draw = () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      for (const p of panels) {
        const k = (p.own1 - p.own0) / (b - a), shift = SPAN * (p.own0 - a) / (b - a);
        p.zoom.setAttribute('transform', `matrix(${k} 0 0 1 ${shift} 0)`);
        ticks(p); showTime(p);
      }
    });
  };
  const cursor = t => { at = t === null ? null : Math.min(b, Math.max(a, t)); for (const p of panels) showTime(p); };
  const zoom = (by, about) => {
    const width = Math.min(t1 - t0, Math.max((t1 - t0) / 5000, (b - a) * by));
    const share = (about - a) / (b - a);
    a = Math.min(t1 - width, Math.max(t0, about - share * width)); b = a + width; draw();
  };
  const move = by => { const w = b - a; a = Math.min(t1 - w, Math.max(t0, a + by)); b = a + w; draw(); };
  const timeAt = (p, x) => { const r = p.plot.getBoundingClientRect(); return a + (b - a) * (x - r.left) / r.width; };
  for (const p of panels) {
    const fingers = new Map();
    let from = null;
    p.plot.addEventListener('pointermove', e => {
      if (fingers.has(e.pointerId) && fingers.size === 2) {
        const other = [...fingers].find(([id]) => id !== e.pointerId)[1], was = fingers.get(e.pointerId);
        const before = Math.abs(was - other), now = Math.abs(e.clientX - other);
        if (before > 10 && now > 10) zoom(before / now, timeAt(p, (e.clientX + other) / 2));
        fingers.set(e.pointerId, e.clientX);
        return;
      }
      if (fingers.has(e.pointerId)) {
        if (b - a < (t1 - t0) * 0.999) {
          const r = p.plot.getBoundingClientRect();
          move((from - e.clientX) * (b - a) / r.width); from = e.clientX;
        }
        fingers.set(e.pointerId, e.clientX);
      }
      cursor(timeAt(p, e.clientX));
    });
    p.plot.addEventListener('pointerdown', e => {
      fingers.set(e.pointerId, e.clientX); from = e.clientX; cursor(timeAt(p, e.clientX));
    });
    for (const name of ['pointerup', 'pointercancel', 'pointerleave']) p.plot.addEventListener(name, e => {
      fingers.delete(e.pointerId);
      const left = name === 'pointerleave' && e.pointerType === 'mouse';
      if (left && !p.chart.contains(document.activeElement)) cursor(null);
    });
    p.plot.addEventListener('wheel', e => {
      if (!e.ctrlKey && !p.chart.contains(document.activeElement)) return;
      e.preventDefault();
      if (Math.abs(e.deltaX) > Math.abs(e.deltaY)) move((b - a) * e.deltaX / 1000);
      else zoom(Math.exp(e.deltaY / 400), timeAt(p, e.clientX));
    }, { passive: false });
    p.plot.addEventListener('dblclick', () => { a = t0; b = t1; draw(); });
  }
  for (const chart of charts) chart.addEventListener('keydown', e => {
    const middle = at === null ? (a + b) / 2 : at, step = (b - a) / (e.shiftKey ? 20 : 200);
    if (e.key === 'ArrowRight') cursor(middle + step); else if (e.key === 'ArrowLeft') cursor(middle - step);
    else if (e.key === '+' || e.key === '=') zoom(0.7, middle); else if (e.key === '-') zoom(1 / 0.7, middle);
    else if (e.key === '0') { a = t0; b = t1; draw(); } else if (e.key === 'Escape') { cursor(null); chart.blur(); }
    else return;
    e.preventDefault();
  });
  addEventListener('scroll', () => { if (at !== null) for (const p of panels) showTime(p); }, { passive: true });
  document.documentElement.classList.add('live');
})();
"""
