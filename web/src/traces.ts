/** Live traces: every sample is kept for the longest window, and drawn once a frame. */

import uPlot from 'uplot';
import { COLUMNS } from './client';
import { axes, plotIn, series, type Line } from './plot';
import { button, field, h, select } from './ui';

/** Samples that are kept: a minute at 1 kHz. The memory is taken once. */
const KEPT = 60_000;
/** Points of a line that are drawn at most; of more, the least and the greatest of each group. */
const DRAWN = 1000;
/** Drawing that takes longer than this leaves out frames. */
const LONG_DRAW_MS = 6;

const enum Place {
  Time,
  Reference,
  Angle,
  Speed,
  Current,
  Duty,
  Voltage,
  Supply,
  State,
  Trip,
}

interface Panel {
  title: string;
  lines: (Line & { of: Place })[];
}

const SPEED: Panel = {
  title: 'speed, rad/s',
  lines: [
    { label: 'speed', colour: '--measured', of: Place.Speed },
    { label: 'reference', colour: '--before', of: Place.Reference, dash: [6, 4] },
  ],
};
const ANGLE: Panel = {
  title: 'angle, rad',
  lines: [
    { label: 'angle', colour: '--measured', of: Place.Angle },
    { label: 'reference', colour: '--before', of: Place.Reference, dash: [6, 4] },
  ],
};
const CURRENT: Panel = { title: 'current, A', lines: [{ label: 'current', colour: '--after', of: Place.Current }] };
const VOLTAGE: Panel = { title: 'voltage, V', lines: [{ label: 'voltage', colour: '--third', of: Place.Voltage }] };

export class Traces {
  readonly element: HTMLElement;
  /** Samples that have come. */
  count = 0;
  private readonly ring = new Float64Array(KEPT * COLUMNS);
  private plots: { plot: uPlot; panel: Panel }[] = [];
  private readonly place = h('div', { class: 'plots-live' });
  private seconds = 5;
  private isPaused = false;
  private hasNew = false;
  private readonly pauseButton: HTMLButtonElement;
  private frame = 0;
  /** Not drawn before: on a slow computer drawing takes half of the time at most, and commands the rest. */
  private earliest = 0;
  private shown: 'speed' | 'position' = 'speed';

  constructor() {
    const window = select([['2', '2 s'], ['5', '5 s'], ['10', '10 s'], ['30', '30 s'], ['60', '60 s']], '5', {
      onchange: () => {
        this.seconds = Number(window.value);
        this.hasNew = true;
      },
    });
    const first = select([['speed', 'speed'], ['position', 'angle']], 'speed', {
      onchange: () => this.show(first.value as 'speed' | 'position'),
    });
    this.pauseButton = button('Pause', () => this.pause(!this.isPaused), { 'aria-pressed': 'false' });
    this.element = h(
      'section',
      { class: 'card traces', 'aria-label': 'Live traces' },
      h('div', { class: 'tools' }, h('h2', {}, 'Live'), field('Shows', first), field('Window', window), this.pauseButton),
      this.place,
      h('small', {}, 'Paused: drag to zoom, double-click for the whole, move over a plot for values.'),
    );
  }

  /** Begins to draw; the element is in the page by then. */
  start(): void {
    this.show(this.shown);
    const draw = () => {
      this.frame = requestAnimationFrame(draw);
      const begun = performance.now();
      if (!this.hasNew || this.isPaused || begun < this.earliest) return;
      this.draw();
      const ended = performance.now();
      if (ended - begun > LONG_DRAW_MS) this.earliest = 2 * ended - begun;
    };
    draw();
  }

  end(): void {
    cancelAnimationFrame(this.frame);
    this.plots.forEach(({ plot }) => plot.destroy());
  }

  private show(what: 'speed' | 'position'): void {
    this.shown = what;
    this.plots.forEach(({ plot }) => plot.destroy());
    const panels = [what === 'speed' ? SPEED : ANGLE, CURRENT, VOLTAGE];
    this.place.replaceChildren();
    this.plots = panels.map((panel, index) => {
      const place = h('figure', { class: 'plot', role: 'img', 'aria-label': `${panel.title}, live` });
      this.place.append(place);
      const options: Omit<uPlot.Options, 'width'> = {
        height: index === 0 ? 230 : 170,
        scales: { x: { time: false } },
        axes: axes(panel.title, index === 2 ? 'time, s' : ''),
        series: series(panel.lines),
        legend: { show: true, live: true },
        cursor: { sync: { key: 'live' }, drag: { x: true, y: false } },
        pxAlign: 0,
      };
      return { plot: plotIn(place, options, this.window(panel)), panel };
    });
    this.hasNew = true;
  }

  add(samples: Float64Array): void {
    for (let from = 0; from < samples.length; from += COLUMNS) {
      this.ring.set(samples.subarray(from, from + COLUMNS), (this.count % KEPT) * COLUMNS);
      this.count += 1;
    }
    this.hasNew = true;
  }

  pause(paused: boolean): void {
    this.isPaused = paused;
    this.pauseButton.textContent = paused ? 'Go on' : 'Pause';
    this.pauseButton.setAttribute('aria-pressed', String(paused));
  }

  /** One number of the newest sample. */
  last(place: number): number {
    return this.count === 0 ? NaN : this.ring[((this.count - 1) % KEPT) * COLUMNS + place]!;
  }

  /** The samples from number `from` on, one array for each of the places. */
  since(from: number, places: number[]): number[][] {
    const first = Math.max(from, this.count - KEPT);
    return places.map(place => Array.from({ length: this.count - first }, (_, index) => this.ring[((first + index) % KEPT) * COLUMNS + place]!));
  }

  private window(panel: Panel): uPlot.AlignedData {
    const end = this.last(Place.Time);
    let first = this.count;
    const oldest = Math.max(0, this.count - KEPT);
    const at = (index: number, place: Place) => this.ring[(index % KEPT) * COLUMNS + place]!;
    while (first > oldest && at(first - 1, Place.Time) > end - this.seconds && at(first - 1, Place.Time) <= end) first--;
    const group = Math.max(1, Math.ceil((2 * (this.count - first)) / DRAWN));
    const time: number[] = [];
    const values: (number | null)[][] = panel.lines.map(() => []);
    const put = (index: number, line: number) => {
      const value = at(index, panel.lines[line]!.of);
      values[line]!.push(Number.isNaN(value) ? null : value);
    };
    // Groups stand still while the window moves, so that lines do not flicker.
    for (let start = Math.ceil(first / group) * group; start < this.count; start += group) {
      const stop = Math.min(start + group, this.count);
      if (group === 1) {
        time.push(at(start, Place.Time));
        panel.lines.forEach((_, line) => put(start, line));
        continue;
      }
      time.push(at(start, Place.Time), at(start + (group >> 1) < stop ? start + (group >> 1) : stop - 1, Place.Time));
      panel.lines.forEach((shown, line) => {
        let [least, most] = [start, start];
        for (let index = start; index < stop; index++) {
          if (at(index, shown.of) < at(least, shown.of)) least = index;
          if (at(index, shown.of) > at(most, shown.of)) most = index;
        }
        put(Math.min(least, most), line);
        put(Math.max(least, most), line);
      });
    }
    return [time, ...values] as uPlot.AlignedData;
  }

  private draw(): void {
    this.hasNew = false;
    const end = this.last(Place.Time);
    for (const { plot, panel } of this.plots) {
      plot.batch(() => {
        plot.setData(this.window(panel), false);
        plot.setScale('x', { min: end - this.seconds, max: end });
      });
    }
  }
}
