// node-canopen is the master of the six boards, through the tap, in the place of our controller. It boots every board,
// reads and writes the whole dictionary of each and compares it with the EDS (objects, types, access, defaults, limits),
// remaps a PDO, transfers blocks, and provokes every abort code that a board can be brought to.
//
// Usage, from the root: NODE_PATH=... node canopen_master.js MELTBENCH
const { spawn } = require('child_process');
const fs = require('fs');
const os = require('os');
const path = require('path');
const ini = require('ini');
const { Device, Eds, NmtState, SdoError } = require('canopen');
const typeToRaw = require('canopen/source/functions/type_to_raw');
const { Socketcand } = require('./socketcand');

const SCENARIO = path.join(__dirname, 'without_controller.toml');
const EDS_FOLDER = path.join(__dirname, '../../fixtures/boards');
const BOARDS = { feeder: 5, screw_drive: 6, melt_pressure: 7, preconditioner: 8, melt_camera: 9, heater: 10 };
const MASTER = 127;
const SDO_TIMEOUT_MS = 2000; // The default of 30 ms is for machines that have nothing else to do.

const Abort = {
  BAD_COMMAND: 0x05040001, READ_WRITE_ONLY: 0x06010001, WRITE_READ_ONLY: 0x06010002, NO_OBJECT: 0x06020000,
  NOT_MAPPABLE: 0x06040041, MAP_TOO_LONG: 0x06040042, LENGTH: 0x06070010, TOO_LONG: 0x06070012, TOO_SHORT: 0x06070013,
  NO_SUB: 0x06090011, VALUE: 0x06090030, TOO_HIGH: 0x06090031, TOO_LOW: 0x06090032, NOT_STORED: 0x08000020,
  STATE: 0x08000022, NO_DATA: 0x08000024,
};
const WRONG_LENGTH = [Abort.LENGTH, Abort.TOO_LONG, Abort.TOO_SHORT];

let failures = 0;
let checked = 0;

function check(holds, statement) {
  checked += 1;
  if (holds) return;
  failures += 1;
  console.log(`does not hold: ${statement}`);
}

const hex = (code) => code === undefined ? 'accepted' : `0x${code.toString(16).toUpperCase().padStart(8, '0')}`;
const name_of = (entry) => `${entry.index.toString(16).toUpperCase()}:${(entry.subIndex || 0).toString(16)} ${entry.parameterName}`;

/** One board as the master sees it. */
class Board {
  constructor(master, name, id) {
    Object.assign(this, { master, name, id });
    this.eds = Eds.fromFile(path.join(EDS_FOLDER, `${name}.eds`));
    const sections = ini.parse(fs.readFileSync(path.join(EDS_FOLDER, `${name}.eds`), 'utf8'));
    this.file = Object.fromEntries(Object.entries(sections).map(([key, section]) => [key.replace('sub', '_').toUpperCase(), section]));
    master.eds.addSdoClientParameter(id, 0x600 + id, 0x580 + id);
    // Sub-index 0 of an object that has others is read by the library as the count of those.
    this.entries = [...this.eds.values()].flatMap((object) => object._subObjects ? object._subObjects.filter(Boolean) : [object]);
  }

  find(index, subIndex = 0) {
    return this.entries.find((entry) => entry.index === index && (entry.subIndex || 0) === subIndex);
  }

  read(index, subIndex = 0, options = {}) {
    return this.master.sdo.upload({ deviceId: this.id, index, subIndex, timeout: SDO_TIMEOUT_MS, ...options });
  }

  write(index, subIndex, data, options = {}) {
    return this.master.sdo.download({ deviceId: this.id, index, subIndex, data, timeout: SDO_TIMEOUT_MS, ...options });
  }

  write_u32(index, subIndex, value) {
    return this.write(index, subIndex, typeToRaw(value >>> 0, 'UNSIGNED32'));
  }

  write_u8(index, subIndex, value) {
    return this.write(index, subIndex, Buffer.from([value]));
  }

  /** The abort code of what was tried; undefined if it was accepted. */
  static async abort_of(attempt) {
    try {
      await attempt;
    } catch (error) {
      if (!(error instanceof SdoError)) throw error;
      return error.code;
    }
    return undefined;
  }

