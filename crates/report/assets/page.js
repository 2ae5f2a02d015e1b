'use strict';
// Makes the drawn plots live: zoom, move, values under the pointer, lines on and off. Without it the drawings stay.
(() => {
  const groups = {};
  const rounded = value => value == null ? '-' : String(Number(value.toPrecision(4)));
  const height = (figure, data) => figure.clientWidth < 560 ? 250 : data.height;

  // One table with a column for each line; lines of other places leave gaps.
  const joined = series => {
    const own = series.map(line => [line.x, line.y]);
    return series.every(line => line.x === series[0].x)
      ? [series[0].x, ...series.map(line => line.y)] : uPlot.join(own);
  };

  const bands = (plot, spans) => {
    const { ctx, bbox } = plot;
    ctx.save();
    for (const { from, to, across } of spans) {
      const [start, end] = [from, to].map(value => plot.valToPos(value, across ? 'x' : 'y', true));
      ctx.fillStyle = across ? 'rgba(0,0,0,.055)' : 'rgba(0,0,0,.10)';
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.save();
      ctx.clip();
      if (across) ctx.fillRect(start, bbox.top, end - start, bbox.height);
      else ctx.fillRect(bbox.left, end, bbox.width, start - end);
      ctx.restore();
    }
    ctx.restore();
  };

  const line = series => ({
    label: series.name,
    stroke: series.colour,
    width: series.width,
    spanGaps: series.joined,
    paths: series.points ? () => null : undefined,
    points: series.points ? { show: true, size: 7, fill: series.colour } : { show: false },
    value: (_, value) => rounded(value),
  });

  // Moves the shown part while shift is held.
  const movable = plot => {
    plot.over.addEventListener('mousedown', down => {
      if (!down.shiftKey) return;
      down.preventDefault();
      down.stopImmediatePropagation();
      const { min, max } = plot.scales.x;
      const perPixel = (max - min) / plot.over.clientWidth;
      const move = event => {
        const by = (down.clientX - event.clientX) * perPixel;
        plot.setScale('x', { min: min + by, max: max + by });
      };
      const up = () => {
        document.removeEventListener('mousemove', move);
        document.removeEventListener('mouseup', up);
      };
      document.addEventListener('mousemove', move);
      document.addEventListener('mouseup', up);
    }, true);
  };

  const together = (plot, key) => {
    const others = groups[key] ??= [];
    others.push(plot);
    plot.hooks.setScale.push((_, scale) => {
      if (scale !== 'x' || together.busy) return;
      together.busy = true;
      const { min, max } = plot.scales.x;
      others.filter(other => other !== plot).forEach(other => other.setScale('x', { min, max }));
      together.busy = false;
    });
  };

  const show = figure => {
    const data = JSON.parse(figure.querySelector('script').textContent);
    let x;
    data.series.forEach(series => {
      x = series.x ??= x;
    });
    const table = joined(data.series);
    const axis = label => ({
      label, labelSize: 24, size: label === data.y_title ? 66 : 36, font: '13px system-ui,sans-serif',
      labelFont: '13px system-ui,sans-serif', grid: { stroke: '#eceef1', width: 1 }, ticks: { stroke: '#d5d8dc', width: 1 },
      stroke: '#3a3f46', values: (_, values) => values.map(value => value == null ? '' : String(Number(value.toPrecision(6)))),
    });
    const plot = new uPlot({
      width: figure.clientWidth,
      height: height(figure, data),
      scales: { x: { time: false, distr: data.log ? 3 : 1 } },
      axes: [axis(data.x_title), axis(data.y_title)],
      series: [{ label: data.x_title, value: (_, value) => rounded(value) }, ...data.series.map(line)],
      cursor: { sync: data.group ? { key: data.group } : undefined, drag: { x: true, y: false, dist: 4 }, points: { size: 6 } },
      hooks: { drawClear: [plot => bands(plot, data.bands)], setScale: [] },
    }, table, figure.querySelector('.live'));
    if (data.group) together(plot, data.group);
    movable(plot);
    figure.classList.add('is-live');
    new ResizeObserver(() => {
      if (figure.clientWidth > 0) plot.setSize({ width: figure.clientWidth, height: height(figure, data) });
    }).observe(figure);
  };

  // A folded plot has no width: it becomes live when it is opened.
  const ready = figure => {
    if (figure.clientWidth > 0 && !figure.classList.contains('is-live')) show(figure);
  };
  // A page that shows this one in a frame makes room for all of it.
  if (parent !== window) {
    const tell = () => parent.postMessage({ height: document.documentElement.offsetHeight }, '*');
    new ResizeObserver(tell).observe(document.documentElement);
  }
  if (typeof uPlot === 'undefined') return;
  const all = [...document.querySelectorAll('figure.plot:has(script)')];
  all.forEach(ready);
  document.querySelectorAll('details').forEach(part => part.addEventListener('toggle', () => all.forEach(ready)));
  document.body.classList.add('can-zoom');
})();
