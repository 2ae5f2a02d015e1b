import { defineConfig } from '@playwright/test';

const PORT = Number(process.env.PORT ?? 8438);

export default defineConfig({
  testDir: process.env.TRIALS ? 'trials' : 'tests',
  timeout: 600_000,
  expect: { timeout: 15_000 },
  // Boards run in real time: two at once on two cores would hold each other up.
  workers: 1,
  retries: 0,
  reporter: [['list']],
  use: {
    baseURL: `http://127.0.0.1:${PORT}/`,
    browserName: 'chromium',
    launchOptions: {
      executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
      args: ['--no-sandbox', '--disable-gpu'],
    },
    viewport: { width: 1200, height: 900 },
  },
  webServer: { command: `node serve.mjs ${PORT}`, port: PORT, reuseExistingServer: false },
});
