// node-candied reads the same DBC, and decodes 2,000 signals of random place, length, byte order, sign and scale to
// what `meltbench show --dbc --frames` prints. Usage: dbc.js MELTBENCH, with candied in NODE_PATH
'use strict';
const fs = require('fs');
const os = require('os');
const path = require('path');
const { execFileSync } = require('child_process');

const meltbench = process.argv[2];
const { Dbc, Can } = require('candied');

const MESSAGES = 500;
const SIGNALS = 4; // Of each message.

// Park and Miller's generator: the same numbers on every machine.
let state = 20261122;
const random = (below) => (state = (state * 48271) % 2147483647) % below;

// 8 * byte + bit, as the format numbers bits: Motorola goes down to bit 0, and on at bit 7 of the next byte.
const bitsOf = (s) => Array.from({ length: s.length }, (_, n) => {
  if (s.order === 1) return s.start + n;
  const place = (s.start >> 3) * 8 + (7 - (s.start & 7)) + n;
  return (place >> 3) * 8 + (7 - (place & 7));
});

function makeSignals() {
  const taken = new Set();
  const signals = [];
  while (signals.length < SIGNALS) {
    const s = { name: `S${signals.length}`, start: random(64), length: 1 + random(signals.length === 0 ? 40 : 16), order: random(2),
      sign: '+-'[random(2)], factor: [1, 1, 0.5, 0.1, -2, 1e-3][random(6)], offset: [0, 0, -40, 12.5][random(4)] };
    const bits = bitsOf(s);
    if (bits.some((bit) => bit > 63 || taken.has(bit))) continue;
    bits.forEach((bit) => taken.add(bit));
    signals.push(s);
  }
  return signals;
}

const messages = Array.from({ length: MESSAGES }, (_, i) => ({ name: `M${i}`, id: 0x100 + i, signals: makeSignals(),
  payload: Array.from({ length: 8 }, () => random(256)) }));
const hex = (bytes) => bytes.map((byte) => byte.toString(16).padStart(2, '0').toUpperCase()).join('');
const write = (place) => 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: X\n\n' + messages.map((m) => `BO_ ${m.id} ${m.name}: 8 X\n` + m.signals.map(place).map((s) =>
  ` SG_ ${s.name} : ${s.start}|${s.length}@${s.order}${s.sign} (${s.factor},${s.offset}) [0|0] "V" X\n`).join('')).join('\n');
const log = messages.map((m, i) => `(${(i / 100).toFixed(6)}) can0 ${m.id.toString(16).toUpperCase().padStart(3, '0')}#${hex(m.payload)}\n`).join('');

const folder = fs.mkdtempSync(path.join(os.tmpdir(), 'dbc-'));
process.on('exit', () => fs.rmSync(folder, { recursive: true, force: true }));
fs.writeFileSync(path.join(folder, 'random.dbc'), write((s) => s));
fs.writeFileSync(path.join(folder, 'random.log'), log);
const shown = execFileSync(meltbench, ['show', path.join(folder, 'random.log'), '--dbc', path.join(folder, 'random.dbc'), '--frames'],
  { encoding: 'utf8' }).trim().split('\n');

const dbc = new Dbc();
const can = new Can();
// candied 2.2.0 misplaces Motorola signals that do not end at a byte's end. Laid out backwards, byte by byte, such a
// signal is an Intel one: bit p from the frame's first becomes bit 63 - p.
const mirror = (s) => (s.order === 1 ? s : { ...s, order: 1, start: 64 - ((s.start >> 3) * 8 + (7 - (s.start & 7))) - s.length });
const theirs = dbc.load(write(mirror));
let equal = 0;
const different = [];
messages.forEach((m, i) => {
  const ours = new Map([...(shown[i] || '').matchAll(/(\w+)=(\S+) V/g)].map((found) => [found[1], Number(found[2])]));
  for (const [name, signal] of theirs.messages.get(m.name).signals) {
    const isBackwards = m.signals.find((s) => s.name === name).order === 0;
    const value = can.decodeSignal(isBackwards ? [...m.payload].reverse() : m.payload, signal).value;
    // Both calculate in doubles; ours is printed with 15 digits.
    if (Math.abs(ours.get(name) - value) <= 1e-13 * Math.max(Math.abs(value), 40)) equal += 1;
    else different.push(`${m.name}.${name} ${JSON.stringify(m.signals.find((s) => s.name === name))} ${hex(m.payload)}: ours ${ours.get(name)}, theirs ${value}`);
  }
});
different.slice(0, 10).forEach((line) => console.log(line));
console.log(`node-candied and show --dbc: ${equal} of ${MESSAGES * SIGNALS} signals equal, ${different.length} different`);
process.exit(equal === MESSAGES * SIGNALS ? 0 : 1);
