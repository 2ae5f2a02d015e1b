/** The page: one of its screens by the part of the address behind `#`. */

import './style.css';
import { boardDoor, virtualDoor } from './doors';
import { recordingDoor } from './recording';
import { teacherPage } from './teacher';
import { h } from './ui';

interface Screen {
  title: string;
  show: () => HTMLElement;
}

const SCREENS: Record<string, Screen> = {
  '': { title: 'motorbench', show: home },
  recording: { title: 'I have a recording', show: recordingDoor },
  board: { title: 'I have a board', show: boardDoor },
  virtual: { title: 'I have nothing', show: virtualDoor },
  teacher: { title: 'For teachers', show: teacherPage },
};

const PICTURES = {
  recording: '<path d="M10 62h280" class="faint"/><path d="M10 70c20-4 26-46 60-46s30 34 62 34 40-42 66-42 36 30 92 26" class="one"/><path d="M10 72c22-2 34-36 62-38s34 28 62 30 36-34 66-36 36 22 90 24" class="two"/>',
  board: '<rect x="60" y="20" width="96" height="54" rx="6" class="one"/><path d="M72 20v-8M86 20v-8M100 20v-8M114 20v-8M128 20v-8M142 20v-8M72 74v8M86 74v8M100 74v8M114 74v8M128 74v8M142 74v8" class="one"/><path d="M156 47h52" class="two"/><circle cx="234" cy="47" r="24" class="one"/><path d="M234 47l14-12" class="two"/>',
  virtual: '<rect x="84" y="12" width="132" height="64" rx="6" class="one"/><path d="M84 26h132" class="one"/><path d="M96 64c10-22 20-22 30-8s18 10 28-8 24-14 48-10" class="two"/><circle cx="92" cy="19" r="2" class="one"/><circle cx="99" cy="19" r="2" class="one"/>',
};

function picture(name: keyof typeof PICTURES): Element {
  // The drawings stand in this file: nothing from outside is read as markup.
  const style = 'fill:none;stroke-width:2.5;stroke-linecap:round;stroke-linejoin:round';
  const text = `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 300 92" aria-hidden="true" style="${style}">${PICTURES[name]}</svg>`;
  const svg = new DOMParser().parseFromString(text, 'image/svg+xml').documentElement;
  for (const [part, colour] of [['one', 'var(--ink)'], ['two', 'var(--before)'], ['faint', 'var(--line)']] as const) {
    svg.querySelectorAll(`.${part}`).forEach(element => element.setAttribute('style', `stroke:${colour}`));
  }
  return document.importNode(svg, true);
}

function home(): HTMLElement {
  const door = (hash: keyof typeof PICTURES, title: string, text: string) =>
    h('li', {}, h('a', { class: 'door', href: `#${hash}` }, picture(hash), h('h2', {}, title), h('p', {}, text), h('span', { class: 'go', 'aria-hidden': 'true' }, 'Open →')));
  return h(
    'main',
    { id: 'main' },
    h(
      'div',
      { class: 'hero' },
      h('h1', {}, 'Understand and control a DC motor'),
      h('p', { class: 'lead' }, 'motorbench says what the simple model of your motor gets wrong, names the physical cause, and designs the loop. All of it is computed in this page: no account, no server, and no file leaves this machine.'),
    ),
    h(
      'ul',
      { class: 'doors' },
      door('recording', 'I have a recording', 'Drop a table of voltage, speed and current. See what the model misses, why, and what to do about it.'),
      door('board', 'I have a board', 'Plug in an Arduino Uno or Nano. Put the firmware on it from here, watch the motor live, tune it, record it, diagnose it.'),
      door('virtual', 'I have nothing', 'A virtual board with a virtual motor, in real time. Load it, break it, and find the effect that a class code hides.'),
    ),
    h('p', {}, 'For a class: ', h('a', { href: '#teacher' }, 'the teacher’s page'), ' makes a code that hides the same effect on every screen, and shows all results side by side.'),
  );
}

let current: HTMLElement | null = null;

function show() {
  const hash = location.hash.slice(1).split('?')[0] ?? '';
  const name = hash in SCREENS ? hash : '';
  const screen = SCREENS[name]!;
  current?.dispatchEvent(new Event('leave'));
  current = screen.show();
  document.title = name ? `${screen.title} – motorbench` : 'motorbench';
  const link = (to: string, text: string) => h('a', { href: `#${to}`, 'aria-current': to === name ? 'page' : false }, text);
  document.querySelector('#app')!.replaceChildren(
    h('a', { class: 'skip', href: '#main', onclick: (event: Event) => { event.preventDefault(); document.querySelector<HTMLElement>('main h1')?.focus(); } }, 'Skip to the content'),
    h(
      'header',
      { class: 'top' },
      h('a', { class: 'name', href: '#' }, h('img', { src: './icon.svg', alt: '' }), 'motorbench'),
      h('nav', { 'aria-label': 'Screens' }, link('recording', 'Recording'), link('board', 'Board'), link('virtual', 'Virtual board'), link('teacher', 'Teacher')),
    ),
    current,
    h('footer', { class: 'foot' }, h('span', {}, 'Everything is computed in this page. It asks for nothing from a network.'), h('span', { id: 'offline' }, '')),
  );
  const heading = current.querySelector<HTMLElement>('h1');
  heading?.setAttribute('tabindex', '-1');
  if (name) heading?.focus({ preventScroll: true });
  scrollTo(0, 0);
  void tellOffline();
}

async function tellOffline() {
  const place = document.querySelector('#offline');
  if (!place || !('serviceWorker' in navigator) || !import.meta.env.PROD) return;
  await navigator.serviceWorker.ready;
  place.textContent = 'Kept for use without a network.';
}

addEventListener('hashchange', show);
if ('serviceWorker' in navigator && import.meta.env.PROD) void navigator.serviceWorker.register('./service-worker.js');
show();
