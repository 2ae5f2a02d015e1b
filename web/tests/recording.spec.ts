import { readFileSync, writeFileSync } from 'node:fs';
import { expect, test } from '@playwright/test';
import { accessible, differences, fitsAPhone, pictures, run, watch } from './help';

test('a recording: from the first click to the report, with the same result as the program', async ({ page }, info) => {
  const faults = watch(page);
  await page.goto('./');
  await accessible(page);
  await fitsAPhone(page);
  await pictures(page, 'doors');
  await page.getByRole('link', { name: /I have a recording/ }).click();
  await accessible(page);
  await pictures(page, 'recording-empty');
  await page.getByRole('button', { name: /try the example/ }).click();
  await expect(page.locator('.read').first()).toContainText('rows with', { timeout: 60_000 });
  await accessible(page);
  await fitsAPhone(page);
  await pictures(page, 'recording');
  const begun = performance.now();
  await page.getByRole('button', { name: 'Diagnose' }).click();
  await expect(page.getByText('Trying:')).toBeVisible();
  await expect(page.locator('.verdict')).toContainText('Stribeck friction', { timeout: 400_000 });
  const inPage = performance.now() - begun;
  await expect(page.frameLocator('iframe.report').locator('h1')).toContainText('Stribeck friction');
  // Its plots are live: the policy lets the two scripts of a report run, and no other.
  await expect(page.frameLocator('iframe.report').locator('figure.is-live').first()).toBeVisible();
  await accessible(page);
  await fitsAPhone(page);
  await pictures(page, 'result');

  const folder = info.outputPath();
  const saved = async (name: string) => {
    const [download] = await Promise.all([page.waitForEvent('download'), page.getByRole('button', { name, exact: true }).click()]);
    const path = `${folder}-${download.suggestedFilename()}`;
    await download.saveAs(path);
    return path;
  };
  const outcome = readFileSync(await saved('Save JSON'), 'utf8');
  const csv = `${folder}-run.csv`;
  run('simulate', 'examples/recording/bench.toml', '--csv', csv);
  const rig = `${folder}-rig.toml`;
  writeFileSync(rig, readFileSync(new URL('../../examples/recording/rig.toml', import.meta.url)));
  const started = performance.now();
  const expected = run('diagnose', csv, '--rig', rig, '--json', '-');
  const inProgram = performance.now() - started;
  console.log(`diagnosis: ${(inPage / 1000).toFixed(1)} s in the page, ${(inProgram / 1000).toFixed(1)} s in the program on one core`);
  expect(differences(JSON.parse(outcome), JSON.parse(expected))).toEqual([]);
  const model = readFileSync(await saved('Save model'), 'utf8');
  expect(model).toContain('[effects.stribeck_friction]');
  expect(readFileSync(await saved('Save report'), 'utf8')).toContain('<!DOCTYPE html>');
  expect(faults).toEqual([]);
});

test('columns with other names are named by hand, and what is wrong is said', async ({ page }) => {
  const faults = watch(page);
  await page.goto('./#recording');
  const rows = Array.from({ length: 400 }, (_, row) => `${row * 10},${row % 100 < 50 ? 200 : -200},${(row * 7) % 90},x`);
  await page.locator('#recording-files').setInputFiles({
    name: 'log.csv',
    mimeType: 'text/csv',
    buffer: Buffer.from(['millis,pwm,drehzahl,mode', ...rows].join('\n')),
  });
  await expect(page.getByLabel('millis is')).toHaveValue('t_s');
  await expect(page.getByLabel('Factor and offset of millis')).toHaveValue('/1000');
  await expect(page.getByLabel('Factor and offset of pwm')).toHaveValue('/255');
  await page.getByLabel('drehzahl is').selectOption('rpm');
  await expect(page.locator('.read').first()).toContainText('speed, rpm');
  await expect(page.locator('.same code').last()).toHaveText(/--column millis=t_s\/1000 --column pwm=duty\/255 --column drehzahl=rpm/);
  await page.getByLabel('Factor and offset of pwm').fill('/zero');
  await page.getByLabel('Factor and offset of pwm').blur();
  await expect(page.getByRole('alert')).toContainText('a number');
  await expect(page.getByRole('button', { name: 'Diagnose' })).toBeDisabled();
  expect(faults).toEqual([]);
});

test('a diagnosis can be cancelled, and started again', async ({ page }) => {
  await page.goto('./#recording');
  await page.getByRole('button', { name: /try the example/ }).click();
  await page.getByRole('button', { name: 'Diagnose' }).click({ timeout: 60_000 });
  await page.getByRole('button', { name: 'Cancel' }).click();
  await expect(page.getByText('Cancelled.')).toBeVisible();
  await page.getByRole('button', { name: 'Diagnose' }).click();
  await expect(page.getByText('Trying:')).toBeVisible();
});

test('nothing in a file is run or shown as HTML', async ({ page }) => {
  const faults = watch(page);
  await page.goto('./#recording');
  const evil = '<img src=x onerror=document.title=1>';
  const rows = Array.from({ length: 50 }, (_, row) => `${row / 100},1,2`);
  await page.locator('#recording-files').setInputFiles({
    name: `${evil}.csv`,
    mimeType: 'text/csv',
    buffer: Buffer.from([`t_s,u_V,${evil}`, ...rows].join('\n')),
  });
  await expect(page.getByRole('heading', { name: `${evil}.csv` })).toBeVisible();
  expect(await page.locator('main img').count()).toBe(0);
  // The policy itself: no script of a text runs.
  expect(await page.evaluate(() => {
    const script = document.createElement('script');
    script.textContent = 'window.wasRun = true';
    document.body.append(script);
    return 'wasRun' in window;
  })).toBe(false);
  await expect(page).toHaveTitle(/motorbench/);
  expect(faults.filter(fault => !fault.includes('Content Security Policy'))).toEqual([]);
});

test('the page works without a network after the first visit', async ({ page, context }) => {
  const faults = watch(page);
  await page.goto('./');
  await expect(page.getByText('Kept for use without a network.')).toBeVisible();
  await page.reload();
  await context.setOffline(true);
  await page.reload();
  await page.getByRole('link', { name: /I have a recording/ }).click();
  await page.getByRole('button', { name: /try the example/ }).click();
  await expect(page.locator('.read').first()).toContainText('rows with', { timeout: 60_000 });
  await page.goto('./#virtual');
  await page.getByRole('button', { name: 'Start the virtual board' }).click();
  await expect(page.getByRole('button', { name: 'STOP' })).toBeVisible();
  expect(faults).toEqual([]);
});
