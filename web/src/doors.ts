/** "I have a board" and "I have nothing": how the line to a board begins, and the bench on it. */

import { Bench } from './bench';
import { Client } from './client';
import { flash, hexBytes } from './flash';
import { BridgeTransport, FIRMWARE_BAUD, SerialTransport, VirtualTransport, type Transport } from './transport';
import { button, errorText, field, h, message } from './ui';
import { virtualPanel } from './virtual';
import { loaded } from './wasm';

const LOCK = 'motorbench-board';

/** One page has the board. The promise is kept until `release` is called. */
function takeBoard(): Promise<(() => void) | null> {
  return new Promise(resolve => {
    if (!navigator.locks) return resolve(() => {});
    void navigator.locks.request(LOCK, { ifAvailable: true }, lock => {
      if (!lock) return resolve(null);
      return new Promise<void>(release => resolve(release));
    });
  });
}

export function boardDoor(): HTMLElement {
  const place = h('div');
  const said = h('div', { 'aria-live': 'polite' });
  const bridge = BridgeTransport.address();
  const canConnect = SerialTransport.isThere() || bridge !== null;
  let bench: Bench | null = null;
  let release: (() => void) | null = null;

  const open = async (): Promise<Transport> => {
    release ??= await takeBoard();
    if (!release) throw new Error('Another tab of this page has the board. Use that one, or close it.');
    return bridge && !SerialTransport.isThere() ? BridgeTransport.open(bridge) : SerialTransport.choose(FIRMWARE_BAUD);
  };
  const giveBack = () => {
    release?.();
    release = null;
  };

  async function connect() {
    said.replaceChildren();
    let transport: Transport | null = null;
    try {
      const libraries = await loaded();
      transport = await open();
      said.replaceChildren(message('note', 'Waiting for the board. A real one starts anew when its port is opened.'));
      const client = new Client(transport);
      await client.start(libraries.version());
      said.replaceChildren();
      bench = new Bench(client, libraries, {
        onend: why => {
          giveBack();
          bench = null;
          start.hidden = false;
          place.replaceChildren();
          if (why) said.replaceChildren(message('error', why));
        },
      });
      start.hidden = true;
      place.replaceChildren(bench.element);
      bench.begin();
    } catch (error) {
      await transport?.close().catch(() => {});
      giveBack();
      if (!isNoChoice(error)) said.replaceChildren(message('error', errorText(error)));
    }
  }

  async function putFirmware() {
    const bar = h('progress', { max: 1, value: 0, 'aria-label': 'Progress' });
    const what = h('span', {}, 'reading the firmware');
    let transport: Transport | null = null;
    try {
      const response = await fetch('./firmware.hex');
      const text = response.ok ? await response.text() : '';
      if (!text.startsWith(':')) throw new Error('This site was built without the firmware: run scripts/web where its compiler is (scripts/setup chip).');
      const program = hexBytes(text);
      transport = await open();
      said.replaceChildren(message('note', what, bar));
      await flash(transport, program, (doing, share) => {
        what.textContent = `${doing}, ${Math.round(100 * share)} %`;
        bar.value = share;
      });
      said.replaceChildren(message('good', `The firmware is on the board: ${program.length} bytes, written and read back. Now connect.`));
    } catch (error) {
      if (!isNoChoice(error)) said.replaceChildren(message('error', errorText(error)));
    } finally {
      await transport?.close().catch(() => {});
      giveBack();
    }
  }

  const start = h(
    'div',
    { class: 'card' },
    canConnect
      ? h(
          'div',
          {},
          h('ol', {}, h('li', {}, 'Plug in the Uno or Nano.'), h('li', {}, 'Once: put the firmware on it. What was on it before is replaced; saved settings stay.'), h('li', {}, 'Connect. Nothing turns before you press “Arm”.')),
          h(
            'div',
            { class: 'actions' },
            button('Connect', connect, { class: 'primary large' }),
            button('Put the firmware on the board', putFirmware),
          ),
          h('p', { class: 'same' }, 'The same in a terminal: ', h('code', {}, 'cargo flash'), ' and ', h('code', {}, 'motorbench tune')),
        )
      : message(
          'note',
          h('p', {}, 'This browser cannot open a serial port. Chrome, Edge and Opera on a computer can.'),
          h('p', {}, 'In this browser it works with the program: it serves this page on this machine, and reaches the port for it.'),
          h('p', {}, h('code', {}, 'motorbench web')),
        ),
  );

  const main = h(
    'main',
    { id: 'main' },
    h('h1', {}, 'I have a board'),
    h('p', { class: 'lead' }, 'Flash it, watch it live, tune it, record it, diagnose it, and send it the gains that were designed.'),
    start,
    said,
    place,
  );
  main.addEventListener('leave', () => void bench?.leave());
  return main;
}

/** The person has closed the list of ports. */
const isNoChoice = (error: unknown) => error instanceof DOMException && error.name === 'NotFoundError';

export function virtualDoor(): HTMLElement {
  const place = h('div');
  const said = h('div', { 'aria-live': 'polite' });
  let bench: Bench | null = null;
  const inAddress = new URLSearchParams(location.hash.split('?')[1] ?? '').get('code') ?? '';
  const code = h('input', { size: 8, maxlength: 9, autocapitalize: 'characters', autocomplete: 'off', spellcheck: 'false', value: inAddress });

  async function begin(withCode: boolean) {
    said.replaceChildren();
    try {
      const libraries = await loaded();
      const text = code.value.trim();
      if (withCode) libraries.class_rig(text);
      const model = libraries.usual_model();
      const transport = await VirtualTransport.start(withCode ? { code: text } : { model });
      const client = new Client(transport);
      await client.start(libraries.version());
      const nominalRig = withCode ? libraries.class_rig(text) : '';
      bench = new Bench(client, libraries, {
        nominalRig,
        panel: virtualPanel(transport, libraries, withCode ? text.toUpperCase() : null, model, () => bench?.result ?? null),
        onend: why => {
          bench = null;
          start.hidden = false;
          place.replaceChildren();
          if (why) said.replaceChildren(message('note', why));
        },
      });
      start.hidden = true;
      place.replaceChildren(bench.element);
      bench.begin();
    } catch (error) {
      said.replaceChildren(message('error', errorText(error)));
    }
  }

  const start = h(
    'div',
    { class: 'card' },
    h(
      'div',
      { class: 'actions' },
      button('Start the virtual board', () => begin(false), { class: 'primary large' }),
    ),
    h('p', {}, 'Or find what is hidden: with a class code the motor has friction, a bridge’s drop, and one more effect that nobody tells you.'),
    h(
      'form',
      { class: 'actions', onsubmit: (event: Event) => { event.preventDefault(); void begin(true); } },
      field('Class code', code),
      h('button', { type: 'submit' }, 'Start with this code'),
    ),
    h('p', { class: 'same' }, 'The same in a terminal: ', h('code', {}, 'motorbench virtual &'), ' and ', h('code', {}, 'motorbench tune')),
  );

  const main = h(
    'main',
    { id: 'main' },
    h('h1', {}, 'I have nothing'),
    h('p', { class: 'lead' }, 'The firmware’s control core and a motor in this page, in real time. It speaks the same protocol to the same controls as a board on USB.'),
    start,
    said,
    place,
  );
  main.addEventListener('leave', () => void bench?.leave());
  return main;
}
