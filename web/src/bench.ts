/** The bench on a board, real or virtual: stop, state, live traces, drive, steps, recording, diagnosis, design, gains. */

import { Analysis, Cancelled, type Predicted, type Result } from './analysis';
import { Stopped, type Client } from './client';
import { axes, plotIn, series, type Line } from './plot';
import { resultView } from './result';
import { Traces } from './traces';
import type uPlot from 'uplot';
import { button, errorText, field, h, message, number, rounded, sameBy, save, select, words } from './ui';
import type { Libraries, Setting, TripHelp } from './wasm';

const MODES: [name: string, text: string, unit: string][] = [
  ['open', 'open loop: voltage', 'V'],
  ['speed', 'speed, PID', 'rad/s'],
  ['position', 'position, PID', 'rad'],
  ['lqr_speed', 'speed, LQR', 'rad/s'],
  ['lqr_position', 'position, LQR', 'rad'],
];
const unitOf = (mode: string) => MODES.find(([name]) => name === mode)?.[2] ?? '';

/** Bits of the state, as in the protocol. */
const ARMED = 8;
const PLAYING = 32;
const LIMITED = 64;
/** Numbers of a sample. */
const [TIME, ANGLE, SPEED, CURRENT, VOLTAGE, SUPPLY, STATE, TRIP] = [0, 2, 3, 4, 6, 7, 8, 9];

/** Settings by what they are for, by the begin of their names; the rest comes last. */
const GROUPS: [title: string, of: RegExp][] = [
  ['PID of the speed', /^speed_(kp|ki|kd|kt|kff|tf|k_|ff)|^speed_k/],
  ['PID of the position', /^position_k/],
  ['LQR', /^lqr/],
  ['Limits and motion', /limit|acceleration|cruise|jerk/],
  ['Trips', /^trip|^emergency/],
];

interface Options {
  nominalRig?: string;
  panel?: HTMLElement;
  onend: (why: string) => void;
}

export class Bench {
  readonly element: HTMLElement;
  /** The last diagnosis. */
  result: Result | null = null;

  private readonly traces = new Traces();
  private readonly analysis = new Analysis();
  private readonly settings: Setting[];
  private readonly trips: TripHelp[];
  private readonly state = h('span', { class: 'state safe', role: 'status' }, 'off');
  private readonly tripArea = h('div', { 'aria-live': 'assertive' });
  private readonly said = h('div', { 'aria-live': 'polite' });
  private readonly reading = Object.fromEntries(['speed', 'angle', 'current', 'voltage', 'supply'].map(name => [name, h('dd', {}, '–')]));
  private readonly losses = h('dd', {}, '0');
  private readonly log = h('pre', { class: 'console', tabindex: 0, 'aria-label': 'Lines and answers' });
  private readonly resultArea = h('div', { 'aria-live': 'polite' });
  private readonly armButton = button('Arm', () => this.toggleArmed(), { class: 'primary' });
  private readonly mode = select(MODES.map(([name, text]): [string, string] => [name, text]), 'speed');
  private readonly reference = number(0, { id: 'reference' });
  private rows = new Map<string, () => void>();
  private designed = new Map<string, number>();
  private saved = new Map<string, number>();
  private rig = '';
  private csv = '';
  private shownTrip = -1;
  /** The end of the last order to the board. */
  private turn: Promise<unknown> = Promise.resolve();
  /** What drives the motor by itself now. */
  private playing = '';
  private clock: ReturnType<typeof setInterval> | undefined;
  private readonly onkey = (event: KeyboardEvent) => {
    if (event.key === 'Escape') this.stop();
  };
  private readonly onunload = () => void this.client.stop();

  constructor(
    private readonly client: Client,
    private readonly libraries: Libraries,
    private readonly options: Options,
  ) {
    this.settings = JSON.parse(libraries.settings()) as Setting[];
    this.trips = JSON.parse(libraries.trips()) as TripHelp[];
    client.onsamples = samples => this.traces.add(samples);
    client.onmessage = line => this.note(`# ${line}`);
    client.onlog = line => this.note(line);
    client.ongone = why => void this.end(why);
    this.element = this.built();
  }

  begin(): void {
    this.traces.start();
    this.clock = setInterval(() => this.look(), 100);
    addEventListener('keydown', this.onkey);
    addEventListener('pagehide', this.onunload);
    this.armButton.focus();
  }

