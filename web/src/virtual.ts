/** What hands do at the virtual bench: load, brake, faults, another motor; and the answer to a class code. */

import type { VirtualTransport } from './transport';
import { button, field, h, message, rounded, save, select, words } from './ui';
import type { Libraries } from './wasm';
import type { Result } from './analysis';

/** What the teacher's page reads. */
export interface ClassResult {
  motorbench_class: 1;
  code: string;
  name: string;
  answer: string;
  is_right: boolean;
  tries: number;
  verdict: string;
  found: string[];
}

interface Slider {
  label: string;
  unit: string;
  min: number;
  max: number;
  step: number;
  value: number;
  set: (value: number) => void;
}

function slider({ label, unit, min, max, step, value, set }: Slider): HTMLElement {
  const id = `slider-${label.replace(/\W+/g, '-').toLowerCase()}`;
  const output = h('output', { for: id }, `${rounded(value)} ${unit}`);
  const input = h('input', {
    type: 'range',
    id,
    min,
    max,
    step,
    value,
    oninput: () => {
      output.textContent = `${rounded(Number(input.value))} ${unit}`;
      set(Number(input.value));
    },
  });
  return h('div', { class: 'slider' }, h('label', { for: id }, label), input, output);
}

export function virtualPanel(
  transport: VirtualTransport,
  libraries: Libraries,
  code: string | null,
  model: string,
  result: () => Result | null,
): HTMLElement {
  const tell = (what: string) => (value: number) => transport.tell({ set: what, value });
  const check = (label: string, what: string) => {
    const input = h('input', { type: 'checkbox', onchange: () => tell(what)(Number(input.checked)) });
    return h('label', { class: 'check' }, input, label);
  };
  const hands = h(
    'section',
    { class: 'card', 'aria-label': 'Hands at the bench' },
    h('h2', {}, 'Hands at the bench'),
    slider({ label: 'Load torque', unit: 'mNm', min: -60, max: 60, step: 1, value: 0, set: value => tell('load_Nm')(value / 1000) }),
    slider({ label: 'Brake', unit: 'mNm', min: 0, max: 60, step: 1, value: 0, set: value => tell('brake_Nm')(value / 1000) }),
    slider({ label: 'Supply', unit: 'V', min: 6, max: 18, step: 0.1, value: 12, set: tell('supply_V') }),
    h('h3', {}, 'Faults'),
    check('Rotor held fast', 'blocked'),
    check('Encoder unplugged', 'encoder_unplugged'),
    check('Wire of the current sensor broken', 'current_sensor_open'),
    check('Contact of the emergency stop closed', 'stop'),
    code ? null : motorSliders(transport, model),
  );
  return h('div', {}, code ? answerCard(libraries, code, result) : null, hands);
}

const MOTOR: [key: string, label: string, unit: string, scale: number][] = [
  ['resistance_ohm', 'Resistance', 'Ω', 1],
  ['torque_constant_Nm_per_A', 'Torque constant', 'mNm/A', 1e3],
  ['inertia_kg_m2', 'Inertia', 'g cm²', 1e7],
];

/** The motor of a model file, by sliders from a third to three times its values. */
function motorSliders(transport: VirtualTransport, model: string): HTMLElement {
  let present = model;
  const line = (key: string) => new RegExp(`^(${key}\\s*=\\s*)(\\S+)`, 'm');
  const rows = MOTOR.map(([key, label, unit, scale]) => {
    const value = Number(line(key).exec(model)?.[2]);
    return slider({
      label,
      unit,
      min: (scale * value) / 3,
      max: scale * value * 3,
      step: (scale * value) / 50,
      value: scale * value,
      set: shown => {
        present = present.replace(line(key), `$1${shown / scale}`);
        transport.tell({ model: present });
      },
    });
  });
  return h('div', {}, h('h3', {}, 'Motor'), ...rows);
}

function answerCard(libraries: Libraries, code: string, result: () => Result | null): HTMLElement {
  const effects = [...libraries.hidden_effects()].sort();
  const answer = select([['', 'choose'], ...effects.map((id): [string, string] => [id, words(id)])], '', {});
  const name = h('input', { autocomplete: 'name', size: 18 });
  const told = h('div', { 'aria-live': 'polite' });
  let [tries, last] = [0, null as ClassResult | null];
  const check = () => {
    if (!answer.value) return told.replaceChildren(message('note', 'Choose an effect first.'));
    tries += 1;
    const { is_right, hidden, constants } = JSON.parse(libraries.check_answer(code, answer.value)) as {
      is_right: boolean;
      hidden: string;
      constants: [effect: string, constant: string, value: number][];
    };
    const found = result() ? (JSON.parse(result()!.outcome) as { causes: { effect: string }[] }).causes.map(cause => cause.effect) : [];
    last = { motorbench_class: 1, code, name: name.value.trim(), answer: answer.value, is_right, tries, verdict: result()?.verdict ?? '', found };
    if (!is_right) {
      return told.replaceChildren(message('error', `It is not ${words(answer.value)}. ${result() ? 'Look at the plots of the report again.' : 'Record and diagnose first: the report shows what the simple model lacks.'}`));
    }
    const rows = constants.map(([effect, constant, value]) => h('tr', {}, h('th', { scope: 'row' }, `${words(effect)}, ${constant.replaceAll('_', ' ')}`), h('td', {}, rounded(value, 3))));
    told.replaceChildren(
      message('good', h('strong', {}, `Right: ${words(hidden)}.`), ` Found with ${tries} ${tries === 1 ? 'try' : 'tries'}.`),
      h('table', {}, h('caption', { class: 'quiet' }, 'What was hidden'), h('tbody', {}, ...rows)),
    );
  };
  const saveResult = () => {
    if (!last) return told.replaceChildren(message('note', 'Check your answer first.'));
    last.name = name.value.trim();
    save(`motorbench-${code}-${(last.name || 'result').replace(/\W+/g, '-')}.json`, JSON.stringify(last, null, 2), 'application/json');
  };
  return h(
    'section',
    { class: 'card', 'aria-label': 'Answer' },
    h('h2', {}, `Class code ${code}`),
    h('p', { class: 'quiet' }, 'Besides friction and the bridge’s drop this bench hides one effect. Record, diagnose, look at the report, then answer.'),
    field('It is', answer),
    h('div', { class: 'actions' }, button('Check the answer', check, { class: 'primary' })),
    told,
    field('Your name, for the teacher', name),
    h('div', { class: 'actions' }, button('Save the result for the teacher', saveResult)),
  );
}
