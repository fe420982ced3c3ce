"""Other people's masters understand every exception code of ours: python3-pymodbus by number, mbpoll in words.

Usage: modbus_exceptions.py EXCEPTION_DEVICE. Status 77: a master is not installed.
"""
import os
import shutil
import subprocess
import sys
import tempfile
import time

try:
    from pymodbus.client import ModbusSerialClient
    from pymodbus.pdu import ExceptionResponse
except ImportError:
    print("python3-pymodbus is not installed")
    sys.exit(77)
if shutil.which("mbpoll") is None:
    print("mbpoll is not installed")
    sys.exit(77)

WORDS = {
    1: "Illegal function",
    2: "Illegal data address",
    3: "Illegal data value",
    4: "Slave device or server failure",
    5: "Acknowledge",
    6: "Slave device or server is busy",
    8: "Memory parity error",
    10: "Gateway path unavailable",
    11: "Target device failed to respond",
}


def main():
    with tempfile.TemporaryDirectory() as folder:
        port = f"{folder}/port"
        device = subprocess.Popen([sys.argv[1], port])
        try:
            while not os.path.exists(port):
                assert device.poll() is None, "the device has ended"
                time.sleep(0.01)
            client = ModbusSerialClient(port, baudrate=19200, parity="N", timeout=2)
            assert client.connect()
            for code in WORDS:
                answer = client.read_holding_registers(code, 1, slave=1)
                assert isinstance(answer, ExceptionResponse) and answer.exception_code == code, f"{code}: {answer}"
            client.close()
            for code, words in WORDS.items():
                poll = ["mbpoll", "-m", "rtu", "-a", "1", "-t", "4", "-0", "-r", str(code), "-1", "-o", "2",
                        "-b", "19200", "-P", "none", port]
                said = subprocess.run(poll, capture_output=True, text=True)
                assert words in said.stdout + said.stderr, f"{code}: {said.stdout}{said.stderr}"
        finally:
            device.terminate()
            device.wait()
    print(f"pymodbus and mbpoll: {len(WORDS)} exception codes each")


main()
