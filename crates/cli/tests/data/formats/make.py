"""Makes the files of this directory with SciPy and NumPy: python3 make.py

A spin-up: u_V steps to 6 V, speed follows with 25 ms, current falls from 1 A."""

import json
import struct

import numpy as np
from scipy.io import savemat

t = np.arange(0, 0.2, 0.01)
u = np.where(t < 0.05, 0.0, 6.0)
x = np.where(t < 0.05, 0.0, 1 - np.exp(-(t - 0.05) / 0.025))
omega = 80 * x
current = np.where(t < 0.05, 0.0, 1.0 - 0.9 * x)
columns = {"t_s": t, "u_V": u, "omega_rad_per_s": omega, "i_A": current}

savemat("plain.mat", {**columns, "comment": "a spin-up", "gains": np.eye(3)})
savemat("compressed.mat", {**columns, "run": {"t_s": t}}, do_compression=True)
# Other types and a row instead of a column, as MATLAB scripts leave them.
savemat("types.mat", {"t_s": t.astype(np.float32), "u_V": u.astype(np.int16), "omega_rad_per_s": omega, "counts": np.arange(20, dtype=np.uint8)}, oned_as="column")
savemat("complex.mat", {"t_s": t, "u_V": u + 1j})

rows = np.zeros(len(t), dtype=[("t_s", "<f8"), ("u_V", ">f4"), ("omega_rad_per_s", "<f8"), ("counts", "<i2")])
rows["t_s"], rows["u_V"], rows["omega_rad_per_s"], rows["counts"] = t, u, omega, np.arange(20)
np.save("structured.npy", rows)
np.save("matrix.npy", np.column_stack([t, u, omega]))
np.savez("plain.npz", **columns, label=np.array("x"))
np.savez_compressed("compressed.npz", speed=omega / (2 * np.pi), t_s=t, u_V=u)


def sysid(direction):
    """A ramp and a step in one direction, in rotations, as SysId's legacy JSON has them."""
    slow = [[k * 0.02, direction * 0.02 * k, direction * 0.001 * k * k, direction * 0.1 * k] for k in range(1, 60)]
    fast = [[k * 0.02, direction * 7.0, direction * 0.2 * k, direction * 10.0] for k in range(1, 30)]
    return slow, fast


(slow_forward, fast_forward), (slow_backward, fast_backward) = sysid(1), sysid(-1)
file = {"sysid": True, "test": "Simple", "units": "Rotations", "unitsPerRotation": 1.0}
for name, start, test in [
    ("slow-forward", 10, slow_forward),
    ("slow-backward", 20, slow_backward),
    ("fast-forward", 30, fast_forward),
    ("fast-backward", 40, fast_backward),
]:
    file[name] = [[start + row[0], *row[1:]] for row in test]
with open("sysid.json", "w") as out:
    json.dump(file, out)


def record(entry, stamp_us, payload):
    """A data log record with the shortest fields that hold its numbers, as WPILib writes them."""
    size = lambda number: max(1, (number.bit_length() + 7) // 8)
    e, p, s = size(entry), size(len(payload)), size(stamp_us)
    p = {3: 4}.get(p, p)
    head = bytes([(e - 1) | (p - 1) << 2 | (s - 1) << 4])
    little = lambda number, count: number.to_bytes(count, "little")
    return head + little(entry, e) + little(len(payload), p) + little(stamp_us, s) + payload


def start(entry, name, kind):
    text = lambda text: struct.pack("<I", len(text)) + text.encode()
    return record(0, 1, b"\0" + struct.pack("<I", entry) + text(name) + text(kind) + text('{"source":"robot"}'))


log = b"WPILOG" + struct.pack("<HI", 0x0100, 5) + b"extra"
log += start(1, "NT:/motor/velocity", "double") + start(2, "NT:/motor/volts", "float") + start(3, "messages", "string")
log += record(3, 2, b"enabled")
last = None
for k in range(len(t)):
    stamp = 5_000_000 + 10_000 * k
    log += record(1, stamp, struct.pack("<d", omega[k] / (2 * np.pi)))
    # Written on change, a little later in the same pass.
    if u[k] != last:
        log += record(2, stamp + 37, struct.pack("<f", u[k]))
        last = u[k]
log += record(0, 6_000_000, b"\2" + struct.pack("<II", 1, 2) + b"{}") + record(0, 6_000_001, b"\1" + struct.pack("<I", 2))
with open("robot.wpilog", "wb") as out:
    out.write(log)
