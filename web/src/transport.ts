/** Lines to a board: a serial port of the browser, the program's bridge to one, or the virtual board in a worker. */

export interface Transport {
  readonly name: string;
  readonly isVirtual: boolean;
  /** Called with bytes from the board. */
  onbytes: (bytes: Uint8Array) => void;
  /** Called when the line is gone. */
  onclose: (why: string) => void;
  write(bytes: Uint8Array): Promise<void>;
  /** Pulls the reset line of a board, where the line can. */
  reset(): Promise<void>;
  /** Changes the speed of the line; the board of a bridge keeps its own. */
  setSpeed(baud: number): Promise<void>;
  close(): Promise<void>;
}

export const FIRMWARE_BAUD = 500_000;
export const BOOTLOADER_BAUD = 115_200;
/** Room for two seconds of telemetry: a busy page loses nothing. */
const BUFFER_BYTES = 65_536;

const pause = (ms: number) => new Promise(resolve => setTimeout(resolve, ms));

export class SerialTransport implements Transport {
  readonly name = 'the board on USB';
  readonly isVirtual = false;
  onbytes: Transport['onbytes'] = () => {};
  onclose: Transport['onclose'] = () => {};
  private reader: ReadableStreamDefaultReader<Uint8Array> | null = null;
  private writer: WritableStreamDefaultWriter<Uint8Array> | null = null;
  private reading: Promise<void> = Promise.resolve();
  private isClosing = false;

  private constructor(private readonly port: SerialPort) {}

  static isThere(): boolean {
    return 'serial' in navigator;
  }

  /** Asks the person for a port. */
  static async choose(baud = FIRMWARE_BAUD): Promise<SerialTransport> {
    const transport = new SerialTransport(await navigator.serial!.requestPort());
    await transport.open(baud);
    return transport;
  }

  private async open(baud: number): Promise<void> {
    await this.port.open({ baudRate: baud, bufferSize: BUFFER_BYTES });
    this.isClosing = false;
    this.reader = this.port.readable!.getReader();
    this.writer = this.port.writable!.getWriter();
    this.reading = this.read();
  }

  private async read(): Promise<void> {
    let why = 'The line to the board is gone: check the cable.';
    while (this.port.readable && !this.isClosing) {
      try {
        for (;;) {
          const { value, done } = await this.reader!.read();
          if (done) break;
          this.onbytes(value);
        }
        break;
      } catch (error) {
        // A break or a wrong parity ends only the present stream: the port gives another one.
        why = `The line to the board is gone (${error instanceof Error ? error.message : error}): check the cable.`;
        this.reader!.releaseLock();
        if (!this.port.readable) break;
        this.reader = this.port.readable.getReader();
      }
    }
    if (!this.isClosing) this.onclose(why);
  }

  async write(bytes: Uint8Array): Promise<void> {
    await this.writer!.write(bytes);
  }

  async reset(): Promise<void> {
    await this.port.setSignals({ dataTerminalReady: false, requestToSend: false });
    await pause(250);
    await this.port.setSignals({ dataTerminalReady: true, requestToSend: true });
    await pause(50);
  }

  async setSpeed(baud: number): Promise<void> {
    await this.end();
    await this.open(baud);
  }

  private async end(): Promise<void> {
    this.isClosing = true;
    await this.reader?.cancel().catch(() => {});
    this.reader?.releaseLock();
    await this.reading;
    await this.writer?.close().catch(() => {});
    this.writer?.releaseLock();
    await this.port.close().catch(() => {});
  }

  async close(): Promise<void> {
    await this.end();
  }
}

/** The port of `motorbench web`: bytes as binary messages, orders as text. */
export class BridgeTransport implements Transport {
  readonly isVirtual = false;
  onbytes: Transport['onbytes'] = () => {};
  onclose: Transport['onclose'] = () => {};
  private constructor(private readonly socket: WebSocket, readonly name: string) {}

