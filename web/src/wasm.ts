/** The libraries on the page itself, for what takes no time: the board's side of the line, and names. */

import init, * as libraries from './pkg/motorbench_web.js';

let ready: Promise<typeof libraries> | null = null;

export function loaded(): Promise<typeof libraries> {
  ready ??= init().then(() => libraries);
  return ready;
}

export type Libraries = typeof libraries;

export interface Setting {
  name: string;
  unit: string;
  help: string;
  min: number;
  max: number;
  default: number;
}

export interface TripHelp {
  number: number;
  words: string;
  cure: string;
  setting: string | null;
}
