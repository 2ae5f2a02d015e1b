/** Plots with uPlot, in the colours of the page. */

import uPlot from 'uplot';
import 'uplot/dist/uPlot.min.css';
import { h } from './ui';

export const COLOURS = ['--measured', '--after', '--before', '--third'] as const;

const colour = (name: string) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export function axes(y: string, x = 'time, s'): uPlot.Axis[] {
  const axis = (label: string, size: number): uPlot.Axis => ({
    label,
    size,
    labelSize: 20,
    font: '12px system-ui, sans-serif',
    labelFont: '12px system-ui, sans-serif',
    stroke: () => colour('--ink'),
    grid: { stroke: () => colour('--line'), width: 1 },
    ticks: { stroke: () => colour('--line'), width: 1 },
  });
  return [axis(x, 32), axis(y, 56)];
}

export interface Line {
  label: string;
  colour: (typeof COLOURS)[number];
  dash?: number[];
  width?: number;
}

export function series(lines: Line[]): uPlot.Series[] {
  return [
    { label: 'time' },
    ...lines.map(
      (line): uPlot.Series => ({
        label: line.label,
        stroke: () => colour(line.colour),
        width: line.width ?? 1.5,
        dash: line.dash,
        points: { show: false },
        spanGaps: true,
      }),
    ),
  ];
}

/** A plot that fits its place, also when that changes. */
export function plotIn(place: HTMLElement, options: Omit<uPlot.Options, 'width'>, data: uPlot.AlignedData): uPlot {
  const plot = new uPlot({ ...options, width: Math.max(200, place.clientWidth || 600) }, data, place);
  new ResizeObserver(() => {
    if (place.clientWidth > 0 && place.clientWidth !== plot.width) plot.setSize({ width: place.clientWidth, height: options.height });
  }).observe(place);
  return plot;
}

/** One quantity over time, with zoom. */
export function drawn(title: string, x: (number | null)[], y: (number | null)[]): HTMLElement {
  const place = h('figure', { class: 'plot', role: 'img', 'aria-label': `${title} over time` });
  const start = x.find(value => value !== null) ?? 0;
  const data = [x.map(value => (value === null ? NaN : value - start)), y] as uPlot.AlignedData;
  requestAnimationFrame(() =>
    plotIn(
      place,
      {
        height: 170,
        scales: { x: { time: false } },
        axes: axes(title),
        series: series([{ label: title, colour: '--measured', width: 1 }]),
        legend: { show: false },
        cursor: { drag: { x: true, y: false }, sync: { key: 'recording' } },
      },
      data,
    ),
  );
  return place;
}
