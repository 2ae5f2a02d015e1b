import { existsSync, readFileSync } from 'node:fs';
import { expect, test } from '@playwright/test';
import { accessible, connected, fitsAPhone, pictures, value, watch, withoutSerial } from './help';
import { Chip, connectTo, Optiboot } from './serial';

test.describe('the firmware on the simulated chip', () => {
  let chip: Chip;
  test.beforeEach(() => void (chip = new Chip()));
  test.afterEach(() => chip.end());

  test('a board: connect, drive, stop, gains, record, diagnose, design, send', async ({ page }) => {
    const faults = watch(page);
    await connectTo(page, chip);
    await chip.start();
    await page.goto('./#board');
    await accessible(page);
    await pictures(page, 'board-start');
    await connected(page);
    await page.getByRole('button', { name: 'Arm', exact: true }).click();
    await page.getByLabel('Reference', { exact: true }).fill('60');
    await page.getByRole('button', { name: 'Set the reference' }).click();
    await expect.poll(() => value(page, 'speed'), { timeout: 30_000 }).toBeCloseTo(60, -0.8);
    await pictures(page, 'board');
    await page.keyboard.press('Escape');
    await expect(page.locator('.state')).toHaveText('drive off');
    // This check holds the page up for longer than a driven motor waits for it.
    await accessible(page);
    await fitsAPhone(page);
    await page.getByLabel(/No limit of current/).check();
    await page.getByRole('button', { name: 'Record 20 s' }).click();
    await expect(page.getByText(/Enough to identify. 20000 samples, 0 frames lost/)).toBeVisible({ timeout: 400_000 });
    await page.getByRole('button', { name: 'Diagnose', exact: true }).click();
    await expect(page.locator('.causes')).toContainText('coulomb friction', { timeout: 400_000 });
    await page.locator('summary', { hasText: /^Design$/ }).click();
    await page.getByRole('button', { name: 'Design', exact: true }).click();
    await page.getByRole('button', { name: 'Send to the board' }).click({ timeout: 90_000 });
    await expect(page.getByText(/settings are on the board, read back/)).toBeVisible();
    await pictures(page, 'design');
    await page.getByRole('button', { name: 'Disconnect' }).click();
    await expect(page.getByRole('button', { name: 'Connect', exact: true })).toBeVisible();
    expect(faults).toEqual([]);
  });

  test('half frames, flipped and lost bytes are counted, and every command gets through', async ({ page }) => {
    const faults = watch(page);
    await connectTo(page, chip);
    await chip.start();
    await connected(page);
    let count = 0;
    chip.disturb = bytes => {
      // Every third piece comes in two parts, of every fortieth one byte is flipped, of every ninetieth one is lost.
      count += 1;
      const copy = Buffer.from(bytes);
      if (count % 40 === 0) copy[copy.length >> 1]! ^= 0x10;
      const sent = count % 90 === 0 ? copy.subarray(0, copy.length - 1) : copy;
      return count % 3 === 0 ? [sent.subarray(0, sent.length >> 1), sent.subarray(sent.length >> 1)] : [sent];
    };
    await page.getByRole('button', { name: 'Arm', exact: true }).click();
    await expect(page.locator('.state')).toContainText('armed');
    for (const reference of ['40', '80', '20']) {
      await page.getByLabel('Reference', { exact: true }).fill(reference);
      await page.getByRole('button', { name: 'Set the reference' }).click();
      await expect.poll(() => value(page, 'speed'), { timeout: 30_000 }).toBeCloseTo(Number(reference), -0.8);
    }
    await expect.poll(() => value(page, 'frames lost')).toBeGreaterThan(0);
    await page.getByRole('button', { name: 'STOP' }).click();
    await expect(page.locator('.state')).toHaveText('drive off');
    expect(faults).toEqual([]);
  });

  test('a stop cancels what was ordered before it, and nothing else drives while a recording runs', async ({ page }) => {
    const faults = watch(page);
    await connectTo(page, chip);
    await chip.start();
    await connected(page);
    const sent: string[] = [];
    const { take } = chip;
    chip.take = bytes => {
      sent.push(String(bytes));
      take.call(chip, bytes);
    };
    // Both within one turn of the page: the line that arms waits for its settings, and must not follow the stop.
    await page.evaluate(() => {
      const named = (name: string) => [...document.querySelectorAll('button')].find(button => button.textContent!.startsWith(name))!;
      named('Arm').click();
      named('STOP').click();
    });
    await expect(page.getByText('Stopped.')).toBeVisible();
    await page.waitForTimeout(500);
    expect(sent.filter(line => line.trim() === 'arm')).toEqual([]);
    await expect(page.locator('.state')).toHaveText('drive off');

    await page.getByRole('button', { name: 'Record 20 s' }).click();
    await expect(page.locator('.state')).toContainText('armed');
    await page.getByRole('button', { name: 'Set the reference' }).click();
    await expect(page.getByText('The recording runs: wait for its end, or press STOP.')).toBeVisible();
    await page.keyboard.press('Escape');
    await expect(page.getByText('It was stopped.')).toBeVisible();
    await expect(page.locator('.state')).toHaveText('drive off');
    expect(faults).toEqual([]);
  });

  test('a page that is closed stops the motor', async ({ page, context }) => {
    await connectTo(page, chip);
    await chip.start();
    await connected(page);
    await page.getByRole('button', { name: 'Arm', exact: true }).click();
    await page.getByLabel('Reference', { exact: true }).fill('60');
    await page.getByRole('button', { name: 'Set the reference' }).click();
    await expect.poll(() => value(page, 'speed'), { timeout: 30_000 }).toBeGreaterThan(40);
    // Not even the last line of the page gets through, as when the computer crashes.
    chip.take = () => {};
    await page.close({ runBeforeUnload: false });
    const other = await context.newPage();
    await new Promise(resolve => setTimeout(resolve, 1500));
    delete (chip as Partial<Chip>).take;
    await connectTo(other, chip);
    await connected(other);
    await expect(other.getByRole('alert')).toContainText('host silent');
    await expect(other.locator('.state')).toHaveText('tripped');
  });

  test('a reset and a pulled cable are said', async ({ page }) => {
    const port = await connectTo(page, chip);
    await chip.start();
    await connected(page);
    chip.tell('reset');
    await expect(page.getByRole('alert')).toContainText('was reset');
    await connected(page);
    await port.unplug();
    await expect(page.getByRole('alert')).toContainText('check the cable');
  });

  test('a second tab says that the first has the board', async ({ page, context }) => {
    await connectTo(page, chip);
    await chip.start();
    await connected(page);
    const other = await context.newPage();
    await connectTo(other, new Optiboot());
    await other.goto('./#board');
    await other.getByRole('button', { name: 'Connect', exact: true }).click();
    await expect(other.getByRole('alert')).toContainText('Another tab');
  });
});

