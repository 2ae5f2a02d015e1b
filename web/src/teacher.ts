/** The teacher's page: a code for a class, and the results of all side by side. */

import type { ClassResult } from './virtual';
import { button, field, h, message, words } from './ui';
import { loaded } from './wasm';

export function teacherPage(): HTMLElement {
  const shown = h('div', { 'aria-live': 'polite' });
  const results = new Map<string, ClassResult>();
  const tableArea = h('div', { 'aria-live': 'polite' });
  const number = h('input', { type: 'number', min: 0, max: 33_554_431, step: 1, value: '' });

  async function make() {
    const libraries = await loaded();
    const drawn = number.value === '' ? crypto.getRandomValues(new Uint32Array(1))[0]! : Number(number.value);
    const code = libraries.class_code(drawn);
    const link = `${location.origin}${location.pathname}#virtual?code=${code}`;
    const { hidden, constants } = JSON.parse(libraries.check_answer(code, '')) as { hidden: string; constants: [string, string, number][] };
    shown.replaceChildren(
      h('p', { class: 'code', 'data-code': code }, code),
      h('p', {}, 'Link for the class: ', h('a', { href: link }, link)),
      h(
        'details',
        {},
        h('summary', {}, 'What it hides (for you)'),
        h('p', {}, h('strong', {}, words(hidden))),
        h('ul', {}, ...constants.map(([effect, constant, value]) => h('li', {}, `${words(effect)}: ${constant.replaceAll('_', ' ')} ${Number(value.toPrecision(3))}`))),
      ),
    );
  }

  const picker = h('input', {
    type: 'file',
    multiple: true,
    accept: '.json',
    id: 'class-results',
    class: 'visually-hidden',
    onchange: () => take([...(picker.files ?? [])]),
  });
  const zone = h(
    'label',
    {
      class: 'drop small-drop',
      for: 'class-results',
      ondragover: (event: DragEvent) => { event.preventDefault(); zone.classList.add('over'); },
      ondragleave: () => zone.classList.remove('over'),
      ondrop: (event: DragEvent) => {
        event.preventDefault();
        zone.classList.remove('over');
        void take([...(event.dataTransfer?.files ?? [])]);
      },
    },
    h('strong', {}, 'Drop the result files of the class here'),
    h('span', {}, 'Each student’s page saves one. They are read in this page and go nowhere.'),
  );

  async function take(files: File[]) {
    const refused: string[] = [];
    for (const file of files) {
      try {
        const result = JSON.parse(await file.text()) as ClassResult;
        if (result.motorbench_class !== 1 || typeof result.code !== 'string') throw new Error();
        results.set(file.name, result);
      } catch {
        refused.push(file.name);
      }
    }
    picker.value = '';
    draw(refused);
  }

  function draw(refused: string[]) {
    const all = [...results.values()].sort((one, other) => String(one.name).localeCompare(String(other.name)));
    const right = all.filter(result => result.is_right).length;
    const row = (result: ClassResult) =>
      h(
        'tr',
        {},
        h('th', { scope: 'row' }, String(result.name || 'without a name')),
        h('td', {}, String(result.code)),
        h('td', {}, result.is_right ? '✓ right' : '✗ not yet'),
        h('td', {}, words(String(result.answer))),
        h('td', {}, String(Number(result.tries))),
        h('td', {}, Array.isArray(result.found) && result.found.length > 0 ? result.found.map(id => words(String(id))).join(', ') : 'no diagnosis'),
      );
    const head = ['Name', 'Code', 'Answer', 'Effect', 'Tries', 'Named by the diagnosis'];
    tableArea.replaceChildren(
      ...(refused.length > 0 ? [message('error', `No result of a class: ${refused.join(', ')}. Take the files that “Save the result for the teacher” writes.`)] : []),
      ...(all.length > 0
        ? [
            h('p', {}, h('strong', {}, `${right} of ${all.length} found it.`)),
            h(
              'div',
              { class: 'wide', tabindex: 0, role: 'region', 'aria-label': 'Results of the class' },
              h('table', {}, h('thead', {}, h('tr', {}, ...head.map(name => h('th', { scope: 'col' }, name)))), h('tbody', {}, ...all.map(row))),
            ),
            h('div', { class: 'actions' }, button('Forget them', () => { results.clear(); draw([]); })),
          ]
        : []),
    );
  }

  return h(
    'main',
    { id: 'main' },
    h('h1', {}, 'For teachers'),
    h('p', { class: 'lead' }, 'A code hides the same bench on every screen of a class. Students record it, diagnose it and say what it is. Their pages tell them how they did.'),
    h(
      'section',
      { class: 'card', 'aria-label': 'Class code' },
      h('h2', {}, '1. Make a code'),
      h('div', { class: 'actions' }, button('Make a class code', make, { class: 'primary large' })),
      h('details', {}, h('summary', {}, 'The same code again'), field('Number of the draw', number, '', 'Left out: drawn at random. The same number gives the same code.')),
      shown,
    ),
    h('section', { class: 'card', 'aria-label': 'Results' }, h('h2', {}, '2. Look at the results'), picker, zone, tableArea),
  );
}