  async expect_abort(attempt, codes, what) {
    const code = await Board.abort_of(attempt);
    check([codes].flat().includes(code), `${this.name}: ${what}: ${hex(code)}, must be ${[codes].flat().map(hex).join(' or ')}`);
  }
}

/** Frames that come until `enough` says so, or until nothing has for a while. */
function collect(bus, enough, patience_ms = 3000) {
  return new Promise((resolve) => {
    const frames = [];
    let timer;
    const finish = () => {
      clearTimeout(timer);
      bus.off('frame', hear);
      resolve(frames);
    };
    const hear = (frame) => {
      frames.push(frame);
      if (enough(frames)) finish();
    };
    timer = setTimeout(finish, patience_ms);
    bus.on('frame', hear);
  });
}

const is_state = (board, state) => (frame) => frame.id === 0x700 + board.id && frame.data.length === 1 && frame.data[0] === state;

async function wait_for_state(bus, board, state, act) {
  const seen = collect(bus, (frames) => frames.some(is_state(board, state)));
  act();
  check((await seen).some(is_state(board, state)), `${board.name}: reaches NMT state ${state}`);
}

function default_of(entry, id) {
  if (entry.defaultValue === undefined || entry.defaultValue === '') return undefined;
  const text = String(entry.defaultValue);
  if (entry.dataTypeString.endsWith('_STRING')) return Buffer.from(text);
  const value = text.includes('$NODEID') ? id + Number(text.replace('$NODEID', '').replace('+', '')) : Number(text);
  return typeToRaw(value, entry.dataType);
}

const is_string = (entry) => entry.dataTypeString.endsWith('_STRING');
const is_writable = (entry) => /^(rw|wo)/.test(entry.accessType);

const is_mapping = ({ index }) => (index >= 0x1600 && index < 0x1800) || (index >= 0x1A00 && index < 0x1C00);
const is_live = (entry) => entry.accessType === 'ro' && Number(entry.pdoMapping) === 1;

async function read_dictionary(board) {
  const values = new Map();
  for (const entry of board.entries) {
    const sub = entry.subIndex || 0;
    if (entry.accessType === 'wo') {
      await board.expect_abort(board.read(entry.index, sub), Abort.READ_WRITE_ONLY, `reading ${name_of(entry)}`);
      continue;
    }
    if (entry.index === 0x1003 && sub > 0 && sub > values.get(board.find(0x1003))[0]) {
      await board.expect_abort(board.read(entry.index, sub), Abort.NO_DATA, `reading ${name_of(entry)}, where no error is`);
      continue;
    }
    let value;
    const code = await Board.abort_of(board.read(entry.index, sub).then((data) => { value = data; }));
    check(code === undefined, `${board.name}: ${name_of(entry)} can be read, but ${hex(code || 0)}`);
    if (code !== undefined) continue;
    values.set(entry, value);
    const size = typeToRaw(0, entry.dataType).length;
    check(is_string(entry) || value.length === size, `${board.name}: ${name_of(entry)} is a ${entry.dataTypeString}, but has ${value.length} bytes`);
    const expected = default_of(entry, board.id);
    if (expected === undefined || is_live(entry)) continue;
    check(value.equals(expected), `${board.name}: ${name_of(entry)} (${entry.accessType}) is ${value.toString('hex')}, its default ${expected.toString('hex')}`);
  }
  return values;
}

async function write_dictionary(board, values) {
  for (const entry of board.entries) {
    const sub = entry.subIndex || 0;
    const value = values.get(entry);
    if (!is_writable(entry)) {
      if (value) await board.expect_abort(board.write(entry.index, sub, value), Abort.WRITE_READ_ONLY, `writing ${name_of(entry)}`);
      continue;
    }
    const size = typeToRaw(0, entry.dataType).length;
    await board.expect_abort(board.write(entry.index, sub, Buffer.alloc(size + 1)), WRONG_LENGTH, `${name_of(entry)} with a byte too many`);
    if (size > 1) await board.expect_abort(board.write(entry.index, sub, Buffer.alloc(size - 1)), WRONG_LENGTH, `${name_of(entry)} with a byte too few`);
    await write_beyond_limits(board, entry);
    if (!value || entry.index === 0x1010 || entry.index === 0x1011 || is_mapping(entry)) continue;
    const code = await Board.abort_of(board.write(entry.index, sub, value));
    check(code === undefined, `${board.name}: ${name_of(entry)} takes its own value, but ${hex(code || 0)}`);
    const again = await board.read(entry.index, sub);
    check(again.equals(value), `${board.name}: ${name_of(entry)} is ${again.toString('hex')} after writing ${value.toString('hex')}`);
  }
}

