import { execFileSync } from 'node:child_process';
import { existsSync, mkdirSync } from 'node:fs';
import { fileURLToPath } from 'node:url';
import AxeBuilder from '@axe-core/playwright';
import { expect, type Page } from '@playwright/test';

const root = fileURLToPath(new URL('../../', import.meta.url));

/** The program that was built last, which the results of the page are compared with. */
export function program(): string {
  const found = process.env.MOTORBENCH ?? ['target/release/motorbench', 'target/debug/motorbench'].map(path => root + path).find(existsSync);
  if (!found) throw new Error('the program is missing: cargo build -p motorbench');
  return found;
}

/** What the program prints; on one core, as the page computes. */
export function run(...argumentsOf: string[]): string {
  return execFileSync(program(), argumentsOf, {
    encoding: 'utf8',
    cwd: root,
    env: { ...process.env, RAYON_NUM_THREADS: '1' },
    maxBuffer: 1 << 28,
  });
}

/** No error of the page passes unseen, and nothing is asked of another host. */
export function watch(page: Page): string[] {
  const faults: string[] = [];
  page.on('pageerror', error => faults.push(String(error)));
  page.on('console', line => {
    if (line.type() === 'error') faults.push(line.text());
  });
  page.on('request', request => {
    const { hostname, protocol } = new URL(request.url());
    if (protocol.startsWith('http') && hostname !== '127.0.0.1') faults.push(`asks ${request.url()}`);
  });
  return faults;
}

export async function accessible(page: Page): Promise<void> {
  const { violations } = await new AxeBuilder({ page }).exclude('iframe').analyze();
  const said = violations.map(({ id, help, nodes }) => `${id}: ${help}: ${nodes.map(node => node.html).slice(0, 3).join(' | ')}`);
  expect(said).toEqual([]);
}

/** Pictures for the documentation, where they are asked for: PICTURES=1. */
export async function pictures(page: Page, name: string): Promise<void> {
  if (!process.env.PICTURES) return;
  const folder = `${root}docs/images/web`;
  mkdirSync(folder, { recursive: true });
  const before = page.viewportSize()!;
  for (const width of [1200, 390]) {
    await page.setViewportSize({ width, height: width === 1200 ? 900 : 844 });
    await page.waitForTimeout(700);
    await page.screenshot({ path: `${folder}/${name}-${width}.png`, animations: 'disabled' });
  }
  await page.setViewportSize(before);
}

/** No part of the page is wider than a phone. */
export async function fitsAPhone(page: Page): Promise<void> {
  const before = page.viewportSize()!;
  await page.setViewportSize({ width: 390, height: 844 });
  await page.waitForTimeout(200);
  const wide = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
  await page.setViewportSize(before);
  expect(wide).toBeLessThanOrEqual(0);
}

/**
 * How far a number may be off, as a share of itself. The mathematical functions of WebAssembly and of the system's
 * library differ in the last digit, and a fit ends where its cost hardly falls.
 */
const SAME_NUMBER = 1e-4;

/** Where two outcomes differ: their names, their order, their texts, or a number by more than the last digits. */
export function differences(found: unknown, expected: unknown, path = ''): string[] {
  if (typeof found === 'number' && typeof expected === 'number') {
    const isSame = Math.abs(found - expected) <= SAME_NUMBER * Math.abs(expected) + 1e-12;
    return isSame ? [] : [`${path}: ${found} for ${expected}`];
  }
  if (found && expected && typeof found === 'object' && typeof expected === 'object') {
    const [here, there] = [found, expected] as Record<string, unknown>[];
    return [...new Set([...Object.keys(here!), ...Object.keys(there!)])].flatMap(key => differences(here![key], there![key], `${path}/${key}`));
  }
  return found === expected ? [] : [`${path}: ${String(found)} for ${String(expected)}`];
}

/** A value of the list beside the traces. */
export const reading = (page: Page, name: string) =>
  page.locator('.readings div').filter({ has: page.locator('dt', { hasText: new RegExp(`^${name}$`) }) }).locator('dd');
export const value = async (page: Page, name: string) => parseFloat((await reading(page, name).textContent())!.replace('−', '-'));

/** Opens the door of a board, and connects. */
export async function connected(page: Page): Promise<void> {
  await page.goto('./#board');
  await page.getByRole('button', { name: 'Connect', exact: true }).click();
  await expect(page.getByRole('button', { name: 'STOP' })).toBeVisible({ timeout: 30_000 });
}

/** As in a browser that has no Web Serial. */
export async function withoutSerial(page: Page): Promise<void> {
  await page.addInitScript(() => {
    delete (Navigator.prototype as { serial?: unknown }).serial;
  });
}
