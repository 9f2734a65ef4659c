#!/usr/bin/env python3
"""Drives the real binary over HTTP against the contract. Python's standard library and NumPy only.

Tests wait for states (metrics, completion), never for wall time, so that a busy machine makes them slow and not wrong.
"""

import concurrent.futures
import contextlib
import io
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import tempfile
import time
import unittest
import zipfile

import numpy as np

import harness
from harness import HEIGHT, PATIENCE_S, PLACE, WIDTH, Service, WithService, frame_request, long_frame, run, tearDownModule

DEM = ""

PRODUCTS = {
    "image": ("|u1", ()), "radiance": ("<f4", ()), "depth": ("<f8", ()), "range": ("<f8", ()), "position": ("<f8", (3,)),
    "geodetic": ("<f8", (3,)), "normal": ("<f4", (3,)), "angles": ("<f4", (3,)), "lit": ("<f4", ()), "gsd": ("<f4", ()),
    "source": ("<u2", ()),
}


def setUpModule():
    global DEM
    harness.set_up()
    DEM = harness.sample("dem", *PLACE, "--ppd", "256")


class Frames(WithService):
    def npy(self, name):
        body = self.ok(self.service.frame(frame_request([name]), "application/x-npy"), "application/x-npy")
        return np.load(io.BytesIO(body), allow_pickle=False)

    def test_every_product_as_npy_raw_and_tiff(self):
        for name, (dtype, components) in PRODUCTS.items():
            with self.subTest(product=name):
                array = self.npy(name)
                self.assertEqual(array.dtype, np.dtype(dtype))
                self.assertEqual(array.shape, (HEIGHT, WIDTH) + components)
                status, headers, body = self.service.frame(frame_request([name]), "application/octet-stream")
                self.assertEqual(status, 200)
                self.assertEqual(body, array.tobytes())
                self.assertEqual(np.dtype(headers["Selenograph-Dtype"]), np.dtype(dtype))
                self.assertEqual(tuple(int(n) for n in headers["Selenograph-Shape"].split(",")), array.shape)
                tiff = self.ok(self.service.frame(frame_request([name]), "image/tiff"), "image/tiff")
                self.assertIn(tiff[:4], (b"II*\0", b"MM\0*", b"II+\0"))

    def test_all_products_as_npz_with_metadata(self):
        body = self.ok(self.service.frame(frame_request(PRODUCTS), "application/x-npz"), "application/x-npz")
        with zipfile.ZipFile(io.BytesIO(body)) as archive:
            self.assertIsNone(archive.testzip())
            self.assertEqual(set(archive.namelist()), {name + ".npy" for name in PRODUCTS} | {"meta.json"})
        arrays = harness.arrays_of(body)
        self.assertIn("lod_error_px", arrays["meta"])
        for name in PRODUCTS:
            np.testing.assert_array_equal(arrays[name], self.npy(name), err_msg=name)

    def test_auto_reports_which_algorithm_it_chose(self):
        for request, chosen in ((frame_request(), "zbuffer"), (frame_request(["radiance"], 8, 8, accuracy={"max_error_px": 0.001}), "raytrace")):
            meta = json.loads(self.service.frame(request, "application/octet-stream")[1]["Selenograph-Meta"])
            self.assertEqual((meta["visibility"], meta["request"]["visibility"]), (chosen, "auto"))

    def test_stages_are_timed(self):
        _, headers, _ = self.service.frame(frame_request())
        stages = [stage.split(";")[0].strip() for stage in headers["Server-Timing"].split(",")]
        for stage in ("queue", "select", "build", "pyramid", "load", "visibility", "touch"):
            self.assertIn(stage, stages)
        for stage in headers["Server-Timing"].split(","):
            self.assertRegex(stage.strip(), r"^[a-z]+;dur=[0-9.]+$")

    # Compares times of one answer with each other. A stage that is counted twice makes the sum too large.
    def test_stages_add_up_to_the_total(self):
        light = {"relief", "views", "sunlit", "bounces", "gather"}
        parts = {"pyramid", "load", "draw", "resolve", "shadow", "touch", "total"} | light
        sensor = {"optics": {"f_number": 4.0},
                  "detector": {"pixel_pitch_um": 5.5, "quantum_efficiency": 0.4, "integration_time_s": 0.02, "gain_e_dn": 50.0}}
        exposed = {"band": {"center_um": 0.65, "width_um": 0.2}, "sensor": sensor}
        moving = dict(exposed, sensor=dict(sensor, motion={"velocity_m_s": [1000.0, 0.0, 0.0], "samples": 5}))
        camera = {key: frame_request()[key] for key in ("camera", "pose")}
        grid = {"projection": "equirectangular", "center": {"lat_deg": 0.1, "lon_deg": 30.1}, "width_m": 6400, "height_m": 6400,
                "gsd_m": 50}
        calls = {
            "z-buffer": ("/v1/frames", frame_request(["radiance"], 256, 256, visibility="zbuffer")),
            "ray tracing": ("/v1/frames", frame_request(["radiance"], 256, 256, visibility="raytrace")),
            "indirect": ("/v1/frames", frame_request(["radiance"], 64, 64, indirect={"terrain": True, "bounces": 2})),
            "sensor": ("/v1/frames", frame_request(["image"], 256, 256, **exposed)),
            "motion": ("/v1/frames", frame_request(["image"], 128, 128, **moving)),
            "cameras": ("/v1/frames", {"sun": frame_request()["sun"], "cameras": {"a": camera, "b": camera}}),
            "map": ("/v1/maps", {"map": grid, "sun": frame_request()["sun"]}),
            "indirect map": ("/v1/maps", {"map": grid, "sun": frame_request()["sun"], "indirect": {"terrain": True}}),
        }
        for name, (path, request) in calls.items():
            with self.subTest(name):
                status, headers, body = self.service.post(path, request)
                self.assertEqual(status, 200, body[:500])
                times = {stage: float(ms) for stage, ms in re.findall(r"(\w+);dur=([0-9.]+)", headers["Server-Timing"])}
                stages = {stage: ms for stage, ms in times.items() if stage not in parts}
                self.assertLessEqual({"queue", "parse", "select", "build", "visibility", "encode", "other"}, stages.keys())
                self.assertEqual(stages["indirect"] > 0, "indirect" in name)
                self.assertEqual(light <= times.keys(), "indirect" in name)
                if "indirect" in name:
                    gathered = sum(times[part] for part in light)
                    self.assertTrue(0.5 * times["indirect"] < gathered <= 1.01 * times["indirect"], times)
                    self.assertEqual(times["bounces"] > 0, name == "indirect", times)
                    self.assertGreater(min(times[part] for part in light - {"bounces"}), 0, times)
                self.assertAlmostEqual(sum(stages.values()) / times["total"], 1, delta=0.03, msg=times)


