// npm modbus-serial works with the feeder at unit 1: every function that it has, and what is refused.
// Usage: NODE_PATH=... node modbus_serial.js PORT. The rig is modbus_rig.toml.
"use strict";
const assert = require("assert");
const ModbusRTU = require("modbus-serial");

let checks = 0;
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
const words = (value) => {
  const bytes = Buffer.alloc(4);
  bytes.writeFloatBE(value);
  return [bytes.readUInt16BE(0), bytes.readUInt16BE(2)];
};
const holds = (what, condition) => {
  ++checks;
  assert(condition, what);
};
const refused = async (what, code, request) => {
  ++checks;
  await assert.rejects(request, (error) => error.modbusCode === code, what);
};

async function main() {
  const client = new ModbusRTU();
  // Not its buffered port: that does not know how long an answer to function 23 is.
  await client.connectRTU(process.argv[2], { baudRate: 19200, parity: "none" });
  client.setID(1);
  client.setTimeout(1000);

  await client.writeRegisters(0, words(5.25));
  holds("set point in force (3)", (await client.readHoldingRegisters(118, 2)).buffer.readFloatBE(0) === 5.25);
  const report = await client.readInputRegisters(0, 26);
  holds("largest flow (4)", report.buffer.readFloatBE(40) === 20);
  holds("latency", report.buffer.readUInt32BE(44) === 2000);
  await client.writeRegister(9, 1);
  holds("volumetric (2)", (await client.readDiscreteInputs(0, 7)).data[6] === true);
  await client.writeCoil(1, false);
  await client.writeCoils(0, [false, false]);
  holds("stopped (1)", (await client.readCoils(0, 5)).data.slice(0, 5).every((on) => on === false));
  await client.writeCoils(0, [true]);
  const identity = await client.readDeviceIdentification(1, 0);
  holds("identity (43/14)", identity.data[0] === "Meltbench" && identity.data[1] === "LIW-1");
  const answer = await client.readWriteRegisters(118, 2, 0, 2, words(7.5));
  holds("writes before it reads (23)", words(7.5).every((word, i) => answer.data[i] === word));

  await refused("unknown function", 1, client.reportServerID(0, 0));
  await refused("address", 2, client.readHoldingRegisters(50, 1));
  await refused("read only", 2, client.writeRegister(100, 1));
  await refused("half of a float", 2, client.writeRegister(0, 1));
  await refused("quantity", 3, client.readHoldingRegisters(0, 126));
  await refused("mode", 3, client.writeRegister(9, 2));
  await refused("not a number", 3, client.writeRegisters(0, words(NaN)));
  await client.writeCoil(0, false); // Stopped: what is full stays full.
  await client.writeCoil(2, true);
  await refused("tare while refilling", 6, client.writeCoil(4, true));
  await pause(1000);
  await refused("refill of a full hopper", 4, client.writeCoil(2, true));
  console.log(`modbus-serial: ${checks} checks held`);
  client.close(() => process.exit(0));
}

main().catch((error) => {
  console.error(`failed: ${error.stack || JSON.stringify(error)}`);
  process.exit(1);
});
