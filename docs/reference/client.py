#!/usr/bin/env python3
"""A client for the motorbench firmware, written from protocol.md alone.

    python3 client.py PORT

It reads the scales, the state and fifty samples of the board, and prints them. It never arms the drive.
"""

import math
import os
import select
import struct
import sys
import termios
import time
import tty

SAMPLES = 50
DIVIDER = 10
MODES = ["off", "open", "speed", "position", "lqr_speed", "lqr_position"]


class Board:
    """A serial line to the board."""

    def __init__(self, port):
        self.file = os.open(port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.file)
        attributes = termios.tcgetattr(self.file)
        attributes[4] = attributes[5] = termios.B500000
        termios.tcsetattr(self.file, termios.TCSANOW, attributes)
        self.received = b""
        self.text = b""
        self.next_number = None
        self.samples = []
        self.lost = self.damaged = 0

    def send(self, line):
        os.write(self.file, line.encode("ascii") + b"\n")

    def read(self, seconds):
        """Adds what comes within this time to what was received; false if nothing came."""
        ready, _, _ = select.select([self.file], [], [], seconds)
        if ready:
            self.received += os.read(self.file, 4096)
        return bool(ready)

    def begin(self):
        """Calls a board that may be starting, until it answers in plain text without echo."""
        end = time.monotonic() + 15
        while time.monotonic() < end:
            # The line feed ends what somebody else has begun.
            os.write(self.file, b"\nstream off\n")
            while self.read(0.3):
                pass
            if b"ok\r\n" in self.received:
                break
            self.received = b""
        else:
            sys.exit("no answer: is this the port of a board?")
        self.received = b""
        self.command("echo off")

    def command(self, line):
        """Sends a line; returns the information lines of its reply."""
        self.send(line)
        information, end = [], time.monotonic() + 5
        while time.monotonic() < end:
            while b"\n" in self.received:
                found, self.received = self.received.split(b"\n", 1)
                found = found.decode("ascii", "replace").strip()
                if found.startswith("# "):
                    information.append(found[2:])
                elif found.startswith("ok"):
                    return information
                elif found.startswith("error: "):
                    sys.exit(f"{line}: {found}")
            self.read(0.1)
        sys.exit(f"{line}: no answer")

    def setting(self, name):
        """The value of a setting: the second word of its line."""
        for line in self.command(f"show {name}"):
            words = line.split()
            if words[0] == name:
                return float(words[1])
        sys.exit(f"the board has no setting {name}")

    def frames(self):
        """Takes the whole frames out of what was received."""
        while b"\0" in self.received:
            encoded, self.received = self.received.split(b"\0", 1)
            content = decode(encoded)
            if content is None:
                self.damaged += 1
                continue
            kind, number, payload = content[0], content[1], content[2:-2]
            if self.next_number is not None:
                self.lost += (number - self.next_number) % 256
            self.next_number = (number + 1) % 256
            if kind == ord("s") and len(payload) == 22:
                self.samples.append(struct.unpack("<IiihhhhBB", payload))
            elif kind == ord("t"):
                self.text += payload


def decode(encoded):
    """Content of a frame without its zero; none if it is damaged."""
    content, place = b"", 0
    while place < len(encoded):
        code = encoded[place]
        if place + code > len(encoded):
            return None
        content += encoded[place + 1 : place + code]
        place += code
        if place < len(encoded) and code < 255:
            content += b"\0"
    if len(content) < 4 or crc(content[:-2]) != struct.unpack("<H", content[-2:])[0]:
        return None
    return content


def crc(data):
    """CRC-16/XMODEM."""
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ (0x1021 if value & 0x8000 else 0)) & 0xFFFF
    return value


def main():
    if len(sys.argv) != 2:
        sys.exit("usage: client.py PORT")
    assert crc(b"123456789") == 0x31C3
    board = Board(sys.argv[1])
    board.begin()
    for line in board.command("version"):
        print(line)
    tick_rate = board.setting("tick_rate")
    counts_per_rev = board.setting("counts_per_rev")
    speed_range = board.setting("speed_range")

    # A few characters of echo may still be there; the first frame begins behind the next zero.
    board.send(f"stream binary {DIVIDER}")
    end, asked = time.monotonic() + 30, False
    while (len(board.samples) < SAMPLES or b"illegal" not in board.text) and time.monotonic() < end:
        board.read(0.1)
        board.frames()
        if not asked and len(board.samples) >= SAMPLES // 2:
            board.send("status")
            asked = True
    board.send("stream off")
    stop = time.monotonic() + 5
    while not board.received.endswith(b"ok\r\n") and time.monotonic() < stop:
        board.read(0.1)
        board.frames()
    board.received = b""
    board.command("echo on")

    if len(board.samples) < SAMPLES:
        sys.exit(f"only {len(board.samples)} samples came")
    print(board.text.decode("ascii").replace("\r\n", "\n"), end="")
    tick, reference, counts, speed, current, duty, supply, state, trip = board.samples[-1]
    ticks = {after[0] - before[0] for before, after in zip(board.samples, board.samples[1:])}
    print(f"samples {len(board.samples)} lost {board.lost} damaged {board.damaged} every {sorted(ticks)} ticks")
    print(f"time {tick / tick_rate:.3f} s")
    print(f"mode {MODES[state & 7]} armed {state >> 3 & 1} enabled {state >> 4 & 1} trip {trip}")
    rad_per_count = 2 * math.pi / counts_per_rev
    value, unit = {
        0: (reference / 1024, "V"),
        1: (reference / 1024, "V"),
        2: (reference * speed_range / 32768, "rad/s"),
        4: (reference * speed_range / 32768, "rad/s"),
        3: (reference * rad_per_count, "rad"),
        5: (reference * rad_per_count, "rad"),
    }[state & 7]
    print(f"reference {value:.3f} {unit}")
    print(f"angle {counts * rad_per_count:.4f} rad")
    print(f"speed {speed * speed_range / 32768:.3f} rad/s")
    print(f"current {current / 4096:.3f} A")
    print(f"duty {duty / 800:.3f}")
    print(f"supply {supply / 1024:.2f} V")


if __name__ == "__main__":
    main()