  /** The address of the bridge, where the program serves the page. */
  static address(): string | null {
    const token = new URLSearchParams(location.search).get('token') ?? sessionStorage.getItem('token');
    if (!token || !['127.0.0.1', 'localhost'].includes(location.hostname)) return null;
    sessionStorage.setItem('token', token);
    return `ws://${location.host}/port?token=${encodeURIComponent(token)}`;
  }

  static open(address: string): Promise<BridgeTransport> {
    const socket = new WebSocket(address);
    socket.binaryType = 'arraybuffer';
    return new Promise((resolve, reject) => {
      const transport = new BridgeTransport(socket, 'the board behind motorbench web');
      socket.onmessage = ({ data }) => {
        if (typeof data !== 'string') return transport.onbytes(new Uint8Array(data as ArrayBuffer));
        const said = JSON.parse(data) as { open?: string; error?: string };
        if (said.error) reject(new Error(said.error));
        else resolve(transport);
      };
      socket.onclose = () => {
        reject(new Error('motorbench web has ended: start it again.'));
        transport.onclose('The line to the board is gone: check the cable, and that motorbench web runs.');
      };
    });
  }

  async write(bytes: Uint8Array): Promise<void> {
    this.socket.send(bytes as Uint8Array<ArrayBuffer>);
  }
  async reset(): Promise<void> {
    this.socket.send(JSON.stringify({ reset: true }));
    await pause(350);
  }
  async setSpeed(baud: number): Promise<void> {
    this.socket.send(JSON.stringify({ baud }));
    await pause(200);
  }
  async close(): Promise<void> {
    this.socket.onclose = null;
    this.socket.close();
  }
}

/** What the worker of the virtual board is told, and what it says. */
export type VirtualOrder =
  | { start: { model?: string; code?: string } }
  | { bytes: Uint8Array }
  | { set: string; value: number }
  | { model: string }
  | { reset: true }
  /** The page has taken a message with bytes. */
  | { taken: true };
export type VirtualSaid = { bytes: Uint8Array } | { ready: true } | { failed: string };

export class VirtualTransport implements Transport {
  readonly name = 'the virtual board';
  readonly isVirtual = true;
  onbytes: Transport['onbytes'] = () => {};
  onclose: Transport['onclose'] = () => {};
  private readonly worker = new Worker(new URL('./virtual-worker.ts', import.meta.url), { type: 'module' });

  static start(start: { model?: string; code?: string }): Promise<VirtualTransport> {
    const transport = new VirtualTransport();
    return new Promise((resolve, reject) => {
      transport.worker.onmessage = ({ data }: MessageEvent<VirtualSaid>) => {
        if ('bytes' in data) {
          transport.onbytes(data.bytes);
          transport.tell({ taken: true });
        } else if ('ready' in data) resolve(transport);
        else reject(new Error(data.failed));
      };
      transport.worker.onerror = event => transport.onclose(`A fault of the virtual board: ${event.message}`);
      transport.tell({ start });
    });
  }

  tell(order: VirtualOrder): void {
    this.worker.postMessage(order);
  }
  async write(bytes: Uint8Array): Promise<void> {
    this.tell({ bytes });
  }
  async reset(): Promise<void> {
    this.tell({ reset: true });
  }
  async setSpeed(): Promise<void> {}
  async close(): Promise<void> {
    this.worker.terminate();
  }
}

declare global {
  /** What is used of Web Serial. */
  interface SerialPort {
    readable: ReadableStream<Uint8Array> | null;
    writable: WritableStream<Uint8Array> | null;
    open(options: { baudRate: number; bufferSize?: number }): Promise<void>;
    close(): Promise<void>;
    setSignals(signals: { dataTerminalReady?: boolean; requestToSend?: boolean }): Promise<void>;
  }
  interface Navigator {
    readonly serial?: { requestPort(options?: object): Promise<SerialPort> };
  }
}