/** Mapping objects can be written only while their PDO is off and maps nothing. */
async function write_mappings(board, values) {
  for (const count of board.entries.filter((entry) => is_mapping(entry) && !entry.subIndex)) {
    const parameters = count.index - 0x200;
    const cob_id = values.get(board.find(parameters, 1)).readUInt32LE();
    const mapping = board.entries.filter((entry) => entry.index === count.index && entry.subIndex);
    const is_valid = cob_id < 0x80000000;
    const maps = is_valid || values.get(count)[0] > 0;
    if (is_valid) await board.expect_abort(board.write(count.index, 0, values.get(count)), Abort.STATE, `${name_of(count)} of a valid PDO`);
    await board.write_u32(parameters, 1, (cob_id | 0x80000000) >>> 0);
    if (maps) await board.expect_abort(board.write(count.index, 1, values.get(mapping[0])), Abort.STATE, `${name_of(mapping[0])} of a PDO that maps`);
    await board.write_u8(count.index, 0, 0);
    for (const entry of mapping) {
      const value = values.get(entry);
      const code = await Board.abort_of(board.write(entry.index, entry.subIndex, value));
      check(code === undefined, `${board.name}: ${name_of(entry)} takes its own value ${value.toString('hex')}, but ${hex(code || 0)}`);
    }
    await board.write(count.index, 0, values.get(count));
    await board.write_u32(parameters, 1, cob_id);
    for (const entry of [count, ...mapping])
      check((await board.read(entry.index, entry.subIndex || 0)).equals(values.get(entry)), `${board.name}: ${name_of(entry)} after remapping`);
  }
}

async function write_beyond_limits(board, entry) {
  // The library keeps whole limits other than 0 only: these are from the file.
  const section = board.file[entry.key.replace('sub', '_').toUpperCase()] || {};
  for (const [text, sign, code] of [[section.LowLimit, -1, Abort.TOO_LOW], [section.HighLimit, 1, Abort.TOO_HIGH]]) {
    if (text === undefined || text === '') continue;
    const limit = Number(text);
    const step = entry.dataTypeString.startsWith('REAL') ? Math.max(1, Math.abs(limit) / 1000) : 1;
    let beyond;
    try {
      beyond = typeToRaw(limit + sign * step, entry.dataType);
    } catch {
      continue; // The limit is that of the type.
    }
    await board.expect_abort(board.write(entry.index, entry.subIndex || 0, beyond), [code, Abort.VALUE], `${name_of(entry)} beyond ${limit}`);
  }
}

async function boot(bus, board) {
  await wait_for_state(bus, board, 0, () => board.master.nmt.resetNode(board.id));
  for (const [index, sub] of [[0x1000, 0], [0x1018, 1], [0x1018, 2], [0x1018, 3], [0x1018, 4]]) {
    const expected = default_of(board.find(index, sub), board.id);
    check((await board.read(index, sub)).equals(expected), `${board.name}: identity ${index.toString(16)}:${sub}`);
  }
  await board.write(0x1017, 0, typeToRaw(20, 'UNSIGNED16'));
  await wait_for_state(bus, board, NmtState.OPERATIONAL, () => board.master.nmt.startNode(board.id));
  await wait_for_state(bus, board, NmtState.STOPPED, () => board.master.nmt.stopNode(board.id));
  await wait_for_state(bus, board, NmtState.PRE_OPERATIONAL, () => board.master.nmt.enterPreOperational(board.id));
  await wait_for_state(bus, board, 0, () => board.master.nmt.resetNode(board.id));
}

