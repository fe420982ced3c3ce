"""python3-pymodbus works with the feeder at unit 1: every function of its map, and what is refused.

Usage: modbus_pymodbus.py PORT. The rig is modbus_rig.toml.
"""
import math
import struct
import sys
import time

from pymodbus.client import ModbusSerialClient
from pymodbus.constants import DeviceInformation
from pymodbus.mei_message import ReadDeviceInformationRequest
from pymodbus.other_message import GetCommEventLogRequest, ReadExceptionStatusRequest, ReportSlaveIdRequest
from pymodbus.pdu import ExceptionResponse

UNIT = 1
REPORT = 100


def words_of(value, low_first=False):
    words = struct.unpack(">HH", struct.pack(">f", value))
    return list(reversed(words)) if low_first else list(words)


def number_of(words, low_first=False):
    return struct.unpack(">f", struct.pack(">HH", *(reversed(words) if low_first else words)))[0]


class Feeder:
    def __init__(self, port):
        self.client = ModbusSerialClient(port, baudrate=19200, parity="N", timeout=1)
        assert self.client.connect()
        self.checks = 0

    def holds(self, what, condition):
        self.checks += 1
        assert condition, what

    def refused(self, what, code, answer):
        self.holds(f"{what}: {answer}", isinstance(answer, ExceptionResponse) and answer.exception_code == code)

    def done(self, what, answer):
        self.holds(f"{what}: {answer}", not answer.isError())
        return answer

    def registers(self, first, count):
        return self.done(f"read {first}", self.client.read_holding_registers(first, count, slave=UNIT)).registers

    def number(self, at, low_first=False):
        return number_of(self.registers(at, 2), low_first)


def use_functions(feeder):
    client = feeder.client
    feeder.done("16", client.write_registers(0, words_of(5.25), slave=UNIT))
    feeder.holds("set point in force", feeder.number(REPORT + 18) == 5.25)
    time.sleep(0.05)  # Latency and control cycle: 3 ms.
    feeder.holds("delivered", feeder.number(REPORT) == 5.25)
    report = feeder.done("4", client.read_input_registers(0, 26, slave=UNIT)).registers
    feeder.holds("input registers are the report", number_of(report[0:2]) == 5.25)
    feeder.holds("latency", report[22:24] == [0, 2000])
    feeder.done("6", client.write_register(9, 1, slave=UNIT))
    bits = feeder.done("2", client.read_discrete_inputs(0, 7, slave=UNIT)).bits[:7]
    feeder.holds("delivers, volumetric", bits == [True, False, False, False, False, False, True])
    feeder.done("5", client.write_coil(1, False, slave=UNIT))
    feeder.holds("1", feeder.done("1", client.read_coils(0, 5, slave=UNIT)).bits[:5] == [True] + 4 * [False])
    feeder.done("15", client.write_coils(0, [False, True], slave=UNIT))
    feeder.holds("stopped", client.read_coils(0, 2, slave=UNIT).bits[:2] == [False, True])
    feeder.done("15", client.write_coils(0, [True, False], slave=UNIT))
    answer = feeder.done("23", client.readwrite_registers(read_address=REPORT + 18, read_count=2, write_address=0,
                                                         write_registers=words_of(7.5), unit=UNIT))
    feeder.holds("23 writes before it reads", number_of(answer.registers) == 7.5)


def ask_identity(feeder):
    for code in (DeviceInformation.Basic, DeviceInformation.Regular, DeviceInformation.Extended):
        answer = feeder.client.execute(ReadDeviceInformationRequest(read_code=code, unit=UNIT))
        feeder.done("43/14", answer)
        feeder.holds("vendor", answer.information[0] == b"Meltbench")
        feeder.holds("product code", answer.information[1] == b"LIW-1")
    answer = feeder.client.execute(ReadDeviceInformationRequest(DeviceInformation.Specific, 1, unit=UNIT))
    feeder.holds("one object", answer.information == {1: b"LIW-1"})


def use_both_word_orders(feeder):
    feeder.done("low word first", feeder.client.write_register(10, 1, slave=UNIT))
    feeder.done("16", feeder.client.write_registers(0, words_of(3.125, low_first=True), slave=UNIT))
    feeder.holds("low first", feeder.number(REPORT + 18, low_first=True) == 3.125)
    feeder.done("high word first", feeder.client.write_register(10, 0, slave=UNIT))
    feeder.holds("high first", feeder.number(REPORT + 18) == 3.125)


def broadcast(feeder):
    feeder.client.write_register(9, 1, slave=0)  # Nobody answers.
    time.sleep(0.1)
    feeder.holds("broadcast is done", feeder.registers(9, 1) == [1])
    feeder.done("back", feeder.client.write_register(9, 0, slave=UNIT))


def be_refused(feeder):
    client = feeder.client
    for request in (ReportSlaveIdRequest(unit=UNIT), ReadExceptionStatusRequest(unit=UNIT), GetCommEventLogRequest(unit=UNIT)):
        feeder.refused("unknown function", 1, client.execute(request))
    feeder.refused("address", 2, client.read_holding_registers(11, 1, slave=UNIT))
    feeder.refused("end of the report", 2, client.read_input_registers(25, 2, slave=UNIT))
    feeder.refused("discrete inputs", 2, client.read_discrete_inputs(0, 9, slave=UNIT))
    feeder.refused("coils", 2, client.read_coils(5, 1, slave=UNIT))
    feeder.refused("read only", 2, client.write_registers(REPORT, [0, 0], slave=UNIT))
    feeder.refused("half of a float", 2, client.write_register(1, 0, slave=UNIT))
    feeder.refused("object", 2, client.execute(ReadDeviceInformationRequest(DeviceInformation.Specific, 9, unit=UNIT)))
    feeder.refused("not a number", 3, client.write_registers(0, words_of(math.nan), slave=UNIT))
    feeder.refused("mode", 3, client.write_register(9, 2, slave=UNIT))
    feeder.done("stop", client.write_coil(0, False, slave=UNIT))  # What is full stays full.
    feeder.done("refill", client.write_coil(2, True, slave=UNIT))
    feeder.refused("tare while refilling", 6, client.write_coil(4, True, slave=UNIT))
    time.sleep(1)
    feeder.refused("refill of a full hopper", 4, client.write_coil(2, True, slave=UNIT))


def main():
    feeder = Feeder(sys.argv[1])
    for step in (use_functions, ask_identity, use_both_word_orders, broadcast, be_refused):
        step(feeder)
    print(f"pymodbus: {feeder.checks} checks held")


main()
