/** A result: the sentence, the causes, what to do, the files, and the program's report, live in a frame. */

import type { Result } from './analysis';
import { button, h, message, rounded, sameBy, save, words } from './ui';

interface Outcome {
  verdict: string;
  causes: { effect: string; confidence: number; parameters: Record<string, { value: number; interval?: [number, number] }> }[];
  advice: string[];
}

export function resultView(
  result: Result,
  files: { base: string; csv?: string; rig?: string; command: string },
): HTMLElement {
  const outcome = JSON.parse(result.outcome) as Outcome;
  const cause = ({ effect, confidence, parameters }: Outcome['causes'][number]) => {
    const constants = Object.entries(parameters).map(([name, { value }]) => `${name.replaceAll('_', ' ')} ${rounded(value, 3)}`);
    return h(
      'li',
      {},
      h('strong', {}, words(effect)),
      h('span', { class: 'quiet' }, `  ${constants.join(', ')} · confidence ${Math.round(100 * confidence)} %`),
    );
  };
  const advice = outcome.advice ?? [];
  return h(
    'section',
    { class: 'result', 'aria-label': 'Result' },
    h('h2', { class: 'verdict', tabindex: -1 }, result.verdict),
    ...result.contradictions.map(note => message('note', note)),
    outcome.causes.length > 0
      ? h('div', { class: 'card' }, h('h3', {}, 'What it is'), h('ul', { class: 'causes' }, ...outcome.causes.map(cause)))
      : null,
    advice.length > 0
      ? h('div', { class: 'card' }, h('h3', {}, 'What to do'), h('ul', {}, ...advice.map(line => h('li', {}, line))))
      : null,
    h(
      'div',
      { class: 'actions' },
      button('Save report', () => save(`${files.base}-diagnosis.html`, result.report, 'text/html'), { class: 'primary' }),
      result.model ? button('Save model', () => save(`${files.base}.model.toml`, result.model!)) : null,
      files.rig ? button('Save rig', () => save(`${files.base}.rig.toml`, files.rig!)) : null,
      files.csv ? button('Save recording', () => save(`${files.base}.csv`, files.csv!, 'text/csv')) : null,
      button('Save JSON', () => save(`${files.base}.json`, result.outcome, 'application/json')),
      h('span', { class: 'quiet' }, `Computed here in ${rounded(result.took_s, 3)} s.`),
    ),
    sameBy(files.command),
    reportFrame(result.report),
  );
}

/** The report keeps to itself: it runs its two scripts, and can reach nothing of this page. */
function reportFrame(html: string): HTMLIFrameElement {
  const frame = h('iframe', { class: 'report', title: 'Report with plots', sandbox: 'allow-scripts', scrolling: 'no' });
  frame.srcdoc = html;
  const fit = (event: MessageEvent) => {
    if (event.source !== frame.contentWindow) return;
    const height = Number((event.data as { height?: unknown })?.height);
    if (height > 0 && height < 100_000) frame.style.height = `${Math.ceil(height)}px`;
    if (!frame.isConnected) removeEventListener('message', fit);
  };
  addEventListener('message', fit);
  return frame;
}
