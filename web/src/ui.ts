/** Small helpers for elements. Text is always set as text: nothing of a file is ever read as HTML. */

type Child = Node | string | null | undefined | false;
type Attributes = Record<string, unknown>;

export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith('on') && typeof value === 'function') {
      element.addEventListener(name.slice(2), value as EventListener);
    } else if (value === true) {
      element.setAttribute(name, '');
    } else {
      element.setAttribute(name, String(value));
    }
  }
  element.append(...children.filter((child): child is Node | string => child !== null && child !== undefined && child !== false));
  return element;
}

export function button(text: string, onclick: () => unknown, attributes: Attributes = {}): HTMLButtonElement {
  return h('button', { type: 'button', onclick, ...attributes }, text);
}

/** A labelled input, with its unit and a line of help. */
export function field(label: string, input: HTMLElement, unit = '', help = ''): HTMLElement {
  const id = (input.id ||= `field-${++fields}`);
  if (help) input.setAttribute('aria-describedby', `${id}-help`);
  return h(
    'div',
    { class: 'field' },
    h('label', { for: id }, label),
    h('span', { class: 'with-unit' }, input, unit ? h('span', { class: 'unit' }, unit) : null),
    help ? h('small', { id: `${id}-help` }, help) : null,
  );
}
let fields = 0;

export function number(value: number, attributes: Attributes = {}): HTMLInputElement {
  return h('input', { type: 'number', step: 'any', value, inputmode: 'decimal', ...attributes });
}

export function select(options: [value: string, text: string][], chosen = '', attributes: Attributes = {}): HTMLSelectElement {
  const list = h('select', attributes, ...options.map(([value, text]) => h('option', { value, selected: value === chosen }, text)));
  if (chosen) list.value = chosen;
  return list;
}

/** The command line that does the same, for a person who has a terminal as well. */
export function sameBy(command: string): HTMLElement {
  return h('p', { class: 'same' }, 'The same in a terminal: ', h('code', { tabindex: 0 }, command));
}

export function save(name: string, content: string, type = 'text/plain'): void {
  const address = URL.createObjectURL(new Blob([content], { type }));
  const link = h('a', { href: address, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

export function rounded(value: number | null | undefined, digits = 4): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  const number = Number(value.toPrecision(digits));
  return String(number).replace('-', '−');
}

export function message(kind: 'error' | 'note' | 'good', ...children: Child[]): HTMLElement {
  return h('div', { class: `message ${kind}`, role: kind === 'error' ? 'alert' : 'status' }, ...children);
}

export const errorText = (error: unknown): string => (error instanceof Error ? error.message : String(error));

/** `coulomb_friction` as a person reads it. */
export const words = (id: string): string => id.replace(/^parameter:/, 'wrong value: ').replaceAll('_', ' ');

/** A word of a command line, quoted where a shell needs it. */
export const quoted = (word: string): string => (/^[\w./:=@%+,*#-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);
