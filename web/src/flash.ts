/** Puts a program on an Uno or Nano: STK500 version 1, as its bootloader Optiboot speaks it. */

import { BOOTLOADER_BAUD, type Transport } from './transport';

const OK = 0x10;
const IN_SYNC = 0x14;
const END = 0x20;
const GET_SYNC = 0x30;
const ENTER = 0x50;
const LEAVE = 0x51;
const LOAD_ADDRESS = 0x55;
const WRITE_PAGE = 0x64;
const READ_PAGE = 0x74;
const READ_SIGNATURE = 0x75;
const FLASH = 0x46;
const PAGE_BYTES = 128;
/** What the bootloader leaves for a program. */
const FLASH_BYTES = 32 * 1024 - 512;
const SIGNATURE = [0x1e, 0x95, 0x0f];
const ANSWER_MS = 1000;
/** The bootloader starts within this many tries: after the reset, or after the second one. */
const SYNC_TRIES = 12;
const SYNC_MS = 200;
const RESETS = 2;

export class FlashError extends Error {}

/** The bytes of a program in Intel's HEX format, from address 0. */
export function hexBytes(text: string): Uint8Array {
  const memory = new Uint8Array(FLASH_BYTES).fill(0xff);
  let [length, base, isWhole] = [0, 0, false];
  text.split(/\r?\n/).forEach((line, index) => {
    if (!line.trim() || isWhole) return;
    const wrong = (what: string) => new FlashError(`firmware, line ${index + 1}: ${what}`);
    if (!/^:([0-9a-f]{2}){5,}$/i.test(line.trim())) throw wrong('this is no line of an Intel HEX file');
    const bytes = line.trim().slice(1).match(/../g)!.map(pair => parseInt(pair, 16));
    if (bytes.reduce((sum, byte) => sum + byte, 0) % 256 !== 0) throw wrong('its check sum is wrong');
    const [count, high, low, kind] = bytes as [number, number, number, number];
    const data = bytes.slice(4, -1);
    if (data.length !== count) throw wrong('its length is wrong');
    if (kind === 1) isWhole = true;
    else if (kind === 2) base = (data[0]! * 256 + data[1]!) * 16;
    else if (kind === 4) base = (data[0]! * 256 + data[1]!) * 65_536;
    else if (kind === 0) {
      const address = base + high * 256 + low;
      if (address + count > FLASH_BYTES) throw wrong('the program is too large for an Uno');
      memory.set(data, address);
      length = Math.max(length, address + count);
    }
  });
  if (!isWhole || length === 0) throw new FlashError('the firmware file is not whole');
  return memory.slice(0, Math.ceil(length / PAGE_BYTES) * PAGE_BYTES);
}

class Bootloader {
  private came: number[] = [];
  private waiter: (() => void) | null = null;

  constructor(private readonly transport: Transport) {
    transport.onbytes = bytes => {
      this.came.push(...bytes);
      this.waiter?.();
    };
  }

  forget(): void {
    this.came = [];
  }

  private wait(count: number, ms: number): Promise<boolean> {
    if (this.came.length >= count) return Promise.resolve(true);
    return new Promise(resolve => {
      const finish = (there: boolean) => {
        clearTimeout(clock);
        this.waiter = null;
        resolve(there);
      };
      const clock = setTimeout(() => finish(false), ms);
      this.waiter = () => this.came.length >= count && finish(true);
    });
  }

  /** Sends a command; the bytes between `in sync` and `ok`. */
  async command(what: string, bytes: number[], answers = 0, ms = ANSWER_MS): Promise<number[]> {
    this.forget();
    await this.transport.write(new Uint8Array([...bytes, END]));
    if (!(await this.wait(answers + 2, ms))) throw new FlashError(`the bootloader does not answer (${what})`);
    const [first, ...rest] = this.came;
    if (first !== IN_SYNC || rest[answers] !== OK) throw new FlashError(`the bootloader answers something else (${what})`);
    return rest.slice(0, answers);
  }

  async synchronise(): Promise<void> {
    for (let tried = 0; tried < SYNC_TRIES; tried++) {
      try {
        await this.command('sync', [GET_SYNC], 0, SYNC_MS);
        return;
      } catch {
        // It may not have started, or not be through with what came before.
      }
    }
    throw new FlashError('no bootloader answers: is this an Uno or a Nano? Old Nanos have a bootloader of 57,600 baud, which this page does not speak');
  }

  async address(bytes: number): Promise<void> {
    const words = bytes >> 1;
    await this.command('address', [LOAD_ADDRESS, words & 255, words >> 8]);
  }
}

/** Writes the program and reads it back. `progress` hears shares from 0 to 1. */
export async function flash(transport: Transport, program: Uint8Array, progress: (what: string, share: number) => void): Promise<void> {
  const bootloader = new Bootloader(transport);
  await transport.setSpeed(BOOTLOADER_BAUD);
  progress('waiting for the bootloader', 0);
  for (let resets = 1; ; resets++) {
    await transport.reset();
    try {
      await bootloader.synchronise();
      break;
    } catch (error) {
      if (resets >= RESETS) throw error;
    }
  }
  const signature = await bootloader.command('signature', [READ_SIGNATURE], 3);
  if (signature.some((byte, index) => byte !== SIGNATURE[index])) {
    const shown = signature.map(byte => byte.toString(16).padStart(2, '0')).join(' ');
    throw new FlashError(`this is another chip (signature ${shown}); the firmware is for the ATmega328P`);
  }
  await bootloader.command('begin', [ENTER]);
  const pages = program.length / PAGE_BYTES;
  for (let page = 0; page < pages; page++) {
    const bytes = program.subarray(page * PAGE_BYTES, (page + 1) * PAGE_BYTES);
    await bootloader.address(page * PAGE_BYTES);
    await bootloader.command('write', [WRITE_PAGE, 0, PAGE_BYTES, FLASH, ...bytes]);
    progress('writing', (page + 1) / pages / 2);
  }
  for (let page = 0; page < pages; page++) {
    await bootloader.address(page * PAGE_BYTES);
    const read = await bootloader.command('read', [READ_PAGE, 0, PAGE_BYTES, FLASH], PAGE_BYTES);
    const wrong = read.findIndex((byte, index) => byte !== program[page * PAGE_BYTES + index]);
    if (wrong >= 0) {
      const address = (page * PAGE_BYTES + wrong).toString(16).padStart(4, '0');
      throw new FlashError(`the board holds another byte than was written, at 0x${address}: try again, with a shorter cable`);
    }
    progress('reading back', 0.5 + (page + 1) / pages / 2);
  }
  await bootloader.command('end', [LEAVE]);
}
