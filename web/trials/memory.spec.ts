import { expect, test } from '@playwright/test';

/** How long the page draws telemetry, and how often its memory is measured. */
const MINUTES = Number(process.env.MINUTES ?? 60);
const EVERY_MINUTES = Math.max(MINUTES / 12, 0.5);

test(`a page that draws 1 kHz telemetry keeps its memory for ${MINUTES} minutes`, async ({ page }) => {
  test.setTimeout((MINUTES + 10) * 60_000);
  await page.goto('./#virtual');
  await page.getByRole('button', { name: 'Start the virtual board' }).click();
  await page.getByRole('button', { name: 'Arm', exact: true }).click();
  await page.getByLabel('Reference', { exact: true }).fill('60');
  await page.getByRole('button', { name: 'Set the reference' }).click();
  const session = await page.context().newCDPSession(page);
  const megabytes: number[] = [];
  const measure = async () => {
    await session.send('HeapProfiler.collectGarbage');
    const { usedSize } = await session.send('Runtime.getHeapUsage');
    const nodes = (await session.send('Memory.getDOMCounters')).nodes;
    megabytes.push(usedSize / 1e6);
    console.log(`heap ${(usedSize / 1e6).toFixed(2)} MB, ${nodes} nodes of the document`);
  };
  await page.waitForTimeout(60_000);
  for (let minute = 0; minute < MINUTES; minute += EVERY_MINUTES) {
    await measure();
    await page.waitForTimeout(EVERY_MINUTES * 60_000);
  }
  await measure();
  await expect(page.locator('.state')).toContainText('armed');
  // A page that kept each sample would grow by 14 MB an hour for each of its channels.
  expect(megabytes.at(-1)! - megabytes[0]!).toBeLessThan(1);
});
