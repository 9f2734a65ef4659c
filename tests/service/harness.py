"""What the service tests share: a temporary folder, the real binary as a process, requests and checks.

SELENOGRAPH_BINARY names the executable. Python's standard library only. A test file imports setUpModule() and
tearDownModule(), or calls set_up() and tear_down() from its own, and main() at its end.
"""

import copy
import http.client
import io
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import unittest
import zipfile

BINARY = os.environ.get("SELENOGRAPH_BINARY", "")
PATIENCE_S = 120
REPOSITORY = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
WIDTH, HEIGHT = 48, 40
# Not all: tests of memory rely on their size.
PRODUCTS = ("image", "radiance", "depth", "range", "position", "geodetic", "normal", "angles", "lit", "gsd", "source")
PLACE = ("--south-deg", "-1", "--west-deg", "29", "--rows", "2")  # 2 x 2 tiles around 0 N 30 E

_folder = ""


def use(folder):
    """Everything goes below this folder."""
    global _folder
    os.makedirs(folder, exist_ok=True)
    _folder = folder


def set_up():
    use(tempfile.mkdtemp(prefix="selenograph-service-test-"))


def stop_all():
    for service in Service.started:  # those that a test left behind
        if service.process.poll() is None:
            service.process.terminate()  # one that is killed writes no counters
            try:
                service.process.wait(10)
            except subprocess.TimeoutExpired:
                service.process.kill()
                service.process.wait()
        service.close()


def tear_down():
    stop_all()
    shutil.rmtree(_folder, ignore_errors=True)


# For a test file that sets up, or removes, no more than that.
setUpModule, tearDownModule = set_up, tear_down


def path(*parts):
    """Below the temporary folder; an absolute path stays what it is."""
    return os.path.join(_folder, *parts)


def full_effort():
    """Whether all cases are asked for: SELENOGRAPH_TEST_EFFORT=full, as in tests/support/effort.h."""
    return os.environ.get("SELENOGRAPH_TEST_EFFORT") == "full"


def share(cases, part):
    """All cases by full effort, else one of `part` of them, evenly spread."""
    cases = list(cases)
    return cases if full_effort() else cases[::part]


def sanitized():
    """Whether the binary is a sanitizer's, whose heap is another and larger one: its presets say options for it."""
    return any(name.endswith("SAN_OPTIONS") for name in os.environ)


# For tests that measure memory or bound addresses.
of_memory = unittest.skipIf(sanitized(), "a sanitizer's heap")


def write(name, content):
    """A file of text, bytes or, of all else, JSON; returns its path."""
    if not isinstance(content, (str, bytes, bytearray)):
        content = json.dumps(content)
    with open(path(name), "w" if isinstance(content, str) else "wb") as file:
        file.write(content)
    return path(name)


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def wait_until(condition, what, patience_s=PATIENCE_S):
    """`what` is said of a condition that is not met in time: a text, or a function that makes it."""
    give_up = time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > give_up:
            raise AssertionError(f"not within {patience_s} s: {what() if callable(what) else what}")
        time.sleep(0.01)


def run(*arguments, stdout=subprocess.PIPE, **options):
    """A command of the binary, to its end."""
    return subprocess.run([BINARY, *arguments], stdout=stdout, stderr=subprocess.PIPE, text=True, timeout=PATIENCE_S * 5,
                          **options)


def sample(name, *options):
    """Writes sample terrain; returns its folder."""
    folder = path(name)
    subprocess.run([BINARY, "sample", folder, *options], check=True, stdout=subprocess.DEVNULL)
    return folder


def assets():
    """A copy of deploy/assets to change, and a map of everywhere; returns the folder."""
    folder = path("assets")
    shutil.copytree(os.path.join(REPOSITORY, "deploy", "assets"), folder)
    with open(os.path.join(folder, "maps", "everywhere.asc"), "w") as f:
        f.write("ncols 4\nnrows 2\nxllcorner -180\nyllcorner -90\ncellsize 90\n0.1 0.2 0.3 0.2\n0.2 0.1 0.2 0.3\n")
    with open(os.path.join(folder, "maps", "everywhere.json"), "w") as f:
        json.dump({"file": "everywhere.asc", "extent": {"south_deg": -90, "north_deg": 90, "west_deg": -180, "east_deg": 180}}, f)
    return folder