async function test_abort_codes(bus, board) {
  await board.expect_abort(board.read(0x5FFF), Abort.NO_OBJECT, 'reading an object that is not there');
  await board.expect_abort(board.write_u8(0x5FFF, 0, 1), Abort.NO_OBJECT, 'writing an object that is not there');
  await board.expect_abort(board.read(0x1018, 9), Abort.NO_SUB, 'reading a sub-index that is not there');
  await board.expect_abort(board.read(0x1000, 1), Abort.NO_SUB, 'reading a sub-index of a plain variable');
  await board.expect_abort(board.write_u32(0x1010, 1, 0x12345678), Abort.NOT_STORED, 'storing with a wrong signature');
  await board.expect_abort(board.write_u32(0x1011, 1, 0x12345678), Abort.NOT_STORED, 'restoring with a wrong signature');
  await board.expect_abort(board.write_u8(0x1003, 0, 1), Abort.VALUE, 'clearing the error history with 1');
  await board.expect_abort(board.write_u32(0x1800, 1, 0x1AB), [Abort.STATE, Abort.VALUE], 'a new COB-ID for a valid PDO');
  await board.expect_abort(board.write_u8(0x1800, 2, 252), Abort.VALUE, 'a transmission type that is not supported');
  await board.expect_abort(board.write_u8(0x1A00, 0, 9), [Abort.VALUE, Abort.TOO_HIGH, Abort.MAP_TOO_LONG, Abort.STATE], 'nine objects in a valid PDO');
  const answer = collect(bus, (frames) => frames.some((frame) => frame.id === 0x580 + board.id));
  bus.send({ id: 0x600 + board.id, data: Buffer.from([0xE0, 0, 0x10, 0, 0, 0, 0, 0]) });
  const abort = (await answer).find((frame) => frame.id === 0x580 + board.id);
  check(abort && abort.data[0] === 0x80 && abort.data.readUInt32LE(4) === Abort.BAD_COMMAND, `${board.name}: a command that is none is aborted with 05040001`);
}

/** Maps error register and the first mappable object into TPDO 1, sends it at SYNC under another identifier. */
async function test_remapping(bus, board) {
  const cob_id = 0x1E0 + board.id;
  const mapped = board.entries.find((entry) => Number(entry.pdoMapping) === 1 && entry.accessType === 'ro' && entry.index >= 0x6000);
  const bits = (entry) => 8 * typeToRaw(0, entry.dataType).length;
  const word = (entry) => (entry.index * 0x10000 + (entry.subIndex || 0) * 0x100 + bits(entry)) >>> 0;
  await board.write_u32(0x1800, 1, 0x80000000 + 0x180 + board.id);
  await board.write_u8(0x1A00, 0, 0);
  await board.expect_abort(board.write_u32(0x1A00, 1, 0x10000020), Abort.NOT_MAPPABLE, 'mapping what is not mappable');
  await board.expect_abort(board.write_u32(0x1A00, 1, 0x5FFF0008), [Abort.NO_OBJECT, Abort.NOT_MAPPABLE], 'mapping what is not there');
  for (let sub = 1; sub <= 8; ++sub) await Board.abort_of(board.write_u32(0x1A00, sub, word(mapped)));
  if (bits(mapped) > 8) await board.expect_abort(board.write_u8(0x1A00, 0, 8), Abort.MAP_TOO_LONG, 'more than 64 bits');
  await board.write_u32(0x1A00, 1, 0x10010008);
  await board.write_u32(0x1A00, 2, word(mapped));
  await board.write_u8(0x1A00, 0, 2);
  await board.write_u8(0x1800, 2, 1);
  await board.write_u32(0x1800, 1, cob_id);
  await wait_for_state(bus, board, NmtState.OPERATIONAL, () => {
    board.master.nmt.startNode(board.id);
    board.write(0x1017, 0, typeToRaw(20, 'UNSIGNED16'));
  });
  const seen = collect(bus, (frames) => frames.filter((frame) => frame.id === cob_id).length === 3);
  for (let i = 0; i < 3; ++i) bus.send({ id: 0x080, data: Buffer.alloc(0) });
  const frames = (await seen).filter((frame) => frame.id === cob_id);
  check(frames.length === 3, `${board.name}: the remapped PDO comes at each SYNC, but ${frames.length} of 3`);
  const length = 1 + bits(mapped) / 8;
  check(frames.every((frame) => frame.data.length === length), `${board.name}: the remapped PDO has ${length} bytes`);
  const error_register = await board.read(0x1001);
  check(frames.length > 0 && frames[2].data[0] === error_register[0], `${board.name}: the remapped PDO begins with the error register`);
  await wait_for_state(bus, board, 0, () => board.master.nmt.resetNode(board.id));
  check((await board.read(0x1800, 1)).equals(default_of(board.find(0x1800, 1), board.id)), `${board.name}: a reset takes the PDO back`);
}

