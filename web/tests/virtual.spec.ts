import { expect, test, type Page } from '@playwright/test';
import { readFileSync } from 'node:fs';
import { accessible, fitsAPhone, pictures, reading, value, watch } from './help';

async function start(page: Page) {
  await page.goto('./#virtual');
  await page.getByRole('button', { name: 'Start the virtual board' }).click();
  await expect(page.getByRole('button', { name: 'STOP' })).toBeVisible();
}

test('nothing at hand: a virtual motor is driven, loaded, tripped and stopped, by the keyboard alone', async ({ page }) => {
  const faults = watch(page);
  await page.goto('./');
  await page.getByRole('link', { name: /I have nothing/ }).focus();
  await page.keyboard.press('Enter');
  await accessible(page);
  await pictures(page, 'virtual-start');
  await page.getByRole('button', { name: 'Start the virtual board' }).focus();
  await page.keyboard.press('Enter');
  // The button that arms has the focus by then.
  await expect(page.getByRole('button', { name: 'Arm', exact: true })).toBeFocused();
  await page.keyboard.press('Enter');
  await expect(page.locator('.state')).toContainText('armed');
  await page.getByLabel('Reference', { exact: true }).fill('60');
  await page.keyboard.press('Enter');
  await expect.poll(() => value(page, 'speed')).toBeCloseTo(60, -0.5);
  await accessible(page);
  await fitsAPhone(page);
  await pictures(page, 'virtual');
  await page.getByLabel('Load torque').focus();
  for (let press = 0; press < 10; press++) await page.keyboard.press('ArrowRight');
  await expect.poll(() => value(page, 'current')).toBeGreaterThan(0.1);
  await page.keyboard.press('Escape');
  await expect(page.locator('.state')).toHaveText('drive off');
  await page.getByLabel('Load torque').fill('0');

  await page.getByLabel('Encoder unplugged').check();
  await page.getByRole('button', { name: 'Arm', exact: true }).click();
  await page.getByRole('button', { name: 'Set the reference' }).click();
  await expect(page.locator('.state')).toHaveText('tripped');
  await expect(page.getByRole('alert')).toContainText('encoder');
  await accessible(page);
  await pictures(page, 'virtual-tripped');
  await page.getByLabel('Encoder unplugged').uncheck();
  await page.getByRole('button', { name: 'Clear the trip' }).click();
  await expect(page.locator('.state')).toHaveText('drive off');
  expect(faults).toEqual([]);
});

test('telemetry at 1 kHz comes without a lost sample, and the page draws it', async ({ page }) => {
  await start(page);
  const frames = page.evaluate(() => new Promise<number>(resolve => {
    let count = 0;
    const end = performance.now() + 5000;
    const next = () => (performance.now() < end ? (count++, requestAnimationFrame(next)) : resolve(count / 5));
    next();
  }));
  console.log(`frames a second while 1 kHz telemetry is drawn: ${(await frames).toFixed(0)}`);
  expect(await reading(page, 'frames lost').textContent()).toBe('0');
});

test('gains are typed with their range, sent, read back and saved; steps are compared', async ({ page }) => {
  const faults = watch(page);
  await start(page);
  await page.getByText('Gains and settings').click();
  await page.getByText('PID of the speed').click();
  const gain = page.getByLabel('speed_kp', { exact: true });
  await gain.fill('99999');
  await expect(gain).toHaveAttribute('aria-invalid', 'true');
  await page.getByRole('button', { name: 'Send', exact: true }).click();
  await expect(page.getByRole('alert')).toContainText('expected a number in');
  await gain.fill('0.03');
  await page.getByRole('button', { name: 'Send', exact: true }).click();
  await expect(gain).toHaveValue('0.03');
  await accessible(page);
  await page.getByText('Gains and settings').click();
  await page.getByText('Step tests').click();
  await page.getByRole('button', { name: 'Step', exact: true }).click();
  const figures = page.getByRole('table').filter({ hasText: 'Overshoot' });
  await expect(figures.getByRole('row')).toHaveCount(2);
  await expect(figures).toContainText('ms');
  await expect(page.locator('.state')).toHaveText('drive off');
  expect(faults).toEqual([]);
});

test('a class code hides the same effect for everybody, and a student finds it', async ({ page }, info) => {
  const faults = watch(page);
  await page.goto('./#teacher');
  await page.getByText('The same code again').click();
  await page.getByLabel('Number of the draw').fill('3');
  await page.getByRole('button', { name: 'Make a class code' }).click();
  const code = (await page.locator('[data-code]').getAttribute('data-code'))!;
  expect(code).toMatch(/^[0-9A-Z]{6}$/);
  await page.getByText('What it hides').click();
  const hidden = (await page.locator('details strong').textContent())!;
  await accessible(page);
  await fitsAPhone(page);

  await page.goto(`./#virtual?code=${code}`);
  await page.getByRole('button', { name: 'Start with this code' }).click();
  await page.getByRole('button', { name: 'Record 20 s' }).click();
  await expect(page.getByText(/Enough to identify/)).toBeVisible({ timeout: 60_000 });
  await page.getByRole('button', { name: 'Diagnose', exact: true }).click();
  await expect(page.locator('.verdict')).toBeVisible({ timeout: 400_000 });
  await expect(page.locator('.causes')).toContainText(hidden);
  await page.getByRole('combobox', { name: 'It is' }).selectOption({ label: hidden });
  await page.getByRole('button', { name: 'Check the answer' }).click();
  await expect(page.getByText(`Right: ${hidden}.`)).toBeVisible();
  await page.getByLabel('Your name').fill('Ada');
  const [download] = await Promise.all([page.waitForEvent('download'), page.getByRole('button', { name: 'Save the result for the teacher' }).click()]);
  const path = info.outputPath('ada.json');
  await download.saveAs(path);
  expect(JSON.parse(readFileSync(path, 'utf8'))).toMatchObject({ code, name: 'Ada', is_right: true, tries: 1 });
  await pictures(page, 'class');

  await page.goto('./#teacher');
  const other = { motorbench_class: 1, code, name: '<b>Bo</b>', answer: 'cogging', is_right: false, tries: 2, verdict: '', found: [] };
  await page.locator('#class-results').setInputFiles([
    { name: 'ada.json', mimeType: 'application/json', buffer: readFileSync(path) },
    { name: 'bo.json', mimeType: 'application/json', buffer: Buffer.from(JSON.stringify(other)) },
    { name: 'no.json', mimeType: 'application/json', buffer: Buffer.from('{}') },
  ]);
  await expect(page.getByText('1 of 2 found it.')).toBeVisible();
  await expect(page.getByRole('row', { name: /<b>Bo<\/b>/ })).toBeVisible();
  await expect(page.getByRole('alert')).toContainText('no.json');
  await accessible(page);
  await pictures(page, 'teacher');
  expect(faults).toEqual([]);
});

test('a wrong class code is refused', async ({ page }) => {
  await page.goto('./#virtual');
  await page.getByLabel('Class code').fill('ABCDEF');
  await page.getByRole('button', { name: 'Start with this code' }).click();
  await expect(page.getByRole('alert')).toContainText('is no class code');
});
