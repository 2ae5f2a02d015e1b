/** Calls into the libraries that run in a worker, so that the page stays alive, and can give up. */

export interface Column {
  name: string;
  unit: string;
  count: number;
  values: (number | null)[];
  likely: string;
}
export interface Preview {
  format: string;
  columns: Column[];
  notes: string[];
}
export interface Summary {
  rows: number;
  is_table: boolean;
  channels: { column: string; title: string; values: (number | null)[] }[];
  ignored: string[];
  notes: string[];
  suggestion: string;
}
export interface InputFile {
  name: string;
  bytes: Uint8Array;
  columns: string[];
}
export interface RigFile {
  name: string;
  text: string;
}
export interface Result {
  outcome: string;
  report: string;
  text: string;
  verdict: string;
  model: string | undefined;
  contradictions: string[];
  /** Seconds that the diagnosis took. */
  took_s: number;
}

/** What a worker is asked, and what it answers. */
export type Order =
  | { kind: 'preview'; file: Omit<InputFile, 'columns'> }
  | { kind: 'read'; file: InputFile }
  | { kind: 'rig'; rig: RigFile }
  | { kind: 'diagnose'; files: InputFile[]; rig: RigFile | null }
  | { kind: 'channels' }
  | { kind: 'example' }
  | { kind: 'design'; rig: string; model: string; asked: string }
  | { kind: 'predict'; model: string; settings: string; mode: string; step: number; duration_s: number };
export type Answer = { progress: string } | { done: unknown } | { failed: string };

export class Cancelled extends Error {
  constructor() {
    super('Cancelled.');
  }
}

/** A worker that does one thing after the other. */
export class Analysis {
  private worker: Worker | null = null;
  private giveUp: (() => void) | null = null;
  private queue: Promise<unknown> = Promise.resolve();

  private order<T>(order: Order, progress: (text: string) => void = () => {}): Promise<T> {
    const next = this.queue.then(() => this.run<T>(order, progress));
    this.queue = next.catch(() => {});
    return next;
  }

  private run<T>(order: Order, progress: (text: string) => void): Promise<T> {
    this.worker ??= new Worker(new URL('./analysis-worker.ts', import.meta.url), { type: 'module' });
    const worker = this.worker;
    return new Promise<T>((resolve, reject) => {
      this.giveUp = () => {
        worker.terminate();
        this.worker = null;
        reject(new Cancelled());
      };
      worker.onmessage = ({ data }: MessageEvent<Answer>) => {
        if ('progress' in data) progress(data.progress);
        else if ('done' in data) resolve(data.done as T);
        else reject(new Error(data.failed));
      };
      worker.onerror = event => {
        worker.terminate();
        this.worker = null;
        reject(new Error(`A fault of motorbench: ${event.message}. Please report it, with the file.`));
      };
      worker.postMessage(order);
    });
  }

  /** Ends what is running. */
  cancel(): void {
    this.giveUp?.();
  }

  preview = (file: Omit<InputFile, 'columns'>) => this.order<Preview>({ kind: 'preview', file });
  read = (file: InputFile) => this.order<Summary>({ kind: 'read', file });
  checkRig = (rig: RigFile) => this.order<Record<string, unknown>>({ kind: 'rig', rig });
  example = () => this.order<{ csv: string; rig: string }>({ kind: 'example' });
  channels = () => this.order<[string, string][]>({ kind: 'channels' });
  diagnose = (files: InputFile[], rig: RigFile | null, progress: (text: string) => void) =>
    this.order<Result>({ kind: 'diagnose', files, rig }, progress);
  design = (rig: string, model: string, asked: object) =>
    this.order<{ commands: string[]; text: string }>({ kind: 'design', rig, model, asked: JSON.stringify(asked) });
  predict = (model: string, settings: [string, number][], mode: string, step: number, duration_s: number) =>
    this.order<Predicted>({ kind: 'predict', model, settings: JSON.stringify(settings), mode, step, duration_s });
}

export interface Predicted {
  t_s: number[];
  value: number[];
  voltage: number[];
  current: number[];
  rise_s: number | null;
  settling_s: number | null;
  overshoot_percent: number | null;
}