async function test_blocks(board) {
  for (const index of [0x1008, 0x1009, 0x100A]) {
    const plain = await board.read(index);
    const block = await board.read(index, 0, { blockTransfer: true });
    check(plain.equals(block) && plain.length > 4, `${board.name}: ${index.toString(16)} by block as by segments: "${plain}", "${block}"`);
  }
  await board.expect_abort(board.read(0x5FFF, 0, { blockTransfer: true }), Abort.NO_OBJECT, 'block upload of nothing');
  const period = typeToRaw(30, 'UNSIGNED16');
  await board.write(0x1017, 0, period, { blockTransfer: true });
  check((await board.read(0x1017)).equals(period), `${board.name}: a block download arrives`);
  await board.expect_abort(board.write(0x1017, 0, Buffer.alloc(100), { blockTransfer: true }), WRONG_LENGTH, 'a block that is too long');
  await board.expect_abort(board.write(0x1000, 0, Buffer.alloc(4), { blockTransfer: true }), Abort.WRITE_READ_ONLY, 'a block into a constant');
  await board.write(0x1017, 0, typeToRaw(0, 'UNSIGNED16'));
}

function start_bench(meltbench, out) {
  const bench = spawn(meltbench, ['run', SCENARIO, '--pace', 'realtime', '--tap', '0', '--tap-wait', '1', '--quiet', '--out', out], { stdio: ['ignore', 'pipe', 'ignore'] });
  return new Promise((resolve, reject) => {
    let said = '';
    bench.on('exit', () => reject(new Error(`the bench ended: ${said}`)));
    bench.stdout.on('data', (text) => {
      said += text;
      const port = said.match(/127\.0\.0\.1:(\d+)\n/);
      if (port) resolve({ bench, port: Number(port[1]) });
    });
  });
}

async function main() {
  const out = fs.mkdtempSync(path.join(os.tmpdir(), 'meltbench_canopen_'));
  const { bench, port } = await start_bench(process.argv[2], out);
  try {
    const bus = await Socketcand.connect(port);
    const master = new Device({ id: MASTER, eds: new Eds() });
    master.on('message', (message) => bus.send(message));
    bus.on('frame', (frame) => master.receive(frame));
    const boards = Object.entries(BOARDS).map(([name, id]) => new Board(master, name, id));
    const boot_ups = await collect(bus, (frames) => boards.every((board) => frames.some(is_state(board, 0))));
    for (const board of boards) check(boot_ups.some(is_state(board, 0)), `${board.name}: says that it is there`);
    master.start();
    for (const board of boards) {
      const before = checked;
      await boot(bus, board);
      const values = await read_dictionary(board);
      await write_dictionary(board, values);
      await write_mappings(board, values);
      await test_abort_codes(bus, board);
      await test_remapping(bus, board);
      await test_blocks(board);
      console.log(`${board.name}: ${board.entries.length} entries, ${checked - before} checks`);
    }
    master.stop();
    bus.close();
  } finally {
    bench.removeAllListeners('exit');
    bench.kill('SIGINT');
    await new Promise((resolve) => { bench.on('exit', resolve); });
    fs.rmSync(out, { recursive: true });
  }
  console.log(`node-canopen: ${checked - failures} of ${checked} checks hold`);
  process.exit(failures === 0 ? 0 : 1);
}

main().catch((error) => {
  console.log(error.stack);
  process.exit(1);
});
