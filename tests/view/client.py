"""A plain client of `conurb view`: HTTP and WebSocket over a socket, and the server itself as a child process."""
import base64
import json
import os
import signal
import socket
import struct
import subprocess
import time


class Server:
    """`conurb view CITY` on a free port."""

    def __init__(self, conurb, city, *options, command=None):
        self.process = subprocess.Popen(command or [conurb, "view", city, "--port", "0", *options],
                                        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.url = ""
        for line in self.process.stdout:  # --view of run and train may say more before
            if line.startswith("http"):
                self.url = line.strip()
                break
        if not self.url:
            raise RuntimeError("the server did not start: " + self.process.stderr.read())
        self.port = int(self.url.split(":")[2].split("/")[0])
        self.token = self.url.split("token=")[1] if "token=" in self.url else None

    def connect(self):
        return socket.create_connection(("127.0.0.1", self.port), timeout=60)

    def resident_kb(self):
        with open(f"/proc/{self.process.pid}/status", encoding="utf-8") as file:
            return int(next(line for line in file if line.startswith("VmRSS")).split()[1])

    def sockets(self):
        """Its open file descriptors that are sockets."""
        folder = f"/proc/{self.process.pid}/fd"
        count = 0
        for name in os.listdir(folder):
            try:
                count += os.readlink(f"{folder}/{name}").startswith("socket:")
            except FileNotFoundError:
                pass
        return count

    def alive(self):
        return self.process.poll() is None

    def stop(self, number=signal.SIGTERM):
        """Its exit code and what it wrote to the standard error."""
        self.process.send_signal(number)
        _, err = self.process.communicate(timeout=120)
        return self.process.returncode, err


def http(server, path="/", method="GET", body=b"", **headers):
    """Status, headers (lower case) and body."""
    lines = {"Host": f"127.0.0.1:{server.port}", "Connection": "close", **headers}
    with server.connect() as s:
        s.sendall(f"{method} {path} HTTP/1.1\r\n".encode() + "".join(
            f"{k.replace('_', '-')}: {v}\r\n" for k, v in lines.items()).encode() + b"\r\n" + body)
        data = b""
        while piece := s.recv(65536):
            data += piece
    head, _, rest = data.partition(b"\r\n\r\n")
    first, *others = head.decode("latin-1").split("\r\n")
    fields = {k.lower(): v for k, v in (line.split(": ", 1) for line in others if ": " in line)}
    return int(first.split()[1]) if first else 0, fields, rest


class Page:
    """What a page says over its WebSocket. Raises ConnectionError where the server refuses or closes."""

    def __init__(self, server, host=None, origin=None, cookie=None, query=""):
        self.socket = server.connect()
        host = host or f"127.0.0.1:{server.port}"
        lines = [f"GET /socket{query} HTTP/1.1", f"Host: {host}", "Upgrade: websocket", "Connection: Upgrade",
                 "Sec-WebSocket-Key: " + base64.b64encode(os.urandom(16)).decode(), "Sec-WebSocket-Version: 13",
                 "Sec-WebSocket-Protocol: conurb"]
        lines += [f"Origin: {origin}"] if origin else []
        lines += [f"Cookie: {cookie}"] if cookie else []
        self.rest, self.number, self.end = b"", 0, None
        self.socket.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        while b"\r\n\r\n" not in self.rest:
            self.fill()
        head, self.rest = self.rest.split(b"\r\n\r\n", 1)
        if b" 101 " not in head.split(b"\r\n")[0]:
            self.socket.close()
            raise ConnectionError(head.decode("latin-1").split("\r\n")[0])

    def fill(self):
        # Pings come in while nothing else does, so the socket's own limit is not enough.
        if self.end and time.monotonic() > self.end:
            raise TimeoutError("the message that was waited for did not come")
        piece = self.socket.recv(1 << 18)
        if not piece:
            raise ConnectionError("closed")
        self.rest += piece

    def send_raw(self, data, opcode=1, final=True):
        mask, n = os.urandom(4), len(data)
        head = bytes([(0x80 if final else 0) | opcode])
        if n < 126:
            head += bytes([0x80 | n])
        else:
            head += struct.pack(">BH", 0xfe, n) if n < 65536 else struct.pack(">BQ", 0xff, n)
        long_mask = mask * (n // 4 + 1)
        masked = (int.from_bytes(data, "big") ^ int.from_bytes(long_mask[:n], "big")).to_bytes(n, "big") if n else b""
        self.socket.sendall(head + mask + masked)

    def send(self, kind, **fields):
        self.number += 1
        self.send_raw(json.dumps({"type": kind, "id": self.number, **fields}).encode())
        return self.number

    def receive_raw(self):
        """Opcode and payload of the next message; answers pings."""
        whole, kind = b"", 0
        while True:
            while len(self.rest) < 2:
                self.fill()
            n, at = self.rest[1] & 127, 2
            extra = {126: 2, 127: 8}.get(n, 0)
            while len(self.rest) < at + extra:
                self.fill()
            if extra:
                n = int.from_bytes(self.rest[at:at + extra], "big")
                at += extra
            while len(self.rest) < at + n:
                self.fill()
            first, data, self.rest = self.rest[0], self.rest[at:at + n], self.rest[at + n:]
            opcode = first & 15
            if opcode == 8:
                raise ConnectionError("closed")
            if opcode == 9:
                self.send_raw(data, opcode=10)
                continue
            whole, kind = whole + data, kind or opcode
            if first & 0x80:
                return kind, whole

    def receive(self):
        """Head, JPEG and tail of the next message."""
        opcode, data = self.receive_raw()
        if opcode == 1:
            return json.loads(data), b"", b""
        n = struct.unpack("<I", data[:4])[0]
        head = json.loads(data[4:4 + n])
        return head, data[4 + n:4 + n + head["jpeg"]], data[4 + n + head["jpeg"]:]

    def until(self, test, seconds=60):
        self.end = time.monotonic() + seconds
        try:
            while not test((message := self.receive())[0]):
                pass
        finally:
            self.end = None
        return message

    def ask(self, kind, **fields):
        """The answer's head; RuntimeError with the text of a failure."""
        number = self.send(kind, **fields)
        message = self.until(lambda head: head.get("id") == number)
        if message[0]["type"] == "failed":
            raise RuntimeError(message[0]["text"])
        return message

    def view(self, pose, width=64, height=48, **fields):
        """Asks for a picture of a view of the city's facts; returns its number."""
        return self.send("view", rotation=pose["rotation"], centre=pose["centre"], vfov_deg=pose["vfov_deg"],
                         width=width, height=height, **fields)

    def close(self):
        self.socket.close()