class OtherCalls(WithService):
    def test_why_a_landmark_has_no_place_in_the_image(self):
        request = {key: frame_request()[key] for key in ("camera", "pose")}
        # From 20 km above: 2 km lower and 9 km aside, 78 degrees from the boresight; 10 km higher.
        request["points"] = [{"lat_deg": 0.4, "lon_deg": 30.1, "height_m": 18000.0}, {"lat_deg": 0.4, "lon_deg": 30.1, "height_m": 30000.0}]
        pinhole = dict(request["camera"])
        fisheye = dict(pinhole, model="fisheye")
        beyond, behind = "beyond the lens's field of view", "behind the camera"
        for camera, expected in (
                (pinhole, [None, behind]),
                (dict(pinhole, distortion={"k1": -0.2}), [beyond, behind]),  # folds 52 degrees from the boresight
                (fisheye, [None, None]),
                (dict(fisheye, distortion={"model": "kannala_brandt", "k1": -0.2}), [beyond, beyond])):  # at 74 degrees
            points = self.ok_json(self.service.post("/v1/project", dict(request, camera=camera)))["points"]
            self.assertEqual([p.get("reason") for p in points], expected, camera)
            self.assertEqual([p["x_px"] is None for p in points], [e is not None for e in expected])
            self.assertFalse(any(p["in_frame"] for p in points))

    def test_metrics(self):
        # An answer is counted when it is sent. Its connection's next request is read after that, another's may be before.
        connection = self.service.connect()
        self.service.ask("POST", "/v1/frames", json.dumps(frame_request()).encode(), {"Content-Type": "application/json"}, connection)
        status, headers, body = self.service.ask("GET", "/metrics", connection=connection)
        connection.close()
        self.assertEqual(status, 200)
        self.assertTrue(headers["Content-Type"].startswith("text/plain; version=0.0.4"))
        text = body.decode()
        self.assertRegex(text, r'selenograph_http_requests_total\{route="/v1/frames",method="POST",status="200"\} [1-9]')
        version, build = re.search(r'selenograph_build_info\{version="([^"]+)",build="([0-9a-f]{16})"\} 1', text).groups()
        self.assertEqual(self.service.ask("GET", "/health/ready")[1]["Selenograph-Build"], build)
        for path in ("/v1/datasets", "/nowhere", "/metrics"):  # clients compare it with their own
            self.assertEqual(self.service.ask("GET", path)[1]["Server"], f"selenograph/{version}")
        self.assertGreater(self.service.metric("process_resident_memory_bytes"), 1e6)
        families = re.findall(r"^# TYPE (\S+)", text, re.M)
        self.assertEqual(len(families), len(set(families)))
        if shutil.which("promtool"):
            subprocess.run(["promtool", "check", "metrics"], input=body, check=True)

    def test_head(self):
        for path in ("/health/live", "/v1/datasets", "/openapi.json", "/metrics"):
            status, headers, body = self.service.ask("HEAD", path)
            self.assertEqual((status, body), (200, b""))
            self.assertGreater(int(headers["Content-Length"]), 0)


