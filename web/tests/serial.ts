/** A serial port for the page, whose other end is in the test: a pseudo-terminal of the simulated chip, or a bootloader. */

import { spawn, type ChildProcess } from 'node:child_process';
import { closeSync, constants, existsSync, openSync, writeSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { ReadStream } from 'node:tty';
import type { Page } from '@playwright/test';
import { program } from './help';

/** The other end of the line. */
export interface FarEnd {
  /** The page has opened the port. */
  opened(baud: number): void;
  closed(): void;
  /** The reset line goes low. */
  reset(): void;
  take(bytes: Buffer): void;
  /** Set by the port. */
  send: (bytes: Buffer) => void;
}

export interface Port {
  /** Pulls the cable. */
  unplug(): Promise<void>;
}

/** Gives the page `navigator.serial` with one port. */
export async function connectTo(page: Page, end: FarEnd): Promise<Port> {
  let waiting: Buffer[] = [];
  let isSending = false;
  const flush = async () => {
    if (isSending) return;
    isSending = true;
    while (waiting.length > 0) {
      const bytes = Buffer.concat(waiting).toString('base64');
      waiting = [];
      await page.evaluate(text => (window as never as { fromBoard(text: string): void }).fromBoard(text), bytes).catch(() => {});
    }
    isSending = false;
  };
  end.send = bytes => {
    waiting.push(bytes);
    void flush();
  };
  await page.exposeFunction('toBoard', (what: string, text: string) => {
    if (what === 'open') end.opened(Number(text));
    else if (what === 'close') end.closed();
    else if (what === 'reset') end.reset();
    else end.take(Buffer.from(text, 'base64'));
  });
  await page.addInitScript(() => {
    const outside = window as never as { toBoard(what: string, text: string): Promise<void>; fromBoard(text: string): void; unplug(): void };
    let incoming: ReadableStreamDefaultController<Uint8Array> | null = null;
    outside.fromBoard = text => {
      try {
        incoming?.enqueue(Uint8Array.from(atob(text), sign => sign.charCodeAt(0)));
      } catch {
        // The page has closed the port.
      }
    };
    const port = {
      readable: null as ReadableStream<Uint8Array> | null,
      writable: null as WritableStream<Uint8Array> | null,
      async open({ baudRate }: { baudRate: number }) {
        port.readable = new ReadableStream({ start: controller => void (incoming = controller) });
        port.writable = new WritableStream({ write: bytes => outside.toBoard('bytes', btoa(String.fromCharCode(...bytes))) });
        await outside.toBoard('open', String(baudRate));
      },
      async close() {
        incoming = null;
        port.readable = port.writable = null;
        await outside.toBoard('close', '');
      },
      async setSignals({ dataTerminalReady }: { dataTerminalReady?: boolean }) {
        if (dataTerminalReady) await outside.toBoard('reset', '');
      },
    };
    outside.unplug = () => {
      const gone = incoming;
      incoming = null;
      port.readable = null;
      gone?.error(new DOMException('The device has been lost.', 'NetworkError'));
    };
    Object.defineProperty(navigator, 'serial', { value: { requestPort: async () => port } });
  });
  return { unplug: () => page.evaluate(() => (window as never as { unplug(): void }).unplug()) };
}

/** The firmware on the simulated chip. */
export class Chip implements FarEnd {
  send: FarEnd['send'] = () => {};
  /** Changes bytes on their way to the page. */
  disturb: (bytes: Buffer) => Buffer[] = bytes => [bytes];
  private process: ChildProcess | null = null;
  private descriptor = -1;
  private stream: ReadStream | null = null;
  /** The port, for programs other than the page. */
  readonly link = join(tmpdir(), `motorbench-web-${process.pid}-${Date.now()}`);

  /** Starts the board and holds its port. */
  async start(): Promise<void> {
    await this.power();
    this.descriptor = openSync(this.link, constants.O_RDWR | constants.O_NOCTTY | constants.O_NONBLOCK);
    this.stream = new ReadStream(this.descriptor);
    this.stream.setRawMode(true);
    this.stream.on('data', bytes => this.disturb(bytes as Buffer).forEach(part => this.send(part)));
    this.stream.on('error', () => {});
  }

  /** Starts the board; its port is free. */
  async power(): Promise<void> {
    this.process = spawn(program(), ['virtual', '--link', this.link, '--json', '--wait-for-reader', '5'], { stdio: ['pipe', 'pipe', 'inherit'] });
    await new Promise<void>((resolve, reject) => {
      this.process!.stdout!.once('data', () => resolve());
      this.process!.once('exit', code => reject(new Error(`motorbench virtual ended (${code})`)));
    });
    if (!existsSync(this.link)) throw new Error('the virtual board has no port');
  }

  /** A line as `motorbench virtual` takes it. */
  tell(line: string): void {
    this.process!.stdin!.write(`${line}\n`);
  }
  opened(): void {}
  closed(): void {}
  reset(): void {}
  take(bytes: Buffer): void {
    writeSync(this.descriptor, bytes);
  }
  end(): void {
    this.process?.stdin?.write('quit\n');
    this.process?.kill();
    this.stream?.destroy();
    if (this.descriptor < 0) return;
    try {
      closeSync(this.descriptor);
    } catch {
      // The stream has closed it.
    }
  }
}

/** A bootloader as Optiboot, with the memory of a chip. */
export class Optiboot implements FarEnd {
  send: FarEnd['send'] = () => {};
  readonly memory = Buffer.alloc(32 * 1024, 0xff);
  signature = [0x1e, 0x95, 0x0f];
  /** Flips a bit of what is written. */
  isFaulty = false;
  isDone = false;
  private baud = 0;
  private isListening = false;
  private address = 0;
  private came = Buffer.alloc(0);

  opened(baud: number): void {
    this.baud = baud;
  }
  closed(): void {}
  reset(): void {
    // Noise of the line, as a board that starts may send it.
    this.isListening = true;
    this.came = Buffer.alloc(0);
    this.send(Buffer.from([0x00, 0xff]));
  }
  take(bytes: Buffer): void {
    if (!this.isListening || this.baud !== 115_200) return;
    this.came = Buffer.concat([this.came, bytes]);
    while (this.command());
  }

  private answer(...bytes: number[]): void {
    // In parts, as USB brings them.
    const whole = Buffer.from([0x14, ...bytes, 0x10]);
    this.send(whole.subarray(0, 1));
    this.send(whole.subarray(1));
  }

  private command(): boolean {
    const [what = 0, high = 0, low = 0] = this.came;
    const count = what === 0x64 ? high * 256 + low : 0;
    const length = { 0x30: 2, 0x50: 2, 0x51: 2, 0x75: 2, 0x55: 4, 0x74: 5, 0x64: 5 + count }[what];
    if (this.came.length === 0) return false;
    if (length === undefined) {
      this.came = this.came.subarray(1);
      return true;
    }
    if (this.came.length < length) return false;
    const whole = this.came.subarray(0, length);
    this.came = this.came.subarray(length);
    if (what === 0x75) this.answer(...this.signature);
    else if (what === 0x55) {
      this.address = (whole[1]! + whole[2]! * 256) * 2;
      this.answer();
    } else if (what === 0x64) {
      whole.copy(this.memory, this.address, 4, 4 + count);
      if (this.isFaulty) this.memory[this.address + 5]! ^= 1;
      this.answer();
    } else if (what === 0x74) this.answer(...this.memory.subarray(this.address, this.address + high * 256 + low));
    else {
      this.isDone ||= what === 0x51;
      this.answer();
    }
    return this.came.length > 0;
  }
}