  private quit(): void {
    clearInterval(this.clock);
    removeEventListener('keydown', this.onkey);
    removeEventListener('pagehide', this.onunload);
    this.traces.end();
    this.analysis.cancel();
  }

  private async end(why: string): Promise<void> {
    this.quit();
    await this.client.close().catch(() => {});
    this.options.onend(why);
  }

  /** The person goes to another screen. */
  async leave(): Promise<void> {
    await this.end('');
  }

  private stop(): void {
    void this.client.stop();
  }

  private note(line: string): void {
    this.log.textContent = `${(this.log.textContent ?? '').slice(-8000)}${line}\n`;
    this.log.scrollTop = this.log.scrollHeight;
  }

  /** Runs what a button does; an error is shown where it can be seen. */
  private async act(what: () => Promise<unknown>): Promise<void> {
    this.said.replaceChildren();
    try {
      await what();
    } catch (error) {
      const isWanted = error instanceof Cancelled || error instanceof Stopped;
      if (!this.client.isGone) this.said.replaceChildren(message(isWanted ? 'note' : 'error', errorText(error)));
    }
  }

  /** Orders to the board follow each other: a second button waits until the first is through. */
  private order(what: (since: number) => Promise<unknown>): Promise<void> {
    const since = this.client.stops;
    return this.act(() => {
      if (this.playing) throw new Error(`${this.playing} runs: wait for its end, or press STOP.`);
      const done = this.turn.then(() => what(since));
      this.turn = done.catch(() => {});
      return done;
    });
  }

  /** An order that takes seconds; others are refused meanwhile. */
  private play(name: string, what: (since: number) => Promise<unknown>): Promise<void> {
    return this.order(async since => {
      this.playing = name;
      try {
        await what(since);
      } finally {
        this.playing = '';
      }
    });
  }

  private get isArmed(): boolean {
    return (this.traces.last(STATE) & ARMED) !== 0;
  }

  private look(): void {
    const at = (place: number) => this.traces.last(place);
    const shown: [string, number, string][] = [
      ['speed', at(SPEED), 'rad/s'],
      ['angle', at(ANGLE), 'rad'],
      ['current', at(CURRENT), 'A'],
      ['voltage', at(VOLTAGE), 'V'],
      ['supply', at(SUPPLY), 'V'],
    ];
    for (const [name, value, unit] of shown) this.reading[name]!.textContent = `${fixed(value)} ${unit}`;
    const [lost] = this.client.receiver.losses();
    this.losses.textContent = String(lost);
    const trip = at(TRIP);
    const [state, text] = trip > 0 ? ['tripped', 'tripped'] : this.isArmed ? ['armed', (at(STATE) & LIMITED) !== 0 ? 'armed, at a limit' : 'armed'] : ['safe', 'drive off'];
    if (this.state.textContent !== text) {
      this.state.textContent = text;
      this.state.className = `state ${state}`;
      this.armButton.textContent = this.isArmed ? 'Disarm' : 'Arm';
    }
    if (trip !== this.shownTrip) this.showTrip(trip);
  }

  private showTrip(trip: number): void {
    this.shownTrip = trip;
    if (!(trip > 0)) return this.tripArea.replaceChildren();
    const known = this.trips.find(other => other.number === trip);
    this.tripArea.replaceChildren(
      message(
        'error',
        h('strong', {}, `The drive switched itself off: ${known?.words ?? `trip ${trip}`}. `),
        `${upperFirst((known?.cure ?? 'the firmware is newer than this page').replaceAll('`', ''))}.`,
        h('div', { class: 'actions' }, button('Clear the trip', () => this.order(since => this.client.ask('clear', since))), sameBy('motorbench connect clear')),
      ),
    );
  }

  private arm(since: number): Promise<void> {
    return this.client.arm(this.libraries.lost_after_ms(), since);
  }

  private async toggleArmed(): Promise<void> {
    if (this.isArmed) return this.stop();
    await this.order(async since => {
      await this.arm(since);
      await this.client.ask(`mode ${this.mode.value}`, since);
    });
  }