class Errors(WithService):
    options = ("--max-body-kb", "64", "--max-image-pixels", "1000000")

    def test_image_size_limit(self):
        self.problem(self.service.frame(frame_request(width=1001, height=1000)), 422)
        self.assertEqual(self.service.frame(frame_request(width=1000, height=1000))[0], 200)

    def test_wrong_type(self):
        for content_type in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x"):
            self.problem(self.service.ask("POST", "/v1/frames", b"{}", {"Content-Type": content_type}), 415)
        self.problem(self.service.ask("POST", "/v1/frames", b"{}", {"Content-Type": "application/json", "Content-Encoding": "gzip"}), 415)

    def test_not_found_and_wrong_method(self):
        self.problem(self.service.ask("GET", "/nothing"), 404)
        self.problem(self.service.ask("GET", "/v1/frames/../../etc/passwd"), 404)
        self.problem(self.service.ask("POST", "/nothing", b"{}", {"Content-Type": "application/json"}), 404)
        for method, path, allowed in (("GET", "/v1/frames", "POST"), ("POST", "/v1/datasets", "GET"), ("DELETE", "/v1/height", "GET"),
                                      ("PUT", "/health/live", "GET")):
            answer = self.service.ask(method, path, b"{}" if method != "GET" else None)
            self.problem(answer, 405)
            self.assertIn(allowed, answer[1]["Allow"])


class SlowClients(WithService):
    options = ("--max-connections", "24", "--idle-timeout-s", "600")

    def test_health_is_answered_while_all_connections_are_taken(self):
        """By clients that send nothing, or a body slowly; all else is refused until they are done, or late."""
        clients = [socket.create_connection((self.service.host, self.service.port), timeout=PATIENCE_S) for _ in range(12)]
        for _ in range(12):
            client = socket.create_connection((self.service.host, self.service.port), timeout=PATIENCE_S)
            client.sendall(b"POST /v1/frames HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 500\r\n\r\n{")
            clients.append(client)
        self.service.wait_for("selenograph_http_connections", 25)  # with the question's own
        for path in ("/health/live", "/health/ready", "/metrics"):
            self.assertEqual(self.service.ask("GET", path)[0], 200)
        answer = self.service.frame(frame_request())
        self.problem(answer, 503)
        self.assertGreaterEqual(int(answer[1]["Retry-After"]), 1)
        for client in clients:
            client.close()
        self.service.wait_for("selenograph_http_connections", 1)
        self.assertEqual(self.service.frame(frame_request())[0], 200)


