/** The virtual board, stepped in real time. */

import init, { VirtualBoard } from './pkg/motorbench_web.js';
import type { VirtualOrder, VirtualSaid } from './transport';

/** How often the board is stepped, and the longest time that is made up for: a computer that slept wakes up without. */
const STEP_MS = 10;
const LONGEST_S = 0.25;
/** So many messages may wait for the page. Then time is held: a busy computer’s delays are not the board’s. */
const MOST_WAITING = 8;

let board: VirtualBoard | null = null;
let last = 0;
let waiting = 0;

const say = (said: VirtualSaid, moved: Transferable[] = []) => self.postMessage(said, { transfer: moved });

function step() {
  if (!board) return;
  const now = performance.now();
  if (waiting >= MOST_WAITING) {
    last = now;
    return;
  }
  const bytes = board.advance(Math.min((now - last) / 1000, LONGEST_S));
  last = now;
  if (bytes.length === 0) return;
  waiting += 1;
  say({ bytes }, [bytes.buffer]);
}

self.onmessage = async ({ data }: MessageEvent<VirtualOrder>) => {
  try {
    if ('start' in data) {
      await init();
      board = data.start.code ? VirtualBoard.of_code(data.start.code) : new VirtualBoard(data.start.model ?? '');
      last = performance.now();
      setInterval(step, STEP_MS);
      say({ ready: true });
    } else if ('taken' in data) {
      waiting -= 1;
    } else if (!board) {
      return;
    } else if ('bytes' in data) {
      step();
      board.receive(data.bytes);
      step();
    } else if ('set' in data) {
      board.set(data.set, data.value);
    } else if ('model' in data) {
      board.set_model(data.model);
    } else {
      board.reset();
    }
  } catch (error) {
    say({ failed: error instanceof Error ? error.message : String(error) });
  }
};