  private built(): HTMLElement {
    const stop = button('STOP', () => this.stop(), { class: 'stop', 'aria-keyshortcuts': 'Escape' });
    stop.append(h('small', {}, 'or the Escape key'));
    const readings = h(
      'dl',
      { class: 'readings' },
      ...Object.entries(this.reading).map(([name, place]) => h('div', {}, h('dt', {}, name), place)),
      h('div', {}, h('dt', {}, 'frames lost'), this.losses),
    );
    return h(
      'div',
      {},
      h('div', { class: 'bar' }, this.state, readings, stop),
      this.tripArea,
      this.said,
      h(
        'div',
        { class: 'bench' },
        h(
          'div',
          {},
          this.drivePart(),
          this.options.panel ?? null,
          this.recordPart(),
          this.stepPart(),
          this.designPart(),
          this.settingsPart(),
          this.consolePart(),
        ),
        this.traces.element,
      ),
      this.resultArea,
    );
  }

  private drivePart(): HTMLElement {
    const unit = h('span', { class: 'unit' }, 'rad/s');
    const range = h('small', { id: 'reference-range' }, '');
    const same = h('div');
    const update = () => {
      const limit = this.referenceLimit(this.mode.value);
      unit.textContent = unitOf(this.mode.value);
      range.textContent = limit ? `−${rounded(limit)} to ${rounded(limit)} ${unitOf(this.mode.value)}` : '';
      same.replaceChildren(sameBy(`motorbench connect arm 'mode ${this.mode.value}' 'ref ${this.reference.value || 0}'`));
    };
    this.mode.addEventListener('change', () => {
      update();
      if (this.isArmed) void this.order(since => this.client.ask(`mode ${this.mode.value}`, since));
    });
    this.reference.addEventListener('input', update);
    this.reference.setAttribute('aria-describedby', 'reference-range');
    const send = () => this.order(since => this.client.ask(`ref ${Number(this.reference.value)}`, since));
    update();
    return h(
      'section',
      { class: 'card', 'aria-label': 'Drive' },
      h('h2', {}, 'Drive'),
      field('Mode', this.mode),
      h(
        'form',
        { onsubmit: (event: Event) => { event.preventDefault(); void send(); } },
        h('div', { class: 'field' }, h('label', { for: 'reference' }, 'Reference'), h('span', { class: 'with-unit' }, this.reference, unit), range),
        h('div', { class: 'actions' }, this.armButton, h('button', { type: 'submit' }, 'Set the reference'), button('Disconnect', () => this.end(''))),
      ),
      h('small', {}, 'Closing this page, or pulling the cable, stops the motor within half a second.'),
      same,
    );
  }

  private referenceLimit(mode: string): number {
    if (mode === 'open') return this.client.setting('voltage_limit');
    return mode.endsWith('speed') ? this.client.setting('speed_range') : 0;
  }

  private recordPart(): HTMLElement {
    const supply = this.client.setting('supply');
    const amplitude = number(Number((0.8 * (supply > 0 ? supply : 12)).toPrecision(3)));
    const free = h('input', { type: 'checkbox', checked: this.client.transport.isVirtual });
    const bar = h('progress', { max: 1, value: 0, 'aria-label': 'Recorded' });
    const covered = h('p', { class: 'read', 'aria-live': 'polite' }, '');
    const after = h('div', { class: 'actions' });
    const go = button('Record 20 s', () => this.play('The recording', since => this.record(since, Number(amplitude.value), free.checked, bar, covered, after, go)), { class: 'primary' });
    return h(
      'section',
      { class: 'card', 'aria-label': 'Record and diagnose' },
      h('h2', {}, 'Record and diagnose'),
      h('p', { class: 'quiet' }, 'The sequence “identify” drives the motor both ways for 20 s. Free the shaft first.'),
      field('Amplitude', amplitude, 'V'),
      h('label', { class: 'check' }, free, 'No limit of current and slew while it records; put back afterwards'),
      h('div', { class: 'actions' }, go),
      bar,
      covered,
      after,
      sameBy('motorbench record --out run.csv && motorbench diagnose run.csv --report run.html'),
    );
  }