class Busy(WithService):
    options = ("--max-frames", "1", "--max-waiting", "1", "--max-image-pixels", "16000000", "--deadline-s", "3600")

    def test_burst(self):
        first = self.service.start_frame(long_frame())
        self.service.wait_for("selenograph_frames_in_work", 1)
        second = self.service.start_frame(long_frame())
        self.service.wait_for("selenograph_frames_waiting", 1)

        for path, document in (("/v1/frames", frame_request()), ("/v1/heights", {"points": [{"lat_deg": 0, "lon_deg": 30}]})):
            answer = self.service.post(path, document)
            self.problem(answer, 503)
            self.assertGreaterEqual(int(answer[1]["Retry-After"]), 1)
        for path in ("/health/live", "/health/ready", "/metrics", "/v1/datasets", "/openapi.json"):
            self.assertEqual(self.service.ask("GET", path)[0], 200, path)

        # Clients that leave free their places, in the queue as in work.
        second.close()
        self.service.wait_for("selenograph_frames_waiting", 0)
        first.close()
        self.service.wait_for("selenograph_frames_in_work", 0)
        self.assertEqual(self.service.frame(frame_request())[0], 200)
        self.assertGreaterEqual(self.service.metric('selenograph_errors_total{code="busy"}'), 2)
        self.assertGreaterEqual(self.service.metric('selenograph_errors_total{code="client_gone"}'), 2)


class Deadlines(WithService):
    options = Busy.options

    def test_deadlines(self):
        self.problem(self.service.frame(long_frame(), Request_Timeout_Ms="100"), 504)  # stopped at work
        holder = self.service.start_frame(long_frame())
        self.service.wait_for("selenograph_frames_in_work", 1)
        self.problem(self.service.frame(frame_request(), Request_Timeout_Ms="100"), 504)  # stopped in the queue
        holder.close()
        self.service.wait_for("selenograph_frames_in_work", 0)
        self.problem(self.service.frame(frame_request(), Request_Timeout_Ms="soon"), 400)


class ServiceDeadline(WithService):
    options = ("--deadline-s", "0.2", "--max-image-pixels", "16000000")

    def test_the_services_own_deadline(self):
        self.problem(self.service.frame(frame_request(width=2000, height=2000, samples=4)), 504)
        self.problem(self.service.frame(frame_request(width=2000, height=2000, samples=4), Request_Timeout_Ms="9999999"), 504)


class Shutdown(unittest.TestCase):
    def frame_under_way(self, service, request):
        pool = concurrent.futures.ThreadPoolExecutor(1)
        frame = pool.submit(service.frame, request, "application/x-npy")
        service.wait_for("selenograph_frames_in_work", 1)
        return frame

    def test_sigterm_finishes_what_runs(self):
        for stop in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            service = Service("--max-frames", "2", "--max-image-pixels", "16000000", "--shutdown-s", "120")
            frame = self.frame_under_way(service, frame_request(width=1024, height=1024, samples=16))
            service.process.send_signal(stop)
            ready = 200
            while ready == 200 and not frame.done():
                try:
                    ready = service.ask("GET", "/health/ready")[0]
                except OSError:
                    break
            status, _, body = frame.result(PATIENCE_S)
            self.assertEqual(status, 200)
            self.assertEqual(np.load(io.BytesIO(body)).shape, (1024, 1024))
            self.assertEqual(service.process.wait(PATIENCE_S), 0)
            service.stop()

    def test_what_is_not_done_in_time_is_ended(self):
        """Frames in work and in the queue, and a body of which only the first byte has come."""
        service = Service("--shutdown-s", "3", "--max-frames", "2", "--max-image-pixels", "16000000", "--deadline-s", "3600")
        half = socket.create_connection((service.host, service.port))
        half.sendall(b"POST /v1/frames HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 500\r\n\r\n{")
        frames = [service.start_frame(long_frame()) for _ in range(4)]
        service.wait_for("selenograph_frames_waiting", 2)
        start = time.monotonic()
        self.assertEqual(service.stop(), 0)
        self.assertGreater(time.monotonic() - start, 1.8, "what runs is given its time")
        for connection in (half, *frames):
            connection.close()


