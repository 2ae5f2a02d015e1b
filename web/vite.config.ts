import { createHash } from 'node:crypto';
import { readFileSync } from 'node:fs';
import { fileURLToPath } from 'node:url';
import { defineConfig, type Plugin } from 'vite';

const file = (path: string) => fileURLToPath(new URL(path, import.meta.url));

/** The two scripts of a report. The page shows reports in a frame, and its policy names these scripts by their hashes. */
const REPORT_SCRIPTS = ['../crates/report/assets/uplot/uPlot.iife.min.js', '../crates/report/assets/page.js'];

function contentSecurityPolicy(): Plugin {
  const hash = (path: string) => `'sha256-${createHash('sha256').update(readFileSync(file(path))).digest('base64')}'`;
  const policy = [
    "default-src 'none'",
    `script-src 'self' 'wasm-unsafe-eval' ${REPORT_SCRIPTS.map(hash).join(' ')}`,
    "style-src 'self' 'unsafe-inline'",
    "img-src 'self' data:",
    "connect-src 'self'",
    "worker-src 'self'",
    "frame-src 'self'",
    "manifest-src 'self'",
    "base-uri 'none'",
    "form-action 'none'",
  ].join('; ');
  return {
    name: 'content-security-policy',
    transformIndexHtml: {
      order: 'post',
      handler: html => html.replace(
        '<meta charset="utf-8">',
        `<meta charset="utf-8">\n    <meta http-equiv="Content-Security-Policy" content="${policy}">`,
      ),
    },
  };
}

/** The service worker knows every file of the site, so that the page works without a network after the first visit. */
function offline(): Plugin {
  return {
    name: 'offline',
    apply: 'build',
    generateBundle: {
      order: 'post',
      handler(_, bundle) {
        const files = ['./', 'manifest.webmanifest', 'icon.svg', 'firmware.hex'];
        const hash = createHash('sha256');
        for (const [name, part] of Object.entries(bundle).sort(([one], [other]) => (one < other ? -1 : 1))) {
          if (name !== 'index.html') files.push(name);
          hash.update(name).update(part.type === 'chunk' ? part.code : part.source);
        }
        for (const name of files.slice(1, 4)) {
          try {
            hash.update(readFileSync(file(`public/${name}`)));
          } catch {
            files.splice(files.indexOf(name), 1);
          }
        }
        const source = readFileSync(file('src/service-worker.js'), 'utf8')
          .replace('__VERSION__', hash.digest('hex').slice(0, 16))
          .replace("'__FILES__'", files.map(name => JSON.stringify(name)).join(', '));
        this.emitFile({ type: 'asset', fileName: 'service-worker.js', source });
      },
    },
  };
}

export default defineConfig({
  base: './',
  build: {
    target: 'es2022',
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    reportCompressedSize: false,
  },
  worker: { format: 'es' },
  plugins: [contentSecurityPolicy(), offline()],
});