  private async record(
    since: number,
    amplitude: number,
    isFree: boolean,
    bar: HTMLProgressElement,
    covered: HTMLElement,
    after: HTMLElement,
    go: HTMLButtonElement,
  ): Promise<void> {
    const { receiver } = this.client;
    after.replaceChildren();
    this.resultArea.replaceChildren();
    go.disabled = true;
    const before = [...this.client.settings];
    const slew = this.settings.find(setting => setting.name === 'slew_limit')!.default;
    const wanted: [string, number][] = isFree
      ? this.libraries.identification_settings().map(pair => pair.split(' ')).map(([name, value]) => [name!, Number(value)])
      : this.client.setting('slew_limit') > slew
        ? [['slew_limit', slew]]
        : [];
    const lostBefore = receiver.losses()[0]!;
    try {
      await this.client.set(wanted);
      await this.arm(since);
      await this.client.ask('mode open', since);
      receiver.record();
      await this.client.ask(`sequence identify ${amplitude} 0 500`, since);
      const ticks = 20 * this.client.setting('tick_rate');
      const ended = await this.played(since, () => {
        bar.value = receiver.recorded() / ticks;
        covered.textContent = (JSON.parse(receiver.covered()) as { words: string }).words;
      });
      await this.client.stop();
      const { words: coverage, lacks } = JSON.parse(receiver.covered()) as { words: string; lacks: { what: string; remedy: string }[] };
      covered.textContent = coverage;
      const lost = receiver.losses()[0]! - lostBefore;
      this.csv = receiver.recording_csv('run');
      this.rig = receiver.rig(this.options.nominalRig ?? '', this.client.transport.isVirtual);
      const told = `${receiver.recorded()} samples, ${lost} frames lost. ${ended}`;
      const isEnough = lacks.length === 0 && ended === '';
      after.replaceChildren(
        message(isEnough ? 'good' : 'note', isEnough ? `Enough to identify. ${told}` : `${told} ${lacks[0] ? `It lacks ${lacks[0].what}.` : ''}`),
        ...(receiver.recorded() > 0
          ? [
              button('Diagnose', () => this.act(() => this.diagnose(after)), { class: 'primary' }),
              button('Save recording', () => save('run.csv', this.csv, 'text/csv')),
              button('Save rig', () => save('run.rig.toml', this.rig)),
            ]
          : []),
      );
    } finally {
      go.disabled = false;
      const changed = new Set(wanted.map(([name]) => name));
      if (!this.client.isGone && changed.size > 0) await this.client.set(before.filter(([name]) => changed.has(name)));
      this.rows.forEach(update => update());
    }
  }

  /** Waits until the sequence is over; why it ended early, or an empty text. */
  private async played(since: number, each: () => void): Promise<string> {
    let hasBegun = false;
    const begun = performance.now();
    for (;;) {
      await new Promise(resolve => setTimeout(resolve, 100));
      each();
      if (this.client.isGone) throw new Error('The line to the board is gone.');
      const state = this.traces.last(STATE);
      if ((state & PLAYING) !== 0) hasBegun = true;
      else if (this.traces.last(TRIP) > 0) return 'The drive tripped: see above.';
      else if (this.client.stops !== since) return 'It was stopped.';
      else if (hasBegun) return '';
      else if (performance.now() - begun > 2000) throw new Error('The sequence did not begin: is the drive armed?');
    }
  }

  private async diagnose(place: HTMLElement): Promise<void> {
    const what = h('span', { role: 'status' }, 'reading');
    const progress = h('div', { class: 'progress' }, h('span', { class: 'spinner', 'aria-hidden': 'true' }), h('span', {}, 'Trying: ', what), button('Cancel', () => this.analysis.cancel()));
    place.append(progress);
    try {
      const bytes = new TextEncoder().encode(this.csv);
      const rig = { name: 'run.rig.toml', text: this.rig };
      this.result = await this.analysis.diagnose([{ name: 'run.csv', bytes, columns: [] }], rig, text => (what.textContent = words(text)));
      const view = resultView(this.result, { base: 'run', csv: this.csv, rig: this.rig, command: 'motorbench diagnose run.csv --report run.html --model model.toml' });
      this.resultArea.replaceChildren(view);
      view.scrollIntoView({ behavior: 'smooth' });
    } finally {
      progress.remove();
    }
  }

