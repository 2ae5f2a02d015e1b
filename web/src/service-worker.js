// Keeps every file of the site, so that the page works without a network. A new version takes over at the next visit.
const CACHE = 'motorbench-__VERSION__';
const FILES = ['__FILES__'];

self.addEventListener('install', event => {
  event.waitUntil(
    caches
      .open(CACHE)
      .then(cache => cache.addAll(FILES.map(file => new Request(file, { cache: 'reload' }))))
      .then(() => self.skipWaiting()),
  );
});

self.addEventListener('activate', event => {
  const old = caches.keys().then(keys => Promise.all(keys.filter(key => key !== CACHE).map(key => caches.delete(key))));
  event.waitUntil(old.then(() => self.clients.claim()));
});

self.addEventListener('fetch', event => {
  const { request } = event;
  if (request.method !== 'GET' || new URL(request.url).origin !== location.origin) return;
  // The part behind `?` or `#` chooses no other file.
  event.respondWith(caches.match(request, { ignoreSearch: true }).then(kept => kept ?? fetch(request)));
});
