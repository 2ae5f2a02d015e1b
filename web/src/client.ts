/** A client of the board's console: lines out, answers and samples in. The format is in `docs/reference/protocol.md`. */

import { Receiver } from './pkg/motorbench_web.js';
import type { Transport } from './transport';

/** The board trips when it has heard nothing for `trip_host`; this is well within it. */
const KEEP_ALIVE_MS = 100;
const CALL_MS = 300;
const START_MS = 8000;
const ANSWER_MS = 4000;
/** An answer that was damaged is asked for again after this long. */
const DAMAGED_MS = 250;
/** The answer to a line that went ahead of all others comes within this time. */
const STRAY_MS = 60;
const TRIES = 10;
/** Telemetry may pause this long. */
const SILENCE_MS = 1000;
/** Numbers of a sample. */
export const COLUMNS = 10;

export class Refused extends Error {}
export class Silent extends Error {}
export class Stopped extends Error {}

export interface Shown {
  name: string;
  value: number;
  unit: string;
}

const encoder = new TextEncoder();
const pause = (ms: number) => new Promise(resolve => setTimeout(resolve, ms));

export class Client {
  readonly receiver = new Receiver();
  firmware = '';
  /** What the board shows of its settings. */
  readonly settings = new Map<string, number>();
  onsamples: (samples: Float64Array) => void = () => {};
  /** Text that nobody asked for. */
  onmessage: (line: string) => void = () => {};
  ongone: (why: string) => void = () => {};
  /** Every line and its answer, for the log. */
  onlog: (line: string) => void = () => {};
  isGone = false;
  /** How often the drive was switched off from this page. Nothing that was ordered before is sent after it. */
  stops = 0;

  private reply = '';
  private waiter: (() => void) | null = null;
  private queue: Promise<unknown> = Promise.resolve();
  private queued = 0;
  private isStreaming = false;
  private heard = performance.now();
  private tail = '';
  private ticker: Worker | null = null;
  private trippedHost = 0;

  constructor(readonly transport: Transport) {
    transport.onbytes = bytes => this.take(bytes);
    transport.onclose = why => this.lose(why);
  }

  /** Waits for the firmware, reads its settings, and has it stream. */
  async start(version: string): Promise<void> {
    this.firmware = await this.call();
    const its = this.firmware.replace(/^motorbench ([^,\s]+).*$/s, '$1');
    if (its !== version) {
      throw new Error(`The board runs motorbench ${its}, this page is ${version}: put this page’s firmware on the board (button “Put the firmware on the board”).`);
    }
    this.receiver.set_binary(true);
    this.isStreaming = true;
    await this.ask('stream binary');
    await this.readSettings();
    this.heard = performance.now();
    this.ticker = new Worker(new URL('./ticker-worker.ts', import.meta.url), { type: 'module' });
    this.ticker.onmessage = () => this.tick();
    this.ticker.postMessage(KEEP_ALIVE_MS);
  }

  /** Calls until the firmware says its version, as text. A board that was streaming is stopped first. */
  private async call(): Promise<string> {
    const end = performance.now() + START_MS;
    this.receiver.set_binary(false);
    while (performance.now() < end && !this.isGone) {
      this.receiver.text();
      // Ctrl-U: what an earlier client has left unfinished must not be carried out.
      await this.write('\x15\nstream off\necho off\nversion\n');
      await pause(CALL_MS);
      const text = this.receiver.text();
      const found = /motorbench [^\n]*/g;
      const version = [...text.matchAll(found)].at(-1)?.[0];
      if (version && text.endsWith('ok\n')) return version;
    }
    if (this.isGone) throw new Error('The line to the board is gone: check the cable.');
    throw new Silent('No answer. Is it an Uno or a Nano with this firmware? “Put the firmware on the board” writes it.');
  }

  private write(text: string): Promise<void> {
    return this.transport.write(encoder.encode(text));
  }

  private take(bytes: Uint8Array): void {
    this.heard = performance.now();
    this.receiver.push(bytes);
    if (!this.isStreaming) return;
    this.watchForReset(bytes);
    const samples = this.receiver.samples();
    if (samples.length > 0) this.onsamples(samples);
    const text = this.receiver.text();
    if (text) this.hear(text);
  }

  private hear(text: string): void {
    this.reply += text;
    if (this.waiter) return this.waiter();
    // Whole lines that belong to no answer.
    const end = this.reply.lastIndexOf('\n') + 1;
    for (const line of this.reply.slice(0, end).split('\n')) {
      if (line.startsWith('# ')) this.onmessage(line.slice(2));
    }
    this.reply = this.reply.slice(end);
  }