  private stepPart(): HTMLElement {
    const mode = select(MODES.map(([name, text]): [string, string] => [name, text]), 'speed');
    const size = number(60);
    const unit = h('span', { class: 'unit' }, 'rad/s');
    const duration = number(1, { min: 0.1, max: 10 });
    const plotArea = h('figure', { class: 'plot', role: 'img', 'aria-label': 'Step tests, overlaid' });
    const table = h('tbody');
    const runs: Step[] = [];
    let plot: uPlot | null = null;
    mode.addEventListener('change', () => (unit.textContent = unitOf(mode.value)));
    const draw = () => {
      plot?.destroy();
      plotArea.replaceChildren();
      table.replaceChildren(...runs.slice(-4).map(stepRow));
      if (runs.length > 0) plot = overlaid(plotArea, runs.slice(-4));
    };
    const go = async (since: number) => {
      const [step, duration_s] = [Number(size.value), Math.min(10, Math.max(0.1, Number(duration.value)))];
      const measured = await this.step(since, mode.value, step, duration_s);
      runs.push({ ...measured, name: `${runs.filter(run => !run.isModel).length + 1}`, isModel: false });
      draw();
      if (!this.result?.model) return;
      const settings = [...this.client.settings].filter(([name]) => name !== 'trip_host');
      const predicted = await this.analysis.predict(this.result.model, settings, mode.value, step, duration_s);
      runs.push({ ...predicted, name: 'model', isModel: true });
      draw();
    };
    return h(
      'details',
      { class: 'card' },
      h('summary', {}, 'Step tests'),
      h('div', { class: 'fields' }, field('Mode', mode), h('div', { class: 'field' }, h('label', { for: 'step-size' }, 'Step'), h('span', { class: 'with-unit' }, withId(size, 'step-size'), unit)), field('Duration', duration, 's')),
      h('div', { class: 'actions' }, button('Step', () => this.play('The step', go), { class: 'primary' }), button('Forget all', () => { runs.length = 0; draw(); })),
      plotArea,
      h('table', {}, h('thead', {}, h('tr', {}, ...['', 'Rise', 'Settles', 'Overshoot'].map(name => h('th', { scope: 'col' }, name)))), table),
      h('small', {}, 'After a diagnosis the model’s prediction is drawn beside the measured step.'),
      sameBy("motorbench connect arm 'mode speed' 'ref 60'"),
    );
  }

  private async step(since: number, mode: string, size: number, duration_s: number): Promise<Omit<Step, 'name' | 'isModel'>> {
    await this.arm(since);
    await this.client.ask(`mode ${mode}`, since);
    const isPosition = mode.endsWith('position');
    const start = isPosition ? this.traces.last(ANGLE) : 0;
    const from = this.traces.count;
    await this.client.ask(`ref ${start + size}`, since);
    await new Promise(resolve => setTimeout(resolve, 1000 * duration_s + 100));
    if (this.client.stops !== since) throw new Stopped('Stopped.');
    const rows = this.traces.since(from, [TIME, isPosition ? ANGLE : SPEED, VOLTAGE, CURRENT]);
    await this.client.stop();
    const [t, value, voltage, current] = rows.map(row => row.slice(0, Math.round(duration_s * this.client.setting('tick_rate')))) as [number[], number[], number[], number[]];
    const t_s = t.map(time => time - t[0]!);
    const relative = value.map(one => one - start);
    const to = mode === 'open' ? relative.at(-1)! : size;
    const array = (numbers: number[]) => new Float64Array(numbers);
    const figures = JSON.parse(this.libraries.measured_step(array(t_s), array(relative), array(voltage), array(current), to)) as Predicted;
    return { t_s, value: relative, rise_s: figures.rise_s, settling_s: figures.settling_s, overshoot_percent: figures.overshoot_percent };
  }