test.describe('the bootloader', () => {
  const firmware = new URL('../public/firmware.hex', import.meta.url);
  test.skip(!existsSync(firmware), 'the site was built without the firmware');

  test('the firmware is written and read back', async ({ page }) => {
    const faults = watch(page);
    const board = new Optiboot();
    await connectTo(page, board);
    await page.goto('./#board');
    await page.getByRole('button', { name: 'Put the firmware on the board' }).click();
    await expect(page.getByText(/The firmware is on the board/)).toBeVisible({ timeout: 60_000 });
    expect(board.isDone).toBe(true);
    for (const line of readFileSync(firmware, 'utf8').split(/\r?\n/)) {
      if (!line.startsWith(':') || line.slice(7, 9) !== '00') continue;
      const bytes = Buffer.from(line.slice(1), 'hex');
      const address = bytes.readUInt16BE(1);
      expect(board.memory.subarray(address, address + bytes[0]!)).toEqual(bytes.subarray(4, 4 + bytes[0]!));
    }
    expect(faults).toEqual([]);
  });

  test('a byte that is written wrongly is found', async ({ page }) => {
    const board = new Optiboot();
    board.isFaulty = true;
    await connectTo(page, board);
    await page.goto('./#board');
    await page.getByRole('button', { name: 'Put the firmware on the board' }).click();
    await expect(page.getByRole('alert')).toContainText('another byte than was written', { timeout: 60_000 });
  });

  test('another chip is refused before anything is written', async ({ page }) => {
    const board = new Optiboot();
    board.signature = [0x1e, 0x98, 0x01];
    await connectTo(page, board);
    await page.goto('./#board');
    await page.getByRole('button', { name: 'Put the firmware on the board' }).click();
    await expect(page.getByRole('alert')).toContainText('signature 1e 98 01');
    expect(board.memory.every(byte => byte === 0xff)).toBe(true);
  });
});

test('a browser without Web Serial says so, and names the way through', async ({ page }) => {
  await withoutSerial(page);
  await page.goto('./#board');
  await expect(page.getByText('This browser cannot open a serial port.')).toBeVisible();
  await expect(page.getByText('motorbench web', { exact: true })).toBeVisible();
  await accessible(page);
  await pictures(page, 'board-no-serial');
});