class Commands(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(dir=harness.path())
        self.cache = harness.path("cache")

    def path(self, name, content=None):
        path = os.path.join(self.folder, name)
        if content is not None:
            with open(path, "w") as file:
                file.write(content)
        return path

    def test_the_operators_table_names_options_that_there_are(self):
        with open(os.path.join(os.path.dirname(__file__), "..", "..", "deploy", "operation", "limits.md")) as file:
            table = re.search(r"(?:^\|.*\n)+", file.read().split("Limits, and what")[1], re.M)[0]
        named, known = set(re.findall(r"`(--[a-z-]+)`", table)), run("serve", "--help").stdout
        self.assertGreater(len(named), 15)
        for option in named:
            self.assertRegex(known, re.escape(option) + r"\b")

    def test_help_and_version(self):
        self.assertRegex(run("--version").stdout, r"\d+\.\d+")
        for command in ((), ("serve",), ("ask",), ("ingest",), ("sample",), ("info",)):
            done = run(*command, "--help")
            self.assertEqual(done.returncode, 0)
            self.assertIn("--help", done.stdout)
        for option in ("--dem", "--host", "--port", "--cache-dir", "--cache-mb", "--threads", "--config"):
            self.assertIn(option, run("serve", "--help").stdout)
        self.assertNotEqual(run("serve", "--no-such-option").returncode, 0)
        self.assertNotEqual(run().returncode, 0)
        for command in (("info",), ("sample",), ("verify", "mertis"), ("batch", "verify")):
            self.assertRegex(run(*command, "--help").stdout, r"\(Env:SELENOGRAPH_[A-Z_]+\)")
        self.assertIn("SELENOGRAPH_<OPTION>", run("--help").stdout)

    def test_a_full_disk_behind_standard_output(self):
        for command in (("info", "--dem", DEM), ("sample", self.path("sample"), "--rows", "1", "--columns", "1", "--ppd", "16"),
                        ("verify", "mertis", "-o", self.path("mertis")), ("--version",)):
            with open("/dev/full", "w") as full:
                done = subprocess.run([harness.BINARY, *command], stdout=full, stderr=subprocess.PIPE, text=True, timeout=PATIENCE_S)
            self.assertEqual(done.returncode, 1, command)
            self.assertEqual(done.stderr, "error: standard output cannot be written\n")

    def test_standard_streams_that_are_closed(self):
        """What is said goes nowhere, into no other file of the process, and ends nothing."""
        def without(*streams):
            return lambda: [os.close(stream) for stream in streams]

        def status(command, closed, **options):
            return subprocess.run(command, preexec_fn=without(*closed), timeout=PATIENCE_S, **options).returncode

        port = harness.free_port()
        service = subprocess.Popen([harness.BINARY, "serve", "--port", str(port), "--dem", DEM, "--cache-dir", self.cache],
                                   preexec_fn=without(0, 1, 2))

        def answers():
            self.assertIsNone(service.poll(), "it has ended")
            with contextlib.suppress(ConnectionError), socket.create_connection(("127.0.0.1", port)) as s:
                s.sendall(b"GET /health/live HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
                return s.makefile("rb").read().startswith(b"HTTP/1.1 200 ")
            return False

        try:
            harness.wait_until(answers, "an answer")
        finally:
            service.terminate()
        self.assertEqual(service.wait(PATIENCE_S), 1)  # its address could not be printed

        request = self.path("request.json", json.dumps(frame_request()))
        render = [harness.BINARY, "ask", "frames", request, "-o", self.path("frame.npz"), "--dem", DEM, "--cache-dir", self.cache]
        self.assertEqual(status(render, (1, 2)), 1)
        self.assertTrue(zipfile.is_zipfile(self.path("frame.npz")))
        self.assertEqual(status(render, (2,), stdout=subprocess.DEVNULL), 0)
        wrong = [harness.BINARY, "info", "--dem", self.path("nowhere")]
        self.assertEqual(status(wrong, (2,)), 1)
        with open("/dev/full", "w") as full:
            self.assertEqual(status(wrong, (), stderr=full), 1)

    def test_a_file_of_settings_that_is_a_folder(self):
        done = run("info", "--dem", DEM, "--config", self.folder)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn(f"--config: File is actually a directory: {self.folder}", done.stderr)

    def test_seeds_of_64_bits(self):
        small = ("--rows", "1", "--columns", "1", "--ppd", "16", "--seed")
        self.assertEqual(run("sample", self.path("largest"), *small, "18446744073709551615").returncode, 0)
        for seed in ("-1", "18446744073709551616", "", " ", "{}"):
            done = run("sample", self.path("none"), *small, seed)
            self.assertNotEqual(done.returncode, 0)
            self.assertIn("--seed", done.stderr)
            self.assertFalse(os.path.exists(self.path("none")))

    def test_ask_gives_the_bytes_of_the_service(self):
        service = Service()
        for extension, accept, products in (("npy", "application/x-npy", ["depth"]), ("npz", "application/x-npz", list(PRODUCTS)),
                                            ("png", "image/png", ["image"]), ("tiff", "image/tiff", ["radiance"]),
                                            ("exr", "image/x-exr", ["radiance", "normal"]), ("raw", "application/octet-stream", ["range"])):
            with self.subTest(format=extension):
                request = frame_request(products)
                output = self.path("out." + extension)
                done = run("ask", "frames", self.path("request.json", json.dumps(request)), "-o", output, "--cache-dir", self.cache, "--dem", DEM)
                self.assertEqual(done.returncode, 0, done.stderr)
                status, _, body = service.frame(request, accept)
                self.assertEqual(status, 200)
                with open(output, "rb") as file:
                    self.assertEqual(file.read(), body)
        self.assertEqual([name for name in os.listdir(self.folder) if "part" in name], [])
        with open(output, "wb") as file:  # standard output by another name: what is said goes elsewhere
            done = run("ask", "frames", self.path("request.json"), "-o", output, "--cache-dir", self.cache, "--dem", DEM, stdout=file)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue(done.stderr.endswith(f"\n{output}: {len(body)} bytes\n"), done.stderr)
        with open(output, "rb") as file:
            self.assertEqual(file.read(), body)
        self.assertEqual(service.stop(), 0)

    def test_ask_reports_what_is_wrong(self):
        request = frame_request()
        request["camera"]["widht"] = 1
        done = run("ask", "frames", self.path("bad.json", json.dumps(request)), "-o", self.path("out.npy"), "--cache-dir", self.cache, "--dem", DEM)
        self.assertEqual(done.returncode, 1)
        self.assertIn("/camera/widht", done.stderr)
        self.assertFalse(os.path.exists(self.path("out.npy")))
        done = run("ask", "frames", self.path("good.json", json.dumps(frame_request())), "-o", self.path("out.jpg"), "--dem", DEM)
        self.assertEqual(done.returncode, 1)
        self.assertIn(".npy", done.stderr)

    def test_missing_dem_is_named(self):
        done = run("serve", "--port", "0", "--cache-dir", self.cache, "--dem", "/no/such/tile.lbl")
        self.assertEqual(done.returncode, 1)
        self.assertIn("/no/such/tile.lbl", done.stderr)

    def test_port_in_use(self):
        service = Service()
        done = run("serve", "--port", str(service.port), "--cache-dir", self.cache, "--dem", DEM)
        self.assertEqual(done.returncode, 1)
        self.assertIn(str(service.port), done.stderr)
        self.assertEqual(service.stop(), 0)

    def test_info(self):
        done = run("info", "--dem", DEM)
        self.assertEqual(done.returncode, 0)
        self.assertIn("4 DEM files", done.stdout)
        document = json.loads(run("info", "--json", "--dem", DEM).stdout)
        self.assertEqual(len(document["datasets"]), 4)
        self.assertNotIn("lowest_m", document["datasets"][0])
        found = json.loads(run("info", "--json", "--heights", str(1 << 20), "--dem", DEM).stdout)["datasets"]
        for dataset, line in zip(found, done.stdout.splitlines()[1:5], strict=True):
            self.assertTrue(line.endswith(f", {dataset['lowest_m']:.1f} to {dataset['highest_m']:.1f} m"), line)
        self.assertEqual(document["uncovered"], [])

    def test_info_shows_gaps(self):
        wide = self.path("wide")
        self.assertEqual(run("sample", wide, "--south-deg", "-1", "--west-deg", "29", "--rows", "1", "--columns", "3", "--ppd", "64").returncode, 0)
        for name in os.listdir(wide):
            if "E030" in name and "E031" in name:
                os.remove(os.path.join(wide, name))
        document = json.loads(run("info", "--json", "--dem", wide).stdout)
        self.assertEqual(len(document["datasets"]), 2)
        self.assertEqual([(gap["west_deg"], gap["east_deg"]) for gap in document["uncovered"]], [(30.0, 31.0)])


if __name__ == "__main__":
    harness.main()
