/** `motorbench web`: the program serves the page, and is the way to a board for browsers without Web Serial. */

import { spawn, type ChildProcess } from 'node:child_process';
import { expect, test, type Page } from '@playwright/test';
import { program, value, watch, withoutSerial } from './help';
import { Chip } from './serial';

let chip: Chip;
let server: ChildProcess | undefined;
let address: string;

test.beforeEach(async () => {
  chip = new Chip();
  await chip.power();
  server = spawn(program(), ['web', '--no-open', '--json', '--port', chip.link], { stdio: ['ignore', 'pipe', 'inherit'] });
  const said = await new Promise<string>((resolve, reject) => {
    server!.stdout!.once('data', bytes => resolve(String(bytes)));
    server!.once('exit', code => reject(new Error(`motorbench web ended (${code})`)));
  });
  address = (JSON.parse(said) as { address: string }).address;
});
test.afterEach(() => {
  server?.kill();
  chip.end();
});

/** Opens the door of a board at the program's address. */
async function connect(page: Page) {
  await withoutSerial(page);
  await page.goto(`${address}#board`);
  await page.getByRole('button', { name: 'Connect', exact: true }).click();
}

test('a browser without Web Serial drives a board through the program, which stops it when it ends', async ({ page, context }) => {
  const faults = watch(page);
  await connect(page);
  await expect(page.getByRole('button', { name: 'STOP' })).toBeVisible({ timeout: 30_000 });
  await page.getByRole('button', { name: 'Arm', exact: true }).click();
  await page.getByLabel('Reference', { exact: true }).fill('60');
  await page.getByRole('button', { name: 'Set the reference' }).click();
  await expect.poll(() => value(page, 'speed'), { timeout: 30_000 }).toBeCloseTo(60, -0.8);

  // A page that shares nothing with the first, as another browser.
  const another = await (await context.browser()!.newContext()).newPage();
  await connect(another);
  await expect(another.getByRole('alert')).toContainText('another page has the board');
  await another.close();

  const ended = new Promise(resolve => server!.once('exit', resolve));
  server!.kill('SIGINT');
  expect(await ended).toBe(0);
  await expect(page.getByRole('alert')).toContainText('motorbench web runs');
  expect(faults).toEqual([]);

  server = spawn(program(), ['connect', '--port', chip.link, '--json', 'status'], { stdio: ['ignore', 'pipe', 'inherit'] });
  let state = '';
  server!.stdout!.on('data', bytes => (state += String(bytes)));
  await new Promise(resolve => server!.once('exit', resolve));
  expect(state).toContain('mode off armed 0 trip 0');
});

test('the bridge is for its own page alone', async ({ request }) => {
  const { origin, host } = new URL(address);
  const upgrade = { Connection: 'Upgrade', Upgrade: 'websocket', 'Sec-WebSocket-Version': '13', 'Sec-WebSocket-Key': 'dGhlIHNhbXBsZSBub25jZQ==' };
  const token = new URL(address).searchParams.get('token')!;
  const asked = async (path: string, headers: Record<string, string>) => (await request.get(`${origin}${path}`, { headers })).status();
  expect(await asked('/', {})).toBe(200);
  expect(await asked('/', { Host: 'motor.example' })).toBe(403);
  expect(await asked('/../Cargo.toml', {})).toBe(404);
  expect(await asked('/port?token=0', { ...upgrade, Origin: origin })).toBe(403);
  expect(await asked(`/port?token=${token}`, { ...upgrade, Origin: 'http://motor.example', Host: host })).toBe(403);
});
