/** "I have a recording": files in, their columns named by hand where needed, a rig or none, a diagnosis out. */

import { Analysis, Cancelled, type Column, type InputFile, type Preview, type RigFile, type Summary } from './analysis';
import { drawn } from './plot';
import { resultView } from './result';
import { button, errorText, field, h, message, quoted, select, words } from './ui';

/** A file, and what each of its columns is: the right side of a mapping, empty for a column that is not used. */
interface Input {
  name: string;
  bytes: Uint8Array;
  preview: Preview | null;
  chosen: string[];
  error: string;
}

const RIG_FIELDS: [key: string, label: string, unit: string][] = [
  ['supply.voltage_V', 'Supply voltage', 'V'],
  ['encoder.counts_per_rev', 'Encoder counts a revolution (x4)', ''],
  ['motor.resistance_ohm', 'Resistance', 'Ω'],
  ['motor.inductance_H', 'Inductance', 'H'],
  ['motor.torque_constant_Nm_per_A', 'Torque constant', 'Nm/A'],
  ['motor.inertia_kg_m2', 'Inertia', 'kg m²'],
  ['motor.viscous_friction_Nm_s', 'Viscous friction', 'Nm s'],
];

export function recordingDoor(): HTMLElement {
  const analysis = new Analysis();
  let inputs: Input[] = [];
  let rig: RigFile | null = null;
  let channels: [string, string][] = [];
  void analysis.channels().then(found => (channels = found));

  const filesArea = h('div');
  const rigArea = h('div');
  const runArea = h('div', { class: 'run' });
  const resultArea = h('div', { 'aria-live': 'polite' });

  const picker = h('input', {
    type: 'file',
    multiple: true,
    id: 'recording-files',
    class: 'visually-hidden',
    onchange: () => take([...(picker.files ?? [])]),
  });
  const zone = h(
    'label',
    { class: 'drop', for: 'recording-files', ondragover: allow, ondragleave: () => zone.classList.remove('over'), ondrop: dropped },
    h('strong', {}, 'Drop a recording here, or choose a file'),
    h('span', {}, 'CSV, text of a serial monitor, Excel, MATLAB, NumPy, WPILib, an oscilloscope. Also a rig file (.toml).'),
    h('span', { class: 'quiet' }, 'Nothing leaves this machine: the file is read and computed in this page.'),
  );
  const example = button('Or try the example: a bench is simulated here', loadExample, { class: 'link' });

  function allow(event: DragEvent) {
    event.preventDefault();
    zone.classList.add('over');
  }
  function dropped(event: DragEvent) {
    event.preventDefault();
    zone.classList.remove('over');
    void take([...(event.dataTransfer?.files ?? [])]);
  }

  async function loadExample() {
    example.disabled = true;
    const { csv, rig } = await analysis.example();
    await take([new File([csv], 'run.csv'), new File([rig], 'rig.toml')]);
    example.disabled = false;
  }

  async function take(files: File[]) {
    resultArea.replaceChildren();
    for (const file of files) {
      if (/\.toml$/i.test(file.name)) {
        await takeRig(file.name, await file.text());
        continue;
      }
      const bytes = new Uint8Array(await file.arrayBuffer());
      const input: Input = { name: file.name, bytes, preview: null, chosen: [], error: '' };
      try {
        input.preview = await analysis.preview({ name: file.name, bytes });
        input.chosen = input.preview.columns.map(column => column.likely);
      } catch (error) {
        input.error = errorText(error);
      }
      inputs = [...inputs.filter(other => other.name !== file.name), input];
    }
    picker.value = '';
    draw();
  }

  async function takeRig(name: string, text: string) {
    try {
      await analysis.checkRig({ name, text });
      rig = { name, text };
      drawRig();
    } catch (error) {
      drawRig(errorText(error));
    }
  }

  const mapping = (input: Input): string[] =>
    (input.preview?.columns ?? []).flatMap((column, index) => {
      const right = input.chosen[index];
      return right && right !== column.name ? [`${column.name}=${right}`] : [];
    });

  const asFile = (input: Input): InputFile => ({ name: input.name, bytes: input.bytes, columns: mapping(input) });

  const command = () => {
    const columns = inputs.flatMap(mapping).map(column => ` --column ${quoted(column)}`);
    const names = inputs.map(input => quoted(input.name)).join(' ');
    const report = inputs[0] ? ` --report ${quoted(base())}.html` : '';
    return `motorbench diagnose ${names}${[...new Set(columns)].join('')}${rig ? ` --rig ${quoted(rig.name)}` : ''}${report}`;
  };
  const base = () => (inputs[0]?.name ?? 'recording').replace(/\.[^.]+$/, '');

  function draw() {
    zone.classList.toggle('small', inputs.length > 0);
    example.hidden = inputs.length > 0;
    filesArea.replaceChildren(...inputs.map(fileCard));
    drawRig();
    drawRun();
  }

  function fileCard(input: Input): HTMLElement {
    const readable = h('div', { 'aria-live': 'polite' });
    const card = h(
      'section',
      { class: 'card', 'aria-label': input.name },
      h(
        'header',
        { class: 'card-head' },
        h('h2', {}, input.name),
        input.preview ? h('span', { class: 'quiet' }, `${input.preview.columns[0]?.count ?? 0} rows, read as ${input.preview.format}`) : null,
        button('Remove', () => {
          inputs = inputs.filter(other => other !== input);
          resultArea.replaceChildren();
          draw();
        }, { class: 'link', 'aria-label': `Remove ${input.name}` }),
      ),
      input.error ? message('error', input.error) : null,
    );
    if (!input.preview) return card;
    const rows = input.preview.columns.map((column, index) => columnRow(input, column, index, () => check(input, readable)));
    const isNamed = input.preview.columns.every((column, index) => input.chosen[index] === column.name);
    card.append(
      ...input.preview.notes.map(note => message('note', note)),
      h(
        'details',
        { open: !isNamed },
        h('summary', {}, isNamed ? 'Columns: all are known by their names' : 'Columns: what each of them is'),
        h(
          'div',
          { class: 'wide', tabindex: 0, role: 'region', 'aria-label': `Columns of ${input.name}` },
          h(
            'table',
            { class: 'columns' },
            h('thead', {}, h('tr', {}, ...['Column', 'Preview', 'Is', 'Factor and offset'].map(name => h('th', { scope: 'col' }, name)))),
            h('tbody', {}, ...rows),
          ),
        ),
      ),
      readable,
    );
    void check(input, readable);
    return card;
  }

  function columnRow(input: Input, column: Column, index: number, changed: () => void): HTMLElement {
    const parts = (right: string) => /^(\w*)(.*)$/.exec(right)!.slice(1) as [string, string];
    const [channel, scale] = parts(input.chosen[index] ?? '');
    const options: [string, string][] = [['', 'not used'], ...channels.map(([name, title]): [string, string] => [name, title])];
    const which = select(options, channel, { 'aria-label': `${column.name} is` });
    const factor = h('input', { value: scale, placeholder: '*1', size: 12, 'aria-label': `Factor and offset of ${column.name}`, spellcheck: 'false' });
    const update = () => {
      input.chosen[index] = which.value ? which.value + factor.value.trim() : '';
      factor.disabled = !which.value;
      changed();
    };
    factor.disabled = !channel;
    which.addEventListener('change', update);
    factor.addEventListener('change', update);
    return h(
      'tr',
      {},
      h('th', { scope: 'row' }, column.name, column.unit ? h('span', { class: 'quiet' }, ` ${column.unit}`) : null),
      h('td', {}, sparkline(column.values)),
      h('td', {}, which),
      h('td', {}, factor),
    );
  }

  /** Reads the file with the names as they are chosen, and shows what the diagnosis will see. */
  async function check(input: Input, area: HTMLElement) {
    input.error = '';
    drawRun();
    try {
      const summary = await analysis.read(asFile(input));
      area.replaceChildren(...readSummary(summary));
    } catch (error) {
      input.error = errorText(error);
      area.replaceChildren(message('error', input.error));
    }
    drawRun();
  }

  function readSummary(summary: Summary): HTMLElement[] {
    const time = summary.channels.find(channel => channel.column === 't_s');
    const ignored = summary.ignored.length > 0 ? message('note', `Not used: ${summary.ignored.join(', ')}.`) : null;
    // Of the ways to say one quantity the first that the file has.
    const shown = [['u_V', 'duty'], ['omega_rad_per_s', 'rpm', 'counts', 'theta_rad'], ['i_A']]
      .map(names => names.map(name => summary.channels.find(channel => channel.column === name)).find(channel => channel !== undefined))
      .filter(channel => channel !== undefined);
    const plots = time ? shown.map(channel => drawn(channel.title, time.values, channel.values)) : [];
    const kind = summary.is_table ? `${summary.rows} steady states` : `${summary.rows} rows`;
    return [
      h('p', { class: 'read' }, h('strong', {}, 'Read: '), `${kind} with ${summary.channels.map(channel => channel.title).join(' · ')}`),
      ...(ignored ? [ignored] : []),
      ...summary.notes.map(note => message('note', note)),
      h('div', { class: 'plots' }, ...plots),
    ];
  }

  function drawRig(error = '') {
    if (inputs.length === 0 && !rig) return rigArea.replaceChildren();
    const upload = h('input', {
      type: 'file',
      accept: '.toml',
      id: 'rig-file',
      onchange: async () => {
        const file = upload.files?.[0];
        if (file) await takeRig(file.name, await file.text());
      },
    });
    const typed = RIG_FIELDS.map(([key, label, unit]) => {
      const input = h('input', { inputmode: 'decimal', size: 10, 'data-key': key, onchange: fromFields, value: known(key) });
      return field(label, input, unit);
    });
    rigArea.replaceChildren(
      h(
        'section',
        { class: 'card', 'aria-label': 'Rig' },
        h(
          'header',
          { class: 'card-head' },
          h('h2', {}, 'What is known of the rig'),
          h('span', { class: 'quiet' }, rig ? `from ${rig.name}` : 'nothing: that works, and finds less'),
          rig ? button('Forget it', () => { rig = null; drawRig(); drawRun(); }, { class: 'link' }) : null,
        ),
        error ? message('error', error) : null,
        field('Rig file (.toml)', upload),
        h('details', {}, h('summary', {}, 'Or type what the data sheet says'), h('div', { class: 'fields' }, ...typed)),
      ),
    );
  }

  const known = (key: string): string => {
    const [table, name] = key.split('.') as [string, string];
    const section = rig?.text.split(/^\[/m).find(part => part.startsWith(`${table}]`));
    return new RegExp(`^${name}\\s*=\\s*([^#\\n]+)`, 'm').exec(section ?? '')?.[1]?.trim() ?? '';
  };

  function fromFields() {
    const tables = new Map<string, string[]>();
    for (const input of rigArea.querySelectorAll<HTMLInputElement>('input[data-key]')) {
      const value = input.value.trim().replace(',', '.');
      if (!value) continue;
      const [table, key] = input.dataset.key!.split('.') as [string, string];
      tables.set(table, [...(tables.get(table) ?? []), `${key} = ${value}`]);
    }
    const text = [...tables].map(([table, lines]) => `[${table}]\n${lines.join('\n')}\n`).join('\n');
    void analysis.checkRig({ name: 'rig.toml', text }).then(
      () => {
        rig = text ? { name: 'rig.toml', text } : null;
        rigArea.querySelector('.message')?.remove();
        drawRun();
      },
      error => {
        rigArea.querySelector('.message')?.remove();
        rigArea.querySelector('.card')?.append(message('error', errorText(error)));
      },
    );
  }

  let isRunning = false;
  function drawRun() {
    if (isRunning) return;
    if (inputs.length === 0) return runArea.replaceChildren();
    const ready = inputs.every(input => input.preview && !input.error);
    runArea.replaceChildren(
      button('Diagnose', diagnose, { class: 'primary large', disabled: !ready }),
      h('p', { class: 'same' }, 'The same in a terminal: ', h('code', {}, command())),
    );
  }

  async function diagnose() {
    isRunning = true;
    const begun = performance.now();
    const what = h('span', { role: 'status', 'aria-live': 'polite' }, 'reading');
    const time = h('span', { class: 'quiet' }, '');
    const clock = setInterval(() => (time.textContent = `${((performance.now() - begun) / 1000).toFixed(0)} s`), 500);
    const cancel = button('Cancel', () => analysis.cancel());
    resultArea.replaceChildren();
    runArea.replaceChildren(
      h('div', { class: 'progress' }, h('span', { class: 'spinner', 'aria-hidden': 'true' }), h('span', {}, 'Trying: ', what), time, cancel),
    );
    cancel.focus();
    try {
      const result = await analysis.diagnose(inputs.map(asFile), rig, text => (what.textContent = words(text)));
      const view = resultView(result, { base: base(), rig: rig?.text, command: command() });
      resultArea.replaceChildren(view);
      view.querySelector<HTMLElement>('.verdict')?.focus({ preventScroll: true });
      view.scrollIntoView({ behavior: 'smooth' });
    } catch (error) {
      resultArea.replaceChildren(message(error instanceof Cancelled ? 'note' : 'error', errorText(error)));
    } finally {
      clearInterval(clock);
      isRunning = false;
      drawRun();
    }
  }

  return h(
    'main',
    { id: 'main' },
    h('h1', {}, 'I have a recording'),
    h('p', { class: 'lead' }, 'What a simulation of this motor gets wrong, by what physical cause, and what naming it gains.'),
    picker,
    zone,
    example,
    filesArea,
    rigArea,
    runArea,
    resultArea,
  );
}

/** A column in a few pixels. */
function sparkline(values: (number | null)[]): SVGElement {
  const [width, height] = [120, 26];
  const svg = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
  svg.setAttribute('class', 'spark');
  svg.setAttribute('viewBox', `0 0 ${width} ${height}`);
  svg.setAttribute('width', String(width));
  svg.setAttribute('height', String(height));
  svg.setAttribute('aria-hidden', 'true');
  const there = values.filter(value => value !== null);
  if (there.length === 0) return svg;
  const [low, high] = [Math.min(...there), Math.max(...there)];
  const at = (value: number) => height - 2 - ((height - 4) * (value - low)) / (high - low || 1);
  let path = '';
  values.forEach((value, index) => {
    if (value === null) return;
    path += `${path ? 'L' : 'M'}${((width * index) / Math.max(1, values.length - 1)).toFixed(1)} ${at(value).toFixed(1)}`;
  });
  const line = document.createElementNS(svg.namespaceURI!, 'path');
  line.setAttribute('d', path);
  svg.append(line);
  return svg;
}