  /** A board greets after a reset, outside of any frame. */
  private watchForReset(bytes: Uint8Array): void {
    this.tail = (this.tail + String.fromCharCode(...bytes.slice(-512))).slice(-600);
    if (!/# motorbench [^\n]*\r\n# reset: /.test(this.tail)) return;
    this.tail = '';
    this.lose('The board was reset, so its drive is off. Connect again.');
  }

  /**
   * The answer to a line, without `# ` and without its end. One line is asked at a time.
   * `since`: the count of stops when the person ordered it; a later stop cancels it.
   */
  ask(line: string, since = this.stops): Promise<string[]> {
    this.queued += 1;
    const next = this.queue.then(() => this.askNow(line, since));
    this.queue = next.catch(() => {}).finally(() => (this.queued -= 1));
    return next;
  }

  private async askNow(line: string, since: number): Promise<string[]> {
    for (let tried = 1; ; tried++) {
      if (this.isGone) throw new Error('The line to the board is gone.');
      if (since !== this.stops) throw new Stopped('Stopped.');
      const before = this.receiver.losses()[0]!;
      this.reply = '';
      await this.write(`\n${line}\n`);
      const answer = await this.answer(before);
      if (answer === null) {
        const isLossy = this.receiver.losses()[0] !== before;
        if (!isLossy || tried >= TRIES) throw new Silent(`No answer to “${line}”: check the cable.`);
        await this.letPass();
        continue;
      }
      const last = answer.at(-1)!;
      if (line !== 'alive') this.onlog(`> ${line}\n${answer.join('\n')}`);
      if (last.startsWith('error: ')) {
        const isLossy = this.receiver.losses()[0] !== before;
        if (isLossy && tried < TRIES) continue;
        throw new Refused(last.slice(7));
      }
      return answer.filter(said => said.startsWith('# ')).map(said => said.slice(2));
    }
  }

  /** A late answer must not be taken for that of the next line. Meanwhile the board hears that this page is there. */
  private async letPass(): Promise<void> {
    for (let waited = 0; waited < DAMAGED_MS; waited += KEEP_ALIVE_MS) {
      await this.write('\nalive\n');
      await pause(KEEP_ALIVE_MS);
    }
  }

  private answer(lostBefore: number): Promise<string[] | null> {
    const begun = performance.now();
    return new Promise(resolve => {
      const finish = (answer: string[] | null) => {
        clearInterval(clock);
        this.waiter = null;
        resolve(answer);
      };
      this.waiter = () => {
        const reply = this.reply.replace(/# saved\n$/, '');
        const end = /(?:^|\n)(ok|error: [^\n]*)\n$/.exec(reply);
        if (!end) return;
        this.reply = '';
        finish(reply.trimEnd().split('\n'));
      };
      const clock = setInterval(() => {
        const waited = performance.now() - begun;
        const isLossy = this.receiver.losses()[0] !== lostBefore;
        if (waited > ANSWER_MS || this.isGone || (isLossy && waited > DAMAGED_MS)) finish(null);
      }, 20);
    });
  }

  private async readSettings(): Promise<void> {
    for (const line of await this.ask('show')) this.note(line);
  }

  private note(line: string): Shown {
    const [name, value, unit] = line.split(' ') as [string, string, string];
    const shown = { name, value: Number(value), unit };
    this.receiver.set_setting(name, shown.value);
    this.settings.set(name, shown.value);
    return shown;
  }

  /** Changes settings, all or none, and reads them back. */
  async set(pairs: [name: string, value: number][]): Promise<void> {
    // A line has at most 63 characters that are safe while the board is busy.
    let rest = pairs.map(([name, value]) => `${name} ${value}`);
    while (rest.length > 0) {
      let count = 1;
      while (count < rest.length && `set ${rest.slice(0, count + 1).join(' ')}`.length <= 62) count++;
      await this.ask(`set ${rest.slice(0, count).join(' ')}`);
      rest = rest.slice(count);
    }
    for (const [name] of pairs) {
      for (const line of await this.ask(`show ${name}`)) this.note(line);
    }
  }

  get setting(): (name: string) => number {
    return name => this.settings.get(name) ?? NaN;
  }

  /** Arms; the board stops by itself when this page is gone. */
  async arm(lostAfterMs: number, since = this.stops): Promise<void> {
    if (!(this.setting('trip_host') > 0)) {
      await this.set([['trip_host', lostAfterMs]]);
      this.trippedHost = lostAfterMs;
    }
    await this.ask('arm', since);
  }

  /** Off at once: ahead of all lines that wait, which are not sent any more. */
  async stop(): Promise<void> {
    this.stops += 1;
    await this.write('\ndisarm\n').catch(() => {});
    // Its answer belongs to no line that waits: the next line is sent when it has come.
    this.queue = this.queue.then(() => pause(STRAY_MS));
    await this.ask('disarm').catch(() => {});
  }

  private tick(): void {
    if (this.isGone) return;
    if (performance.now() - this.heard > SILENCE_MS) {
      return this.lose('The board is silent. Check the cable, then connect again. Its drive stops by itself.');
    }
    if (this.queued === 0) this.ask('alive').catch(() => {});
  }

  private lose(why: string): void {
    if (this.isGone) return;
    this.isGone = true;
    this.ticker?.terminate();
    this.ongone(why);
  }

  /** Leaves the board as it was: drive off, its own `trip_host`, text. */
  async close(): Promise<void> {
    if (!this.isGone) {
      await this.stop();
      if (this.trippedHost) await this.ask('set trip_host 0').catch(() => {});
      this.isGone = true;
      this.ticker?.terminate();
      await this.write('\nstream off\necho on\n').catch(() => {});
      await pause(50);
    }
    this.isGone = true;
    await this.transport.close();
  }
}
