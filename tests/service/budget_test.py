"""All memory is on one budget: what does not fit waits, is told when to come back, or is refused for good."""

import io
import json
import socket
import time
import zipfile

import harness
from harness import Service, WithService, frame_request, sample, tearDownModule

MEMORY_MB, CACHE_MB, SCENE_MB, MESH_MB = 1028, 64, 64, 16
EVERYTHING = ("image", "radiance", "depth", "range", "position", "geodetic", "normal", "angles", "lit", "gsd", "source",
              "object_id", "detail")


def setUpModule():
    harness.set_up()
    sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")


def head_of(service, request):
    body = json.dumps(request).encode()
    return (f"POST /v1/frames HTTP/1.1\r\nHost: {service.host}\r\nContent-Type: application/json\r\n"
            f"Accept: application/x-npz\r\nContent-Length: {len(body)}\r\n\r\n").encode() + body


class Budget(WithService):
    options = ("--memory-mb", str(MEMORY_MB), "--cache-mb", str(CACHE_MB), "--scene-mb", str(SCENE_MB),
               "--mesh-mb", str(MESH_MB))

    def setUp(self):
        self.service.wait_for("selenograph_request_memory_bytes", 0)

    def test_what_never_fits_is_refused(self):
        problem = self.problem(self.service.frame(frame_request(EVERYTHING, width=4096, height=2048)), 422, "/camera")
        self.assertIn("--memory-mb", problem["errors"][0]["detail"])

    def test_what_fits_is_served_and_given_back(self):
        status, _, body = self.service.frame(frame_request(EVERYTHING, width=1024, height=1024), "application/x-npz")
        self.assertEqual(status, 200, body[:300])
        self.service.wait_for("selenograph_request_memory_bytes", 0)

    def test_rocks_are_on_the_budget(self):
        """Places and shapes of as many as a frame or a batch of rays may have: 74 MB, of 56 that requests have here."""
        service = Service("--assets-dir", harness.assets(), "--memory-mb", "720", *self.options[2:])
        rays = {"rays": [{"origin_m": [1757400.0, 0, 0], "direction": [-1, 0, 0]}]}
        for path, request, pointer in (("/v1/frames", frame_request(), "/camera"), ("/v1/rays", rays, "/rays")):
            with self.subTest(path):
                self.assertEqual(service.post(path, request)[0], 200)
                self.problem(service.post(path, dict(request, detail="landing")), 422, pointer)
        self.assertEqual(service.post("/v1/frames", frame_request(detail="highlands"))[0], 200)
        self.assertEqual(service.stop(), 0)

    def test_answers_that_nobody_reads_are_on_the_budget(self):
        """Of answers of 111 MB each, a few fit at once; the others wait without a slot, and small frames pass them."""
        request = frame_request(EVERYTHING, width=1024, height=1024)
        readers = []
        for _ in range(10):
            reader = socket.create_connection((self.service.host, self.service.port))
            reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            reader.sendall(head_of(self.service, request))
            readers.append(reader)
        harness.wait_until(lambda: self.service.metric("selenograph_frames_waiting") > 0 and
                           self.service.metric("selenograph_frames_in_work") == 0, "full memory")
        self.assertLess(self.service.resident_mb("VmHWM"), 1.15 * MEMORY_MB)
        self.assertEqual(self.service.frame(frame_request())[0], 200)
        for reader in readers:
            reader.close()

    def peak_mb_of(self, ask):
        before = self.service.resident_mb()
        with open(f"/proc/{self.service.process.pid}/clear_refs", "w") as reset:
            reset.write("5")  # proc(5): the peak starts anew
        answer = ask()
        return answer, self.service.resident_mb("VmHWM") - min(before, self.service.resident_mb())

    def test_a_packed_text_is_on_the_budget(self):
        """17 KB of an .npz hold 16 MB of JSON, whose document would take 834 MB: no more text than a body may have is read."""
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("request.json", "[" + "{}," * 5500000 + "{}]")
        self.assertLess(len(packed.getvalue()), 100000)
        headers = {"Content-Type": "application/x-npz"}
        answer, peak_mb = self.peak_mb_of(lambda: self.service.ask("POST", "/v1/rays", packed.getvalue(), headers))
        self.problem(answer, 413)
        self.assertLess(peak_mb, 60)

    def test_the_peak_of_a_large_frame(self):
        """Products and answer exist once each."""
        width, height, bytes_per_pixel = 1536, 1024, 106
        answer_mb = width * height * bytes_per_pixel / 2**20
        for accept in ("application/x-npz", "image/x-exr"):
            request = frame_request(EVERYTHING, width=width, height=height)
            (status, _, body), peak_mb = self.peak_mb_of(lambda: self.service.frame(request, accept))
            self.assertEqual(status, 200, body[:300])
            self.assertGreater(len(body), 0.95 * answer_mb * 2**20)
            self.assertLess(peak_mb, 2.3 * len(body) / 2**20 + 100, accept)
            time.sleep(2)  # freed memory goes back to the system


if __name__ == "__main__":
    harness.main()
