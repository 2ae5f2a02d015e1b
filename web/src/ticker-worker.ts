/** A clock that a page in the background keeps as well: its own timers become slow. */
self.onmessage = ({ data }: MessageEvent<number>) => setInterval(() => self.postMessage(0), data);