def service_with_assets():
    """Small sample terrain around 0 N 30 E, a copy of the assets to change, and a service of both."""
    sample("dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "2", "--columns", "2", "--ppd", "256")
    return Service("--assets-dir", assets())


def shared_data(name):
    """A folder of the data beside the project; None where there is none."""
    source = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    base = os.environ.get("SELENOGRAPH_SHARED_DATA") or os.path.join(source, "..", "shared", "data")
    folder = os.path.join(base, name)
    return folder if os.path.isdir(folder) else None


def frame_request(products=("radiance",), width=WIDTH, height=HEIGHT, samples=1, **changes):
    request = {
        "camera": {"model": "pinhole", "width": width, "height": height, "fov_deg": 40.0},
        "pose": {"geodetic": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": 20000.0}, "nadir": {"up_azimuth_deg": 0.0}},
        "sun": {"local": {"lat_deg": 0.0, "lon_deg": 30.0, "azimuth_deg": 90.0, "elevation_deg": 15.0}},
        "accuracy": {"samples_per_pixel": samples},
        "products": list(products),
    }
    request.update(changes)
    return request


def changed(document, path, value):
    """A copy with another value of the member at a path (names and indices)."""
    document = copy.deepcopy(document)
    place = document
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    return document


def long_frame():
    """A frame that no machine finishes within a test's other steps; always given up or past its deadline."""
    return frame_request(width=4000, height=4000, samples=100)


def meta_of(body):
    """The metadata of an NPZ answer."""
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        return json.loads(archive.read("meta.json"))


def arrays_of(body):
    """The arrays of an NPZ answer by product, and `meta`. Needs NumPy."""
    import numpy
    with numpy.load(io.BytesIO(body), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files if name != "meta.json"} | {"meta": meta_of(body)}


class Service:
    """A running `selenograph serve`."""

    started = []

    def __init__(self, *more, cache="cache", dem="dem", binary=None, options=None, limits=None, log=None):
        """With `more` options; or with these `options` alone. `limits` is called in the process before it starts. `log` is
        the file that takes its standard error. Its deadline is ten minutes unless an option or the environment says
        otherwise: frames are slow on a busy machine."""
        options = options or ["--port", "0", "--cache-dir", path(cache), *more, "--dem", path(dem)]
        command = [binary or BINARY, "serve", *options]
        self.log = log or tempfile.TemporaryFile()
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=self.log, text=True, preexec_fn=limits,
                                        env={"SELENOGRAPH_DEADLINE_S": "600"} | os.environ)
        Service.started.append(self)
        line = self.process.stdout.readline()
        found = re.search(r"listening on http://(\S+):(\d+)$", line.strip())
        if not found:
            self.process.kill()
            raise RuntimeError(f"did not start: {line!r} {self.log_text()}")
        self.host, self.port = found[1].strip("[]"), int(found[2])

    def log_text(self):
        # Without moving the file's offset, which is the service's as well: it would write where a seek has put it.
        return os.pread(self.log.fileno(), os.fstat(self.log.fileno()).st_size, 0).decode(errors="replace")

    def connect(self, timeout=PATIENCE_S):
        return http.client.HTTPConnection(self.host, self.port, timeout=timeout)

    def ask(self, method, path, body=None, headers=None, connection=None):
        """Returns (status, headers, body)."""
        own = connection is None
        connection = connection or self.connect()
        connection.request(method, path, body=body, headers=headers or {})
        answer = connection.getresponse()
        content = answer.read()
        if own:
            connection.close()
        return answer.status, answer.headers, content

    def post(self, path, document, accept="*/*", **headers):
        sent = {"Content-Type": "application/json", "Accept": accept}
        sent.update({name.replace("_", "-"): value for name, value in headers.items()})
        return self.ask("POST", path, json.dumps(document).encode(), sent)

    def frame(self, request, accept="*/*", **headers):
        return self.post("/v1/frames", request, accept, **headers)

    def arrays(self, request, path="/v1/frames"):
        """The arrays of the answer by product, and `meta`, `headers`, `body`."""
        status, headers, body = self.post(path, request, "application/x-npz")
        assert status == 200, (status, body[:500])
        return arrays_of(body) | {"headers": headers, "body": body}

    def resident_mb(self, what="VmRSS"):
        """Memory of the process in MiB; VmHWM is its peak."""
        with open(f"/proc/{self.process.pid}/status") as status:
            return next(int(line.split()[1]) / 1024 for line in status if line.startswith(what + ":"))

    def metric(self, name):
        text = self.ask("GET", "/metrics")[2].decode()
        found = re.search("^" + re.escape(name) + r" (\S+)$", text, re.M)
        return float(found[1]) if found else None

    def wait_for(self, name, value):
        wait_until(lambda: self.metric(name) == value, lambda: f"{name} is {self.metric(name)}, not {value}")

    def start_frame(self, request):
        """Sends a request and does not wait; close() the connection to leave."""
        connection = self.connect()
        connection.request("POST", "/v1/frames", json.dumps(request).encode(),
                           {"Content-Type": "application/json", "Accept": "application/x-npy"})
        return connection

    def raw(self, data):
        """Sends bytes as they are; returns everything until the server closes."""
        with socket.create_connection((self.host, self.port), timeout=PATIENCE_S) as s:
            s.sendall(data)
            received = b""
            while True:
                try:
                    got = s.recv(65536)
                except ConnectionResetError:
                    break
                if not got:
                    break
                received += got
        return received

    def stop(self):
        if self.process.poll() is None:
            self.process.terminate()
        code = self.process.wait(PATIENCE_S)
        self.close()
        return code

    def expect_clean_stop(self):
        code = self.stop()
        assert code == 0, f"exit status {code} after SIGTERM"

    def kill(self):
        self.process.kill()
        self.process.wait(PATIENCE_S)
        self.close()

    def close(self):
        self.process.stdout.close()
        self.log.close()


class WithService(unittest.TestCase):
    options = ()

    @classmethod
    def setUpClass(cls):
        cls.service = Service(*cls.options)

    @classmethod
    def tearDownClass(cls):
        cls.service.expect_clean_stop()

    def problem(self, answer, status, pointer=None):
        got, headers, body = answer
        self.assertEqual(got, status, body[:500])
        self.assertEqual(headers["Content-Type"], "application/problem+json")
        self.assertNotIn("EXCEPTION_WHAT", headers)
        document = json.loads(body)
        self.assertEqual(document["status"], status)
        for member in ("type", "title", "detail"):
            self.assertTrue(document[member])
        if pointer is not None:
            self.assertIn(pointer, [error["pointer"] for error in document["errors"]])
        return document

    def ok(self, answer, content_type):
        status, headers, body = answer
        self.assertEqual(status, 200, body[:500])
        self.assertEqual(headers["Content-Type"], content_type)
        self.assertEqual(int(headers["Content-Length"]), len(body))
        return body

    def ok_json(self, answer):
        return json.loads(self.ok(answer, "application/json"))


def main():
    if not BINARY or not os.access(BINARY, os.X_OK):
        sys.exit("set SELENOGRAPH_BINARY to the executable")
    unittest.main(verbosity=2)
