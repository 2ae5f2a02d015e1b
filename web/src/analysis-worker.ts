/** The libraries in a worker. */

import init, * as libraries from './pkg/motorbench_web.js';
import type { Answer, Order } from './analysis';

const ready = init();
const answer = (message: Answer) => self.postMessage(message);

function carryOut(order: Order): unknown {
  switch (order.kind) {
    case 'preview':
      return JSON.parse(libraries.preview_file(order.file.name, order.file.bytes));
    case 'read':
      return JSON.parse(libraries.read_recording(order.file.name, order.file.bytes, order.file.columns));
    case 'rig':
      return JSON.parse(libraries.check_rig(order.rig.name, order.rig.text));
    case 'channels':
      return JSON.parse(libraries.channels());
    case 'example':
      return { csv: libraries.example_recording(), rig: libraries.example_rig() };
    case 'design':
      return JSON.parse(libraries.design_law(order.rig, order.model, order.asked));
    case 'predict':
      return JSON.parse(libraries.predict_step(order.model, order.settings, order.mode, order.step, order.duration_s));
    case 'diagnose': {
      const recordings = new libraries.Recordings();
      for (const file of order.files) recordings.add(file.name, file.bytes, file.columns);
      if (order.rig) recordings.set_rig(order.rig.name, order.rig.text);
      const contradictions = recordings.contradictions();
      const begun = performance.now();
      const found = recordings.diagnose((progress: string) => answer({ progress }));
      const took_s = (performance.now() - begun) / 1000;
      const written = `${new Date().toISOString().slice(0, 16).replace('T', ' ')} UTC, in a browser`;
      const result = {
        outcome: found.outcome(),
        report: found.report(written),
        text: found.text(),
        verdict: found.verdict(),
        model: found.model(),
        contradictions,
        took_s,
      };
      found.free();
      recordings.free();
      return result;
    }
  }
}

self.onmessage = async ({ data }: MessageEvent<Order>) => {
  try {
    await ready;
    answer({ done: carryOut(data) });
  } catch (error) {
    // A fault of the libraries leaves them in no state to go on: the page starts another worker.
    if (error instanceof WebAssembly.RuntimeError) {
      setTimeout(() => {
        throw error;
      });
      return;
    }
    answer({ failed: error instanceof Error ? error.message : String(error) });
  }
};
