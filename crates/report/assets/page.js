'use strict';
// Makes the drawn plots live: zoom, move, values under the pointer, lines on and off. Without it the drawings stay.
(() => {
  const groups = {};
  const rounded = value => value == null ? '' : String(Number(value.toPrecision(4)));
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

  // What a line of the table does not show: upright lines, and two standard deviations about a dot.
  const marks = (plot, series) => {
    const { ctx, bbox } = plot;
    const place = (value, axis) => plot.valToPos(value, axis, true);
    const upright = (at, from, to) => {
      ctx.beginPath();
      ctx.moveTo(at, from);
      ctx.lineTo(at, to);
      ctx.stroke();
    };
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.lineWidth = 2 * devicePixelRatio;
    series.forEach((one, index) => {
      if (!plot.series[index + 1].show) return;
      ctx.strokeStyle = one.colour;
      if (one.upright != null) upright(place(one.upright, 'x'), bbox.top, bbox.top + bbox.height);
      ctx.globalAlpha = 0.4;
      one.deviations?.forEach((deviation, dot) => {
        if (one.y[dot] == null) return;
        const [low, high] = [-2, 2].map(by => place(one.y[dot] + by * deviation, 'y'));
        upright(place(one.x[dot], 'x'), low, high);
      });
      ctx.globalAlpha = 1;
    });
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
      if (series.upright != null) series.y = series.x.map(() => null);
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
      legend: { markers: { width: 0, fill: (plot, index) => plot.series[index].stroke(plot, index) } },
      hooks: { drawClear: [plot => bands(plot, data.bands)], draw: [plot => marks(plot, data.series)], setScale: [] },
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
  // Paper cannot be unfolded.
  const folded = [];
  addEventListener('beforeprint', () => document.querySelectorAll('details:not([open])').forEach(part => {
    part.open = true;
    folded.push(part);
  }));
  addEventListener('afterprint', () => folded.splice(0).forEach(part => {
    part.open = false;
  }));
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