  private designPart(): HTMLElement {
    const law = select(MODES.slice(1).map(([name, text]): [string, string] => [name, text]), 'speed');
    const bandwidth = number(5, { min: 0.1 });
    const overshoot = number(10, { min: 0 });
    const current = number(1, { min: 0.05 });
    const rigFile = h('input', { type: 'file', accept: '.toml' });
    const place = h('div', { 'aria-live': 'polite' });
    const go = async () => {
      const rig = this.rig || this.libraries_rig();
      const file = rigFile.files?.[0];
      const nominal = file ? await file.text() : rig;
      place.replaceChildren(h('p', { class: 'quiet' }, 'Weights, margins, 30 % off in everything, on the core.'));
      const asked = { law: law.value, bandwidth_Hz: Number(bandwidth.value), overshoot_percent: Number(overshoot.value), current_limit_A: Number(current.value) };
      try {
        const { commands, text } = await this.analysis.design(nominal, this.result?.model ?? '', asked);
        const pairs = commands.flatMap(settingsOf);
        this.designed = new Map(pairs);
        this.rows.forEach(update => update());
        const send = async () => {
          await this.client.set(pairs);
          this.rows.forEach(update => update());
          place.append(message('good', `${pairs.length} settings are on the board, read back. Save keeps them without power.`));
        };
        place.replaceChildren(
          h('pre', { class: 'console', tabindex: 0, 'aria-label': 'Design' }, text),
          h('div', { class: 'actions' }, button('Send to the board', () => this.order(send), { class: 'primary' }), button('Save on the board', () => this.order(() => this.saveSettings())), button('Save lines', () => save('gains.txt', `${commands.join('\n')}\n`))),
          sameBy('motorbench send gains.txt --save'),
        );
      } catch (error) {
        place.replaceChildren(message('error', errorText(error)));
      }
    };
    return h(
      'details',
      { class: 'card' },
      h('summary', {}, 'Design'),
      h('p', { class: 'quiet' }, 'For the model of the last diagnosis. Without one, for the motor of a rig file.'),
      h('div', { class: 'fields' }, field('Law', law), field('Bandwidth at least', bandwidth, 'Hz'), field('Overshoot at most', overshoot, '%'), field('Current at most', current, 'A')),
      field('Rig file with the motor (.toml)', rigFile),
      h('div', { class: 'actions' }, button('Design', () => this.act(go), { class: 'primary' })),
      place,
      sameBy('motorbench design --rig run.rig.toml --model model.toml --speed --pid --bandwidth-Hz 5'),
    );
  }

  private libraries_rig(): string {
    return this.client.receiver.rig(this.options.nominalRig ?? '', this.client.transport.isVirtual);
  }

  private async saveSettings(): Promise<void> {
    await this.client.ask('save');
    this.saved = new Map(this.client.settings);
    this.rows.forEach(update => update());
  }

  private settingsPart(): HTMLElement {
    const groups = new Map<string, Setting[]>();
    for (const setting of this.settings) {
      const title = GROUPS.find(([, of]) => of.test(setting.name))?.[0] ?? 'Rig and sensors';
      groups.set(title, [...(groups.get(title) ?? []), setting]);
    }
    const order = [...GROUPS.map(([title]) => title), 'Rig and sensors'].filter(title => groups.has(title));
    const changed = () => this.settings.filter(setting => this.typed(setting) !== undefined);
    const send = async () => {
      const pairs = changed().map((setting): [string, number] => [setting.name, this.typed(setting)!]);
      if (pairs.length === 0) throw new Error('Nothing is changed: type a value first.');
      await this.client.set(pairs);
      this.rows.forEach(update => update());
    };
    return h(
      'details',
      { class: 'card' },
      h('summary', {}, 'Gains and settings'),
      h('p', { class: 'quiet' }, 'Each shows what is on the board. What you type is sent with “Send”, all or nothing.'),
      ...order.map(title => h('details', {}, h('summary', {}, title), ...groups.get(title)!.map(setting => this.settingRow(setting)))),
      h(
        'div',
        { class: 'actions' },
        button('Send', () => this.order(send), { class: 'primary' }),
        button('Save on the board', () => this.order(() => this.saveSettings())),
      ),
      sameBy("motorbench connect 'set speed_kp 0.05' save"),
    );
  }

  private readonly inputs = new Map<string, HTMLInputElement>();

  /** The value that was typed, where it is another than the board's. */
  private typed(setting: Setting): number | undefined {
    const text = this.inputs.get(setting.name)?.value ?? '';
    const value = Number(text);
    return text === '' || value === this.client.setting(setting.name) ? undefined : value;
  }

  private settingRow(setting: Setting): HTMLElement {
    const input = number(this.client.setting(setting.name), { id: `set-${setting.name}`, min: setting.min, max: setting.max, 'aria-describedby': `about-${setting.name}` });
    const state = h('small', {}, '');
    this.inputs.set(setting.name, input);
    const update = () => {
      input.value = String(this.client.setting(setting.name));
      tell();
    };
    const tell = () => {
      const [typed, designed, saved] = [this.typed(setting), this.designed.get(setting.name), this.saved.get(setting.name)];
      const isOut = typed !== undefined && (typed < setting.min || typed > setting.max);
      input.setAttribute('aria-invalid', String(isOut));
      state.className = typed !== undefined ? 'changed' : '';
      state.textContent = [
        isOut ? `outside ${rounded(setting.min)}…${rounded(setting.max)}` : '',
        typed !== undefined ? `board ${rounded(this.client.setting(setting.name))}` : '',
        designed !== undefined ? `designed ${rounded(designed)}` : '',
        saved !== undefined && saved !== this.client.setting(setting.name) ? `saved ${rounded(saved)}` : '',
      ].filter(Boolean).join(' · ') || `${setting.unit}`;
    };
    input.addEventListener('input', tell);
    this.rows.set(setting.name, update);
    tell();
    return h(
      'div',
      { class: 'gain' },
      h('label', { for: input.id }, setting.name),
      input,
      state,
      h('small', { id: `about-${setting.name}`, style: 'grid-column: 1 / -1' }, `${setting.help}; ${rounded(setting.min)} to ${rounded(setting.max)} ${setting.unit}`),
    );
  }

  private consolePart(): HTMLElement {
    const line = h('input', { 'aria-label': 'Line for the console', spellcheck: 'false', autocapitalize: 'off', placeholder: 'help', style: 'width: 100%' });
    const send = () => this.order(async since => {
      const text = line.value.trim();
      if (!text) return;
      if (/^(arm)\b/.test(text)) return this.arm(since);
      if (/^(stream|echo|record)\b/.test(text)) throw new Error('This page steers the stream itself: use its buttons for this.');
      line.value = '';
      await this.client.ask(text, since);
    });
    return h(
      'details',
      { class: 'card' },
      h('summary', {}, 'Console'),
      this.log,
      h('form', { onsubmit: (event: Event) => { event.preventDefault(); void send(); } }, line),
      sameBy('motorbench connect'),
    );
  }
}

interface Step {
  name: string;
  isModel: boolean;
  t_s: number[];
  value: number[];
  rise_s: number | null;
  settling_s: number | null;
  overshoot_percent: number | null;
}

function stepRow(step: Step): HTMLElement {
  const ms = (seconds: number | null) => (seconds === null ? '–' : `${rounded(1000 * seconds, 3)} ms`);
  return h('tr', {}, h('th', { scope: 'row' }, step.name), h('td', {}, ms(step.rise_s)), h('td', {}, ms(step.settling_s)), h('td', {}, step.overshoot_percent === null ? '–' : `${rounded(step.overshoot_percent, 3)} %`));
}

function overlaid(place: HTMLElement, runs: Step[]): uPlot {
  const longest = runs.reduce((one, other) => (one.t_s.length >= other.t_s.length ? one : other));
  const colours: Line['colour'][] = ['--measured', '--after', '--third', '--before'];
  const lines = runs.map((run, index): Line => ({ label: run.name, colour: run.isModel ? '--before' : colours[index % 3]!, dash: run.isModel ? [6, 4] : undefined }));
  const data = [longest.t_s, ...runs.map(run => longest.t_s.map((_, row) => run.value[row] ?? null))] as uPlot.AlignedData;
  return plotIn(place, { height: 220, scales: { x: { time: false } }, axes: axes('from the start'), series: series(lines), cursor: { drag: { x: true, y: false } } }, data);
}

/** The settings that a line of the console sets: `set NAME VALUE NAME VALUE`. */
function settingsOf(line: string): [string, number][] {
  const parts = line.split(' ');
  if (parts[0] !== 'set') return [];
  return parts.slice(1).flatMap((name, index, all): [string, number][] => (index % 2 === 0 ? [[name, Number(all[index + 1])]] : []));
}

const fixed = (value: number) => (Number.isFinite(value) ? value.toFixed(Math.abs(value) >= 100 ? 1 : 2).replace('-', '−') : '–');
const upperFirst = (text: string) => text.slice(0, 1).toUpperCase() + text.slice(1);
const withId = <T extends HTMLElement>(element: T, id: string): T => Object.assign(element, { id });
